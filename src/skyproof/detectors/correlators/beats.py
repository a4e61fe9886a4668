"""Test if the beats of all satellites' signals are those of one further sky: arrays only.

Two signals of a satellite that a correlator cannot part beat: the power of their sum has a line at the difference of
their carriers, even if one is 20 dB weaker. A further sky, whose receiver would move by w (m/s) and whose clock would
run by d (m/s) beside the tracked one's, gives the satellite in direction u a line at

    |u . w - d| / wavelength

less a multiple of the rate of looks. Four unknowns explain any four lines; ten lines that they explain are of one sky.
Reflections make lines as well:

- of several reflectors they fit the unknowns by chance only. Their frequencies are taken as log-uniform, no decade
  being likelier than another, or as uniform up to the fastest, whichever is denser.
- of one reflector for all satellites, or of parallel ones, they are those of the antenna's image. An image moves as
  fast as the antenna and has its clock: |v + w| = |v| and d = 0 (Kaplan & Hegarty, 9.5: specular reflection). If the
  reflector moves, all satellites are still before it, and u . w has one sign. Either is weaker than what it reflects by
  3 dB at least, so a power that all but vanishes in every beat is of none.

What modulates all signals at one rate (a radar, the mains, a rotor) has w = 0, as has a further sky at the same place
whose clock runs otherwise.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations, product
from math import comb, log, prod
from typing import NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.correlators.policy import POLICY
from skyproof.detectors.dccaf.delays import DccafSettings
from skyproof.detectors.dccaf.policy import POLICY as DCCAF
from skyproof.statistics.distributions import binomial_survival, chi_square_survival, normal_two_sided
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = [
    "CommonMotion",
    "Line",
    "common_p_value",
    "find_line",
    "fit_common_motion",
    "mirror_p_value",
    "weaker_p_value",
]

_UNKNOWNS = 4


class Line(NamedTuple):
    """The strongest line of a signal's power: frequency_hz, and sigma_hz of it; statistic : over the noise's mean.
    depth, depth_sigma : its amplitude over the mean power, which noise makes larger."""

    frequency_hz: float
    sigma_hz: float
    statistic: float
    depth: float = 0.0
    depth_sigma: float = 0.0


class CommonMotion(NamedTuple):
    """What explains most lines: state (4,) of w and d in m/s, and which lines (n,) it explains.

    design : (m, 4) of those. off_m_s, sigma_m_s : (m,) by how much the state leaves them, and its sigma. p_value : of
    independent lines.
    """

    state: Reals
    explained: Booleans
    design: Reals
    off_m_s: Reals
    sigma_m_s: Reals
    p_value: float

    def without(self, out: tuple[int, ...]) -> tuple[Reals, Reals] | None:
        """Fit again without some of the explained lines: state and covariance; None if too few are left."""
        white = np.delete(self.design / self.sigma_m_s[:, np.newaxis], out, axis=0)
        if np.linalg.matrix_rank(white) < _UNKNOWNS:
            return None
        covariance = np.asarray(np.linalg.inv(white.T @ white), np.float64)
        return self.state - covariance @ white.T @ np.delete(self.off_m_s / self.sigma_m_s, out), covariance

    def largest_p_value(self, test: Callable[[Reals, Reals], float]) -> float:
        """Return the largest p-value of a test of state and covariance without any two lines, which may be others'."""

        def p_values(sets: Iterable[tuple[int, ...]]) -> Iterator[float]:
            for out in sets:
                fitted = self.without(out)
                yield 1.0 if fitted is None else test(*fitted)

        lines = range(self.off_m_s.size)
        return largest_p_value_without(lines, p_values, counts=(0, 1, 2), least=_UNKNOWNS + 1, enough=0.5)


def find_line(power: Reals, step_s: float) -> Line | None:
    """Find the line of a series of powers (n,) that noise makes with `signal_probability` at most; None without one.

    The spectrum of white noise is exponential at each frequency (Kay, Detection Theory, 7.6.3); its mean is taken from
    the median. power : of any unit. step_s : from look to look.
    """
    n = power.size
    looks = np.arange(n)
    rest = power / power.mean() - 1.0
    rest = (rest - np.polyval(np.polyfit(looks, rest, 2), looks)) * np.hanning(n)
    spectrum = np.abs(np.fft.rfft(rest, 4 * n)) ** 2
    frequency_hz = np.fft.rfftfreq(4 * n, step_s)
    within = np.flatnonzero((frequency_hz > POLICY.least_beat_hz) & (frequency_hz < POLICY.most_beat_share / step_s))
    spectrum /= np.median(spectrum[within]) / log(2.0)
    top = int(within[np.argmax(spectrum[within])])
    statistic = float(spectrum[top])
    # A top at the edge of the band is the flank of what is slower or faster.
    if top in (within[0], within[-1]) or within.size * np.exp(-statistic) > POLICY.signal_probability:
        return None
    before, at, after = np.log(spectrum[top - 1 : top + 2])
    shift = 0.5 * (before - after) / (before - 2.0 * at + after)
    spread_hz = 1.0 / (n * step_s)
    sigma_hz = spread_hz * np.hypot(POLICY.beat_sigma_bins, np.sqrt(1.5 / statistic) / np.pi)
    line_hz = float(frequency_hz[top] + shift * (frequency_hz[1] - frequency_hz[0]))
    phase_rad = np.asarray(2.0 * np.pi * line_hz * step_s * looks, np.float64)
    return Line(line_hz, float(sigma_hz), statistic, *_measure_depth(power, phase_rad))


def _measure_depth(power: Reals, phase_rad: Reals) -> tuple[float, float]:
    """Measure the amplitude of a line of known phase in powers (n,) over their mean, and its sigma."""
    design = np.column_stack([np.ones(power.size), np.cos(phase_rad), np.sin(phase_rad)])
    fitted, _, _, _ = np.linalg.lstsq(design, power, rcond=None)
    rest = float(np.std(power - design @ fitted))
    return float(np.hypot(*fitted[1:]) / fitted[0]), float(np.sqrt(2.0 / power.size) * rest / fitted[0])


def fit_common_motion(lines: Sequence[Line], wavelength_m: Reals, design: Reals, step_s: float) -> CommonMotion | None:
    """Fit one motion and clock to lines (n,), whose signs are not known; None if it explains too few.

    wavelength_m : (n,) of the signals. design : (n, 4) rows of u and -1. step_s : from look to look.
    """
    n = len(lines)
    if n < _UNKNOWNS + POLICY.beats_more:
        return None
    seen = _Seen(
        design=design,
        rate_m_s=wavelength_m * [line.frequency_hz for line in lines],
        sigma_m_s=wavelength_m * [line.sigma_hz for line in lines],
        repeat_m_s=wavelength_m / step_s,
    )
    # Without a clock that runs otherwise, three lines tell a motion.
    families = product((_UNKNOWNS - 1, _UNKNOWNS), POLICY.repetitions)
    found = [_fit_most(seen, lines, unknowns, repeated, step_s) for unknowns, repeated in families]
    best = min((motion for motion in found if motion is not None), key=lambda motion: motion.p_value, default=None)
    return best and best._replace(p_value=min(1.0, len(found) * best.p_value))


def _fit_most(seen: "_Seen", lines: Sequence[Line], unknowns: int, repeated: int, step_s: float) -> CommonMotion | None:
    """Fit the state that explains most lines, of those that as few of them give; None if it explains too few.

    unknowns : of w alone, 3, or of d as well, 4; so many lines give them. repeated : times that the rate of looks may
    hide in a line, to either side.
    """
    bases = np.array(list(combinations(range(len(lines)), unknowns)))
    conditions = np.linalg.cond(seen.design[bases][..., :unknowns])
    order = np.argsort(conditions, kind="stable")[: POLICY.bases]
    bases = bases[order]
    branches = np.arange(-repeated, repeated + 1)
    signed = seen.rate_m_s + seen.repeat_m_s * branches[:, np.newaxis]
    choices = np.concatenate([signed, -signed])
    # Turning all signs over turns the state over: the first line is taken with one.
    others = product(range(branches.size), *[range(len(choices))] * (unknowns - 1))
    right = choices[np.array(list(others))[np.newaxis], bases[:, np.newaxis, :]]
    inverses = np.linalg.pinv(seen.design[bases][..., :unknowns])
    states = np.zeros((right.shape[0] * right.shape[1], _UNKNOWNS))
    states[:, :unknowns] = np.einsum("bij,bpj->bpi", inverses, right).reshape(-1, unknowns)
    reach = POLICY.beat_sigmas * conditions[order[0]] * seen.sigma_m_s
    fits = (np.abs(seen.leave(states)) < reach).sum(axis=1)
    most = np.argsort(-fits, kind="stable")[: POLICY.refined]
    refined = (_refine(states[k], reach, seen, unknowns) for k in most)
    state, explained = max(refined, key=lambda fitted: int(fitted[1].sum()))
    if explained.sum() < _UNKNOWNS + POLICY.beats_more:
        return None
    p_value = _bound_chance(explained, lines, step_s, len(states), unknowns)
    if unknowns < _UNKNOWNS:  # what it explains is tested with all unknowns
        state, explained = _refine(state, POLICY.beat_sigmas * seen.sigma_m_s, seen, _UNKNOWNS)
    off_m_s = seen.leave(state)
    if np.ptp(seen.repeat_m_s) == 0.0:  # all lines repeat alike, and so does the clock
        state[3] -= seen.repeat_m_s[0] * np.rint(state[3] / seen.repeat_m_s[0])
    return CommonMotion(
        state, explained, seen.design[explained], off_m_s[explained], seen.sigma_m_s[explained], p_value
    )


class _Seen(NamedTuple):
    """Rates (n,) of lines, m/s, their sigmas, and those of the looks, with which they repeat; design (n, 4)."""

    design: Reals
    rate_m_s: Reals
    sigma_m_s: Reals
    repeat_m_s: Reals

    def leave(self, states: Reals) -> Reals:
        """Return by how much states (..., 4) leave the lines (..., n): the nearest of their signs and repetitions."""
        expected = states @ self.design.T
        off = np.stack([expected - self.rate_m_s, expected + self.rate_m_s])
        off -= self.repeat_m_s * np.rint(off / self.repeat_m_s)
        return np.asarray(np.where(np.abs(off[0]) < np.abs(off[1]), off[0], off[1]))


def _refine(state: Reals, reach: Reals, seen: _Seen, unknowns: int) -> tuple[Reals, Booleans]:
    """Fit the lines that a state explains by least squares, until they stay the same; first those within reach (n,)."""
    state, fits = state.copy(), np.abs(seen.leave(state)) < reach
    for _ in range(POLICY.refined):
        white = seen.design[fits, :unknowns] / seen.sigma_m_s[fits, np.newaxis]
        if np.linalg.matrix_rank(white) < unknowns:
            break
        state[:unknowns] -= np.linalg.lstsq(white, seen.leave(state)[fits] / seen.sigma_m_s[fits], rcond=None)[0]
        now = np.abs(seen.leave(state)) < POLICY.beat_sigmas * seen.sigma_m_s
        if np.array_equal(now, fits):
            break
        fits = now
    return state, fits


def _bound_chance(explained: Booleans, lines: Sequence[Line], step_s: float, tried: int, unknowns: int) -> float:
    """Bound the probability that so many independent lines fit any state tried.

    Their density is the larger of log-uniform and uniform up to the fastest. As many as there are unknowns always fit:
    those are taken that fit most easily.
    """
    e_folds = log(POLICY.most_beat_share / step_s / POLICY.least_beat_hz)
    fastest_hz = max(line.frequency_hz for line in lines)
    chances = [
        min(1.0, 2.0 * POLICY.beat_sigmas * line.sigma_hz / min(line.frequency_hz * e_folds, fastest_hz))
        for line, fits in zip(lines, explained, strict=True)
        if fits
    ]
    more = sorted(chances)[:-unknowns]
    return min(1.0, tried * comb(len(lines) - unknowns, len(more)) * prod(more))


def mirror_p_value(motion: CommonMotion, velocity_m_s: Reals, covariance_m2_s2: Reals) -> float:
    """Return the p-value of an image of the antenna in a fixed reflector, or in one that moves.

    In a fixed one |v + w| = |v| and d = 0, of w or -w. One that moves has all satellites before it: u . w has one sign.
    velocity_m_s : (3,) of the tracked sky with its covariance (3, 3).
    """

    def test_fixed(state: Reals, covariance: Reals) -> float:
        found = []
        for sign in (1.0, -1.0):
            w, d = sign * state[:3], sign * state[3]
            slope = np.zeros((2, _UNKNOWNS))
            slope[0, :3], slope[1, 3] = velocity_m_s + w, 1.0
            spread = slope @ covariance @ slope.T
            spread[0, 0] += w @ covariance_m2_s2 @ w
            off = np.array([velocity_m_s @ w + 0.5 * w @ w, d])
            found.append(float(chi_square_survival(off @ np.linalg.solve(spread, off), 2)))
        return max(found)

    state, covariance = motion.without(()) or (motion.state, np.zeros((_UNKNOWNS, _UNKNOWNS)))
    to_line = motion.design[:, :3]
    along = np.sort(to_line @ state[:3] / np.sqrt(np.einsum("ni,ij,nj->n", to_line, covariance[:3, :3], to_line)))
    # One line may be another reflector's: the second of either sign counts.
    one_sign = along.size * float(normal_two_sided(max(min(along[-2], -along[1]), 0.0)))
    return min(1.0, max(motion.largest_p_value(test_fixed), one_sign))


def weaker_p_value(lines: Sequence[Line | None]) -> float:
    """Return the p-value of reflections, weaker by `reflected_weaker_db` than what they reflect.

    A second signal of the amplitude a beside the first makes a line of the depth 2 a / (1 + a^2). Several reflections
    of a satellite may add to more as rarely as `dccaf` allows for. lines : of each satellite, None without one.
    """
    amplitude = 10.0 ** (-0.05 * DCCAF.reflected_weaker_db)
    most = 2.0 * amplitude / (1.0 + amplitude**2)
    p_values = [1.0 if line is None else _p_of_depth(line, most) for line in lines]
    deep = sum(p_value < POLICY.signal_probability for p_value in p_values)
    chance = DccafSettings.no_reflection_probability + POLICY.signal_probability
    return float(binomial_survival(deep, len(lines), chance))


def _p_of_depth(line: Line, most: float) -> float:
    """Return the p-value of a depth of so much at most."""
    over = line.depth - most
    return 0.5 * float(normal_two_sided(over / max(line.depth_sigma, 1e-9))) if over > 0.0 else 1.0


def common_p_value(motion: CommonMotion) -> float:
    """Return the p-value of one modulation of all signals: w = 0."""
    return motion.largest_p_value(
        lambda state, covariance: float(
            chi_square_survival(state[:3] @ np.linalg.solve(covariance[:3, :3], state[:3]), 3)
        )
    )
