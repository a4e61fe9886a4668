"""Strapdown: error-free readings lead back to where they were made; Euler rates, true and as printed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.time import GPS_EPOCH, seconds_between
from skyproof.navigation.strapdown import navigate, navigate_paths
from skyproof.records import ImuSeries, NavState
from skyproof.simulator.inertial import simulate_inertial
from skyproof.simulator.trajectories import make_circle, make_las_vegas, make_way_points


def take_first(motion):
    return NavState(
        gpst=np.array([GPS_EPOCH]),
        position_ecef_m=motion.position_ecef_m[:1],
        velocity_ecef_m_s=motion.velocity_ecef_m_s[:1],
        attitude=motion.attitude[:1],
    )


def make_corners():
    """Make a course with banked turns, 100 m/s at 6 m/s^2 to the side."""
    lat = np.radians([36.0, 36.05, 36.05, 36.1, 36.1, 36.2])
    lon = np.radians([-115.2, -115.2, -115.12, -115.12, -115.2, -115.2])
    points = ecef_from_geodetic(lat, lon, np.array([1000.0, 1000.0, 1300.0, 1300.0, 1000.0, 1000.0]))
    return make_way_points(points, 100.0, lateral_m_s2=6.0, from_rest=False, to_rest=False)


ROUND = make_circle(ecef_from_geodetic(0.6, -2.0, 500.0), 500.0, 50.0)


@pytest.mark.parametrize(
    ("trajectory", "rate_hz", "within_m"),
    [
        (make_las_vegas(), 100.0, 1e-3),
        (make_las_vegas(), 10.0, 1e-3),
        (ROUND, 10.0, 1e-3),
        (ROUND, 100.0, 1e-3),
        (make_corners(), 100.0, 3e-3),
    ],
)
def test_error_free_readings_return_233_s_to_millimetres(trajectory, rate_hz, within_m):
    unit = simulate_inertial(trajectory.at, rate_hz=rate_hz, duration_s=233.0)
    found = navigate(take_first(trajectory.at([0.0])), unit.read(0, unit.n_samples))
    time_s = seconds_between(found.gpst, GPS_EPOCH)
    truth = trajectory.at(time_s)
    assert time_s[-1] == 233.0
    assert np.abs(found.position_ecef_m - truth.position_ecef_m).max() < within_m
    assert np.abs(found.attitude - truth.attitude).max() < 1e-7
    assert np.abs(found.velocity_ecef_m_s - truth.velocity_ecef_m_s).max() < 1e-4


def test_a_run_in_pieces_gives_the_whole():
    unit = simulate_inertial(ROUND.at, rate_hz=50.0, duration_s=20.0)
    whole = navigate(take_first(ROUND.at([0.0])), unit.read(0, 1000))
    half = navigate(take_first(ROUND.at([0.0])), unit.read(0, 500))
    rest = navigate(half, unit.read(500, 500))
    assert np.abs(rest.position_ecef_m[-1] - whole.position_ecef_m[-1]).max() < 1e-5
    assert rest.gpst[0] == half.gpst[-1]


def test_coning_is_taken_from_two_intervals():
    # A body whose axis nods in a circle turns in the mean by less than its mean rate: the classical coning drift.
    rate_hz, nod_rad, turn_rad_s = 100.0, 0.02, 2.0 * np.pi * 3.0
    fine = np.arange(0, 100_001) * 1e-4
    attitude = Rotation.from_rotvec(
        nod_rad * np.stack((np.cos(turn_rad_s * fine), np.sin(turn_rad_s * fine), 0.0 * fine), axis=1)
    )
    small = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    angle = small.reshape(1000, 100, 3).sum(axis=1)
    earth = np.array([0.0, 0.0, 7.2921151467e-5])
    turning = attitude[:-1].inv().apply(earth).reshape(1000, 100, 3).mean(axis=1)
    start = ecef_from_geodetic(0.0, 0.0, 0.0)
    _, _, found = navigate_paths(
        start, np.zeros(3), attitude[0].as_matrix(), np.zeros((1000, 3)), angle * rate_hz + turning, 1.0 / rate_hz
    )
    apart = Rotation.from_matrix(found[-1]) * attitude[-1].inv()
    drift_without = 0.5 * nod_rad**2 * turn_rad_s * (1 - np.sinc(3.0 / rate_hz * 2)) * 10.0
    assert apart.magnitude() < 0.05 * drift_without


def test_many_units_at_once_are_each_as_alone():
    unit = simulate_inertial(ROUND.at, rate_hz=20.0, duration_s=10.0)
    series = unit.read(0, 200)
    rng = np.random.default_rng(1)
    force = series.specific_force_m_s2 + 0.01 * rng.standard_normal((2, 3, 200, 3))
    start = take_first(ROUND.at([0.0]))
    places, _, attitudes = navigate_paths(
        start.position_ecef_m[0], start.velocity_ecef_m_s[0], start.attitude[0], force, series.angular_rate_rad_s, 0.05
    )
    assert places.shape == (2, 3, 201, 3)
    assert attitudes.shape == (2, 3, 201, 3, 3)
    alone = navigate(
        start,
        ImuSeries(
            gpst=series.gpst,
            interval_s=0.05,
            specific_force_m_s2=force[1, 2],
            angular_rate_rad_s=series.angular_rate_rad_s,
        ),
    )
    assert np.array_equal(alone.position_ecef_m, places[1, 2])
