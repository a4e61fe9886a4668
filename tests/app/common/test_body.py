"""The body's state in the windows of a run: whose position it is, and a covariance that holds whatever signals show."""

import re
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.app.protect.choosing import NAVIGATION, make_inertia, make_takeover
from tests.app.protect.test_choosing import DRIVE
from tests.written import write_table

from skyproof.app.common.body import Body, Carried, body_of, body_states, open_body, with_imu, with_stored_readings
from skyproof.app.common.epoch_source import WholeSource
from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_use import match_tables
from skyproof.app.common.session import Session
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import instantiate_detectors, windows_of
from skyproof.errors import InputError, SettingsError
from skyproof.formats.byte_io import compute_sha256
from skyproof.formats.imu import COLUMNS
from skyproof.formats.imu_pieces import StoredImuFile
from skyproof.formats.pieces import Workspace
from skyproof.fusion.corrected import CorrectedNavigator
from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic, heading_pitch_roll_rad, rot_enu_ecef
from skyproof.gnss.imu_grades import GRADES
from skyproof.navigation.attitude import estimate_interpolation_sigma_rad
from skyproof.navigation.nav_estimate import estimate_from_parts
from skyproof.navigation.predictor import SkyFix
from skyproof.records import Attitude, ConsistentSet, NavigationData, Need, Records, SignalId
from skyproof.simulator.inertial import simulate_inertial
from skyproof.simulator.sky import make_scene
from skyproof.simulator.trajectories import make_circle, make_static
from skyproof.studies.receiver_model import ChannelNoise, model_receptions

START = np.datetime64("2022-01-01T10:30:00", "ns")
HOME_RAD = 0.9, 0.2
HOME = ecef_from_geodetic(*HOME_RAD, 100.0)
TO_ENU = rot_enu_ecef(*HOME_RAD)
ANGLES_DEG = 40.0, 5.0, -3.0
SIGMA_RAD = np.radians(0.2)
SURVEYED = {"lat_deg": np.degrees(0.9), "lon_deg": np.degrees(0.2), "height_m": 100.0, "sigma_m": 0.05}


def shift_time(seconds):
    return START + np.rint(np.asarray(seconds) * 1e9).astype("timedelta64[ns]")


def shift_place(east_m, north_m=0.0):
    return HOME + np.array([east_m, north_m, 0.0]) @ TO_ENU


def make_window(start_s, end_s, *places):
    """Make a window in which signals show these places."""
    sets = tuple(
        ConsistentSet(
            receiver="one",
            signals=(SignalId(f"G{k + 1:02d}"),),
            gpst=shift_time(start_s),
            position_ecef_m=np.asarray(place),
            clock_bias_s=0.0,
            covariance_m2=np.eye(4),
            statistic=1.0,
            dof=1,
            p_value=0.5,
        )
        for k, place in enumerate(places)
    )
    return Records(start_gpst=shift_time(start_s), end_gpst=shift_time(end_s), sets=sets)


def make_platform(**tables):
    return Platform.model_validate(tables, context={"folder": Path()})


def state_attitude(**more):
    heading, pitch, roll = ANGLES_DEG
    return {"heading_deg": heading, "pitch_deg": pitch, "roll_deg": roll, "sigma_deg": 0.2, **more}


def make_body(carrier, names=("one",)):
    return body_of(carrier, open_body(carrier), names, match_tables(carrier, names), START, 300.0)


def find_state(body, records, carried):
    """Return the state of the receiver `one`, None where it is not known, and what is carried on."""
    states, carried = body_states(body, records, carried)
    return states.get("one"), carried


def make_attitude(place=HOME, angles_deg=ANGLES_DEG):
    return attitude_ecef(place, *np.radians(angles_deg))


def measure_error_rad(state, true, row=-1):
    return Rotation.from_matrix(state.attitude[row] @ true.T).magnitude()


def read_sigma_rad(state, row=-1):
    return np.sqrt(np.linalg.eigvalsh(state.covariance[row, 6:, 6:])[-1])


# Stated angles


def test_angles_at_a_surveyed_place_give_a_state_there():
    carrier = make_platform(attitude=state_attitude(), receivers=[{"position": SURVEYED}])
    state, _ = find_state(make_body(carrier), make_window(0.0, 10.0, shift_place(5e5)), Carried())
    assert state.gpst.tolist() == shift_time([0.0, 10.0]).tolist()
    np.testing.assert_allclose(state.position_ecef_m, [HOME, HOME], atol=1e-6)
    np.testing.assert_allclose(state.covariance[0, :3, :3], 0.05**2 * np.eye(3))
    assert measure_error_rad(state, make_attitude()) < 1e-9
    assert read_sigma_rad(state) == pytest.approx(SIGMA_RAD)  # whatever the signals show
    assert not state.velocity_ecef_m_s.any()


def test_a_moving_platform_has_no_surveyed_place_or_fixed_angles():
    carrier = make_platform(motion="moving", attitude=state_attitude(), receivers=[{"position": SURVEYED}])
    assert make_body(carrier) is None
    assert make_body(make_platform(receivers=[{"position": SURVEYED}])) is None


def test_another_receivers_place_is_off_by_their_distance():
    carrier = make_platform(attitude=state_attitude(), receivers=[{"name": "a"}, {"name": "b", "position": SURVEYED}])
    states, _ = body_states(make_body(carrier, ("a", "b")), make_window(0.0, 10.0), Carried())
    sigmas_m = {name: np.sqrt(state.covariance[0, 0, 0]) for name, state in states.items()}
    assert sigmas_m == {"a": pytest.approx(300.0, rel=1e-6), "b": pytest.approx(0.05)}


def test_each_receiver_has_the_place_where_it_was_surveyed():
    north = {**SURVEYED, "lat_deg": SURVEYED["lat_deg"] + 1e-3}
    carrier = make_platform(
        attitude=state_attitude(), receivers=[{"name": "a", "position": SURVEYED}, {"name": "b", "position": north}]
    )
    states, _ = body_states(make_body(carrier, ("a", "b")), make_window(0.0, 10.0, HOME), Carried())
    assert set(states) == {"a", "b", "one"}  # where the third one stands the signals say
    assert np.linalg.norm(states["b"].position_ecef_m[0] - states["a"].position_ecef_m[0]) == pytest.approx(
        111.2, abs=0.2
    )
    assert np.isinf(states["one"].covariance[0, 0, 0])


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.floats(-2e5, 2e5), st.floats(-2e5, 2e5)), min_size=1, max_size=4),
    st.integers(0, 3),
)
def test_without_a_place_the_covariance_holds_the_true_one(offsets, where):
    # The body is at one of the places that signals show: there its attitude is as far off as the sigma allows.
    places = [shift_place(*offset) for offset in offsets]
    true = places[where % len(places)]
    state, _ = find_state(
        make_body(make_platform(attitude=state_attitude())), make_window(0.0, 10.0, *places), Carried()
    )
    assert np.isinf(state.covariance[:, range(6), range(6)]).all()
    satellite = true + 2.2e7 * true / np.linalg.norm(true) + 1e7 * TO_ENU[0]
    directions = [
        (satellite - place) / np.linalg.norm(satellite - place) for place in (true, state.position_ecef_m[-1])
    ]
    in_body = make_attitude(true).T @ directions[0], state.attitude[-1].T @ directions[1]
    wrong_rad = np.linalg.norm(np.cross(*in_body))
    assert wrong_rad**2 <= read_sigma_rad(state) ** 2 - SIGMA_RAD**2 + 1e-14


def test_places_too_far_apart_or_missing_give_no_state():
    stays = make_body(make_platform(attitude=state_attitude()))
    assert find_state(stays, make_window(0.0, 10.0), Carried())[0] is None
    assert find_state(stays, make_window(0.0, 10.0, HOME, shift_place(2e6)), Carried())[0] is None


# Angles from a file


def write_attitude(tmp_path, seconds, heading_deg):
    path = tmp_path / "attitude.csv"
    n = len(seconds)
    write_table(
        path,
        {"time_s": seconds, "heading_deg": heading_deg, "pitch_deg": np.full(n, 5.0), "roll_deg": np.full(n, -3.0)},
    )
    return make_platform(attitude={"file": str(path), "sigma_deg": 0.2})


def test_angles_of_a_file_hold_at_its_times_and_not_in_holes(tmp_path):
    seconds = np.delete(np.arange(0.0, 60.0, 0.5), slice(50, 55))
    turning = make_body(write_attitude(tmp_path, seconds, 350.0 + 2.0 * seconds - 360.0 * (seconds > 5.0)))
    state, carried = find_state(turning, make_window(10.2, 20.0, HOME), Carried())
    assert state.gpst[0] == shift_time(10.0)
    assert state.gpst[-1] == shift_time(20.0)
    assert measure_error_rad(state, make_attitude(angles_deg=(30.0, 5.0, -3.0))) < 1e-9
    assert find_state(turning, make_window(20.0, 30.0, HOME), carried)[0] is None  # 25 to 27 s are missing
    state, _ = find_state(turning, make_window(50.0, 70.0, HOME), carried)
    assert state.gpst[-1] == shift_time(59.5)
    assert find_state(turning, make_window(70.0, 80.0, HOME), carried)[0] is None


def test_what_lies_between_rows_is_in_the_sigma():
    time_s = np.arange(0.0, 60.0, 0.5)
    swing = np.radians(3.0) * np.sin(0.8 * time_s)
    rows = np.column_stack([np.full(time_s.size, 1.0), np.zeros(time_s.size), swing])
    sigma = estimate_interpolation_sigma_rad(Attitude(gpst=shift_time(time_s), angles_rad=rows, sigma_rad=0.0))
    between = np.radians(3.0) * np.sin(0.8 * (time_s[:-1] + 0.25)) - 0.5 * (swing[1:] + swing[:-1])
    assert np.sqrt(np.mean(between**2)) < sigma < 6.0 * np.sqrt(np.mean(between**2))
    assert (
        estimate_interpolation_sigma_rad(
            Attitude(gpst=shift_time([0.0, 1.0]), angles_rad=np.zeros((2, 3)), sigma_rad=0.0)
        )
        == 0.0
    )


# An inertial unit


ROUND = make_circle(HOME, 300.0, 30.0)


@lru_cache
def make_readings(motion, duration_s, grade):
    unit = simulate_inertial(
        motion.at, rate_hz=50.0, duration_s=duration_s, grade=grade, zero_gpst=shift_time(-2.0), seed=3
    )
    return unit.read(0, unit.n_samples)


def make_imu(tmp_path, motion=ROUND, duration_s=60.0, grade="tactical", missing=(), **more):
    """Make a platform with readings that begin two seconds before the signals, and its first attitude."""
    series = make_readings(motion, duration_s, grade)
    values = np.concatenate([series.specific_force_m_s2, series.angular_rate_rad_s], axis=1)
    table = {"gpst": series.gpst, **dict(zip(COLUMNS, values.T, strict=True))}
    path = tmp_path / "imu.csv"
    write_table(path, {name: np.delete(column, list(missing), axis=0) for name, column in table.items()})
    first = motion.at(np.array([0.02]))
    heading, pitch, roll = np.degrees(heading_pitch_roll_rad(first.position_ecef_m, first.attitude)).ravel()
    initial = {"heading_deg": heading, "pitch_deg": pitch, "roll_deg": roll, "sigma_deg": 0.1}
    return {"file": str(path), "grade": grade, "initial": initial, **more}


def carry_through(carried_body, edges_s, *places):
    states, carried = [], Carried()
    for start_s, end_s in pairwise(edges_s):
        state, carried = find_state(carried_body, make_window(start_s, end_s, *places), carried)
        states.append(state)
    return states, carried


def at_s(state):
    return (state.gpst[-1] - shift_time(-2.0)) / np.timedelta64(1, "s")


def test_the_gyros_carry_the_attitude_from_window_to_window(tmp_path):
    states, carried = carry_through(make_body(make_platform(imu=make_imu(tmp_path))), [0.0, 10.0, 20.0, 30.0], HOME)
    assert carried.run is not None
    for k, state in enumerate(states):
        assert state.gpst[0] <= shift_time(10.0 * k)
        assert shift_time(10.0 * k + 9.98) < state.gpst[-1] <= shift_time(10.0 * k + 10.02)
        true = ROUND.at(np.array([at_s(state)])).attitude[0]
        error = Rotation.from_matrix(state.attitude[-1] @ true.T).as_rotvec()
        assert error @ np.linalg.solve(state.covariance[-1, 6:, 6:], error) < 16.3  # 1e-3 of chi-square of three
        assert np.isinf(state.covariance[-1, 0, 0])
    sigmas = [read_sigma_rad(state) for state in states]
    assert np.radians(0.1) < sigmas[0] < sigmas[1] < sigmas[2] < np.radians(0.3)


def test_cuts_of_the_run_change_nothing(tmp_path):
    unit = make_body(make_platform(imu=make_imu(tmp_path)))
    fine, _ = carry_through(unit, [0.0, 3.0, 3.7, 12.0, 20.0, 30.0], HOME)
    coarse, _ = carry_through(unit, [0.0, 30.0], HOME)
    assert fine[-1].gpst[-1] == coarse[-1].gpst[-1]
    assert measure_error_rad(fine[-1], coarse[-1].attitude[-1]) < 1e-7
    np.testing.assert_allclose(read_sigma_rad(fine[-1]), read_sigma_rad(coarse[-1]), rtol=1e-3)


@pytest.mark.parametrize("each", [377, 5000])
def test_readings_on_a_disk_give_the_same_states(tmp_path, monkeypatch, each):
    carrier = make_platform(imu=make_imu(tmp_path))
    files = open_body(carrier)
    monkeypatch.setattr("skyproof.formats.imu_pieces.HELD_READINGS", 100)
    monkeypatch.setattr("skyproof.formats.imu_pieces.PIECE_READINGS", each)
    stored = with_stored_readings(files, Workspace(tmp_path))
    assert isinstance(stored.imu, StoredImuFile)
    names = ("one",)
    held, read = (body_of(carrier, item, names, match_tables(carrier, names), START, 300.0) for item in (files, stored))
    for in_memory, from_disk in zip(
        *(carry_through(item, [0.0, 10.0, 30.0], HOME)[0] for item in (held, read)), strict=True
    ):
        np.testing.assert_array_equal(from_disk.attitude, in_memory.attitude)
        np.testing.assert_array_equal(from_disk.covariance, in_memory.covariance)


def test_later_attacks_do_not_move_the_attitude(tmp_path):
    unit = make_body(make_platform(imu=make_imu(tmp_path)))
    _, carried = find_state(unit, make_window(0.0, 10.0, HOME), Carried())
    state, _ = find_state(unit, make_window(10.0, 20.0, shift_place(1e5), HOME), carried)
    true = ROUND.at(np.array([at_s(state)])).attitude[0]
    assert measure_error_rad(state, true) < np.radians(0.3)
    assert read_sigma_rad(state) > 1e5 / 6.4e6
    _, carried = find_state(unit, make_window(0.0, 10.0, shift_place(1e5)), Carried())
    state, _ = find_state(unit, make_window(10.0, 20.0, HOME), carried)
    assert np.radians(1.0) < measure_error_rad(state, true) < 1.05 * read_sigma_rad(state)


def test_after_a_long_gap_the_stated_attitude_takes_over(tmp_path):
    unit = make_imu(tmp_path, make_static(HOME, heading_rad=0.7), missing=range(500, 600))
    alone, _ = carry_through(make_body(make_platform(imu=unit)), [0.0, 10.0, 20.0], HOME)
    assert alone[0].gpst[-1] == shift_time(8.0)
    assert alone[1] is None
    stated, _ = carry_through(make_body(make_platform(imu=unit, attitude=state_attitude())), [0.0, 10.0, 20.0], HOME)
    assert measure_error_rad(stated[1], make_attitude()) < 1e-9


def test_a_unit_of_other_axes_gives_the_same_states(tmp_path):
    straight, _ = carry_through(make_body(make_platform(imu=make_imu(tmp_path))), [0.0, 10.0], HOME)
    unit = make_imu(tmp_path)
    rotation = Rotation.from_euler("zyx", [0.3, -0.2, 2.0]).as_matrix()
    for axes, rot in (("flu", np.diag([1.0, -1, -1])), ("rfu", np.eye(3)[[1, 0, 2]] * [1, 1, -1]), (None, rotation)):
        lines = Path(unit["file"]).read_text().splitlines()
        rows = [line.split(",") for line in lines[1:]]
        values = np.array([row[1:] for row in rows], np.float64).reshape(-1, 2, 3) @ rot
        turned = tmp_path / "turned.csv"
        columns = dict(zip(COLUMNS, values.reshape(-1, 6).T, strict=True))
        write_table(turned, {"gpst": np.array([row[0] for row in rows], "datetime64[ns]"), **columns})
        other = make_platform(imu={**unit, "file": str(turned), "axes": axes or rot.tolist()})
        states, _ = carry_through(make_body(other), [0.0, 10.0], HOME)
        np.testing.assert_allclose(states[0].attitude, straight[0].attitude, atol=1e-12)
        np.testing.assert_allclose(states[0].covariance, straight[0].covariance, rtol=1e-9)
        if axes is not None:
            assert np.array_equal(states[0].attitude, straight[0].attitude)


def test_times_count_from_the_stated_start_or_the_recordings(tmp_path):
    unit = make_imu(tmp_path)
    path = Path(unit["file"])
    lines = path.read_text().replace("gpst", "time_s").splitlines()
    rows = [f"{0.02 * k:.2f},{line.split(',', 1)[1]}" for k, line in enumerate(lines[1:], 1)]
    path.write_text("\n".join([lines[0], *rows]))
    assert make_body(make_platform(imu=unit)).readings.gpst[0] == shift_time(0.02)
    unit["start_gpst"] = shift_time(-2.0)
    assert make_body(make_platform(imu=unit)).readings.gpst[0] == shift_time(-1.98)


def test_wrong_axes_are_noticed_by_gravity(tmp_path):
    with pytest.raises(SettingsError, match=r"p\.toml: .*imu\.csv is 1\d\d degrees"):
        open_body(make_platform(imu=make_imu(tmp_path, axes="flu")), "p.toml")


def test_readings_without_an_initial_attitude_are_reported(tmp_path):
    unit = make_imu(tmp_path)
    carrier = with_imu(make_platform(), unit["file"])
    files = open_body(carrier)
    unaligned = body_of(carrier, files, ("one",), {}, START, 300.0)
    assert unaligned is not None
    assert find_state(unaligned, make_window(0.0, 10.0, HOME), Carried())[0] is None
    ((path, kind, remarks),) = files.remarks(None, make_window(0.0, 10.0))
    assert (path, kind) == (unit["file"], "inertial readings")
    assert files.sums[path] == compute_sha256(path)
    assert "not stated" in remarks[-1]
    late = files.remarks(None, make_window(1e5, 2e5), files.imu.series(START))
    assert "2022-01-01T10:29:58.0" in next(late)[2][-1]
    timeless = Records(
        start_gpst=np.datetime64("NaT", "ns"), end_gpst=np.datetime64("NaT", "ns")
    )  # nothing was received
    ((_, _, remarks),) = files.remarks(None, timeless, files.imu.series(START))
    assert "not stated" in remarks[-1]
    with pytest.raises(InputError, match=r"none\.csv.*exist"):
        open_body(with_imu(make_platform(imu=unit), "none.csv"))


def test_antennas_in_the_body_are_given_to_detectors(tmp_path):
    tables = [{"name": "one", "body_m": [1.0, 2.0, 0.0]}, {"name": "two", "body_m": [4.0, 2.0, 0.0]}]
    for receivers, known in ((tables, True), ([tables[0], {"name": "two"}], False)):
        carried = make_body(make_platform(imu=make_imu(tmp_path), receivers=receivers), ("one", "two"))
        windows = windows_of([], NavigationData(ephemerides=()), Settings(), body=carried)
        (detector,) = (d for d in instantiate_detectors(Settings(), windows.run) if d.name == "multi_receiver")
        assert (detector.settings.antennas_body_m is not None) is known
        if known:
            np.testing.assert_array_equal(detector.settings.antennas_body_m["two"], [4.0, 2.0, 0.0])
            assert detector.settings.antennas_body_sigma_m == 0.1


def test_files_of_another_time_are_said_to_be_unused(tmp_path):
    carrier = make_platform(imu=make_imu(tmp_path))
    files = open_body(carrier)
    carried = body_of(carrier, files, ("one",), {}, START, 300.0)
    ((_, _, remarks),) = files.remarks(carried, make_window(100.0, 110.0))
    assert re.match(r"not used: .*\b2022-01-01T10:29:58\.0 to 2022-01-01T10:30:58\.0,", remarks[-1])
    assert not next(iter(files.remarks(carried, make_window(0.0, 60.0))))[2]
    (half,) = next(iter(files.remarks(carried, make_window(30.0, 110.0))))[2]
    assert re.match(r"not there\b.*\b2022-01-01T10:29:58\.0 to 2022-01-01T10:30:58\.0,", half)
    assert find_state(carried, make_window(100.0, 110.0, HOME), Carried())[0] is None
    assert find_state(carried, make_window(-30.0, -20.0, HOME), Carried())[0] is None


def test_a_session_gives_the_state_and_the_run_reports_it(tmp_path):
    carried = make_body(make_platform(imu=make_imu(tmp_path)))
    windows = windows_of([], NavigationData(ephemerides=()), Settings(), body=carried)
    assert isinstance(carried, Body)
    assert windows.run.has(Need.NAV_STATE)
    assert not windows_of([], NavigationData(ephemerides=()), Settings()).run.has(Need.NAV_STATE)
    # Nothing was received, so nothing says where it is.
    assert [step.records.nav_state for step in Session(windows, []).steps()] == [{}]
    assert replace(carried, grade=GRADES["consumer"]).grade is not carried.grade


# The navigator that fixes correct


@lru_cache
def make_drive():
    """Make a drive's scene, its measurements, and the prediction of its poor unit."""
    unit = {"grade": "industrial", "rate_hz": 50.0}
    scene = make_takeover(path=DRIVE, imu=unit, duration_s=71.0, onset_s=60.0)
    scene = make_scene(scene.scenario.model_copy(update={"attacks": ()}), NAVIGATION)
    (heard,) = model_receptions(scene, ChannelNoise(code_m=0.5), rng=np.random.default_rng(2))
    (expected,) = make_inertia(scene, Settings(), "industrial").values()
    return scene, heard.reception.observations, expected


def navigate(initial):
    """Return the states of the drive's windows, with the attitude at the first reading."""
    _, o, unit = make_drive()
    predictors = {"bow": replace(unit, initial=initial)}
    carried = Body(readings=unit.readings, initial=initial, grade=GRADES["industrial"])
    windows = windows_of([WholeSource(o)], NAVIGATION, Settings(), body=carried, predictors=predictors)
    session = Session(windows, instantiate_detectors(Settings(), windows.run))
    return [step.records.nav_state.get("bow") for step in session.steps()]


@pytest.mark.parametrize("known", [True, False], ids=["stated", "found"])
def test_fixes_keep_the_attitude_that_gyros_lose(known):
    scene, o, unit = make_drive()
    states = navigate(unit.initial if known else None)
    assert (states[0] is not None) is known
    last = states[-1]
    assert read_sigma_rad(last) < np.radians(1.0)
    assert last.gpst[0] <= o.gpst[o.gpst >= last.gpst[0]][0]
    assert last.gpst[-1] >= o.gpst[-1]
    at = (last.gpst[-1] - scene.scenario.start_gpst) / np.timedelta64(1, "s")
    error = Rotation.from_matrix(last.attitude[-1] @ scene.trajectories["bow"].at(np.array([at])).attitude[0].T)
    error = error.as_rotvec()
    assert error @ np.linalg.solve(last.covariance[-1, 6:, 6:], error) < 16.3
    assert np.isinf(last.covariance[-1, 0, 0])


def test_a_navigator_runs_on_where_nothing_corrects_it():
    scene, o, unit = make_drive()
    true = scene.trajectories["bow"].at(np.zeros(1))
    fix = estimate_from_parts(
        unit.readings.gpst[0],
        position_ecef_m=true.position_ecef_m[0],
        position_m2=np.eye(3),
        velocity_ecef_m_s=true.velocity_ecef_m_s[0],
        velocity_m2_s2=0.01 * np.eye(3),
    )
    navigator = unit.learned(SkyFix(whole=fix, each=(fix,)))
    known = {"bow": CorrectedNavigator(predictor=navigator, kind=None, early=(), until=None, bias_s=0.0)}
    edges = [o.gpst[0] + np.timedelta64(10 * k, "s") for k in range(5)]

    def last_of(cuts):
        carried, states = Carried(), {}
        for begin, end in pairwise(cuts):
            records = replace(make_window(0.0, 1.0, true.position_ecef_m[0]), start_gpst=begin, end_gpst=end)
            states, carried = body_states(Body(readings=unit.readings), records, carried, known)
        return states["one"]

    fine, coarse = last_of(edges), last_of([edges[0], edges[-1]])
    assert fine.gpst[-1] == coarse.gpst[-1]
    assert measure_error_rad(fine, coarse.attitude[-1]) < 1e-7
    np.testing.assert_allclose(read_sigma_rad(fine), read_sigma_rad(coarse), rtol=1e-3)
