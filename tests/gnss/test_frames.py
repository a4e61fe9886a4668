"""Golden position: an independent program's, given with the rendered pair of recordings (truth.json, 0.1 mm)."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.constants import WGS84_A_M
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef

LATITUDES = st.floats(-np.pi / 2, np.pi / 2)
LONGITUDES = st.floats(-np.pi, np.pi)
HEIGHTS = st.floats(-12e3, 4e7)


def test_a_known_place_has_its_known_position():
    ecef_m = ecef_from_geodetic(np.radians(59.4121), np.radians(16.8837), 31.0)
    np.testing.assert_allclose(ecef_m, [3113427.3381, 944964.1381, 5467465.2304], atol=1e-4)


def test_pole_and_equator_stand_on_the_axes_of_the_ellipsoid():
    np.testing.assert_allclose(ecef_from_geodetic(0.0, 0.0, 0.0), [WGS84_A_M, 0.0, 0.0], atol=1e-9)
    # Semi-minor axis 6 356 752.3142 m: NGA.STND.0036_1.0.0_WGS84, table 3.4.
    np.testing.assert_allclose(ecef_from_geodetic(np.pi / 2, 0.0, 10.0), [0.0, 0.0, 6356762.3142], atol=1e-4)
    np.testing.assert_allclose(geodetic_from_ecef([0.0, 0.0, -6356752.3142]), (-np.pi / 2, 0.0, 0.0), atol=1e-4)


@given(LATITUDES, LONGITUDES, HEIGHTS)
def test_geodetic_to_ecef_and_back_is_the_same_place(lat_rad, lon_rad, height_m):
    ecef_m = ecef_from_geodetic(lat_rad, lon_rad, height_m)
    back_lat_rad, back_lon_rad, back_height_m = geodetic_from_ecef(ecef_m)
    assert abs(back_lat_rad - lat_rad) < 1e-14  # 60 nm on the ground
    assert abs(back_height_m - height_m) < 2e-8  # rounding of 4e7 m
    np.testing.assert_allclose(ecef_from_geodetic(back_lat_rad, back_lon_rad, back_height_m), ecef_m, atol=2e-7)


@given(LATITUDES, LONGITUDES)
def test_east_north_up_is_a_right_handed_rotation(lat_rad, lon_rad):
    rot = rot_enu_ecef(lat_rad, lon_rad)
    np.testing.assert_allclose(rot @ rot.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rot) > 0.0
    here_m = ecef_from_geodetic(lat_rad, lon_rad, 100.0)
    np.testing.assert_allclose(rot @ (ecef_from_geodetic(lat_rad, lon_rad, 101.0) - here_m), [0, 0, 1], atol=1e-8)
    step_rad = 1e-7  # about 0.6 m
    north_m = rot @ (ecef_from_geodetic(lat_rad + step_rad, lon_rad, 100.0) - here_m)
    assert north_m[1] > 0.6
    assert abs(north_m[0]) < 1e-6
    east_m = rot @ (ecef_from_geodetic(lat_rad, lon_rad + step_rad, 100.0) - here_m)
    assert east_m[0] > 0.6 * np.cos(lat_rad) - 1e-6
    assert abs(east_m[1]) < 1e-6


def test_leading_axes_broadcast():
    lat_rad, lon_rad = np.linspace(-1.5, 1.5, 4)[:, None], np.linspace(-3.0, 3.0, 5)
    ecef_m = ecef_from_geodetic(lat_rad, lon_rad, 0.0)
    assert ecef_m.shape == (4, 5, 3)
    assert rot_enu_ecef(lat_rad, lon_rad).shape == (4, 5, 3, 3)
    back_lat_rad, back_lon_rad, back_height_m = geodetic_from_ecef(ecef_m)
    np.testing.assert_allclose(back_lat_rad, np.broadcast_to(lat_rad, (4, 5)), atol=1e-14)
    np.testing.assert_allclose(back_lon_rad, np.broadcast_to(lon_rad, (4, 5)), atol=1e-14)
    np.testing.assert_allclose(back_height_m, 0.0, atol=1e-8)
