"""Inverse RAIM: find all choices of one signal per satellite that fit one position and clock.

Integrity monitoring asks whether a set is consistent; with two or three delays for each satellite the question is which
sets are. More than one means more than one sky: an attack, or several echoes that agree. After Ahmed, Khanafseh,
Pervan, "GNSS Spoofing Detection and Exclusion by Decomposition of Complex Cross Ambiguity Function (DCCAF) with INS
Aiding", ION, with these corrections:

- Not "only two sets are consistent". Four satellites always fit; and where true and false delays agree to the noise,
  satellites can be exchanged: with six satellites, an offset of 100 m and a sigma of 3 m, five mixed sets pass.
  Sets are therefore gathered in clusters of one position and clock, and clusters are counted.
- The full false set needs every satellite to be false. With fewer, at least five, `find_second_subset` looks among the
  signals that the passing set leaves over.
- An attack on time alone gives one position and two clocks: `timing_only`.

Linear about a place near all fixes (what that neglects in a range is the offset squared over twice the distance: 0.2 mm
at 100 m, 2 m at 10 km); skies far apart are for `navigation.sets`. Sets are visited by partial sums of parity vectors,
or, to the same result, by branch and bound: with the parity matrix trapezoidal, each satellite from the last four on
finishes one coordinate, and a branch beyond the threshold ends.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Integers, Reals
from skyproof.compiled import compiled
from skyproof.navigation.least_squares import design_matrix, invert_spd
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["PassingSets", "find_passing_sets", "find_second_subset", "parity_matrix", "set_states"]

_UNKNOWNS = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class PassingSets:
    """choice (m, n): which signal of each satellite; statistic (m,), chi-square with `dof` degrees for a true set, the
    smallest first; threshold; tried: how many sets there are."""

    choice: Integers
    statistic: Reals
    dof: int
    threshold: float
    tried: int


def parity_matrix(unit: ArrayLike, sigma_m: ArrayLike = 1.0) -> Reals:
    """Compute S (n - 4, n): orthonormal rows with S H = 0, divided by the sigmas; row i is zero left of column i.

    unit : (n, 3) vectors to the satellites; sigma_m : (n,). |S z|^2 is chi-square with n - 4 degrees for ranges z of
    one position and clock. Raises ValueError for fewer than five satellites.
    """
    design = design_matrix(np.asarray(unit, np.float64))
    n = len(design)
    if n <= _UNKNOWNS:
        raise ValueError(f"{n} satellites: four always fit one position and clock, expected five or more")
    sigma = np.broadcast_to(np.asarray(sigma_m, np.float64), (n,))
    return np.asarray(_trapezoid(design / sigma[:, None]) / sigma)


@compiled
def _trapezoid(design):  # type: ignore[no-untyped-def]
    """Compute orthonormal rows beside the columns of `design`, row i zero left of column i, by two QR decompositions.

    It is compiled: single calls from Python would take longer than the search that they serve.
    """
    n = design.shape[0]
    wide = np.zeros((n, n + _UNKNOWNS))
    wide[:, :_UNKNOWNS] = design
    for i in range(n):
        wide[i, _UNKNOWNS + i] = 1.0
    full = np.linalg.qr(wide)[0]
    return np.linalg.qr(np.ascontiguousarray(full[:, _UNKNOWNS:].T))[1]


@compiled
def _search_all(terms, counts, limit, choice, statistic):  # type: ignore[no-untyped-def]
    """Search all sets by partial sums, the last satellite innermost; return how many pass.

    Writes as many as the arrays hold.
    """
    n, _, r = terms.shape
    sums = np.zeros((n, r))
    at = np.zeros(n, np.int64)
    last_squares = np.zeros(counts[n - 1])
    for c in range(counts[n - 1]):
        for i in range(r):
            last_squares[c] += terms[n - 1, c, i] ** 2
    found, level = 0, 0
    while level >= 0:
        if level < n - 1:
            if at[level] == counts[level]:
                at[level] = 0
                level -= 1
                if level >= 0:
                    at[level] += 1
                continue
            for i in range(r):
                sums[level + 1, i] = sums[level, i] + terms[level, at[level], i]
            level += 1
            continue
        size = 0.0
        for i in range(r):
            size += sums[level, i] ** 2
        for c in range(counts[level]):
            along = 0.0
            for i in range(r):
                along += sums[level, i] * terms[level, c, i]
            total = size + 2.0 * along + last_squares[c]
            if total <= limit:
                if found < len(statistic):
                    choice[found, :level] = at[:level]
                    choice[found, level] = c
                    statistic[found] = total
                found += 1
        level -= 1
        if level >= 0:
            at[level] += 1
    return found


@compiled
def _search_pruned(terms, counts, limit, choice, statistic):  # type: ignore[no-untyped-def]
    """Search as `_search_all`, from the last satellite to the first.

    Row i is final once satellites i and later are set.
    """
    n, _, r = terms.shape
    sums = np.zeros((n + 1, r))  # sums[k]: of satellites k and later
    total = np.zeros(n + 1)
    at = np.zeros(n, np.int64)
    found, k = 0, n - 1
    while k < n:
        if at[k] == counts[k]:
            at[k] = 0
            k += 1
            if k < n:
                at[k] += 1
            continue
        for i in range(min(k + 1, r)):
            sums[k, i] = sums[k + 1, i] + terms[k, at[k], i]
        total[k] = total[k + 1]
        if k < r:
            total[k] += sums[k, k] ** 2
        if total[k] > limit:
            at[k] += 1
        elif k > 0:
            k -= 1
        else:
            if found < len(statistic):
                choice[found] = at
                statistic[found] = total[0]
            found += 1
            at[0] += 1
    return found


def find_passing_sets(
    unit: ArrayLike,
    misfit_m: ArrayLike,
    sigma_m: ArrayLike = 1.0,
    *,
    false_alarm_probability: float = 1e-3,
    exhaustive: bool = False,
) -> PassingSets:
    """Find all choices of one signal per satellite that pass a chi-square test, the smallest statistic first.

    Parameters
    ----------
    unit : (n, 3) to the satellites from a place near all fixes, in any axes.
    misfit_m : (n, c) measured minus modelled range at that place of each satellite's signals, in order; NaN where a
        satellite has fewer than c.
    sigma_m : (n,) or one for all.
    false_alarm_probability : that a true set fails.
    exhaustive : visit every set; the same result.

    Raises
    ------
    ValueError : fewer than five satellites, or one without a signal.
    """
    misfit = np.atleast_2d(np.asarray(misfit_m, np.float64))
    parity = parity_matrix(unit, sigma_m)
    counts = np.isfinite(misfit).sum(axis=1)
    if not counts.all():
        raise ValueError("a satellite has no signal; leave it out")
    terms = parity.T[:, None, :] * np.nan_to_num(misfit)[:, :, None]
    n = len(counts)
    limit = float(chi_square_threshold(false_alarm_probability, n - _UNKNOWNS))
    visit = _search_all if exhaustive else _search_pruned
    room = 1024
    while True:
        choice, statistic = np.empty((room, n), np.int64), np.empty(room)
        found = visit(terms, counts, limit, choice, statistic)
        if found <= room:
            break
        room = found
    order = np.argsort(statistic[:found], kind="stable")
    return PassingSets(
        choice=choice[order],
        statistic=statistic[order],
        dof=n - _UNKNOWNS,
        threshold=limit,
        tried=int(np.prod(counts.astype(object))),
    )


def set_states(unit: ArrayLike, misfit_m: ArrayLike, sigma_m: ArrayLike, choice: Integers) -> tuple[Reals, Reals]:
    """Place and clock (m, 4) of each set from the reference, in the axes of `unit`, and their covariance (4, 4)."""
    design = design_matrix(np.asarray(unit, np.float64))
    n = len(design)
    weight = 1.0 / np.broadcast_to(np.asarray(sigma_m, np.float64), (n,)) ** 2
    covariance = invert_spd(design.T @ (weight[:, None] * design))
    chosen = np.atleast_2d(np.asarray(misfit_m, np.float64))[np.arange(n), choice]
    return np.asarray((chosen * weight) @ design @ covariance), covariance


def find_second_subset(
    unit: ArrayLike,
    misfit_m: ArrayLike,
    sigma_m: ArrayLike,
    choice: Integers,
    *,
    false_alarm_probability: float = 1e-3,
) -> tuple[Integers, PassingSets] | None:
    """Find the largest set of satellites, at least five, that fit one position with signals not in `choice` (n,).

    Returns the satellites and the passing sets among their other signals, or None. The sets' `choice` counts these
    other signals in order. Of several subsets of one size the one with the smallest statistic is taken. Small subsets
    among many pass by chance (`navigation.chance`): with five satellites, one in about threshold/spread.
    """
    units, misfit = np.asarray(unit, np.float64), np.array(np.atleast_2d(misfit_m), np.float64)
    sigma = np.broadcast_to(np.asarray(sigma_m, np.float64), (len(misfit),))
    misfit[np.arange(len(misfit)), choice] = np.nan
    other_signals = np.take_along_axis(misfit, np.argsort(np.isnan(misfit), axis=1, kind="stable"), axis=1)
    able = np.flatnonzero(np.isfinite(other_signals[:, 0]))
    for size in range(able.size, _UNKNOWNS, -1):
        best: tuple[Integers, PassingSets] | None = None
        for rows in combinations(able, size):
            some = np.array(rows)
            sets = find_passing_sets(
                units[some], other_signals[some], sigma[some], false_alarm_probability=false_alarm_probability
            )
            if sets.statistic.size and (best is None or sets.statistic[0] < best[1].statistic[0]):
                best = some, sets
        if best is not None:
            return best
    return None
