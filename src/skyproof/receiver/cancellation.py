"""Subtract known signals from the samples, and measure a signal that was found.

A signal is taken out one code period at a time: correlate the period, subtract the replica with the amplitude found.
That is least squares with an amplitude a period, so data bits, fading and phase noise cost nothing. It removes the
whole correlation shape with all its side lobes, also those on other satellites' codes. Signals of one satellite
overlap: a few rounds over them give the joint least squares (backfitting; half a chip apart, the error falls to a
quarter a round).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from skyproof.arrays import Complexes, Floats, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import SignalPlan, prn_of

__all__ = ["KnownSignal", "Measured", "measure", "measure_noise", "remove", "separation_chips"]

CHUNK: Final = 512
FRACTIONS: Final = 64
"""Fractions of a sample at which a code to be taken out is tabled: at 2.6 Msps 0.3 % of its power stays, at edges."""
_FREE_CHIPS: Final = 0.75
_FIT_STEP_CHIPS: Final = 0.05
_FAST: Final = {"reassoc", "contract", "nsz"}


@dataclass(frozen=True, kw_only=True)
class KnownSignal:
    """A signal that is tracked or was found.

    delay_s : of the first start of a code period at or after the stretch's first sample.
    doppler_hz : apparent carrier minus the nominal one (intermediate frequency taken off).
    """

    delay_s: float
    doppler_hz: float


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A signal found, measured over the whole stretch."""

    signal: KnownSignal
    power: float  # mean of the prompt correlation of one code period, noise included


def remove(
    planes: Floats,
    signal: SignalPlan,
    rate_hz: float,
    if_hz: float,
    known: Sequence[tuple[str, KnownSignal]],
    *,
    rounds: int = 1,
) -> Reals:
    """Subtract the known signals, (satellite, signal), from `planes`, float32 (2, n), in place.

    Returns the mean power of each one's correlation over one code period, noise included: shape (n_known,).
    """
    power = np.zeros((rounds, len(known)))
    for turn in range(rounds):
        for number, (sat, known_signal) in enumerate(known):
            chip, chip_step, cycle_step = _phases(signal, rate_hz, if_hz, known_signal)
            nominal = signal.chip_rate_hz / rate_hz
            power[turn, number] = _subtract(
                planes[0],
                planes[1],
                _build_table(signal, sat, nominal),
                chip,
                chip_step,
                nominal,
                cycle_step,
                signal.code_length,
            )
    scaled: Reals = (rate_hz * signal.period_s) ** 2 * power[0]
    return scaled


def measure(
    planes: Floats,
    signal: SignalPlan,
    rate_hz: float,
    if_hz: float,
    sat: str,
    rough: KnownSignal,
    *,
    doppler_reach_hz: float,
) -> Measured:
    """Measure delay, Doppler and C/N0 of a signal found within half a chip and `doppler_reach_hz` (at most 500 Hz).

    Doppler: spectrum of the squared correlations of half code periods, which are free of data bits. Delay: late minus
    early along the prompt (Kaplan and Hegarty, 8.7, dot product), the triangle's slope.
    """
    estimate, code = rough, _code_of(signal, sat)
    taps = np.linspace(-0.5, 0.5, 5)
    halves = _correlate(planes, signal, rate_hz, if_hz, code, estimate, taps)
    best = int(np.argmax(np.sum(np.abs(halves) ** 2, axis=(0, 1))))
    prompts = halves[..., best].ravel()
    n_fft = 8 * fft.next_fast_len(prompts.size)
    spectrum = np.abs(fft.fft(prompts**2, n_fft))
    frequency_hz = 0.5 * fft.fftfreq(n_fft, 0.5 * signal.period_s)
    spectrum[np.abs(frequency_hz) > doppler_reach_hz] = 0.0
    chip_s = 1.0 / signal.chip_rate_hz
    estimate = KnownSignal(
        delay_s=estimate.delay_s + taps[best] * chip_s,
        doppler_hz=estimate.doppler_hz + float(frequency_hz[int(np.argmax(spectrum))]),
    )
    for apart in (0.5, 0.25):
        early, prompt, late = np.moveaxis(
            _correlate(planes, signal, rate_hz, if_hz, code, estimate, np.array([-apart, 0.0, apart])).sum(axis=1),
            -1,
            0,
        )
        slope = float(np.sum(((late - early) * prompt.conj()).real) / (2.0 * np.sum(np.abs(prompt) ** 2)))
        estimate = KnownSignal(
            delay_s=estimate.delay_s + float(np.clip(slope, -0.5, 0.5)) * chip_s, doppler_hz=estimate.doppler_hz
        )
    return Measured(
        signal=KnownSignal(delay_s=estimate.delay_s % signal.period_s, doppler_hz=estimate.doppler_hz),
        power=float(np.mean(np.abs(prompt) ** 2)),
    )


def separation_chips(
    planes: Floats,
    signal: SignalPlan,
    rate_hz: float,
    if_hz: float,
    sat: str,
    one: KnownSignal,
    other: KnownSignal,
) -> float:
    """Estimate how far apart two overlapping signals of one satellite are: joint least squares over both delays.

    Each was measured as if it were alone, or after the other was subtracted. If a single signal is subtracted from one
    with a near reflection, the rest has a false top a chip away.

    planes : with both in. Amplitudes are free in each code period; both delays within `_FREE_CHIPS` of what is known.
    """
    apart = (other.delay_s - one.delay_s + 0.5 * signal.period_s) % signal.period_s - 0.5 * signal.period_s
    second = apart * signal.chip_rate_hz
    taps = np.arange(min(second, 0.0) - _FREE_CHIPS, max(second, 0.0) + _FREE_CHIPS, _FIT_STEP_CHIPS)
    sums = _correlate(planes, signal, rate_hz, if_hz, _code_of(signal, sat), one, taps).sum(axis=1)
    common = (sums.conj().T @ sums).real
    between = np.abs(taps - taps[:, np.newaxis])
    top = np.maximum(1.0 - between, 0.0)
    power = np.diag(common)
    explained = (power + power[:, np.newaxis] - 2.0 * top * common) / np.maximum(1.0 - top**2, 1e-9)
    explained[between < 1.5 * _FIT_STEP_CHIPS] = 0.0
    return float(between.flat[int(np.argmax(explained))])


def measure_noise(planes: Floats, signal: SignalPlan, rate_hz: float, if_hz: float, code: NDArray[np.int8]) -> float:
    """Measure the mean power of one code period's correlation with an unused code: the noise in the code's band.

    It uses at most 20 periods and 16 delays: good to 6 %. The mean square of the samples would not do, as the front
    end's band may be a small part of theirs.
    """
    delays_chips = np.linspace(0.0, signal.code_length, 16, endpoint=False)
    origin = KnownSignal(delay_s=0.0, doppler_hz=0.0)
    n = min(planes.shape[1], math.ceil(20.0 * signal.period_s * rate_hz))
    sums = _correlate(planes[:, :n], signal, rate_hz, if_hz, _pad_code(code), origin, delays_chips).sum(axis=1)
    return float(np.mean(np.abs(sums) ** 2))


@cache
def _build_table(signal: SignalPlan, sat: str, chips_per_sample: float) -> NDArray[np.int8]:
    """Build a table of the code at fractions of a sample, (FRACTIONS, n), for a satellite.

    Row p, column k is the chip (k + p / FRACTIONS - 1) samples after the code's start. Reading a row costs a fraction
    of looking up the chip of each sample.
    """
    n = math.ceil(signal.code_length / chips_per_sample) + CHUNK + 4
    samples = np.arange(n)[None, :] - 1.0 + np.arange(FRACTIONS)[:, None] / FRACTIONS
    chips = signal.code(prn_of(sat))
    return np.asarray(chips[np.floor(samples * chips_per_sample).astype(np.int64) % chips.size])


@cache
def _code_of(signal: SignalPlan, sat: str) -> Floats:
    return _pad_code(signal.code(prn_of(sat)))


def _pad_code(chips: NDArray[np.int8]) -> Floats:
    """Pad the code with the chips that rounding may touch beyond either end."""
    return np.concatenate([chips[-1:], chips, chips[:1]]).astype(np.float32)


def _phases(signal: SignalPlan, rate_hz: float, if_hz: float, one: KnownSignal) -> tuple[float, float, float]:
    """Return the chip at sample 0, chips a sample, and carrier cycles a sample."""
    code_rate_hz = signal.chip_rate_hz * (1.0 + one.doppler_hz / signal.carrier_hz)
    chip = (-one.delay_s * code_rate_hz) % signal.code_length
    return chip, code_rate_hz / rate_hz, (if_hz + one.doppler_hz) / rate_hz


def _correlate(
    planes: Floats,
    signal: SignalPlan,
    rate_hz: float,
    if_hz: float,
    code: Floats,
    one: KnownSignal,
    taps_chips: Reals,
) -> Complexes:
    """Correlate each half of each whole code period with replicas delayed by the taps: (n_periods, 2, n_taps)."""
    chip, chip_step, cycle_step = _phases(signal, rate_hz, if_hz, one)
    per_period = signal.code_length / chip_step
    first = ((-chip) % signal.code_length) / chip_step
    n_periods = int((planes.shape[1] - first) / per_period)
    out = np.empty((max(n_periods, 1), 2, taps_chips.size), np.complex128)
    _correlate_halves(planes[0], planes[1], code, first, per_period, chip_step, cycle_step, taps_chips, out)
    return out


@compiled(fastmath=_FAST)
def _fill_rotations(cycle_step: float, cosines: Floats, sines: Floats) -> None:
    """Compute exp(j 2 pi k cycle_step) for k < CHUNK, by doubling."""
    cosines[0], sines[0] = np.float32(1.0), np.float32(0.0)
    length = 1
    while length < CHUNK:
        angle = 2.0 * math.pi * ((length * cycle_step) % 1.0)
        c, s = np.float32(math.cos(angle)), np.float32(math.sin(angle))
        for k in range(length):
            cosines[length + k] = cosines[k] * c - sines[k] * s
            sines[length + k] = cosines[k] * s + sines[k] * c
        length *= 2


@compiled(fastmath=_FAST)
def _sum(i: Floats, q: Floats, replica: NDArray[Any], cosines: Floats, sines: Floats) -> tuple[float, float]:
    real = np.float32(0.0)
    imag = np.float32(0.0)
    for k in range(replica.shape[0]):
        chip = np.float32(replica[k])
        real += (i[k] * cosines[k] + q[k] * sines[k]) * chip
        imag += (q[k] * cosines[k] - i[k] * sines[k]) * chip
    return float(real), float(imag)


@compiled(fastmath=_FAST)
def _subtract_replica(
    i: Floats,
    q: Floats,
    replica: NDArray[np.int8],
    cosines: Floats,
    sines: Floats,
    real: np.float32,
    imag: np.float32,
) -> None:
    for k in range(replica.shape[0]):
        chip = np.float32(replica[k])
        i[k] -= (real * cosines[k] - imag * sines[k]) * chip
        q[k] -= (real * sines[k] + imag * cosines[k]) * chip


@compiled
def _place(sample: float) -> tuple[int, int]:
    """Return row and first column of the table for a chunk so many samples after the code's start."""
    steps = math.floor((sample + 1.0) * FRACTIONS + 0.5)
    return steps % FRACTIONS, steps // FRACTIONS


@compiled
def _subtract(
    i: Floats,
    q: Floats,
    table: NDArray[np.int8],
    chip: float,
    chip_step: float,
    nominal: float,
    cycle_step: float,
    length: int,
) -> float:
    """Take one signal out, a code period at a time. Returns the mean power of its amplitudes."""
    n = i.shape[0]
    cosines, sines = np.empty(CHUNK, np.float32), np.empty(CHUNK, np.float32)
    _fill_rotations(cycle_step, cosines, sines)
    begin, period = 0, 0
    power, weight = 0.0, 0.0
    while begin < n:
        end = min(n, math.ceil((length * (period + 1) - chip) / chip_step))
        re, im = 0.0, 0.0
        for at in range(begin, end, CHUNK):
            to = min(end, at + CHUNK)
            row, column = _place(max(chip + at * chip_step - length * period, 0.0) / nominal)
            a, b = _sum(i[at:to], q[at:to], table[row, column : column + to - at], cosines, sines)
            angle = 2.0 * math.pi * ((at * cycle_step) % 1.0)
            c, s = math.cos(angle), math.sin(angle)
            re += a * c + b * s
            im += b * c - a * s
        if end > begin:
            re /= end - begin
            im /= end - begin
        power += (re * re + im * im) * (end - begin)
        weight += end - begin
        for at in range(begin, end, CHUNK):
            to = min(end, at + CHUNK)
            row, column = _place(max(chip + at * chip_step - length * period, 0.0) / nominal)
            angle = 2.0 * math.pi * ((at * cycle_step) % 1.0)
            c, s = math.cos(angle), math.sin(angle)
            _subtract_replica(
                i[at:to],
                q[at:to],
                table[row, column : column + to - at],
                cosines,
                sines,
                np.float32(re * c - im * s),
                np.float32(re * s + im * c),
            )
        begin, period = end, period + 1
    return power / max(weight, 1.0)


@compiled
def _correlate_halves(
    i: Floats,
    q: Floats,
    code: Floats,
    first: float,
    per_period: float,
    chip_step: float,
    cycle_step: float,
    taps_chips: Reals,
    out: Complexes,
) -> None:
    length = code.shape[0] - 2
    cosines, sines = np.empty(CHUNK, np.float32), np.empty(CHUNK, np.float32)
    _fill_rotations(cycle_step, cosines, sines)
    replica = np.empty(int(per_period) + 2, np.float32)
    for period in range(out.shape[0]):
        start = first + period * per_period
        edges = (math.ceil(start), math.ceil(start + 0.5 * per_period), math.ceil(start + per_period))
        for tap in range(taps_chips.shape[0]):
            for half in range(2):
                begin, end = edges[half], min(edges[half + 1], i.shape[0])
                rep = replica[: max(end - begin, 0)]
                chip = (begin - start) * chip_step - taps_chips[tap]
                for k in range(rep.shape[0]):
                    number = math.floor(chip + k * chip_step)
                    rep[k] = code[1 + (number + length) % length]
                re, im = 0.0, 0.0
                for at in range(begin, end, CHUNK):
                    to = min(end, at + CHUNK)
                    a, b = _sum(i[at:to], q[at:to], rep[at - begin : to - begin], cosines, sines)
                    angle = 2.0 * math.pi * ((at * cycle_step) % 1.0)
                    c, s = math.cos(angle), math.sin(angle)
                    re += a * c + b * s
                    im += b * c - a * s
                out[period, half, tap] = complex(re, im)
