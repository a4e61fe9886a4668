"""What tests of directions miss: blocks of the sky, dead zones, and tests of one vector against others."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals
from skyproof.statistics.directions import (
    direction_cosines,
    equal_statistic,
    mahalanobis_squared,
    subtract_nearest_whole,
)
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "DirectionBlocks",
    "blocks",
    "equal_p_value",
    "measure_dead_zone",
    "noncentrality_for_power",
    "outsider_statistic",
]


class DirectionBlocks(NamedTuple):
    """Blocks of azimuth and elevation over the upper hemisphere, azimuth running fastest.

    azimuth_rad, elevation_rad : (n,) the point that stands for the block. direction : (n, 3).
    share : (n,) of the hemisphere's solid angle; sums to 1.
    """

    azimuth_rad: Reals
    elevation_rad: Reals
    direction: Reals
    share: Reals


def blocks(step_deg: float = 1.0, *, azimuth_place: float = 0.5, elevation_place: float = 0.5) -> DirectionBlocks:
    """List all blocks of `step_deg`, which divides 90. The places are 0 at the lower edge, 0.5 in the middle."""
    rings = round(90.0 / step_deg)
    ring, turn = np.divmod(np.arange(4 * rings * rings), 4 * rings)
    az_rad, el_rad = np.radians((turn + azimuth_place) * step_deg), np.radians((ring + elevation_place) * step_deg)
    lower, upper = np.sin(np.radians(ring * step_deg)), np.sin(np.radians((ring + 1) * step_deg))
    return DirectionBlocks(az_rad, el_rad, direction_cosines(az_rad, el_rad), (upper - lower) / (4 * rings))


def outsider_statistic(
    value: ArrayLike, covariance: ArrayLike, mean: ArrayLike, of_mean: ArrayLike, *, wrapped: bool = False
) -> Reals:
    """Compute the squared norm of a vector's distance from a group's mean, (...).

    It is chi-square with d degrees if the vector belongs to the group.

    Parameters
    ----------
    value, mean : (..., d). covariance, of_mean : (..., d, d).
    """
    difference = np.asarray(value, np.float64) - np.asarray(mean, np.float64)
    total = np.asarray(covariance, np.float64) + np.asarray(of_mean, np.float64)
    return subtract_nearest_whole(difference, total)[1] if wrapped else mahalanobis_squared(difference, total)


def noncentrality_for_power(power: ArrayLike, false_alarm_probability: ArrayLike, dof: ArrayLike) -> Reals:
    """Compute the noncentrality at which a chi-square test has this power: 27.4145 for 0.99 at 0.01 with 2 degrees."""
    threshold = chi_square_threshold(false_alarm_probability, dof)
    return np.asarray(special.chndtrinc(threshold, dof, 1.0 - np.asarray(power, np.float64)), float)


def measure_dead_zone(
    predicted: Reals,
    received: Reals,
    design: Reals,
    covariance: Reals,
    *,
    weight: ArrayLike = 1.0,
    power: float = 0.99,
    false_alarm_probability: float = 0.01,
    wrapped: bool = False,
) -> Reals:
    """Sum (p,) of the weights of directions from which a false signal is found with less than `power`.

    The test of one signal: chi-square with d degrees, noncentral by the squared norm of the difference of the means;
    `wrapped` by the least over all whole numbers, as the means are then known modulo 1.

    Parameters
    ----------
    predicted : (p, 3). received : (r, 3), with `weight` one number or (r,).
    design : (d, 3), the mean of a measurement from u is design @ u. covariance : (d, d) of a difference.
    """
    limit = float(noncentrality_for_power(power, false_alarm_probability, design.shape[0]))
    weight = np.broadcast_to(np.asarray(weight, np.float64), (len(received),))
    # Where no component can be half a cycle off within the limit, rounding finds the one set of whole cycles that may.
    rounding = limit * np.max(np.diag(covariance)) < 0.25
    inverse = np.linalg.inv(np.linalg.cholesky(covariance))
    predicted_cyc, received_cyc = predicted @ design.T, received @ design.T
    white, white_there = predicted_cyc @ inverse.T, received_cyc @ inverse.T
    there_square = np.sum(white_there**2, axis=-1)
    total = np.empty(len(predicted))
    chunk = max(1, 2**17 // len(received))  # in the cache
    for start in range(0, len(predicted), chunk):
        rows = slice(start, start + chunk)
        if not wrapped:
            far = np.sum(white[rows] ** 2, axis=-1)[:, None] + there_square - 2.0 * (white[rows] @ white_there.T)
        elif rounding:
            far = _round_and_square(predicted_cyc[rows], received_cyc, inverse)
        else:
            far = subtract_nearest_whole(predicted_cyc[rows, None, :] - received_cyc, covariance)[1]
        total[rows] = (far < limit) @ weight
    return total


def equal_p_value(values: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """Return the p-value (...) of `equal_statistic`, uniform where the n vectors are one."""
    n, d = np.shape(values)[-2:]
    return chi_square_survival(equal_statistic(values, covariance, wrapped=wrapped)[0], (n - 1) * d)


def _round_and_square(here: Reals, there: Reals, inverse: Reals) -> Reals:
    """Compute the squared norm (p, r) of differences rounded component by component."""
    apart = [here[:, k, None] - there[:, k] for k in range(here.shape[-1])]
    for component in apart:
        component -= np.rint(component)
    total = np.zeros((len(here), len(there)))
    for row, weights in enumerate(inverse):
        total += sum(w * component for w, component in zip(weights[: row + 1], apart, strict=False)) ** 2
    return total
