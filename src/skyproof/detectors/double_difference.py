"""Detector 1b of the paper: code double differences, unknown noise variance; and the paper's rule to count them.

Source: N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, "Results on GNSS Spoofing Mitigation Using Multiple
Receivers", NAVIGATION 69(1), 2022, doi 10.33012/navi.510, with three corrections, without which the false alarm rate is
wrong for more than two receivers: differences against a common receiver are whitened by the inverse root of I + 1 1^T
(equation 8 prints the root); the numerator has 2(R-1) degrees of freedom and the denominator (N-2)(R-1) (printed: 2 and
N-2).

Single difference SD of a satellite: receiver i minus receiver 1. Double difference DD: SD of a satellite minus SD of
another. H0: both SDs are false, from one antenna; then the DD is zero but for noise. So rejecting H0 speaks for
authenticity, and the false alarm probability is the chance that a pair of false signals is *not* recognised. A small
one is the safe side against wrong authentication, and costs authentic signals.

The rule judges satellites one by one, and noise that is not white makes it authenticate false signals; `one_antenna`
decides for groups and allows for that. What is here serves plots, studies and comparison.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyproof.statistics.autoregression import ar1_fit, estimate_ar1
from skyproof.statistics.distributions import f_survival
from skyproof.statistics.lines import difference_whitener, fit_line

__all__ = ["CountingRule", "LineTest", "counting_rule", "difference_test", "pair_tests", "pooled_correlation"]

Reals = NDArray[np.float64]


class LineTest(NamedTuple):
    """statistic and p_value (...); F with dof_num and dof_den degrees under H0 and white noise (of correlation phi)."""

    statistic: Reals
    p_value: Reals
    dof_num: int
    dof_den: int


def difference_test(dd_m: Reals, *, phi: ArrayLike = 0.0, constant_sigma_m: float = 0.0) -> LineTest:
    """Test that double differences have neither level nor slope.

    Parameters
    ----------
    dd_m : (..., N, R-1) of one pair of satellites over N >= 3 epochs, each receiver minus the first.
    phi : AR(1) coefficient of the noise, known or from `pooled_correlation` (Prais-Winsten), broadcasts with (...).
    constant_sigma_m : error of a pseudorange track that stays over the window. The level's square is divided by what it
        adds to the level's variance; the law is then no longer exactly F, and the p-value errs to the safe side (high).
    """
    n, m = dd_m.shape[-2:]
    fit = ar1_fit(dd_m @ difference_whitener(m), phi)
    rss = np.sum(fit.residual**2, axis=(-1, -2))
    level, slope = np.sum(fit.level**2, axis=-1), np.sum(fit.slope**2, axis=-1)
    return _line_test(level, slope, rss, fit.gain, (n, m), constant_sigma_m)


def pair_tests(sd_m: Reals, *, phi: ArrayLike = 0.0, constant_sigma_m: float = 0.0) -> LineTest:
    """`difference_test` of every pair out of Q single differences at once: statistic and p_value (..., Q, Q).

    Each single difference keeps two coefficients and a row of the Gram matrix of the residuals, from which every pair's
    statistic follows: RSS(k, l) = G_kk + G_ll - 2 G_kl. Of 7 satellites with two tracks in each of two receivers 28
    single differences make all 21 * 16 tests. An entry of a difference with itself has p-value 1.

    Parameters
    ----------
    sd_m : (..., Q, N, R-1). phi broadcasts with (...).
    """
    *_, q, n, m = sd_m.shape
    fit = ar1_fit(sd_m @ difference_whitener(m), np.asarray(phi, float)[..., None])
    flat = fit.residual.reshape(*fit.residual.shape[:-2], n * m)
    level, slope, rss = (_squared_distances(v) for v in (fit.level, fit.slope, flat))
    same = np.eye(q, dtype=bool)
    test = _line_test(level, slope, np.where(same, 1.0, rss), fit.gain[..., None], (n, m), constant_sigma_m)
    return test._replace(statistic=np.where(same, 0.0, test.statistic), p_value=np.where(same, 1.0, test.p_value))


def pooled_correlation(sd_m: Reals) -> Reals:
    """AR(1) coefficient (...) of the noise from all single differences (..., Q, N, R-1) of a window together."""
    *lead, q, n, m = sd_m.shape
    residual = fit_line(sd_m @ difference_whitener(m)).residual
    return estimate_ar1(np.moveaxis(residual, -3, -2).reshape(*lead, n, q * m))


def _line_test(
    level: Reals, slope: Reals, rss: Reals, gain: Reals, shape: tuple[int, int], constant_sigma_m: float
) -> LineTest:
    n, m = shape
    dof_num, dof_den = 2 * m, (n - 2) * m
    variance = rss / dof_den
    # Whitening over receivers leaves the difference of two satellites: a constant error counts twice.
    level = level / (1.0 + 2.0 * constant_sigma_m**2 * gain**2 / variance)
    statistic = (level + slope) / dof_num / variance
    return LineTest(statistic, f_survival(statistic, dof_num, dof_den), dof_num, dof_den)


def _squared_distances(vectors: Reals) -> Reals:
    """|v_k - v_l|^2 (..., Q, Q) from the Gram matrix of v (..., Q, D), less the mean so that digits are kept."""
    centred = vectors - vectors.mean(axis=-2, keepdims=True)
    gram = centred @ np.swapaxes(centred, -1, -2)
    squares = np.einsum("...kk->...k", gram)
    return np.asarray(np.maximum(squares[..., :, None] + squares[..., None, :] - 2.0 * gram, 0.0))


class CountingRule(NamedTuple):
    """removed : (..., R, S, X) measurement (receiver, satellite, track) looks false.
    usable : (..., R, S) the one track that is left, -1 if none or several are."""

    removed: NDArray[np.bool_]
    usable: NDArray[np.intp]


def counting_rule(
    rejected: NDArray[np.bool_], satellite: NDArray[np.intp], track: NDArray[np.intp], *, k: int = 4
) -> CountingRule:
    """The paper's rule, made exact: remove a measurement that agrees with k - 1 different satellites or more.

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
