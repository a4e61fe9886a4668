"""A slow twin of the scenes' delays: each instant independently, from the orbits and the models, without any curve."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris, NavigationData
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation, rotate_to_reception
from skyproof.gnss.time import week_and_tow
from skyproof.simulator.sites import ScenePlace


@dataclass(frozen=True, eq=False, kw_only=True)
class Delays:
    """One satellite at one place: arrays of one shape (...), over time."""

    code_s: Reals
    carrier_s: Reals
    range_m: Reals
    az_rad: Reals
    el_rad: Reals


def compute_delays(
    place: ScenePlace, ephemeris: Ephemeris, navigation: NavigationData, start_gpst: np.datetime64, true_s: ArrayLike
) -> Delays:
    """Compute delays of one satellite's signal at a place that stands still, at true times (...) of reception.

    The satellite clock of an L1 C/A user is the message's minus the group delay (IS-GPS-200N, 20.3.3.3.3.2); the
    carrier is coherent with the code at the satellite, so the ionosphere alone parts them.
    """
    week, tow_s = week_and_tow(start_gpst)
    lat_rad, lon_rad, height_m = place.geodetic_rad
    rx_ecef_m = ecef_from_geodetic(*place.geodetic_rad)
    received_s = tow_s + np.asarray(true_s, np.float64)
    travel_s = np.full(received_s.shape, 0.075)
    for _ in range(4):  # each round shrinks the error by the satellite's speed over that of light, 1e-5
        state = compute_satellite_state_s(ephemeris, week, received_s - travel_s)
        sat_ecef_m = rotate_to_reception(state.position_ecef_m, travel_s)
        range_m = np.linalg.norm(sat_ecef_m - rx_ecef_m, axis=-1)
        travel_s = range_m / SPEED_OF_LIGHT_M_S
    az_rad, el_rad = compute_azimuth_elevation(rx_ecef_m, sat_ecef_m)
    up_rad = np.maximum(el_rad, 0.0)  # the models end at the horizon
    troposphere_s = compute_troposphere_m(lat_rad, height_m, up_rad) / SPEED_OF_LIGHT_M_S
    klobuchar = navigation.ionosphere
    ionosphere_s = (
        compute_klobuchar_s(klobuchar, lat_rad, lon_rad, az_rad, up_rad, received_s)
        if klobuchar is not None
        else np.zeros_like(travel_s)
    )
    common_s = travel_s + troposphere_s - (state.clock_s - ephemeris.tgd)
    return Delays(
        code_s=common_s + ionosphere_s,
        carrier_s=common_s - ionosphere_s,
        range_m=np.asarray(range_m),
        az_rad=az_rad,
        el_rad=el_rad,
    )
