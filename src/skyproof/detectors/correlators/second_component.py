"""Find what a second signal of the same satellite adds to the correlators of the first, while the two overlap.

Taps of look n (some milliseconds of every 20 ms), carrier and data bits wiped off, at the delays d of the replica ahead
of the tracked code:

    y_n(d) = A R(d) + sum over k of a_k A R(d + lag_k) exp(2 pi i f_k t_n) + noise

R is the correlation behind the front end, lag_k by how much signal k is later. Signal k carries the tracked one's data
bits, so wiping them makes it a *line* at the difference f_k of the carriers. Noise is white from look to look. So are
other satellites' signals, whose own bits turn them at random. Only a second signal of the same satellite makes a line.
The window's mean is the reference, and its scatter the noise. The shape that the front end gives to R, C/N0, and the
correlation of taps need not be known, and none of them is fitted.

Under noise the Fourier bins X_f of m taps have one law. With S the sum of X X^H over K bins beside f,

    X_f^H S^-1 X_f = b / (1 - b),  b being Beta(m, K + 1 - m)      (complex Wishart: Goodman, Ann. Math. Stat., 1963)

The nearest bins are left out of S, for beats drift: a line would hide itself.

`distortion` removes the tracked signal's own part. It takes sums of taps at d and -d less their mean share of the
prompt. The signal's fading, phase and code errors (odd in d) do not change these sums. `earlier` works at beats faster
than the loops. It compares R(d + lag) at lags before the tracked signal with all other lags.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Complexes, ComplexFloats, Reals
from skyproof.detectors.correlators.correlator_laws import triangle
from skyproof.detectors.correlators.policy import POLICY

__all__ = ["BeatLine", "combine_smallest", "distortion", "earlier", "line_p_value", "pair_taps", "reflection_amplitude"]

EARLY_CHIPS = np.arange(-1.5, -0.249, 0.125)
OTHER_CHIPS = np.arange(-0.125, 1.501, 0.125)
"""Lags that `earlier` compares. Within a quarter of a chip a second signal looks like a wider peak."""
TWO_REFLECTIONS = [
    (a, b) for a, b in itertools.combinations(range(OTHER_CHIPS.size), 2) if OTHER_CHIPS[b] - OTHER_CHIPS[a] >= 0.25
]
"""Places of two lags of `OTHER_CHIPS` that are no single one with a wider peak."""


class BeatLine(NamedTuple):
    """The most telling line: p-value of all bins together, frequency in hertz, lag in chips (NaN where not looked at)
    and its statistic."""

    p_value: float
    frequency_hz: float
    lag_chips: float
    statistic: float


def pair_taps(delays_chips: Reals) -> list[tuple[int, int, int]]:
    """Return the indices of each pair of taps placed evenly about the prompt, ahead and behind, and of the prompt."""
    prompt = np.flatnonzero(np.abs(delays_chips) < 1e-6)
    ahead = np.flatnonzero(delays_chips > 1e-6)
    behind = [np.flatnonzero(np.abs(delays_chips + delays_chips[k]) < 1e-6) for k in ahead]
    return [
        (int(k), int(other[0]), int(prompt[0]))
        for k, other in zip(ahead, behind, strict=True)
        if other.size and prompt.size
    ]


def line_p_value(odds: ArrayLike, n_taps: int, n_bins: int) -> Reals:
    """Compute the p-value of X_f^H S^-1 X_f = `odds` with S the sum over `n_bins` other bins, under noise."""
    ratio = np.maximum(np.asarray(odds, float), 0.0)
    return np.asarray(special.betainc(n_bins + 1 - n_taps, n_taps, 1.0 / (1.0 + ratio)), float)


def combine_smallest(p_value: float, count: int) -> float:
    """Combine `count` independent p-values by their smallest (Sidak)."""
    return float(-np.expm1(count * np.log1p(-min(p_value, 1.0 - 1e-16))))


def distortion(looks: ComplexFloats, delays_chips: Reals, step_s: float, *, allowed: float = 0.0) -> BeatLine:
    """Find the strongest line at any beat in the sums of pairs of taps.

    looks : (n, n_taps), one signal. step_s : from look to look. allowed : amplitude of a second signal, relative to the
        tracked one, that reflections have without an attack, one sigma; 0 makes the p-value exact.
    """
    value, pairs = looks.astype(np.complex128), pair_taps(delays_chips)
    sums = np.stack([value[:, a] + value[:, b] for a, b, _ in pairs], axis=1)
    prompt = value[:, pairs[0][2]]
    share = sums.mean(axis=0) / prompt.mean()
    spectrum = _compute_spectrum(sums - prompt[:, np.newaxis] * share, step_s, least_hz=0.0)
    lags = OTHER_CHIPS[OTHER_CHIPS > 0.0]
    ahead = delays_chips[[a for a, _, _ in pairs], np.newaxis]
    shape = triangle(lags + ahead) + triangle(lags - ahead) - share[:, np.newaxis] * triangle(lags)  # (pair, lag)
    power = spectrum.power(shape).max(axis=1)
    expected = len(looks) * np.abs(prompt.mean()) ** 2 * allowed**2 * power * spectrum.n_others
    odds = spectrum.odds() / (1.0 + expected)
    p_values = line_p_value(odds, len(pairs), spectrum.n_others)
    best = int(np.argmin(p_values))
    return BeatLine(
        combine_smallest(float(p_values[best]), len(p_values)),
        float(spectrum.frequency_hz[best]),
        np.nan,
        float(odds[best]),
    )


def earlier(looks: ComplexFloats, delays_chips: Reals, step_s: float) -> BeatLine:
    """Find the line that fits a signal before the tracked one best; arguments as of `distortion`.

    The statistic is by how much a lag before the tracked signal explains a bin better than any two others do. One
    bin may hold two reflections, or one and the tracked signal, which loops turn with the beat; the sum of two can
    look like a lag between or beside them. Under noise the statistic is less than the whole of the bin, whose law is
    known. Under a line at any other lag it is less still. So the p-value is an upper bound.
    """
    value = looks.astype(np.complex128)
    spectrum = _compute_spectrum(value, step_s, least_hz=POLICY.fastest_loop_hz)
    towards = spectrum.towards().conj()

    def explain(lags: Reals) -> Reals:
        shape = triangle(delays_chips[:, np.newaxis] + lags)  # (tap, lag)
        return np.asarray(np.abs(towards @ shape) ** 2 / spectrum.power(shape))

    early = explain(EARLY_CHIPS)
    two = spectrum.by_two(triangle(delays_chips[:, np.newaxis] + OTHER_CHIPS), TWO_REFLECTIONS)
    more = early.max(axis=1) - two.max(axis=1) - POLICY.shape_error_share * spectrum.odds()
    p_values = line_p_value(more, value.shape[1], spectrum.n_others)
    best = int(np.argmin(p_values))
    return BeatLine(
        combine_smallest(float(p_values[best]), len(p_values)),
        float(spectrum.frequency_hz[best]),
        float(EARLY_CHIPS[np.argmax(early[best])]),
        float(more[best]),
    )


def reflection_amplitude(multipath_sigma_m: float, early_chips: float, chip_m: float) -> float:
    """Return the largest relative amplitude of a reflection that shifts the code by `multipath_sigma_m`.

    With early and late at +-`early_chips`, an amplitude a shifts it by a early_chips (Kaplan & Hegarty, 9.5.2, coherent
    discriminator).
    """
    return multipath_sigma_m / (chip_m * early_chips)


class _Spectrum(NamedTuple):
    """bins : (n, m) of the frequencies (n,). inverse : (n, m, m) of the sum of outer products of `n_others` other bins,
    without the nearest."""

    bins: Complexes
    frequency_hz: Reals
    inverse: Complexes
    n_others: int

    def odds(self) -> Reals:
        """Compute X^H S^-1 X (n,)."""
        return np.asarray(np.real(np.sum(self.bins.conj() * self.towards(), axis=1)))

    def towards(self) -> Complexes:
        """Compute S^-1 X (n, m)."""
        return np.asarray((self.inverse @ self.bins[:, :, np.newaxis])[:, :, 0])

    def power(self, shape: Reals | Complexes) -> Reals:
        """Compute the power (n, n_shapes) of a line of each shape (m, n_shapes)."""
        return np.asarray(np.real(np.sum(shape.conj() * (self.inverse @ shape), axis=1)))

    def by_two(self, shape: Reals, pairs: Sequence[tuple[int, int]]) -> Reals:
        """Compute what lines of two shapes (m, n_shapes) explain together (n, n_pairs)."""
        first, second = np.array(pairs).T
        seen = self.towards().conj() @ shape
        gram = np.einsum("ms,nmk,kt->nst", shape, self.inverse, shape, optimize=True)
        a, b = seen[:, first], seen[:, second]
        aa, bb, ab = (gram[:, i, k] for i, k in ((first, first), (second, second), (first, second)))
        joint = np.abs(a) ** 2 * bb.real + np.abs(b) ** 2 * aa.real - 2.0 * np.real(a.conj() * b * ab.conj())
        return np.asarray(joint / (aa.real * bb.real - np.abs(ab) ** 2))


def _compute_spectrum(value: Complexes, step_s: float, *, least_hz: float) -> _Spectrum:
    """Compute Fourier bins of (n, m), without those of the mean and of beats slower than `least_hz`."""
    frequency_hz = np.fft.fftfreq(len(value), step_s)
    order = np.argsort(frequency_hz)
    order = order[np.abs(frequency_hz[order]) > least_hz]
    bins = np.fft.fft(value, axis=0)[order] / np.sqrt(len(value))
    products = bins[:, :, np.newaxis] * bins.conj()[:, np.newaxis, :]
    reach = math.ceil(POLICY.line_half_width_hz * len(value) * step_s)
    # Frequencies go round: the neighbours of the last are the first.
    ahead = np.cumsum(np.concatenate([products[-reach - 1 :], products, products[:reach]]), axis=0)
    nearest = ahead[2 * reach + 1 :] - ahead[: -2 * reach - 1]
    inverse = np.linalg.inv(products.sum(axis=0) - nearest)
    return _Spectrum(bins, frequency_hz[order], inverse, len(bins) - 2 * reach - 1)
