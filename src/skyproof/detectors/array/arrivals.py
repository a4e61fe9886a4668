"""From where a signal comes to an array: every direction that its phases allow, with covariance.

Whole cycles are unknown, so that directions which differ by whole cycles at all antennas look alike, and an array in a
plane sees what is below the plane as above it. All that fit are given, the likeliest first.
"""

from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.array.agreement import Agreement, MeanPhases, covariance_of, shared_given
from skyproof.detectors.array.array_model import array_design
from skyproof.statistics.directions import hemisphere, nearest_whole
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["Arrival", "across", "arrivals"]

_CELL_RAD: Final = 0.05  # of the grid of directions, times wavelengths of the longest baseline
_MOST_CELLS: Final = 200_000
_STARTS: Final = 48
_MISSED: Final = 1e-3  # probability that the true direction is none of those given
_ROUNDS: Final = 30
_STEP_LEAST_RAD: Final = 1e-5
_STEP_MOST_RAD: Final = 0.05
_ALIKE: Final = 9.0  # squared distance over sigma of two directions that are one


class Arrival(NamedTuple):
    """direction : (3,) in the axes of the predicted ones. covariance_rad2 : (2, 2) along the axes of `across`."""

    direction: Reals
    covariance_rad2: Reals


def across(direction: Reals) -> Reals:
    """(2, 3) unit vectors across a direction: horizontal (third component 0) to where the angle from the first axis to
    the second grows, and towards a larger third component."""
    level = np.hypot(direction[0], direction[1])
    around = np.array([-direction[1], direction[0], 0.0]) / level if level > 1e-9 else np.array([0.0, 1.0, 0.0])
    return np.stack([around, np.cross(direction, around)])


def arrivals(
    measured: MeanPhases, agreed: Agreement, cycles: Reals, covariance: Reals, ratio: float = 1.0
) -> list[Arrival]:
    """Directions from which a signal, or several from one place, may come.

    measured, agreed : the signals that show what all share. cycles : (d,) raw differences of the signal, any whole
    cycles in them; covariance : (d, d) of what is its own.
    """
    frame = agreed.frame
    design = ratio * array_design(measured.elements_cyc) @ frame.turn
    known = measured.part(agreed.members)
    reach = max(float(np.linalg.norm(design, axis=1).max()), 0.5)
    upper = hemisphere(min(int(2.0 * np.pi * (reach / _CELL_RAD) ** 2), _MOST_CELLS))
    grid = np.concatenate([upper, upper * [1.0, 1.0, -1.0]])
    total = covariance + _shared(known, agreed, grid[0], ratio)[1]
    far = nearest_whole(cycles - frame.bias_cyc - grid @ design.T, total)[1]
    limit = float(chi_square_threshold(_MISSED, len(cycles)))
    # The nearest direction of the grid is off by up to half a cell's diagonal: where errors are small, by many sigmas.
    sharpest = float(np.linalg.eigvalsh(design.T @ np.linalg.solve(total, design))[-1])
    most = (2.0 * np.sqrt(limit) + _CELL_RAD / reach * np.sqrt(0.5 * sharpest)) ** 2
    starts: list[Reals] = []
    for row in np.argsort(far)[: np.searchsorted(np.sort(far), most)]:
        if all(grid[row] @ one < np.cos(2.0 * _CELL_RAD / reach) for one in starts):
            starts.append(grid[row])
        if len(starts) == _STARTS:
            break
    fitted = [_fitted(known, agreed, cycles, covariance, design, start, ratio) for start in starts]
    found: list[Arrival] = []
    for statistic, arrival in sorted(fitted, key=lambda one: one[0]):
        if statistic < limit and not any(_within(arrival, one.direction) for one in found):
            found.append(arrival)
    return found


def _within(arrival: Arrival, other: Reals) -> bool:
    """Whether a direction lies within the errors of an arrival: in a flat array's plane its elevation is open."""
    off = across(arrival.direction) @ (other - arrival.direction)
    near = bool(arrival.direction @ other > 0.0)
    return near and float(off @ np.linalg.solve(arrival.covariance_rad2, off)) < _ALIKE


def _shared(known: MeanPhases, agreed: Agreement, direction: Reals, ratio: float) -> tuple[Reals, Reals]:
    """Mean (d,) and covariance (d, d) of what is common to all signals in one from a direction."""
    n = agreed.members.size
    both = MeanPhases(
        cycles=np.vstack([known.cycles, np.zeros(known.cycles.shape[1])]),
        direction=np.vstack([known.direction, direction]),
        sigma_cyc=np.vstack([known.sigma_cyc, np.full(known.sigma_cyc.shape[1], 1e-9)]),
        elements_cyc=known.elements_cyc,
        ratio=np.append(known.ratio, ratio),
        position_sigma_cyc=known.position_sigma_cyc,
    )
    mean, left = shared_given(agreed.residual_cyc, covariance_of(both, agreed.frame), np.arange(n), np.array([n]))
    return mean[0], left[0]


def _fitted(
    known: MeanPhases,
    agreed: Agreement,
    cycles: Reals,
    covariance: Reals,
    design: Reals,
    direction: Reals,
    ratio: float,
) -> tuple[float, Arrival]:
    """Least squares on the sphere from a start."""
    for _ in range(2):  # what is shared hardly depends on the direction
        mean, shared = _shared(known, agreed, direction, ratio)
        total = covariance + shared
        inverse = np.asarray(np.linalg.inv(total), np.float64)
        for _ in range(_ROUNDS):
            off, statistic = nearest_whole(cycles - agreed.frame.bias_cyc - mean - design @ direction, total)
            axes = across(direction)
            columns = design @ axes.T
            of_angles = _of_angles(design, inverse, direction)
            step = of_angles @ (columns.T @ inverse @ off)
            size = float(np.linalg.norm(step))
            if size < _STEP_LEAST_RAD:
                break
            moved = direction + step * min(1.0, _STEP_MOST_RAD / size) @ axes
            direction = np.asarray(moved / np.linalg.norm(moved))
    return float(statistic), Arrival(direction, _bent(design, inverse, direction, of_angles))


def _of_angles(design: Reals, inverse: Reals, direction: Reals) -> Reals:
    """Covariance (2, 2) across a direction, by the slope there. A line of antennas, or a direction in the plane of flat
    ones, leaves an angle open: by a radian, say."""
    columns = design @ across(direction).T
    return np.asarray(np.linalg.inv(columns.T @ inverse @ columns + np.eye(2)), np.float64)


def _bent(design: Reals, inverse: Reals, direction: Reals, of_angles: Reals) -> Reals:
    """The covariance by which three sigmas along its longer axis are three sigmas of the phases on either side.

    Towards the plane of a flat array an angle is known less and less. The slope halfway to where three sigmas end is
    that of the chord. Where that comes near the plane the axis is at most doubled.
    """
    values, vectors = np.linalg.eigh(of_angles)
    longer = vectors[:, -1]
    halves = 1.5 * np.sqrt(values[-1]) * np.array([[1.0], [-1.0]]) * longer @ across(direction)
    there = [moved / np.linalg.norm(moved) for moved in direction + halves]
    most = max(float(longer @ _of_angles(design, inverse, one) @ longer) for one in there)
    return np.asarray(of_angles + (np.clip(most, values[-1], 4.0 * values[-1]) - values[-1]) * np.outer(longer, longer))
