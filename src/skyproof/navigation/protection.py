"""Protection levels: bound the position error without an alarm when one satellite has a bias of any size.

By solution separation, after M. Brenner, "Integrated GPS/inertial fault detection availability", NAVIGATION 43(2),
1996, and J. Blanch et al., "Baseline advanced RAIM user algorithm and possible improvements", IEEE Trans. AES 51(1),
2015. Of one faulty satellite i, the solution without it has no bias, so

    |all - truth| <= |all - without i| + |without i - truth|

and the first term is known up to the alarm's threshold while there is no alarm, the second is Gaussian. That holds for
a bias of any size, without a search for the worst. Leading axes are free, the axis before the last is the satellite.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from skyproof.arrays import Booleans, Reals
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import FixGeometry
from skyproof.navigation.raim import count_unknowns, fit_whitened
from skyproof.records import Fix, FixStatus
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["Protection", "add_protection", "compute_noise_levels", "compute_protection_levels"]

_UNCONTROLLED = 1e-9  # a share of variance in the residual below this is rounding
_UNMOVED_M = 1e-6  # a position that a metre of bias moves by less is not touched


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
    integrity_risk: float = 1e-7,
    false_alarm_probability: float = 1e-5,
) -> Protection:
    """Compute the protection levels of the weighted fit of `misfit_m` (..., k) by `design`, and its alarm.

    Suppose that every measurement has independent Gaussian noise of its sigma, and at most one of them a bias besides,
    of any size. Then the horizontal error exceeds `horizontal_m` without an alarm with probability `integrity_risk` at
    most, given the fault; and the vertical one `vertical_m`. Who knows how rare faults are may divide by that. Several
    faults at once, as an attacker makes them, are not covered.

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
        threshold = np.fmin(
            -special.ndtri(0.5 * false_alarm_probability / np.maximum(n, 1)),
            np.sqrt(chi_square_threshold(false_alarm_probability, np.maximum(dof, 1))),
        )
        # East, north, up that one metre of each measurement's whitened error gives.
        enu = rot_enu_ecef @ covariance[..., :3, :]
        gain = np.swapaxes(enu @ np.swapaxes(np.where(used[..., None], design, 0.0), -1, -2), -1, -2)
        gain = gain / np.where(used, sigma_m, 1.0)[..., None]
        apart = gain / np.sqrt(np.where(tested, redundancy, np.nan))[..., None]  # all minus without it, one sigma
    variance = (enu[..., :3] @ np.swapaxes(rot_enu_ecef, -1, -2))[..., None, :, :]
    without = variance + apart[..., :, None] * apart[..., None, :]
    moved = used & ~tested & (np.linalg.norm(gain, axis=-1) * np.where(used, sigma_m, 1.0) > _UNMOVED_M)

    def level(axes: slice, quantile: float) -> Reals:
        def spread(matrix: Reals) -> Reals:
            return np.sqrt(_compute_largest_variance(matrix[..., axes, axes]))

        each = threshold[..., None] * np.linalg.norm(apart[..., axes], axis=-1) + quantile * spread(without)
        each = np.where(tested, each, np.where(moved, np.inf, 0.0))
        nominal = quantile * spread(variance)[..., 0]
        return np.asarray(np.where(np.isnan(nominal), np.nan, np.maximum(nominal, np.max(each, axis=-1))))

    statistic = np.where(n > 0, np.max(w, axis=-1), np.nan)
    return Protection(
        horizontal_m=level(slice(0, 2), _find_quantiles(integrity_risk)[0]),
        vertical_m=level(slice(2, 3), _find_quantiles(integrity_risk)[1]),
        statistic=statistic,
        threshold=np.asarray(threshold),
        alarm=statistic > threshold,
    )


def compute_noise_levels(covariance_m2: Reals, rot_enu_ecef: Reals, *, integrity_risk: float) -> Reals:
    """Return the levels (..., 2), horizontal and vertical, of an ECEF position with Gaussian errors, (..., 3, 3)."""
    enu_m2 = rot_enu_ecef @ covariance_m2 @ np.swapaxes(rot_enu_ecef, -1, -2)
    spreads_m = [np.sqrt(_compute_largest_variance(enu_m2[..., axes, axes])) for axes in (slice(0, 2), slice(2, 3))]
    return np.asarray(np.stack(spreads_m, axis=-1) * np.array(_find_quantiles(integrity_risk)))


def _find_quantiles(integrity_risk: float) -> tuple[float, float]:
    """Return the sigmas that errors exceed with that probability.

    For two axes by Rayleigh, for one on both sides.
    """
    return float(np.sqrt(-2.0 * np.log(integrity_risk))), float(-special.ndtri(0.5 * integrity_risk))


def add_protection(fix: Fix, geometry: FixGeometry, *, integrity_risk: float) -> Fix:
    """Add the protection levels of its epochs to a fix, by the sigmas behind its covariance.

    The level is NaN without a fix, at an alarm, and where a satellite that moves the position is not controlled by the
    others, as with no more satellites than unknowns. So no one has to ask for the alarm: the error exceeds a finite
    level with a probability of `integrity_risk` at most.

    geometry : what `fix.fix_and_geometry` gave with the fix. A fix that was emptied since then gets no level.
    """
    good = np.flatnonzero(fix.status == FixStatus.OK)
    lat_rad, lon_rad, _ = geodetic_from_ecef(fix.position_ecef_m[good])
    found = compute_protection_levels(
        geometry.design[good],
        geometry.misfit_m[good],
        geometry.sigma_m[good],
        rot_enu_ecef(lat_rad, lon_rad),
        integrity_risk=integrity_risk,
    )
    both_m = np.stack((found.horizontal_m, found.vertical_m), axis=-1)
    levels_m = np.full((len(fix.gpst), 2), np.nan)
    levels_m[good] = np.where(np.isfinite(both_m) & ~found.alarm[:, None], both_m, np.nan)
    return replace(fix, protection_m=levels_m)


def _compute_largest_variance(matrix: Reals) -> Reals:
    """Return the largest eigenvalue of symmetric matrices (..., 1, 1) or (..., 2, 2)."""
    if matrix.shape[-1] == 1:
        return matrix[..., 0, 0]
    mean = 0.5 * (matrix[..., 0, 0] + matrix[..., 1, 1])
    half = 0.5 * (matrix[..., 0, 0] - matrix[..., 1, 1])
    return np.asarray(mean + np.hypot(half, matrix[..., 0, 1]))
