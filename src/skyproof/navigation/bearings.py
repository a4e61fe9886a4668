"""Locate a transmitter from directions at several places, or from one place that moves.

A ray begins at a known place and has a direction with a covariance across it. The transmitter is where the angles at
all places are off least (bearings-only location by least squares: Torrieri, "Statistical theory of passive location
systems", IEEE Transactions on Aerospace and Electronic Systems 20(2), 1984).

Rays from one body share most of their errors: its attitude, its antennas. How much is not known, so that no averaging
is assumed. Correlated errors of n rays of one body make the covariance at most n times that of independent ones
(Cauchy-Schwarz). The same holds for the residual sum of squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.records import freeze
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["BearingRay", "Meeting", "locate_transmitter"]

_MOST_STEPS: Final = 30
_CONVERGED: Final = 1e-6  # of the distance
_CLEAR: Final = 0.35  # one sigma of the distance over the distance, beyond which rays do not meet anywhere to speak of
_NEAREST_M: Final = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class BearingRay:
    """A direction from a place.

    place_ecef_m : (3,). place_covariance_m2 : (3, 3). azimuth_rad, elevation_rad : from north by east, above the
    horizon. covariance_rad2 : (2, 2) along the horizon to where the azimuth grows, and upwards. body : what carries the
    antennas: errors of its rays may be the same.
    """

    place_ecef_m: Reals
    place_covariance_m2: Reals
    azimuth_rad: float
    elevation_rad: float
    covariance_rad2: Reals
    body: str

    def __post_init__(self) -> None:
        freeze(
            self,
            {"place_ecef_m": ("3",), "place_covariance_m2": ("3", "3"), "covariance_rad2": ("2", "2")},
        )

    @property
    def axes(self) -> Reals:
        """Return unit vectors (3, 3) in ECEF: the direction, along the horizon, and upwards across it."""
        lat, lon, _ = geodetic_from_ecef(self.place_ecef_m)
        (sin_az, sin_el), (cos_az, cos_el) = (f([self.azimuth_rad, self.elevation_rad]) for f in (np.sin, np.cos))
        enu = [
            [sin_az * cos_el, cos_az * cos_el, sin_el],
            [cos_az, -sin_az, 0.0],
            [-sin_az * sin_el, -cos_az * sin_el, cos_el],
        ]
        return np.asarray(np.array(enu) @ rot_enu_ecef(lat, lon))


@dataclass(frozen=True, eq=False, kw_only=True)
class Meeting:
    """A place (3,) in ECEF with covariance (3, 3); p_value : that all rays come from there, not too small."""

    position_ecef_m: Reals
    covariance_m2: Reals
    p_value: float

    def __post_init__(self) -> None:
        freeze(self, {"position_ecef_m": ("3",), "covariance_m2": ("3", "3")})


def locate_transmitter(rays: Sequence[BearingRay]) -> Meeting | None:
    """Find the place where rays meet; None for fewer than two, diverging, or nearly parallel rays."""
    if len(rays) < 2:
        return None
    places = np.array([ray.place_ecef_m for ray in rays])
    axes = np.array([ray.axes for ray in rays])
    place_m = _find_nearest_point(places, axes[:, 0])
    if place_m is None:
        return None
    for _ in range(_MOST_STEPS):
        away_m, off, design, weight = _linearize_rays(rays, places, axes, place_m)
        information = np.einsum("kai,kab,kbj->ij", design, weight, design)
        if np.linalg.cond(information) > 1e12:
            return None
        step_m = np.linalg.solve(information, np.einsum("kai,kab,kb->i", design, weight, off))
        place_m = place_m - step_m
        if np.linalg.norm(step_m) < _CONVERGED * away_m.min():
            break
    away_m, off, design, weight = _linearize_rays(rays, places, axes, place_m)
    if away_m.min() <= _NEAREST_M:
        return None
    shared = max(sum(other.body == ray.body for other in rays) for ray in rays)
    covariance = shared * np.linalg.inv(np.einsum("kai,kab,kbj->ij", design, weight, design))
    if np.sqrt(np.linalg.eigvalsh(covariance).max()) > _CLEAR * away_m.min():
        return None
    statistic = float(np.einsum("ka,kab,kb->", off, weight, off)) / shared
    return Meeting(
        position_ecef_m=place_m,
        covariance_m2=covariance,
        p_value=float(chi_square_survival(statistic, 2 * len(rays) - 3)),
    )


def _find_nearest_point(places: Reals, towards: Reals) -> Reals | None:
    """Find the point (3,) least far from the lines of all rays; None if they are all parallel."""
    across = np.eye(3) - towards[:, :, None] * towards[:, None, :]
    normal = across.sum(axis=0)
    if np.linalg.cond(normal) > 1e10:
        return None
    middle = places.mean(axis=0)  # for the digits
    return np.asarray(middle + np.linalg.solve(normal, np.einsum("kij,kj->i", across, places - middle)))


def _linearize_rays(
    rays: Sequence[BearingRay], places: Reals, axes: Reals, place_m: Reals
) -> tuple[Reals, Reals, Reals, Reals]:
    """Linearize every ray about a point.

    Returns how far along each ray the point lies (negative behind), the angles (k, 2) by which it is off, their
    derivatives (k, 2, 3), and their information (k, 2, 2).
    """
    to_point = place_m - places
    along_m = np.einsum("ki,ki->k", axes[:, 0], to_point)
    reach_m = np.maximum(np.linalg.norm(to_point, axis=1), _NEAREST_M)
    off = np.einsum("kai,ki->ka", axes[:, 1:], to_point) / reach_m[:, None]
    design = axes[:, 1:] / reach_m[:, None, None]
    moved = np.array([ray.place_covariance_m2 for ray in rays])
    total = np.array([ray.covariance_rad2 for ray in rays]) + np.einsum("kai,kij,kbj->kab", design, moved, design)
    return along_m, off, design, np.linalg.inv(total)
