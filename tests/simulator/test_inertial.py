"""Inertial units: error-free readings lead back to the trajectory; errors have the law that their grade says."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from skyproof.errors import ScenarioError
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.gravity import compute_gravity_m_s2
from skyproof.gnss.imu_grades import GRADES, ImuGrade
from skyproof.gnss.time import GPS_EPOCH, seconds_between
from skyproof.simulator.inertial import (
    BLOCK,
    ImuErrors,
    compute_accelerometer_allan_m_s2,
    compute_gyro_allan_rad_s,
    simulate_inertial,
)
from skyproof.simulator.trajectories import make_las_vegas, make_way_points
from skyproof.statistics.allan import allan_deviation

EARTH_RAD_S = 7.2921151467e-5
LAT_RAD, LON_RAD = np.radians(36.0), np.radians(-115.2)
ORIGIN_M = ecef_from_geodetic(LAT_RAD, LON_RAD, 1500.0)
TO_ECEF = rot_enu_ecef(LAT_RAD, LON_RAD).T


@dataclass(frozen=True)
class Motion:
    position_ecef_m: np.ndarray
    velocity_ecef_m_s: np.ndarray
    acceleration_ecef_m_s2: np.ndarray
    attitude: np.ndarray
    angular_rate_body_rad_s: np.ndarray


def count_seconds(series):
    """Count seconds since the scene's start."""
    return seconds_between(series.gpst, GPS_EPOCH)


def make_motion(path, angles):
    """Make a motion of east, north, up (3, 3, n) and yaw, pitch, roll (2, 3, n), with their derivatives."""
    position, velocity, acceleration = (each.T @ TO_ECEF.T for each in path)
    (yaw, pitch, roll), (yaw_rate, pitch_rate, roll_rate) = angles
    attitude = TO_ECEF @ Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=-1)).as_matrix()
    rate = np.stack(
        [
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * np.cos(roll) + yaw_rate * np.sin(roll) * np.cos(pitch),
            -pitch_rate * np.sin(roll) + yaw_rate * np.cos(roll) * np.cos(pitch),
        ],
        axis=-1,
    )
    return Motion(ORIGIN_M + position, velocity, acceleration, attitude, rate)


def make_wave(amplitude, rate_rad_s, phase_rad, t_s):
    """Return a sine and its first two derivatives."""
    angle = rate_rad_s * t_s + phase_rad
    return amplitude * np.stack([np.sin(angle), rate_rad_s * np.cos(angle), -(rate_rad_s**2) * np.sin(angle)])


def make_static(t_s):
    return make_motion(np.zeros((3, 3, t_s.size)), np.zeros((2, 3, t_s.size)) + [[[0.7], [0.1], [-0.2]], [[0]] * 3])


def make_turntable(t_s):
    """Make a level body that stands and turns about the down axis ever faster."""
    angles = np.zeros((2, 3, t_s.size))
    angles[0, 0], angles[1, 0] = 0.5 * 0.02 * t_s**2, 0.02 * t_s
    return make_motion(np.zeros((3, 3, t_s.size)), angles)


def make_circle(t_s):
    path = np.stack(
        [make_wave(500.0, 0.1, 0.5 * np.pi, t_s), make_wave(500.0, 0.1, 0.0, t_s), 0.0 * make_wave(1, 1, 0, t_s)],
        axis=1,
    )
    angles = np.zeros((2, 3, t_s.size))
    angles[0, 0], angles[1, 0], angles[0, 2] = 0.1 * t_s, 0.1, 0.4
    return make_motion(path, angles)


def make_figure(t_s):
    """Make kilometres of eights and climbs at up to 124 m/s and 1.3 g, with roll, pitch and a 3 Hz vibration."""
    path = np.stack(
        [
            make_wave(1500.0, 0.06, 0.0, t_s) + make_wave(5e-3, 19.0, 0.3, t_s),
            make_wave(700.0, 0.12, 0.2, t_s),
            make_wave(150.0, 0.07, 1.0, t_s) + make_wave(2.0, 1.7, 0.0, t_s),
        ],
        axis=1,
    )
    angles = np.stack(
        [
            (make_wave(3.0, 0.09, 0.4, t_s) + make_wave(2e-3, 19.0, 0.0, t_s))[:2],
            make_wave(0.5, 0.23, 0.0, t_s)[:2],
            (make_wave(1.0, 0.31, 0.0, t_s) + make_wave(2e-3, 19.0, 1.5, t_s))[:2],
        ],
        axis=1,
    )
    return make_motion(path, angles)


def integrate_reference(series, start, lever_m=(0.0, 0.0, 0.0)):
    """Integrate positions (n + 1, 3) and attitudes in ECEF from increments and the state at the start.

    In inertial axes, which know neither Coriolis nor transport terms: splines through the summed increments give rate
    and force at quarters of the intervals; a fourth-order Magnus step turns the attitude; a quintic spline of the
    acceleration is integrated twice; gravitation is found by going round.
    """
    interval_s = series.interval_s
    n = len(series.gpst)
    edges_s = interval_s * np.arange(n + 1)
    spin = np.array([0.0, 0.0, EARTH_RAD_S])

    def derivative(means):
        summed = np.concatenate([np.zeros((1, 3)), np.cumsum(means, axis=0) * interval_s])
        return make_interp_spline(edges_s, summed, k=5).derivative()

    half_s = 0.5 * interval_s
    halves_s = half_s * np.arange(2 * n + 1)
    gauss = np.sqrt(3.0) / 6.0
    rate = derivative(series.angular_rate_rad_s)
    early, late = (rate(halves_s[:-1] + (0.5 + side * gauss) * half_s) for side in (-1.0, 1.0))
    turn = 0.5 * half_s * (early + late) + np.sqrt(3.0) / 12.0 * half_s**2 * np.cross(early, late)
    attitude = np.empty((2 * n + 1, 3, 3))
    attitude[0] = start.attitude[0]
    for k, step in enumerate(Rotation.from_rotvec(turn).as_matrix()):
        attitude[k + 1] = attitude[k] @ step

    force = np.einsum("nij,nj->ni", attitude, derivative(series.specific_force_m_s2)(halves_s))
    earth = Rotation.from_rotvec(halves_s[:, None] * spin).as_matrix()  # ECEF to inertial axes
    place = start.position_ecef_m[0] + start.attitude[0] @ lever_m
    swing = start.attitude[0] @ np.cross(start.angular_rate_body_rad_s[0], lever_m)
    velocity = start.velocity_ecef_m_s[0] + swing + np.cross(spin, place)
    position = place + velocity * halves_s[:, None]
    for _ in range(7):
        ecef = np.einsum("nji,nj->ni", earth, position)
        attraction = compute_gravity_m_s2(ecef) + np.cross(spin, np.cross(spin, ecef))
        acceleration = force + np.einsum("nij,nj->ni", earth, attraction)
        twice = make_interp_spline(halves_s, acceleration, k=5).antiderivative(2)
        position = place + velocity * halves_s[:, None] + twice(halves_s) - twice(0.0)
    ecef = np.einsum("nji,nj->ni", earth, position)
    attitude = np.einsum("nji,njk->nik", earth, attitude)
    return ecef[::2] - np.einsum("nij,j->ni", attitude[::2], lever_m), attitude[::2]


@pytest.mark.parametrize(
    ("motion_at", "lever_m"),
    [
        (make_static, (0.0, 0.0, 0.0)),
        (make_circle, (0.0, 0.0, 0.0)),
        (make_figure, (0.0, 0.0, 0.0)),
        (make_figure, (1.5, -0.4, 0.8)),
    ],
)
def test_error_free_readings_return_the_trajectory_over_233_s(motion_at, lever_m):
    unit = simulate_inertial(motion_at, rate_hz=100.0, duration_s=233.0, lever_body_m=lever_m)
    series = unit.read(0, unit.n_samples)
    position_m, attitude = integrate_reference(series, motion_at(np.zeros(1)), lever_m)
    truth = motion_at(np.concatenate([[0.0], count_seconds(series)]))
    assert np.abs(position_m - truth.position_ecef_m).max() < 1e-4  # 0.013 mm at most
    assert np.abs(attitude - truth.attitude).max() < 1e-9


def test_the_approach_and_banked_turns_come_back_too():
    corners_m = ORIGIN_M + np.array([[0, 0, 0], [6e3, 0, 0], [6e3, 5e3, 300], [0, 5e3, 300], [0, 12e3, 0]]) @ TO_ECEF.T
    course = make_way_points(corners_m, 100.0, lateral_m_s2=6.0, from_rest=False, to_rest=False)
    for trajectory in (make_las_vegas(), course):
        unit = simulate_inertial(trajectory.at, rate_hz=100.0, duration_s=233.0, lever_body_m=(1.5, -0.4, 0.8))
        series = unit.read(0, unit.n_samples)
        position_m, _ = integrate_reference(series, trajectory.at(np.zeros(1)), (1.5, -0.4, 0.8))
        truth = trajectory.at(np.concatenate([[0.0], count_seconds(series)]))
        assert np.abs(position_m - truth.position_ecef_m).max() < 1e-3


def test_at_rest_it_feels_gravity_and_the_earths_rotation():
    series = simulate_inertial(make_static, rate_hz=50.0, duration_s=2.0).read(0, 100)
    attitude = make_static(np.zeros(1)).attitude[0]
    gravity = compute_gravity_m_s2(ORIGIN_M)
    np.testing.assert_allclose(series.specific_force_m_s2, np.tile(-attitude.T @ gravity, (100, 1)), atol=1e-12)
    np.testing.assert_allclose(series.angular_rate_rad_s, np.tile(attitude.T[:, 2] * EARTH_RAD_S, (100, 1)), rtol=1e-12)
    # upwards: east, north, up of what a level unit feels
    assert (TO_ECEF.T @ attitude @ series.specific_force_m_s2[0])[2] == pytest.approx(9.794, abs=0.005)


def test_on_a_turntable_the_lever_arm_adds_acceleration():
    lever_m = np.array([2.0, 0.0, 0.0])
    near, far = (
        simulate_inertial(make_turntable, rate_hz=10.0, duration_s=60.0, lever_body_m=at)
        for at in (np.zeros(3), lever_m)
    )
    more = far.read(0, 600).specific_force_m_s2 - near.read(0, 600).specific_force_m_s2
    begin_s, end_s = 0.1 * np.arange(600), 0.1 * np.arange(1, 601)
    rate2 = 0.02**2 * (end_s**3 - begin_s**3) / 3.0 / 0.1
    np.testing.assert_allclose(more[:, 1], 0.02 * 2.0, atol=2e-5)  # within what Coriolis and the gradient of gravity do
    np.testing.assert_allclose(more[:, 0], -rate2 * 2.0, atol=5e-4)


def test_readings_are_means_over_intervals_that_end_there():
    fine, coarse = (
        simulate_inertial(make_figure, rate_hz=rate_hz, duration_s=4.0).read(0, 9999) for rate_hz in (200.0, 5.0)
    )
    assert np.array_equal(coarse.gpst, fine.gpst[39::40])
    for name in ("specific_force_m_s2", "angular_rate_rad_s"):
        means = getattr(fine, name).reshape(-1, 40, 3).mean(axis=1)
        np.testing.assert_allclose(getattr(coarse, name), means, atol=1e-9)


def test_mounting_turns_the_axes_but_not_the_sensor_errors():
    rotation = Rotation.from_euler("ZYX", [0.3, -1.0, 2.0]).as_matrix()
    plain, turned = (
        simulate_inertial(make_figure, rate_hz=100.0, duration_s=5.0, mounting=m).read(0, 500) for m in (None, rotation)
    )
    np.testing.assert_allclose(turned.specific_force_m_s2, plain.specific_force_m_s2 @ rotation.T, atol=1e-12)
    np.testing.assert_allclose(turned.angular_rate_rad_s, plain.angular_rate_rad_s @ rotation.T, atol=1e-12)
    grade = replace(GRADES["tactical"], accelerometer_scale=0.0, gyro_scale=0.0, misalignment_rad=0.0)
    wrong = simulate_inertial(make_figure, rate_hz=100.0, duration_s=5.0, mounting=rotation, grade=grade, seed=4).read(
        0, 500
    )
    other = simulate_inertial(make_figure, rate_hz=100.0, duration_s=5.0, grade=grade, seed=4).read(0, 500)
    np.testing.assert_allclose(
        wrong.specific_force_m_s2 - turned.specific_force_m_s2,
        other.specific_force_m_s2 - plain.specific_force_m_s2,
        atol=1e-12,
    )


@settings(max_examples=8, deadline=None)
@given(cuts=st.lists(st.integers(0, 9000), max_size=5), order=st.randoms())
def test_the_same_bytes_come_for_any_request_and_order(cuts, order):
    def make():
        return simulate_inertial(
            make_circle, rate_hz=100.0, duration_s=90.0, grade="tactical", seed=7, lever_body_m=(1.0, 0.0, 0.0)
        )

    whole, fresh = make().read(0, 9000), make()
    edges = sorted({0, *cuts, 9000})
    pieces = list(pairwise(edges))
    order.shuffle(pieces)
    for begin, end in pieces:
        part = fresh.read(begin, end - begin)
        for name in ("gpst", "specific_force_m_s2", "angular_rate_rad_s"):
            assert getattr(part, name).tobytes() == getattr(whole, name)[begin:end].tobytes()


def test_blocks_are_the_whole_one_after_the_other():
    asked = []

    def watch(t_s):
        asked.append(t_s.max())
        return make_static(t_s)

    unit = simulate_inertial(watch, rate_hz=100.0, duration_s=125.0, grade="navigation")
    blocks = unit.blocks(1000)
    first = next(blocks)
    assert len(asked) == 1
    assert asked[0] < BLOCK / 100.0
    rest = list(blocks)
    assert len(asked) == 4
    forces = np.concatenate([first.specific_force_m_s2, *(part.specific_force_m_s2 for part in rest)])
    assert forces.tobytes() == unit.read(0, 12_500).specific_force_m_s2.tobytes()


@pytest.mark.parametrize("rate_hz", [0.5, 10.0, 1000.0])
def test_the_motion_is_asked_for_few_times_at_once_at_any_rate(rate_hz):
    asked = []

    def watch(t_s):
        asked.append(t_s.size)
        return make_static(t_s)

    simulate_inertial(watch, rate_hz=rate_hz, duration_s=30.0).read(0, 100)
    assert max(asked) <= 4 * BLOCK


def test_it_is_short_at_the_end_only():
    unit = simulate_inertial(make_static, rate_hz=10.0, duration_s=5.0)
    assert len(unit.read(45, 10).gpst) == 5
    assert len(unit.read(50, 10).gpst) == len(unit.read(70, 10).gpst) == 0
    with pytest.raises(ValueError, match="negative"):
        unit.read(-1, 10)


def test_start_of_the_unit_shifts_its_times():
    unit = simulate_inertial(make_figure, rate_hz=100.0, duration_s=3.0, start_s=2.0)
    later = simulate_inertial(make_figure, rate_hz=100.0, duration_s=5.0)
    assert np.array_equal(unit.read(0, 300).gpst, later.read(200, 300).gpst)
    np.testing.assert_allclose(
        unit.read(0, 300).specific_force_m_s2, later.read(200, 300).specific_force_m_s2, atol=1e-9
    )


# --- errors


def draw_errors(grade, rate_hz, count, seed):
    made = ImuErrors.of(grade, rate_hz, -(-count // BLOCK), seed)
    return np.concatenate([made.drawn(block) for block in range(-(-count // BLOCK))])[:count]


def test_grades_are_the_papers_table_in_si_units():
    navigation, tactical = GRADES["navigation"], GRADES["tactical"]
    assert navigation.velocity_random_walk_m_s_rts == pytest.approx(2.3833e-4, rel=1e-4)
    assert navigation.angular_random_walk_rad_rts == pytest.approx(2.9089e-7, rel=1e-4)
    assert navigation.accelerometer_instability_m_s2 == pytest.approx(9.80665e-5)
    assert navigation.gyro_instability_rad_s == pytest.approx(1.6968e-8, rel=1e-4)
    assert tactical.velocity_random_walk_m_s_rts == pytest.approx(1e-3)
    assert tactical.angular_random_walk_rad_rts == pytest.approx(4.3633e-5, rel=1e-4)
    assert tactical.accelerometer_instability_m_s2 == pytest.approx(4.903e-4, rel=1e-4)
    assert tactical.gyro_instability_rad_s == pytest.approx(2.4241e-6, rel=1e-4)
    assert tactical.gyro_repeatability_rad_s == pytest.approx(4.0 * np.pi / 180.0 / 3600.0)
    assert all(grade.source for grade in GRADES.values())


@pytest.mark.parametrize("name", ["navigation", "tactical"])
def test_noise_density_is_the_grades(name):
    # White noise alone stands at 0.02 to 0.5 s; counts in the limits of each axis and seed, two-sided.
    grade = replace(GRADES[name], accelerometer_instability_m_s2=0.0, gyro_instability_rad_s=0.0)
    rate_hz, factors = 100.0, [1, 7, 50]
    runs = np.stack([draw_errors(grade, rate_hz, 3000, seed) for seed in range(25)])
    phase = np.concatenate([np.zeros((25, 1, 6)), np.cumsum(runs, axis=1) / rate_hz], axis=1)
    got = allan_deviation(np.moveaxis(phase, 1, 2), 1.0 / rate_hz, factors, confidence=0.8)
    want = np.stack(
        [compute_accelerometer_allan_m_s2(grade, got.tau_s)] * 3 + [compute_gyro_allan_rad_s(grade, got.tau_s)] * 3
    )
    inside = ((got.lower < want) & (want < got.upper)).sum(axis=0)
    for count in inside.ravel():  # 18 counts of 25
        assert stats.binomtest(int(count), 25, 0.8).pvalue > 1e-4
    for count in inside.sum(axis=0):
        assert stats.binomtest(int(count), 150, 0.8).pvalue > 1e-3
    ratio = np.mean(got.deviation**2, axis=(0, 1)) / np.mean(want**2, axis=0)
    assert np.abs(ratio[0] - 1.0) < 0.02


@pytest.mark.parametrize("name", list(GRADES))
def test_allan_deviation_with_instability_is_the_grades(name):
    # From 10 s to 2000 s, where the instability stands out of the noise; mean variances of 40 units, two-sided.
    grade, rate_hz, factors = GRADES[name], 0.5, [5, 50, 280, 1000]
    runs = np.stack([draw_errors(grade, rate_hz, 5000, seed) for seed in range(40)])
    phase = np.concatenate([np.zeros((40, 1, 6)), np.cumsum(runs, axis=1) / rate_hz], axis=1)
    got = allan_deviation(np.moveaxis(phase, 1, 2), 1.0 / rate_hz, factors)
    for columns, want in (
        (slice(0, 3), compute_accelerometer_allan_m_s2(grade, got.tau_s)),
        (slice(3, 6), compute_gyro_allan_rad_s(grade, got.tau_s)),
    ):
        variance = got.deviation[:, columns].reshape(120, -1) ** 2
        z = (variance.mean(axis=0) - want**2) / (variance.std(axis=0, ddof=1) / np.sqrt(120.0))
        assert (np.abs(z) < 4.0).all(), z


def test_instability_has_its_deviation_and_time_at_any_rate():
    grade = ImuGrade(
        velocity_random_walk_m_s_rts=0.0,
        angular_random_walk_rad_rts=0.0,
        accelerometer_instability_m_s2=2.0,
        gyro_instability_rad_s=3.0,
        correlation_s=50.0,
    )
    for rate_hz in (1.0, 40.0):
        lag = int(50.0 * rate_hz)
        ends = np.stack([draw_errors(grade, rate_hz, lag + 1, seed)[[0, lag]] for seed in range(250)])
        squares = np.sum((ends / [2.0, 2.0, 2.0, 3.0, 3.0, 3.0]) ** 2, axis=0)
        assert ((stats.chi2.ppf(1e-4, 250) < squares) & (squares < stats.chi2.isf(1e-4, 250))).all()
        correlation = np.mean(ends[:, 0] * ends[:, 1], axis=0).reshape(2, 3).mean(axis=1) / [4.0, 9.0]
        np.testing.assert_allclose(correlation, np.exp(-1.0), atol=4.0 / np.sqrt(750.0))


def test_instability_goes_on_from_block_to_block():
    grade = ImuGrade(
        velocity_random_walk_m_s_rts=0.0,
        angular_random_walk_rad_rts=0.0,
        accelerometer_instability_m_s2=1.0,
        gyro_instability_rad_s=1.0,
        correlation_s=1e4,
    )
    steps = np.diff(draw_errors(grade, 1.0, 3 * BLOCK, seed=1), axis=0)
    assert np.abs(steps[[BLOCK - 1, 2 * BLOCK - 1]]).max() < 5.0 * np.sqrt(2.0 / 1e4)


def test_constant_errors_have_the_stated_spread():
    grade = ImuGrade(
        velocity_random_walk_m_s_rts=0.0,
        angular_random_walk_rad_rts=0.0,
        accelerometer_instability_m_s2=0.0,
        gyro_instability_rad_s=0.0,
        accelerometer_repeatability_m_s2=2e-3,
        gyro_repeatability_rad_s=1e-5,
        accelerometer_scale=3e-4,
        gyro_scale=5e-4,
        misalignment_rad=1e-4,
    )
    made = [ImuErrors.of(grade, 1.0, 1, seed) for seed in range(500)]
    bias = np.stack([each.bias for each in made]) / np.repeat([2e-3, 1e-5], 3)
    gain = np.stack([each.gain for each in made]).reshape(-1, 2, 3, 3)
    diagonal = np.einsum("njaa->nja", gain) / np.array([[3e-4], [5e-4]])
    cross = gain[:, :, ~np.eye(3, dtype=bool)] / 1e-4
    for values in (bias, diagonal, cross):
        assert 1e-4 < stats.chi2.cdf(np.sum(values**2), values.size) < 1.0 - 1e-4

    clean, wrong = (
        simulate_inertial(make_circle, rate_hz=20.0, duration_s=5.0, grade=g, seed=3).read(0, 100)
        for g in (None, grade)
    )
    unit = ImuErrors.of(grade, 20.0, 1, 3)
    for part, name in enumerate(("specific_force_m_s2", "angular_rate_rad_s")):
        truth, rows = getattr(clean, name), slice(3 * part, 3 * part + 3)
        want = truth + truth @ unit.gain[rows].T + unit.bias[rows]
        np.testing.assert_allclose(getattr(wrong, name), want, atol=1e-12)


def test_errors_grow_as_the_closed_forms_predict():
    # Velocity random walk q gives q sqrt(t^3 / 3) of position; of 300 axes, two-sided.
    grade = replace(GRADES["tactical"], accelerometer_instability_m_s2=0.0)
    drift_m = [
        np.cumsum(np.cumsum(draw_errors(grade, 10.0, 1000, seed)[:, :3], axis=0) / 10.0, axis=0)[-1] / 10.0
        for seed in range(100)
    ]
    squares = np.sum(np.square(drift_m)) / (1e-6 * 100.0**3 / 3.0)
    assert stats.chi2.ppf(1e-3, 300) < squares < stats.chi2.isf(1e-3, 300)


def test_units_and_seeds_are_set_apart():
    made = [
        simulate_inertial(make_static, rate_hz=10.0, duration_s=5.0, grade="tactical", seed=seed, stream=stream)
        for seed, stream in ((1, 0), (1, 1), (2, 0), (1, 0))
    ]
    forces = [unit.read(0, 50).specific_force_m_s2.tobytes() for unit in made]
    assert len(set(forces)) == 3
    assert forces[0] == forces[3]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"rate_hz": 0.0}, "imu.rate_hz"),
        ({"rate_hz": float("nan")}, "imu.rate_hz"),
        ({"duration_s": -1.0}, "duration_s"),
        ({"grade": "navigatoin"}, "perhaps 'navigation'"),
        ({"grade": "Tactical"}, "perhaps 'tactical'"),
        ({"mounting": np.diag([1.0, 1.0, 2.0])}, "imu.mounting"),
        ({"mounting": np.diag([1.0, 1.0, -1.0])}, "mirrors"),
        ({"mounting": np.eye(2)}, "imu.mounting"),
        ({"lever_body_m": (1.0, 2.0)}, "imu.lever_body_m"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, words):
    with pytest.raises(ScenarioError, match=words):
        simulate_inertial(make_static, **{"rate_hz": 100.0, "duration_s": 1.0, **arguments})
