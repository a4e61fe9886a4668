"""Protection levels: bound the position error without an alarm when one satellite has a bias of any size.

By solution separation, after M. Brenner, "Integrated GPS/inertial fault detection availability", NAVIGATION 43(2),
1996, and J. Blanch et al., "Baseline advanced RAIM user algorithm and possible improvements", IEEE Trans. AES 51(1),
2015. Of one faulty satellite i, the solution without it has no bias, so

    |all - truth| <= |all - without i| + |without i - truth|

and the first term is known up to the alarm's threshold while there is no alarm, the second is Gaussian. That holds for
a bias of any size, without a search for the worst. Leading axes are free, the axis before the last is the satellite.

Of several faulty satellites at once the same holds for each set of so many: the alarm is then that of the whole sum of
squared residuals, of which the part that a set can make is at most as large.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, islice
from math import comb

import numpy as np
from scipy import special

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import FixGeometry
from skyproof.navigation.raim import count_unknowns, fit_whitened
from skyproof.records import Fix, FixStatus
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["Protection", "add_protection", "compute_noise_levels", "compute_protection_levels"]

_UNCONTROLLED = 1e-9  # a share of variance in the residual below this is rounding
_UNMOVED_M = 1e-6  # a position that a metre of bias moves by less is not touched
_MOST_SETS = 2000  # of faulty satellites, a second of work for a thousand epochs; of more nothing is promised
_SETS_AT_ONCE = 64


@dataclass(frozen=True, eq=False, kw_only=True)
class Protection:
    """Arrays of shape (...).

    horizontal_m, vertical_m : the levels; infinite where a satellite that moves the position is not controlled by the
        others, NaN where there is no position.
    statistic : largest normalised residual (Baarda's w), without sign; NaN if none can be tested.
    threshold : what it exceeds with the false-alarm probability.
    alarm : whether it does.
    """

    horizontal_m: Reals
    vertical_m: Reals
    statistic: Reals
    threshold: Reals
    alarm: Booleans


def compute_protection_levels(
    design: Reals,
    misfit_m: Reals,
    sigma_m: Reals,
    rot_enu_ecef: Reals,
    *,
    faults: int = 1,
    integrity_risk: float = 1e-7,
    false_alarm_probability: float = 1e-5,
) -> Protection:
    """Compute the protection levels of the weighted fit of `misfit_m` (..., k) by `design`, and its alarm.

    Suppose that every measurement has independent Gaussian noise of its sigma, and at most `faults` of them a bias
    besides, of any size, as an attacker may choose them together. Then the horizontal error exceeds `horizontal_m`
    without an alarm with probability `integrity_risk` at most, given the faults; and the vertical one `vertical_m`. Who
    knows how rare faults are may divide by that.

    Without a fault the alarm comes with `false_alarm_probability` at most. It does exactly with one degree of
    redundancy, and nearly so where residuals are many and weakly correlated: the threshold is the lower one of two
    bounds, Bonferroni's and that of the whole sum of squares.

    Parameters
    ----------
    design : as `least_squares.design_matrix` makes it, at a converged position, in ECEF.
    sigma_m : (..., k); not finite means not used.
    rot_enu_ecef : (..., 3, 3), as `gnss.frames.rot_enu_ecef` makes it.
    """
    residual, redundancy, covariance = fit_whitened(design, misfit_m, sigma_m)
    used = np.isfinite(residual)
    tested = used & (redundancy > _UNCONTROLLED)
    n, dof = tested.sum(axis=-1), used.sum(axis=-1) - count_unknowns(design, used)
    with np.errstate(invalid="ignore", divide="ignore"):
        w = np.where(tested, np.abs(residual) / np.sqrt(redundancy), 0.0)
        of_sum = np.sqrt(chi_square_threshold(false_alarm_probability, np.maximum(dof, 1)))
        of_largest = -special.ndtri(0.5 * false_alarm_probability / np.maximum(n, 1))
        threshold = np.fmin(of_largest, of_sum) if faults == 1 else of_sum
        # East, north, up that one metre of each measurement's whitened error gives.
        enu = rot_enu_ecef @ covariance[..., :3, :]
        gain = np.swapaxes(enu @ np.swapaxes(np.where(used[..., None], design, 0.0), -1, -2), -1, -2)
        gain = gain / np.where(used, sigma_m, 1.0)[..., None]
    variance = (enu[..., :3] @ np.swapaxes(rot_enu_ecef, -1, -2))[..., None, :, :]
    moved = used & ~tested & (np.linalg.norm(gain, axis=-1) * np.where(used, sigma_m, 1.0) > _UNMOVED_M)
    uncontrolled = moved.any(axis=-1)
    quantiles = _find_quantiles(integrity_risk)
    levels_m = [_compute_spread(variance, axes)[..., 0] * q for axes, q in zip(_AXES, quantiles, strict=True)]
    if not 0 < comb(tested.shape[-1], faults) <= _MOST_SETS:
        uncontrolled = np.ones_like(uncontrolled)
    else:
        for apart, lost in _separate_sets(design, sigma_m, tested, gain, covariance, faults):
            uncontrolled = uncontrolled | lost.any(axis=-1)
            for k, (axes, q) in enumerate(zip(_AXES, quantiles, strict=True)):
                without = _compute_spread(variance + apart, axes)
                each = threshold[..., None] * _compute_spread(apart, axes) + q * without
                levels_m[k] = np.maximum(levels_m[k], np.max(each, axis=-1))
    horizontal_m, vertical_m = (
        np.where(uncontrolled & ~np.isnan(nominal_m), np.inf, nominal_m) for nominal_m in levels_m
    )
    with np.errstate(invalid="ignore"):
        total = np.sqrt(np.nansum(np.where(tested, residual, 0.0) ** 2, axis=-1))
    statistic = np.where(n > 0, np.max(w, axis=-1) if faults == 1 else total, np.nan)
    return Protection(
        horizontal_m=horizontal_m,
        vertical_m=vertical_m,
        statistic=statistic,
        threshold=np.asarray(threshold),
        alarm=statistic > threshold,
    )


_AXES = slice(0, 2), slice(2, 3)
"""Of east, north and up: what each level is of."""


def _separate_sets(
    design: Reals, sigma_m: Reals, tested: Booleans, gain: Reals, covariance: Reals, faults: int
) -> Iterator[tuple[Reals, Booleans]]:
    """Yield the covariances (..., sets, 3, 3) of the solution of all less those without each set of so many satellites,
    and which sets (..., sets) move the position while the others do not control them.

    Satellites that are not tested count as left in.

    gain : (..., k, 3) east, north and up that one unit of each whitened error gives.
    """
    used = np.isfinite(sigma_m) & np.isfinite(design).all(axis=-1)
    scaled = np.where(used[..., None], design, 0.0) / np.where(used, sigma_m, 1.0)[..., None]
    left = np.eye(design.shape[-2]) - scaled @ covariance @ np.swapaxes(scaled, -1, -2)
    both = tested[..., :, None] & tested[..., None, :]
    left = np.where(both, left, np.eye(design.shape[-2]))
    moves = np.where(tested[..., None], gain, 0.0)
    sets = combinations(range(design.shape[-2]), faults)
    while some := list(islice(sets, _SETS_AT_ONCE)):
        yield _separate_some(left, moves, np.array(some, np.intp))


def _separate_some(left: Reals, moves: Reals, some: Indices) -> tuple[Reals, Booleans]:
    """Return the covariances (..., n, 3, 3) of sets of satellites (n, f), and which (..., n) are not controlled.

    left : (..., k, k) covariance of residuals over sigma.
    """
    variances, axes = np.linalg.eigh(left[..., some[:, :, None], some[:, None, :]])
    along = np.swapaxes(moves[..., some, :], -1, -2) @ axes  # (..., n, 3, f)
    controlled = variances[..., None, :] > _UNCONTROLLED
    lost = np.any(~controlled & (np.abs(along) > _UNMOVED_M), axis=(-1, -2))
    apart = np.where(controlled, along / np.sqrt(np.where(controlled, variances[..., None, :], 1.0)), 0.0)
    return apart @ np.swapaxes(apart, -1, -2), np.asarray(lost)


def _compute_spread(matrix: Reals, axes: slice) -> Reals:
    """Return the largest sigma (...) of covariances (..., 3, 3) along some of their axes."""
    return np.sqrt(_compute_largest_variance(matrix[..., axes, axes]))


def compute_noise_levels(covariance_m2: Reals, rot_enu_ecef: Reals, *, integrity_risk: float) -> Reals:
    """Return the levels (..., 2), horizontal and vertical, of an ECEF position with Gaussian errors, (..., 3, 3)."""
    enu_m2 = rot_enu_ecef @ covariance_m2 @ np.swapaxes(rot_enu_ecef, -1, -2)
    spreads_m = [_compute_spread(enu_m2, axes) for axes in _AXES]
    return np.asarray(np.stack(spreads_m, axis=-1) * np.array(_find_quantiles(integrity_risk)))


def _find_quantiles(integrity_risk: float) -> tuple[float, float]:
    """Return the sigmas that errors exceed with that probability.

    For two axes by Rayleigh, for one on both sides.
    """
    return float(np.sqrt(-2.0 * np.log(integrity_risk))), float(-special.ndtri(0.5 * integrity_risk))


def add_protection(fix: Fix, geometry: FixGeometry, *, integrity_risk: float, faults: Integers | None = None) -> Fix:
    """Add the protection levels of its epochs to a fix, by the sigmas behind its covariance.

    The level is NaN without a fix, at an alarm, and where a satellite that moves the position is not controlled by the
    others, as with no more satellites than unknowns. So no one has to ask for the alarm: the error exceeds a finite
    level with a probability of `integrity_risk` at most.

    geometry : what `fix.fix_and_geometry` gave with the fix. A fix that was emptied since then gets no level.
    faults : (n,) how many satellites may have a bias in each epoch; one if absent.
    """
    levels_m = np.full((len(fix.gpst), 2), np.nan)
    number = np.ones(len(fix.gpst), np.intp) if faults is None else faults
    for at_most in np.unique(number):
        rows = np.flatnonzero((fix.status == FixStatus.OK) & (number == at_most))
        lat_rad, lon_rad, _ = geodetic_from_ecef(fix.position_ecef_m[rows])
        found = compute_protection_levels(
            geometry.design[rows],
            geometry.misfit_m[rows],
            geometry.sigma_m[rows],
            rot_enu_ecef(lat_rad, lon_rad),
            faults=int(at_most),
            integrity_risk=integrity_risk,
        )
        both_m = np.stack((found.horizontal_m, found.vertical_m), axis=-1)
        levels_m[rows] = np.where(np.isfinite(both_m) & ~found.alarm[:, None], both_m, np.nan)
    return replace(fix, protection_m=levels_m)


def _compute_largest_variance(matrix: Reals) -> Reals:
    """Return the largest eigenvalue of symmetric matrices (..., 1, 1) or (..., 2, 2)."""
    if matrix.shape[-1] == 1:
        return matrix[..., 0, 0]
    mean = 0.5 * (matrix[..., 0, 0] + matrix[..., 1, 1])
    half = 0.5 * (matrix[..., 0, 0] - matrix[..., 1, 1])
    return np.asarray(mean + np.hypot(half, matrix[..., 0, 1]))
