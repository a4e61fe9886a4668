"""Tell whether an inertial unit may be to blame where position and velocity part from the signals'."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.prediction.policy import POLICY
from skyproof.gnss.time import seconds_between
from skyproof.records import UNTESTED, InertialReadings
from skyproof.statistics.distributions import f_survival

__all__ = ["Departure", "find_blow_m_s", "find_change_m_s", "find_unit_p_value", "is_sudden"]


@dataclass(frozen=True, eq=False)
class Departure:
    """At one instant: velocity by the unit (3,), and what position and velocity by the signals are more (6,).

    covariance : (6, 6) of those of the signals.
    """

    gpst: np.datetime64
    speed_m_s: Reals
    apart: Reals
    covariance: Reals


def find_change_m_s(looks: Sequence[Departure]) -> float:
    """Return by how much the unit shows the velocity to change at most."""
    return float(np.linalg.norm(np.ptp([look.speed_m_s for look in looks], axis=0))) if looks else 0.0


def find_unit_p_value(looks: Sequence[Departure]) -> float:
    """Return the largest p-value of how positions part, whatever the unit errs by: as velocities add up to.

    Errors of the signals' velocities are taken to last, as reflections may. Between looks the unit's velocity may
    wander off and back unseen: as a random walk with the steps that it shows from look to look, whose bridges have
    dt^3 / 12 of its rate in position. That rate is estimated, so the law is F with the degrees of freedom of Welch
    (Biometrika 34, 1947).
    """
    if len(looks) < POLICY.least_looks:
        return UNTESTED
    first, last = looks[0], looks[-1]
    t = np.asarray(seconds_between(np.array([look.gpst for look in looks]), first.gpst), np.float64)
    apart_m_s, each_s = np.array([look.apart[3:] for look in looks]), np.diff(t)
    off_m = last.apart[:3] - first.apart[:3] - np.trapezoid(apart_m_s, t, axis=0)
    spread = first.covariance[:3, :3] + last.covariance[:3, :3] + t[-1] ** 2 * last.covariance[3:, 3:]
    wander_m2_s3 = float(np.mean(np.diff(apart_m_s, axis=0) ** 2 / each_s[:, None]))
    unseen_m2 = wander_m2_s3 * float(np.sum(each_s**3)) / 12.0
    total = spread + unseen_m2 * np.eye(3)
    dof = off_m.size * each_s.size * (np.trace(total) / max(3.0 * unseen_m2, np.finfo(float).tiny)) ** 2
    return float(f_survival(off_m @ np.linalg.solve(total, off_m) / off_m.size, off_m.size, dof))


def is_sudden(looks: Sequence[Departure]) -> bool:
    """Tell whether velocities part within moments and stay so."""
    if len(looks) < POLICY.least_looks:
        return False
    t = np.asarray(seconds_between(np.array([look.gpst for look in looks]), looks[0].gpst), np.float64)
    apart = np.array([look.apart[3:] for look in looks])
    late = apart[t >= t[-1] - POLICY.parts_within_s].mean(axis=0)
    size = float(np.linalg.norm(late))
    if not size:
        return False
    along = apart @ (late / size)
    begun = np.searchsorted(t, t + POLICY.parts_within_s)
    early = np.flatnonzero((begun < t.size) & (t + POLICY.parts_within_s <= t[-1] - POLICY.stays_parted_s))
    return bool(np.any(along[begun[early]] - along[early] >= POLICY.parted_share * size))


def find_blow_m_s(readings: InertialReadings, start: np.datetime64, end: np.datetime64) -> float:
    """Return the largest change of velocity, between two instants, that one reading makes beside its neighbours."""
    rows = slice(*np.searchsorted(readings.gpst, np.array([start, end])))
    force = readings.select(rows).specific_force_m_s2
    if len(force) < 3:
        return np.inf
    alone = force[1:-1] - 0.5 * (force[2:] + force[:-2])
    return float(np.linalg.norm(alone, axis=1).max() * readings.interval_s)
