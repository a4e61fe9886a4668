"""Gauss-Newton for position and clocks from ranges, any number of problems at once.

State: ECEF position and c times clock bias, one for each time scale that the satellites keep, all in metres.
Leading axes are problems (epochs, candidates), the axis before the last one is the satellite. Problems that cannot be
solved come out as NaN, without an exception.
"""

from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.sky import rotate_to_reception

__all__ = ["Solution", "design_matrix", "gauss_newton", "line_of_sight", "normal_inverse", "spd_inverse"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """state_m (..., 3 + c), covariance_m2 (..., 3 + c, 3 + c), residual_m (..., k) zero if unused, last_step_m (...).

    A clock without a satellite keeps its start, with a variance of 1 m^2 that means nothing.
    """

    state_m: Reals
    covariance_m2: Reals
    residual_m: Reals
    last_step_m: Reals


def spd_inverse(matrix: Reals, *, smallest_pivot: float = 1e-13) -> Reals:
    """Inverse of symmetric positive definite matrices (..., n, n), NaN where one is not, or only just.

    By Cholesky, written out over the few rows: unlike `numpy.linalg.inv` one singular matrix does not fail the batch,
    and for n = 4 it is several times faster. `smallest_pivot` is relative to the diagonal.
    """
    n = matrix.shape[-1]
    lower, inverse = np.zeros_like(matrix), np.zeros_like(matrix)
    for j in range(n):
        diagonal = matrix[..., j, j]
        pivot = diagonal - np.sum(lower[..., j, :j] ** 2, axis=-1)
        lower[..., j, j] = np.sqrt(np.where(pivot > smallest_pivot * diagonal, pivot, np.nan))
        for i in range(j + 1, n):
            inner = np.sum(lower[..., i, :j] * lower[..., j, :j], axis=-1)
            lower[..., i, j] = (matrix[..., i, j] - inner) / lower[..., j, j]
    for j in range(n):
        inverse[..., j, j] = 1.0 / lower[..., j, j]
        for i in range(j + 1, n):
            inner = np.sum(lower[..., i, j:i] * inverse[..., j:i, j], axis=-1)
            inverse[..., i, j] = -inner / lower[..., i, i]
    return np.asarray(np.swapaxes(inverse, -1, -2) @ inverse)


def line_of_sight(satellite_ecef_m: Reals, position_ecef_m: Reals) -> tuple[Reals, Reals, Reals]:
    """Satellites in the frame of reception, unit vectors to them, and distances.

    Parameters
    ----------
    satellite_ecef_m : (..., k, 3) at transmission, in the ECEF frame of transmission.
    position_ecef_m : (..., 3) at reception, in the ECEF frame of reception.

    The travel time is the unturned distance plus the first-order Sagnac term: the distance is right to a nanometre.
    """
    position = position_ecef_m[..., None, :]
    turned_m2 = satellite_ecef_m[..., 0] * position[..., 1] - satellite_ecef_m[..., 1] * position[..., 0]
    straight_m = np.linalg.norm(satellite_ecef_m - position, axis=-1)
    travel_s = (straight_m + EARTH_ROTATION_RAD_S / SPEED_OF_LIGHT_M_S * turned_m2) / SPEED_OF_LIGHT_M_S
    satellite = rotate_to_reception(satellite_ecef_m, travel_s)
    difference = satellite - position
    distance_m = np.linalg.norm(difference, axis=-1)
    return satellite, difference / distance_m[..., None], distance_m


def design_matrix(unit_vector: Reals, clocks: Reals | None = None) -> Reals:
    """Derivative of range plus clock by position and clocks: (..., k, 3 + c) from unit vectors (..., k, 3).

    clocks : (k, c), 1 where a satellite keeps the time of that clock; without it, one clock for all.
    """
    if clocks is None:
        return np.concatenate((-unit_vector, np.ones_like(unit_vector[..., :1])), axis=-1)
    return np.concatenate((-unit_vector, np.broadcast_to(clocks, (*unit_vector.shape[:-1], clocks.shape[1]))), axis=-1)


def normal_inverse(normal: Reals) -> Reals:
    """Inverse of normal matrices (..., n, n) in which clocks (from column 3 on) may have no measurement at all.

    Such a clock gets a weight of one of its own, so that it touches nothing and the others are solved.
    """
    n = normal.shape[-1]
    if n > 4:
        empty = np.diagonal(normal, axis1=-2, axis2=-1) == 0.0
        empty[..., :3] = False
        normal = normal + empty[..., None] * np.eye(n)
    return spd_inverse(normal)


def gauss_newton(
    satellite_ecef_m: Reals,
    range_m: Reals,
    sigma_m: Reals,
    start_m: Reals,
    *,
    clocks: Reals | None = None,
    max_steps: int = 12,
    tolerance_m: float = 1e-4,
) -> Solution:
    """Weighted least squares of position and clocks, iterated until no problem moves by more than `tolerance_m`.

    Parameters
    ----------
    satellite_ecef_m : (..., k, 3) at transmission, in the ECEF frame of transmission.
    range_m : (..., k) geometric range plus c times clock bias; all other delays are taken off.
    sigma_m : (..., k) one sigma. Not finite in any of the three means: not used.
    start_m : (..., 3 + c) where to start. Earth's centre with any clock does for a position near the Earth.
    clocks : (k, c) as in `design_matrix`.
    """
    used = np.isfinite(range_m) & np.isfinite(sigma_m) & np.isfinite(satellite_ecef_m[..., 0])
    weight = np.where(used, 1.0 / np.where(used, sigma_m, 1.0) ** 2, 0.0)
    satellite_ecef_m = np.where(used[..., None], satellite_ecef_m, 2.6e7)  # anywhere but at the receiver
    range_m = np.where(used, range_m, 0.0)
    state = np.array(start_m, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for _ in range(max_steps):
            _, unit, distance = line_of_sight(satellite_ecef_m, state[..., :3])
            clock = state[..., 3:] if clocks is None else state[..., 3:] @ clocks.T
            misfit = np.where(used, range_m - distance - clock, 0.0)
            design = design_matrix(unit, clocks)
            weighted = np.swapaxes(design * weight[..., None], -1, -2)
            covariance = normal_inverse(weighted @ design)
            step = (covariance @ (weighted @ misfit[..., None]))[..., 0]
            state = state + step
            step_m = np.linalg.norm(step, axis=-1)
            if not np.any(step_m > tolerance_m):
                break
        residual = np.where(used, misfit - (design @ step[..., None])[..., 0], 0.0)
    return Solution(state_m=state, covariance_m2=covariance, residual_m=residual, last_step_m=step_m)
