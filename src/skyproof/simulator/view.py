"""Compute the true sky at a moving point: exact ranges, an atmosphere that changes slowly, directions."""

import numpy as np
import scipy

from skyproof.arrays import Integers, Reals
from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Klobuchar
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import week_and_tow
from skyproof.simulator.motion import Motion
from skyproof.simulator.platforms import Point
from skyproof.simulator.ranges import Orbits, Sight
from skyproof.simulator.scenario import Scenario

__all__ = ["KNOT_S", "View", "compute_directions", "compute_patch_db", "find_when_above"]

KNOT_S = 1.0
"""Distance of the knots of what changes slowly: atmosphere, elevations. The only corner is the rim of the ionosphere
model's day, smoothed over 1 s."""
_PATCH_DB = 10.0


class View:
    """The true sky at a point that moves: exact ranges, and an atmosphere that changes slowly."""

    def __init__(
        self, point: Point, orbits: Orbits, knots_s: Reals, scenario: Scenario, ionosphere: Klobuchar | None
    ) -> None:
        self.point, self.orbits = point, orbits
        place_ecef_m = point(knots_s).position_ecef_m
        sight = self.orbits.compute_sight(knots_s, place_ecef_m)
        self.az_rad, self.el_rad = compute_directions(place_ecef_m, sight)
        lat_rad, lon_rad, height_m = (np.asarray(value)[:, np.newaxis] for value in geodetic_from_ecef(place_ecef_m))
        up_rad = np.maximum(self.el_rad, 0.0)  # the models end at the horizon
        troposphere_s, ionosphere_s = np.zeros(up_rad.shape), np.zeros(up_rad.shape)
        if scenario.sky.troposphere:
            troposphere_s = compute_troposphere_m(lat_rad, height_m, up_rad) / SPEED_OF_LIGHT_M_S
        if scenario.sky.ionosphere and ionosphere is not None:
            _, tow_s = week_and_tow(scenario.start_gpst)
            ionosphere_s = compute_klobuchar_s(
                ionosphere, lat_rad, lon_rad, self.az_rad, up_rad, tow_s + knots_s[:, np.newaxis]
            )
        air_s = np.stack([troposphere_s + ionosphere_s, troposphere_s - ionosphere_s], axis=1)
        self._air_s = scipy.interpolate.CubicSpline(knots_s, air_s)

    def delays_s(self, received_s: Reals, columns: Integers) -> tuple[Reals, Reals]:
        """Compute delays of code and carrier of the satellites in these columns, (n, n_columns) each."""
        return self.delays_from_s(received_s, self.point(received_s), columns)

    def delays_from_s(self, received_s: Reals, here: Motion, columns: Integers) -> tuple[Reals, Reals]:
        """Compute the same where the point's motion is known already."""
        sight = self.orbits.compute_sight(received_s, here.position_ecef_m, columns)
        air_s = self._air_s(received_s)[:, :, columns]
        vacuum_s = sight.flight_s - sight.clock_s
        return vacuum_s + air_s[:, 0], vacuum_s + air_s[:, 1]


def compute_directions(place_ecef_m: Reals, sight: Sight) -> tuple[Reals, Reals]:
    """Compute azimuth and elevation, (n, n_sats) each, rad."""
    lat_rad, lon_rad, _ = geodetic_from_ecef(place_ecef_m)
    enu = np.einsum("nij,nsj->nsi", rot_enu_ecef(lat_rad, lon_rad), sight.toward)
    return np.mod(np.arctan2(enu[..., 0], enu[..., 1]), 2.0 * np.pi), np.arcsin(np.clip(enu[..., 2], -1.0, 1.0))


def compute_patch_db(toward: Reals, place_ecef_m: Reals, attitude: Reals) -> Reals:
    """Compute what the body's tilt changes for directions (n, k, 3) in ECEF: dB, (n, k)."""
    lat_rad, lon_rad, _ = geodetic_from_ecef(place_ecef_m)
    up = rot_enu_ecef(lat_rad, lon_rad)[:, 2]
    body_up = -attitude[:, :, 2]
    return np.asarray(_PATCH_DB * np.einsum("nki,ni->nk", toward, body_up - up))


def find_when_above(el_rad: Reals, knots_s: Reals, mask_deg: float) -> tuple[float, float] | None:
    """Find the first and last moment above the mask, infinite where that is an end of the scene; None if never."""
    above = np.flatnonzero(el_rad >= np.radians(mask_deg))
    if above.size == 0:
        return None
    return (
        -np.inf if above[0] == 0 else float(knots_s[above[0]]),
        np.inf if above[-1] == knots_s.size - 1 else float(knots_s[above[-1]]),
    )
