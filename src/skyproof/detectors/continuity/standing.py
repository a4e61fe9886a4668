"""Test if a receiver that is stated to stand moves, as its carriers show it: arrays only.

Less the motion of satellites and the air's delay, carriers change with a receiver's motion between two epochs by

    change = -u . moved + c clock + errors                                  u receiver to satellite

for each satellite. If it stands, `moved` is zero, and over its covariance chi-square with 3 degrees. Errors are noise,
bridges of slips by Doppler, unmodelled changes of the air, and unrelated reflections at either end. A reflection weaker
than the direct signal turns a carrier by a quarter of a wavelength at most. So `carrier_error_m` of 4 cm exceeds any on
L1 and equals the largest on L5.

An attack that drags a position off moves all carriers. Walls that move, and a loop that tracks two beating signals,
move those of some satellites (`whole_sky`).

A position dragged off by code alone is no motion for this test: code and carrier diverge then (`common_change`).
"""

from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.detectors.continuity.series import Series
from skyproof.detectors.continuity.whole_sky import SkyMotion, estimate_motion, select_least_likely
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.ranges import compute_atmosphere
from skyproof.records import NavigationData, Observations

__all__ = ["find_carrier_motion"]

_FAR_M: Final = 2.5e7


def find_carrier_motion(
    o: Observations,
    series: Series,
    navigation: NavigationData,
    place_ecef_m: Reals,
    *,
    carrier_error_m: float,
    alpha: float,
) -> SkyMotion | None:
    """Find the least likely motion of a receiver that stands, over `carrier_spans_s` up to the last epoch.

    o : one signal a transmission, and `series` of it (`series.build_series`). place_ecef_m : (3,) to some metres.
    carrier_error_m : of a carrier at one epoch beside noise, one sigma. alpha : at which the motion is tested
    without some of the satellites. P-values are bounds, for all spans together. None if the carriers of fewer than
    five satellites cover a span.
    """
    sats, found = np.array([signal.sat for signal in o.signals]), list[SkyMotion | None]()
    for span_s in POLICY.carrier_spans_s:
        rows = _span_ends(series, span_s)
        if rows is None:
            continue
        change_m, variance_m2 = _carrier_changes(o, series, navigation, place_ecef_m, rows)
        variance_m2 = variance_m2 + 2.0 * carrier_error_m**2
        time_s = float(series.elapsed_s[rows[1]] - series.elapsed_s[rows[0]])
        unit, share = series.unit[rows[1]], alpha / len(POLICY.carrier_spans_s)
        found.append(estimate_motion(sats, unit, change_m, variance_m2, time_s, alpha=share))
    return select_least_likely(found)


def _span_ends(series: Series, span_s: float) -> tuple[int, int] | None:
    """Return the rows at the start and the end (the last) of a span; None if it is too short, or nothing bridges it."""
    t, last = series.elapsed_s, series.elapsed_s.size - 1
    first = int(np.searchsorted(t, t[last] - span_s - 1e-6))
    if t[last] - t[first] < (1.0 - POLICY.span_late_share) * span_s or series.divides[first + 1 :].any():
        return None
    return first, last


def _carrier_changes(
    o: Observations, series: Series, navigation: NavigationData, place_ecef_m: Reals, rows: tuple[int, int]
) -> tuple[Reals, Reals]:
    """Compute the change (m,) of each carrier from one row to the other, less the air's, and its variance.

    The variance leaves out reflections.
    """
    first, last = rows
    measured = np.isfinite(series.offset_m[[first, last]]).all(axis=0)
    satellite_m = place_ecef_m + _FAR_M * series.unit[[first, last]]
    tow_s = week_and_tow(o.gpst[[first, last]])[1]
    places = np.broadcast_to(place_ecef_m, (2, 3))
    air = compute_atmosphere(places, satellite_m, tow_s, navigation.ionosphere, carrier_hz=o.carrier_hz)
    slowed_m = np.diff(air.delay_m - 2.0 * air.ionosphere_m, axis=0)[0]  # what delays code puts carriers ahead
    change_m = np.where(measured, series.move_m[last] - series.move_m[first] - slowed_m, np.nan)
    return change_m, series.bridge_m2[last] - series.bridge_m2[first] + (POLICY.air_share * slowed_m) ** 2
