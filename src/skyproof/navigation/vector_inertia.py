"""Measure an antenna's motion between two rows by an inertial unit: the known input of a vector filter.

The navigator begins where and when the filter does, with the attitude stated at the first reading and carried by the
gyros until then. It then runs free, and only changes from row to row are taken from it; its position and velocity
beyond that do not matter. No measurement corrects it. Errors of its accelerations (tilts, in which gravity is taken for
them, and biases) last, while the filter's noise is white. That noise is as large as such an error makes a velocity
within `LASTS_S`, and larger than it at any time before.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertia import select_readings
from skyproof.navigation.inertial_predictor import begin_at_fix
from skyproof.navigation.ins import GRAVITY_M_S2, InsSettings, InsState, step
from skyproof.navigation.ins_updates import estimate_antenna
from skyproof.navigation.nav_estimate import NavEstimate
from skyproof.navigation.vector_filter import VectorState
from skyproof.records import Attitude, InertialReadings

__all__ = ["LASTS_S", "AntennaUnit", "FreeMotion", "Moved", "begin_motion", "carry_motion"]

LASTS_S: Final = 60.0
"""A channel continues for so long without a signal."""


@dataclass(frozen=True, eq=False)
class AntennaUnit:
    """readings : of the whole run. initial : the attitude at the first of them. settings : with the lever arm to the
    antenna."""

    readings: InertialReadings
    initial: Attitude
    settings: InsSettings


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeMotion:
    """The navigator of a unit at an instant. antenna : (6,) its position and velocity there."""

    unit: AntennaUnit
    state: InsState
    gpst: np.datetime64
    antenna: Reals


class Moved(NamedTuple):
    """change : (6,) of position beside that of an even motion, and of velocity, ECEF. acceleration_m2_s3 : density of
    the random walk of what it leaves open."""

    change: Reals
    acceleration_m2_s3: float


def begin_motion(unit: AntennaUnit, filtered: VectorState, gpst: np.datetime64) -> FreeMotion | None:
    """Start a navigator from a filter at an instant.

    None where the readings do not reach there, or the attitude is not known any more.
    """
    fix = NavEstimate(gpst=gpst, mean=filtered.mean, covariance=filtered.covariance)
    state = begin_at_fix(unit.readings, unit.initial, fix, unit.settings)
    return None if state is None else _make_motion(unit, state, gpst)


def carry_motion(own: FreeMotion, gpst: np.datetime64) -> tuple[FreeMotion, Moved] | None:
    """Advance to a later instant, and measure the antenna's motion until then; None where readings are missing."""
    readings = own.unit.readings
    rows = select_readings(readings, own.state.gpst, gpst)
    state = step(own.state, rows, own.unit.settings)[1] if rows.gpst.size else own.state
    if state is None or not 0.0 <= float(seconds_between(gpst, state.gpst)) < 2.0 * readings.interval_s:
        return None
    after = _make_motion(own.unit, state, gpst)
    change = after.antenna - own.antenna
    change[:3] -= own.antenna[3:] * float(seconds_between(gpst, own.gpst))
    return after, Moved(change, LASTS_S * _compute_wrong2(state, own.unit.settings))


def _make_motion(unit: AntennaUnit, state: InsState, gpst: np.datetime64) -> FreeMotion:
    return FreeMotion(
        unit=unit, state=state, gpst=gpst, antenna=estimate_antenna(state, unit.settings, gpst).mean[:6].copy()
    )


def _compute_wrong2(state: InsState, settings: InsSettings) -> float:
    """Compute the variance of a lasting error of acceleration along any axis, (m/s^2)^2."""
    tilt2 = float(np.linalg.eigvalsh(state.covariance[6:9, 6:9])[-1])
    grade = settings.grade
    return GRAVITY_M_S2**2 * tilt2 + grade.accelerometer_repeatability_m_s2**2 + grade.accelerometer_instability_m_s2**2
