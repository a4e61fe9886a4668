"""Estimate the power density of samples, its floor, and narrow-band lines above it."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy import fft, special

from skyproof.arrays import Booleans, Integers, Reals

__all__ = [
    "GUARD",
    "compute_line_threshold",
    "count_noise_bins",
    "estimate_density",
    "find_floor_and_lines",
    "measure_tone",
]

GUARD: Final = 5
_SIDE: Final = 24
"""Bins to either side of the one looked at: left out (the window's main lobe), then used for the floor."""
_STOP_BAND: Final = 0.03
"""Of the highest floor: where a filter leaves less, its ripples are not looked at for lines; none could hurt there."""
_BLACKMAN_HARRIS: Final = (0.35875, -0.48829, 0.14128, -0.01168)
"""F. J. Harris, "On the use of windows for harmonic analysis with the discrete Fourier transform", Proc. IEEE 66(1),
1978, table 1: four terms, -92 dB."""


def compute_line_threshold(n_averaged: int, probability: float) -> float:
    """Compute the level over its floor that a bin of noise exceeds with `probability`.

    A bin is the mean of `n_averaged` independent exponential variables: Gamma. The floor is the greater one of the
    medians of `_SIDE` bins on either side, each nearly normal; the threshold allows for its spread.
    """
    independent = _SIDE / _ALIKE
    spread = 1.2533 / math.sqrt(independent * n_averaged)  # of a median: sqrt(pi / 2) that of a mean
    z, weights = np.polynomial.hermite_e.hermegauss(40)
    weights = weights * 2.0 * special.ndtr(z)  # the greater one of two
    weights /= weights.sum()
    floors = np.maximum(1.0 + spread * z, 0.05)
    low, high = 1.0, 1e3
    for _ in range(50):
        middle = math.sqrt(low * high)
        exceeded = float(np.sum(weights * special.gammaincc(n_averaged, n_averaged * middle * floors)))
        low, high = (middle, high) if exceeded > probability else (low, middle)
    return high


def _window(n_fft: int) -> Reals:
    # side lobes of -92 dB: a line 60 dB above the floor is nine bins and no more
    turns = np.arange(n_fft) / n_fft
    return np.asarray(sum(a * np.cos(2.0 * np.pi * k * turns) for k, a in enumerate(_BLACKMAN_HARRIS)), np.float64)


def count_noise_bins(n_fft: int) -> float:
    """Return the noise bandwidth of a bin, in bins."""
    window = _window(n_fft)
    return float(n_fft * np.sum(window**2) / np.sum(window) ** 2)


def estimate_density(
    stretches: Sequence[Reals], dc: Reals, rate_hz: float, n_fft: int, *, real: bool
) -> tuple[Reals, Reals, int]:
    """Estimate power density by Welch's method, frequencies ascending; and count the periodograms.

    Neighbours overlap by half, which this window makes all but independent (correlation of powers 0.001).
    """
    window = _window(n_fft)
    total: Reals = np.zeros(n_fft)
    count = 0
    for planes in stretches:
        wave = (planes[0] - dc[0]) + 1j * (planes[1] - dc[1])
        segments = np.lib.stride_tricks.sliding_window_view(wave, n_fft)[:: n_fft // 2] * window
        spectra = fft.fft(segments.astype(np.complex64), axis=-1)
        total += np.sum(spectra.real.astype(np.float64) ** 2 + spectra.imag.astype(np.float64) ** 2, axis=0)
        count += segments.shape[0]
    density = total / (count * rate_hz * np.sum(window**2))
    if real:
        half = n_fft // 2
        return np.arange(half) * rate_hz / n_fft, 2.0 * density[:half], count
    return fft.fftshift(fft.fftfreq(n_fft, 1.0 / rate_hz)), fft.fftshift(density), count


def find_floor_and_lines(
    density: Reals, threshold: float, usable: Booleans, mean_over_median: float, *, circular: bool
) -> tuple[Reals, list[Integers]]:
    """Find the floor, and the bins that each line covers.

    Lines found are left out of the floor, until no more come.
    """
    covered: Booleans = np.zeros(density.size, np.bool_)
    found: Booleans = covered
    floor = density
    for _ in range(8):
        floor = mean_over_median * _estimate_floor(density, covered, circular=circular)
        found = np.asarray((density > threshold * np.maximum(floor, _STOP_BAND * floor.max())) & usable)
        wide = _widen(found, GUARD - 1, circular=circular)
        if not (wide & ~covered).any():
            break
        covered = np.asarray(covered | wide, np.bool_)
    if not found.any():
        return floor, []
    # bins of one line lie closer than the window's main lobe
    groups = np.split(np.flatnonzero(found), np.flatnonzero(np.diff(np.flatnonzero(found)) >= GUARD) + 1)
    reach = np.arange(-(GUARD - 1), GUARD)
    bins = [np.unique((group[:, np.newaxis] + reach).ravel()) for group in groups]
    return floor, [b % density.size if circular else b[(b >= 0) & (b < density.size)] for b in bins]


def _widen(flags: Booleans, reach: int, *, circular: bool) -> Booleans:
    padded = np.pad(flags, reach, mode="wrap" if circular else "constant")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).any(axis=1), np.bool_)


def _estimate_floor(density: Reals, covered: Booleans, *, circular: bool) -> Reals:
    """Take the greater one of the medians on either side, so that no slope or edge of the band counts as a line."""
    reach = GUARD + _SIDE
    kept = np.where(covered, np.nan, density)
    padded = np.pad(kept, reach, mode="wrap") if circular else np.pad(kept, reach, mode="reflect")
    window = np.lib.stride_tricks.sliding_window_view(padded, _SIDE)
    with np.errstate(all="ignore"):
        medians = _compute_nan_median(window)
    below, above = medians[: density.size], medians[GUARD + reach + 1 : GUARD + reach + 1 + density.size]
    floor = np.fmax(below, above)
    fallback = float(np.nanmedian(kept)) if not covered.all() else float(np.median(density))
    return np.where(np.isfinite(floor) & (floor > 0.0), floor, fallback)


def _compute_nan_median(windows: Reals) -> Reals:
    """Compute the median along the last axis without NaN (NaN if fewer than a quarter are numbers)."""
    ordered = np.sort(windows, axis=-1)  # NaN come last
    count = np.count_nonzero(np.isfinite(ordered), axis=-1)
    rows = np.arange(ordered.shape[0])
    middle = 0.5 * (ordered[rows, np.maximum(count - 1, 0) // 2] + ordered[rows, np.minimum(count, _SIDE - 1) // 2])
    return np.where(count >= _SIDE // 4, middle, np.nan)


def measure_tone(
    bins: Integers, frequency_hz: Reals, density: Reals, floor: Reals, step_hz: float
) -> tuple[float, float, float]:
    """Measure frequency, power and rms width of the line in `bins`."""
    excess = np.maximum(density[bins] - floor[bins], 0.0)
    power = float(np.sum(excess) * step_hz)
    top = int(np.argmax(excess))
    # the logarithm of this window's main lobe is a parabola to 0.01 bin
    shift = 0.0
    if 0 < top < bins.size - 1 and excess[top - 1] > 0.0 and excess[top + 1] > 0.0:
        below, middle, above = np.log(excess[top - 1 : top + 2])
        shift = 0.5 * (below - above) / (below - 2.0 * middle + above)
    at_hz = float(frequency_hz[bins[top]] + shift * step_hz)
    offset = np.arange(bins.size) - top - shift
    variance = float(np.sum(excess * offset**2) / np.sum(excess)) - _LOBE_VARIANCE
    strong = excess[top] > 10.0 * floor[bins[top]]  # below that the wings are noise
    width_hz = step_hz * math.sqrt(variance) if strong and variance > 0.5 else 0.0
    return at_hz, power, width_hz


def _compute_lobe_variance() -> float:
    """Compute the variance of the power of the window's main lobe around its middle, in squared bins."""
    lobe = np.abs(fft.fft(_window(256)))[np.arange(-4, 5)] ** 2
    return float(np.sum(lobe * np.arange(-4, 5) ** 2) / np.sum(lobe))


def _count_alike() -> float:
    """Count how many neighbouring bins the window makes of one: the sum of the correlations of their powers."""
    window = _window(256)
    return float(256 * np.sum(window**4) / np.sum(window**2) ** 2)


_LOBE_VARIANCE: Final = _compute_lobe_variance()
_ALIKE: Final = _count_alike()
