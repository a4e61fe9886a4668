"""The elevation mask: what stands low is left out, what stands where nothing is received from is not."""

import numpy as np

from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.navigation.elevation_mask import RECEIVED_FROM_DEG, find_low

PLACE = 0.9, 0.2, 100.0


def place_at_elevation(degrees):
    """Place points 22 000 km to the north of a place, at these elevations."""
    el = np.radians(degrees)
    enu_m = 2.2e7 * np.column_stack([np.zeros(el.size), np.cos(el), np.sin(el)])
    return ecef_from_geodetic(*PLACE) + enu_m @ rot_enu_ecef(*PLACE[:2])


def test_satellites_between_horizon_and_mask_are_low():
    elevations_deg = np.array([-30.0, RECEIVED_FROM_DEG - 0.1, RECEIVED_FROM_DEG + 0.1, 1.7, 9.9, 10.1, 80.0])
    low = find_low(ecef_from_geodetic(*PLACE), place_at_elevation(elevations_deg), 10.0)
    assert low.tolist() == [False, False, True, True, True, False, False]
