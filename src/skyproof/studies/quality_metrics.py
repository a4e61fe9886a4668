"""Signal quality metrics of scalar tracking: is the correlation of one signal distorted?

Taps at -d, 0 and +d chip, in units of their noise in one component: A R(offset) + n, A = sqrt(2 T K C/N0) as in
`correlator_laws.prompt_amplitude`, noise of two taps correlated as R of their distance. Some authors take the taps as
independent, or forget the factor 2; the thresholds are then wrong by factors.

For a metric Z = c^T I / I_P, I the in-phase parts, mean mu of c^T R:
    var Z = (c^T C c - 2 mu c^T C e_P + mu^2) / A^2                                          (first order)
    Prob(Z <= z) = Phi(A (z - mu) / sqrt(c^T C c - 2 z c^T C e_P + z^2))                     (exact while I_P > 0)
The tails are heavier than normal, so thresholds come from the exact law. Where A is not known but by the prompt itself,
c^T I - mu I_P is exactly normal whatever A is (E. C. Fieller, "Some problems in interval estimation", Journal of the
Royal Statistical Society B 16(2), 1954): `ratio_deviate`.

Metrics: R. E. Phelts, "Multicorrelator techniques for robust mitigation of threats to GPS signal quality", Stanford,
2001 (delta, ratio); X. Zhang, H. Li, C. Yang and M. Lu, IET Radar, Sonar & Navigation, 2020, doi
10.1049/iet-rsn.2020.0021, sections 1 and 4, list those that spoofing detection uses. A loop that holds early and late
equal holds delta of the same pair at zero: use another pair, or sums shorter than the loop's time. An attack whose
signals no longer overlap the true ones distorts nothing, and echoes distort as well.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.correlators.correlator_laws import triangle
from skyproof.statistics.distributions import (
    chi_square_survival,
    chi_square_threshold,
    noncentral_chi_square_survival,
)

__all__ = [
    "RatioLaw",
    "alarm_starts",
    "code_jitter_chips",
    "delta_law",
    "delta_metric",
    "doppler_law",
    "doppler_metric",
    "doppler_slope",
    "magnitude_difference",
    "moving_variance",
    "moving_variance_p_value",
    "moving_variance_power",
    "moving_variance_threshold",
    "ratio_cumulative",
    "ratio_deviate",
    "ratio_law",
    "ratio_metric",
    "ratio_p_value",
    "ratio_threshold",
    "tap_covariance",
]


# Metrics --------------------------------------------------------------------------------------------------------------


def delta_metric(early: ArrayLike, prompt: ArrayLike, late: ArrayLike) -> Reals:
    """Compute (I_E - I_L) / (2 I_P), zero in lock."""
    e, p, lt = (np.real(x) for x in (early, prompt, late))
    return np.asarray((e - lt) / (2.0 * p), float)


def ratio_metric(early: ArrayLike, prompt: ArrayLike, late: ArrayLike) -> Reals:
    """Compute (I_E + I_L) / (2 I_P), 1 - d in lock without a band limit."""
    e, p, lt = (np.real(x) for x in (early, prompt, late))
    return np.asarray((e + lt) / (2.0 * p), float)


def magnitude_difference(early: ArrayLike, prompt: ArrayLike, late: ArrayLike) -> Reals:
    """Compute (|E| - |L|) / (2 |P|), zero in lock; it also sees a signal in quadrature."""
    return np.asarray((np.abs(early) - np.abs(late)) / (2.0 * np.abs(prompt)), float)


def doppler_metric(slow: ArrayLike, prompt: ArrayLike, fast: ArrayLike, *, magnitudes: bool = True) -> Reals:
    """Compute (S - F) / (2 P) of correlators at -df and +df from the carrier; zero in lock.

    The phase of all three has to be that of the middle of the integration, or the in-phase parts mean something else.
    """
    part = np.abs if magnitudes else np.real
    return np.asarray((part(slow) - part(fast)) / (2.0 * part(prompt)), float)


# Their laws -----------------------------------------------------------------------------------------------------------


class RatioLaw(NamedTuple):
    """Of Z = c^T I / I_P: mean mu, c^T C c, and c^T C e_P; arrays of one shape."""

    mean: Reals
    noise: Reals
    shared: Reals

    def variance(self, amplitude: ArrayLike) -> Reals:
        """Compute the variance, to first order in 1 / amplitude."""
        a2 = np.square(np.asarray(amplitude, float))
        return np.asarray((self.noise - 2.0 * self.mean * self.shared + self.mean**2) / a2, float)


def tap_covariance(delays_chips: ArrayLike) -> Reals:
    """Compute the noise covariance (n, n) of taps at delays (n,), for variance 1 each."""
    delays = np.asarray(delays_chips, float)
    return triangle(delays[:, None] - delays[None, :])


def delta_law(spacing_chips: ArrayLike) -> RatioLaw:
    """Return the law of delta in lock: variance d / A^2 for 2 d <= 1, else (1 - R(2d)) / (2 A^2)."""
    d = np.asarray(spacing_chips, float)
    zero = np.zeros(d.shape)
    return RatioLaw(zero, 0.5 * (1.0 - triangle(2.0 * d)), zero)


def ratio_law(spacing_chips: ArrayLike, lost_chips: ArrayLike = 0.0) -> RatioLaw:
    """Return the law of ratio in lock: variance d (1 - d) / A^2 for 2 d <= 1.

    lost_chips : mean distance of the replica from the peak, below d. Early and late together stay what they are and the
    prompt loses so much, so that the mean is larger. By `code_jitter_chips` it is sqrt(2 / pi) of these, which is 0.4
    of the metric's sigma over a second of a loop of 1 Hz.
    """
    d = np.asarray(spacing_chips, float)
    mean = triangle(d) / (1.0 - np.asarray(lost_chips, float))
    return RatioLaw(np.asarray(mean), 0.5 * (1.0 + triangle(2.0 * d)), triangle(d))


def code_jitter_chips(
    bandwidth_hz: ArrayLike, spacing_chips: ArrayLike, amplitude: ArrayLike, coherent_s: ArrayLike
) -> Reals:
    """Compute one sigma of the replica of a first-order code loop.

    With gain g = 4 B T of each update the noise of one, of `delta_law`, is left with a share of g / (2 - g).
    """
    gain = 4.0 * np.asarray(bandwidth_hz, float) * np.asarray(coherent_s, float)
    return np.asarray(np.sqrt(delta_law(spacing_chips).variance(amplitude) * gain / (2.0 - gain)))


def doppler_law(offset_hz: ArrayLike, coherent_s: ArrayLike) -> RatioLaw:
    """Return the law of the slow/fast metric in lock: variance (1 - sinc(2 df T)) / (2 A^2)."""
    x = np.asarray(offset_hz, float) * np.asarray(coherent_s, float)
    zero = np.zeros(x.shape)
    return RatioLaw(zero, np.asarray(0.5 * (1.0 - np.sinc(2.0 * x))), zero)


def doppler_slope(offset_hz: ArrayLike, coherent_s: ArrayLike) -> Reals:
    """Compute the mean of the slow/fast metric per hertz above the carrier: g'(df), g(x) = sinc(x T)."""
    t = np.asarray(coherent_s, float)
    x = np.pi * np.asarray(offset_hz, float) * t
    return np.asarray(np.pi * t * (np.cos(x) / x - np.sin(x) / x**2), float)


def ratio_cumulative(value: ArrayLike, law: RatioLaw, amplitude: ArrayLike) -> Reals:
    """Compute Prob(Z <= value), exact but for the chance of a negative prompt, Q(A)."""
    z, a = np.asarray(value, float), np.asarray(amplitude, float)
    return np.asarray(special.ndtr(a * (z - law.mean) / np.sqrt(law.noise - 2.0 * z * law.shared + z**2)), float)


def ratio_p_value(value: ArrayLike, law: RatioLaw, amplitude: ArrayLike) -> Reals:
    """Compute the two-sided p-value: twice the smaller tail, uniform under the null but for Q(A)."""
    z, a = np.asarray(value, float), np.asarray(amplitude, float)
    deviate = a * (z - law.mean) / np.sqrt(law.noise - 2.0 * z * law.shared + z**2)
    return np.asarray(2.0 * special.ndtr(-np.abs(deviate)), float)


def ratio_deviate(value: ArrayLike, prompt: ArrayLike, law: RatioLaw, up_to: RatioLaw | None = None) -> Reals:
    """Compute (c^T I - mu I_P) over its noise: standard normal under the null at any amplitude.

    prompt : whose in-phase part I_P the ratio `value` was taken by, in units of the noise of one component.
    up_to : with a larger mean; of all laws from one to the other the one that makes the deviate smallest.
    """
    z, in_phase = np.asarray(value, float), np.real(prompt)
    deviates = [(z - limit_law.mean) * in_phase / np.sqrt(limit_law.variance(1.0)) for limit_law in (law, up_to or law)]
    return np.asarray(np.minimum(deviates[0], 0.0) + np.maximum(deviates[1], 0.0))


def ratio_threshold(probability: ArrayLike, law: RatioLaw, amplitude: ArrayLike) -> tuple[Reals, Reals]:
    """Limits below and above which Z lies with half of `probability` each; infinite where the law has no such tail.

    The roots of (A^2 - t^2) z^2 - 2 (A^2 mu - t^2 s) z + A^2 mu^2 - t^2 v = 0, t the normal deviate.
    """
    a2 = np.square(np.asarray(amplitude, float))
    t2 = np.square(special.ndtri(0.5 * np.asarray(probability, float)))
    lead = a2 - t2
    half = a2 * law.mean - t2 * law.shared
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(np.maximum(half**2 - lead * (a2 * law.mean**2 - t2 * law.noise), 0.0))
        low = np.where(lead > 0.0, (half - root) / lead, -np.inf)
        high = np.where(lead > 0.0, (half + root) / lead, np.inf)
    return np.asarray(low, float), np.asarray(high, float)


# Moving variance ------------------------------------------------------------------------------------------------------


def moving_variance(values: Reals, window: int) -> Reals:
    """Sample variance (divided by window - 1) of the last `window` of (..., n): shape (..., n - window + 1)."""
    # About the series' mean, so that digits are kept; products of views, so that no array of all windows is made.
    centred = values - np.nan_to_num(values).mean(axis=-1, keepdims=True)
    views = np.lib.stride_tricks.sliding_window_view(centred, window, axis=-1)
    squares = np.einsum("...w,...w->...", views, views) - np.sum(views, axis=-1) ** 2 / window
    return np.asarray(np.maximum(squares, 0.0) / (window - 1), float)


def moving_variance_p_value(variance: ArrayLike, sigma: ArrayLike, window: int) -> Reals:
    """Compute the p-value of one window of independent normal values with a known sigma."""
    statistic = (window - 1) * np.asarray(variance, float) / np.square(np.asarray(sigma, float))
    return chi_square_survival(statistic, window - 1)


def moving_variance_threshold(probability: ArrayLike, sigma: ArrayLike, window: ArrayLike) -> Reals:
    """Compute the variance that one window exceeds with `probability`."""
    dof = np.asarray(window, float) - 1.0
    return np.asarray(np.square(np.asarray(sigma, float)) * chi_square_threshold(probability, dof) / dof, float)


def moving_variance_power(
    probability: ArrayLike, sigma: ArrayLike, window: ArrayLike, squared_deviations: ArrayLike
) -> Reals:
    """Compute the power against a mean that moves within the window."""
    dof = np.asarray(window, float) - 1.0
    noncentrality = np.asarray(squared_deviations, float) / np.square(np.asarray(sigma, float))
    return noncentral_chi_square_survival(chi_square_threshold(probability, dof), dof, noncentrality)


def alarm_starts(alarm: ArrayLike) -> Booleans:
    """Find where an alarm begins in (..., n): sliding windows alarm in clusters."""
    on = np.asarray(alarm, bool)
    begins = on.copy()
    begins[..., 1:] &= ~on[..., :-1]
    return begins
