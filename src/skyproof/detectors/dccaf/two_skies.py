"""Separate two skies when each satellite has two signals: find which signals belong together.

Two skies within one receiver give each satellite one signal of either. A pairing puts one of each satellite's signals
in one sky and the rest in the other. With ranges of independent Gaussian errors its likelihood is

    exp(-(T + T') / 2)

with T and T' the sums of squared normalised residuals of both skies. Two skies are reported under three conditions.
Both fit. All pairings with other fixes are together improbable beside the likeliest. The signals outside one sky fit a
second position better than by chance. Some pairings exchange signals that lie near each other, so their fixes differ by
no more than noise. They are merged: their mean, with their spread in the covariance.
"""

from typing import NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.detectors.dccaf.inverse_raim import set_states
from skyproof.detectors.dccaf.policy import POLICY
from skyproof.navigation.chance import bound_chance_p_value
from skyproof.navigation.least_squares import design_matrix
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["TwoSkies", "find_two_skies"]


class TwoSkies(NamedTuple):
    """state_m (2, 4), covariance_m2 (2, 4, 4): place and clock of each from the reference. statistic (2,), chi-square
    with `dof` degrees for a true sky. choice (n,) : which signal of each satellite is in the first. doubt : bound of
    the probability that these are not two skies, or others."""

    state_m: Reals
    covariance_m2: Reals
    statistic: Reals
    dof: int
    choice: Integers
    doubt: float


def find_two_skies(
    unit: Reals, misfit_m: Reals, sigma_m: Reals, *, window_m: float, set_probability: float, most_doubt: float
) -> TwoSkies | None:
    """Find the two skies that satellites show, or None.

    Parameters
    ----------
    unit : (n, 3) to the satellites from a place near both fixes, in any axes.
    misfit_m : (n, 2) measured minus modelled range at that place of each satellite's signals.
    sigma_m : (n,).
    window_m : range in which a signal that belongs to no sky may lie.
    set_probability : that a true sky fails its chi-square test; also that fixes of one sky are taken for two.
    most_doubt : largest `doubt`.
    """
    n = len(unit)
    if n < POLICY.least_satellites:
        return None
    choice, design = _list_pairings(misfit_m, sigma_m), design_matrix(unit)
    skies = [set_states(unit, misfit_m, sigma_m, pairing) for pairing in (choice, 1 - choice)]
    state, covariance = np.stack([pairing for pairing, _ in skies], axis=1), skies[0][1]
    chosen = np.stack([misfit_m[np.arange(n), pairing] for pairing in (choice, 1 - choice)], axis=1)
    statistic = np.sum(((chosen - state @ design.T) / sigma_m) ** 2, axis=-1)
    dof, cost = n - 4, statistic.sum(axis=1)
    best, fitting = int(np.argmin(cost)), statistic <= chi_square_threshold(set_probability, dof)
    if not fitting[best].all():
        return None
    weight = np.exp(-0.5 * (cost - cost[best]))
    same = _is_same_pair(state, state[best], covariance, set_probability)
    by_chance = float(bound_chance_p_value(sigma_m, window_m=window_m, largest_statistic=statistic[best].max()))
    # Whatever set fits, what it leaves over was tried.
    doubt = float(weight[~same].sum() / weight.sum() + fitting.sum() * by_chance)
    if doubt > most_doubt:
        return None
    share = weight * same / weight[same].sum()
    mean = np.einsum("p,pki->ki", share, state)
    off = state - mean
    spread = covariance + np.einsum("p,pki,pkj->kij", share, off, off)
    return TwoSkies(mean, spread, statistic[best], dof, choice[best], doubt)


def _list_pairings(misfit_m: Reals, sigma_m: Reals) -> Integers:
    """List which signal of each satellite is in the first sky (2^(n - 1), n).

    The satellite whose signals are farthest apart has always its first there, or each pairing would occur twice.
    """
    n = len(sigma_m)
    fixed = int(np.argmax(np.abs(misfit_m[:, 1] - misfit_m[:, 0]) / sigma_m))
    bits = (np.arange(2 ** (n - 1))[:, None] >> np.arange(n - 1)) & 1
    return np.insert(bits, fixed, 0, axis=1)


def _is_same_pair(state_m: Reals, of_m: Reals, covariance_m2: Reals, probability: float) -> Booleans:
    """Find pairs of fixes (m, 2, 4) that differ from one pair (2, 4) by no more than independent noise."""
    off = state_m - of_m
    distance = np.einsum("mki,ij,mkj->mk", off, np.linalg.inv(2.0 * covariance_m2), off)
    return np.asarray(np.all(chi_square_survival(distance, 4) > probability, axis=1))
