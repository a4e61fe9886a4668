"""What the geometry of an array tells at most: single tests, blind directions, regular arrays."""

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.detectors.array.array_model import array_design, differences
from skyproof.statistics.directions import mahalanobis_squared, subtract_nearest_whole

__all__ = [
    "blind_directions",
    "direction_statistic",
    "equilateral_triangle",
    "phase_residuals",
    "regular_tetrahedron",
    "single_statistic",
    "subtract_first_signal",
]


def equilateral_triangle(side: float) -> Reals:
    """Return the elements (3, 3) of the paper's array, the second on the x axis."""
    return side * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0]])


def regular_tetrahedron(side: float) -> Reals:
    """Return elements (4, 3): the triangle and a fourth one above. Its power is the same in all directions."""
    return np.vstack([equilateral_triangle(side), side * np.array([[0.5, np.sqrt(1 / 12), np.sqrt(2 / 3)]])])


def phase_residuals(phase_cyc: ArrayLike, elements_cyc: ArrayLike, direction: ArrayLike) -> Reals:
    """Compute measured minus predicted phase differences z (..., n, d), with any whole cycles in them.

    Parameters
    ----------
    phase_cyc : (..., n, M), growing where an antenna is nearer to the source.
    elements_cyc : (M, 3) or (..., n, M, 3). direction : (..., n, 3) predicted.
    """
    predicted = np.einsum("...ma,...a->...m", np.asarray(elements_cyc, np.float64), np.asarray(direction, np.float64))
    return differences(np.asarray(phase_cyc, np.float64) - predicted)


def single_statistic(residual_cyc: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """Compute T (...) of one signal: chi-square with d degrees for a true one.

    The paper's test is that with the covariance of white noise alone, not wrapped (equation 37).

    Parameters
    ----------
    residual_cyc : (..., d). covariance : (..., d, d).
    wrapped : choose the whole cycles that leave least; needs errors small against half a cycle.
    """
    return (
        subtract_nearest_whole(residual_cyc, covariance)[1]
        if wrapped
        else mahalanobis_squared(residual_cyc, covariance)
    )


def subtract_first_signal(residual_cyc: ArrayLike, covariance: ArrayLike) -> tuple[Reals, Reals]:
    """Compute residuals (..., n - 1, d) against the first signal and their covariance: line biases cancel.

    `joint_statistic` of them has (n - 1) d degrees, whichever signal is first. Parameters as in `joint_statistic`;
    residuals wrapped to within half a cycle before.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    covariance = np.asarray(covariance, np.float64)
    n, d = residual_cyc.shape[-2:]
    contrast = np.kron(np.column_stack([-np.ones(n - 1), np.eye(n - 1)]), np.eye(d))
    return differences(residual_cyc, axis=-2), contrast @ covariance @ contrast.T


def direction_statistic(residual_cyc: ArrayLike, covariance: ArrayLike, design: ArrayLike) -> tuple[Reals, Reals, int]:
    """Split residuals into what an error of direction can cause, and the rest as a check.

    Parameters
    ----------
    residual_cyc : (..., k). covariance : (..., k, k).
    design : (k, q): `array_design` for one signal; stacked for several epochs or frequencies, or block by block.

    Returns
    -------
    statistic : (...) chi-square with `dof` degrees. rest : (...) chi-square with k - dof, independent. dof : its rank.
    """
    residual_cyc = np.asarray(residual_cyc, np.float64)
    covariance = np.asarray(covariance, np.float64)
    design = np.asarray(design, np.float64)
    dof = int(np.linalg.matrix_rank(design))
    # An orthonormal basis of the columns makes the information regular also where the design is not.
    basis = np.linalg.svd(design, full_matrices=False)[0][:, :dof]
    weighted = np.linalg.solve(covariance, np.broadcast_to(basis, (*covariance.shape[:-2], *basis.shape)))
    along = np.einsum("...kq,...k->...q", weighted, residual_cyc)
    statistic = mahalanobis_squared(along, np.swapaxes(weighted, -1, -2) @ basis)
    return statistic, mahalanobis_squared(residual_cyc, covariance) - statistic, dof


def blind_directions(direction: ArrayLike, elements_cyc: ArrayLike, *, tolerance: float = 1e-9) -> Reals:
    """Find directions (k, 3) that differ from one by whole cycles at every antenna of a planar array.

    Up and `direction` itself are among them; no test of one signal and epoch can tell them apart.

    Raises
    ------
    ValueError : the array is not planar, or is a line.
    """
    design = array_design(elements_cyc)
    if np.any(design[:, 2]) or np.linalg.matrix_rank(design[:, :2]) < 2:
        raise ValueError("blind_directions: elements must span the x-y plane, with z the same for all")
    level = np.asarray(direction, np.float64)[:2]
    # Two independent baselines give all candidates; the others must then be whole, too.
    pair = design[_select_baselines(design[:, :2]), :2]
    reach = np.ceil(2.0 * np.linalg.norm(pair, axis=-1)).astype(int)
    whole = np.stack(np.meshgrid(*(np.arange(-k, k + 1) for k in reach), indexing="ij"), axis=-1).reshape(-1, 2)
    candidates = level + np.linalg.solve(pair, whole.T).T
    cycles = (candidates - level) @ design[:, :2].T
    squared = np.sum(candidates**2, axis=-1)
    keep = (squared < 1.0) & np.all(np.abs(cycles - np.rint(cycles)) < tolerance, axis=-1)
    return np.column_stack([candidates[keep], np.sqrt(1.0 - squared[keep])])


def _select_baselines(design: Reals) -> list[int]:
    """Select the longest baseline and the one farthest off its line."""
    first = int(np.argmax(np.sum(design**2, axis=-1)))
    off = np.abs(design[:, 0] * design[first, 1] - design[:, 1] * design[first, 0])
    return [first, int(np.argmax(off))]
