"""Inertial readings from files: round trips, axes, gaps, and units that are confused."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.written import write_table

from skyproof.errors import InputError
from skyproof.formats.imu import COLUMNS, read_imu
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.simulator.inertial import simulate_inertial
from skyproof.simulator.motion import AlongMotion
from skyproof.simulator.trajectories import make_circle, make_static, make_way_points

START = np.datetime64("2022-01-01T10:29:58", "ns")
HOME = ecef_from_geodetic(0.9, 0.2, 100.0)
ROUND = make_circle(HOME, 300.0, 30.0)
RANDOM = np.random.default_rng(5)


def make_road():
    """Make a car's way with corners, hills and two starts from rest."""
    lat = 0.9 + np.array([0, 20, 20, 60, 60, 120, 130]) * 1e-6
    lon = 0.2 + np.array([0, 0, 40, 40, 90, 90, 150]) * 1e-6
    height = 100.0 + np.array([0, 6, 12, 4, 0, 9, 3])
    return make_way_points(
        ecef_from_geodetic(lat, lon, height),
        12.0,
        lateral_m_s2=3.0,
        from_rest=True,
        to_rest=False,
        attitude=AlongMotion(bank=False),
    )


def make_readings(motion=ROUND, rate_hz=50.0, duration_s=4.0, grade="tactical", **more):
    unit = simulate_inertial(motion.at, rate_hz=rate_hz, duration_s=duration_s, grade=grade, zero_gpst=START, **more)
    return unit.read(0, unit.n_samples)


def make_table(series, **changes):
    values = np.concatenate([series.specific_force_m_s2, series.angular_rate_rad_s], axis=1)
    return {"gpst": series.gpst} | dict(zip(COLUMNS, values.T, strict=True)) | changes


def write_columns(folder, columns, ending=".csv"):
    path = folder / f"imu{ending}"
    write_table(path, columns)
    return path


def assert_same(found, series):
    return (
        np.array_equal(found.gpst, series.gpst)
        and found.interval_s == pytest.approx(series.interval_s, rel=1e-12)
        and np.array_equal(found.specific_force_m_s2, series.specific_force_m_s2)
        and np.array_equal(found.angular_rate_rad_s, series.angular_rate_rad_s)
    )


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
@pytest.mark.parametrize("dated", [True, False])
def test_readings_that_are_written_come_back(tmp_path, ending, dated):
    series = make_readings(rate_hz=125.0)
    columns = make_table(series)
    if not dated:
        columns["time_s"] = (columns.pop("gpst") - START).astype(np.int64) * 1e-9
    found = read_imu(write_columns(tmp_path, columns, ending))
    assert found.dated == dated
    assert not found.remarks
    assert assert_same(found.series(START), series)


@settings(max_examples=30)
@given(
    st.tuples(*[st.floats(-np.pi, np.pi)] * 3).map(lambda angles: Rotation.from_euler("zyx", angles).as_matrix()),
    st.sampled_from([".csv", ".parquet"]),
)
def test_a_unit_of_any_axes_reads_as_one_that_sits_straight(tmp_path_factory, rot_unit_body, ending):
    folder = tmp_path_factory.getbasetemp()
    turned = make_readings(grade=None, duration_s=0.5, mounting=rot_unit_body)
    found = read_imu(write_columns(folder, make_table(turned), ending), rot_body_unit=rot_unit_body.T)
    straight = make_readings(grade=None, duration_s=0.5)
    np.testing.assert_allclose(found.specific_force_m_s2, straight.specific_force_m_s2, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.angular_rate_rad_s, straight.angular_rate_rad_s, rtol=0, atol=1e-15)


def test_missing_readings_are_left_out_and_reported(tmp_path):
    series = make_readings()
    columns = make_table(series)
    for name, rows in (("accel_y_m_s2", [20, 21]), ("gyro_z_rad_s", [21, 90])):
        columns[name] = columns[name].copy()
        columns[name][rows] = np.nan
    kept = np.delete(np.arange(200), [20, 21, 90, 150, 151, 152])
    absent = {name: np.delete(column, [150, 151, 152]) for name, column in columns.items()}
    found = read_imu(write_columns(tmp_path, absent))
    assert np.array_equal(found.series(START).gpst, series.gpst[kept])
    assert np.array_equal(found.specific_force_m_s2, series.specific_force_m_s2[kept])
    assert found.interval_s == pytest.approx(0.02, rel=1e-9)
    (remark,) = found.remarks
    assert re.findall(r"\d+(?:\.\d+)?", remark) == ["6", "200", "3", "0.08"]


def test_scattered_labels_are_kept_with_a_mean_interval(tmp_path):
    series = make_readings()
    late = np.rint(1e6 * RANDOM.uniform(-3.0, 3.0, 200)).astype("timedelta64[ns]")  # 15 % of an interval
    found = read_imu(write_columns(tmp_path, make_table(series, gpst=series.gpst + late)))
    assert found.interval_s == pytest.approx(0.02, rel=1e-3)
    assert not found.remarks


@settings(max_examples=20)
@given(polled_s=st.floats(0.3, 0.9), seed=st.integers(0, 99))
def test_readings_that_a_logger_repeats_count_once(tmp_path_factory, polled_s, seed):
    # Read out at uneven times, every `polled_s` intervals in the mean: what the unit gave comes back, evenly.
    series = make_readings(duration_s=20.0)
    n, rng = series.gpst.size, np.random.default_rng(seed)
    polls = np.cumsum(polled_s * rng.uniform(0.9, 1.1, round(n / polled_s)))
    seen = np.clip(polls.astype(int), 0, n - 1)
    rows = {name: column[seen] for name, column in make_table(series).items()}
    rows["gpst"] = START + np.rint(polls * series.interval_s * 1e9).astype("timedelta64[ns]")
    found = read_imu(write_columns(tmp_path_factory.mktemp("polled"), rows))
    first, last = seen[0], seen[-1]
    given_once = np.unique(seen)
    assert found.interval_s == pytest.approx(series.interval_s, rel=0.01)
    assert np.array_equal(found.specific_force_m_s2, series.specific_force_m_s2[given_once])
    ends = START + np.rint((given_once + 1) * series.interval_s * 1e9).astype("timedelta64[ns]")
    late_s = (found.series(START).gpst - ends) / np.timedelta64(1, "s")
    assert np.abs(late_s).max() < series.interval_s
    assert np.ptp(late_s) < 0.3 * series.interval_s
    assert given_once.size >= 0.95 * (last - first)
    assert "repeat" in found.remarks[0]


def test_a_body_at_rest_with_constant_readings_keeps_its_rows(tmp_path):
    series = make_readings(make_static(HOME), grade=None)
    rows = make_table(series)
    for name in COLUMNS:
        rows[name] = np.full(series.gpst.size, rows[name][0])
    assert read_imu(write_columns(tmp_path, rows)).time_ns.size == series.gpst.size


@pytest.mark.parametrize(
    "steps_s",
    [
        RANDOM.exponential(0.02, 199),
        np.tile([1e-4, 1e-4, 1e-4, 0.0397], 50)[:199],
        np.where(np.arange(199) % 2, 0.02, 0.1),
    ],
    ids=["random", "in bursts", "most are missing"],
)
def test_times_without_an_even_rate_are_refused(tmp_path, steps_s):
    gpst = START + np.rint(np.cumsum(np.append(0.0, steps_s)) * 1e9).astype("timedelta64[ns]")
    with pytest.raises(InputError, match=r"line \d+: .*\brate\b"):
        read_imu(write_columns(tmp_path, make_table(make_readings(), gpst=gpst)))


@pytest.mark.parametrize(
    ("rate_hz", "factor", "unit"),
    [
        (100.0, 1e3, "milliseconds"),
        (4000.0, 1e6, "microseconds"),
        (200.0, 1e9, "nanoseconds"),
        (200.0, 1.0 / 3600.0, "hours"),
    ],
)
@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_a_time_in_another_unit_is_refused_and_named(tmp_path, rate_hz, factor, unit, ending):
    columns = make_table(make_readings(rate_hz=rate_hz, duration_s=0.5))
    columns.pop("gpst")
    path = write_columns(tmp_path, {"time_s": np.arange(round(0.5 * rate_hz)) / rate_hz * factor, **columns}, ending)
    with pytest.raises(InputError, match=rf"\b{unit} \({rate_hz:g} a second\): "):
        read_imu(path)


@pytest.mark.parametrize("rate_hz", [2.5, 10.0, 4000.0])
def test_rates_that_units_have_are_read(tmp_path, rate_hz):
    found = read_imu(
        write_columns(tmp_path, make_table(make_readings(rate_hz=rate_hz, duration_s=max(8.0 / rate_hz, 0.2))))
    )
    assert found.interval_s == pytest.approx(1.0 / rate_hz)


def test_dated_readings_ten_seconds_apart_are_refused(tmp_path):
    series = make_readings()
    columns = make_table(series, gpst=series.gpst[0] + np.arange(series.gpst.size) * np.timedelta64(10, "s"))
    with pytest.raises(InputError, match=r"gpst: .*\b10 s\b"):
        read_imu(write_columns(tmp_path, columns))


def test_too_few_readings_are_refused(tmp_path):
    columns = {name: column[:3] for name, column in make_table(make_readings()).items()}
    columns["gyro_x_rad_s"] = np.array([0.0, np.nan, np.nan])
    with pytest.raises(InputError, match=r"\b1 rows\b.*\bsix\b"):
        read_imu(write_columns(tmp_path, columns))


# Units


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.0 / 9.80665, r"\bin g\b.*m/s2.* 9\.80665"),
        (1000.0 / 9.80665, r"\bin mg\b"),
        (1.0 / 0.3048, r"\bin ft/s2"),
    ],
)
def test_accelerations_in_other_units_are_noticed(tmp_path, factor, words):
    columns = {
        name: column * factor if "accel" in name else column for name, column in make_table(make_readings()).items()
    }
    with pytest.raises(InputError, match=words):
        read_imu(write_columns(tmp_path, columns))


def test_accelerations_without_gravity_are_noticed(tmp_path):
    columns = make_table(make_readings(make_static(HOME)))
    columns["accel_z_m_s2"] = columns["accel_z_m_s2"] + 9.81
    with pytest.raises(InputError, match=r"expected .*\b9\.8\b"):
        read_imu(write_columns(tmp_path, columns))


def make_sea_motion(seed=0, sway_m_s2=0.3):
    """Make a vessel that rolls by 6 and pitches by 2 degrees, and is shaken besides."""
    rng, time_s = np.random.default_rng(seed), np.arange(1001) / 25.0
    angles = np.column_stack([0.01 * time_s, 0.035 * np.sin(0.9 * time_s + seed), 0.1 * np.sin(0.7 * time_s)])
    attitude = Rotation.from_euler("ZYX", angles)
    rate = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * 25.0
    force = attitude[1:].inv().apply([0.0, 0.0, -9.8]) + sway_m_s2 * rng.standard_normal((1000, 3))
    columns = np.column_stack([force, rate + 0.002 * rng.standard_normal((1000, 3))])
    return {"time_s": time_s[1:]} | dict(zip(COLUMNS, columns.T, strict=True))


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (make_sea_motion(), "gyros .*rad/s.* pi / 180"),
        (
            make_table(make_readings(make_road(), duration_s=30.0)),
            r"\d turns.*rad/s.* pi / 180",
        ),
    ],
    ids=["at sea", "on a road"],
)
def test_rates_in_degrees_are_noticed_by_tilts_and_turns(tmp_path, columns, words):
    degrees = {name: np.degrees(column) if "gyro" in name else column for name, column in columns.items()}
    read_imu(write_columns(tmp_path, columns))
    with pytest.raises(InputError, match=words):
        read_imu(write_columns(tmp_path, degrees))


def test_gyros_that_turn_the_wrong_way_are_noticed(tmp_path):
    mirrored = {name: -column if "gyro" in name else column for name, column in make_sea_motion().items()}
    with pytest.raises(InputError, match=r"\bagainst the gyros\b"):
        read_imu(write_columns(tmp_path, mirrored))


@pytest.mark.parametrize("motion", [make_static(HOME), ROUND, make_road()], ids=["at rest", "round", "road"])
def test_what_is_right_is_never_refused(tmp_path, motion):
    # Consumer noise, too: at rest the gyros' noise says nothing of units.
    for seed in range(6):
        columns = make_table(make_readings(motion, rate_hz=20.0, duration_s=20.0, seed=seed))
        noisy = {
            name: column + 0.02 * np.random.default_rng(seed).standard_normal(400) if name != "gpst" else column
            for name, column in columns.items()
        }
        read_imu(write_columns(tmp_path, noisy, ".parquet"))
        read_imu(write_columns(tmp_path, make_sea_motion(seed, sway_m_s2=0.1 * seed), ".parquet"))
