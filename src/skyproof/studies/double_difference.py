"""The paper's detectors 1a, 1b, 2a and 2b on double differences, and its rule to count them.

Source: N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, "Results on GNSS Spoofing Mitigation Using Multiple
Receivers", NAVIGATION 69(1), 2022, doi 10.33012/navi.510, with corrections, without which the false alarm rate is wrong
for more than two receivers: differences against a common receiver are whitened by the inverse root of I + 1 1^T
(equation 8 prints the root); with r = 2(R-1) of level and slope, or R-1 of the slope alone, tested, the denominator has
(N-2)(R-1) degrees (printed: r = 2 or 1, and N-2); and under H0 the carrier's level is free, not zero. `whitened=False`
and `degrees="printed"` give the printed forms.

Single difference SD of a satellite: receiver i minus receiver 1. Double difference DD: SD of a satellite minus SD of
another. H0: both SDs are false, from one antenna; then the DD is zero but for noise. So rejecting H0 speaks for
authenticity, and the false alarm probability is the chance that a pair of false signals is *not* recognised. A small
one is the safe side against wrong authentication, and costs authentic signals.

| detector | of | tests | noise variance |
|---|---|---|---|
| 1a | code | level and slope | known |
| 1b | code | level and slope | unknown |
| 2a | carrier | slope | known |
| 2b | carrier | slope | unknown |

The rule judges satellites one by one, and noise that is not white makes it authenticate false signals; `one_antenna`
and `group_choice` decide for groups and allow for that. What is here serves plots, studies and comparison.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.statistics.autoregression import ar1_fit, estimate_ar1
from skyproof.statistics.distributions import (
    f_survival,
    f_threshold,
    noncentral_chi_square_survival,
    noncentral_f_survival,
)
from skyproof.statistics.lines import fit_line

__all__ = [
    "CountingRule",
    "Degrees",
    "LineTest",
    "Tested",
    "counting_rule",
    "difference_colourer",
    "difference_test",
    "difference_whitener",
    "estimate_pooled_correlation",
    "line_power",
    "pair_tests",
    "reject_pairs",
]

Tested = Literal["line", "slope"]
"""What is zero under H0: level and slope of code, the slope of carrier."""
Degrees = Literal["all", "printed"]
"""Degrees of freedom: of all receivers, or as the paper prints them, which is right for two."""


class LineTest(NamedTuple):
    """statistic and p_value (...); F with dof_num and dof_den degrees under H0 and white noise (of correlation phi).

    With a known variance dof_den is infinite, and dof_num times the statistic chi-square.
    """

    statistic: Reals
    p_value: Reals
    dof_num: int
    dof_den: float


def difference_whitener(n: int) -> Reals:
    """Compute the (n, n) inverse root of I + 1 1^T, the covariance of n differences against one reference.

    Its eigenvalue along 1 is 1 + n and 1 elsewhere, so the inverse root is I - (1 - 1/sqrt(1+n))/n 1 1^T. The printed
    root in the paper (NAVIGATION 69(1), 2022, doi 10.33012/navi.510, equation 8) colours instead of whitening.
    """
    return np.asarray(np.eye(n) - (1.0 - (1.0 + n) ** -0.5) / n, float)


def difference_colourer(n: int) -> Reals:
    """Compute the (n, n) root of I + 1 1^T, which `difference_whitener` inverts.

    Equation 8 of the paper has it in its place.
    """
    return np.asarray(np.eye(n) + ((1.0 + n) ** 0.5 - 1.0) / n, float)


def difference_test(
    dd_m: Reals,
    *,
    tested: Tested = "line",
    sigma_m: float | None = None,
    phi: ArrayLike = 0.0,
    constant_sigma_m: float = 0.0,
    whitened: bool = True,
    degrees: Degrees = "all",
) -> LineTest:
    """Test that double differences have neither level nor slope, or no slope.

    Parameters
    ----------
    dd_m : (..., N, R-1) of one pair of satellites over N >= 3 epochs, each receiver minus the first.
    tested : "line" for code, "slope" for carrier (whose level is free).
    sigma_m : of one track's measurement at one epoch, if it is known (detectors a); None takes it from the residuals
        (detectors b). The paper's sigma^2 is that of a difference of two satellites in one receiver: twice this one's.
    phi : AR(1) coefficient of the noise, known or from `estimate_pooled_correlation` (Prais-Winsten), as (...).
    constant_sigma_m : error of a pseudorange track that stays over the window. The level's square is divided by what it
        adds to the level's variance; the law is then no longer exactly F, and the p-value errs to the safe side (high).
    whitened : False multiplies by the root of I + 1 1^T, as printed. degrees : see `Degrees`.
    """
    n, m = dd_m.shape[-2:]
    fit = ar1_fit(dd_m @ (difference_whitener(m) if whitened else difference_colourer(m)), phi)
    rss = np.sum(fit.residual**2, axis=(-1, -2))
    level, slope = np.sum(fit.level**2, axis=-1), np.sum(fit.slope**2, axis=-1)
    statistic = _statistic(level, slope, rss, fit.gain, (n, m), tested, sigma_m, constant_sigma_m, degrees)
    return _line_test(statistic, *_degrees((n, m), tested, sigma_m, degrees))


def pair_tests(
    sd_m: Reals,
    *,
    tested: Tested = "line",
    sigma_m: float | None = None,
    phi: ArrayLike = 0.0,
    constant_sigma_m: float = 0.0,
) -> LineTest:
    """Test every pair out of Q single differences at once, as `difference_test`: (..., Q, Q).

    Each single difference keeps two coefficients and a row of the Gram matrix of the residuals, from which every pair's
    statistic follows: RSS(k, l) = G_kk + G_ll - 2 G_kl. Of 7 satellites with two tracks in each of two receivers 28
    single differences make all 21 * 16 tests. An entry of a difference with itself has p-value 1.

    Parameters
    ----------
    sd_m : (..., Q, N, R-1). phi broadcasts with (...).
    """
    statistic = _pair_statistic(sd_m, tested, sigma_m, phi, constant_sigma_m)
    test = _line_test(statistic, *_degrees(sd_m.shape[-2:], tested, sigma_m, "all"))
    return test._replace(p_value=np.where(np.eye(sd_m.shape[-3], dtype=bool), 1.0, test.p_value))


def reject_pairs(
    sd_m: Reals,
    false_alarm_probability: float,
    *,
    tested: Tested = "line",
    sigma_m: float | None = None,
    phi: ArrayLike = 0.0,
    constant_sigma_m: float = 0.0,
) -> Booleans:
    """Test which pairs (..., Q, Q) `pair_tests` rejects, by the threshold alone."""
    statistic = _pair_statistic(sd_m, tested, sigma_m, phi, constant_sigma_m)
    threshold = f_threshold(false_alarm_probability, *_degrees(sd_m.shape[-2:], tested, sigma_m, "all"))
    return np.asarray(statistic > threshold)


def line_power(
    dd_m: Reals, false_alarm_probability: float, sigma_m: float, *, tested: Tested = "line", known: bool = False
) -> Reals:
    """Compute the power (...) of the test on double differences dd_m (..., N, R-1) in white noise.

    The noncentrality is the squared length of what the tested columns see of the whitened dd_m over the whitened
    variance, 2 sigma_m^2; `known` says whether the test knows sigma_m.
    """
    n, m = dd_m.shape[-2:]
    fit = fit_line(dd_m @ difference_whitener(m))
    seen = np.sum(fit.slope**2, axis=-1) + (np.sum(fit.level**2, axis=-1) if tested == "line" else 0.0)
    dof_num, dof_den = _degrees((n, m), tested, sigma_m if known else None, "all")
    threshold = f_threshold(false_alarm_probability, dof_num, dof_den)
    noncentrality = seen / (2.0 * sigma_m**2)
    if known:
        return noncentral_chi_square_survival(dof_num * threshold, dof_num, noncentrality)
    return noncentral_f_survival(threshold, dof_num, dof_den, noncentrality)


def estimate_pooled_correlation(sd_m: Reals) -> Reals:
    """Estimate the AR(1) coefficient (...) of the noise from all single differences together."""
    *lead, q, n, m = sd_m.shape
    residual = fit_line(sd_m @ difference_whitener(m)).residual
    return estimate_ar1(np.moveaxis(residual, -3, -2).reshape(*lead, n, q * m))


def _degrees(shape: tuple[int, ...], tested: Tested, sigma_m: float | None, degrees: Degrees) -> tuple[int, float]:
    """Return the degrees of freedom of the numerator and the denominator."""
    n, m = shape
    receivers = m if degrees == "all" else 1
    return (2 if tested == "line" else 1) * receivers, np.inf if sigma_m is not None else (n - 2) * receivers


def _statistic(
    level: Reals,
    slope: Reals,
    rss: Reals,
    gain: Reals,
    shape: tuple[int, ...],
    tested: Tested,
    sigma_m: float | None,
    constant_sigma_m: float,
    degrees: Degrees = "all",
) -> Reals:
    dof_num, dof_den = _degrees(shape, tested, sigma_m, degrees)
    variance = rss / dof_den if sigma_m is None else 2.0 * sigma_m**2
    if tested == "slope":
        return np.asarray(slope / dof_num / variance)
    # Whitening over receivers leaves the difference of two satellites: a constant error counts twice.
    level = level / (1.0 + 2.0 * constant_sigma_m**2 * gain**2 / variance)
    return np.asarray((level + slope) / dof_num / variance)


def _pair_statistic(
    sd_m: Reals, tested: Tested, sigma_m: float | None, phi: ArrayLike, constant_sigma_m: float
) -> Reals:
    *_, q, n, m = sd_m.shape
    fit = ar1_fit(sd_m @ difference_whitener(m), np.asarray(phi, float)[..., None])
    flat = fit.residual.reshape(*fit.residual.shape[:-2], n * m)
    same = np.eye(q, dtype=bool)
    # With a known variance nobody asks for the residuals.
    rss = np.where(same, 1.0, _square_distances(flat)) if sigma_m is None else np.ones(1)
    level = _square_distances(fit.level) if tested == "line" else np.zeros(1)
    slope = _square_distances(fit.slope)
    statistic = _statistic(level, slope, rss, fit.gain[..., None], (n, m), tested, sigma_m, constant_sigma_m)
    return np.where(same, 0.0, statistic)


def _line_test(statistic: Reals, dof_num: int, dof_den: float) -> LineTest:
    return LineTest(statistic, f_survival(statistic, dof_num, dof_den), dof_num, dof_den)


def _square_distances(vectors: Reals) -> Reals:
    """Compute |v_k - v_l|^2 (..., Q, Q) from the Gram matrix of v (..., Q, D), less the mean."""
    centred = vectors - vectors.mean(axis=-2, keepdims=True)
    gram = centred @ np.swapaxes(centred, -1, -2)
    squares = np.einsum("...kk->...k", gram)
    return np.asarray(np.maximum(squares[..., :, None] + squares[..., None, :] - 2.0 * gram, 0.0))


class CountingRule(NamedTuple):
    """removed : (..., R, S, X) measurement (receiver, satellite, track) looks false.
    usable : (..., R, S) the one track that is left, -1 if none or several are."""

    removed: Booleans
    usable: Indices


def counting_rule(rejected: Booleans, satellite: Indices, track: Indices, *, k: int = 4) -> CountingRule:
    """Apply the paper's rule, made exact: remove a measurement that agrees with k - 1 satellites or more.

    It agrees with satellite l if any double difference that contains it, with any of l's tracks, is not rejected. A
    satellite is usable in a receiver if exactly one of its tracks is left. With k = 4 false signals of three satellites
    or fewer are never removed.

    Parameters
    ----------
    rejected : (..., Q, Q) of `pair_tests`.
    satellite : (Q,) index 0..S-1 of each single difference. track : (Q, R) which track of each receiver it is made of.
    """
    n_sats, n_tracks, n_receivers = int(satellite.max()) + 1, int(track.max()) + 1, track.shape[1]
    of_sat = np.eye(n_sats)[satellite]  # (Q, S)
    other = 1.0 - of_sat @ of_sat.T
    agrees = ((~rejected * other) @ of_sat > 0.0).astype(float)  # (..., Q, S): with any track of that satellite
    removed = []
    for receiver in range(n_receivers):
        of_track = np.eye(n_sats * n_tracks)[satellite * n_tracks + track[:, receiver]]  # (Q, S * X)
        count = np.sum(of_track.T @ agrees > 0.0, axis=-1)
        removed.append((count >= k - 1).reshape(*count.shape[:-1], n_sats, n_tracks))
    gone = np.stack(removed, axis=-3)
    usable = np.where(np.sum(~gone, axis=-1) == 1, np.argmin(gone, axis=-1), -1)
    return CountingRule(gone, usable)
