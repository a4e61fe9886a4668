"""How an antenna moved between two rows of measurements, by an inertial unit: the known input of a vector filter.

The navigator begins where and when the filter does, with the attitude that was stated at the first reading and that the
gyros carried until then. It then runs free, and only changes from row to row are taken from it: what it has of position
and velocity beyond that is of no account. No measurement corrects it. What its accelerations may be off by (tilts, in
which gravity is taken for them, and biases) lasts, while the filter's noise is white: it is as large as such an error
makes a velocity within `LASTS_S`, and larger than it at any time before.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertia import readings_between
from skyproof.navigation.inertial_predictor import begun
from skyproof.navigation.ins import GRAVITY_M_S2, InsSettings, InsState, step
from skyproof.navigation.ins_updates import antenna_of
from skyproof.navigation.nav_estimate import NavEstimate
from skyproof.navigation.vector_filter import VectorState
from skyproof.records import Attitude, InertialReadings

__all__ = ["LASTS_S", "AntennaUnit", "FreeMotion", "Moved", "carried", "carrying"]

LASTS_S: Final = 60.0
"""For so long a channel goes on without a signal."""


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


def carrying(unit: AntennaUnit, filtered: VectorState, gpst: np.datetime64) -> FreeMotion | None:
    """A navigator that begins with a filter at an instant; None where the readings do not reach there, or the attitude
    is not known any more."""
    fix = NavEstimate(gpst=gpst, mean=filtered.mean, covariance=filtered.covariance)
    state = begun(unit.readings, unit.initial, fix, unit.settings)
    return None if state is None else _at(unit, state, gpst)


def carried(own: FreeMotion, gpst: np.datetime64) -> tuple[FreeMotion, Moved] | None:
    """At a later instant, and how the antenna moved until then; None where readings are missing."""
    readings = own.unit.readings
    rows = readings_between(readings, own.state.gpst, gpst)
    state = step(own.state, rows, own.unit.settings)[1] if rows.gpst.size else own.state
    if state is None or not 0.0 <= float(seconds_between(gpst, state.gpst)) < 2.0 * readings.interval_s:
        return None
    after = _at(own.unit, state, gpst)
    change = after.antenna - own.antenna
    change[:3] -= own.antenna[3:] * float(seconds_between(gpst, own.gpst))
    return after, Moved(change, LASTS_S * _wrong2(state, own.unit.settings))


def _at(unit: AntennaUnit, state: InsState, gpst: np.datetime64) -> FreeMotion:
    return FreeMotion(unit=unit, state=state, gpst=gpst, antenna=antenna_of(state, unit.settings, gpst).mean[:6].copy())


def _wrong2(state: InsState, settings: InsSettings) -> float:
    """Variance of a lasting error of acceleration along any axis, (m/s^2)^2."""
    tilt2 = float(np.linalg.eigvalsh(state.covariance[6:9, 6:9])[-1])
    grade = settings.grade
    return GRAVITY_M_S2**2 * tilt2 + grade.accelerometer_repeatability_m_s2**2 + grade.accelerometer_instability_m_s2**2
