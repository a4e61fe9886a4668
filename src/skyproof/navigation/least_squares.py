"""Gauss-Newton for position and clocks from ranges, any number of problems at once.

State: ECEF position and c times clock bias, one for each time scale that the satellites keep, all in metres.
Leading axes are problems (epochs, candidates), the axis before the last one is the satellite. Problems that cannot be
solved come out as NaN, without an exception.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.navigation.fit_kernels import SMALLEST_PIVOT, fill_sights, invert_all, solve_gauss_newton

__all__ = [
    "Solution",
    "compute_line_of_sight",
    "design_matrix",
    "fit_position",
    "invert_normal",
    "invert_spd",
    "merge_lead",
]


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """state_m (..., 3 + c), covariance_m2 (..., 3 + c, 3 + c), residual_m (..., k) zero if unused, last_step_m (...).

    A clock without a satellite keeps its start, with a variance of 1 m^2 that means nothing.
    """

    state_m: Reals
    covariance_m2: Reals
    residual_m: Reals
    last_step_m: Reals


def invert_spd(matrix: Reals, *, smallest_pivot: float = SMALLEST_PIVOT) -> Reals:
    """Invert symmetric positive definite matrices (..., n, n); NaN where one is not, or only just.

    By Cholesky: unlike `numpy.linalg.inv` one singular matrix does not fail the batch. `smallest_pivot` is relative to
    the diagonal.
    """
    n = matrix.shape[-1]
    matrices = merge_lead(matrix, matrix.shape[:-2], n, n)
    inverse = np.empty_like(matrices)
    invert_all(matrices, smallest_pivot, inverse)
    return inverse.reshape(matrix.shape)


def compute_line_of_sight(satellite_ecef_m: Reals, position_ecef_m: Reals) -> tuple[Reals, Reals, Reals]:
    """Compute satellites in the frame of reception, unit vectors to them, and distances.

    Parameters
    ----------
    satellite_ecef_m : (..., k, 3) at transmission, in the ECEF frame of transmission.
    position_ecef_m : (..., 3) at reception, in the ECEF frame of reception.

    The travel time is the unturned distance plus the first-order Sagnac term: the distance is right to a nanometre.
    """
    shape = np.broadcast_shapes(satellite_ecef_m.shape[:-2], position_ecef_m.shape[:-1])
    k = satellite_ecef_m.shape[-2]
    satellite = merge_lead(satellite_ecef_m, shape, k, 3)
    turned, unit, distance_m = np.empty(satellite.shape), np.empty(satellite.shape), np.empty(satellite.shape[:2])
    fill_sights(satellite, merge_lead(position_ecef_m, shape, 3), turned, unit, distance_m)
    return turned.reshape(*shape, k, 3), unit.reshape(*shape, k, 3), distance_m.reshape(*shape, k)


def merge_lead(values: ArrayLike, lead: tuple[int, ...], *own: int) -> Reals:
    """Broadcast values to `lead` and `own` axes, with all of `lead` as one axis, as kernels take them.

    The result is a copy: a kernel would be compiled again for arrays that cannot be written.
    """
    whole = np.broadcast_to(np.asarray(values, np.float64), (*lead, *own))
    return np.array(whole, order="C").reshape(math.prod(lead), *own)


def design_matrix(unit_vector: Reals, clocks: Reals | None = None) -> Reals:
    """Differentiate range plus clock by position and clocks, (..., k, 3 + c), by unit vectors (..., k, 3).

    clocks : (k, c), 1 where a satellite keeps the time of that clock; without it, one clock for all.
    """
    if clocks is None:
        return np.concatenate((-unit_vector, np.ones_like(unit_vector[..., :1])), axis=-1)
    return np.concatenate((-unit_vector, np.broadcast_to(clocks, (*unit_vector.shape[:-1], clocks.shape[1]))), axis=-1)


def invert_normal(normal: Reals) -> Reals:
    """Invert normal matrices (..., n, n) in which clocks (from column 3 on) may have no measurement.

    Such a clock gets a weight of one of its own, so that it touches nothing and the others are solved.
    """
    n = normal.shape[-1]
    if n > 4:
        empty = np.diagonal(normal, axis1=-2, axis2=-1) == 0.0
        empty[..., :3] = False
        normal = normal + empty[..., None] * np.eye(n)
    return invert_spd(normal)


def fit_position(
    satellite_ecef_m: Reals,
    range_m: Reals,
    sigma_m: Reals,
    start_m: Reals,
    *,
    clocks: Reals | None = None,
    max_steps: int = 12,
    tolerance_m: float = 1e-4,
) -> Solution:
    """Solve for position and clocks by weighted least squares, until no problem moves by `tolerance_m`.

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
    shape, k = start_m.shape[:-1], range_m.shape[-1]
    n = start_m.shape[-1]
    state = np.array(start_m, np.float64).reshape(-1, n)
    covariance, residual_m, step_m = np.empty((len(state), n, n)), np.empty((len(state), k)), np.empty(len(state))
    solve_gauss_newton(
        merge_lead(satellite_ecef_m, shape, k, 3),
        merge_lead(range_m, shape, k),
        merge_lead(weight, shape, k),
        np.ones((k, 1)) if clocks is None else np.ascontiguousarray(clocks, np.float64),
        max_steps,
        tolerance_m,
        state,
        covariance,
        residual_m,
        step_m,
    )
    return Solution(
        state_m=state.reshape(start_m.shape),
        covariance_m2=covariance.reshape(*shape, n, n),
        residual_m=residual_m.reshape(*shape, k),
        last_step_m=step_m.reshape(shape),
    )
