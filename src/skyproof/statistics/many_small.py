"""Test if more of several p-values are small than chance explains, however many and however small."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from skyproof.arrays import Reals
from skyproof.statistics.distributions import binomial_survival

__all__ = ["ManySmall", "many_small", "many_small_chance"]


class ManySmall(NamedTuple):
    """p_value; how_many : of the smallest are the least likely together; chance : that so many are so small."""

    p_value: float
    how_many: int
    chance: float


def many_small(p_values: Sequence[float] | Reals, *, least: int = 1, most: float = 1.0) -> ManySmall:
    """Test that p-values (n,) are independent and uniform, against "`least` or more are small": `most` or less.

    The statistic is the smallest, over k, of the binomial probability that k or more of n are at or below the k-th
    smallest (R. H. Berk, D. H. Jones, Z. Wahrscheinlichkeitstheorie 47, 1979, doi 10.1007/BF00533250). Its law is exact
    for uniform p-values (`many_small_chance`); p-values that are larger than uniform, as where many are 1, make
    alarms rarer.
    """
    ordered = np.sort(np.asarray(p_values, float))
    n = ordered.size
    counts = np.arange(least, n + 1)
    if counts.size == 0:
        return ManySmall(1.0, 0, 1.0)
    small = ordered[least - 1 :] <= most
    if not small.any():
        return ManySmall(1.0, 0, 1.0)
    chances = np.where(small, binomial_survival(counts, n, ordered[least - 1 :]), 1.0)
    best = int(np.argmin(chances))
    return ManySmall(many_small_chance(float(chances[best]), n, least, most), int(counts[best]), float(chances[best]))


def many_small_chance(chance: float, n: int, least: int = 1, most: float = 1.0) -> float:
    """Return the chance of a smallest binomial probability of at most `chance`, for n uniform p-values.

    It is the chance of this event for some k from `least` on: the k-th smallest of n values is at most `most`. Also, k
    or more values are so small with a binomial probability of at most `chance`.

    The sum walks over the cuts c_k; at each, k or more must not lie below. All terms are positive, so the tail keeps
    its digits.
    """
    if chance >= 1.0:
        return 1.0
    counts = np.arange(least, n + 1)
    cuts = np.minimum(special.betaincinv(counts, n - counts + 1.0, chance), most)
    below, crossed, before = np.zeros(n + 1), 0.0, 0.0
    below[0] = 1.0
    for count, cut in zip(counts, cuts, strict=True):
        below = _update_counts(below, n, (cut - before) / max(1.0 - before, 1e-300))
        crossed += float(below[count:].sum())
        below[count:] = 0.0
        before = cut
    return min(1.0, crossed)


def _update_counts(below: Reals, n: int, share: float) -> Reals:
    """Update the probabilities of how many of n lie below, if each of the others falls below with `share`."""
    moved = np.zeros(n + 1)
    for already in np.flatnonzero(below):
        above = n - int(already)
        new = np.arange(above + 1)
        log_ways = special.gammaln(above + 1.0) - special.gammaln(new + 1.0) - special.gammaln(above - new + 1.0)
        chance = np.exp(log_ways + special.xlogy(new, share) + special.xlog1py(above - new, -share))
        moved[already:] += below[already] * chance
    return moved
