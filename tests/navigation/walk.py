"""A real walk with a hand-held inertial unit and a carrier-phase receiver, as readings and fixes.

The unit's model is not stated: the grade "consumer" is taken, which its bias at rest fits (0.2 deg/s, 12 mg). The raw
log is read as any log is (`formats.imu`), by the times in GPS time that its owner gave to the same rows: it was read
out every 6 to 9 ms, but the unit renews its readings every 10 ms. Its axes are x, y and z with z up; body axes are x,
-y and -z. The antenna is 5 cm from the unit across the way, as its owner states; the side is that which the fixes
agree with. The fixes of 1 to 3 cm are taken for ones of 5 cm.
"""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tests.written import write_table

from skyproof.formats.imu import COLUMNS, read_imu
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.alignment import align_moving
from skyproof.navigation.inertia import select_readings
from skyproof.navigation.ins import InsSettings, InsState, correct, step
from skyproof.navigation.ins_updates import expect_fix, measurement_from_fix
from skyproof.navigation.nav_estimate import NavEstimate, estimate_from_parts
from skyproof.records import ImuSeries

UNIX = np.datetime64("1970-01-01", "ns")
AXES = np.diag([1.0, -1.0, -1.0])  # from the unit's to the body's
SETTINGS = InsSettings(grade=GRADES["consumer"], oscillator=OSCILLATORS["tcxo"], lever_m=np.array([-0.05, 0.0, 0.0]))
PLACE_M, SPEED_M_S = 0.05, 0.1


@dataclass(frozen=True)
class Walk:
    """readings of the unit; fixes four times a second; seconds (n,) of the fixes since the first reading; to_enu."""

    readings: ImuSeries
    fixes: list[NavEstimate]
    seconds: np.ndarray
    to_enu: np.ndarray


def read_log(folder) -> ImuSeries:
    """Read the raw log through a file, as this program takes it."""
    times = np.loadtxt(folder / "imu_1730_sf.csv", delimiter=",", usecols=0)
    raw = np.genfromtxt(folder / "imu_1730.csv", delimiter=",", skip_header=1, skip_footer=1, usecols=range(6))
    values = np.concatenate((9.80665 * raw[:, :3], np.radians(raw[:, 3:])), axis=1)
    gpst = UNIX + np.rint(times * 1e9).astype("timedelta64[ns]")
    with TemporaryDirectory() as made:
        path = Path(made) / "imu.csv"
        write_table(path, {"gpst": gpst, **dict(zip(COLUMNS, values.T, strict=True))})
        return read_imu(path, rot_body_unit=AXES).series(UNIX)


def read_walk(folder) -> Walk:
    readings = read_log(folder)
    solution = [line.split() for line in (folder / "gnss_1730_sf.pos").read_text().splitlines() if line[0] != "%"]
    values = np.array([[float(word) for word in line[2:]] for line in solution])
    gpst = np.array([np.datetime64(line[0].replace("/", "-") + "T" + line[1], "ns") for line in solution])
    places = ecef_from_geodetic(np.radians(values[:, 0]), np.radians(values[:, 1]), values[:, 2])
    to_enu = rot_enu_ecef(*np.radians(values[0, :2]))
    speeds = values[:, [14, 13, 15]] @ to_enu  # the file has north, east, up
    within = (gpst > readings.gpst[0]) & (gpst <= readings.gpst[-1])
    fixes = [
        estimate_from_parts(
            when,
            position_ecef_m=place,
            position_m2=PLACE_M**2 * np.eye(3),
            velocity_ecef_m_s=speed,
            velocity_m2_s2=SPEED_M_S**2 * np.eye(3),
        )
        for when, place, speed in zip(gpst[within], places[within], speeds[within], strict=True)
    ]
    return Walk(readings, fixes, (gpst[within] - readings.gpst[0]) / np.timedelta64(1, "s"), to_enu)


def align(walk: Walk, start_s: float, end_s: float):
    return align_moving(
        walk.readings,
        [fix for fix, at in zip(walk.fixes, walk.seconds, strict=True) if start_s <= at <= end_s],
        SETTINGS,
        heading_most_rad=np.radians(20.0),
    )


@dataclass(frozen=True)
class Seen:
    """Of a run fix by fix: off (n, 8) what was expected less the fix; spread (n, 8, 8) of that; p_value (n,)."""

    seconds: np.ndarray
    off: np.ndarray
    spread: np.ndarray
    p_value: np.ndarray


def follow(walk: Walk, state: InsState, end_s: float, *, use=None, fixes=None, false_alarm_probability=0.0):
    """Run the filter over the fixes after its instant that `use` takes in; return fixes and states."""
    seconds, off, spread, p_value = [], [], [], []
    for fix, at in zip(fixes or walk.fixes, walk.seconds, strict=True):
        if fix.gpst <= state.gpst or at > end_s:
            continue
        _, state = step(state, select_readings(walk.readings, state.gpst, fix.gpst), SETTINGS)
        if state is None:
            break
        result = expect_fix(state, SETTINGS, fix.gpst)
        seconds.append(at)
        off.append(result.mean - fix.mean)
        spread.append(result.covariance + np.diag(np.diag(fix.covariance)))
        after, fit = correct(
            state, measurement_from_fix(state, fix, SETTINGS), false_alarm_probability=false_alarm_probability
        )
        p_value.append(fit.p_value)
        if use is None or use(at):
            state = after
    return Seen(np.array(seconds), np.array(off), np.array(spread), np.array(p_value)), state
