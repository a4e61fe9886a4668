"""Find how many samples a code period takes and where the carrier lies, with neither rate nor code known.

A code that repeats makes samples one period apart alike. All satellites do so at the same lag, whatever their codes and
their Dopplers, which only turn the phase of each one's part. So the autocorrelation of the samples has a peak at each
whole number of periods, as wide as a chip, and under it the carrier turns.

The samples are first made white: power over its local median, with high lines cut. Then interfering lines, which repeat
as well, vanish. |r|^2 over its mean is a standard exponential variable at each lag where nothing repeats (Kay,
Detection Theory, 2.2: the sum of many independent terms is complex normal). The sum over M multiples of a lag is
Gamma(M). tests/recording/test_repetition.py counts false alarms.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special

from skyproof.arrays import ComplexFloats, Floats, Integers, Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan

__all__ = ["Repetition", "choose_length", "find_repetition"]

LEAST_SAMPLES: Final = 3000
_LEAST_PERIOD, _MOST_PERIOD = 1000, 110_000
"""Of a period in samples: the band of a C/A code fills the one at 1 MHz; front ends with 110 MHz are rare."""
_MULTIPLES: Final = 6
"""Of a period that are looked at. Beyond that data bits of 20 periods have changed more often than not."""
_BLOCKS: Final = 512
"""Of the spectrum, for its median: hides what repeats within 512 samples, which is the band's own shape."""
_CUT: Final = 8.0
"""Over the local mean: noise goes there once in 3000 times, a line much further."""
_DIVISORS: Final = 40
_CERTAIN: Final = 1e-4
"""Chance below which the multiples of a lag that are no multiples of a longer one are taken to stand out."""
_FINE, _FINE_TO = 0.25, 8000
"""Steps of the lags up to there: multiples of shorter ones, whose peaks are few samples wide, must not drift away."""
_GRID: Final = 8192
_GRAIN: Final = 1 << 16


@dataclass(frozen=True, kw_only=True)
class Repetition:
    """What repeats: every `period_samples` (with one sigma), around `carrier_cycles` a sample.

    carrier_cycles : -0.5 to 0.5, of real samples 0 to 0.5; good to a twentieth of a chip rate or so.
    chance : that noise alone repeats as strongly at any of the lags tried, as its decimal logarithm.
    strength : power of what repeats over the whole, summed over the multiples looked at: the better of two readings of
        the same bytes has more.
    mirrored_share : power of what repeats with its own mirror image over `strength`. Signals in complex samples have no
        image; in real ones that were read as I and Q they do. 0 for real samples.
    """

    period_samples: float
    period_sigma: float
    carrier_cycles: float
    log10_chance: float
    strength: float
    mirrored_share: float = 0.0


def choose_length(n_samples: int, most: int) -> int:
    """Choose how many samples to take, at most: a multiple of a power of two, for the transform, if many."""
    n_samples = min(n_samples, most)
    return n_samples if n_samples < 2 * _GRAIN else n_samples // _GRAIN * _GRAIN


def find_repetition(wave: ComplexFloats | Floats, *, signal: SignalPlan = GPS_L1_CA) -> Repetition:
    """Find the most repeating lag of samples of unknown rate.

    Parameters
    ----------
    wave : (n,) complex samples, or real ones.
    signal : whose code's chips, so many a period, give the width of the peaks.

    Raises
    ------
    ValueError : fewer than `LEAST_SAMPLES`.
    """
    n = wave.size
    if n < LEAST_SAMPLES:
        raise ValueError(f"{n} samples; at least {LEAST_SAMPLES} are needed to see a code repeat")
    real = not np.iscomplexobj(wave)
    lobes, powers, images = _autocorrelate(wave, real)
    longest = min(_MOST_PERIOD, n // 3)
    lags = np.concatenate([np.arange(_LEAST_PERIOD, min(_FINE_TO, longest), _FINE), np.arange(_FINE_TO, longest)])
    counts = np.minimum(_MULTIPLES, (n // 2) // lags).astype(np.int64)
    total = np.zeros(lags.size)
    for multiple in range(1, _MULTIPLES + 1):
        inside = counts >= multiple
        total[inside] += powers[_round_lags(multiple * lags[inside])]
    chances = _compute_log10_gamma(counts, total)
    best = int(np.argmin(chances - 1e-3 * total))  # beyond the least float the sum decides
    lag = _find_fundamental(powers, float(lags[best]), n)
    period, sigma = _refine(powers, lag, n, signal.code_length)
    count = min(_MULTIPLES, int((n // 2) / lag))
    multiples = _round_lags(lag * np.arange(1, count + 1))
    plain, imaged = (float(np.sum(kind[multiples])) for kind in (powers, images))
    chance = min(0.0, float(_compute_log10_gamma(np.array([count]), np.array([plain]))[0]) + math.log10(lags.size))
    return Repetition(
        period_samples=period,
        period_sigma=sigma,
        carrier_cycles=_find_carrier(lobes, period, n, signal.code_length, real),
        log10_chance=chance,
        strength=plain / n,
        mirrored_share=max(imaged - 3.0 * count, 0.0) / max(plain, 1.0),
    )


def _autocorrelate(wave: ComplexFloats | Floats, real: bool) -> tuple[ComplexFloats, Reals, Reals]:
    """Autocorrelate the whitened samples, circularly, at all lags.

    Returns the autocorrelation; its power over the mean of noise; and the same power for the correlation with the
    samples' own mirror image. Of real samples the positive frequencies are used: then the magnitude does not swing with
    the carrier.
    """
    n = wave.size
    spectrum = fft.rfft(wave)[1 : n // 2] if real else fft.fft(wave)
    power = spectrum.real**2 + spectrum.imag**2
    size = power.size // _BLOCKS
    level = np.median(power[: size * _BLOCKS].reshape(_BLOCKS, size), axis=1) / math.log(2.0)
    level = np.maximum(level, 1e-9 * level.max() + 1e-30)
    smooth = np.interp(
        np.arange(power.size), (np.arange(_BLOCKS) + 0.5) * size, level, period=None if real else power.size
    )
    white = np.minimum(power / smooth, _CUT).astype(np.float32)
    mean = white.mean()
    whole = np.zeros(n, np.complex64)
    whole[1 if real else 0 :][: white.size] = white - mean
    lobes = fft.ifft(whole, overwrite_x=True)
    powers = _compute_power(lobes) * (n**2 / (white.size * float(np.var(white)) + 1e-30))
    if real:
        return lobes, powers, np.zeros(n)
    straight = spectrum * np.sqrt(white / np.maximum(power, 1e-30))
    mirror = straight[(-np.arange(n)) % n]
    # each pair of frequencies comes twice: the lags are half as many independent numbers with twice the power
    return lobes, powers, _compute_power(fft.ifft(straight * mirror)) * (0.5 * n / float(mean) ** 2)


def _compute_power(values: ComplexFloats) -> Reals:
    return np.asarray(values.real**2 + values.imag**2, np.float64)


def _compute_log10_gamma(counts: Integers, total: Reals) -> Reals:
    """Compute the logarithm of the chance that the sum of so many exponential variables exceeds `total`."""
    chance = special.gammaincc(counts, total)
    # far out the incomplete gamma function is e^-x x^(m-1) / (m-1)!
    far = (-total + (counts - 1) * np.log(np.maximum(total, 1.0)) - special.gammaln(counts)) / math.log(10.0)
    return np.asarray(np.where(chance > 1e-250, np.log10(np.maximum(chance, 1e-300)), far))


def _round_lags(lags: NDArray[np.floating]) -> Integers:
    return np.asarray(np.round(lags), np.int64)


def _find_fundamental(powers: Reals, lag: float, n: int) -> float:
    """Find the shortest lag that divides `lag` and stands out at multiples of its own.

    Multiples of a longer such lag do not count. It is not done step by step: satellites may cancel at twice the period,
    though not at once it.
    """
    for divisor in range(min(_DIVISORS, int(lag / _LEAST_PERIOD)), 1, -1):
        shorter = lag / divisor
        multiples = np.arange(1, min(2 * _MULTIPLES, int((n // 2) / shorter)) + 1)
        at = _round_lags(multiples[np.gcd(multiples, divisor) == 1] * shorter)
        seen = np.maximum(powers[at], np.maximum(powers[at - 1], powers[at + 1]))
        chance = 10.0 ** float(_compute_log10_gamma(np.array([at.size]), np.array([seen.sum()]))[0])
        if chance * 3 ** min(at.size, 12) < _CERTAIN / _DIVISORS:
            return shorter
    return lag


def _refine(powers: Reals, lag: float, n: int, chips: int) -> tuple[float, float]:
    """Refine the lag, with one sigma: the middles of the peaks at its multiples on one line through zero."""
    period, width, most = lag, max(1, round(lag / chips)), min(2 * _MULTIPLES, int((n // 2) / lag) - 1)
    moment = spread = 0.0
    for multiple in range(1, most + 1):
        around = round(multiple * period) + np.arange(-2 * width, 2 * width + 1)
        height = np.maximum(powers[around] - 2.0, 0.0)
        if height.max() < 10.0:
            continue
        near = np.abs(around - around[int(np.argmax(height))]) <= width
        middle = float(np.sum(height[near] * around[near]) / np.sum(height[near]))
        weight = float(height.max())
        spread += weight * multiple**2
        moment += weight * multiple * middle
        period = moment / spread
    # the middle of a triangle of power P is known to some 0.3 / sqrt(P) of its half width, and no better than 0.02
    return period, 0.3 * width / math.sqrt(max(spread, 1.0)) + 0.02 * width / max(1, most)


def _find_carrier(lobes: ComplexFloats, period: float, n: int, chips: int, real: bool) -> float:
    """Find the frequency around which signals repeat.

    Spectra of the peaks, each with a phase of its own, are added in power.
    """
    width = max(2, round(1.5 * period / chips))
    offsets = np.arange(-width, width + 1)
    shape = 1.0 - np.abs(offsets) / (width + 1.0)
    total = np.zeros(_GRID)
    for multiple in range(1, min(_MULTIPLES, int((n // 2) / period)) + 1):
        piece = lobes[round(multiple * period) + offsets] * shape
        total += np.abs(fft.fft(piece, _GRID)) ** 2
    frequency = fft.fftfreq(_GRID)
    if real:
        total[frequency < 0.0] = 0.0
    return float(frequency[int(np.argmax(total))])
