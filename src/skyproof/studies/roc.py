"""Power against false alarms: from formulas, from counts, and the interval of a counted rate."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals
from skyproof.statistics.distributions import chi_square_threshold, noncentral_chi_square_survival

__all__ = ["Roc", "area_under", "chi_square_power", "count_interval", "count_roc"]


class Roc(NamedTuple):
    """Thresholds and the shares of null and alternative draws above them; arrays of one shape."""

    threshold: Reals
    false_alarm: Reals
    detection: Reals


def count_roc(null: ArrayLike, alternative: ArrayLike, false_alarm: ArrayLike) -> Roc:
    """Thresholds that the stated share of `null` (n,) exceeds, and the share of `alternative` (m,) above them."""
    below, above = np.sort(np.asarray(null, float)), np.sort(np.asarray(alternative, float))
    allowed = np.floor(np.asarray(false_alarm, float) * below.size + 1e-9).astype(int)
    threshold = below[np.clip(below.size - 1 - allowed, 0, below.size - 1)]
    share = [1.0 - np.searchsorted(draws, threshold, side="right") / draws.size for draws in (below, above)]
    return Roc(threshold, np.asarray(share[0], float), np.asarray(share[1], float))


def area_under(null: ArrayLike, alternative: ArrayLike) -> float:
    """Area under the ROC: the chance that a draw of the alternative exceeds one of the null, ties counting half."""
    below, above = np.sort(np.asarray(null, float)), np.asarray(alternative, float)
    less = np.searchsorted(below, above, side="left") + np.searchsorted(below, above, side="right")
    return float(np.mean(less) / (2.0 * below.size))


def chi_square_power(false_alarm: ArrayLike, dof: ArrayLike, noncentrality: ArrayLike) -> Reals:
    """Power of a chi-square test at a false-alarm probability; absolute accuracy 1e-10."""
    return noncentral_chi_square_survival(chi_square_threshold(false_alarm, dof), dof, noncentrality)


def count_interval(count: ArrayLike, trials: ArrayLike, confidence: float = 0.95) -> tuple[Reals, Reals]:
    """Interval of a probability after `count` in `trials` (C. J. Clopper and E. S. Pearson, Biometrika 26(4), 1934)."""
    k, n = np.asarray(count, float), np.asarray(trials, float)
    tail = 0.5 * (1.0 - confidence)
    low = special.betaincinv(np.maximum(k, 0.5), n - k + 1.0, tail)
    high = special.betaincinv(k + 1.0, np.maximum(n - k, 0.5), 1.0 - tail)
    return np.asarray(np.where(k <= 0, 0.0, low), float), np.asarray(np.where(k >= n, 1.0, high), float)
