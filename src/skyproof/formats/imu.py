"""Readings of an inertial unit from CSV or Parquet.

Columns: `gpst` or `time_s` (see `skyproof.formats.timed_rows`), `accel_x_m_s2` to `accel_z_m_s2`, specific force, which
is 9.8 m/s2 upwards at rest, and `gyro_x_rad_s` to `gyro_z_rad_s`, relative to inertial space: means over the intervals
that end at the time, in the unit's own axes. Rows come at an even rate. A row that lacks a number, or is absent, is a
reading that is missing, which is reported and left out of the series.

A logger may read a unit out faster than it renews its readings: then rows repeat the one before, and the times are the
logger's. Summed up as they stand, some readings count once and others twice, by chance. Repeats are left out, and the
others get even times of the unit's own clock, which runs by the logger's over ten seconds.

Units that are confused are noticed by what the numbers say, and refused: accelerations by gravity; rates by how far
gravity turns in the accelerometers where the body tilts, or by turns that are too fast. Rates of a body that does
neither show nothing.
"""

import os
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from skyproof.arrays import Indices, Instants, Integers, Reals
from skyproof.errors import InputError
from skyproof.formats.timed_rows import TimedRows, read_timed_rows
from skyproof.records import ImuSeries
from skyproof.remarks import Remark, RemarkKind

__all__ = ["COLUMNS", "ImuFile", "imu_from_rows", "read_imu"]

COLUMNS: Final = tuple(f"accel_{axis}_m_s2" for axis in "xyz") + tuple(f"gyro_{axis}_rad_s" for axis in "xyz")
_NO_READING: Final = 1e5  # m/s2 or rad/s: what no unit measures
_UNEVEN: Final = 0.2  # of an interval, root mean square: more is no even rate
_REPEATED: Final = 0.05  # of the rows, if a logger reads faster than the unit renews; fewer are chance
_EVEN_S: Final = 10.0
_INTERVAL_S: Final = 1e-4, 0.5
"""Between readings. Units give 10 to 4000 a second, rarely 10 000. In half a second a body turns and brakes too much
for one mean; and readings a second apart or more are what a time in milliseconds looks like."""
_TIME_UNITS: Final = {
    "milliseconds": 1e-3,
    "microseconds": 1e-6,
    "nanoseconds": 1e-9,
    "minutes": 60.0,
    "hours": 3600.0,
    "days": 86_400.0,
}
_LEAST_SHARE: Final = 0.5  # of the readings that an even rate makes between the first and the last
_FORCE_M_S2: Final = 5.0, 20.0  # between which the median of a body that moves on the Earth lies
_FORCE_UNITS: Final = (("g", 9.80665), ("mg", 9.80665e-3), ("ft/s2", 0.3048))
_FASTEST_RAD_S: Final = 10.0  # over a block: one and a half turns a second
_BLOCK_S: Final = 0.5  # over which rates and gravity's direction are averaged
_SURE: Final = 10.0  # standard errors
_ALIKE: Final = 0.5, 2.0  # of the slope that confused units would have


@dataclass(frozen=True, eq=False, kw_only=True)
class ImuFile:
    """Readings as `ImuSeries`, but for the instant of `time_s` = 0, which the file does not state.

    time_ns : (n,) ends of the intervals: of `datetime64[ns]` if `dated`, else since `time_s` = 0.
    specific_force_m_s2, angular_rate_rad_s : (n, 3) in body axes.
    """

    source: str
    time_ns: Integers
    dated: bool
    interval_s: float
    specific_force_m_s2: Reals
    angular_rate_rad_s: Reals
    remarks: tuple[str, ...] = ()

    def series(self, zero_gpst: np.datetime64) -> ImuSeries:
        """Convert the readings to GPS time.

        zero_gpst : instant of `time_s` = 0, unused where the file has `gpst`.
        """
        zero: np.datetime64 = np.datetime64(0, "ns") if self.dated else zero_gpst.astype("datetime64[ns]")
        gpst: Instants = zero + self.time_ns.astype("timedelta64[ns]")
        return ImuSeries(
            gpst=gpst,
            interval_s=self.interval_s,
            specific_force_m_s2=self.specific_force_m_s2,
            angular_rate_rad_s=self.angular_rate_rad_s,
        )


def read_imu(path: str | os.PathLike[str], *, rot_body_unit: ArrayLike | None = None) -> ImuFile:
    """Read the readings in a file that ends in .csv or .parquet, in body axes (forward, right, down).

    rot_body_unit : (3, 3) rotation from the unit's axes to the body's; the same axes if absent.

    Raises
    ------
    InputError : as `read_timed_rows`; rows at no even rate, or at one that no unit has; fewer than two whole ones;
    numbers that no body on the Earth gives in these units.
    """
    return imu_from_rows(read_timed_rows(path, COLUMNS, "the inertial readings"), rot_body_unit=rot_body_unit)


def imu_from_rows(rows: TimedRows, *, rot_body_unit: ArrayLike | None = None) -> ImuFile:
    """Return the readings in rows with the columns `COLUMNS`; otherwise as `read_imu`."""
    whole = np.flatnonzero((np.abs(rows.values) < _NO_READING).all(axis=1))
    if whole.size < 2:
        raise InputError(
            f"{rows.source}: {whole.size} rows have all six readings, expected two or more; give a file with readings"
        )
    whole, late_s, repeats = _select_renewed(rows, whole)
    force, rate = rows.values[whole, :3], rows.values[whole, 3:]
    _require_interval(rows, whole)
    interval_s, steps = _estimate_rate(rows, whole, late_s)
    _require_force(rows.source, force)
    _require_turning(rows.source, force, rate, steps, interval_s)
    rotation = np.eye(3) if rot_body_unit is None else np.asarray(rot_body_unit, np.float64)
    return ImuFile(
        source=rows.source,
        time_ns=_space_times(rows.time_ns[whole], steps, interval_s) if late_s > 0.0 else rows.time_ns[whole],
        dated=rows.dated,
        interval_s=interval_s,
        specific_force_m_s2=force @ rotation.T,
        angular_rate_rad_s=rate @ rotation.T,
        remarks=(*rows.remarks, *repeats, *_report_gaps(steps, interval_s)),
    )


def _select_renewed(rows: TimedRows, whole: Indices) -> tuple[Indices, float, tuple[str, ...]]:
    """Select the rows that do not repeat the reading before; with their lateness, and what to report.

    Where there are only repeats, a reading without noise is that of a body that stands: all rows are kept.
    """
    new = np.append(True, (np.diff(rows.values[whole], axis=0) != 0.0).any(axis=1))
    repeated = int(whole.size - new.sum())
    if not _REPEATED * whole.size < repeated < 0.9 * whole.size:
        return whole, 0.0, ()
    read_s = float(np.median(np.diff(rows.time_ns[whole]))) * 1e-9
    words = (
        f"{repeated} of {whole.size} rows repeat the reading before, as if the unit were read every "
        f"{1e3 * read_s:.3g} ms but renewed its readings less often; they are left out"
    )
    return whole[new], read_s, (words,)


def _require_interval(rows: TimedRows, whole: Indices) -> None:
    """Raise InputError if readings come as often as from no unit, with the unit of time that would explain it."""
    usual_s = float(np.median(np.diff(rows.time_ns[whole]))) * 1e-9
    least_s, most_s = _INTERVAL_S
    if least_s <= usual_s <= most_s:
        return
    column, remedy = "gpst" if rows.dated else "time_s", "give the readings as the unit makes them"
    likely = {name: size for name, size in _TIME_UNITS.items() if least_s <= usual_s * size <= most_s}
    if likely and not rows.dated:
        units = (f"in {name} ({1.0 / (usual_s * size):.4g} a second): {size:g}" for name, size in likely.items())
        remedy = f"multiply time_s, if it is {', or '.join(units)}"
    raise InputError(
        f"{rows.where(int(whole[1]))}, {column}: a reading every {usual_s:.4g} s is usual, expected one every "
        f"{least_s:g} to {most_s:g} s; {remedy}"
    )


def _estimate_rate(rows: TimedRows, whole: Indices, late_s: float = 0.0) -> tuple[float, Integers]:
    """Estimate an interval's length, and count the intervals between neighbouring readings (n - 1,).

    A gap has more than one.

    late_s : by which each time may be late. Raises InputError if no even rate can be seen in them.
    """
    apart_s = np.diff(rows.time_ns[whole]) * 1e-9
    usual_s = float(np.median(apart_s))
    alone = apart_s < 1.5 * usual_s + late_s
    steps = np.where(alone, 1.0, np.maximum(np.rint(apart_s / apart_s[alone].mean()), 1.0))
    interval_s = float(apart_s.sum() / steps.sum())
    uneven = apart_s / interval_s - steps
    if (
        np.sqrt(np.mean(uneven**2)) > np.hypot(_UNEVEN, late_s / interval_s / np.sqrt(2.0))
        or apart_s.size < _LEAST_SHARE * steps.sum()
    ):
        worst = int(np.argmax(np.abs(uneven)))
        raise InputError(
            f"{rows.where(int(whole[worst + 1]))}: {apart_s[worst]:.6g} s after the reading before, where one every "
            f"{usual_s:.6g} s is usual: the rate is not even, or most readings are missing; give readings "
            "at an even rate"
        )
    return interval_s, steps.astype(np.int64)


def _space_times(time_ns: Integers, steps: Integers, interval_s: float) -> Integers:
    """Times (n,) without the lateness of each: even intervals, which follow the mean over `_EVEN_S`."""
    even_ns = np.append(0, np.cumsum(steps)) * (1e9 * interval_s)
    late_ns = (time_ns - time_ns[0]) - even_ns
    usual_ns = ndimage.uniform_filter1d(late_ns, round(_EVEN_S / interval_s) | 1, mode="reflect")
    return np.asarray(time_ns[0] + np.rint(even_ns + usual_ns).astype(np.int64))


def _report_gaps(steps: Integers, interval_s: float) -> tuple[str, ...]:
    """Report gaps."""
    gaps = steps[steps > 1]
    if not gaps.size:
        return ()
    return (
        Remark(
            f"{int((gaps - 1).sum())} of {int(steps.sum()) + 1} readings are missing, in {gaps.size} gaps; the longest "
            f"is {gaps.max() * interval_s:.3g} s",
            RemarkKind.BEARS,
        ),
    )


def _require_force(source: str, force: Reals) -> None:
    """Raise InputError unless the accelerometers feel about gravity, as all that moves on the Earth does."""
    usual = float(np.median(np.linalg.norm(force, axis=1)))
    if _FORCE_M_S2[0] <= usual <= _FORCE_M_S2[1]:
        return
    near = [(name, size) for name, size in _FORCE_UNITS if _FORCE_M_S2[0] <= usual * size <= _FORCE_M_S2[1]]
    if near:
        name, size = min(near, key=lambda unit: abs(np.log(usual * unit[1] / 9.8)))
        raise InputError(
            f"{source}: the accelerations are {usual:.4g} in the middle, as gravity is in {name}, expected m/s2; "
            f"multiply them by {size:g}"
        )
    raise InputError(
        f"{source}: the accelerations are {usual:.4g} m/s2 in the middle, expected about 9.8, which gravity is; give "
        "specific force in m/s2, with gravity in it"
    )


def _require_turning(source: str, force: Reals, rate: Reals, steps: Integers, interval_s: float) -> None:
    """Raise InputError if the rates are in degrees a second, or turn against the accelerometers.

    Between two blocks of half a second the direction of the mean force turns by minus the angle that the gyros sum up.
    Accelerations disturb that, but are unrelated to it. So the slope of one over the other is 1, with its own error.
    Where nothing tilts it is 0 within that error, which decides nothing.
    """
    length = max(round(_BLOCK_S / interval_s), 1)
    count = len(rate) // length
    means = rate[: count * length].reshape(count, length, 3).mean(axis=1)
    fastest = float(np.linalg.norm(means, axis=1).max(initial=0.0)) if length * interval_s > 0.5 * _BLOCK_S else 0.0
    slope, sigma = _fit_slope(force, means, steps, length, interval_s)
    remedy = "expected rad/s; multiply them by pi / 180"
    if slope > _SURE * sigma and _ALIKE[0] < np.degrees(slope) < _ALIKE[1]:
        raise InputError(
            f"{source}: gravity turns in the accelerometers by {slope:.4f} of the gyros' angles, as if the gyros "
            f"were in degrees a second; {remedy}"
        )
    if fastest > _FASTEST_RAD_S:
        raise InputError(
            f"{source}: the gyros read {fastest:.3g} for half a second, {fastest / (2.0 * np.pi):.1f} turns a second, "
            f"{remedy} if they are in degrees a second"
        )
    if -slope > _SURE * sigma and _ALIKE[0] < -slope < _ALIKE[1]:
        raise InputError(
            f"{source}: gravity turns in the accelerometers against the gyros (slope {slope:.2f}, "
            "expected 1): the axes of the two differ, or one has a wrong sign; give both in the same right-handed axes"
        )


def _fit_slope(force: Reals, means: Reals, steps: Integers, length: int, interval_s: float) -> tuple[float, float]:
    """Fit the turn of gravity's direction over the gyros' angle; with its standard error (infinite if unknown)."""
    count = len(means)
    ends = np.concatenate(([0], np.cumsum(steps)))
    whole = ends[length - 1 :: length][:count] - ends[: count * length : length] == length - 1  # no gap within
    joined = np.append(steps, 2)[length - 1 : (count - 1) * length : length] == 1
    pull = force[: count * length].reshape(count, length, 3).mean(axis=1)
    pull /= np.linalg.norm(pull, axis=1, keepdims=True) + 1e-300
    turn = 0.5 * (means[1:] + means[:-1]) * (length * interval_s)
    seen, gyro_turn = np.diff(pull, axis=0), -np.cross(turn, 0.5 * (pull[1:] + pull[:-1]))
    used = whole[1:] & whole[:-1] & joined & (np.linalg.norm(seen, axis=1) < 0.5)
    seen, gyro_turn = seen[used].ravel(), gyro_turn[used].ravel()
    power = float(gyro_turn @ gyro_turn)
    if seen.size < 30 or power == 0.0:
        return 0.0, np.inf
    slope = float(gyro_turn @ seen) / power
    return slope, float(np.sqrt(np.mean((seen - slope * gyro_turn) ** 2) / power))
