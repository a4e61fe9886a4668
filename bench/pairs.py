"""Pairs of signals of one satellite through the whole receiver, and second signals where there are none.

A satellite is tracked alone; then a second signal of it begins, with the same data bits, so much later or earlier. The
place in the code, the sign of the separation, the carriers' phases, the bits and the noise are drawn anew in each
trial. Errors are those of the measurements 2 to 3 s after the second signal was found, rms, beside their stated
(thermal) sigma and beside the pull: what the correlation of the other signal, side lobes included, does to a loop and a
discriminator without noise. Where the tops of the two correlations touch, a loop need not have a place to stay near the
weaker one; `stays` is the share of phases between the carriers for which it has.

`followed` is the share of epochs, from the one at which the second signal was found until errors were taken, that have
both, each within a quarter of a chip of the truth and nearer to its own than to the other; `over bound` is the rms of
the codes' errors over the Cramer-Rao bound of a row of 0.2 s in which nothing of the two is known (`receiver.joint`).
`swapped` counts trials at whose end the letter of the first signal is not on it.

`python bench/pairs.py --trials 20` writes the whole table as markdown; with `--joint` that of a receiver with joint
channels.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from time import process_time

import numba
import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Floats, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of
from skyproof.receiver import joint as j
from skyproof.receiver import measurement as m
from skyproof.receiver.acquisition import KnownSignal, Peak, Searcher
from skyproof.receiver.channels import Arc
from skyproof.receiver.joint_model import JointModel
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.replica import passed
from skyproof.receiver.tracking import Receiver, ReceiverSettings, ReceiverState
from skyproof.simulator import ScenePlace, samples_of, scenes

RATE_HZ = 2.6037e6
"""No whole number of samples a code period: with one, a signal of little Doppler is read at the same places of its
chips for seconds, and sharp chips alias into a metre of code."""
SAT = "G07"
CHIP_S = 1.0 / GPS_L1_CA.chip_rate_hz
CHIP_M = SPEED_OF_LIGHT_M_S * CHIP_S
BLOCK_S = 0.1
ALONE_S = 1.5  # at least, before the second signal begins
BITS_S = 2.5  # likewise with joint channels: the first has its bits by then, without which none begins
WAIT_S = 4.0  # for a second signal to be found
TRACKED_S = 2.0  # before errors are taken
SEEN_S = 1.0  # over which they are
NEAR_CHIPS = 0.25

SEPARATIONS_CHIPS = (0.5, 0.75, 1.0, 1.5, 2.0, 4.0, 8.0)
POWERS_DB = (-10.0, -6.0, 0.0, 6.0, 10.0)
DIFFERENCES_HZ = (0.0, 2.0, 10.0, 50.0)
REFLECTIONS = tuple(product((0.2, 0.35, 0.5, 0.7), (-3.0, -6.0, -10.0), (0.0, 0.3)))


# ---------------------------------------------------------------------- samples


@dataclass(frozen=True, kw_only=True)
class Wave:
    """One signal: a data bit begins at `delay_s` (less than 20 ms); there from `begin_s` on."""

    sat: str
    cn0_dbhz: float
    delay_s: float
    doppler_hz: float
    phase_cyc: float
    bits: Floats
    begin_s: float = 0.0

    def sent_s(self, t_s: Reals | float) -> Reals:
        """Time shown by the code, s."""
        return np.asarray(t_s * (1.0 + self.doppler_hz / GPS_L1_CA.carrier_hz) - self.delay_s)


def add(wave: Wave, first: int, planes: Floats, rate_hz: float = RATE_HZ) -> None:
    """Add a signal to samples, (2, n), of which the first has this number. Noise has variance 1 in I and in Q."""
    amplitude = math.sqrt(2.0 * 10.0 ** (0.1 * wave.cn0_dbhz) / rate_hz)
    skip = min(max(math.ceil(wave.begin_s * rate_hz) - first, 0), planes.shape[1])
    t_s = (first + skip) / rate_hz
    _add(
        GPS_L1_CA.code(prn_of(wave.sat)),
        wave.bits,
        float(wave.sent_s(t_s)) / CHIP_S,
        (1.0 + wave.doppler_hz / GPS_L1_CA.carrier_hz) / CHIP_S / rate_hz,
        (wave.phase_cyc + wave.doppler_hz * t_s) % 1.0,
        wave.doppler_hz / rate_hz,
        amplitude,
        planes[:, skip:],
    )


@numba.njit(cache=True, nogil=True)
def _add(
    code: NDArray[np.int8],
    bits: Floats,
    chip: float,
    chip_step: float,
    cycle: float,
    cycle_step: float,
    amplitude: float,
    planes: Floats,
) -> None:
    step = complex(math.cos(2.0 * math.pi * cycle_step), math.sin(2.0 * math.pi * cycle_step))
    turn = amplitude * complex(math.cos(2.0 * math.pi * cycle), math.sin(2.0 * math.pi * cycle))
    per_bit = 20 * code.shape[0]
    for i in range(planes.shape[1]):
        now = math.floor(chip + i * chip_step) + per_bit  # a bit before the first, for delays
        value = bits[now // per_bit] * code[now % code.shape[0]]
        planes[0, i] += value * turn.real
        planes[1, i] += value * turn.imag
        turn *= step


def noise(rng: np.random.Generator, n: int) -> Floats:
    """Samples of receiver noise, (2, n)."""
    return rng.standard_normal((2, n), dtype=np.float32)


def bits(rng: np.random.Generator, duration_s: float) -> Floats:
    """Data bits for so long and a delay."""
    return rng.choice(np.array([-1.0, 1.0], np.float32), math.ceil(50.0 * duration_s) + 3)


# ---------------------------------------------------------------------- pairs


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Second signal beside the first: separation (that in the middle of where errors are taken), power, Doppler."""

    apart_chips: float
    relative_db: float
    apart_hz: float
    cn0_dbhz: float = 45.0  # of the first
    rate_hz: float = RATE_HZ


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """What the receiver made of a pair.

    wait_s : from the beginning of the second signal to the search that found it; NaN if not both were followed.
    others : confirmed channels beyond one on each; pulled : arcs that ended as pulled away.
    swapped : whether the first's letter ended elsewhere. followed : (n_epochs,) since both were found, if they are.
    code_m, doppler_hz : errors of first and second, (2, n_epochs), and their stated sigmas; over_bound : codes' over
        the Cramer-Rao bound, bound_m, infinite where there is none.
    """

    wait_s: float = math.nan
    others: int
    pulled: int
    swapped: bool = False
    followed: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))
    bound_m: Reals = field(default_factory=lambda: np.empty((2, 0)))
    code_m: Reals = field(default_factory=lambda: np.empty((2, 0)))
    code_sigma_m: Reals = field(default_factory=lambda: np.empty((2, 0)))
    doppler_hz: Reals = field(default_factory=lambda: np.empty((2, 0)))
    doppler_sigma_hz: Reals = field(default_factory=lambda: np.empty((2, 0)))

    @property
    def both(self) -> bool:
        """Whether both were found, confirmed, and still followed when errors were taken."""
        return math.isfinite(self.wait_s)


def trial(rng: np.random.Generator, cell: Cell, settings: ReceiverSettings | None = None) -> Outcome:
    """One pair through the receiver."""
    receiver = Receiver(cell.rate_hz, 0.0, settings or ReceiverSettings(sats=(SAT,)))
    # At any moment between two searches.
    onset_s = (BITS_S if receiver.settings.joint else ALONE_S) + receiver.settings.near_search_s * rng.random()
    # Code and carrier belong together, so that signals of different Doppler move apart.
    middle_s = onset_s + 0.3 + TRACKED_S + 0.5 * SEEN_S
    wait_s = max(WAIT_S, receiver.settings.joint_look_s + 0.5 if receiver.settings.joint else 0.0)
    first, second = waves(rng, cell, onset_s, middle_s, onset_s + wait_s + TRACKED_S + SEEN_S)
    state, parts, arcs = ReceiverState(), [], {}
    n = round(BLOCK_S * cell.rate_hz)
    stop_s = math.inf  # of the epochs that count
    for block in range(math.floor((onset_s + wait_s + TRACKED_S + SEEN_S) / BLOCK_S)):  # as long as there are bits
        planes = noise(rng, n)
        add(first, block * n, planes, cell.rate_hz)
        add(second, block * n, planes, cell.rate_hz)
        output, state = receiver.step(state, planes)
        parts.append(output.measurements)
        arcs |= output.arcs
        now_s = (block + 1) * BLOCK_S
        new = [c.found_s for c in state.channels if c.copy is not None and c.found_s > onset_s - 0.05]
        stop_s = min(new) + TRACKED_S + SEEN_S if new else math.inf
        if now_s > min(stop_s + 0.3, math.inf if new else onset_s + wait_s + 1.0):
            break
    return _outcome(cell, Measurements.joined(parts), arcs, (first, second), onset_s, min(stop_s, now_s))


def waves(
    rng: np.random.Generator, cell: Cell, onset_s: float, middle_s: float, duration_s: float
) -> tuple[Wave, Wave]:
    """A pair with the same data, the second from `onset_s` on; as far apart as the cell says at `middle_s`."""
    sign = rng.choice([-1.0, 1.0])
    apart_hz = cell.apart_hz * rng.choice([-1.0, 1.0])
    doppler_hz, delay_s = rng.uniform(-4000.0, 4000.0), rng.uniform(2e-5, 0.0198)
    data = bits(rng, duration_s)
    later_s = sign * cell.apart_chips * CHIP_S + apart_hz / GPS_L1_CA.carrier_hz * middle_s
    first = Wave(
        sat=SAT, cn0_dbhz=cell.cn0_dbhz, delay_s=delay_s, doppler_hz=doppler_hz, phase_cyc=rng.random(), bits=data
    )
    second = Wave(
        sat=SAT,
        cn0_dbhz=cell.cn0_dbhz + cell.relative_db,
        delay_s=delay_s + later_s,
        doppler_hz=doppler_hz + apart_hz,
        phase_cyc=rng.random(),
        bits=data,
        begin_s=onset_s,
    )
    return first, second


def _outcome(
    cell: Cell, measured: Measurements, arcs: dict[int, Arc], waves: tuple[Wave, Wave], onset_s: float, stop_s: float
) -> Outcome:
    """Channels given to the signal that each is nearer to, within half a chip, in the last second."""
    t_s = measured.elapsed_s
    late = (t_s > stop_s - SEEN_S + 1e-9) & (t_s < stop_s + 1e-9)
    shown_s = measured.column(m.PERIODS) * GPS_L1_CA.period_s + measured.column(m.FRACTION_S)
    error_m = np.stack([SPEED_OF_LIGHT_M_S * ((shown_s - one.sent_s(t_s) + 0.5e-3) % 1e-3 - 0.5e-3) for one in waves])
    letters = np.array([arcs[int(arc)].signal.copy for arc in measured.arc])
    rows_of: list[list[NDArray[np.bool_]]] = [[], []]
    others = 0
    for name in np.unique([arc.signal.copy for arc in arcs.values()]):
        rows = late & (letters == name)
        off_m = np.median(np.abs(error_m[:, rows]), axis=1) if rows.any() else np.full(2, math.inf)
        which = int(np.argmin(off_m))
        if off_m[which] < 0.5 * CHIP_M:
            rows_of[which].append(rows)
        elif rows.any() or any(arc.found_s > onset_s - 0.05 for arc in arcs.values() if arc.signal.copy == name):
            others += 1
    others += sum(len(found) - 1 for found in rows_of if found)
    pulled = sum(arc.began == "pulled away" for arc in arcs.values())
    if not all(rows_of):
        return Outcome(others=others, pulled=pulled)
    found_s = [min(arcs[int(arc)].found_s for arc in measured.arc[found[0]]) for found in rows_of]
    n = min(int(found[0].sum()) for found in rows_of)
    numbers = [np.flatnonzero(found[0])[:n] for found in rows_of]
    table = np.stack([measured.table[rows] for rows in numbers])
    since = (t_s > max(found_s) + 1e-9) & (t_s < stop_s + 1e-9)
    return Outcome(
        wait_s=max(found_s) - onset_s,
        others=others,
        pulled=pulled,
        swapped=not any(letters[rows[0]] == "a" for rows in numbers[:1]),
        followed=_followed(t_s[since], error_m[:, since], waves),
        bound_m=bounds_m(cell, waves, t_s[numbers[0]]),
        code_m=np.stack([error_m[i, rows] for i, rows in enumerate(numbers)]),
        code_sigma_m=table[..., m.CODE_SIGMA_S] * SPEED_OF_LIGHT_M_S,
        doppler_hz=table[..., m.DOPPLER_HZ] - np.array([[one.doppler_hz] for one in waves]),
        doppler_sigma_hz=table[..., m.DOPPLER_SIGMA_HZ],
    )


def _followed(t_s: Reals, error_m: Reals, waves: tuple[Wave, Wave]) -> NDArray[np.bool_]:
    """Whether both signals are followed at each epoch, by rows of errors (2, n_rows) beside each of them."""
    apart_m = SPEED_OF_LIGHT_M_S * np.abs(waves[1].sent_s(t_s) - waves[0].sent_s(t_s))
    near = np.abs(error_m) < np.minimum(NEAR_CHIPS * CHIP_M, 0.5 * apart_m)
    return np.array([near[:, t_s == epoch].any(axis=1).all() for epoch in np.unique(t_s)], np.bool_)


def bounds_m(cell: Cell, waves: tuple[Wave, Wave], t_s: Reals) -> Reals:
    """Cramer-Rao bounds (2, n) of the codes of a pair in rows of measurements about these times; infinite where a row
    does not determine them.
    """
    model = _model(cell.rate_hz)
    mean = np.zeros((t_s.size, 2, j.N_STATE))
    for n, (wave, db) in enumerate(zip(waves, (0.0, cell.relative_db), strict=True)):
        phase = 2.0 * math.pi * (wave.phase_cyc + (wave.doppler_hz * t_s) % 1.0)
        mean[:, n, j.RE] = math.sqrt(model.energy(cell.cn0_dbhz + db)) * np.cos(phase)
        mean[:, n, j.IM] = math.sqrt(model.energy(cell.cn0_dbhz + db)) * np.sin(phase)
        mean[:, n, j.HZ] = wave.doppler_hz - waves[0].doppler_hz
        mean[:, n, j.CHIPS] = (waves[0].sent_s(t_s) - wave.sent_s(t_s)) / CHIP_S
    limit = j.bound(mean, model.row_times_s, model.look_s, model.dictionary)
    variance = np.diagonal(limit, axis1=-2, axis2=-1)[:, j.CHIPS :: j.N_FITTED]
    return CHIP_M * np.sqrt(variance).T


@cache
def _model(rate_hz: float) -> JointModel:
    return JointModel(signal=GPS_L1_CA, code=GPS_L1_CA.code(prn_of(SAT)), rate_hz=rate_hz)


# ---------------------------------------------------------------------- theory


@cache
def _shape(rate_hz: float) -> tuple[Reals, Reals]:
    """Correlation of signal and replica out to 12 chips, side lobes of the code included: where, and how high.

    Sharp chips in the samples, chips behind the replica's low-pass against them; 1 at the highest.
    """
    chips_per_sample = GPS_L1_CA.chip_rate_hz / rate_hz
    f = (np.arange(4000) + 0.5) / 4000.0 * 0.5 / chips_per_sample
    weight = np.sinc(f) ** 2 * passed(f * chips_per_sample)
    x = np.linspace(-4.0, 4.0, 801)
    top = (np.cos(2.0 * np.pi * np.outer(x, f)) @ weight) / weight.sum()
    chips = GPS_L1_CA.code(prn_of(SAT)).astype(np.float64)
    lobes = np.fft.ifft(np.abs(np.fft.fft(chips)) ** 2).real / chips.size
    at = np.linspace(-12.0, 12.0, 2401)
    high = sum(lobes[k % chips.size] * np.interp(at - k, x, top, left=0.0, right=0.0) for k in range(-16, 17))
    return at, np.asarray(high)


def correlation(delay_chips: Reals, rate_hz: float = RATE_HZ) -> Reals:
    """Of signal and replica, at most 12 chips apart; any shape."""
    return np.asarray(np.interp(delay_chips, *_shape(rate_hz)))


@cache
def _receiver(rate_hz: float) -> Receiver:
    return Receiver(rate_hz)


def _taps(tau: Reals, cell: Cell, wave: NDArray[np.complex128], half: float) -> NDArray[np.complex128]:
    """Early, prompt, late, (3, ...), of a replica `tau` later than a signal of 1, beside the other one of `wave`."""
    at = tau + np.array([-half, 0.0, half]).reshape(3, *[1] * tau.ndim)
    return correlation(at, cell.rate_hz) + wave * correlation(at - cell.apart_chips, cell.rate_hz)


@cache
def stays(cell: Cell, of_second: bool, n_phases: int = 64) -> tuple[float, Reals]:
    """Share of phases for which a loop without noise that begins on a signal is still there after 3 s, and where.

    The loop of `kernels`: normalised dot product, 4 Hz for the first half second, then 1 Hz; every 5 ms.
    """
    receiver = _receiver(cell.rate_hz)
    half, gain = float(receiver.taps_chips[0]), receiver.discriminator.gain
    amplitude = 10.0 ** ((-cell.relative_db if of_second else cell.relative_db) / 20.0)
    phase = np.arange(n_phases) / n_phases
    tau = np.zeros(n_phases)
    step_s = 0.005
    power: Reals | None = None
    settings = receiver.settings
    for k in range(600):
        wave = amplitude * np.exp(2j * np.pi * (phase + cell.apart_hz * k * step_s)) * np.sinc(cell.apart_hz * step_s)
        early, prompt, late = _taps(tau, cell, wave, half)
        now = np.abs(prompt) ** 2
        power = now if power is None else power + 0.1 * (now - power)
        dot = ((late - early) * np.conj(prompt)).real / np.maximum(power, 0.05) / gain
        bandwidth_hz = (settings.pull_in if k * step_s < settings.pull_in_s else settings.tracking).dll_bandwidth_hz
        tau = tau + 4.0 * bandwidth_hz * step_s * np.clip(dot, -0.5, 0.5)
    there = np.abs(tau) < min(0.5, 0.5 * cell.apart_chips)
    return float(there.mean()), np.where(there, tau, np.nan)


def pulls(cell: Cell, of_second: bool, n_phases: int = 32) -> tuple[float, float]:
    """What the other signal does to the measured code (m) and Doppler (Hz) of one: rms over the phase between them.

    Without a difference of Doppler the loop goes along with the pull, to where its discriminator is zero; with one it
    stands, and the measurement, over 0.2 s in bits of 20 ms, has the pull to itself.
    """
    receiver = _receiver(cell.rate_hz)
    half, gain = float(receiver.taps_chips[0]), receiver.discriminator.gain
    if cell.apart_hz == 0.0:
        _, tau = stays(cell, of_second)
        rms = float(np.sqrt(np.nanmean(tau**2))) if np.isfinite(tau).any() else math.nan
        return CHIP_M * rms, 0.0
    amplitude = 10.0 ** ((-cell.relative_db if of_second else cell.relative_db) / 20.0)
    t_s = (np.arange(10) + 0.5) * 0.02 - 0.1
    phase = np.arange(n_phases)[:, None] / n_phases + cell.apart_hz * t_s
    wave = amplitude * np.exp(2j * np.pi * phase) * np.sinc(cell.apart_hz * 0.02)
    early, prompt, late = _taps(np.zeros((n_phases, 1)), cell, wave, half)
    angle = 0.5 * np.unwrap(2.0 * np.angle(prompt), axis=1)
    fit = np.polynomial.polynomial.polyfit(t_s, angle.T, 2)
    wipe = np.exp(-1j * np.polynomial.polynomial.polyval(t_s, fit))
    wipe = np.where((prompt * wipe).real < 0.0, -wipe, wipe)
    tau = ((late - early) * wipe).real.sum(axis=1) / (prompt * wipe).real.sum(axis=1) / gain
    return CHIP_M * float(np.sqrt(np.mean(tau**2))), float(np.sqrt(np.mean((fit[1] / (2.0 * np.pi)) ** 2)))


# ---------------------------------------------------------------------- second signals where there are none


@dataclass(frozen=True, kw_only=True)
class Count:
    """Searches of clean sky: how many, of how many tracked signals, and in how many something came up."""

    searches: int
    signals: int
    peaks: tuple[Peak, ...]
    alarms: int


def clean_searches(rng: np.random.Generator, searches: int, *, full: bool) -> Count:
    """Stretches of clean sky, each of its own, searched as the receiver does while it tracks all that is there.

    4 to 9 satellites of 38 to 52 dB-Hz, at any Doppler and place in their bits; known as a loop knows them: to 0.02
    chips and 2 Hz (thermal, 38 dB-Hz).
    """
    settings = ReceiverSettings()
    searcher = Searcher(GPS_L1_CA, RATE_HZ, settings.search if full else settings.near_search)
    steps = np.arange(-14.0, 15.0) * 500.0
    step_hz = settings.near_search.doppler_step_hz
    reach = settings.near_doppler_hz // step_hz
    near_hz = np.arange(-reach, reach + 1.0) * step_hz
    signals, alarms, peaks = 0, 0, []
    for _ in range(searches):
        planes = noise(rng, searcher.n_samples)
        known, grid = {}, dict.fromkeys(GPS_SATS, steps) if full else {}
        for sat in rng.choice(GPS_SATS, rng.integers(4, 10), replace=False).tolist():
            one = Wave(
                sat=sat,
                cn0_dbhz=rng.uniform(38.0, 52.0),
                delay_s=rng.uniform(0.0, 0.0199),
                doppler_hz=rng.uniform(-4500.0, 4500.0),
                phase_cyc=rng.random(),
                bits=bits(rng, searcher.duration_s),
            )
            add(one, 0, planes)
            delay_s = (one.delay_s + 0.02 * CHIP_S * rng.normal()) % GPS_L1_CA.period_s
            known[sat] = [KnownSignal(delay_s=delay_s, doppler_hz=one.doppler_hz + 2.0 * rng.normal())]
            if not full:
                grid[sat] = near_hz + round(one.doppler_hz / step_hz) * step_hz
            signals += 1
        found = searcher.search(planes, 0.0, grid, known)
        alarms += bool(found)
        peaks += found
    return Count(searches=searches, signals=signals, peaks=tuple(peaks), alarms=alarms)


def clean_recording(duration_s: float, seed: int) -> tuple[float, list[str]]:
    """A clean sky through the whole receiver: signal-seconds followed, and confirmed signals that are not there."""
    start = np.datetime64("2024-05-14T09:59:58", "ns")
    place = ScenePlace(lat_deg=-60.0 + 17.0 * (seed % 8), lon_deg=(41.0 * seed) % 360.0 - 180.0, height_m=50.0)
    scenario = scenes.clean(place, start, receivers=1, duration_s=duration_s, seed=seed)
    samples = samples_of(scenario, nominal_constellation(start))[0]
    receiver, state, arcs, epochs = Receiver(samples.rate_hz), ReceiverState(), {}, 0
    n = round(samples.rate_hz)
    for begin in range(0, samples.n_samples, n):
        output, state = receiver.step(state, samples.read(begin, min(n, samples.n_samples - begin)))
        arcs |= output.arcs
        epochs += len(output.measurements)
    names = {(arc.signal.sat, arc.signal.copy) for arc in arcs.values()}
    return 0.2 * epochs, sorted(f"{sat}{copy}" for sat, copy in names if copy != "a")


def reflected(
    rng: np.random.Generator,
    apart_chips: float,
    relative_db: float,
    apart_hz: float,
    settings: ReceiverSettings | None = None,
) -> int:
    """Signals reported beside a satellite's own, of one with a reflection."""
    cell = Cell(apart_chips=apart_chips, relative_db=relative_db, apart_hz=apart_hz, cn0_dbhz=rng.uniform(42.0, 50.0))
    outcome = trial(rng, cell, settings)
    return outcome.others + outcome.both


# ---------------------------------------------------------------------- tables


@dataclass(frozen=True, kw_only=True)
class Row:
    """A cell's trials in figures. Of first and second signal: rms of the errors, of the sigmas, and the pulls."""

    cell: Cell
    trials: int
    found: int
    others: int
    pulled: int
    swapped: int
    followed: float  # share of epochs
    over_bound: tuple[float, float]
    bound_m: tuple[float, float]
    wait_s: tuple[float, float]  # median and most
    stays: float
    code_m: tuple[tuple[float, float, float], ...]
    doppler_hz: tuple[tuple[float, float, float], ...]


def table(
    trials: int,
    separations_chips: Sequence[float] = SEPARATIONS_CHIPS,
    powers_db: Sequence[float] = POWERS_DB,
    differences_hz: Sequence[float] = DIFFERENCES_HZ,
    settings: ReceiverSettings | None = None,
    rate_hz: float = RATE_HZ,
    cn0_dbhz: float = 45.0,
) -> Iterator[Row]:
    """Row by row. A cell's trials are its own whatever other cells are asked for."""
    for apart_chips, relative_db, apart_hz in product(separations_chips, powers_db, differences_hz):
        cell = Cell(
            apart_chips=apart_chips, relative_db=relative_db, apart_hz=apart_hz, cn0_dbhz=cn0_dbhz, rate_hz=rate_hz
        )
        yield row_of(cell, trials, settings)


def row_of(cell: Cell, trials: int, settings: ReceiverSettings | None = None) -> Row:
    """The trials of one cell."""
    rng = np.random.default_rng([round(100 * cell.apart_chips), round(cell.relative_db) + 100, round(cell.apart_hz)])
    outcomes = [trial(rng, cell, settings) for _ in range(trials)]
    good = [one for one in outcomes if one.both]
    waits = [one.wait_s for one in good]
    pulls_of = [pulls(cell, of_second) for of_second in (False, True)]

    def rms(of: int, errors: str) -> float:
        values = [getattr(one, errors)[of] for one in good]
        return _rms(np.concatenate(values)) if good else math.nan

    at_best = [np.concatenate([one.bound_m[i] for one in good]) if good else np.empty(0) for i in (0, 1)]
    errors = [np.concatenate([one.code_m[i] for one in good]) if good else np.empty(0) for i in (0, 1)]
    known = [np.isfinite(bound) for bound in at_best]
    return Row(
        cell=cell,
        trials=trials,
        found=len(good),
        others=sum(one.others for one in outcomes),
        pulled=sum(one.pulled for one in outcomes),
        swapped=sum(one.swapped for one in good),
        followed=float(np.mean(np.concatenate([one.followed for one in good]))) if good else 0.0,
        over_bound=tuple(_rms((errors[i] / at_best[i])[known[i]]) for i in (0, 1)),
        bound_m=tuple(_rms(at_best[i][known[i]]) for i in (0, 1)),
        wait_s=(float(np.median(waits)), max(waits)) if good else (math.nan, math.nan),
        stays=min(stays(cell, of_second)[0] for of_second in (False, True)) if cell.apart_chips < 2.0 else 1.0,
        code_m=tuple((rms(i, "code_m"), rms(i, "code_sigma_m"), pulls_of[i][0]) for i in (0, 1)),
        doppler_hz=tuple((rms(i, "doppler_hz"), rms(i, "doppler_sigma_hz"), pulls_of[i][1]) for i in (0, 1)),
    )


def _rms(values: Reals) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _text(row: Row) -> str:
    cell = row.cell
    head = f"  {cell.apart_chips:4.2f} chips {cell.relative_db:+3.0f} dB {cell.apart_hz:2.0f} Hz"
    share = f"{row.found}/{row.trials} (stays {row.stays:4.2f}) others {row.others} pulled {row.pulled}"
    if not row.found:
        return f"{head}: {share}"
    code = ", ".join("{:.1f} ({:.1f}, {:.1f})".format(*one) for one in row.code_m)
    doppler = ", ".join("{:.2f} ({:.2f}, {:.2f})".format(*one) for one in row.doppler_hz)
    return f"{head}: {share}  {row.wait_s[0]:.1f} to {row.wait_s[1]:.1f} s  code {code} m  Doppler {doppler} Hz"


def _markdown(row: Row) -> str:
    cell = row.cell
    cells = [f"{1e-6 * cell.rate_hz:.3g}", f"{cell.cn0_dbhz:g}", f"{cell.apart_chips:g}", f"{cell.relative_db:+.0f}"]
    cells += [f"{cell.apart_hz:g}", f"{row.found}/{row.trials}", f"{row.stays:.2f}"]
    cells += [str(row.others), str(row.pulled), str(row.swapped)]
    if row.found:
        cells += ["{:.2f} / {:.2f}".format(*row.wait_s), f"{row.followed:.3f}"]
        cells += ["{:.2f} / {:.2f}".format(*row.over_bound), "{:.1f} / {:.1f}".format(*row.bound_m)]
        cells += ["{:.1f} ({:.1f}; {:.1f})".format(*one) for one in row.code_m]
        cells += ["{:.2f} ({:.2f}; {:.2f})".format(*one) for one in row.doppler_hz]
    else:
        cells += ["–"] * 8
    return "| " + " | ".join(cells) + " |"


MARKDOWN_HEAD = (
    "| Msps | dB-Hz | apart, chips | second, dB | Doppler, Hz | both | stays | others | pulled | swapped "
    "| wait median / most, s | followed | code over bound | bound, m "
    "| first, code m | second, code m | first, Doppler Hz | second, Doppler Hz |\n" + "|" + " --- |" * 18
)


def report(trials: int = 1) -> Iterator[str]:
    """Rows of the table."""
    begin = process_time()
    yield (
        "pairs of one satellite, first 45 dB-Hz, 2.6 Msps: both followed; share of phases for which a loop can stay; "
        "wait; rms errors of first and second (thermal sigma, pull)"
    )
    for row in table(trials):
        yield _text(row)
    yield f"  {process_time() - begin:.0f} s of CPU"
    yield "second signals on clean sky, 4 to 9 tracked satellites of 38 to 52 dB-Hz"
    rng = np.random.default_rng(1)
    for full, searches in ((False, 2000 * trials), (True, 60 * trials)):
        yield _counted(clean_searches(rng, searches, full=full), full)
    yield f"second signals beside a reflection, {trials} trials each, 42 to 50 dB-Hz"
    yield from _reflections(rng, trials)
    yield f"  {process_time() - begin:.0f} s of CPU"


def _counted(count: Count, full: bool) -> str:
    settings = ReceiverSettings()
    each_s = settings.full_search_s if full else settings.near_search_s
    what = "full" if full else "near"
    hours = count.searches * each_s / 3600.0
    return (
        f"  {count.searches} {what} searches ({hours:.2f} h at one each {each_s:g} s) of {count.signals} signals: "
        f"{count.alarms} with a peak"
    )


def _reflections(rng: np.random.Generator, trials: int) -> Iterator[str]:
    for apart_chips, relative_db, apart_hz in REFLECTIONS:
        seen = [reflected(rng, apart_chips, relative_db, apart_hz) for _ in range(trials)]
        yield (
            f"  {apart_chips:4.2f} chips {relative_db:+3.0f} dB {apart_hz:.1f} Hz: "
            f"{sum(n > 0 for n in seen)}/{trials} with another signal"
        )


def main() -> None:
    """The whole table as markdown, with as many trials as wanted."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--trials", type=int, default=10, help="of each cell")
    options.add_argument("--apart", type=float, nargs="*", default=SEPARATIONS_CHIPS, help="separations, chips")
    options.add_argument("--power", type=float, nargs="*", default=POWERS_DB, help="of the second, dB")
    options.add_argument("--hz", type=float, nargs="*", default=DIFFERENCES_HZ, help="between the Dopplers")
    options.add_argument("--cn0", type=float, default=45.0, help="of the first signal, dB-Hz")
    options.add_argument("--rate", type=float, default=RATE_HZ, help="samples a second")
    options.add_argument("--joint", action="store_true", help="with joint channels")
    chosen = options.parse_args()
    settings = ReceiverSettings(sats=(SAT,), joint=chosen.joint)
    print(MARKDOWN_HEAD)
    for row in table(chosen.trials, chosen.apart, chosen.power, chosen.hz, settings, chosen.rate, chosen.cn0):
        print(_markdown(row), flush=True)


if __name__ == "__main__":
    main()
