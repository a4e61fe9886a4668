"""Test whether two stretches of samples hold the same noise: one antenna, or a copy.

Two antennas receive signals in common, and under a strong transmitter hardly anything else. But signals repeat with
their code. Written as rows of one code period, each is a matrix of rank one, times the bits and the carrier's turns; so
are the products of a filter or a coarse quantiser. Noise has full rank. So every component above what noise can have is
removed from the rows (`remove_repetition`), and the rest is correlated. The signals need not be known.

Rows are correlated one by one, and their powers added: carriers may differ by a tenth of the reciprocal of a code
period, and their phase may drift. Under independent noise the sum over M rows of |r|^2 over its mean is Gamma(M). With
a common part of coefficient rho it is half a non-central chi-square variable of 2 M degrees and non-centrality 2 M N
rho^2, for N cells a row. The null is the worst that two antennas under common signals can have: the rho of
`bound_explained`. So p-values are far too large rather than uniform. Nothing is reported where more repeats than noise
can stand beside. tests/recording/test_same_noise.py counts, up to signals 30 dB stronger than the sky's.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from skyproof.arrays import ComplexFloats, Floats, Reals
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.statistics.distributions import noncentral_chi_square_tail

__all__ = [
    "EXPLAINED",
    "LEAST_ROWS",
    "N_ROWS",
    "SharedNoise",
    "bound_explained",
    "correlate_noise",
    "cut_rows",
    "find_usable_hz",
    "remove_repetition",
]

N_ROWS: Final = 80
"""Code periods of a stretch: several times as many as there are signals."""
LEAST_ROWS: Final = 32
"""Of a recording that is shorter: at least twice as many as there are signals."""
EXPLAINED: Final = 0.1
"""Correlation coefficient that components of signals may have that were too weak to be distinguished from noise. One
that is found with `N_ROWS` rows of N cells has a power of 1 / sqrt(N_ROWS N) or more, so that ten that are not make
0.03."""
_IN_COMMON: Final = 0.03
"""Twice what the largest of all lags shows by chance. Receivers on one antenna that have less in common add 15 dB to
its noise: the sky's signals, 53 dB-Hz at most, come below 40 dB-Hz then."""
_LEAST_LEFT: Final = 0.25  # of the rows: where less is left, nearly all that was received repeats
_BAND_HZ: Final = 2.0 * GPS_L1_CA.chip_rate_hz  # the main lobe; noise beyond it adds nothing to noise within it
_LEVELS: Final = 64
_FINE: Final = 4
"""Lags a cell: between two of them the correlation loses 2.5 %."""
_LINE: Final = 30.0  # times its neighbours' median: no noise


@dataclass(frozen=True, kw_only=True)
class SharedNoise:
    """What two stretches have in common besides what repeats.

    coefficient : magnitude of the correlation, 0 to 1; of power, its square is common. NaN where nothing decides.
    lag_s : how much later in the second than in the first, modulo a code period.
    p_value : of a correlation as high at any lag, from two antennas.
    """

    coefficient: float
    lag_s: float
    p_value: float

    @property
    def of_two_antennas(self) -> bool:
        """Tell if nothing is in common, as of two antennas."""
        return self.coefficient <= _IN_COMMON


NOTHING: Final = SharedNoise(coefficient=math.nan, lag_s=0.0, p_value=1.0)


def find_usable_hz(rate_hz: float, carrier_at_hz: float, *, real: bool) -> float:
    """Return the band around the carrier that the samples hold, two-sided."""
    low_hz, high_hz = (0.0 if real else -0.5 * rate_hz), 0.5 * rate_hz
    return max(min(2.0 * min(carrier_at_hz - low_hz, high_hz - carrier_at_hz), _BAND_HZ), 0.0)


def cut_rows(planes: Floats, carrier_cycles: float, cells: int, n_rows: int = N_ROWS) -> ComplexFloats:
    """Cut the band around the carrier, white, into rows of one code period: (n_rows, cells).

    planes : (2, n) I and Q of so many code periods, by the clock of the recording that this one is compared with.
    carrier_cycles : where the carrier lies, cycles a sample. cells : the band times a code period. n_rows : at least
        `LEAST_ROWS`.
    """
    count = cells * n_rows
    spectrum = fft.fft(planes[0] + 1j * planes[1])
    middle = round(carrier_cycles * planes.shape[1])
    part = spectrum[(middle + np.arange(-(count // 2), count - count // 2)) % spectrum.size]
    power = part.real**2 + part.imag**2
    width = count // _LEVELS
    level = np.median(power[: width * _LEVELS].reshape(_LEVELS, width), axis=1) / math.log(2.0)
    level = np.interp(np.arange(count), (np.arange(_LEVELS) + 0.5) * width, np.maximum(level, 1e-9 * level.max()))
    part = part / np.sqrt(np.maximum(level, power / _LINE) + np.float32(1e-30))
    rows: ComplexFloats = fft.ifft(fft.ifftshift(part)).reshape(n_rows, cells).astype(np.complex64)
    return rows


def remove_repetition(rows: ComplexFloats) -> tuple[ComplexFloats, int]:
    """Remove what repeats from row to row; return the rest, and how many components were removed.

    Components are taken off, the strongest first, while the next stands above the edge of what noise has: the mean of
    those that remain times (1 + sqrt(rows / cells))^2 (Marchenko and Pastur, 1967).
    """
    n_rows, cells = rows.shape
    values, vectors = np.linalg.eigh((rows @ rows.conj().T).astype(np.complex128))
    taken = 0
    while taken < n_rows - 1:
        remaining = n_rows - taken
        edge = float(np.mean(values[:remaining])) * (1.0 + math.sqrt(remaining / cells)) ** 2
        if values[remaining - 1] <= edge:
            break
        taken += 1
    signals = vectors[:, n_rows - taken :].astype(np.complex64)
    return rows - signals @ (signals.conj().T @ rows), taken


def bound_explained(repeating: float) -> float:
    """Bound the correlation coefficient left between two antennas when this share of their power repeats.

    A quantiser mixes signals with each other, and the mixtures are too many to be removed. One bit is the coarsest.
    There two Gaussian inputs of correlation rho give outputs of 2 / pi asin(rho), and 2 / pi rho of it repeats as the
    inputs do (Van Vleck and Middleton, 1966). Any finer one mixes less. From 2 / pi on nothing decides.
    """
    rho = 0.5 * math.pi * repeating
    if rho >= 1.0:
        return 1.0
    return max(EXPLAINED, (math.asin(rho) / (0.5 * math.pi) - repeating) / (1.0 - repeating))


def correlate_noise(first: ComplexFloats, second: ComplexFloats, *, period_s: float) -> SharedNoise:
    """Correlate what two stretches hold besides what repeats; the second was cut to begin within half a period.

    first, second : (n_rows, cells) as `cut_rows` gives them, of the same shape.
    """
    n_rows, cells = first.shape
    (first_rest, of_one), (second_rest, of_other) = remove_repetition(first), remove_repetition(second)
    if n_rows - max(of_one, of_other) < _LEAST_LEFT * n_rows:
        return NOTHING
    repeating = 1.0 - min(
        _sum_energy(first_rest).sum() / _sum_energy(first).sum(),
        _sum_energy(second_rest).sum() / _sum_energy(second).sum(),
    )
    common = bound_explained(float(repeating))
    if common >= 1.0:
        return NOTHING
    spectrum = fft.fftshift(fft.fft(second_rest, axis=1) * np.conj(fft.fft(first_rest, axis=1)), axes=1)
    correlation = _FINE * fft.ifft(spectrum, _FINE * cells, axis=1)
    share = (
        np.abs(correlation) ** 2 / np.maximum(_sum_energy(first_rest) * _sum_energy(second_rest), 1e-30)[:, np.newaxis]
    )
    total = cells * np.sum(share, axis=0)
    best = int(np.argmax(total))
    excess = max(float(total[best]) / n_rows - 1.0, 0.0) / cells
    noncentrality = 2.0 * n_rows * cells * common**2
    p_value = total.size * noncentral_chi_square_tail(2.0 * float(total[best]), 2.0 * n_rows, noncentrality)
    lag = (best + _interpolate_top(total, best)) / total.size
    return SharedNoise(
        coefficient=math.sqrt(min(excess, 1.0)),
        lag_s=((lag + 0.5) % 1.0 - 0.5) * period_s,
        p_value=min(p_value, 1.0),
    )


def _sum_energy(rows: ComplexFloats) -> Reals:
    return np.asarray(np.sum(np.abs(rows) ** 2, axis=1, dtype=np.float64))


def _interpolate_top(values: NDArray[np.floating], best: int) -> float:
    """Find where between its neighbours the highest value has its top: that of a parabola."""
    before, at, after = (math.sqrt(float(values[(best + k) % values.size])) for k in (-1, 0, 1))
    bend = before - 2.0 * at + after
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0
