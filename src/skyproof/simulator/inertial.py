"""Simulate an inertial unit on a moving body: specific force and angular rate, with its grade's errors.

A reading is a mean over its interval: velocity and angle increments divided by the interval, as sensors that integrate
give them. They are integrals of the true motion in the turning axes of the sensor, by Gauss-Legendre quadrature of
eighth order over panels of at most 10 ms, so that coning and sculling are in them as in reality, and what a navigator
loses of them is its own. Without errors they lead back to the trajectory: measured over 233 s at 100 Hz, within 0.02 mm
of one with 1.3 g, kilometres and a 3 Hz shaking.

With C the body's attitude (body to ECEF), omega its rate relative to ECEF in body axes, Omega the Earth's, gamma
gravity (attraction and centrifugal) and r, v, a in ECEF (Groves, Principles of GNSS, Inertial, and Multisensor
Integrated Navigation Systems, 2nd ed., 5.2 and 5.3, turned round):

    angular rate     omega + C' Omega
    specific force   C' (a + 2 Omega x v - gamma(r))

at a lever arm l from the body's origin, r + C l, v + C (omega x l), and in the body's axes omega' x l + omega x (omega
x l) more; the integral of the former is the difference of omega at the interval's ends, exactly.

Errors, in sensor axes: reading = (1 + scale factors and misalignments) truth + turn-on bias + instability + white
noise, the instability a Gauss-Markov process (Ahmed, Khanafseh, Pervan: GNSS Spoofing Detection and Exclusion by
Decomposition of Complex Cross Ambiguity Function with INS Aiding, ION, equations 14 to 17). Time tags have no error.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.gnss.frames import EARTH_RAD_S
from skyproof.gnss.gravity import compute_gravity_m_s2
from skyproof.gnss.imu_grades import GRADES, ImuGrade
from skyproof.gnss.time import GPS_EPOCH, timedelta_from_s
from skyproof.records import ImuSeries
from skyproof.statistics.gauss_markov import gauss_markov_allan_variance, gauss_markov_path, gauss_markov_step

__all__ = [
    "BLOCK",
    "ImuErrors",
    "ImuReadings",
    "MotionLike",
    "compute_accelerometer_allan_m_s2",
    "compute_gyro_allan_rad_s",
    "simulate_inertial",
]

BLOCK = 4096
"""Readings that are worked out together and have a noise stream of their own, whatever is asked for."""
_PANEL_S = 0.01
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_STREAM = 0x696D75  # sets the errors apart from other random numbers of the same seed
_MAX_RATE_HZ = 10_000.0


class MotionLike(Protocol):
    """Motion of a body at n times: position, velocity, acceleration (n, 3) in ECEF, attitude (n, 3, 3) from body to
    ECEF, and the rate of the body relative to ECEF in body axes (n, 3)."""

    @property
    def position_ecef_m(self) -> Reals: ...
    @property
    def velocity_ecef_m_s(self) -> Reals: ...
    @property
    def acceleration_ecef_m_s2(self) -> Reals: ...
    @property
    def attitude(self) -> Reals: ...
    @property
    def angular_rate_body_rad_s(self) -> Reals: ...


def compute_accelerometer_allan_m_s2(grade: ImuGrade, tau_s: ArrayLike) -> Reals:
    """Compute the Allan deviation of white noise and instability, by theory, at averaging times of any shape."""
    return _compute_allan(
        grade.velocity_random_walk_m_s_rts, grade.accelerometer_instability_m_s2, grade.correlation_s, tau_s
    )


def compute_gyro_allan_rad_s(grade: ImuGrade, tau_s: ArrayLike) -> Reals:
    """Compute the Allan deviation of white noise and instability, by theory, at averaging times of any shape."""
    return _compute_allan(grade.angular_random_walk_rad_rts, grade.gyro_instability_rad_s, grade.correlation_s, tau_s)


def _compute_allan(walk: float, instability: float, correlation_s: float, tau_s: ArrayLike) -> Reals:
    tau_s = np.asarray(tau_s, np.float64)
    slow = gauss_markov_allan_variance(instability, correlation_s, tau_s)
    return np.asarray(np.sqrt(walk**2 / tau_s + slow))


@dataclass(frozen=True, eq=False, kw_only=True)
class ImuErrors:
    """The errors of one unit at one turn-on. The first three columns are the accelerometers, the others the gyros.

    gain : (6, 3), of each sensor for the truth along the three axes, less one for its own.
    bias : (6,), constant.
    drawn : number of a block to noise and instability (BLOCK, 6).
    """

    gain: Reals
    bias: Reals
    drawn: Callable[[int], Reals]

    @classmethod
    def of(cls, grade: ImuGrade, rate_hz: float, n_blocks: int, seed: int, stream: int = 0) -> "ImuErrors":
        """Draw errors for the first `n_blocks` blocks of readings at `rate_hz`. Keeps 48 bytes a block."""
        rng = _make_rng(seed, stream, 0)
        scale = _repeat_three(grade.accelerometer_scale, grade.gyro_scale)
        gain = grade.misalignment_rad * rng.standard_normal((6, 3))
        gain[np.arange(6), np.arange(6) % 3] = scale * rng.standard_normal(6)
        bias = _repeat_three(
            grade.accelerometer_repeatability_m_s2, grade.gyro_repeatability_rad_s
        ) * rng.standard_normal(6)
        sigma = _repeat_three(grade.accelerometer_instability_m_s2, grade.gyro_instability_rad_s)
        white = _repeat_three(grade.velocity_random_walk_m_s_rts, grade.angular_random_walk_rad_rts)
        step = gauss_markov_step(sigma, grade.correlation_s, 1.0 / rate_hz)
        spread: Reals = np.hypot(step.spread * rate_hz, white * np.sqrt(rate_hz))  # of a mean over an interval

        def instability(block: int, start: Reals) -> tuple[Reals, np.random.Generator]:
            rng = _make_rng(seed, stream, block + 1)
            return gauss_markov_path(step, start, rng.standard_normal((BLOCK, 6))), rng

        starts = [sigma * rng.standard_normal(6)]
        for block in range(n_blocks - 1):
            starts.append(instability(block, starts[-1])[0][-1].copy())

        def drawn(block: int) -> Reals:
            path, rng = instability(block, starts[block])
            slow: Reals = (path[1:] + path[:-1]) * (step.half * rate_hz)
            return slow + spread * rng.standard_normal((BLOCK, 6))

        return cls(gain=gain, bias=bias, drawn=drawn)


@dataclass(frozen=True, eq=False, kw_only=True)
class ImuReadings:
    """A unit's readings, worked out when they are read.

    `read(start, count)` gives readings number `start` on, in the unit's own axes (the body's, but for the mounting); it
    is short at the end only, and safe to call from several
    threads. The same readings come, to the byte, whichever stretches are asked for.
    """

    rate_hz: float
    n_samples: int
    grade: ImuGrade | None
    read: Callable[[int, int], ImuSeries]

    def blocks(self, count: int = BLOCK) -> Iterator[ImuSeries]:
        """Iterate over all readings in order, `count` at a time: memory does not grow with the duration."""
        for start in range(0, self.n_samples, count):
            yield self.read(start, count)


def simulate_inertial(
    motion_at: Callable[[Reals], MotionLike],
    *,
    rate_hz: float,
    duration_s: float,
    grade: ImuGrade | str | None = None,
    mounting: ArrayLike | None = None,
    lever_body_m: ArrayLike = (0.0, 0.0, 0.0),
    seed: int = 0,
    stream: int = 0,
    start_s: float = 0.0,
    zero_gpst: np.datetime64 = GPS_EPOCH,
) -> ImuReadings:
    """Simulate the readings of a unit on a body that moves by `motion_at`.

    Parameters
    ----------
    motion_at : times (n,) since the scene's start to the motion of the body's origin; acceleration continuous. It is
        asked for times from `start_s` to `start_s + duration_s`.
    grade : a name of GRADES, errors of one's own, or None for readings without error.
    mounting : (3, 3) rotation from body to sensor axes; the same axes if absent.
    lever_body_m : (3,) from the body's origin to the unit, in body axes.
    seed, stream : of the errors; the same two are the same unit at the same turn-on. Give the scene's seed, and as
        stream the unit's number.
    zero_gpst : the scene's start.

    Raises
    ------
    ScenarioError : a rate, duration, grade, mounting or lever arm that makes no sense.
    """
    if not 0.0 < rate_hz <= _MAX_RATE_HZ:
        raise ScenarioError(
            f"imu.rate_hz: {rate_hz:g}, expected above zero and at most {_MAX_RATE_HZ:g}; give readings a second"
        )
    if not (np.isfinite(duration_s) and duration_s >= 0.0):
        raise ScenarioError(f"imu: duration_s is {duration_s:g}, expected zero or more; give the scene's")
    to_sensor, lever_m = _check_mounting(mounting), np.asarray(lever_body_m, np.float64)
    if lever_m.shape != (3,) or not np.isfinite(lever_m).all():
        raise ScenarioError(
            f"imu.lever_body_m: {lever_m.tolist()}, expected three lengths; give metres forward, right and down"
        )
    quality = _find_grade(grade) if isinstance(grade, str) else grade
    n_samples = int(np.floor(duration_s * rate_hz * (1.0 + 1e-12)))
    n_blocks = -(-n_samples // BLOCK)
    errors = None if quality is None else ImuErrors.of(quality, rate_hz, n_blocks, seed, stream)

    stride = max(1, BLOCK // _count_panels(1.0 / rate_hz))  # slow units need many nodes for each reading

    @lru_cache(maxsize=4)
    def block(number: int) -> Reals:
        count = min(BLOCK, n_samples - number * BLOCK)
        edges_s = start_s + (number * BLOCK + np.arange(count + 1)) / rate_hz
        parts = [_average_readings(motion_at, edges_s[k : k + stride + 1], lever_m) for k in range(0, count, stride)]
        readings: Reals = np.concatenate(parts) @ to_sensor.T  # (count, 2, 3)
        if errors is None:
            return readings
        gained = np.einsum("naj,akj->nak", readings, errors.gain.reshape(2, 3, 3))
        wrong = (errors.bias + errors.drawn(number)[:count]).reshape(count, 2, 3)
        return np.asarray(readings + gained + wrong)

    def read(start: int, count: int) -> ImuSeries:
        if start < 0 or count < 0:
            raise ValueError(f"start {start} and count {count} must not be negative")
        stop = min(start + count, n_samples)
        numbers = range(start // BLOCK, -(-stop // BLOCK)) if start < stop else range(0)
        parts = [block(number)[max(start - number * BLOCK, 0) : stop - number * BLOCK] for number in numbers]
        readings = np.concatenate([np.empty((0, 2, 3)), *parts])
        ends_s = start_s + (start + 1 + np.arange(len(readings))) / rate_hz
        return ImuSeries(
            gpst=zero_gpst + timedelta_from_s(ends_s),
            interval_s=1.0 / rate_hz,
            specific_force_m_s2=readings[:, 0],
            angular_rate_rad_s=readings[:, 1],
        )

    return ImuReadings(rate_hz=rate_hz, n_samples=n_samples, grade=quality, read=read)


def _average_readings(motion_at: Callable[[Reals], MotionLike], edges_s: Reals, lever_m: Reals) -> Reals:
    """Average specific force and angular rate in body axes between neighbouring edges (n + 1,): (n, 2, 3)."""
    interval_s = float(edges_s[-1] - edges_s[0]) / (edges_s.size - 1)
    panels = _count_panels(interval_s)
    middles = (np.arange(panels) + 0.5)[:, np.newaxis]
    shares = ((middles + 0.5 * _NODES) / panels).ravel()  # of the interval
    weights = np.tile(0.5 * _WEIGHTS / panels, panels)
    nodes_s = edges_s[:-1, np.newaxis] + np.diff(edges_s)[:, np.newaxis] * shares
    motion = motion_at(nodes_s.ravel())
    to_body = np.swapaxes(motion.attitude, -1, -2)
    rate_rad_s = np.asarray(motion.angular_rate_body_rad_s)
    swing = np.cross(rate_rad_s, lever_m)  # of the lever arm, in body axes
    position_m = motion.position_ecef_m + _rotate(motion.attitude, lever_m)
    velocity_m_s = motion.velocity_ecef_m_s + _rotate(motion.attitude, swing)
    pull = motion.acceleration_ecef_m_s2 + 2.0 * np.cross(EARTH_RAD_S, velocity_m_s) - compute_gravity_m_s2(position_m)
    force = _rotate(to_body, pull) + np.cross(rate_rad_s, swing)
    values = np.stack([force, rate_rad_s + _rotate(to_body, EARTH_RAD_S)], axis=1)
    means = np.einsum("nkaj,k->naj", values.reshape(edges_s.size - 1, shares.size, 2, 3), weights)
    if lever_m.any():
        ends_rad_s = np.asarray(motion_at(edges_s).angular_rate_body_rad_s)
        means[:, 0] += np.cross(np.diff(ends_rad_s, axis=0), lever_m) / interval_s
    return np.asarray(means)


def _count_panels(interval_s: float) -> int:
    return int(np.ceil(interval_s / _PANEL_S * (1.0 - 1e-9)))


def _rotate(rotation: Reals, vector: Reals) -> Reals:
    return np.asarray(np.einsum("...ij,...j->...i", rotation, vector))


def _check_mounting(mounting: ArrayLike | None) -> Reals:
    rotation = np.eye(3) if mounting is None else np.asarray(mounting, np.float64)
    if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9):
        raise ScenarioError(
            f"imu.mounting: {rotation.tolist()}, expected a rotation; give three rows of length one at right angles to "
            "each other"
        )
    if np.linalg.det(rotation) < 0.0:
        raise ScenarioError("imu.mounting: mirrors the axes; change the sign of one row")
    return rotation


def _repeat_three(accelerometer: float, gyro: float) -> Reals:
    return np.repeat(np.array([accelerometer, gyro]), 3)


def _make_rng(seed: int, stream: int, part: int) -> np.random.Generator:
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(_STREAM, stream, part))))


def _find_grade(grade: str) -> ImuGrade:
    if grade in GRADES:
        return GRADES[grade]
    near = get_close_matches(grade.lower(), GRADES, n=1, cutoff=0.0)[0]
    raise ScenarioError(f"imu.grade: {grade!r} is not a grade, perhaps {near!r}? Known: {', '.join(GRADES)}")
