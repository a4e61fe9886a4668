"""Normal gravity against the published constants of WGS-84 and against what defines it."""

import numpy as np
import pytest

from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.gravity import compute_gravity_m_s2

LAT_RAD = np.radians(np.array([-90.0, -61.0, -30.0, 0.0, 15.0, 45.0, 80.0, 90.0]))


def compute_local_m_s2(lat_rad, lon_rad, height_m):
    gravity = compute_gravity_m_s2(ecef_from_geodetic(lat_rad, lon_rad, height_m))
    return np.einsum("...ij,...j->...i", rot_enu_ecef(lat_rad, lon_rad), gravity)


def test_golden_at_equator_and_poles():
    # NGA.STND.0036_1.0.0_WGS84, table 3.6: 9.7803253359 and 9.8321849378 m/s^2
    assert compute_local_m_s2(0.0, 0.3, 0.0)[2] == pytest.approx(-9.7803253359, abs=1.5e-9)
    for pole in (0.5, -0.5):
        assert compute_local_m_s2(pole * np.pi, 0.0, 0.0)[2] == pytest.approx(-9.8321849378, abs=3e-9)


def test_on_the_ellipsoid_it_is_somiglianas_and_normal():
    e2 = 6.69437999014e-3  # the same document, table 3.5; k = 1.931852652458e-3
    sin2 = np.sin(LAT_RAD) ** 2
    somigliana = 9.7803253359 * (1.0 + 1.931852652458e-3 * sin2) / np.sqrt(1.0 - e2 * sin2)
    got = compute_local_m_s2(LAT_RAD, 2.0, 0.0)
    np.testing.assert_allclose(-got[:, 2], somigliana, atol=3e-9)
    np.testing.assert_allclose(got[:, :2], 0.0, atol=1e-12)


@pytest.mark.parametrize("height_m", [-400.0, 0.0, 9000.0, 500_000.0])
def test_it_has_no_curl_and_the_divergence_of_rotation(height_m):
    place = ecef_from_geodetic(0.7, -1.1, height_m)
    step_m = 50.0
    steps = step_m * np.eye(3)
    slope = (compute_gravity_m_s2(place + steps) - compute_gravity_m_s2(place - steps)) / (2.0 * step_m)
    np.testing.assert_allclose(slope, slope.T, atol=1e-13)
    assert np.trace(slope) == pytest.approx(2.0 * 7.292115e-5**2, abs=1e-13)


def test_far_away_it_is_a_point_mass_plus_rotation():
    place = np.array([3e8, 2e8, 1e8])
    distance_m = np.linalg.norm(place)
    want = -3.986004418e14 * place / distance_m**3 + 7.292115e-5**2 * place * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(
        compute_gravity_m_s2(place), want, atol=2e-8
    )  # its oblateness, 1e-3 (a / r)^2, and no more


def test_leading_axes_are_free_and_the_axis_itself_is_no_trouble():
    places = ecef_from_geodetic(LAT_RAD.reshape(2, 4), 0.4, 100.0)
    assert compute_gravity_m_s2(places).shape == (2, 4, 3)
    north = compute_gravity_m_s2([0.0, 0.0, 6.36e6])
    assert (north[:2] == 0.0).all()
    assert north[2] < -9.8
