import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.sky import compute_azimuth_elevation, compute_unit_vectors, rotate_to_reception

LAT_RAD, LON_RAD = np.radians(59.4), np.radians(16.9)
RX_M = ecef_from_geodetic(LAT_RAD, LON_RAD, 100.0)


def place_at(az_rad, el_rad, range_m=2.2e7):
    az_rad, el_rad = np.broadcast_arrays(az_rad, el_rad)
    enu = np.stack([np.cos(el_rad) * np.sin(az_rad), np.cos(el_rad) * np.cos(az_rad), np.sin(el_rad)], axis=-1)
    return RX_M + range_m * enu @ rot_enu_ecef(LAT_RAD, LON_RAD)


@given(st.floats(0.0, 6.28), st.floats(-1.5, 1.5))
def test_a_satellite_is_seen_where_it_was_put(az_rad, el_rad):
    az_seen_rad, el_seen_rad = compute_azimuth_elevation(RX_M, place_at(az_rad, el_rad))
    assert abs((az_seen_rad - az_rad + np.pi) % (2.0 * np.pi) - np.pi) < 1e-12
    assert abs(el_seen_rad - el_rad) < 1e-13


def test_azimuth_runs_from_north_over_east():
    az_rad, el_rad = compute_azimuth_elevation(RX_M, RX_M + rot_enu_ecef(LAT_RAD, LON_RAD) * 1e4)  # east, north, up
    np.testing.assert_allclose(np.exp(1j * az_rad[:2]), [1j, 1.0], atol=1e-12)
    np.testing.assert_allclose(el_rad, [0.0, 0.0, np.pi / 2], atol=1e-7)
    np.testing.assert_allclose(compute_azimuth_elevation(RX_M, place_at(-1e-3, 0.5))[0], 2.0 * np.pi - 1e-3, atol=1e-12)


def test_receivers_and_satellites_broadcast():
    rx_m = np.stack([RX_M, -RX_M])[:, None, :]
    sat_m = place_at(np.linspace(0.0, 6.0, 5), 0.7)
    az_rad, el_rad = compute_azimuth_elevation(rx_m, sat_m)
    assert az_rad.shape == el_rad.shape == (2, 5)
    assert compute_unit_vectors(rx_m, sat_m).shape == (2, 5, 3)
    assert (el_rad[1] < 0.0).all()


def test_unit_vectors_point_to_the_satellite():
    sat_m = place_at(1.0, 0.5)
    los = compute_unit_vectors(RX_M, sat_m)
    assert abs(np.linalg.norm(los) - 1.0) < 1e-15
    np.testing.assert_allclose(RX_M + 2.2e7 * los, sat_m, atol=1e-6)


def test_the_earth_turns_while_the_signal_travels():
    sat_m = place_at(np.array([1.5, 4.7]), np.array([0.3, 0.3]))  # in the east and in the west
    travel_s = np.linalg.norm(sat_m - RX_M, axis=-1) / SPEED_OF_LIGHT_M_S
    turned_m = rotate_to_reception(sat_m, travel_s)
    # Sagnac correction to first order: Misra and Enge, Global Positioning System, 2nd edition, section 5.1.
    sagnac_m = EARTH_ROTATION_RAD_S / SPEED_OF_LIGHT_M_S * (sat_m[:, 0] * RX_M[1] - sat_m[:, 1] * RX_M[0])
    change_m = np.linalg.norm(turned_m - RX_M, axis=-1) - np.linalg.norm(sat_m - RX_M, axis=-1)
    np.testing.assert_allclose(change_m, sagnac_m, atol=1e-3)
    assert change_m[0] < -10.0 < 10.0 < change_m[1]  # the receiver turns eastwards
    np.testing.assert_array_equal(turned_m[:, 2], sat_m[:, 2])
    np.testing.assert_allclose(rotate_to_reception(turned_m, -travel_s), sat_m, atol=1e-8)
