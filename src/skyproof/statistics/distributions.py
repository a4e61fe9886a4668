"""Tails and thresholds of the distributions that tests use, from `scipy.special`, accurate far into the tail.

All functions broadcast. Probabilities are upper tails unless a name says otherwise. Relations between the functions
are those of the NIST Digital Library of Mathematical Functions, sections 8.17 and 8.11.
"""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals

__all__ = [
    "binomial_survival",
    "binomial_threshold",
    "binomial_two_sided",
    "chi_square_survival",
    "chi_square_threshold",
    "f_survival",
    "f_threshold",
    "noncentral_chi_square_survival",
    "noncentral_chi_square_tail",
    "noncentral_f_survival",
    "noncentrality_for_power",
    "normal_two_sided",
]


def chi_square_survival(statistic: ArrayLike, dof: ArrayLike) -> Reals:
    """Return P(X > statistic) for X chi-square with `dof` degrees of freedom."""
    return np.asarray(special.chdtrc(dof, np.asarray(statistic, float)), float)


def chi_square_threshold(probability: ArrayLike, dof: ArrayLike) -> Reals:
    """Return the value that chi-square with `dof` degrees exceeds with `probability`."""
    return np.asarray(special.chdtri(dof, np.asarray(probability, float)), float)


def noncentrality_for_power(threshold: ArrayLike, dof: ArrayLike, *, power: float) -> Reals:
    """Return the noncentrality at which noncentral chi-square exceeds `threshold` with probability `power`."""
    return np.asarray(special.chndtrinc(np.asarray(threshold, float), dof, 1.0 - power), float)


def noncentral_chi_square_survival(statistic: ArrayLike, dof: ArrayLike, noncentrality: ArrayLike) -> Reals:
    """Return P(X > statistic) for X non-central chi-square.

    The absolute accuracy is 1e-10, enough for a power.
    """
    return np.asarray(1.0 - special.chndtr(np.asarray(statistic, float), dof, noncentrality), float)


def noncentral_chi_square_tail(statistic: float, dof: float, noncentrality: float) -> float:
    """Return P(X > statistic) for X non-central chi-square, accurate far into the tail.

    The relative accuracy is 1e-10 down to 1e-290, as p-values need it.

    It is a mixture of central ones whose degrees grow by two, with Poisson weights (Johnson, Kotz and Balakrishnan,
    Continuous Univariate Distributions 2, section 29.3). All terms are positive, so no digits cancel.
    """
    mean = 0.5 * noncentrality
    reach = 40.0 * math.sqrt(mean) + 800.0  # weights beyond are below 1e-300
    k = np.arange(math.floor(max(mean - reach, 0.0)), math.ceil(mean + reach) + 1.0)
    log_weight = special.xlogy(k, mean) - mean - special.gammaln(k + 1.0)
    return float(np.exp(log_weight) @ special.gammaincc(0.5 * dof + k, 0.5 * statistic))


def normal_two_sided(z: ArrayLike) -> Reals:
    """Return P(|X| > |z|) for X standard normal."""
    return np.asarray(2.0 * special.ndtr(-np.abs(np.asarray(z, float))), float)


def f_survival(statistic: ArrayLike, dof_num: ArrayLike, dof_den: ArrayLike) -> Reals:
    """Return P(X > statistic) for X ~ F with (dof_num, dof_den) degrees of freedom; `dof_den` may be infinite.

    With infinitely many degrees the denominator is known, and `dof_num` times the statistic is chi-square.
    """
    x, d1, d2 = np.asarray(statistic, float), np.asarray(dof_num, float), np.asarray(dof_den, float)
    finite = special.fdtrc(d1, np.where(np.isinf(d2), 1.0, d2), x)
    return np.asarray(np.where(np.isinf(d2), special.chdtrc(d1, d1 * x), finite), float)


def f_threshold(probability: ArrayLike, dof_num: ArrayLike, dof_den: ArrayLike) -> Reals:
    """Return the value that F with (dof_num, dof_den) degrees exceeds with `probability`.

    `dof_den` may be infinite.

    d2/(d2 + d1 X) is Beta(d2/2, d1/2), so the upper tail of F is a lower tail of Beta and keeps its digits.
    """
    p, d1, d2 = np.asarray(probability, float), np.asarray(dof_num, float), np.asarray(dof_den, float)
    finite = np.where(np.isinf(d2), 1.0, d2)
    share = special.betaincinv(finite / 2, d1 / 2, p)
    with np.errstate(divide="ignore"):
        threshold = finite * (1.0 - share) / (d1 * share)
    return np.asarray(np.where(np.isinf(d2), special.chdtri(d1, p) / d1, threshold), float)


def noncentral_f_survival(
    statistic: ArrayLike, dof_num: ArrayLike, dof_den: ArrayLike, noncentrality: ArrayLike
) -> Reals:
    """Return P(X > statistic) for X non-central F; absolute accuracy 1e-10, enough for a power."""
    cumulative = special.ncfdtr(dof_num, dof_den, noncentrality, np.asarray(statistic, float))
    return np.asarray(1.0 - cumulative, float)


def binomial_survival(count: ArrayLike, trials: ArrayLike, probability: ArrayLike) -> Reals:
    """Return P(X >= count) for X binomial: the chance of at least that many."""
    k, n = np.asarray(count, float), np.asarray(trials, float)
    inside = special.betainc(np.maximum(k, 1.0), np.maximum(n - k + 1.0, 1.0), probability)
    return np.asarray(np.where(k <= 0, 1.0, np.where(k > n, 0.0, inside)), float)


def binomial_threshold(false_alarm_probability: float, trials: int, probability: float) -> tuple[int, float]:
    """Return the smallest count whose chance is at most `false_alarm_probability`, and that chance.

    That chance is the attained rate.

    The count is `trials` + 1, attained 0, if not even all of them would be rare enough.
    """
    counts = np.arange(trials + 2)
    chances = binomial_survival(counts, trials, probability)
    count = int(np.argmax(chances <= false_alarm_probability))
    return count, float(chances[count])


def binomial_two_sided(count: int, trials: int, probability: float) -> float:
    """Return the chance of a count at least as far out as this on its side, doubled.

    It is small if there are too many or too few.
    """
    upper = float(binomial_survival(count, trials, probability))
    lower = 1.0 - float(binomial_survival(count + 1, trials, probability))
    return min(1.0, 2.0 * min(upper, lower))
