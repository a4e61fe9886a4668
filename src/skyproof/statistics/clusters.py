"""Count how many different values noisy numbers have, with the probability of finding too many.

Values of one cluster share a mean. If the numbers come from C clusters, consider the least sum of squares over all ways
to divide them into C. It is at most that of the true way, which is chi-square with K - C degrees. So the smallest C
whose least sum passes at a probability p is larger than the true number with probability p at most. On a line the best
parts are intervals of the sorted values (W. D. Fisher, "On grouping for maximum homogeneity", JASA 53, 1958), found by
dynamic programming: the answer is exact, not that of a search.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Indices, Reals
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["LineClusters", "divide_line"]


class LineClusters(NamedTuple):
    """number : (...) of clusters. label : (..., K) from 0 on in order of the values. p_value : (...) of this number;
    the next smaller one has less than was asked for. Conservative, for the best parting is not the true one."""

    number: Indices
    label: Indices
    p_value: Reals


def divide_line(values: Reals, sigma: ArrayLike, false_alarm_probability: float) -> LineClusters:
    """Divide values (..., K) of standard deviations `sigma` (broadcasts) into as few clusters as pass.

    false_alarm_probability : of more clusters than there are. K^3 operations each.
    """
    k = values.shape[-1]
    order = np.argsort(values, axis=-1)
    x = np.take_along_axis(values, order, -1)
    x = x - x.mean(axis=-1, keepdims=True)  # keeps digits
    weight = np.take_along_axis(np.broadcast_to(1.0 / np.asarray(sigma, float) ** 2, values.shape), order, -1)
    cost = _interval_squares(x, weight)
    least, begins = cost[..., 0, :], [np.zeros(values.shape, np.intp)]  # of the first j + 1 values in c clusters
    squares = [least[..., -1]]
    for _ in range(1, k):
        before = np.concatenate([np.full((*values.shape[:-1], 1), np.inf), least[..., :-1]], axis=-1)
        total = before[..., :, None] + cost  # the last cluster begins at i and ends at j
        begins.append(np.argmin(total, axis=-2))
        least = np.min(total, axis=-2)
        squares.append(least[..., -1])
    dof = k - 1 - np.arange(k)
    p_values = np.where(dof > 0, chi_square_survival(np.stack(squares, axis=-1), np.maximum(dof, 1)), 1.0)
    count = np.argmax(p_values >= false_alarm_probability, axis=-1) + 1
    label = _label_values(np.stack(begins, axis=-2), count, k)
    unsorted = np.empty_like(label)
    np.put_along_axis(unsorted, order, label, -1)
    return LineClusters(count, unsorted, np.take_along_axis(p_values, count[..., None] - 1, -1)[..., 0])


def _interval_squares(x: Reals, weight: Reals) -> Reals:
    """Sum the squares (..., i, j) of the values i to j around their mean; infinite for i > j."""
    sums = [np.cumsum(w, axis=-1) for w in (weight, weight * x, weight * x**2)]
    within = [
        s[..., None, :] - (s - w)[..., :, None] for s, w in zip(sums, (weight, weight * x, weight * x**2), strict=True)
    ]
    upper = np.triu(np.ones((x.shape[-1], x.shape[-1]), bool))
    with np.errstate(invalid="ignore", divide="ignore"):
        squares = within[2] - within[1] ** 2 / within[0]
    return np.where(upper, np.maximum(squares, 0.0), np.inf)


def _label_values(begins: Indices, count: Indices, k: int) -> Indices:
    """Label the sorted values (..., K), from where each last cluster begins, (..., c, j)."""
    label = np.zeros((*count.shape, k), np.intp)
    end = np.full(count.shape, k - 1)
    for c in range(k - 1, 0, -1):
        begin = np.take_along_axis(begins[..., c, :], np.maximum(end, 0)[..., None], -1)[..., 0]
        used = c < count
        label += (np.arange(k) >= begin[..., None]) & used[..., None]
        end = np.where(used, begin - 1, end)
    return label
