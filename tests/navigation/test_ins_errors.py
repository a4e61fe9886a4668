"""The linear error model: closed forms, the guide's drifts, units that really drift, and renewal by a fix."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.imu_grades import GRADES, ImuGrade
from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.ins_errors import (
    STATES,
    build_start_covariance,
    propagate_covariance,
)
from skyproof.navigation.strapdown import navigate_paths
from skyproof.records import NavState
from skyproof.simulator.inertial import ImuErrors, simulate_inertial
from skyproof.simulator.trajectories import make_las_vegas, make_way_points

SECONDS = np.arange(0.0, 234.0)
LABELS = GPS_EPOCH + SECONDS.astype("timedelta64[s]")
APPROACH = make_las_vegas()
MOTION = APPROACH.at(SECONDS)
PATH = NavState(
    gpst=LABELS,
    position_ecef_m=MOTION.position_ecef_m,
    velocity_ecef_m_s=MOTION.velocity_ecef_m_s,
    attitude=MOTION.attitude,
)
TO_ENU = rot_enu_ecef(*geodetic_from_ecef(MOTION.position_ecef_m[0])[:2])
NONE = ImuGrade(
    velocity_random_walk_m_s_rts=0.0,
    angular_random_walk_rad_rts=0.0,
    accelerometer_instability_m_s2=0.0,
    gyro_instability_rad_s=0.0,
)
MILLI_G = 9.80665e-3
DEG_HOUR = np.radians(1.0) / 3600.0


def predict_drift_m(grade, at_s=233, **start):
    """Predict one sigma of position, east, north, up."""
    covariance = propagate_covariance(PATH, grade, build_start_covariance(grade, **start))[at_s, :3, :3]
    return np.sqrt(np.diag(TO_ENU @ covariance @ TO_ENU.T))


@pytest.mark.parametrize(
    ("changes", "start", "horizontal_m", "vertical_m"),
    [
        ({"velocity_random_walk_m_s_rts": 0.06 / 60}, {}, 2.1, 2.1),
        ({"velocity_random_walk_m_s_rts": 0.0143 / 60}, {}, 0.5, 0.5),
        ({"accelerometer_repeatability_m_s2": 0.05 * MILLI_G}, {}, 13.3, 13.3),
        ({"angular_random_walk_rad_rts": np.radians(0.15) / 60}, {}, 79.0, 0.0),
        ({"gyro_repeatability_rad_s": 0.5 * DEG_HOUR}, {}, 50.0, 0.0),
        ({"gyro_repeatability_rad_s": 0.0035 * DEG_HOUR}, {}, 0.35, 0.0),
        ({}, {"tilt_rad": np.radians(0.02)}, 93.0, 0.0),
        ({}, {"velocity_m_s": 0.05}, 11.65, 11.65),
    ],
)
def test_each_error_grows_by_its_closed_form(changes, start, horizontal_m, vertical_m):
    east, north, up = predict_drift_m(replace(NONE, **changes), **start)
    assert [east, north] == pytest.approx([horizontal_m] * 2, rel=0.05)  # Schuler's pull is 2 % over 233 s
    assert up == pytest.approx(vertical_m, rel=0.06, abs=0.03 * horizontal_m)


def test_the_slow_biases_stay_what_they_are():
    grade = GRADES["tactical"]
    last = propagate_covariance(PATH, grade, build_start_covariance(grade))[-1]
    assert np.diag(last)[15:18] == pytest.approx(grade.accelerometer_instability_m_s2**2, rel=1e-6)
    assert np.diag(last)[18:21] == pytest.approx(grade.gyro_instability_rad_s**2, rel=1e-6)


def drop_gain(name):
    return replace(GRADES[name], accelerometer_scale=0.0, gyro_scale=0.0, misalignment_rad=0.0)


def use_table_only(name):
    return replace(drop_gain(name), accelerometer_repeatability_m_s2=0.0, gyro_repeatability_rad_s=0.0)


WINDING = np.array([[0, 0], [1, 0], [1, 1], [2, 1], [2, 0], [3, -1], [3, -3]], np.float64)
MOVING = {"position_m": 1.0, "velocity_m_s": 0.05}


@pytest.mark.parametrize(
    ("grade", "start", "east_m", "up_m"),
    [
        (use_table_only("navigation"), {}, (0.5, 1.7, 2.5), (0.5, 1.7, 2.4)),
        (use_table_only("navigation"), MOVING, (5, 9.5, 12), (5, 10, 12)),
        (drop_gain("navigation-calibrated"), MOVING | {"tilt_rad": np.radians(0.003)}, (6, 14, 19), (5, 10, 13)),
        (drop_gain("navigation"), MOVING | {"tilt_rad": np.radians(0.01)}, (10, 33, 49), (5.5, 11, 15)),
        (use_table_only("tactical"), {}, (10, 54, 92), (2.4, 8, 12)),
        (use_table_only("tactical"), MOVING, (12, 55, 93), (6, 13, 18)),
        (drop_gain("tactical-calibrated"), MOVING | {"tilt_rad": np.radians(0.02)}, (25, 111, 182), (12, 40, 59)),
        (drop_gain("tactical"), MOVING | {"tilt_rad": np.radians(0.1)}, (103, 425, 686), (39, 139, 208)),
    ],
)
def test_drifts_are_those_of_the_guide(grade, start, east_m, up_m):
    found = np.array([predict_drift_m(grade, at_s, **start) for at_s in (100, 190, 233)])
    assert found[:, 0] == pytest.approx(east_m, rel=0.09)  # the guide counted 300 runs: 4 % is one sigma
    assert found[:, 2] == pytest.approx(up_m, rel=0.09)


def draw_units(n, grade, rng, **start):
    """Draw errors of position and attitude of n units after the approach, at 2 Hz."""
    unit = simulate_inertial(APPROACH.at, rate_hz=2.0, duration_s=233.0)
    true = unit.read(0, unit.n_samples)
    wrong = np.stack([_draw_errors(grade, k, unit.n_samples) for k in range(n)])
    return navigate_paths(
        PATH.position_ecef_m[0],
        PATH.velocity_ecef_m_s[0] + start["velocity_m_s"] * rng.standard_normal((n, 3)),
        PATH.attitude[0],
        true.specific_force_m_s2 + wrong[..., :3],
        true.angular_rate_rad_s + wrong[..., 3:],
        0.5,
    )


def _draw_errors(grade, seed, n):
    errors = ImuErrors.of(grade, 2.0, 1, seed)
    return errors.bias + errors.drawn(0)[:n]


def test_units_drift_as_the_model_says():
    rng = np.random.default_rng(2)
    grade = drop_gain("tactical")
    places, speeds, attitudes = draw_units(300, grade, rng, velocity_m_s=0.2)
    predicted = propagate_covariance(PATH, grade, build_start_covariance(grade, velocity_m_s=0.2))[233]
    turned = attitudes[:, -1] @ MOTION.attitude[233].T
    psi = 0.5 * np.stack(
        [turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0], turned[:, 1, 0] - turned[:, 0, 1]],
        axis=1,
    )
    error = np.concatenate(
        (places[:, -1] - MOTION.position_ecef_m[233], speeds[:, -1] - MOTION.velocity_ecef_m_s[233], psi), axis=1
    )
    squared = np.einsum("ni,ij,nj->n", error, np.linalg.inv(predicted[:9, :9]), error)
    assert squared.mean() == pytest.approx(9.0, abs=4 * np.sqrt(18 / 300))


def test_units_of_wrong_gains_drift_as_the_model_predicts():
    # Errors of scale and alignment alone, of 1 % each, over 24 s of a way that turns left and right.
    grade = replace(NONE, accelerometer_scale=0.01, gyro_scale=0.01, misalignment_rad=0.01)
    motion = make_way_points(ecef_from_geodetic(0.9 + 7e-6 * WINDING[:, 0], 0.2 + 7e-6 * WINDING[:, 1], 0.0), 4.0)
    exact = simulate_inertial(motion.at, rate_hz=50.0, duration_s=24.0)
    true = exact.read(0, exact.n_samples)
    at = motion.at(np.arange(0.0, 24.01, 0.5))
    path = NavState(
        gpst=GPS_EPOCH + (np.arange(49) * 500).astype("timedelta64[ms]"),
        position_ecef_m=at.position_ecef_m,
        velocity_ecef_m_s=at.velocity_ecef_m_s,
        attitude=at.attitude,
    )
    rng, squares = np.random.default_rng(3), []
    predicted = propagate_covariance(path, grade, build_start_covariance(grade))[-1][:6, :6]
    for _ in range(150):
        gain = np.eye(3) + 0.01 * rng.standard_normal((2, 3, 3))
        places, speeds, _ = navigate_paths(
            at.position_ecef_m[0],
            at.velocity_ecef_m_s[0],
            at.attitude[0],
            true.specific_force_m_s2 @ gain[0].T,
            true.angular_rate_rad_s @ gain[1].T,
            0.02,
        )
        error = np.concatenate((places[-1] - at.position_ecef_m[-1], speeds[-1] - at.velocity_ecef_m_s[-1]))
        squares.append(error @ np.linalg.solve(predicted, error))
    assert np.mean(squares) == pytest.approx(6.0, abs=4 * np.sqrt(12 / 150))


def test_a_path_with_long_steps_is_refused():
    sparse = NavState(
        gpst=LABELS[::10],
        position_ecef_m=MOTION.position_ecef_m[::10],
        velocity_ecef_m_s=MOTION.velocity_ecef_m_s[::10],
        attitude=MOTION.attitude[::10],
    )
    with pytest.raises(ValueError, match="steps"):
        propagate_covariance(sparse, NONE, np.zeros((STATES, STATES)))
