"""Directions and small vectors: cosines, blocks of a sphere, whole numbers in phases, and which of several are equal.

Azimuth is the angle from the x axis towards the y axis, elevation the angle above the x-y plane; both radians.
Covariances are positive definite. All functions take free leading axes, written (...).
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Indices, Reals
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold, noncentral_chi_square_survival

__all__ = [
    "Clusters",
    "DirectionBlocks",
    "blocks",
    "complete_linkage",
    "dead_zone",
    "direction_cosines",
    "equal_clusters",
    "equal_p_value",
    "equal_statistic",
    "equality_chance",
    "hemisphere",
    "nearest_whole",
    "noncentrality_for_power",
    "outsider_statistic",
    "pair_statistics",
    "squared_norm",
]


ALL_NEIGHBOURS: Final = 4
"""Components up to which all neighbours of whole numbers are tried."""


def direction_cosines(azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> Reals:
    """Unit vectors (..., 3): cos el cos az, cos el sin az, sin el."""
    az_rad, el_rad = np.broadcast_arrays(np.asarray(azimuth_rad, np.float64), np.asarray(elevation_rad, np.float64))
    level = np.cos(el_rad)
    return np.stack((level * np.cos(az_rad), level * np.sin(az_rad), np.sin(el_rad)), axis=-1)


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
    """All blocks of `step_deg`, which divides 90. The places are 0 at the lower edge, 0.5 in the middle."""
    rings = round(90.0 / step_deg)
    ring, turn = np.divmod(np.arange(4 * rings * rings), 4 * rings)
    az_rad, el_rad = np.radians((turn + azimuth_place) * step_deg), np.radians((ring + elevation_place) * step_deg)
    lower, upper = np.sin(np.radians(ring * step_deg)), np.sin(np.radians((ring + 1) * step_deg))
    return DirectionBlocks(az_rad, el_rad, direction_cosines(az_rad, el_rad), (upper - lower) / (4 * rings))


def hemisphere(count: int) -> Reals:
    """Directions (count, 3) spread evenly over the upper hemisphere: equal steps of height, turned by the golden angle
    (Gonzalez, Mathematical Geosciences 42, 2010)."""
    k = np.arange(count)
    up = (k + 0.5) / count
    return direction_cosines(np.pi * (3.0 - np.sqrt(5.0)) * k, np.arcsin(up))


def squared_norm(vector: ArrayLike, covariance: ArrayLike) -> Reals:
    """vector' covariance^-1 vector of (..., d) and (..., d, d); chi-square with d degrees for N(0, covariance)."""
    return np.asarray(np.sum(_whitened(np.asarray(vector, np.float64), _whitener(covariance)) ** 2, axis=-1))


def nearest_whole(vector: ArrayLike, covariance: ArrayLike) -> tuple[Reals, Reals]:
    """The vector less the whole numbers that leave the least vector' covariance^-1 vector, and that least.

    Each component is rounded and its neighbours tried: all 3^d up to `ALL_NEIGHBOURS` components; of more, which are
    taken for differences against one antenna, those that rounding against each other antenna gives. Exact while
    standard deviations are small against one half. Then the least is chi-square with d degrees for N(0, covariance)
    plus any whole numbers, and does not depend on which antenna differences refer to (rounding alone does).

    Parameters
    ----------
    vector : (..., d). covariance : (..., d, d), broadcast over the leading axes.

    Returns
    -------
    remainder : (..., d). least : (...).
    """
    vector = np.asarray(vector, np.float64)
    remainder = vector - np.rint(vector)
    whitener = _whitener(covariance)
    white = _whitened(remainder, whitener)
    least = np.sum(white**2, axis=-1)
    choice = np.zeros(white.shape)
    for step in _neighbours(remainder):
        tried = np.sum((white - _whitened(step, whitener)) ** 2, axis=-1)
        better = tried < least
        least = np.where(better, tried, least)
        choice = np.where(better[..., None], step, choice)
    return remainder - choice, least


def _neighbours(remainder: Reals) -> Iterator[Reals]:
    """Whole numbers (..., d) or (d,) that may leave less than none."""
    d = remainder.shape[-1]
    if d > ALL_NEIGHBOURS:
        yield from (np.rint(remainder - remainder[..., k : k + 1]) for k in range(d))
    else:
        yield from (np.array(step) for step in product((-1.0, 0.0, 1.0), repeat=d) if any(step))


def pair_statistics(values: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """Of every pair, the squared norm of their difference: (..., n, n), chi-square with d degrees where equal.

    Parameters
    ----------
    values : (..., n, d) independent. covariance : (d, d) or (..., n, d, d). wrapped : values are known modulo 1.
    """
    values = np.asarray(values, np.float64)
    covariance = np.broadcast_to(np.asarray(covariance, np.float64), values.shape + values.shape[-1:])
    difference = values[..., :, None, :] - values[..., None, :, :]
    total = covariance[..., :, None, :, :] + covariance[..., None, :, :, :]
    return nearest_whole(difference, total)[1] if wrapped else squared_norm(difference, total)


def equal_statistic(values: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> tuple[Reals, Reals, Reals]:
    """Are n vectors one? Sum of squared norms about their weighted mean: chi-square with (n - 1) d degrees if so.

    Parameters
    ----------
    values, covariance, wrapped : as in `pair_statistics`. Wrapped values are first taken to within half of the first.

    Returns
    -------
    statistic : (...). mean : (..., d). covariance of the mean : (..., d, d).
    """
    values = np.asarray(values, np.float64)
    covariance = np.broadcast_to(np.asarray(covariance, np.float64), values.shape + values.shape[-1:])
    if wrapped:
        first = values[..., :1, :]
        values = first + nearest_whole(values - first, covariance + covariance[..., :1, :, :])[0]
    information = np.linalg.inv(covariance)
    of_mean = np.linalg.inv(information.sum(axis=-3))
    mean = np.einsum("...ab,...nbc,...nc->...a", of_mean, information, values)
    return squared_norm(values - mean[..., None, :], covariance).sum(axis=-1), mean, of_mean


def outsider_statistic(
    value: ArrayLike, covariance: ArrayLike, mean: ArrayLike, of_mean: ArrayLike, *, wrapped: bool = False
) -> Reals:
    """Squared norm of a vector's distance from a group's mean, (...); chi-square with d degrees if it belongs there.

    Parameters
    ----------
    value, mean : (..., d). covariance, of_mean : (..., d, d).
    """
    difference = np.asarray(value, np.float64) - np.asarray(mean, np.float64)
    total = np.asarray(covariance, np.float64) + np.asarray(of_mean, np.float64)
    return nearest_whole(difference, total)[1] if wrapped else squared_norm(difference, total)


def complete_linkage(distance: ArrayLike, limit: float) -> Indices:
    """Clusters in which no pair is farther apart than `limit`, joined from the nearest pair on.

    Parameters
    ----------
    distance : (..., n, n), symmetric.

    Returns
    -------
    labels : (..., n), the smallest index in the same cluster.
    """
    distance = np.array(distance, np.float64)
    *lead, n, _ = distance.shape
    apart = distance.reshape(-1, n, n)
    apart[:, np.arange(n), np.arange(n)] = np.inf
    labels = np.tile(np.arange(n), (apart.shape[0], 1))
    for _ in range(n - 1):
        nearest = apart.reshape(-1, n * n).argmin(axis=-1)
        one, other = np.divmod(nearest, n)
        trial = np.flatnonzero(apart[np.arange(len(nearest)), one, other] <= limit)
        if trial.size == 0:
            break
        kept, gone = np.minimum(one, other)[trial], np.maximum(one, other)[trial]
        joined = np.maximum(apart[trial, kept], apart[trial, gone])
        joined[np.arange(trial.size), kept] = np.inf
        apart[trial, kept, :], apart[trial, :, kept] = joined, joined
        apart[trial, gone, :] = np.inf
        apart[trial, :, gone] = np.inf
        labels[trial] = np.where(labels[trial] == gone[:, None], kept[:, None], labels[trial])
    return np.asarray(labels.reshape(*lead, n))


class Clusters(NamedTuple):
    """labels : (..., n) the smallest index in the same cluster. distance : (..., n, n) pair statistics, chi-square with
    d degrees where equal. limit : what no pair of a cluster exceeds."""

    labels: Indices
    distance: Reals
    limit: float


def equal_clusters(
    values: ArrayLike, covariance: ArrayLike, *, false_alarm_probability: float, wrapped: bool = False
) -> Clusters:
    """Which of n vectors are equal.

    n equal vectors are all in one cluster with a probability of at least 1 - `false_alarm_probability`, by the union
    bound over their pairs. With others among them that are nearly equal they may be divided more often, as one of them
    may be joined to such a neighbour first.

    Parameters
    ----------
    values, covariance, wrapped : as in `pair_statistics`.
    """
    values = np.asarray(values, np.float64)
    n, d = values.shape[-2:]
    limit = float(chi_square_threshold(false_alarm_probability / max(1, n * (n - 1) // 2), d))
    distance = pair_statistics(values, covariance, wrapped=wrapped)
    return Clusters(complete_linkage(distance, limit), distance, limit)


def noncentrality_for_power(power: ArrayLike, false_alarm_probability: ArrayLike, dof: ArrayLike) -> Reals:
    """The noncentrality at which a chi-square test has this power: 27.4145 for 0.99 at 0.01 with 2 degrees."""
    threshold = chi_square_threshold(false_alarm_probability, dof)
    return np.asarray(special.chndtrinc(threshold, dof, 1.0 - np.asarray(power, np.float64)), float)


def dead_zone(
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
    here, there = predicted @ design.T, received @ design.T
    white, white_there = here @ inverse.T, there @ inverse.T
    there_square = np.sum(white_there**2, axis=-1)
    total = np.empty(len(predicted))
    chunk = max(1, 2**17 // len(received))  # in the cache
    for start in range(0, len(predicted), chunk):
        rows = slice(start, start + chunk)
        if not wrapped:
            far = np.sum(white[rows] ** 2, axis=-1)[:, None] + there_square - 2.0 * (white[rows] @ white_there.T)
        elif rounding:
            far = _rounded_square(here[rows], there, inverse)
        else:
            far = nearest_whole(here[rows, None, :] - there, covariance)[1]
        total[rows] = (far < limit) @ weight
    return total


def equality_chance(design: Reals, covariance: Reals, limit: float, *, wrapped: bool = False) -> float:
    """Chance that a signal from anywhere above is taken for equal to another: the largest over the other's direction.

    Over 32 directions of the other, and 8000 of the signal, spread evenly over the hemisphere.

    Parameters
    ----------
    design : (d, 3), the mean of a signal from u is design @ u. covariance : (d, d) of one signal. limit : of the pair.
    """
    design, covariance = np.ascontiguousarray(design, float), np.ascontiguousarray(covariance, float)
    return _equality_chance(design.tobytes(), covariance.tobytes(), limit, wrapped)


@lru_cache(maxsize=64)
def _equality_chance(design_bytes: bytes, covariance_bytes: bytes, limit: float, wrapped: bool) -> float:
    """Kept, as a geometry meets window after window and this takes a tenth of a second."""
    design = np.frombuffer(design_bytes).reshape(-1, 3)
    covariance = np.frombuffer(covariance_bytes).reshape(len(design), -1)
    means, others = hemisphere(8000) @ design.T, hemisphere(32) @ design.T
    shift = np.linspace(0.0, 2.0 * limit + 100.0, 2000)
    taken = 1.0 - noncentral_chi_square_survival(limit, len(design), shift)
    worst = 0.0
    for other in others:
        difference = means - other
        far = nearest_whole(difference, 2.0 * covariance)[1] if wrapped else squared_norm(difference, 2.0 * covariance)
        worst = max(worst, float(np.interp(far, shift, taken).mean()))
    return worst


def equal_p_value(values: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """p-value (...) of `equal_statistic`, uniform where the n vectors are one."""
    n, d = np.shape(values)[-2:]
    return chi_square_survival(equal_statistic(values, covariance, wrapped=wrapped)[0], (n - 1) * d)


def _whitener(covariance: ArrayLike) -> Reals:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(np.asarray(covariance, np.float64))), np.float64)


def _whitened(vector: Reals, whitener: Reals) -> Reals:
    if whitener.ndim == 2:
        return np.asarray(vector @ whitener.T)
    return np.asarray(np.matmul(whitener, vector[..., None])[..., 0])


def _rounded_square(here: Reals, there: Reals, inverse: Reals) -> Reals:
    """Squared norm (p, r) of differences rounded component by component; a component at a time, for the cache."""
    apart = [here[:, k, None] - there[:, k] for k in range(here.shape[-1])]
    for one in apart:
        one -= np.rint(one)
    total = np.zeros((len(here), len(there)))
    for row, weights in enumerate(inverse):
        total += sum(w * one for w, one in zip(weights[: row + 1], apart, strict=False)) ** 2
    return total
