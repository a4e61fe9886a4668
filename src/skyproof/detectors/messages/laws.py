"""Measure how far two broadcast data sets of one satellite differ, and how improbable that is.

Model. The error of a data set, as ranges see it, is normal with the accuracy that the message states (IS-GPS-200N,
20.3.3.3.1.3: user range accuracy, one sigma). Two data sets that both serve at an instant differ there by the two
errors at most. So their difference over the root of the sum of squares exceeds a value no more often than a normal
number does.

The weights that turn a difference of place and clock into one of ranges are those of O. Montenbruck, P. Steigenberger
and A. Hauschild, "Multi-GNSS signal-in-space range error assessment", Advances in Space Research 61(12), 2018. The
radial part counts in full, the parts along and across by the square root of 1/49 for GPS, less for the others.
"""

import math
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.messages.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.lnav import URA_M
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.time import seconds_between
from skyproof.statistics.distributions import normal_two_sided

__all__ = [
    "accuracy_sigma_m",
    "chance_of_difference",
    "differences_m",
    "lowest_elevation_rad",
    "range_difference_m",
    "serve_together",
]

_EARTH_M: Final = 6.371e6


def serve_together(first: Ephemeris, second: Ephemeris) -> bool:
    """Tell whether two data sets belong to one message of one satellite, and both serve between their times."""
    same = first.sat == second.sat and first.message == second.message
    return same and abs(float(seconds_between(first.reference_gpst, second.reference_gpst))) <= POLICY.valid_together_s


def range_difference_m(first: Ephemeris, second: Ephemeris) -> float:
    """Return by how much ranges from two data sets differ, in the middle between their times, metres."""
    begin, end = first.reference_gpst, second.reference_gpst
    radial_m, sideways_m, clock_m = differences_m(first, second, begin + (end - begin) // 2)
    return math.hypot(radial_m - clock_m, POLICY.sideways_share * sideways_m)


def differences_m(first: Ephemeris, second: Ephemeris, gpst: np.datetime64) -> tuple[float, float, float]:
    """Return by how much two data sets differ at an instant: upwards, along and across together, and by the clock."""
    state, other = (compute_satellite_state(each, gpst) for each in (first, second))
    apart_m = state.position_ecef_m - other.position_ecef_m
    up = state.position_ecef_m / np.linalg.norm(state.position_ecef_m)
    radial_m = float(apart_m @ up)
    sideways_m = float(np.linalg.norm(apart_m - radial_m * up))
    return radial_m, sideways_m, SPEED_OF_LIGHT_M_S * float(state.clock_s - other.clock_s)


def chance_of_difference(first: Ephemeris, second: Ephemeris) -> float | None:
    """Return the chance of data sets that differ at least so; None where one of them promises no accuracy."""
    sigma_m = accuracy_sigma_m(first, second)
    return None if sigma_m is None else float(normal_two_sided(range_difference_m(first, second) / sigma_m))


def accuracy_sigma_m(first: Ephemeris, second: Ephemeris) -> float | None:
    """Return the sigma of a difference by the accuracies of two data sets; None if one of them states none."""
    if not all(0 <= e.ura_index < len(URA_M) for e in (first, second)):
        return None
    return math.hypot(URA_M[first.ura_index], URA_M[second.ura_index])


def lowest_elevation_rad(place_ecef_m: Reals) -> float:
    """Return the elevation below which no satellite is received at a place (3,): below the horizon, with a margin."""
    height_m = max(float(geodetic_from_ecef(place_ecef_m)[2]), 0.0)
    return -math.acos(_EARTH_M / (_EARTH_M + height_m)) - math.radians(POLICY.below_horizon_deg)
