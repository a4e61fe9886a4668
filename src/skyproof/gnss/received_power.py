"""Least power of the signals that every receiver is made for, by the systems' documents; and power of a jammer."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["LEAST_RECEIVED_DBW", "JammerToNoise", "estimate_jammer_to_noise"]

_SIGMAS_95: Final = 1.96  # of a normal distribution

LEAST_RECEIVED_DBW: Final = {
    ("G", "L1", "CA"): -158.5,
    ("J", "L1", "CA"): -158.5,
    ("E", "E1", "B"): -160.25,
    ("E", "E1", "C"): -160.25,
    ("C", "B1", "2I"): -163.0,
    ("R", "G1", "CA"): -161.0,
}
"""Least power that an antenna of 0 dBi receives of a kind that every receiver is made for.

IS-GPS-200N, 6.3.1; IS-QZSS-PNT; Galileo OS SIS ICD 2.1 (half of E1's for each part); BDS-SIS-ICD-B1I-3.0; GLONASS ICD
5.1.
"""


class JammerToNoise(NamedTuple):
    """Power of what comes in over the receiver's own noise, dB, and the limits that hold it in 95 %.

    low_db : None where noise alone may explain the rise. high_db : None where only a lower bound of the rise is known.
    """

    db: float
    low_db: float | None
    high_db: float | None


def estimate_jammer_to_noise(
    rise_db: ArrayLike, sigma_db: ArrayLike, *, at_least: bool = False
) -> JammerToNoise | None:
    """Estimate J/N from rises of the noise (n,), dB, each measured independently; None if the noise does not rise.

    C/N0 falls, and power in the band rises, by 1 + J/N (N. Stenberg and others, doi 10.33012/navi.510, section 5.2).
    Rises are averaged by their weights. Where they disagree, the error grows by what they scatter beyond their sigmas
    (R. T. Birge, Physical Review 40, 1932, page 207). at_least : the rises are lower bounds.
    """
    rises, weights = np.atleast_1d(np.asarray(rise_db, float)), np.atleast_1d(np.asarray(sigma_db, float)) ** -2.0
    mean_db = float(np.average(rises, weights=weights))
    scatter = float(np.sum(weights * (rises - mean_db) ** 2)) / max(rises.size - 1, 1)
    reach_db = _SIGMAS_95 * float(np.sqrt(max(1.0, scatter) / np.sum(weights)))
    middle_db = _jammer_db(mean_db)
    if middle_db is None:
        return None
    return JammerToNoise(
        middle_db, _jammer_db(mean_db - reach_db), None if at_least else _jammer_db(mean_db + reach_db)
    )


def _jammer_db(rise_db: float) -> float | None:
    """Convert a rise of the noise to J/N, dB; None where nothing rises."""
    return 10.0 * float(np.log10(np.expm1(rise_db * np.log(10.0) / 10.0))) if rise_db > 0.0 else None
