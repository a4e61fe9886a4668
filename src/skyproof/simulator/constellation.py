"""Choose a scene's satellites: those of a navigation file, those in stated directions, or the nominal ones.

All are ephemerides, so that signals, messages and the navigation file that is written beside them state the same.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, GPS_PI, MU_M3_S2, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris, NavigationData
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.lnav import quantise
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import prn_of
from skyproof.gnss.sky import rotate_to_reception
from skyproof.gnss.time import gpst, seconds_between
from skyproof.simulator.platforms import make_trajectory
from skyproof.simulator.scenario import SatelliteDirection, Scenario

__all__ = ["make_navigation"]

_STEEPEST_RAD: Final = 1.19  # receivers take a message of 1.2 and more for damaged: no GPS satellite flies so


def make_navigation(scenario: Scenario) -> NavigationData:
    """Read or make the orbits, clocks and ionosphere of a scene: the one place that decides.

    Its navigation file if it names one; satellites in `sky.directions` if it gives them; else the nominal
    constellation.

    Raises
    ------
    InputError : the navigation file cannot be read.
    ScenarioError : a direction where no GPS satellite comes.
    """
    if scenario.navigation is not None:
        return read_nav(scenario.navigation)
    nominal = make_nominal_constellation(scenario.start_gpst)
    if scenario.sky.directions is None:
        return nominal
    here_ecef_m = make_trajectory(scenario.receivers[0], "receivers[0]").at([0.0]).position_ecef_m[0]
    templates = [eph for eph in nominal.ephemerides if isinstance(eph, Ephemeris)]
    ephemerides = []
    for number, direction in enumerate(scenario.sky.directions):
        template = templates[(prn_of(direction.sat) - 1) % len(templates)]
        eph = _place_satellite(direction, here_ecef_m, scenario.start_gpst, replace(template, sat=direction.sat))
        if eph.i0 > _STEEPEST_RAD:
            raise ScenarioError(
                f"sky.directions[{number}]: {direction.sat} would stand over latitude {np.degrees(eph.i0):.1f} "
                f"degrees, where GPS satellites never come (at most {np.degrees(_STEEPEST_RAD):.1f} here); give "
                "another direction"
            )
        ephemerides.append(quantise(eph))
    return replace(nominal, ephemerides=tuple(ephemerides), source="satellites in given directions")


def _place_satellite(
    direction: SatelliteDirection, here_ecef_m: Reals, start_gpst: np.datetime64, like: Ephemeris
) -> Ephemeris:
    """Make an ephemeris whose wave that arrives at `start_gpst` comes from the direction.

    The orbit is a circle of the nominal radius and inclination. It is steeper where the satellite stands over a higher
    latitude, whose northernmost or southernmost point it then passes. `like` gives the clock and the common values.
    """
    lat_rad, lon_rad, _ = geodetic_from_ecef(here_ecef_m)
    az_rad, el_rad = np.radians([direction.az_deg, direction.el_deg])
    enu = np.array([np.cos(el_rad) * np.sin(az_rad), np.cos(el_rad) * np.cos(az_rad), np.sin(el_rad)])
    toward = enu @ rot_enu_ecef(lat_rad, lon_rad)
    radius_m = like.sqrt_a**2
    along_m = float(toward @ here_ecef_m)
    range_m = np.sqrt(along_m**2 + radius_m**2 - here_ecef_m @ here_ecef_m) - along_m
    travel_s = float(range_m / SPEED_OF_LIGHT_M_S)
    x_m, y_m, z_m = rotate_to_reception(here_ecef_m + range_m * toward, -travel_s)  # as it stood at transmission

    sine_of_lat = z_m / radius_m
    i0 = max(like.i0, float(np.arcsin(abs(sine_of_lat))))
    u = np.arcsin(np.clip(sine_of_lat / np.sin(i0), -1.0, 1.0))
    if direction.descending:
        u = np.pi - u
    node_ecef_rad = np.arctan2(y_m, x_m) - np.arctan2(np.sin(u) * np.cos(i0), np.cos(u))
    since_toe_s = float(seconds_between(start_gpst, gpst(like.week, like.toe))) - travel_s
    motion_rad_s = np.sqrt(MU_M3_S2 / radius_m**3) + like.delta_n
    turned_rad = (like.omega_dot - EARTH_ROTATION_RAD_S) * since_toe_s - EARTH_ROTATION_RAD_S * like.toe
    return replace(
        like,
        e=0.0,
        omega=0.0,
        i0=i0,
        m0=_wrap(float(u) - motion_rad_s * since_toe_s),
        omega0=_wrap(float(node_ecef_rad) - turned_rad),
    )


def _wrap(angle_rad: float) -> float:
    """Wrap an angle to -pi .. pi less one step, which is what the message holds."""
    return float(np.clip((angle_rad + np.pi) % (2.0 * np.pi) - np.pi, -GPS_PI, GPS_PI * (1.0 - 2.0**-31)))
