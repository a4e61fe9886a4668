"""What corrects an inertial navigator: fixes of its antenna, and what such a fix is expected to be.

Fixes may be up to a reading's interval later than the state:
the antenna is carried there along its velocity and acceleration.
"""

from typing import NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.frames import EARTH_RAD_S
from skyproof.gnss.gravity import gravity_ecef_m_s2
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

__all__ = ["antenna_of", "by_fix", "expect_fix"]


class _Antenna(NamedTuple):
    """Position, velocity, c times clock bias and drift (8,), and their sensitivity (8, 45) to the state's errors."""

    mean: Reals
    sensitivity: Reals


def _antenna(state: InsState, settings: InsSettings, gpst: np.datetime64) -> _Antenna:
    """What is true of the antenna at an instant near the state's, as the state has it."""
    ahead_s = float(seconds_between(gpst, state.gpst))
    force, rate = state.last
    arm = state.attitude @ settings.lever_m
    swing = state.attitude @ np.cross(rate - EARTH_RAD_S @ state.attitude, settings.lever_m)
    speed, pull = state.velocity_ecef_m_s + swing, np.zeros(3)
    if state.run.last is not None:
        pull = state.attitude @ force + gravity_ecef_m_s2(state.position_ecef_m) - 2.0 * np.cross(EARTH_RAD_S, speed)
    clock_m = state.clock_m + [ahead_s * state.clock_m[1], 0.0]
    h = np.zeros((KNOWN, SIZE))
    h[0:3, POSITION] = h[3:6, VELOCITY] = np.eye(3)
    h[0:3, ATTITUDE], h[3:6, ATTITUDE] = -skew(arm), -skew(swing)
    _of_sensor(h[3:6], GYRO, GAINS[1], -state.attitude @ skew(settings.lever_m), rate)
    h[6:8, CLOCK] = np.eye(2)
    h[0:3] += ahead_s * h[3:6]
    h[6] += ahead_s * h[7]
    place = state.position_ecef_m + arm + ahead_s * speed + 0.5 * ahead_s**2 * pull
    return _Antenna(np.concatenate((place, speed + ahead_s * pull, clock_m)), h)


def _of_sensor(h: Reals, biases: tuple[slice, slice], gains: slice, by: Reals, felt: Reals, slow: float = 1.0) -> None:
    """Put into rows (m, 45) the sensitivity `by` (m, 3) to a sensor's error: biases, and gains by what it felt (3,)."""
    h[:, biases[0]], h[:, biases[1]] = by, slow * by
    h[:, gains] = (by[:, :, None] * felt).reshape(len(by), 9)


def antenna_of(state: InsState, settings: InsSettings, gpst: np.datetime64 | None = None) -> NavEstimate:
    """What is true of the antenna, at the state's instant or one near it."""
    gpst = state.gpst if gpst is None else gpst
    mean, h = _antenna(state, settings, gpst)
    return NavEstimate(gpst=gpst, mean=mean, covariance=h @ state.covariance @ h.T)


def expect_fix(state: InsState, settings: InsSettings, gpst: np.datetime64 | None = None) -> NavEstimate:
    """What a fix at the antenna would say, lasting error included, at the state's instant or one near it."""
    gpst = state.gpst if gpst is None else gpst
    mean, h = _as_a_fix(state, settings, gpst)
    return NavEstimate(gpst=gpst, mean=mean, covariance=h @ state.covariance @ h.T)


def _as_a_fix(state: InsState, settings: InsSettings, gpst: np.datetime64) -> _Antenna:
    mean, h = _antenna(state, settings, gpst)
    rows = [0, 1, 2, 6]
    h[rows, LASTING] = np.eye(4)
    mean[rows] += state.lasting_m
    return _Antenna(mean, h)


def by_fix(state: InsState, fix: NavEstimate, settings: InsSettings) -> Measurement:
    """A fix of the antenna, of which whatever is known counts. Its covariance is that of the noise alone, which is
    another one in the next fix; the lasting error stands in the settings."""
    mean, h = _as_a_fix(state, settings, fix.gpst)
    there = fix.there
    return Measurement(
        innovation=(mean - fix.mean)[there], sensitivity=h[there], noise=fix.covariance[np.ix_(there, there)]
    )
