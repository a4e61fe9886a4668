"""Measurements that correct an inertial navigator: fixes of its antenna, and what it expects of them.

Fixes may be up to a reading's interval later than the state:
the antenna is carried there along its velocity and acceleration.
"""

from typing import NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.frames import EARTH_RAD_S
from skyproof.gnss.gravity import compute_gravity_m_s2
from skyproof.gnss.time import seconds_between
from skyproof.navigation.ins import (
    ATTITUDE,
    CLOCK,
    GYRO,
    LASTING,
    POSITION,
    SIZE,
    VELOCITY,
    InsSettings,
    InsState,
    Measurement,
)
from skyproof.navigation.ins_errors import GAINS, skew
from skyproof.navigation.nav_estimate import KNOWN, NavEstimate

__all__ = ["estimate_antenna", "expect_fix", "measurement_from_fix"]


class _Antenna(NamedTuple):
    """Position, velocity, c times clock bias and drift (8,), and their sensitivity (8, 45) to the state's errors."""

    mean: Reals
    sensitivity: Reals


def _compute_antenna(state: InsState, settings: InsSettings, gpst: np.datetime64) -> _Antenna:
    """Compute the antenna's state at an instant near the navigator's."""
    ahead_s = float(seconds_between(gpst, state.gpst))
    force, rate = state.last
    arm = state.attitude @ settings.lever_m
    swing = state.attitude @ np.cross(rate - EARTH_RAD_S @ state.attitude, settings.lever_m)
    speed, pull = state.velocity_ecef_m_s + swing, np.zeros(3)
    if state.run.last is not None:
        pull = state.attitude @ force + compute_gravity_m_s2(state.position_ecef_m) - 2.0 * np.cross(EARTH_RAD_S, speed)
    clock_m = state.clock_m + [ahead_s * state.clock_m[1], 0.0]
    h = np.zeros((KNOWN, SIZE))
    h[0:3, POSITION] = h[3:6, VELOCITY] = np.eye(3)
    h[0:3, ATTITUDE], h[3:6, ATTITUDE] = -skew(arm), -skew(swing)
    _fill_sensor(h[3:6], GYRO, GAINS[1], -state.attitude @ skew(settings.lever_m), rate)
    h[6:8, CLOCK] = np.eye(2)
    h[0:3] += ahead_s * h[3:6]
    h[6] += ahead_s * h[7]
    place = state.position_ecef_m + arm + ahead_s * speed + 0.5 * ahead_s**2 * pull
    return _Antenna(np.concatenate((place, speed + ahead_s * pull, clock_m)), h)


def _fill_sensor(
    h: Reals, biases: tuple[slice, slice], gains: slice, by: Reals, felt: Reals, slow: float = 1.0
) -> None:
    """Fill the sensitivity of rows (m, 45) to one sensor's errors.

    `by` (m, 3) is that to the sensor's reading, `felt` (3,) the reading, by which gains count.
    """
    h[:, biases[0]], h[:, biases[1]] = by, slow * by
    h[:, gains] = (by[:, :, None] * felt).reshape(len(by), 9)


def estimate_antenna(state: InsState, settings: InsSettings, gpst: np.datetime64 | None = None) -> NavEstimate:
    """Estimate the antenna's true state at the navigator's instant or one near it."""
    gpst = state.gpst if gpst is None else gpst
    mean, h = _compute_antenna(state, settings, gpst)
    return NavEstimate(gpst=gpst, mean=mean, covariance=h @ state.covariance @ h.T)


def expect_fix(state: InsState, settings: InsSettings, gpst: np.datetime64 | None = None) -> NavEstimate:
    """Predict a fix at the antenna, lasting error included, at the navigator's instant or one near it."""
    gpst = state.gpst if gpst is None else gpst
    mean, h = _predict_as_fix(state, settings, gpst)
    return NavEstimate(gpst=gpst, mean=mean, covariance=h @ state.covariance @ h.T)


def _predict_as_fix(state: InsState, settings: InsSettings, gpst: np.datetime64) -> _Antenna:
    mean, h = _compute_antenna(state, settings, gpst)
    rows = [0, 1, 2, 6]
    h[rows, LASTING] = np.eye(4)
    mean[rows] += state.lasting_m
    return _Antenna(mean, h)


def measurement_from_fix(state: InsState, fix: NavEstimate, settings: InsSettings) -> Measurement:
    """Make a measurement of a fix of the antenna, from its known components.

    The covariance is that of the noise alone, which is independent from fix to fix; the lasting error stands in the
    settings.
    """
    mean, h = _predict_as_fix(state, settings, fix.gpst)
    known = fix.there
    return Measurement(
        innovation=(mean - fix.mean)[known], sensitivity=h[known], noise=fix.covariance[np.ix_(known, known)]
    )
