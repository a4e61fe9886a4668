"""The whole receiver and `protect` behind drawn correlators: what every tap holds, in closed form, without samples.

Loops, lock control, telemetry, measurements, detectors, prediction and decision are the package's own, as they are. In
place of samples and of the kernels that correlate them stand signals and reflections of a simulated scene: over each
code period one of amplitude A adds to a tap d chips ahead

    A R(lag - d) sin(pi f T)/(pi f T) exp(2 pi i phase)

with lag, phase and frequency f against the replica as the loops steer it, R the correlation of the code behind the
front end with the receiver's low-pass replica. Amplitudes, the quantiser's loss and the noise (the other satellites'
signals in it) are those of `skyproof.simulator.correlate`. Noise is Gaussian and correlates between taps as replicas
do. Correlation grids are made alike with a replica that the grid's band cuts off.

A search finds what stands above `FIND_DBHZ` a chip or more from all that is followed. Left out: noise that channels on
one satellite, or a channel and its grid, have in common; what sampled chips fold back; cross-correlation but as noise;
the turn of a data bit within a code period of a signal that is late by a chip.
"""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from drawn_receiver import FIND_DBHZ
from numpy.typing import NDArray

from skyproof.app.common.body import body_of, open_body
from skyproof.app.common.platform import read_platform
from skyproof.app.common.platform_use import described, settings_of
from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.app.common.windows import asked, following_epochs
from skyproof.app.protect.document import Outcome, document
from skyproof.app.protect.foresights import antenna_units, foresights_of, unit_of
from skyproof.app.protect.run import judge
from skyproof.app.receive.measured import MeasurementLog, RowLog
from skyproof.app.receive.reception import Reception, observe
from skyproof.app.receive.tracker import Tracker, guiding_of, receiver_settings
from skyproof.arrays import Complexes, Floats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.formats.pieces import Workspace
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of
from skyproof.navigation.vector_inertia import AntennaUnit
from skyproof.receiver import kernels as k
from skyproof.receiver.acquisition import KnownSignal, Peak
from skyproof.receiver.grids import N_META, NOISE_TAPS, GridCorrelator, Grids
from skyproof.receiver.looking import Lookout
from skyproof.receiver.replica import CODE_SCALE, passed
from skyproof.receiver.settings import ReceiverSettings
from skyproof.receiver.state import ReceiverState
from skyproof.receiver.tracking import MEASURE_FRAMES, Receiver
from skyproof.records import NavigationData, Samples
from skyproof.simulator import aligned, correlate
from skyproof.simulator.received import Scene, row_of
from skyproof.simulator.samples import low_pass
from skyproof.verdict import Verdict

__all__ = ["DrawnReceiver", "Waves", "judged", "received_of", "reception_of", "waves_of"]

POINTS = 32
"""A chip, of tables of correlation."""
STEP_S = 0.1
"""Phases and delays are parabolas over each; amplitudes are those of its middle."""
FIND_CHIPS, FOUND_CHIPS, FOUND_HZ = 1.0, 0.1, 25.0
"""How far a search keeps from what is followed, and how far off what it finds is."""
_RIDGE = 1e-9

SIGNAL = GPS_L1_CA


# ---------------------------------------------------------------------- what arrives


@dataclass(frozen=True, eq=False)
class Waves:
    """Signals and reflections at one antenna, over steps of `STEP_S` of the sampling clock.

    code_s, turns_cyc : (n_steps, n_waves, 3) of 1, u, u^2 with u from 0 to 1 over the step: time of transmission less
        that of the sampling clock, and the carrier's phase in the samples. amplitude : (n_steps, n_waves), of a sample.
    white : (n_steps, n_waves) variance of a sample's noise in I and in Q for that satellite; power : (n_steps,) mean of
        I^2 + Q^2 of samples. symbols, guesses : (n_waves, n_symbols); guessed : (n_waves,) share of a symbol's first
        code period. lead_s : of the first symbol before the scene.
    """

    sats: tuple[str, ...]
    code_s: Reals
    turns_cyc: Reals
    amplitude: Reals
    white: Reals
    power: Reals
    symbols: NDArray[np.int8]
    guesses: NDArray[np.int8]
    guessed: Reals
    lead_s: float

    def of(self, sat: str) -> Integers:
        """Which waves are of a satellite."""
        return np.flatnonzero(np.array(self.sats) == sat)


def waves_of(scene: Scene, index: int) -> Waves:
    """Of antenna number `index` over the whole scene."""
    sky, front_end = scene.skies[index], scene.scenario.front_end
    if front_end.kind != "complex":
        raise ValueError("samples must be complex")
    n_steps = math.ceil(scene.scenario.duration_s / STEP_S) + 2
    knots_s = STEP_S * np.arange(2 * n_steps + 1) / 2.0
    ahead_s = sky.true_minus_elapsed_s(knots_s)
    true_s = knots_s + ahead_s
    of = np.array([*range(len(sky.signals)), *(ray.of for ray in sky.rays)], np.int64)
    code_s, carrier_s = (each[:, of].copy() for each in sky.delays_s(true_s))
    for row, ray in enumerate(sky.rays, len(sky.signals)):
        further_s = ray.further_s(true_s)
        code_s[:, row] += further_s
        carrier_s[:, row] += further_s - (ray.phase_cyc + ray.rate_hz * true_s) / SIGNAL.carrier_hz
    turns_cyc = SIGNAL.carrier_hz * (ahead_s[:, None] - carrier_s) + front_end.if_hz * knots_s[:, None]
    middle_s = STEP_S * (np.arange(n_steps) + 0.5)
    seen: dict[str, Any] = {"delays_chips": (0.0,), "coherent_s": SIGNAL.period_s, "tracked": aligned(scene, index)}
    alone, among = (correlate(scene, index, middle_s, others=each, **seen) for each in ("neglected", "noise"))
    parts = alone.parts
    own = (parts.channel == parts.signal) & (parts.ray < 0)
    amplitude = np.zeros((n_steps, len(sky.signals)))
    amplitude[:, parts.signal[own]] = np.abs(parts.weight[:, own])
    amplitude = amplitude[:, of] * np.array([1.0] * len(sky.signals) + [ray.amplitude for ray in sky.rays])
    sampled = front_end.rate_hz * SIGNAL.period_s
    rows, messages = row_of(scene.messages, [sky.signals[column] for column in of]), scene.messages
    return Waves(
        sats=tuple(sky.signals[column].id.sat for column in of),
        code_s=_parabolas(ahead_s[:, None] - code_s),
        turns_cyc=_parabolas(turns_cyc),
        amplitude=amplitude,
        white=among.noise_sigma[:, of] ** 2 * sampled,
        power=2.0 * alone.noise_sigma[:, 0] ** 2 * sampled + np.sum(amplitude**2, axis=1),
        symbols=messages.symbols[rows],
        guesses=messages.guesses[rows],
        guessed=messages.guess_s[rows] / SIGNAL.period_s,
        lead_s=messages.lead_s,
    )


def _parabolas(values: Reals) -> Reals:
    """Through start, middle and end of each step: (2 n_steps + 1, n) to (n_steps, n, 3)."""
    first, middle, last = values[:-2:2], values[1::2], values[2::2]
    return np.stack([first, 4.0 * middle - 3.0 * first - last, 2.0 * (first + last) - 4.0 * middle], axis=-1)


# ---------------------------------------------------------------------- what replicas make of it


@dataclass(frozen=True, eq=False)
class Shapes:
    """Of one code: correlation of what arrives with a replica, and of the replica with itself, `POINTS` a chip."""

    signal: Reals
    replica: Reals


@cache
def shapes(prn: int, rate_hz: float, bandwidth_hz: float | None, band_hz: float | None) -> Shapes:
    """band_hz : to which a replica is cut; None stands for the receiver's own low-pass."""
    code = SIGNAL.code(prn).astype(np.float64)
    lines = np.arange(code.size * POINTS // 2 + 1)
    hz = lines / code.size * SIGNAL.chip_rate_hz
    power = (np.abs(np.fft.fft(code)) ** 2)[lines % code.size] * np.sinc(lines / code.size) ** 2 / code.size**2
    arrives = np.ones(hz.size) if bandwidth_hz is None else low_pass(hz, bandwidth_hz)
    replica = passed(hz / rate_hz) if band_hz is None else np.asarray(hz <= 0.5 * band_hz, np.float64)

    def table(shape: Reals) -> Reals:
        return np.asarray(np.fft.irfft(power * shape, code.size * POINTS) * (code.size * POINTS))

    level = math.sqrt(float(table(arrives**2)[0]))
    return Shapes(signal=table(arrives * replica) / level, replica=table(replica**2))


def read(table: Reals, lag_chips: Reals) -> Reals:
    """A table of `POINTS` a chip at lags of any shape."""
    at = np.mod(lag_chips * POINTS, table.size)
    whole = at.astype(np.int64)
    return np.asarray(table[whole % table.size] * (1.0 - at + whole) + table[(whole + 1) % table.size] * (at - whole))


def noise_root(table: Reals, delays_chips: Reals) -> Reals:
    """Lower triangle whose square is the covariance of replicas' noise, of variance 1 a sample."""
    covariance = read(table, np.subtract.outer(delays_chips, delays_chips))
    return np.linalg.cholesky(covariance + _RIDGE * table[0] * np.eye(delays_chips.size))


# ---------------------------------------------------------------------- the receiver


class DrawnReceiver(Receiver):
    """The receiver, whose correlators are drawn; it takes samples of no plane, (0, n), which say how many there are."""

    def __init__(self, scene: Scene, index: int, settings: ReceiverSettings, rng: np.random.Generator) -> None:
        front_end = scene.scenario.front_end
        super().__init__(front_end.rate_hz, front_end.if_hz, settings)
        if self.taps_hz.size > 1 or self.settings.joint:
            raise ValueError("only one Doppler is drawn, and no joint channel")
        self.waves = waves_of(scene, index)
        self._rng = rng
        self._shape = front_end.rate_hz, front_end.bandwidth_hz
        self._lookout = DrawnLookout(self.rate_hz, self.if_hz, self.settings, self.waves, rng)
        if self.grids is not None:
            self.grids = DrawnGrids(self.grids, front_end.bandwidth_hz, self.waves, rng)
        self._of: dict[str, tuple[Integers, Reals, Reals]] = {}

    def _advance(self, state: ReceiverState, begin: int, end: int) -> ReceiverState:
        n = len(state.channels)
        if n == 0:
            return state
        rows = np.zeros((n, self._max_periods, k.row_size(self.n_taps, 1)))
        counts, loops = np.zeros(n, np.int64), state.loops.copy()
        loops[:, [k.LOCK_I, k.LOCK_Q, k.LOCK_COUNT]] = 0.0
        power = float(self.waves.power[min(state.frame, len(self.waves.power) - 1)]) * CODE_SCALE**2
        noise = self._rng.standard_normal((n, self._max_periods, self.n_taps, 2))
        arriving = [(w, stop, i) for w, stop in self._stretches(begin, end) for i in range(n)]
        for w, stop, i in arriving:
            of, table, root = self._known(state.channels[i].sat)
            _followed(
                stop,
                power,
                loops[i],
                w.code_s[:, of],
                w.turns_cyc[:, of],
                w.amplitude[:, of],
                w.white[:, of[:1]],
                w.symbols[of],
                w.guesses[of],
                w.guessed[of],
                w.lead_s,
                table,
                root,
                noise[i],
                self.taps_chips,
                self._look_samples,
                self.settings.look_share,
                self.rate_hz,
                self.if_hz,
                SIGNAL.chip_rate_hz,
                SIGNAL.carrier_hz,
                SIGNAL.code_length,
                self.discriminator.gain,
                rows[i],
                counts[i : i + 1],
            )
        prompts = tuple(
            (*old, rows[i, : counts[i], k.OUT_TAPS + 2].astype(np.float32)) for i, old in enumerate(state.prompts)
        )
        noise_power = power * self.rate_hz * SIGNAL.period_s
        return replace(state, loops=loops, rows=rows, counts=counts, prompts=prompts, noise=noise_power)

    def _stretches(self, begin: int, end: int) -> list[tuple[Waves, int]]:
        """What arrives from sample `begin` on, and up to where."""
        return [(self.waves, end)]

    def _known(self, sat: str) -> tuple[Integers, Reals, Reals]:
        if sat not in self._of:
            shape = shapes(prn_of(sat), *self._shape, None)
            self._of[sat] = self.waves.of(sat), shape.signal, noise_root(shape.replica, self.taps_chips)
        return self._of[sat]


@compiled
def _followed(
    end: int,
    sample_power: float,
    state: Reals,
    code_s: Reals,
    turns_cyc: Reals,
    amplitude: Reals,
    white: Reals,
    symbols: NDArray[np.int8],
    guesses: NDArray[np.int8],
    guessed: Reals,
    lead_s: float,
    table: Reals,
    root: Reals,
    noise: Reals,
    taps_chips: Reals,
    look_samples: float,
    look_share: float,
    rate_hz: float,
    if_hz: float,
    code_rate_hz: float,
    carrier_hz: float,
    code_length: int,
    code_gain: float,
    out: Reals,
    count: Integers,
) -> None:
    """`kernels.advance` of one channel, with waves in place of samples before the absolute index `end`."""
    n_taps, n_waves = taps_chips.shape[0], code_s.shape[1]
    sums = np.empty((n_taps, 2))
    while count[0] < out.shape[0]:
        chips_per_sample = state[k.CODE_RATE] / rate_hz
        n = math.ceil((code_length - state[k.CHIP]) / chips_per_sample)
        if state[k.START] + n > end:
            break
        looked = state[k.START] % look_samples < look_share * look_samples
        taken = n_taps if looked else 3
        row = out[count[0]]
        at_s = (state[k.START] + 0.5 * (n - 1)) / rate_hz
        step = min(int(at_s / STEP_S), code_s.shape[0] - 1)
        u = at_s / STEP_S - step
        sums[:] = 0.0
        for wave in range(n_waves):
            size = amplitude[step, wave]
            if size <= 0.0:
                continue
            a, b, c = code_s[step, wave]
            sent_s = at_s + a + u * (b + u * c)
            lag = sent_s * code_rate_hz - state[k.CHIP] - 0.5 * (n - 1) * chips_per_sample
            a, b, c = turns_cyc[step, wave]
            mine = state[k.PHASE] + 0.5 * (n - 1) * state[k.FREQUENCY] / rate_hz
            cycles = a + u * (b + u * c) - mine
            off_hz = (b + 2.0 * u * c) / STEP_S - state[k.FREQUENCY]
            x = math.pi * off_hz * n / rate_hz
            size *= n * (math.sin(x) / x if abs(x) > 1e-6 else 1.0)
            symbol = (lead_s + sent_s) / (20.0 * code_length / code_rate_hz)
            number = int(symbol)
            if (symbol - number) * 20.0 < 1.0:
                size *= symbols[wave, number] * (1.0 - guessed[wave]) + guesses[wave, number] * guessed[wave]
            else:
                size *= symbols[wave, number]
            angle_rad = 2.0 * math.pi * (cycles - math.floor(cycles))
            real, imaginary = size * math.cos(angle_rad), size * math.sin(angle_rad)
            for tap in range(taken):
                at = (lag - taps_chips[tap]) * POINTS
                at -= math.floor(at / table.size) * table.size
                whole = int(at)
                share = at - whole
                value = table[whole % table.size] * (1.0 - share) + table[(whole + 1) % table.size] * share
                sums[tap, 0] += real * value
                sums[tap, 1] += imaginary * value
        spread = math.sqrt(white[step, 0] * n)
        for tap in range(taken):
            for lower in range(tap + 1):
                sums[tap, 0] += spread * root[tap, lower] * noise[count[0], lower, 0]
                sums[tap, 1] += spread * root[tap, lower] * noise[count[0], lower, 1]
        row[k.OUT_TAPS :] = math.nan
        for tap in range(taken):
            row[k.OUT_TAPS + 2 * tap] = CODE_SCALE * sums[tap, 0]
            row[k.OUT_TAPS + 2 * tap + 1] = CODE_SCALE * sums[tap, 1]
        row[k.OUT_START], row[k.OUT_CHIP], row[k.OUT_PHASE] = state[k.START], state[k.CHIP], state[k.PHASE]
        row[k.OUT_FREQUENCY], row[k.OUT_PERIOD], row[k.OUT_SHIFT] = state[k.FREQUENCY], state[k.PERIODS], 0.0
        k.close_period(state, row, n, rate_hz, chips_per_sample, code_length)
        if (state[k.PERIODS] - max(state[k.BIT_START], 0.0)) % state[k.INTEGRATION] == 0.0:
            k.steer(state, sample_power, rate_hz, if_hz, code_rate_hz, carrier_hz, code_gain)
        count[0] += 1


class DrawnLookout(Lookout):
    """Searches that find what is there."""

    def __init__(
        self, rate_hz: float, if_hz: float, settings: ReceiverSettings, waves: Waves, rng: np.random.Generator
    ) -> None:
        super().__init__(rate_hz, if_hz, settings)
        searchers = [
            DrawnSearcher(one.doppler_step_hz, waves, rate_hz, rng) for one in (settings.search, settings.near_search)
        ]
        self.searcher, self.near_searcher = searchers  # type: ignore[assignment]

    def look(self, state: ReceiverState, begin: int, rows_shape: tuple[int, int]) -> ReceiverState:
        """As a search of samples."""
        for searcher in (self.searcher, self.near_searcher):
            searcher.begin = begin  # type: ignore[attr-defined]
        return super().look(state, begin, rows_shape)


class DrawnSearcher:
    """Finds signals above `FIND_DBHZ` near the Dopplers asked for, `FIND_CHIPS` from known and from stronger ones."""

    def __init__(self, step_hz: float, waves: Waves, rate_hz: float, rng: np.random.Generator) -> None:
        self.step_hz, self.waves, self.rate_hz, self.rng = step_hz, waves, rate_hz, rng
        self.begin, self.n_samples = 0, round(0.02 * rate_hz)

    def search(
        self, samples: Floats, if_hz: float, dopplers: Mapping[str, Reals], known: Mapping[str, Sequence[KnownSignal]]
    ) -> list[Peak]:
        """As `Searcher.search`."""
        w, step = self.waves, min(int(self.begin / self.rate_hz / STEP_S), self.waves.amplitude.shape[0] - 1)
        at_s = self.begin / self.rate_hz
        u = at_s / STEP_S - step
        powers = np.array([1.0, u, u * u])
        with np.errstate(divide="ignore"):
            dbhz = 10.0 * np.log10(0.5 * w.amplitude[step] ** 2 / w.white[step] * self.rate_hz)
        found = []
        for sat, grid in dopplers.items():
            taken = [one.delay_s for one in known.get(sat, ())]
            for wave in sorted(w.of(sat).tolist(), key=lambda one: -dbhz[one]):
                doppler_hz = float(w.turns_cyc[step, wave, 1] + 2.0 * u * w.turns_cyc[step, wave, 2]) / STEP_S - if_hz
                sent_s = at_s + float(w.code_s[step, wave] @ powers)
                delay_s = -sent_s % SIGNAL.period_s
                if dbhz[wave] < FIND_DBHZ or np.abs(grid - doppler_hz).min() > 0.6 * self.step_hz:
                    continue
                if any(abs(_apart_s(delay_s, one)) * SIGNAL.chip_rate_hz < FIND_CHIPS for one in taken):
                    continue
                taken.append(delay_s)
                off_chips, off_hz = self.rng.standard_normal(2) * (FOUND_CHIPS, FOUND_HZ)
                found.append(
                    Peak(
                        sat=sat,
                        delay_s=(delay_s + off_chips / SIGNAL.chip_rate_hz) % SIGNAL.period_s,
                        doppler_hz=doppler_hz + off_hz,
                        cn0_dbhz=float(dbhz[wave]),
                        power=100.0,
                        p_value=1e-9,
                    )
                )
        return found


def _apart_s(one_s: float, other_s: float) -> float:
    return (one_s - other_s + 0.5 * SIGNAL.period_s) % SIGNAL.period_s - 0.5 * SIGNAL.period_s


class DrawnGrids(GridCorrelator):
    """Correlation grids that are drawn."""

    def __init__(
        self, like: GridCorrelator, bandwidth_hz: float | None, waves: Waves, rng: np.random.Generator
    ) -> None:
        super().__init__(like.asked, like.rate_hz, like.if_hz, like.signal, like._code_phases)
        if self.dopplers_hz.tolist() != [0.0] or self.periods != SIGNAL.periods_per_symbol:
            raise ValueError("grids are drawn at one Doppler, over one data bit")
        self._bandwidth_hz, self._waves, self._rng = bandwidth_hz, waves, rng

    def take(
        self,
        samples: Floats,
        first_sample: int,
        frame: tuple[Reals, Integers],
        bit_start: Reals,
        sats: Sequence[str],
        arcs: Integers,
        elapsed_s: float,
        threads: Executor,
        n_threads: int,
    ) -> Grids:
        """As `GridCorrelator.take`."""
        rows, counts = frame
        coherent_s = self.periods * SIGNAL.period_s
        times_s = elapsed_s + 0.01 + (np.arange(self.asked.intervals) + 0.5) * coherent_s
        values, metas, periods, whole = [], [], [], []
        for i, sat in enumerate(sats):
            if bit_start[i] < 0.0:
                continue
            number = rows[i, : counts[i], k.OUT_PERIOD]
            first = np.flatnonzero((number - bit_start[i]) % self.periods == 0.0)[: self.asked.intervals]
            if first.size < self.asked.intervals or first[-1] + self.periods > counts[i]:
                continue
            value, meta = self._burst(sat, rows[i], first, times_s)
            values.append(value)
            metas.append(meta)
            periods.append(number[first].astype(np.int64))
            whole.append(arcs[i])
        if not values:
            return self.nothing()
        meta = np.concatenate(metas)
        return Grids(
            elapsed_s=np.tile(times_s, len(whole)),
            arc=np.repeat(np.array(whole, np.int64), times_s.size),
            periods=np.concatenate(periods),
            fraction_s=meta[:, 0],
            doppler_hz=meta[:, 1],
            noise_variance=meta[:, 2],
            value=np.concatenate(values).astype(np.complex64)[:, None, :],
        )

    def _burst(self, sat: str, rows: Reals, first: Integers, times_s: Reals) -> tuple[Complexes, Reals]:
        """Values (n_intervals, n_delays) and what `Grids` has beside them."""
        shape = shapes(prn_of(sat), self.rate_hz, self._bandwidth_hz, self.band_hz)
        begin, last = rows[first], rows[first + self.periods - 1]
        took_s = (last[:, k.OUT_START] - begin[:, k.OUT_START]) / self.rate_hz
        frequency_hz = (last[:, k.OUT_PHASE] - begin[:, k.OUT_PHASE]) / took_s
        doppler_hz = frequency_hz - self.if_hz
        chips_per_sample = SIGNAL.chip_rate_hz / self.rate_hz * (1.0 + doppler_hz / SIGNAL.carrier_hz)
        start, chip = begin[:, k.OUT_START], begin[:, k.OUT_CHIP]
        n = np.ceil((self.periods * SIGNAL.code_length - chip) / chips_per_sample)
        value = np.zeros((first.size, self.delays_chips.size), np.complex128)
        w, at_s = self._waves, (start + 0.5 * (n - 1.0)) / self.rate_hz
        step = np.minimum((at_s / STEP_S).astype(np.int64), w.amplitude.shape[0] - 1)
        u = at_s / STEP_S - step
        for wave in w.of(sat):
            sent_s = at_s + np.sum(w.code_s[step, wave] * np.stack([u**0, u, u * u], axis=1), axis=1)
            lag = sent_s * SIGNAL.chip_rate_hz - chip - 0.5 * (n - 1.0) * chips_per_sample
            a, b, c = w.turns_cyc[step, wave].T
            off_hz = (b + 2.0 * u * c) / STEP_S - frequency_hz
            cycles = a + u * (b + u * c) - frequency_hz * 0.5 * (n - 1.0) / self.rate_hz
            sign = w.symbols[wave, ((w.lead_s + sent_s) / SIGNAL.symbol_s).astype(np.int64)]
            size = w.amplitude[step, wave] * np.sinc(off_hz * n / self.rate_hz) * sign
            turn = np.exp(2j * np.pi * cycles)
            value += (size * turn)[:, None] * read(shape.signal, lag[:, None] + self.delays_chips)
        white = w.white[step, w.of(sat)[0]]
        root = noise_root(shape.replica, self.delays_chips)
        noise = self._rng.standard_normal((*value.shape, 2)) @ np.array([1.0, 1.0j])
        value += np.sqrt(white / n)[:, None] * (noise @ root.T)
        meta = np.empty((first.size, N_META))
        meta[:, 0] = (chip + (times_s * self.rate_hz - start) * chips_per_sample) / SIGNAL.chip_rate_hz
        meta[:, 1] = doppler_hz
        freedom = 2 * NOISE_TAPS * first.size
        measured = self._rng.chisquare(freedom) / freedom
        meta[:, 2] = 2.0 * float(np.mean(white / n)) * shape.replica[0] * measured
        return value, meta


# ---------------------------------------------------------------------- from a scene to the verdict


class _Undiagnosed(Tracker):
    """Many arcs do not raise the question here whether the recording was read as it should be."""

    @property
    def ended(self) -> bool:
        return False


def received_of(
    scene: Scene,
    index: int,
    settings: Settings,
    navigation: NavigationData,
    rng: np.random.Generator,
    unit: AntennaUnit | None = None,
) -> Reception:
    """What a receiver behind drawn correlators receives at antenna number `index`."""
    wanted = receiver_settings(GPS_SATS, settings, asked())
    return reception_of(scene, index, DrawnReceiver(scene, index, wanted, rng), navigation, settings, unit)[0]


def reception_of(
    scene: Scene,
    index: int,
    receiver: DrawnReceiver,
    navigation: NavigationData,
    settings: Settings,
    unit: AntennaUnit | None = None,
) -> tuple[Reception, Tracker]:
    """What a receiver receives of the whole scene, and what it kept of how."""
    front_end, name = scene.scenario.front_end, scene.skies[index].name
    samples = Samples(
        name=name,
        rate_hz=front_end.rate_hz,
        n_samples=round(scene.scenario.duration_s * front_end.rate_hz),
        read=lambda start, count: np.empty((0, count), np.float32),
        if_hz=front_end.if_hz,
        start_gpst=scene.scenario.start_gpst,
    )
    workspace = Workspace()
    tracker = _Undiagnosed(
        samples=samples,
        receiver=receiver,
        measured=MeasurementLog(workspace, name, MEASURE_FRAMES * receiver.settings.frame_s),
        grids=RowLog(workspace, f"{name}/grids"),
        vector=guiding_of(samples, navigation, settings, unit) if settings.tracking == "vector" else None,
        checks=0,
    )
    while tracker.advance():
        pass
    return observe(tracker, navigation, None, workspace), tracker


def judged(scene: Scene, navigation: NavigationData, platform_path: Path, seed: int) -> tuple[Verdict, Outcome]:
    """As `protect` with the scene's recordings, the navigation file and the platform file."""
    platform = read_platform(platform_path)
    names = [sky.name for sky in scene.skies]
    tables = described(platform, names, str(platform_path))
    settings, _ = settings_of(platform, resolve_settings(platform.protect), names, tables)
    rng = np.random.default_rng(seed)
    start_gpst, files = scene.scenario.start_gpst, open_body(platform)
    unit = unit_of(platform, files, names, tables, start_gpst)
    carrying = antenna_units(unit)
    receptions = [
        received_of(scene, index, settings, navigation, rng, carrying.get(name)) for index, name in enumerate(names)
    ]
    observed = [r.observations for r in receptions if r.observations is not None]
    settings = following_epochs(settings, observed)
    body = body_of(platform, files, names, tables, start_gpst, settings.max_separation_m)
    foresights = foresights_of(names, settings, platform, tables, unit)
    outcome, _ = judge(receptions, navigation, settings, Silent(), body=body, foresights=foresights)
    return document(outcome, (), settings), outcome
