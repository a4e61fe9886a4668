"""Strapdown and filter beside an independent solution, pyins: in local-level axes, written by others."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyins
import pytest
from scipy.spatial.transform import Rotation
from tests.navigation import walk as real
from tests.navigation.units import ROUND, add_errors, draw_fix, draw_start, label, read_perfectly

from skyproof.gnss.frames import geodetic_from_ecef, heading_pitch_roll_rad, rot_enu_ecef
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.inertia import select_readings
from skyproof.navigation.ins import InsSettings, begin, correct, step, subtract_errors
from skyproof.navigation.ins_updates import measurement_from_fix
from skyproof.navigation.strapdown import navigate_paths
from skyproof.records import NavState

AXES = "xyz"
NED = [1, 0, 2]


def make_increments(readings, seconds):
    """Convert readings as pyins takes them: the first reading serves as the one before."""
    values = readings.interval_s * np.hstack((readings.angular_rate_rad_s, readings.specific_force_m_s2))
    columns = [f"gyro_{axis}" for axis in AXES] + [f"accel_{axis}" for axis in AXES]
    return pyins.strapdown.compute_increments_from_imu(
        pd.DataFrame(values, index=seconds, columns=columns), "increment"
    )


def convert_pva(state: NavState, at_s):
    lat, lon, height = geodetic_from_ecef(state.position_ecef_m[-1])
    speed = (rot_enu_ecef(lat, lon) @ state.velocity_ecef_m_s[-1])[NED] * [1.0, 1.0, -1.0]
    heading, pitch, roll = heading_pitch_roll_rad(state.position_ecef_m[-1], state.attitude[-1])
    values = [*np.degrees([lat, lon]), height, *speed, *np.degrees([roll, pitch, heading])]
    names = ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"]
    return pd.Series(np.array(values, float), index=names, name=at_s)


def subtract_mm(state: NavState, theirs) -> np.ndarray:
    """Subtract their north, east, down from ours."""
    ours = convert_pva(state, 0.0)
    difference = pyins.transform.compute_lla_difference(
        ours[["lat", "lon", "alt"]].to_numpy(), theirs[["lat", "lon", "alt"]].to_numpy(float)
    )
    return 1e3 * np.asarray(difference, float)


def compare_strapdown_mm(start: NavState, readings, seconds):
    """Compare both solutions after all readings but the first, from a start at the end of that."""
    integrator = pyins.strapdown.Integrator(convert_pva(start, seconds[0]))
    theirs = integrator.integrate(make_increments(readings, seconds)).iloc[-1]
    first = np.stack((readings.specific_force_m_s2[0], readings.angular_rate_rad_s[0]))
    place, speed, attitude = navigate_paths(
        start.position_ecef_m[-1],
        start.velocity_ecef_m_s[-1],
        start.attitude[-1],
        readings.specific_force_m_s2[1:],
        readings.angular_rate_rad_s[1:],
        readings.interval_s,
        before=first,
    )
    ours = NavState(
        gpst=start.gpst[-1:], position_ecef_m=place[-1:], velocity_ecef_m_s=speed[-1:], attitude=attitude[-1:]
    )
    return subtract_mm(ours, theirs)


def test_free_running_strapdowns_agree():
    readings = read_perfectly(ROUND, 60.0, 100.0)
    at = ROUND.at(np.array([0.01]))
    start = NavState(
        gpst=label([0.01]),
        position_ecef_m=at.position_ecef_m,
        velocity_ecef_m_s=at.velocity_ecef_m_s,
        attitude=at.attitude,
    )
    north, east, down = compare_strapdown_mm(start, readings, np.arange(1, readings.gpst.size + 1) / 100.0)
    print(f"60 s of a circle at 30 m/s, mm: north {north:.2f}, east {east:.2f}, down {down:.2f}")
    assert np.hypot(north, east) < 15.0
    assert abs(down) < 15.0  # its gravity leaves out 2e-6 m/s2 at 100 m


def compare_filters(start: NavState, readings, seconds, fixes, fix_seconds, grade, sigma, noise):
    """Compare both filters after all fixes: position in mm (3,), and its stated sigmas' ratio (3,)."""
    settings = InsSettings(grade=grade, oscillator=OSCILLATORS["tcxo"])
    state = begin(start, settings)
    first = np.stack((readings.specific_force_m_s2[0], readings.angular_rate_rad_s[0]))
    state = replace(state, run=replace(state.run, last=first))
    for fix in fixes:
        _, state = step(state, select_readings(readings, state.gpst, fix.gpst), settings)
        state, _ = correct(state, measurement_from_fix(state, fix, settings))
    _, state = step(state, select_readings(readings, state.gpst, readings.gpst[-1]), settings)
    states = [
        NavState(
            gpst=start.gpst,
            position_ecef_m=fix.mean[None, 0:3],
            velocity_ecef_m_s=fix.mean[None, 3:6],
            attitude=start.attitude,
        )
        for fix in fixes
    ]
    seen = pd.DataFrame([convert_pva(one, at) for one, at in zip(states, fix_seconds, strict=True)])
    result = pyins.filters.run_feedback_filter(
        convert_pva(start, seconds[0]),
        sigma[0],
        sigma[1],
        np.degrees(sigma[2]),
        np.degrees(sigma[2]),
        make_increments(readings, seconds),
        pyins.inertial_sensor.EstimationModel(
            bias_sd=grade.gyro_repeatability_rad_s, noise=grade.angular_random_walk_rad_rts
        ),
        pyins.inertial_sensor.EstimationModel(
            bias_sd=grade.accelerometer_repeatability_m_s2, noise=grade.velocity_random_walk_m_s_rts
        ),
        [pyins.measurements.Position(seen, noise[0]), pyins.measurements.NedVelocity(seen, noise[1])],
        time_step=0.5,
    )
    enu = rot_enu_ecef(*geodetic_from_ecef(state.position_ecef_m)[:2])
    ours = np.sqrt(np.diag(enu @ state.covariance[:3, :3] @ enu.T))[NED]
    theirs = result.trajectory_sd.iloc[-1][["north", "east", "down"]].to_numpy(float)
    return subtract_mm(state.run.state, result.trajectory.iloc[-1]), ours, theirs


def drop_slow_biases(name):
    return replace(
        GRADES[name],
        accelerometer_instability_m_s2=0.0,
        gyro_instability_rad_s=0.0,
        accelerometer_scale=0.0,
        gyro_scale=0.0,
        misalignment_rad=0.0,
    )


def test_filters_agree():
    # A tactical unit with errors, and a fix of 1.5 m and 0.1 m/s a second; the last one is a second old at the end.
    grade, rng = drop_slow_biases("tactical"), np.random.default_rng(1)
    readings = add_errors(read_perfectly(ROUND, 20.0, 50.0), grade, rng).readings
    sigma, noise = (2.0, 0.3, np.radians(1.0)), (1.5, 0.1)
    start = draw_start(ROUND, np.repeat(sigma, 3), rng, at_s=0.02)
    at_s = np.arange(1.0, 20.0)
    fixes = [draw_fix(ROUND, at, rng, *noise, arm=np.zeros(3)) for at in at_s]
    seconds = np.arange(1, readings.gpst.size + 1) / 50.0
    apart, ours, theirs = compare_filters(start, readings, seconds, fixes, at_s, grade, sigma, noise)
    print(f"20 s with fixes, mm: {np.round(apart, 1)}; stated, m: {np.round(ours, 3)} and {np.round(theirs, 3)}")
    assert np.linalg.norm(apart) < 0.05 * 1e3 * np.linalg.norm(ours)
    assert ours == pytest.approx(theirs, rel=0.05)  # theirs is of half a second before: 3 % less


@pytest.mark.long
@pytest.mark.shared_data
def test_filters_agree_on_a_real_walk(shared_data):
    # From 25 s on, attitude found in motion; free for 10 s, and with fixes four times a second for 60 s.
    walk = real.read_walk(shared_data / "real" / "imu-gnss-walk")
    state = real.align(walk, 11.0, 25.0).state
    zero = walk.readings.gpst[0]
    grade = drop_slow_biases("consumer")
    for seconds in (10.0, 30.0):
        rows = slice(*np.searchsorted(walk.readings.gpst, [state.gpst, state.gpst + np.timedelta64(int(seconds), "s")]))
        readings = subtract_errors(walk.readings.select(rows), state.bias[:6] + state.bias[6:], state.gain)
        # Labels follow the logger's clock, by some 1e-4 of an interval: both are given the unit's own.
        at_s = (readings.gpst[0] - zero) / np.timedelta64(1, "s") + np.arange(readings.gpst.size) * readings.interval_s
        print(
            f"{seconds:g} s free on the walk, mm: {np.round(compare_strapdown_mm(state.run.state, readings, at_s), 2)}"
        )
    sigma = (0.05, 0.1, np.radians(2.0))
    start = replace(state.run.state, covariance=np.diag(np.repeat(np.square(sigma), 3))[None])
    kept = [
        k for k, fix in enumerate(walk.fixes) if state.gpst + np.timedelta64(100, "ms") < fix.gpst < readings.gpst[-1]
    ]
    apart, ours, theirs = compare_filters(
        start,
        readings,
        at_s,
        [walk.fixes[k] for k in kept],
        walk.seconds[kept],
        grade,
        sigma,
        (real.PLACE_M, real.SPEED_M_S),
    )
    print(
        f"30 s with fixes on the walk, mm: {np.round(apart, 1)}; stated, m: {np.round(ours, 3)}, {np.round(theirs, 3)}"
    )
    assert np.linalg.norm(apart) < 1e3 * np.linalg.norm(ours)


def test_attitudes_have_the_same_convention():
    at = ROUND.at(np.array([3.0]))
    state = NavState(
        gpst=label([3.0]),
        position_ecef_m=at.position_ecef_m,
        velocity_ecef_m_s=at.velocity_ecef_m_s,
        attitude=at.attitude,
    )
    theirs = pyins.transform.mat_from_rph(convert_pva(state, 0.0)[["roll", "pitch", "heading"]])
    enu = rot_enu_ecef(*geodetic_from_ecef(at.position_ecef_m[0])[:2])
    ours = (enu[NED] * [[1.0], [1.0], [-1.0]]) @ at.attitude[0]
    assert Rotation.from_matrix(ours @ theirs.T).magnitude() < 1e-9
