"""Measure code phases of found satellites in short stretches, against what their Dopplers predict."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import fft, special

from skyproof.arrays import ComplexFloats, Floats, Integers, Reals
from skyproof.gnss.signals import SignalPlan, prn_of
from skyproof.records import Samples

__all__ = [
    "AT_START",
    "CELLS",
    "CodeBlocks",
    "FoundSignal",
    "Tracks",
    "compute_ramp",
    "correlate_spectra",
    "correlate_tracks",
    "find_peak",
    "group_by_stretch",
    "list_bins",
    "predict_delay_s",
    "read_blocks",
]

CELLS = 2400  # of a code period: 2.4 samples a microsecond hold the main lobe of a C/A code
_BAND_HZ = 1.15e6
_STRETCHES, _MOST_PERIODS = 20, 10
AT_START = np.arange(-8, 9)  # cells that the delay predicted may be off: a search at a wrong rate errs by chips


class FoundSignal(Protocol):
    """A satellite's signal: its code period began `delay_s` after the recording's first sample did."""

    @property
    def sat(self) -> str: ...
    @property
    def delay_s(self) -> float: ...
    @property
    def doppler_hz(self) -> float: ...


@dataclass(frozen=True, eq=False, kw_only=True)
class CodeBlocks:
    """One code period after the other, at zero frequency and few samples a chip: (n_blocks, CELLS).

    changing : whether the samples change in every one.
    """

    waves: ComplexFloats
    first_sample: Integers  # (n_blocks,)
    block_samples: int
    rate_hz: float
    signal: SignalPlan
    changing: bool

    @property
    def block_s(self) -> float:
        return self.block_samples / self.rate_hz


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracks:
    """Correlation of every satellite in every stretch, around the delay predicted.

    around : (n_sats, n_stretches, CELLS) power over the noise's mean, all delays, that predicted first.
    middle_s : (n_stretches,) since the first sample.
    """

    spectra: ComplexFloats  # (n_sats, n_blocks, CELLS) of signal times conjugate code
    around: Floats
    middle_s: Reals
    ratio: float  # of code Doppler to carrier Doppler that was taken
    periods: int  # blocks a stretch
    noise: Reals  # (n_sats,) mean power of one block's cell


def read_blocks(samples: Samples, carrier_hz: float, n_blocks: int, signal: SignalPlan) -> CodeBlocks:
    """Read the first `n_blocks` code periods, the nominal carrier taken off; fewer if the recording is short."""
    exact = samples.rate_hz * signal.period_s
    size = round(exact)
    first = np.round(np.arange(n_blocks) * exact).astype(np.int64)
    first = first[first + size <= samples.n_samples]
    phasor = np.exp(-2j * np.pi * np.mod(carrier_hz / samples.rate_hz * np.arange(size), 1.0)).astype(np.complex64)
    kept = list_bins(size, samples.rate_hz)
    waves = np.zeros((first.size, CELLS), np.complex64)
    changing = True
    for row, start in enumerate(first):  # one period at a time: memory stays with the few cells that are kept
        planes = samples.read(int(start), size)
        changing &= bool(np.ptp(planes) > 0.0)
        spectrum = fft.fft((planes[0] + 1j * planes[1]) * phasor)
        waves[row, kept] = spectrum[kept]
    waves = fft.ifft(waves, axis=1)
    return CodeBlocks(
        waves=waves, first_sample=first, block_samples=size, rate_hz=samples.rate_hz, signal=signal, changing=changing
    )


def list_bins(size: int, rate_hz: float) -> Integers:
    """Return the indices of the FFT bins to keep, which count from the end for negative frequencies."""
    reach = min(int(_BAND_HZ * size / rate_hz), (size - 1) // 2, CELLS // 2 - 1)
    return np.arange(-reach, reach + 1)


def correlate_spectra(blocks: CodeBlocks, received: FoundSignal) -> ComplexFloats:
    """Multiply the spectra of all blocks, Doppler taken off, by the conjugate spectrum of the code."""
    size, rate_hz = blocks.block_samples, blocks.rate_hz
    chips = blocks.signal.code(prn_of(received.sat))
    fine = np.arange(8 * CELLS) * (blocks.block_s / (8 * CELLS)) * blocks.signal.chip_rate_hz
    code = fft.fft(chips[np.floor(fine).astype(np.int64) % chips.size].astype(np.float64))
    kept = list_bins(size, rate_hz)
    replica = np.zeros(CELLS, np.complex64)
    replica[kept] = np.conj(code[kept]) / (8 * CELLS)
    turns = np.mod(received.doppler_hz * blocks.block_s / CELLS * np.arange(CELLS), 1.0)
    spectra: ComplexFloats = fft.fft(blocks.waves * np.exp(-2j * np.pi * turns).astype(np.complex64), axis=1) * replica
    return spectra


def correlate_tracks(
    blocks: CodeBlocks, signals: Sequence[FoundSignal], spectra: ComplexFloats, ratio: float
) -> Tracks:
    """Correlate all satellites in all stretches.

    ratio : of code Doppler to carrier Doppler, 1 or -1.
    """
    n_blocks = spectra.shape[1]
    periods = int(np.clip(n_blocks // _STRETCHES, 1, _MOST_PERIODS))
    n_stretches = n_blocks // periods
    around = np.empty((len(signals), n_stretches, CELLS), np.float32)
    for row, received in enumerate(signals):
        # one ramp a stretch: within it the delay moves by a few hundredths of a chip, and half a sample for rounding
        ramps = compute_ramp(blocks, group_by_stretch(predict_delay_s(blocks, received, ratio), periods).mean(axis=1))
        for j, ramp in enumerate(ramps):
            waves = fft.ifft(spectra[row, j * periods : (j + 1) * periods] * ramp, axis=-1)
            around[row, j] = np.sum(waves.real**2 + waves.imag**2, axis=0)
    noise = np.median(around[:, :, ::3], axis=(1, 2)) / special.gammaincinv(periods, 0.5)
    around /= noise[:, np.newaxis, np.newaxis] * periods
    middle_s = (
        group_by_stretch(blocks.first_sample, periods).mean(axis=1) + 0.5 * blocks.block_samples
    ) / blocks.rate_hz
    return Tracks(spectra=spectra, around=around, middle_s=middle_s, ratio=ratio, periods=periods, noise=noise)


def group_by_stretch(values: Reals | Integers, periods: int) -> Reals:
    """Group values of all blocks as (n_stretches, periods); a last part of a stretch is left out."""
    n_stretches = values.size // periods
    return np.asarray(values[: n_stretches * periods].reshape(n_stretches, periods), np.float64)


def predict_delay_s(blocks: CodeBlocks, received: FoundSignal, ratio: float) -> Reals:
    """Predict the delay of the code's start after each block's first sample, not reduced to one period."""
    start_s = blocks.first_sample / blocks.rate_hz
    # whole periods are taken off exactly: the blocks' starts are rounded to samples
    past_s = start_s - np.arange(start_s.size) * blocks.signal.period_s
    return received.delay_s - past_s - ratio * received.doppler_hz / blocks.signal.carrier_hz * start_s


def compute_ramp(blocks: CodeBlocks, delay_s: Reals) -> ComplexFloats:
    """Compute the phase ramp that brings a delay to the first cell: (..., CELLS)."""
    bins = fft.fftfreq(CELLS, 1.0 / CELLS)
    turns = np.multiply.outer(np.asarray(delay_s) / blocks.block_s, bins)
    return np.asarray(np.exp(2j * np.pi * np.mod(turns, 1.0)), np.complex64)


def find_peak(power: Reals | Floats) -> float:
    """Find the cells of the highest of `AT_START`, by the parabola through it and its neighbours."""
    best = int(np.clip(np.argmax(power), 1, power.size - 2))
    low, middle, high = (float(value) for value in power[best - 1 : best + 2])
    bend = low - 2.0 * middle + high
    return float(AT_START[best]) + (float(np.clip(0.5 * (low - high) / bend, -1.0, 1.0)) if bend < 0.0 else 0.0)
