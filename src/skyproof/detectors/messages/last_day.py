"""Bound how far a data set may be from one of the day before that is propagated to its time.

A broadcast orbit is an ellipse whose elements serve for some hours. What they leave out beyond is the tide of Moon and
Sun, of half an orbit's period: an acceleration of a at most. Within the hours of a fit it changes the distance by up to
a / n^2, where n is the mean motion, and so the radius by twice that at most. It changes the mean motion by 1.5 a / (n
r), and so the place along the orbit by 1.5 a t / n after a time t. These are Hill's equations (D. Vallado, Fundamentals
of Astrodynamics and Applications, 4th ed., 6.8). Ranges see `sideways_share` of the part along the orbit. The elements
include the Earth's flattening.

A polynomial propagates the clock. The best prediction of an atomic clock after a time t errs by t sigma / sqrt(ln 2),
where sigma is its Allan deviation over t, here that of a rubidium standard. Source: D. Allan, "Time and frequency
characterization, estimation and prediction of precision clocks and oscillators", IEEE Trans. UFFC 34(6), 1987,
table III: flicker noise, the largest.

Both bounds widen by the accuracies that the two sets state; the difference beyond is normal at most. Orbit and clock
are tested separately. Satellites whose period is a day are left out: they are manoeuvred every few weeks.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from skyproof.detectors.messages.laws import accuracy_sigma_m, differences_m
from skyproof.detectors.messages.policy import POLICY
from skyproof.gnss.constants import MU_M3_S2, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.gnss.time import seconds_between
from skyproof.statistics.distributions import normal_two_sided

__all__ = ["DayDifference", "clock_sigma_m", "difference_over_hours", "is_of_last_day", "orbit_bound_m"]

_TESTS: Final = 2  # orbit and clock


class DayDifference(NamedTuple):
    """The chance of two data sets that differ so, which of orbit and clock differs more, and by how many metres."""

    chance: float
    what: str
    amount_m: float


def is_of_last_day(e: Ephemeris, other: Ephemeris) -> bool:
    """Tell whether another data set of the same message lies within the day around, and no longer serves with it."""
    apart_s = abs(float(seconds_between(e.reference_gpst, other.reference_gpst)))
    same = e.sat == other.sat and e.message == other.message
    return same and POLICY.valid_together_s < apart_s <= POLICY.last_day_s and e.sqrt_a**2 < POLICY.medium_axis_m


def orbit_bound_m(sqrt_a: float, apart_s: float) -> float:
    """Return by how much ranges from an orbit and from one propagated for so long may differ."""
    motion_rad_s = math.sqrt(MU_M3_S2) / sqrt_a**3
    tide_m_s2 = POLICY.tide_per_s2 * sqrt_a**2
    radial_m = 2.0 * tide_m_s2 / motion_rad_s**2
    along_m = 1.5 * tide_m_s2 / motion_rad_s * apart_s
    return radial_m + POLICY.sideways_share * along_m


def clock_sigma_m(apart_s: float) -> float:
    """Return the deviation of a satellite's clock that is propagated for so long."""
    deviation = float(OSCILLATORS["rubidium"].allan_deviation(apart_s))
    return SPEED_OF_LIGHT_M_S * POLICY.clock_spread * deviation * apart_s / math.sqrt(math.log(2.0))


def difference_over_hours(e: Ephemeris, other: Ephemeris) -> DayDifference | None:
    """Compare a data set, at its time, with another one propagated to it; None if one promises no accuracy."""
    sigma_m = accuracy_sigma_m(e, other)
    if sigma_m is None:
        return None
    apart_s = abs(float(seconds_between(e.reference_gpst, other.reference_gpst)))
    radial_m, sideways_m, clock_m = differences_m(e, other, e.reference_gpst)
    orbit_m, clock_m = math.hypot(radial_m, POLICY.sideways_share * sideways_m), abs(clock_m)
    of_orbit = max(0.0, orbit_m - orbit_bound_m(other.sqrt_a, apart_s)) / sigma_m
    of_clock = clock_m / math.hypot(sigma_m, clock_sigma_m(apart_s))
    quantity, amount_m = ("orbit", orbit_m) if of_orbit > of_clock else ("clock", clock_m)
    chance = float(np.minimum(1.0, _TESTS * normal_two_sided(max(of_orbit, of_clock))))
    return DayDifference(chance, quantity, amount_m)
