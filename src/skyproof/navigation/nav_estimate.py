"""What is known of one antenna at one instant: position, velocity and clock with their covariance."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between
from skyproof.records import Fix, FixStatus, freeze

__all__ = ["KNOWN", "NavEstimate", "estimate_from_parts", "estimates_from_fix", "mark_unknown"]

_RATE_SIGMA_M_S: Final = 0.05
"""Of a velocity by Doppler, one sigma for each metre of the position's over `_RANGE_SIGMA_M`: reflections, beside
which the carrier's own noise is small."""
_RANGE_SIGMA_M: Final = 1.0
KNOWN = 8
"""Numbers: ECEF position and velocity, c times clock bias and drift."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NavEstimate:
    """A fix, or what is predicted of one.

    mean : (8,) ECEF position and velocity, c times clock bias and drift, in m and m/s. covariance : (8, 8); the
    variance of what is not known is infinite.
    """

    gpst: np.datetime64
    mean: Reals
    covariance: Reals

    def __post_init__(self) -> None:
        freeze(self, {"mean": (str(KNOWN),), "covariance": (str(KNOWN), str(KNOWN))})

    @property
    def there(self) -> Indices:
        """List which of the eight components are known."""
        return np.flatnonzero(np.isfinite(self.mean) & np.isfinite(np.diag(self.covariance)))


def estimate_from_parts(
    gpst: np.datetime64,
    *,
    position_ecef_m: Reals | None = None,
    position_m2: Reals | None = None,
    velocity_ecef_m_s: Reals | None = None,
    velocity_m2_s2: Reals | None = None,
    clock_m: Reals | None = None,
    clock_m2: Reals | None = None,
) -> NavEstimate:
    """Build an estimate from independent parts, each with its covariance: (3,), (3,), and (2,) of the clock."""
    mean, covariance = np.zeros(KNOWN), np.diag(np.full(KNOWN, np.inf))
    parts = (
        (slice(0, 3), position_ecef_m, position_m2),
        (slice(3, 6), velocity_ecef_m_s, velocity_m2_s2),
        (slice(6, 8), clock_m, clock_m2),
    )
    for rows, value, spread in parts:
        if (value is None) != (spread is None):
            raise ValueError("a value without its covariance, or a covariance without a value; give both")
        if value is not None:
            mean[rows], covariance[rows, rows] = value, spread
    return NavEstimate(gpst=gpst, mean=mean, covariance=covariance)


def mark_unknown(one: NavEstimate, rows: Indices) -> NavEstimate:
    """Mark components of the eight as unknown."""
    covariance = one.covariance.copy()
    covariance[rows, :] = covariance[:, rows] = 0.0
    covariance[rows, rows] = np.inf
    return NavEstimate(gpst=one.gpst, mean=one.mean, covariance=covariance)


def estimates_from_fix(fix: Fix, *, every_s: float = 0.0) -> Iterator[NavEstimate]:
    """Iterate over the epochs of a fix, at least `every_s` apart, with velocity and drift where known.

    The covariance of velocity and drift is not in the fix: it has the geometry of that of position and clock, with
    ranges of 1 m for rates of 0.05 m/s.
    """
    last: np.datetime64 | None = None
    for row in np.flatnonzero(fix.status == FixStatus.OK):
        gpst = fix.gpst[row]
        if last is not None and seconds_between(gpst, last) < every_s:
            continue
        last = gpst
        rate = np.append(fix.velocity_ecef_m_s[row], SPEED_OF_LIGHT_M_S * fix.clock_drift[row])
        place = np.append(fix.position_ecef_m[row], SPEED_OF_LIGHT_M_S * fix.clock_bias_s[row])
        mean, covariance = np.zeros(KNOWN), np.diag(np.full(KNOWN, np.inf))
        places, rates = np.array([0, 1, 2, 6]), np.array([3, 4, 5, 7])
        mean[places], covariance[np.ix_(places, places)] = place, fix.covariance_m2[row]
        if np.isfinite(rate).all():
            share = (_RATE_SIGMA_M_S / _RANGE_SIGMA_M) ** 2
            mean[rates], covariance[np.ix_(rates, rates)] = rate, share * fix.covariance_m2[row]
        yield NavEstimate(gpst=gpst, mean=mean, covariance=covariance)
