"""A free-running navigator: where it should be, no more and no less off than it states, over gaps too."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation
from tests.written import write_table

from skyproof.formats.imu import COLUMNS, read_imu
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.inertia import GAP_S, TURN_MOST_RAD, FreeRun, begin_free_run, coast, measure_apparent_tilt_rad
from skyproof.navigation.strapdown import navigate_paths
from skyproof.records import ImuSeries, NavState
from skyproof.simulator.inertial import ImuErrors, simulate_inertial
from skyproof.simulator.trajectories import make_circle, make_static

HOME = ecef_from_geodetic(0.9, 0.2, 100.0)
MOTIONS = {
    "at rest": make_static(HOME, heading_rad=0.5, pitch_rad=0.1, roll_rad=-0.2),
    "round": make_circle(HOME, 300.0, 30.0),
}
START_SIGMA = np.repeat([1.0, 0.1, np.radians(0.5)], 3)  # m, m/s, rad
EXACT = replace(
    GRADES["navigation"],
    velocity_random_walk_m_s_rts=1e-9,
    angular_random_walk_rad_rts=1e-12,
    accelerometer_instability_m_s2=0.0,
    gyro_instability_rad_s=0.0,
    accelerometer_repeatability_m_s2=0.0,
    gyro_repeatability_rad_s=0.0,
)


def label(seconds):
    return GPS_EPOCH + np.rint(np.asarray(seconds) * 1e9).astype("timedelta64[ns]")


def make_truth(motion, seconds, covariance=None):
    at = motion.at(np.asarray(seconds, np.float64))
    return NavState(
        gpst=label(seconds),
        position_ecef_m=at.position_ecef_m,
        velocity_ecef_m_s=at.velocity_ecef_m_s,
        attitude=at.attitude,
        covariance=None if covariance is None else np.tile(covariance, (len(at.position_ecef_m), 1, 1)),
    )


def make_readings(motion, rate_hz=50.0, duration_s=10.0, **more):
    unit = simulate_inertial(motion.at, rate_hz=rate_hz, duration_s=duration_s, **more)
    return unit.read(0, unit.n_samples)


def drop_rows(series, rows):
    kept = np.delete(np.arange(series.gpst.size), rows)
    return ImuSeries(
        gpst=series.gpst[kept],
        interval_s=series.interval_s,
        specific_force_m_s2=series.specific_force_m_s2[kept],
        angular_rate_rad_s=series.angular_rate_rad_s[kept],
    )


def make_exact_run(motion, at_s=0.0):
    return begin_free_run(make_truth(motion, [at_s], 1e-12 * np.eye(9)), EXACT)


def find_errors(found, true):
    """Return the errors (9,) of the last row, as `NavState.covariance` has them."""
    psi = Rotation.from_matrix(found.attitude[-1] @ true.attitude[-1].T).as_rotvec()
    apart = (
        found.position_ecef_m[-1] - true.position_ecef_m[-1],
        found.velocity_ecef_m_s[-1] - true.velocity_ecef_m_s[-1],
    )
    return np.concatenate((*apart, psi))


@settings(max_examples=20)
@given(st.sampled_from(sorted(MOTIONS)), st.floats(0.0, 5.0), st.lists(st.floats(0.0, 10.0), max_size=3))
def test_error_free_readings_follow_the_truth_in_any_pieces(name, start_s, cuts):
    motion = MOTIONS[name]
    series, run = make_readings(motion), make_exact_run(motion, round(start_s, 9))
    for end_s in [*sorted(cuts), 10.0]:
        states, run = coast(run, _cut_after(series, end_s), EXACT)
    ends = make_truth(motion, [10.0])
    assert states.gpst[-1] == ends.gpst[0]
    assert np.abs(find_errors(states, ends)[:3]).max() < 2e-3
    assert np.abs(find_errors(states, ends)[6:]).max() < 2e-6


def _cut_after(series, end_s):
    return drop_rows(series, np.flatnonzero(series.gpst > label(end_s)))


def test_a_run_in_pieces_has_the_covariance_of_the_whole():
    motion, grade = MOTIONS["round"], GRADES["tactical"]
    series, run = (
        make_readings(motion, grade="tactical"),
        begin_free_run(make_truth(motion, [0.0], np.diag(START_SIGMA**2)), grade),
    )
    whole, _ = coast(run, series, grade)
    for end_s in (3.0, 3.01, 7.5, 10.0):
        states, run = coast(run, _cut_after(series, end_s), grade)
    assert isinstance(run, FreeRun)
    np.testing.assert_allclose(states.covariance[-1], whole.covariance[-1], rtol=1e-3, atol=1e-9)
    assert np.linalg.norm(states.position_ecef_m[-1] - whole.position_ecef_m[-1]) < 1e-3


UNITS = 150
LASTS_S = {"consumer": 2.0, "industrial": 10.0, "tactical": 60.0, "navigation": 60.0}


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("grade", LASTS_S)
@pytest.mark.parametrize("angle_deg", [0.05, 0.5])
def test_errors_are_as_large_as_the_covariance_says(name, grade, angle_deg):
    # Starts and units are drawn: the normalised squares are chi-square of nine, neither larger nor smaller.
    # With half a degree at the start the model's allowance for what is not linear makes them smaller.
    sigma = np.repeat([1.0, 0.1, np.radians(angle_deg)], 3)
    motion, errs, duration_s, rate_hz = MOTIONS[name], GRADES[grade], LASTS_S[grade], 10.0
    exact, ends = make_readings(motion, rate_hz, duration_s), make_truth(motion, [duration_s])
    states, run = coast(begin_free_run(make_truth(motion, [0.0], np.diag(sigma**2)), errs), exact, errs)
    assert run is not None
    rng = np.random.default_rng(7)
    felt = np.concatenate((exact.specific_force_m_s2, exact.angular_rate_rad_s), axis=1)
    drawn = np.stack([_draw_sensor_errors(errs, seed, rate_hz, felt) for seed in range(UNITS)])
    wrong = sigma * rng.standard_normal((UNITS, 9))
    start = make_truth(motion, [0.0])
    places, speeds, attitudes = navigate_paths(
        start.position_ecef_m[0] + wrong[:, :3],
        start.velocity_ecef_m_s[0] + wrong[:, 3:6],
        Rotation.from_rotvec(wrong[:, 6:]).as_matrix() @ start.attitude[0],
        exact.specific_force_m_s2 + drawn[..., :3],
        exact.angular_rate_rad_s + drawn[..., 3:],
        1.0 / rate_hz,
    )
    psi = Rotation.from_matrix(attitudes[:, -1] @ ends.attitude[0].T).as_rotvec()
    apart = places[:, -1] - ends.position_ecef_m[0], speeds[:, -1] - ends.velocity_ecef_m_s[0], psi
    error = np.concatenate(apart, axis=1)
    squares = np.einsum("ni,ij,nj->n", error, np.linalg.inv(states.covariance[-1]), error)
    p_value = stats.chi2(9 * UNITS).cdf(squares.sum())
    assert p_value < 1.0 - 1e-3, f"mean {squares.mean():.2f}, expected 9"
    if angle_deg < 0.1:
        assert p_value > 1e-3
        assert stats.kstest(squares, stats.chi2(9).cdf).pvalue > 1e-3
    else:
        assert squares.mean() > 5.0


def _draw_sensor_errors(grade, seed, rate_hz, felt):
    errors = ImuErrors.of(grade, rate_hz, 1, seed)
    gain = np.concatenate((felt[:, :3] @ errors.gain[:3].T, felt[:, 3:] @ errors.gain[3:].T), axis=1)
    return gain + errors.bias + errors.drawn(0)[: len(felt)]


def test_a_run_ends_where_its_errors_are_too_large_for_the_model():
    motion, grade = MOTIONS["at rest"], GRADES["consumer"]
    series, start = make_readings(motion, 10.0, 60.0), make_truth(motion, [0.0], np.diag(START_SIGMA**2))
    states, run = coast(begin_free_run(start, grade), series, grade)
    assert run is None
    assert 1.0 < (states.gpst[-1] - GPS_EPOCH) / np.timedelta64(1, "s") < 5.0
    turns, run = coast(begin_free_run(start, grade), series, grade, tilt_most_rad=np.inf, turn_most_rad=TURN_MOST_RAD)
    assert run is None
    sigma = np.sqrt(np.linalg.eigvalsh(turns.covariance[-1, 6:, 6:])[-1])
    assert 0.9 * TURN_MOST_RAD < sigma < TURN_MOST_RAD
    states, run = coast(
        begin_free_run(make_truth(motion, [0.0], np.diag((10.0 * START_SIGMA) ** 2)), grade), series, grade
    )
    assert run is None
    assert states.gpst.size == 1


# Axes and lever arm


@pytest.mark.parametrize("axes", ["flu", "rfu"])
def test_a_unit_of_other_axes_gives_the_same_states_exactly(tmp_path, axes):
    rot_body_unit = {"flu": np.diag([1.0, -1.0, -1.0]), "rfu": np.array([[0, 1.0, 0], [1, 0, 0], [0, 0, -1]])}[axes]
    series = make_readings(MOTIONS["round"], grade="tactical")
    straight, _ = coast(make_exact_run(MOTIONS["round"]), series, GRADES["tactical"])
    values = np.concatenate(
        [series.specific_force_m_s2 @ rot_body_unit, series.angular_rate_rad_s @ rot_body_unit], axis=1
    )
    write_table(tmp_path / "imu.csv", {"gpst": series.gpst, **dict(zip(COLUMNS, values.T, strict=True))})
    found = read_imu(tmp_path / "imu.csv", rot_body_unit=rot_body_unit).series(GPS_EPOCH)
    turned, _ = coast(
        make_exact_run(MOTIONS["round"]), replace(found, interval_s=series.interval_s), GRADES["tactical"]
    )
    for name in ("gpst", "position_ecef_m", "velocity_ecef_m_s", "attitude", "covariance"):
        assert np.array_equal(getattr(turned, name), getattr(straight, name)), name


# Gaps


def test_gaps_are_bridged_within_what_the_covariance_says():
    # Strong noise on a body that turns and shakes, with 3 of 10 seconds missing in pieces of 0.02 to 0.9 s.
    motion, grade = MOTIONS["round"], GRADES["tactical"]
    whole = make_readings(motion)
    missing = np.r_[30:32, 60:90, 150:195, 250, 300:340, 400:430]
    ends, squares = make_truth(motion, [10.0]), []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        shaken = replace(
            whole,
            specific_force_m_s2=whole.specific_force_m_s2 + 0.5 * rng.standard_normal((500, 3)),
            angular_rate_rad_s=whole.angular_rate_rad_s + 0.01 * rng.standard_normal((500, 3)),
        )
        shaking = replace(
            grade, velocity_random_walk_m_s_rts=0.5 * 0.02**0.5, angular_random_walk_rad_rts=0.01 * 0.02**0.5
        )
        states, run = coast(
            begin_free_run(make_truth(motion, [0.0], 1e-12 * np.eye(9)), shaking), drop_rows(shaken, missing), shaking
        )
        assert run is not None
        assert states.gpst.size == 501
        error = find_errors(states, ends)
        squares.append(error @ np.linalg.solve(states.covariance[-1], error))
    assert np.sum(squares) < stats.chi2(9 * 30).isf(1e-3)
    assert np.sum(squares) > 0.1 * 9 * 30  # safe, but not by orders of magnitude


def test_a_long_gap_ends_the_run_where_it_begins():
    motion = MOTIONS["round"]
    series = make_readings(motion)
    states, run = coast(make_exact_run(motion), drop_rows(series, slice(200, 252)), EXACT)
    assert run is None
    assert states.gpst[-1] == label(4.0)
    states, run = coast(make_exact_run(motion), drop_rows(series, slice(200, 200 + round(GAP_S / 0.02))), EXACT)
    assert run is not None
    states, run = coast(make_exact_run(motion), drop_rows(series, slice(0, 60)), EXACT)
    assert run is None
    assert states.gpst.tolist() == label([0.0]).tolist()


def test_without_later_readings_the_run_stays():
    run = make_exact_run(MOTIONS["round"], 20.0)
    states, same = coast(run, make_readings(MOTIONS["round"]), EXACT)
    assert same is run
    assert states.gpst.size == 1


def test_a_start_needs_a_covariance():
    with pytest.raises(ValueError, match="covariance"):
        begin_free_run(make_truth(MOTIONS["round"], [0.0]), EXACT)


def test_the_tilt_that_accelerometers_show_is_the_attitudes():
    motion = MOTIONS["at rest"]
    series, state = make_readings(motion, duration_s=1.0), make_truth(motion, [0.0])
    assert measure_apparent_tilt_rad(state, series.specific_force_m_s2) < 1e-9
    rolled = replace(state, attitude=state.attitude @ Rotation.from_euler("x", 30.0, degrees=True).as_matrix())
    wanted = np.arccos(np.cos(0.1) ** 2 * np.cos(np.radians(30.0)) + np.sin(0.1) ** 2)
    assert measure_apparent_tilt_rad(rolled, series.specific_force_m_s2) == pytest.approx(wanted, abs=1e-4)
    upside_down = series.specific_force_m_s2 * [1.0, -1.0, -1.0]
    assert measure_apparent_tilt_rad(state, upside_down) > np.radians(150.0)
