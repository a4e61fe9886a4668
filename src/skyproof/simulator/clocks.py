"""Receiver clocks: simulate the time that a receiver with an oscillator of a given class shows.

`offset_s(t)` is what the clock shows minus true time, at true time t since the scene's start, and `drift(t)` its
derivative. One oscillator makes the sampling clock and the local carrier, so the same function serves the sampling
times, the code and the carrier phase: with `Receiver.lo_ppm` of p alone, the drift is p * 1e-6, the clock counts
1 + p * 1e-6 seconds in a true second, and `true_minus_shown_s` is what `ReceiverSky.true_minus_elapsed_s` says, up to
what the clock showed at the first sample.

The noise is white, flicker and random-walk frequency noise of the densities h0 + h-1 / f + h-2 / f^2. On a grid of
knots, fixed whatever is asked for, phase and frequency follow the exact discrete law of the two-state model (Brown and
Hwang, Introduction to Random Signals and Applied Kalman Filtering, 4th ed., 9.3; Zucca and Tavella, IEEE Trans. UFFC
52, 2005, 289-296). Flicker noise has no finite state; it is a sum of Gauss-Markov processes a decade apart, which keeps
within 6 % of h-1 / f from 1e-4 Hz to 2 Hz, and within 12 % from 3e-5 Hz to 5 Hz. Between the knots runs a cubic Hermite
curve with central differences for slopes: the clock is a smooth function, and averaging times from two knots on have
the noise they should.
"""

from collections.abc import Callable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.gnss.oscillators import OSCILLATORS, Oscillator
from skyproof.statistics.gauss_markov import gauss_markov_path, gauss_markov_step

__all__ = ["LEAD_S", "Clock", "make_clock"]

STEP_S = 1.0 / 256.0
"""Of the knots: as long as the samples' chunks of straight phase at their longest, and exact in binary."""
BLOCK = 4096
"""Knots that have a noise stream of their own. Only the state at the start of each is kept: 80 bytes for 16 s."""
LEAD_S = BLOCK * STEP_S
"""How far before zero, and after its duration, a clock can be asked."""
_LEAD_BLOCKS = 2  # before zero; the first serves as a neighbour only
_STREAM = 0x636C6F636B  # sets the clock's random numbers apart from others of the same seed
_FLICKER_S = 10.0 ** np.arange(-2.0, 5.0)  # correlation times
_ROUNDS = 6  # of the inversion; each shrinks the error by the drift, 1e-3 at most


@dataclass(frozen=True, eq=False, kw_only=True)
class Clock:
    """A clock over true times from -LEAD_S to duration_s + LEAD_S. Safe to ask from several threads.

    start_s : offset at time zero; slope : its steady drift, less the noise's frequency at time zero.
    knots : number of a block to the noise's phase (BLOCK + 3,) in s, one knot more on the left and on the right.
    """

    oscillator: Oscillator
    duration_s: float
    start_s: float
    slope: float
    knots: Callable[[int], Reals]

    def offset_s(self, t_s: ArrayLike) -> Reals:
        """Compute the clock's reading minus true time, at true times of any shape.

        Raises
        ------
        ValueError : a time lies outside what the clock was made for.
        """
        t_s = np.asarray(t_s, np.float64)
        return self.start_s + self.slope * t_s + self._compute_noise(t_s)[0]

    def drift(self, t_s: ArrayLike) -> Reals:
        """Compute by how many seconds a second the clock gets ahead: the derivative of `offset_s`, any shape."""
        return self.slope + self._compute_noise(np.asarray(t_s, np.float64))[1]

    def true_minus_shown_s(self, shown_s: ArrayLike) -> Reals:
        """Compute true time minus the clock's reading when it reads `shown_s`, any shape.

        It is small, so that it keeps its digits.

        Sample k is taken when the clock shows what it showed at sample 0 and k / rate more.
        """
        shown_s = np.asarray(shown_s, np.float64)
        late_s = np.full(shown_s.shape, -self.start_s)
        for _ in range(_ROUNDS):
            late_s = -self.offset_s(shown_s + late_s)
        return np.asarray(late_s)

    def _compute_noise(self, t_s: Reals) -> tuple[Reals, Reals]:
        """Compute the noise's phase and frequency by plain sums and products.

        A time's bytes depend on no other time.
        """
        if t_s.size and not -LEAD_S <= t_s.min() <= t_s.max() <= self.duration_s + LEAD_S:
            raise ValueError(
                f"times from {t_s.min():g} to {t_s.max():g} s asked of a clock made for {-LEAD_S:g} to "
                f"{self.duration_s + LEAD_S:g} s; make it with a longer duration_s"
            )
        whole = np.floor(t_s / STEP_S)
        part = t_s / STEP_S - whole
        block, first = np.divmod(whole.astype(np.int64) + _LEAD_BLOCKS * BLOCK, BLOCK)
        around = np.empty((4, t_s.size))
        order = np.argsort(block, axis=None, kind="stable")
        for members in np.split(order, np.flatnonzero(np.diff(block.ravel()[order])) + 1) if t_s.size else ():
            knots = self.knots(int(block.flat[members[0]]))
            around[:, members] = knots[first.flat[members] + np.arange(4)[:, np.newaxis]]
        around = around.reshape(4, *t_s.shape)
        rise, slope_before, slope_after = (
            around[2] - around[1],
            0.5 * (around[2] - around[0]),
            0.5 * (around[3] - around[1]),
        )
        square, cube = 3.0 * rise - 2.0 * slope_before - slope_after, slope_before + slope_after - 2.0 * rise
        return (
            around[1] + part * (slope_before + part * (square + part * cube)),
            (slope_before + part * (2.0 * square + 3.0 * part * cube)) / STEP_S,
        )


def make_clock(
    kind: str | Oscillator,
    offset_s: float = 0.0,
    drift: float = 0.0,
    seed: int = 0,
    duration_s: float = 0.0,
    *,
    stream: int = 0,
) -> Clock:
    """Make a clock that is `offset_s` ahead at time zero and gains `drift` seconds a second, with noise.

    Parameters
    ----------
    kind : a name of OSCILLATORS, or densities of one's own.
    drift : of the steady frequency at time zero; 1e-6 is one part in a million too fast. White frequency noise comes
        on top of it.
    seed, stream : the same two give the same clock, however it is asked. Give the scene's seed, and as stream the
        receiver's number.
    duration_s : how long the clock can be asked, from zero on.

    Raises
    ------
    ScenarioError : no such kind, or a duration or drift that makes no sense.
    """
    oscillator = kind if isinstance(kind, Oscillator) else _find_oscillator(kind)
    if not (np.isfinite(duration_s) and duration_s >= 0.0):
        raise ScenarioError(f"clock: duration_s is {duration_s:g}, expected zero or more; give the length of the scene")
    if not abs(drift) < 1e-3 or not np.isfinite(offset_s):
        raise ScenarioError(
            f"clock: offset_s {offset_s:g}, drift {drift:g}; expected numbers, and a drift below 0.001; "
            "give the clock's error in seconds, and in seconds a second"
        )
    walk = _Walk(oscillator, seed, stream)
    n_blocks = _LEAD_BLOCKS + int((duration_s + LEAD_S) // LEAD_S) + 2
    starts = [walk.start()]
    for block in range(n_blocks):
        starts.append(walk.path(block, starts[-1])[1])
    at_zero = starts[_LEAD_BLOCKS].copy()
    for state in starts:
        state[0] -= at_zero[0]
    phase = lru_cache(maxsize=16)(lambda block: walk.path(block, starts[block])[0])

    @lru_cache(maxsize=8)
    def knots(block: int) -> Reals:
        return np.concatenate([phase(block - 1)[-2:-1], phase(block), phase(block + 1)[1:2]])

    return Clock(
        oscillator=oscillator, duration_s=duration_s, start_s=offset_s, slope=drift - at_zero[1:].sum(), knots=knots
    )


@dataclass(frozen=True)
class _Walk:
    """The noise from knot to knot. A state is (phase in s, random-walk frequency, flicker frequencies)."""

    oscillator: Oscillator
    seed: int
    stream: int

    def start(self) -> Reals:
        flicker = self._flicker_sigma * self._make_rng(0).standard_normal(_FLICKER_S.size)
        return np.concatenate([[0.0, 0.0], flicker])

    def path(self, block: int, state: Reals) -> tuple[Reals, Reals]:
        """Draw phases (BLOCK + 1,) at the knots of a block, from its start state; return them and the end state."""
        noise = self.oscillator
        if noise.white_s == noise.flicker == noise.walk_hz == 0.0:
            return np.zeros(BLOCK + 1), np.zeros_like(state)
        normals = self._make_rng(block + 1).standard_normal((BLOCK, state.size))
        walk_density = 2.0 * np.pi**2 * noise.walk_hz  # of the random walk's driving noise
        walk = state[1] + np.concatenate([[0.0], np.cumsum(np.sqrt(walk_density * STEP_S) * normals[:, 1])])
        step = gauss_markov_step(self._flicker_sigma, _FLICKER_S, STEP_S)
        flicker = gauss_markov_path(step, state[2:], normals[:, 2:])
        spread_s = np.sqrt(
            0.5 * noise.white_s * STEP_S + walk_density * STEP_S**3 / 12.0 + np.sum(np.square(step.spread))
        )  # of the phase between two knots whose frequencies are known
        gain_s = 0.5 * STEP_S * (walk[1:] + walk[:-1]) + spread_s * normals[:, 0]
        for k, half_s in enumerate(step.half):
            gain_s += half_s * (flicker[1:, k] + flicker[:-1, k])
        phase_s = state[0] + np.concatenate([[0.0], np.cumsum(gain_s)])
        return phase_s, np.concatenate([[phase_s[-1], walk[-1]], flicker[-1]])

    @property
    def _flicker_sigma(self) -> Reals:
        """Processes of variance h-1 ln r each, r apart in correlation time, sum up to h-1 / f."""
        return np.full(_FLICKER_S.size, np.sqrt(self.oscillator.flicker * np.log(10.0)))

    def _make_rng(self, part: int) -> np.random.Generator:
        seeds = np.random.SeedSequence(self.seed, spawn_key=(_STREAM, self.stream, part))
        return np.random.Generator(np.random.SFC64(seeds))


def _find_oscillator(kind: str) -> Oscillator:
    if kind in OSCILLATORS:
        return OSCILLATORS[kind]
    near = get_close_matches(kind.lower(), OSCILLATORS, n=1, cutoff=0.0)[0]
    raise ScenarioError(
        f"clock: {kind!r} is not a class of oscillator, perhaps {near!r}? Known: {', '.join(OSCILLATORS)}"
    )
