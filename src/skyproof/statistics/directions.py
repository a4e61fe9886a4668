"""Directions and small vectors: cosines, points on a sphere, whole numbers in phases, and tests of equality.

Azimuth is the angle from the x axis towards the y axis, elevation the angle above the x-y plane; both radians.
Covariances are positive definite. All functions take free leading axes, written (...).
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Indices, Reals
from skyproof.statistics.distributions import chi_square_threshold, noncentral_chi_square_survival

__all__ = [
    "Clusters",
    "complete_linkage",
    "direction_cosines",
    "equal_clusters",
    "equal_statistic",
    "equality_chance",
    "hemisphere",
    "mahalanobis_squared",
    "pair_statistics",
    "subtract_nearest_whole",
]


ALL_NEIGHBOURS: Final = 4
"""Components up to which all neighbours of whole numbers are tried."""


def direction_cosines(azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> Reals:
    """Compute unit vectors (..., 3): cos el cos az, cos el sin az, sin el."""
    az_rad, el_rad = np.broadcast_arrays(np.asarray(azimuth_rad, np.float64), np.asarray(elevation_rad, np.float64))
    level = np.cos(el_rad)
    return np.stack((level * np.cos(az_rad), level * np.sin(az_rad), np.sin(el_rad)), axis=-1)


def hemisphere(count: int) -> Reals:
    """Generate directions (count, 3), spread evenly over the upper hemisphere.

    Heights have equal steps, azimuths turn by the golden angle (Gonzalez, Mathematical Geosciences 42, 2010).
    """
    k = np.arange(count)
    up = (k + 0.5) / count
    return direction_cosines(np.pi * (3.0 - np.sqrt(5.0)) * k, np.arcsin(up))


def mahalanobis_squared(vector: ArrayLike, covariance: ArrayLike) -> Reals:
    """Compute vector' covariance^-1 vector of (..., d) and (..., d, d).

    It is chi-square with d degrees for N(0, covariance).
    """
    return np.asarray(np.sum(_whiten(np.asarray(vector, np.float64), _whitener(covariance)) ** 2, axis=-1))


def subtract_nearest_whole(vector: ArrayLike, covariance: ArrayLike) -> tuple[Reals, Reals]:
    """Subtract the whole numbers that leave the least vector' covariance^-1 vector; also return that least.

    Each component is rounded and its neighbours tried: all 3^d up to `ALL_NEIGHBOURS` components. More components are
    taken for differences against one antenna; then the neighbours are those that rounding against each other antenna
    gives. The result is exact while standard deviations are small against one half. Then the least is chi-square with
    d degrees for N(0, covariance) plus any whole numbers. Unlike rounding alone, it does not depend on the reference
    antenna.

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
    white = _whiten(remainder, whitener)
    least = np.sum(white**2, axis=-1)
    choice = np.zeros(white.shape)
    for step in _neighbours(remainder):
        tried = np.sum((white - _whiten(step, whitener)) ** 2, axis=-1)
        better = tried < least
        least = np.where(better, tried, least)
        choice = np.where(better[..., None], step, choice)
    return remainder - choice, least


def _neighbours(remainder: Reals) -> Iterator[Reals]:
    """Yield whole numbers (..., d) or (d,) that may leave a smaller rest than zero does."""
    d = remainder.shape[-1]
    if d > ALL_NEIGHBOURS:
        yield from (np.rint(remainder - remainder[..., k : k + 1]) for k in range(d))
    else:
        yield from (np.array(step) for step in product((-1.0, 0.0, 1.0), repeat=d) if any(step))


def pair_statistics(values: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> Reals:
    """Compute the squared norm of every pair's difference: (..., n, n), chi-square with d degrees where equal.

    Parameters
    ----------
    values : (..., n, d) independent. covariance : (d, d) or (..., n, d, d). wrapped : values are known modulo 1.
    """
    values = np.asarray(values, np.float64)
    covariance = np.broadcast_to(np.asarray(covariance, np.float64), values.shape + values.shape[-1:])
    difference = values[..., :, None, :] - values[..., None, :, :]
    total = covariance[..., :, None, :, :] + covariance[..., None, :, :, :]
    return subtract_nearest_whole(difference, total)[1] if wrapped else mahalanobis_squared(difference, total)


def equal_statistic(values: ArrayLike, covariance: ArrayLike, *, wrapped: bool = False) -> tuple[Reals, Reals, Reals]:
    """Test if n vectors are equal, by the sum of squared norms about their weighted mean.

    It is chi-square with (n - 1) d degrees if so.

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
        values = first + subtract_nearest_whole(values - first, covariance + covariance[..., :1, :, :])[0]
    information = np.linalg.inv(covariance)
    of_mean = np.linalg.inv(information.sum(axis=-3))
    mean = np.einsum("...ab,...nbc,...nc->...a", of_mean, information, values)
    return mahalanobis_squared(values - mean[..., None, :], covariance).sum(axis=-1), mean, of_mean


def complete_linkage(distance: ArrayLike, limit: float) -> Indices:
    """Join clusters from the nearest pair on, in which no pair is farther apart than `limit`.

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
        first, second = np.divmod(nearest, n)
        trial = np.flatnonzero(apart[np.arange(len(nearest)), first, second] <= limit)
        if trial.size == 0:
            break
        kept, gone = np.minimum(first, second)[trial], np.maximum(first, second)[trial]
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
    """Find which of n vectors are equal.

    n equal vectors are all in one cluster with a probability of at least 1 - `false_alarm_probability`, by the union
    bound over their pairs. Nearly equal vectors among them may divide them more often, as one of them may be joined to
    such a neighbour first.

    Parameters
    ----------
    values, covariance, wrapped : as in `pair_statistics`.
    """
    values = np.asarray(values, np.float64)
    n, d = values.shape[-2:]
    limit = float(chi_square_threshold(false_alarm_probability / max(1, n * (n - 1) // 2), d))
    distance = pair_statistics(values, covariance, wrapped=wrapped)
    return Clusters(complete_linkage(distance, limit), distance, limit)


def equality_chance(design: Reals, covariance: Reals, limit: float, *, wrapped: bool = False) -> float:
    """Return the chance that a signal from anywhere above is taken for equal to another.

    It is the largest over the other's direction.

    It is computed over 32 directions of the other, and 8000 of the signal, spread evenly over the hemisphere.

    Parameters
    ----------
    design : (d, 3), the mean of a signal from u is design @ u. covariance : (d, d) of one signal. limit : of the pair.
    """
    design, covariance = np.ascontiguousarray(design, float), np.ascontiguousarray(covariance, float)
    return _equality_chance(design.tobytes(), covariance.tobytes(), limit, wrapped)


@lru_cache(maxsize=64)
def _equality_chance(design_bytes: bytes, covariance_bytes: bytes, limit: float, wrapped: bool) -> float:
    """Cache the chance, as a geometry recurs window after window and this takes a tenth of a second."""
    design = np.frombuffer(design_bytes).reshape(-1, 3)
    covariance = np.frombuffer(covariance_bytes).reshape(len(design), -1)
    means, references = hemisphere(8000) @ design.T, hemisphere(32) @ design.T
    shift = np.linspace(0.0, 2.0 * limit + 100.0, 2000)
    taken = 1.0 - noncentral_chi_square_survival(limit, len(design), shift)
    worst = 0.0
    for other in references:
        difference = means - other
        far = (
            subtract_nearest_whole(difference, 2.0 * covariance)[1]
            if wrapped
            else mahalanobis_squared(difference, 2.0 * covariance)
        )
        worst = max(worst, float(np.interp(far, shift, taken).mean()))
    return worst


def _whitener(covariance: ArrayLike) -> Reals:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(np.asarray(covariance, np.float64))), np.float64)


def _whiten(vector: Reals, whitener: Reals) -> Reals:
    if whitener.ndim == 2:
        return np.asarray(vector @ whitener.T)
    return np.asarray(np.matmul(whitener, vector[..., None])[..., 0])
