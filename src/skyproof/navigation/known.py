"""What is known of one antenna at one instant: position, velocity and clock with their covariance."""

from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.records import freeze

__all__ = ["KNOWN", "Known", "known"]

KNOWN = 8
"""Numbers: ECEF position and velocity, c times clock bias and drift."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
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
        """Which of the eight are known."""
        return np.flatnonzero(np.isfinite(self.mean) & np.isfinite(np.diag(self.covariance)))


def known(
    gpst: np.datetime64,
    *,
    position_ecef_m: Reals | None = None,
    position_m2: Reals | None = None,
    velocity_ecef_m_s: Reals | None = None,
    velocity_m2_s2: Reals | None = None,
    clock_m: Reals | None = None,
    clock_m2: Reals | None = None,
) -> Known:
    """From parts that are independent of each other, each with its covariance: (3,), (3,), and (2,) of the clock."""
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
    return Known(gpst=gpst, mean=mean, covariance=covariance)
