"""Receiver autonomous integrity monitoring: do the measurements fit one position, and if not, which one spoils it?

After R. G. Brown, "A baseline GPS RAIM scheme and a note on the equivalence of three RAIM methods", NAVIGATION 39(3),
1992, and W. Baarda, "A testing procedure for use in geodetic networks", 1968. Leading axes are free (epochs, trials);
the last axis is the satellite; a sigma that is not finite means that a measurement is not used.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.navigation.least_squares import invert_normal
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "Exclusion",
    "GlobalTest",
    "check_residuals",
    "compute_residual_statistic",
    "count_unknowns",
    "exclude_one",
    "exclude_several",
    "fit_whitened",
    "normalise_residuals",
]

_UNKNOWNS = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class GlobalTest:
    """statistic, dof, threshold, p_value and consistent, all of shape (...).

    Without redundancy (dof < 1) threshold and p-value are NaN and `consistent` is False: nothing was shown.
    """

    statistic: Reals
    dof: Integers
    threshold: Reals
    p_value: Reals
    consistent: Booleans


@dataclass(frozen=True, eq=False, kw_only=True)
class Exclusion:
    """excluded (...) index of the measurement left out, -1 for none; and the test of the others."""

    excluded: Integers
    test: GlobalTest


def count_unknowns(design: Reals, used: Booleans) -> Integers:
    """Count the unknowns (...) of used rows of `design` (..., k, 3 + c): position, and clocks in use."""
    touched = np.any(used[..., None] & (design != 0.0), axis=-2)
    return np.asarray(3 + touched[..., 3:].sum(axis=-1))


def compute_residual_statistic(
    residual_m: Reals, sigma_m: Reals, *, unknowns: ArrayLike = _UNKNOWNS
) -> tuple[Reals, Integers]:
    """Sum of squared normalised residuals of a weighted fit, and its degrees of freedom; arguments (..., k).

    Chi-square with n - `unknowns` degrees if each measurement has independent Gaussian noise of its sigma. Residuals
    that are NaN are not counted. `unknowns` (...) is 4 for position and one clock; each further clock is one more.
    """
    used = np.isfinite(residual_m) & np.isfinite(sigma_m)
    normalised = np.where(used, residual_m, 0.0) / np.where(used, sigma_m, 1.0)
    return np.sum(normalised**2, axis=-1), used.sum(axis=-1) - np.asarray(unknowns)


def check_residuals(
    residual_m: Reals, sigma_m: Reals, *, false_alarm_probability: float, unknowns: ArrayLike = _UNKNOWNS
) -> GlobalTest:
    """Test whether residuals (..., k) of a weighted fit are as small as noise alone leaves them."""
    return _test_statistic(*compute_residual_statistic(residual_m, sigma_m, unknowns=unknowns), false_alarm_probability)


def normalise_residuals(design: Reals, misfit_m: Reals, sigma_m: Reals) -> Reals:
    """Compute residuals (..., k) of the linear fit of `misfit_m` by `design`, over their own sigma.

    Standard normal each under the model (Baarda's w). NaN where not used or where a measurement is uncontrolled: the
    others alone do not determine the position, so that its residual is always zero.
    """
    residual, redundancy, _ = fit_whitened(design, misfit_m, sigma_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(redundancy > 1e-9, residual / np.sqrt(redundancy), np.nan))


def exclude_one(design: Reals, misfit_m: Reals, sigma_m: Reals, *, false_alarm_probability: float) -> Exclusion:
    """Leave out the measurement with the largest normalised residual if the global test fails; test again.

    For faults of single measurements only: a satellite clock that jumps, a reflected signal, a bad word of data. It
    must never decide who is authentic. It believes the majority, and an attacker can be the majority: of 6 imitated
    satellites beside 5 true ones it throws out the true ones, and the rest passes easily. The detectors and the fusion
    choose between several consistent skies; they get all the sets of `sets.find_consistent_sets`, small ones too.

    Leaving out measurement i lowers the statistic by its normalised residual squared, exactly, in the linear fit.

    Parameters
    ----------
    design : (..., k, 3 + c), as `least_squares.design_matrix` makes it, of one or several clocks. A satellite that is
        alone with its clock cannot be tested and is never left out.
    misfit_m : (..., k) measured minus modelled at a converged position. sigma_m : (..., k).
    """
    residual, _, _ = fit_whitened(design, misfit_m, sigma_m)
    unknowns = count_unknowns(design, np.isfinite(residual))
    statistic, dof = compute_residual_statistic(residual, np.ones_like(residual), unknowns=unknowns)
    before = _test_statistic(statistic, dof, false_alarm_probability)
    w = normalise_residuals(design, misfit_m, sigma_m)
    size = np.where(np.isfinite(w), np.abs(w), -1.0)
    worst = np.argmax(size, axis=-1)
    reduction = np.take_along_axis(size, worst[..., None], axis=-1)[..., 0] ** 2
    possible = ~before.consistent & (dof >= 2) & (np.max(size, axis=-1) >= 0.0)
    after = _test_statistic(
        np.where(possible, np.maximum(statistic - reduction, 0.0), statistic),
        np.where(possible, dof - 1, dof),
        false_alarm_probability,
    )
    return Exclusion(excluded=np.where(possible, worst, -1), test=after)


def exclude_several(
    design: Reals, misfit_m: Reals, sigma_m: Reals, *, false_alarm_probability: float, most: int = 4
) -> tuple[Booleans, GlobalTest]:
    """Leave out one measurement after the other, by `exclude_one`, until the rest passes the global test.

    Returns which (..., k) are left out and the test of the rest. Where `most` exclusions do not cure the fit, none is
    made: what fails for another reason than a few faults is not cured by throwing data away.
    """
    excluded = np.zeros(misfit_m.shape, np.bool_)
    for _ in range(most):
        found = exclude_one(
            design, misfit_m, np.where(excluded, np.nan, sigma_m), false_alarm_probability=false_alarm_probability
        )
        excluded |= np.arange(misfit_m.shape[-1]) == found.excluded[..., None]
        if not np.any((found.excluded >= 0) & ~found.test.consistent):
            break
    return excluded & found.test.consistent[..., None], found.test


def fit_whitened(design: Reals, misfit_m: Reals, sigma_m: Reals) -> tuple[Reals, Reals, Reals]:
    """Fit `misfit_m` (..., k) linearly by `design` (..., k, 3 + c), each measurement over its sigma.

    Returns residuals over sigma, and the share of each one's variance that the fit leaves (0 to 1). Both are (..., k)
    and NaN where not used. The last value is the covariance (..., 3 + c, 3 + c).
    """
    used = np.isfinite(misfit_m) & np.isfinite(sigma_m)
    root_weight = np.where(used, 1.0 / np.where(used, sigma_m, 1.0), 0.0)
    scaled = np.where(used[..., None], design, 0.0) * root_weight[..., None]
    target = np.where(used, misfit_m, 0.0) * root_weight
    transposed = np.swapaxes(scaled, -1, -2)
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = invert_normal(transposed @ scaled)
        redundancy = 1.0 - np.sum((scaled @ covariance) * scaled, axis=-1)
        residual = target - (scaled @ (covariance @ (transposed @ target[..., None])))[..., 0]
    return np.where(used, residual, np.nan), np.where(used, redundancy, np.nan), covariance


def _test_statistic(statistic: Reals, dof: Integers, false_alarm_probability: float) -> GlobalTest:
    testable = dof >= 1
    safe_dof = np.maximum(dof, 1)
    threshold = np.where(testable, chi_square_threshold(false_alarm_probability, safe_dof), np.nan)
    p_value = np.where(testable, chi_square_survival(statistic, safe_dof), np.nan)
    return GlobalTest(
        statistic=np.asarray(statistic),
        dof=np.asarray(dof),
        threshold=threshold,
        p_value=p_value,
        consistent=testable & (statistic <= threshold),
    )
