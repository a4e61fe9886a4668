"""What the studies of exclusion are computed by: inertial units that run free on the approach to Las Vegas, and which
of two fixes they choose.

The paper, and what it prints of each, stand in `dccaf_exclusion`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from skyproof.arrays import Instants, Reals
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.imu_grades import GRADES, ImuGrade
from skyproof.gnss.time import GPS_EPOCH, timedelta_from_s
from skyproof.navigation.ins_errors import STATES, build_start_covariance, propagate_covariance
from skyproof.navigation.strapdown import navigate_paths
from skyproof.records import NavState
from skyproof.simulator.inertial import simulate_inertial
from skyproof.simulator.trajectories import make_las_vegas, make_las_vegas_false
from skyproof.statistics.gauss_markov import gauss_markov_step
from skyproof.statistics.kalman import kalman_update
from skyproof.studies.base import Row, StudySettings
from skyproof.studies.exclusion import choose_fix, wrong_choice_probability, wrong_choice_rule

__all__ = ["BOTH", "SET", "THRESHOLD_S", "approach", "exclusion", "interval", "restart"]

_UP_EAST: Final = np.array([1.0, 0.0, 1.0]) * np.sqrt(0.5)
_FIX_SIGMA_M: Final = np.array([1.5, 1.5, 3.0])
_FIX_M2: Final = np.diag(_FIX_SIGMA_M**2)
_FIX_SPEED_M_S: Final = 0.05  # per axis, of a velocity from Dopplers
_MOMENTS_S: Final = (100, 190, 233)
_INTERVALS_S: Final = (10, 15, 20, 30, 40, 60, 100)
_RESTART_S, _END_S = 190, 233
_RATE_HZ: Final = 2.0  # of the readings: the approach is straight, 0.4 mm are lost
_AT_ONCE: Final = 1000
_FOOT_M: Final = 0.3048
THRESHOLD_S: Final = 232.1
SET, BOTH = "place set", "both updated"


class _Start(NamedTuple):
    position_m: float = 0.0
    velocity_m_s: float = 0.0
    tilt_deg: float = 0.0


def _level(grade: ImuGrade) -> ImuGrade:
    """Remove gain errors, which the paper does not mention: on a straight approach they are a bias."""
    return replace(grade, accelerometer_scale=0.0, gyro_scale=0.0, misalignment_rad=0.0)


def _table_only(grade: ImuGrade) -> ImuGrade:
    return replace(_level(grade), accelerometer_repeatability_m_s2=0.0, gyro_repeatability_rad_s=0.0)


_MOVING: Final = _Start(position_m=1.0, velocity_m_s=0.05)
_UNITS: Final[dict[tuple[str, str], tuple[ImuGrade, _Start]]] = {
    (name, errors): unit
    for name, tilt_deg, calibrated_deg in (("navigation", 0.01, 0.003), ("tactical", 0.1, 0.02))
    for errors, unit in (
        ("table 1", (_table_only(GRADES[name]), _Start())),
        ("table 1, start", (_table_only(GRADES[name]), _MOVING)),
        ("calibrated, start", (_level(GRADES[f"{name}-calibrated"]), _MOVING._replace(tilt_deg=calibrated_deg))),
        ("switch-on, start", (_level(GRADES[name]), _MOVING._replace(tilt_deg=tilt_deg))),
    )
}


# Flying ---------------------------------------------------------------------------------------------------------------


class _Approach(NamedTuple):
    """The true path, second by second, the error-free readings (n, 3) along it, and ECEF to east, north, up."""

    path: NavState
    force: Reals
    rate: Reals
    to_enu: Reals


@lru_cache(maxsize=1)
def _approach() -> _Approach:
    seconds = np.arange(0.0, _END_S + 1.0)
    motion = make_las_vegas().at(seconds)
    path = NavState(
        gpst=_gpst(seconds),
        position_ecef_m=motion.position_ecef_m,
        velocity_ecef_m_s=motion.velocity_ecef_m_s,
        attitude=motion.attitude,
    )
    unit = simulate_inertial(make_las_vegas().at, rate_hz=_RATE_HZ, duration_s=float(_END_S))
    readings = unit.read(0, unit.n_samples)
    to_enu = rot_enu_ecef(*geodetic_from_ecef(motion.position_ecef_m[0])[:2])
    return _Approach(path, readings.specific_force_m_s2, readings.angular_rate_rad_s, to_enu)


def _gpst(seconds: Reals) -> Instants:
    return GPS_EPOCH + timedelta_from_s(seconds)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Flown:
    """States (runs, n + 1, ...) of units that navigate alone from the path's first on, and their readings."""

    places: Reals
    speeds: Reals
    attitudes: Reals
    force: Reals
    rate: Reals

    def drift_m(self, moments_s: Sequence[int]) -> Reals:
        """Return the errors of position (runs, moments, 3), east, north, up."""
        approach = _approach()
        at = [round(moment_s * _RATE_HZ) for moment_s in moments_s]
        return np.asarray((self.places[:, at] - approach.path.position_ecef_m[list(moments_s)]) @ approach.to_enu.T)


def _fly(grade: ImuGrade, start: _Start, runs: int, end_s: int, rng: np.random.Generator) -> _Flown:
    approach, n = _approach(), round(end_s * _RATE_HZ)
    force = approach.force[:n] + _sensor_errors(
        grade.accelerometer_repeatability_m_s2,
        grade.accelerometer_instability_m_s2,
        grade.velocity_random_walk_m_s_rts,
        grade.correlation_s,
        runs,
        n,
        rng,
    )
    rate = approach.rate[:n] + _sensor_errors(
        grade.gyro_repeatability_rad_s,
        grade.gyro_instability_rad_s,
        grade.angular_random_walk_rad_rts,
        grade.correlation_s,
        runs,
        n,
        rng,
    )
    path = approach.path
    turn = Rotation.from_rotvec(np.radians(start.tilt_deg) * rng.standard_normal((runs, 3))).as_matrix()
    places, speeds, attitudes = navigate_paths(
        path.position_ecef_m[0] + start.position_m * rng.standard_normal((runs, 3)),
        path.velocity_ecef_m_s[0] + start.velocity_m_s * rng.standard_normal((runs, 3)),
        turn @ path.attitude[0],
        force,
        rate,
        1.0 / _RATE_HZ,
        gravity_reach_m=2000.0,
    )
    return _Flown(places=places, speeds=speeds, attitudes=attitudes, force=force, rate=rate)


def _sensor_errors(
    repeatability: float,
    instability: float,
    walk: float,
    correlation_s: float,
    runs: int,
    n: int,
    rng: np.random.Generator,
) -> Reals:
    """Draw errors (runs, n, 3) of readings: constant, Gauss-Markov and white."""
    step = gauss_markov_step(instability, correlation_s, 1.0 / _RATE_HZ)
    keep = float(step.keep)
    at_start = instability * rng.standard_normal((runs, 1, 3))
    drive = float(step.drive) * rng.standard_normal((runs, n, 3))
    later, _ = lfilter([1.0], [1.0, -keep], drive, axis=1, zi=keep * at_start)
    slow = np.concatenate((at_start, later), axis=1)
    means = (slow[:, 1:] + slow[:, :-1]) * float(step.half) * _RATE_HZ
    spread = np.hypot(float(step.spread) * _RATE_HZ, walk * np.sqrt(_RATE_HZ))
    constant = repeatability * rng.standard_normal((runs, 1, 3))
    return np.asarray(constant + means + spread * rng.standard_normal((runs, n, 3)))


def _predict_covariance(grade: ImuGrade, start: _Start) -> Reals:
    """Predict the covariance (234, 21, 21), ECEF, by the linear model, without the draws above."""
    first = build_start_covariance(
        grade, position_m=start.position_m, velocity_m_s=start.velocity_m_s, tilt_rad=float(np.radians(start.tilt_deg))
    )
    return propagate_covariance(_approach().path, grade, first)


def _place_enu_m2(covariance: Reals) -> Reals:
    to_enu = _approach().to_enu
    return np.asarray(to_enu @ covariance[..., :3, :3] @ to_enu.T)


def _batches(runs: int) -> list[int]:
    return [min(_AT_ONCE, runs - begin) for begin in range(0, runs, _AT_ONCE)]


def _judge(offset_m: Reals, drift_m: Reals, predicted_m2: Reals, rng: np.random.Generator) -> dict[str, Any]:
    """Count and predict drifts (runs, 3), and which of two fixes `offset_m` apart is chosen."""
    runs = len(drift_m)
    fixes = np.stack((np.zeros((runs, 3)), np.broadcast_to(offset_m, (runs, 3))), axis=1)
    fixes = fixes + _FIX_SIGMA_M * rng.standard_normal((runs, 2, 3))
    choice = choose_fix(drift_m, predicted_m2, fixes, _FIX_M2)
    apart = drift_m[:, None, :] - fixes
    nearest = np.argmin(np.sum(apart**2, axis=-1), axis=-1)
    horizontal = np.argmin(np.sum(apart[..., :2] ** 2, axis=-1), axis=-1)
    sigma_m, expected_m = np.sqrt(np.mean(drift_m**2, axis=0)), np.sqrt(np.diag(predicted_m2))
    return {
        "offset_m": float(np.linalg.norm(offset_m)),
        "east_m": float(sigma_m[0]),
        "north_m": float(sigma_m[1]),
        "up_m": float(sigma_m[2]),
        "east_predicted_m": float(expected_m[0]),
        "north_predicted_m": float(expected_m[1]),
        "up_predicted_m": float(expected_m[2]),
        "wrong_nearest": float(np.mean(nearest)),
        "wrong_horizontal": float(np.mean(horizontal)),
        "wrong_covariance": float(np.mean(choice.nearest)),
        "wrong_predicted": float(wrong_choice_probability(offset_m, predicted_m2, _FIX_M2)),
        "wrong_rule": float(wrong_choice_rule(offset_m, predicted_m2 + _FIX_M2)),
        "chosen_wrong": float(np.mean(choice.chosen == 1)),
        "undecided": float(np.mean(choice.chosen == -1)),
        "trials": runs,
    }


# The studies ----------------------------------------------------------------------------------------------------------


def approach(settings: StudySettings) -> Iterator[Row]:
    """Yield the true and the false path, from the fix to the threshold and on, in axes of the fix. No chance."""
    del settings
    seconds = np.concatenate((np.arange(0.0, 231.0, 10.0), [THRESHOLD_S, float(_END_S)]))
    true, false = make_las_vegas().at(seconds), make_las_vegas_false().at(seconds)
    start = true.position_ecef_m[0]
    to_enu = rot_enu_ecef(*geodetic_from_ecef(start)[:2])
    height_m = geodetic_from_ecef(true.position_ecef_m)[2]
    place_m = (true.position_ecef_m - start) @ to_enu.T
    offset_m = (false.position_ecef_m - true.position_ecef_m) @ to_enu.T
    for k, time_s in enumerate(seconds.tolist()):
        yield {
            "time_s": time_s,
            "east_m": float(place_m[k, 0]),
            "north_m": float(place_m[k, 1]),
            "height_m": float(height_m[k]),
            "height_ft": float(height_m[k]) / _FOOT_M,
            "speed_m_s": float(np.linalg.norm(true.velocity_ecef_m_s[k])),
            "false_east_m": float(offset_m[k, 0]),
            "false_north_m": float(offset_m[k, 1]),
            "false_up_m": float(offset_m[k, 2]),
            "offset_m": float(np.linalg.norm(offset_m[k])),
        }


def exclusion(settings: StudySettings) -> Iterator[Row]:
    """Count the drift of a free-running unit on the approach, and which fix it chooses.

    The false fix is 1 m/s up-east from 90 s on, 100 m away from 190 s on. Both have noise of (1.5, 1.5, 3) m.
    """
    rng = settings.rng()
    runs = settings.count(20_000, 3000)  # a standard deviation is known to 0.5 %, 1.3 %
    for (name, errors), (grade, start) in _UNITS.items():
        drift_m = np.concatenate(
            [_fly(grade, start, batch, _END_S, rng).drift_m(_MOMENTS_S) for batch in _batches(runs)]
        )
        predicted = _place_enu_m2(_predict_covariance(grade, start))
        for k, moment_s in enumerate(_MOMENTS_S):
            offset_m = min(max(moment_s - 90.0, 0.0), 100.0) * _UP_EAST
            judged = _judge(offset_m, drift_m[:, k], predicted[moment_s], rng)
            yield {"grade": name, "errors": errors, "time_s": moment_s, **judged}


def interval(settings: StudySettings) -> Iterator[Row]:
    """Count how long after a clean fix the next choice is safe, and how soon.

    The unit begins with errors of 1 m and 0.05 m/s an axis, and the false fix leaves at once, 1 m/s up-east.
    """
    rng = settings.rng()
    runs = settings.count(20_000, 2000)
    for (name, errors), (grade, start) in _UNITS.items():
        if start == _Start():
            continue  # no fix is free of errors
        drift_m = np.concatenate(
            [_fly(grade, start, batch, _INTERVALS_S[-1], rng).drift_m(_INTERVALS_S) for batch in _batches(runs)]
        )
        predicted = _place_enu_m2(_predict_covariance(grade, start))
        for k, interval_s in enumerate(_INTERVALS_S):
            judged = _judge(interval_s * _UP_EAST, drift_m[:, k], predicted[interval_s], rng)
            yield {"grade": name, "errors": errors, "interval_s": interval_s, **judged}


def restart(settings: StudySettings) -> Iterator[Row]:
    """Take the true fix at 190 s, 100 m from the false one, and choose again at 233 s.

    restart : its place is "set" to the fix, as in the paper; or place, or place and velocity (0.05 m/s an axis), are
    updated by the covariance, which puts velocity, tilt and biases right, too.
    """
    rng = settings.rng()
    runs = settings.count(10_000, 2000)
    for errors in ("table 1", "table 1, start", "calibrated, start", "switch-on, start"):
        grade, start = _UNITS["tactical", errors]
        covariance = _predict_covariance(grade, start)
        drifts: dict[str, list[Reals]] = {how: [] for how in _RESTARTS}
        for batch in _batches(runs):
            flown = _fly(grade, start, batch, _END_S, rng)
            for how, taken in _RESTARTS.items():
                drifts[how].append(_restart_units(flown, covariance[_RESTART_S], taken, grade, rng))
        for how, taken in _RESTARTS.items():
            after = _covariance_after(covariance[_RESTART_S], taken, grade) if taken else covariance[_END_S]
            judged = _judge(100.0 * _UP_EAST, np.concatenate(drifts[how]), _place_enu_m2(after), rng)
            yield {"grade": "tactical", "errors": errors, "restart": how, "time_s": _END_S, **judged}


_RESTARTS: Final = {"none": "", SET: "set", "place updated": "place", BOTH: "velocity"}


def _fix(taken: str) -> tuple[Reals, Reals]:
    """Return what a fix measures of the states (m, 21), and its noise (m, m), ECEF."""
    to_enu = _approach().to_enu
    place_m2 = to_enu.T @ _FIX_M2 @ to_enu
    m = 6 if taken == "velocity" else 3
    noise = place_m2 if m == 3 else block_diag(place_m2, _FIX_SPEED_M_S**2 * np.eye(3))
    return np.eye(m, STATES), np.asarray(noise)


def _covariance_after(covariance: Reals, taken: str, grade: ImuGrade) -> Reals:
    """Compute the covariance at the end (21, 21), from that just before the restart."""
    sensitivity, noise = _fix(taken)
    if taken == "set":
        after = covariance.copy()
        after[:3, :] = after[:, :3] = 0.0
        after[:3, :3] = noise
    else:
        after = kalman_update(covariance, sensitivity, noise, np.zeros(len(noise))).covariance
    path, rest = _approach().path, slice(_RESTART_S, None)
    ahead = NavState(
        gpst=path.gpst[rest],
        position_ecef_m=path.position_ecef_m[rest],
        velocity_ecef_m_s=path.velocity_ecef_m_s[rest],
        attitude=path.attitude[rest],
    )
    return np.asarray(propagate_covariance(ahead, grade, after)[-1])


def _restart_units(flown: _Flown, covariance: Reals, taken: str, grade: ImuGrade, rng: np.random.Generator) -> Reals:
    """Compute drifts (runs, 3) at the end of units that a fix of the true place corrects on their way."""
    if not taken:
        return np.asarray(flown.drift_m((_END_S,))[:, 0])
    approach, k = _approach(), round(_RESTART_S * _RATE_HZ)
    path = approach.path
    sensitivity, noise = _fix(taken)
    runs, m = len(flown.places), len(noise)
    state = np.concatenate((flown.places[:, k], flown.speeds[:, k]), axis=1)
    truth = np.concatenate((path.position_ecef_m[_RESTART_S], path.velocity_ecef_m_s[_RESTART_S]))
    misfit = (state - truth)[:, :m] - rng.standard_normal((runs, m)) @ np.linalg.cholesky(noise).T
    wrong = np.zeros((runs, STATES))
    if taken == "set":
        wrong[:, :3] = misfit
    else:
        wrong = kalman_update(covariance, sensitivity, noise, misfit).change
    elapsed_s = (np.arange(flown.force.shape[1] - k) + 0.5) / _RATE_HZ
    fading = np.exp(-elapsed_s / grade.correlation_s)[:, None]
    bias = wrong[:, None, 9:15] + fading * wrong[:, None, 15:21]
    places, _, _ = navigate_paths(
        state[:, :3] - wrong[:, :3],
        state[:, 3:] - wrong[:, 3:6],
        Rotation.from_rotvec(-wrong[:, 6:9]).as_matrix() @ flown.attitudes[:, k],
        flown.force[:, k:] - bias[..., :3],
        flown.rate[:, k:] - bias[..., 3:],
        1.0 / _RATE_HZ,
        gravity_reach_m=2000.0,
    )
    return np.asarray((places[:, -1] - path.position_ecef_m[_END_S]) @ approach.to_enu.T)
