"""Coast on an inertial unit: from a known start over readings with gaps, with the covariance.

Strapdown (`strapdown`) with the linear error model (`ins_errors`) beside it. It uses no received signal once it has
begun, so that no false signal moves it. The price is drift, which the covariance states.

The error model is linear. It leaves out g psi^2 / 2 of gravity for a tilt psi, and half as much for a tilt and a turn
about the vertical together. The root mean square of that at the start is added to the bias of the accelerometers:
sqrt(2) g times the standard deviations of the tilt and of the largest angle. A run ends where the tilt becomes larger
than `TILT_MOST_RAD`, or, if only the attitude is wanted, any angle than `TURN_MOST_RAD`.

A gap in the readings of up to `GAP_S` is bridged along a straight line. Over a gap of T the mean of a reading is then
off by no more than the readings differ from each other over that time; with D their mean square difference at that
distance, measured on the readings around, velocity and angle gain a variance of T^2 D / 2 an axis: for white noise what
it is, for a random walk six times too much. A longer gap ends the run.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Instants, Integers, Reals
from skyproof.gnss.gravity import compute_gravity_m_s2
from skyproof.gnss.imu_grades import ImuGrade
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.navigation.ins_errors import attach_covariance, build_start_covariance, propagate_covariance
from skyproof.navigation.nav_state import interpolate_state
from skyproof.navigation.strapdown import navigate_paths
from skyproof.records import ImuSeries, InertialReadings, NavState

__all__ = [
    "GAP_S",
    "TILT_MOST_RAD",
    "TURN_MOST_RAD",
    "FreeRun",
    "begin_free_run",
    "coast",
    "compute_turn_and_tilt",
    "measure_apparent_tilt_rad",
    "select_readings",
]

GAP_S: Final = 1.0
TILT_MOST_RAD: Final = np.radians(1.5)
"""One sigma: g psi^2 / 2 is then 3e-3 m/s2, below the bias of the accelerometers of a unit that drifts so fast."""
TURN_MOST_RAD: Final = np.radians(10.0)
_BIAS: Final = np.arange(9, 12)  # of the accelerometers, among the states
_KNOT_S: Final = 0.5  # between covariances, which grow smoothly
_LAST: Final = np.array([-1])


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeRun:
    """A free-running navigator at one instant.

    state : one row, of the unit (not the antenna). covariance : (39 + k, 39 + k) as `ins_errors` has its states, and k
        more of whoever runs it.
    last : (2, 3) specific force and angular rate of the last reading, None before the first.
    """

    state: NavState
    covariance: Reals
    last: Reals | None = None


def begin_free_run(start: NavState, grade: ImuGrade) -> FreeRun:
    """Start a navigator at the last row of `start`, the state of the unit with its covariance."""
    if start.covariance is None:
        raise ValueError("a start without covariance; give one")
    state = start.select(_LAST)
    covariance = build_start_covariance(grade)
    covariance[:9, :9] = start.covariance[-1]
    turn2, tilt2 = compute_turn_and_tilt(state, covariance[None])
    gravity = float(np.linalg.norm(compute_gravity_m_s2(state.position_ecef_m[0])))
    covariance[_BIAS, _BIAS] += 2.0 * gravity**2 * float(tilt2[0] * turn2[0])
    return FreeRun(state=state, covariance=covariance)


def coast(
    run: FreeRun,
    readings: ImuSeries,
    grade: ImuGrade,
    *,
    tilt_most_rad: float = TILT_MOST_RAD,
    turn_most_rad: float = np.inf,
    further: Callable[[float], tuple[Reals, Reals]] | None = None,
) -> tuple[NavState, FreeRun | None]:
    """Integrate the unit's states (n + 1) over later readings, from the run's instant.

    Returns them, and the run at the end.

    Missing readings are bridged and have their states, too. The states end, and the run with them, at a gap longer than
    `GAP_S`, also between the run's instant and the first reading. They also end where the covariance becomes too large
    to be true.

    tilt_most_rad, turn_most_rad : one sigma at which the states end, of angles about level axes and about any. Where
        position and velocity do not matter, only the latter, of `TURN_MOST_RAD`, does.
    further : of k more states, as in `propagate_covariance`.
    """
    whole = _fill_gaps(readings, run.state.gpst[-1])
    path = _integrate_path(run, whole)
    every = max(int(_KNOT_S / readings.interval_s), 1)
    knots = np.unique(np.append(np.arange(0, path.gpst.size, every), path.gpst.size - 1))
    if knots.size == 1:
        return path, None if whole.broken else run
    most_s = 2.0 * max(_KNOT_S, readings.interval_s)  # labels scatter
    sums = np.add.reduceat(whole.extra, knots[:-1])
    covariance = propagate_covariance(
        path.select(knots), grade, run.covariance, extra=sums, most_s=most_s, further=further
    )
    turn2, tilt2 = compute_turn_and_tilt(path.select(knots), covariance)
    holds = (tilt2 < tilt_most_rad**2) & (turn2 < turn_most_rad**2)
    good = int(np.argmin(np.append(holds, False)))
    if good < knots.size:
        knots, covariance = knots[: max(good, 1)], covariance[: max(good, 1)]
        path = path.select(slice(knots[-1] + 1))
    between = interpolate_state(attach_covariance(path.select(knots), covariance), path.gpst)
    states = replace(path, covariance=between.covariance)
    ended = whole.broken or good < len(sums) + 1
    if ended:
        return states, None
    last = np.stack((whole.force[-1], whole.rate[-1]))
    return states, FreeRun(state=states.select(_LAST), covariance=covariance[-1], last=last)


def compute_turn_and_tilt(path: NavState, covariance: Reals) -> tuple[Reals, Reals]:
    """Return the largest variances (n,) of the angles about any axis and about any level one."""
    turn = covariance[:, 6:9, 6:9]
    up = path.position_ecef_m / np.linalg.norm(path.position_ecef_m, axis=1, keepdims=True)
    level = np.eye(3) - up[:, :, None] * up[:, None, :]
    largest = [np.linalg.eigvalsh(each)[:, -1].astype(np.float64) for each in (turn, level @ turn @ level)]
    return largest[0], largest[1]


class _Filled(NamedTuple):
    """Readings at an even rate. extra : (n, 2) variances of velocity and angle that bridging adds at each."""

    gpst: Instants
    interval_s: float
    first_s: float
    force: Reals
    rate: Reals
    extra: Reals
    broken: bool


def _fill_gaps(readings: ImuSeries, start_gpst: np.datetime64) -> _Filled:
    """Bridge the gaps of the readings after an instant, up to the first that is too long.

    `first_s` is the part of the first interval after that instant.
    """
    later = readings.gpst > start_gpst
    gpst, interval_s = readings.gpst[later], readings.interval_s
    force, rate = readings.specific_force_m_s2[later], readings.angular_rate_rad_s[later]
    apart_s = seconds_between(gpst, np.concatenate(([start_gpst], gpst[:-1]))) if gpst.size else np.empty(0)
    steps = np.maximum(np.rint(apart_s / interval_s), 1.0).astype(np.int64)
    long = np.flatnonzero((steps - 1) * interval_s > GAP_S)
    n = int(long[0]) if long.size else gpst.size
    gpst, force, rate, steps = gpst[:n], force[:n], rate[:n], steps[:n]
    rows = np.cumsum(steps) - 1
    every = np.arange(rows[-1] + 1 if n else 0)
    extra = np.zeros((every.size, 2))
    for row in np.flatnonzero(steps > 1):
        missing = int(steps[row]) - 1
        spread = [_compute_difference2(values, missing + 1) for values in (force, rate)]
        extra[rows[row]] = 0.5 * (missing * interval_s) ** 2 * np.array(spread)
    labels = np.interp(every, rows, seconds_between(gpst, start_gpst)) if n else np.empty(0)
    if n and steps[0] > 1:
        labels[: rows[0]] = labels[rows[0]] - interval_s * np.arange(rows[0], 0, -1)
    between = start_gpst + timedelta_from_s(labels)
    if n:
        between[rows] = gpst
    return _Filled(
        gpst=between,
        interval_s=interval_s,
        first_s=float(labels[0]) if n else 0.0,
        force=_interpolate_lines(every, rows, force),
        rate=_interpolate_lines(every, rows, rate),
        extra=extra,
        broken=bool(long.size),
    )


def _interpolate_lines(every: Integers, rows: Integers, values: Reals) -> Reals:
    if rows.size == every.size:
        return values
    return np.column_stack([np.interp(every, rows, axis) for axis in values.T])


def _compute_difference2(values: Reals, distance: int) -> float:
    """Compute the mean square difference of readings (n, 3) that far apart, on the axis where it is largest."""
    distance = min(distance, len(values) - 1)
    if distance < 1:
        return float(np.max(values**2))
    return float(np.max(np.mean((values[distance:] - values[:-distance]) ** 2, axis=0)))


def _integrate_path(run: FreeRun, whole: _Filled) -> NavState:
    """Integrate the states from the start on, without covariance. The first reading may reach back before it."""
    start, before = run.state, run.last
    places, speeds, attitudes = [start.position_ecef_m[-1:]], [start.velocity_ecef_m_s[-1:]], [start.attitude[-1:]]
    n, first = len(whole.force), abs(whole.first_s - whole.interval_s) > 1e-3 * whole.interval_s
    for rows, interval_s in ((slice(0, first), whole.first_s), (slice(first, n), whole.interval_s)):
        if rows.stop > rows.start and n:
            path = navigate_paths(
                places[-1][-1],
                speeds[-1][-1],
                attitudes[-1][-1],
                whole.force[rows],
                whole.rate[rows],
                interval_s,
                before=before,
            )
            before = np.stack((whole.force[rows][-1], whole.rate[rows][-1]))
            for parts, part in zip((places, speeds, attitudes), path, strict=True):
                parts.append(part[1:])
    return NavState(
        gpst=np.concatenate((start.gpst[-1:], whole.gpst)),
        position_ecef_m=np.concatenate(places),
        velocity_ecef_m_s=np.concatenate(speeds),
        attitude=np.concatenate(attitudes),
    )


def measure_apparent_tilt_rad(state: NavState, specific_force_m_s2: ArrayLike) -> float:
    """Measure the angle between the vertical by the state's attitude and by the mean of readings (n, 3).

    Accelerations tilt the latter: a vehicle's by some degrees, an aircraft's in a turn by as much as it banks.
    """
    felt = state.attitude[-1] @ np.mean(np.asarray(specific_force_m_s2, np.float64), axis=0)
    up = -compute_gravity_m_s2(state.position_ecef_m[-1])
    return float(np.arctan2(np.linalg.norm(np.cross(felt, up)), felt @ up))


def select_readings(readings: InertialReadings, start_gpst: np.datetime64, end_gpst: np.datetime64) -> ImuSeries:
    """Select the readings later than one instant and no later than the other."""
    return readings.select(slice(*np.searchsorted(readings.gpst, np.array([start_gpst, end_gpst]), side="right")))
