"""The dictionary of one satellite's code behind a receiver's replica: its side lobes and both filters included.

`fit.delay_dictionary` is that of random chips behind an ideal filter. A code's own side lobes are up to 0.06 high
beside its peak, and a replica's low-pass need not be a wall: with long sums and strong signals both are seen.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Integers, Reals
from skyproof.decomposition.fit import Dictionary, dictionary_of

__all__ = ["Filter", "code_dictionary", "filter_loss", "quiet_lags"]

Filter = Callable[[Reals], Reals]
"""Amplitude that a low-pass leaves at frequencies in cycles a chip; it shifts nothing."""

_ROUNDED = 1e-4  # of the noise's largest eigenvalue: below, a replica rounded to int8 is not what it is taken to be
_POINTS = 256  # a chip, between which cubics are laid: 1e-4 of the highest frequency of 30 MHz


def code_dictionary(
    code: NDArray[np.int8],
    taps_chips: Sequence[float],
    replica: Filter,
    front_end: Filter | None = None,
    *,
    band_cycles: float,
    window_chips: float = 1.6,
) -> Dictionary:
    """Of taps at `taps_chips` (later positive), for signals that come up to `window_chips` earlier or later.

    code : (n,) of +1 and -1. replica, front_end : their low-passes; no `front_end` lets all pass. band_cycles : a chip,
    above which `replica` lets nothing through. A signal of amplitude one gives one at its own delay; noise is white
    before the front end.
    """
    line = np.arange(int(band_cycles * code.size) + 1)
    cycles = line / code.size
    power = np.abs(np.fft.fft(code.astype(np.float64)))[line % code.size] ** 2 * np.sinc(cycles) ** 2
    passed = replica(cycles) * (1.0 if front_end is None else front_end(cycles))
    taps = np.array(taps_chips)
    step = 0.01 if band_cycles < 15.0 else 0.005
    side = round(window_chips / step)
    grid = np.asarray(step * np.arange(-side, side + 1), np.float64)
    lag = taps[:, None] - grid
    value, slope = _curves(power * passed, code.size)
    noise, noise_slope = _curves(power * passed**2, code.size)
    return dictionary_of(
        taps,
        grid,
        value=_read(lag, value, slope) / value[0],
        slope=-_read_slope(lag, value, slope) / value[0],
        noise=_read(taps[:, None] - taps, noise, noise_slope) / noise[0],
        least=_ROUNDED,
    )


def filter_loss(replica: Filter, *, band_cycles: float) -> float:
    """Of C/N0, in a single tap, against sharp chips in white noise and their own replica."""
    cycles = (np.arange(4096) + 0.5) / 4096 * band_cycles
    step, gain = band_cycles / 4096, replica(cycles)
    chip = np.sinc(cycles) ** 2
    return float((2.0 * step * np.sum(chip * gain)) ** 2 / (2.0 * step * np.sum(chip * gain**2)))


def quiet_lags(code: NDArray[np.int8], count: int, *, clear_chips: int = 4) -> Integers:
    """Lags (count,) in whole chips around which the code shows nothing of itself: where noise is measured.

    Gold codes have side lobes at one lag of four only. Those nearest to the peak, `clear_chips` free to both sides.

    Raises
    ------
    ValueError : there are fewer.
    """
    lobes = np.rint(np.fft.ifft(np.abs(np.fft.fft(code.astype(np.float64))) ** 2).real).astype(np.int64)
    quiet = np.abs(lobes) <= 1
    clear = np.all([np.roll(quiet, shift) for shift in range(-clear_chips, clear_chips + 1)], axis=0)
    lags = np.flatnonzero(clear[: code.size // 2])
    if lags.size < count:
        raise ValueError(f"a code of {code.size} chips has {lags.size} lags without side lobes, {count} are needed")
    return np.asarray(lags[:count], np.int64)


def _curves(spectrum: Reals, size: int) -> tuple[Reals, Reals]:
    """Even function of the lag and its slope at `_POINTS` a chip over one period, from its lines."""
    n = size * _POINTS
    lines = np.zeros(n // 2 + 1)
    lines[: spectrum.size] = spectrum
    turn = 2j * np.pi * np.arange(lines.size) / size
    return np.fft.irfft(lines, n), np.fft.irfft(lines * turn, n)


def _places(lag: Reals, curve: Reals) -> tuple[Integers, Integers, Reals]:
    at = lag * _POINTS
    cell = np.floor(at).astype(np.int64)
    return cell % curve.size, (cell + 1) % curve.size, at - cell


def _read(lag: Reals, curve: Reals, slope: Reals) -> Reals:
    i, j, u = _places(lag, curve)
    step = 1.0 / _POINTS
    ends = (1.0 + 2.0 * u) * (1.0 - u) ** 2 * curve[i] + u * u * (3.0 - 2.0 * u) * curve[j]
    return np.asarray(ends + (u * (1.0 - u) ** 2 * slope[i] + u * u * (u - 1.0) * slope[j]) * step)


def _read_slope(lag: Reals, curve: Reals, slope: Reals) -> Reals:
    i, j, u = _places(lag, curve)
    ends = 6.0 * u * (1.0 - u) * (curve[j] - curve[i]) * _POINTS
    return np.asarray(ends + (1.0 - u) * (1.0 - 3.0 * u) * slope[i] + u * (3.0 * u - 2.0) * slope[j])
