"""Inverse RAIM as the paper has it: clusters of pseudorange sets, innovations, timing alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.detectors.dccaf.inverse_raim import PassingSets, find_passing_sets, set_states
from skyproof.navigation.least_squares import design_matrix
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["InverseRaim", "clusters", "complementary_pair", "innovations", "inverse_raim", "timing_only"]


@dataclass(frozen=True, eq=False, kw_only=True)
class InverseRaim:
    """sets : the passing ones. state_m (m, 4): place and clock from the reference. covariance_m2 (4, 4) of each.
    cluster (m,) : number of each set's cluster, 0 for that of the best set. leader (clusters,) : the set of each
    cluster with the smallest statistic. pair : two passing sets that share no signal of a satellite that has several,
    the best such pair; None if there is none. timing_only : the pair, else the first two leaders, differ in the clock
    alone."""

    sets: PassingSets
    state_m: Reals
    covariance_m2: Reals
    cluster: Integers
    leader: Integers
    pair: tuple[int, int] | None
    timing_only: bool


def clusters(state_m: ArrayLike, covariance_m2: ArrayLike, *, probability: float = 1e-3) -> tuple[Integers, Integers]:
    """Cluster fixes (m, 4), the best first, by place and clock: cluster of each (m,), and its first fix.

    A fix joins the first cluster whose leader it does not differ from: two independent fixes of one place differ by
    more with `probability` (sets that share signals differ by less).
    """
    state = np.asarray(state_m, np.float64)
    inverse = np.linalg.inv(2.0 * np.asarray(covariance_m2, np.float64))
    limit = float(chi_square_threshold(probability, state.shape[-1]))
    cluster = np.full(len(state), -1)
    leaders: list[int] = []
    while np.any(cluster < 0):
        leader = int(np.argmax(cluster < 0))
        apart = state - state[leader]
        near = (cluster < 0) & (np.einsum("mi,ij,mj->m", apart, inverse, apart) <= limit)
        cluster[near] = len(leaders)
        leaders.append(leader)
    return cluster, np.array(leaders, np.int64)


def complementary_pair(choice: Integers, several: Booleans) -> tuple[int, int] | None:
    """Find the first pair of sets (m, n), best first, that differ in every satellite with `several` (n,)."""
    if not several.any():
        return None
    choices = choice[:, several]
    for first in range(len(choices)):
        other = np.flatnonzero(np.all(choices[first + 1 :] != choices[first], axis=1))
        if other.size:
            return first, first + 1 + int(other[0])
    return None


def timing_only(one_m: Reals, other_m: Reals, covariance_m2: Reals, *, probability: float = 1e-3) -> bool:
    """Test whether two fixes (4,) differ in the clock and not in the place.

    Both tests by the covariance (4, 4) of each: a true difference of place passes for none with the tests' power only.
    """
    apart = np.asarray(one_m) - np.asarray(other_m)
    twice = 2.0 * np.asarray(covariance_m2)
    place = float(apart[:3] @ np.linalg.solve(twice[:3, :3], apart[:3]))
    every = float(apart @ np.linalg.solve(twice, apart))
    return bool(place <= chi_square_threshold(probability, 3) and every - place > chi_square_threshold(probability, 1))


def inverse_raim(
    unit: ArrayLike, misfit_m: ArrayLike, sigma_m: ArrayLike = 1.0, *, false_alarm_probability: float = 1e-3
) -> InverseRaim:
    """Find all passing sets, their fixes and clusters; arguments as for `passing_sets`."""
    misfit = np.atleast_2d(np.asarray(misfit_m, np.float64))
    sets = find_passing_sets(unit, misfit, sigma_m, false_alarm_probability=false_alarm_probability)
    state, covariance = set_states(unit, misfit, sigma_m, sets.choice)
    cluster, leader = clusters(state, covariance, probability=false_alarm_probability)
    pair = complementary_pair(sets.choice, np.isfinite(misfit).sum(axis=1) > 1)
    two = pair if pair is not None else (tuple(leader[:2]) if len(leader) > 1 else None)
    only_time = two is not None and timing_only(
        state[two[0]], state[two[1]], covariance, probability=false_alarm_probability
    )
    return InverseRaim(
        sets=sets,
        state_m=state,
        covariance_m2=covariance,
        cluster=cluster,
        leader=leader,
        pair=pair,
        timing_only=only_time,
    )


def innovations(unit: ArrayLike, misfit_m: ArrayLike, sigma_m: ArrayLike, choice: Integers) -> Reals:
    """Compute each signal (n, c) against the fix of the set `choice` (n,), over its sigma.

    Outside the set, signals of that sky are standard normal; the set's own are NaN.
    """
    design = design_matrix(np.asarray(unit, np.float64))
    misfit = np.array(np.atleast_2d(misfit_m), np.float64)
    n = len(misfit)
    sigma = np.broadcast_to(np.asarray(sigma_m, np.float64), (n,))
    state, covariance = set_states(unit, misfit, sigma, choice[None, :])
    variance = sigma**2 + np.einsum("ni,ij,nj->n", design, covariance, design)
    misfit[np.arange(n), choice] = np.nan
    return np.asarray((misfit - (design @ state[0])[:, None]) / np.sqrt(variance)[:, None])
