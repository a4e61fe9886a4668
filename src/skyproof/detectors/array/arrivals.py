"""Find every direction of arrival that a signal's phases at an array allow, with covariance.

Whole cycles are unknown: directions that differ by whole cycles at all antennas look alike. An array in a plane cannot
tell below the plane from above it. All directions that fit are returned, the likeliest first.
"""

from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.array.agreement import Agreement, MeanPhases, compute_covariance, predict_from_members
from skyproof.detectors.array.array_model import array_design
from skyproof.detectors.array.policy import POLICY
from skyproof.statistics.directions import hemisphere, subtract_nearest_whole
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["Arrival", "across", "find_arrivals"]

_CELL_RAD: Final = 0.05  # of the grid of directions, times wavelengths of the longest baseline
_MOST_CELLS: Final = 200_000
_STARTS: Final = 48
_ROUNDS: Final = 30
_STEP_LEAST_RAD: Final = 1e-5
_STEP_MOST_RAD: Final = 0.05


class Arrival(NamedTuple):
    """direction : (3,) in the axes of the predicted ones. covariance_rad2 : (2, 2) along the axes of `across`."""

    direction: Reals
    covariance_rad2: Reals


def across(direction: Reals) -> Reals:
    """Return two unit vectors (..., 2, 3) across each direction (..., 3).

    The first is horizontal (third component 0), to where the angle from the first axis to the second grows. The second
    points to a larger third component.
    """
    x, y, z = np.moveaxis(direction, -1, 0)
    level = np.hypot(x, y)
    slanted = level > 1e-9
    least = np.where(slanted, level, 1.0)
    east, north = np.where(slanted, -y / least, 0.0), np.where(slanted, x / least, 1.0)
    around = np.stack([east, north, np.zeros_like(east)], axis=-1)
    up = np.stack([-z * north, z * east, x * north - y * east], axis=-1)
    return np.stack([around, up], axis=-2)


def find_arrivals(
    measured: MeanPhases, agreed: Agreement, cycles: Reals, covariance: Reals, ratio: float = 1.0
) -> list[Arrival]:
    """Find the directions from which a signal, or several from one place, may come.

    measured, agreed : the signals that show what all share. cycles : (d,) raw differences of the signal, any whole
    cycles in them; covariance : (d, d) of the signal's independent errors.
    """
    frame = agreed.frame
    design = ratio * array_design(measured.elements_cyc) @ frame.turn
    known = measured.part(agreed.members)
    reach = max(float(np.linalg.norm(design, axis=1).max()), 0.5)
    upper = hemisphere(min(int(2.0 * np.pi * (reach / _CELL_RAD) ** 2), _MOST_CELLS))
    grid = np.concatenate([upper, upper * [1.0, 1.0, -1.0]])
    total = covariance + _predict_shared(known, agreed, grid[:1], ratio)[1][0]
    far = subtract_nearest_whole(cycles - frame.bias_cyc - grid @ design.T, total)[1]
    limit = float(chi_square_threshold(POLICY.missed_direction_probability, len(cycles)))
    # The nearest direction of the grid is off by up to half a cell's diagonal: where errors are small, by many sigmas.
    sharpest = float(np.linalg.eigvalsh(design.T @ np.linalg.solve(total, design))[-1])
    most = (2.0 * np.sqrt(limit) + _CELL_RAD / reach * np.sqrt(0.5 * sharpest)) ** 2
    starts: list[Reals] = []
    for row in np.argsort(far)[: np.searchsorted(np.sort(far), most)]:
        if all(grid[row] @ start < np.cos(2.0 * _CELL_RAD / reach) for start in starts):
            starts.append(grid[row])
        if len(starts) == _STARTS:
            break
    if not starts:
        return []
    statistics, directions, spreads = _fit_directions(
        known, agreed, cycles, covariance, design, np.stack(starts), ratio
    )
    found: list[Arrival] = []
    for row in np.argsort(statistics, kind="stable"):
        arrival = Arrival(directions[row], spreads[row])
        if statistics[row] < limit and not any(_is_within(arrival, known_arrival.direction) for known_arrival in found):
            found.append(arrival)
    return found


def _is_within(arrival: Arrival, other: Reals) -> bool:
    """Test if a direction lies within an arrival's errors: in a flat array's plane its elevation is open."""
    off = across(arrival.direction) @ (other - arrival.direction)
    near = bool(arrival.direction @ other > 0.0)
    return near and float(off @ np.linalg.solve(arrival.covariance_rad2, off)) < POLICY.one_direction_squared_sigmas


def _predict_shared(known: MeanPhases, agreed: Agreement, directions: Reals, ratio: float) -> tuple[Reals, Reals]:
    """Predict the part common to all signals for one from each of `directions` (s, 3).

    Returns mean (s, d) and covariance (s, d, d).
    """
    n, s = agreed.members.size, len(directions)
    extended = MeanPhases(
        cycles=np.vstack([known.cycles, np.zeros((s, known.cycles.shape[1]))]),
        direction=np.vstack([known.direction, directions]),
        sigma_cyc=np.vstack([known.sigma_cyc, np.full((s, known.sigma_cyc.shape[1]), 1e-9)]),
        elements_cyc=known.elements_cyc,
        ratio=np.append(known.ratio, np.full(s, ratio)),
        position_sigma_cyc=known.position_sigma_cyc,
        scale_sigma=known.scale_sigma,
        pattern_sigma_cyc=known.pattern_sigma_cyc,
    )
    return predict_from_members(
        agreed.residual_cyc, compute_covariance(extended, agreed.frame), np.arange(n), np.arange(n, n + s)
    )


def _fit_directions(
    known: MeanPhases,
    agreed: Agreement,
    cycles: Reals,
    covariance: Reals,
    design: Reals,
    directions: Reals,
    ratio: float,
) -> tuple[Reals, Reals, Reals]:
    """Fit a direction on the sphere by least squares from each of `directions` (s, 3).

    Returns statistics (s,), directions, and covariances (s, 2, 2) across them.
    """
    statistics, of_angles = np.zeros(len(directions)), np.zeros((len(directions), 2, 2))
    for _ in range(2):  # what is shared hardly depends on the direction
        mean, shared = _predict_shared(known, agreed, directions, ratio)
        total = covariance + shared
        inverse = np.asarray(np.linalg.inv(total), np.float64)
        going = np.arange(len(directions))
        for _ in range(_ROUNDS):
            at = directions[going]
            off, statistics[going] = subtract_nearest_whole(
                cycles - agreed.frame.bias_cyc - mean[going] - at @ design.T, total[going]
            )
            axes = across(at)
            slope = np.einsum("ak,sjk,sab,sb->sj", design, axes, inverse[going], off, optimize=True)
            of_angles[going] = _covariance_of_angles(design, inverse[going], at)
            step = np.einsum("sij,sj->si", of_angles[going], slope)
            size = np.linalg.norm(step, axis=-1)
            moving = size >= _STEP_LEAST_RAD
            if not moving.any():
                break
            step *= np.minimum(1.0, _STEP_MOST_RAD / np.maximum(size, _STEP_LEAST_RAD))[:, None]
            moved = (at + np.einsum("sj,sjk->sk", step, axes))[moving]
            going = going[moving]
            directions[going] = moved / np.linalg.norm(moved, axis=-1, keepdims=True)
    return statistics, directions, _widen_towards_plane(design, inverse, directions, of_angles)


def _covariance_of_angles(design: Reals, inverse: Reals, directions: Reals) -> Reals:
    """Compute the covariance (s, 2, 2) across directions, by the slope at each.

    A line of antennas, or a direction in the plane of a flat array, leaves an angle open: it gets a sigma of one
    radian.
    """
    columns = design @ np.swapaxes(across(directions), -1, -2)
    return np.asarray(np.linalg.inv(np.swapaxes(columns, -1, -2) @ inverse @ columns + np.eye(2)), np.float64)


def _widen_towards_plane(design: Reals, inverse: Reals, directions: Reals, of_angles: Reals) -> Reals:
    """Widen covariances so that three sigmas along the longer axis are three sigmas of the phases on either side.

    Towards the plane of a flat array the error of an angle grows. The slope halfway to where three sigmas end is that
    of the chord. Where that comes near the plane the axis is at most doubled.
    """
    values, vectors = np.linalg.eigh(of_angles)
    longest, longer = values[:, -1], vectors[:, :, -1]
    half = 1.5 * np.sqrt(longest)[:, None] * np.einsum("sj,sjk->sk", longer, across(directions))
    most = np.zeros(len(directions))
    for moved in (directions + half, directions - half):
        covariance = _covariance_of_angles(design, inverse, moved / np.linalg.norm(moved, axis=-1, keepdims=True))
        most = np.maximum(most, np.einsum("si,sij,sj->s", longer, covariance, longer))
    more = np.clip(most, longest, 4.0 * longest) - longest
    return np.asarray(of_angles + more[:, None, None] * longer[:, :, None] * longer[:, None, :])
