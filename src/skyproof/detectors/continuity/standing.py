"""Does a receiver that is stated to stand move, as its carriers show it: arrays only.

What carriers show of a receiver's motion from one epoch to another, the motion of satellites and the air's delay taken
away, is

    change = -u . moved + c clock + errors                                  u receiver to satellite

for each satellite. If it stands, `moved` is nothing, and over its covariance chi-square with 3 degrees. Errors are
noise, what bridges slips by Doppler, what models of the air leave of its change, and reflections at either end, which
need have nothing in common: one that is weaker than the direct signal turns a carrier by a quarter of a wavelength at
most, so that `carrier_error_m` of 4 cm is more than any has on L1 and as much as the largest has on L5.

An attack that draws a position off moves all carriers; walls that move, and what a loop makes of two signals that beat,
move those of some satellites (`whole_sky`).

A position that is drawn off by code alone is no motion by this: code and carrier part then (`common_change`).
"""

from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.detectors.continuity.series import Series
from skyproof.detectors.continuity.whole_sky import SkyMotion, least_likely, motion_of
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.ranges import compute_atmosphere
from skyproof.records import NavigationData, Observations

__all__ = ["moved_of"]

_FAR_M: Final = 2.5e7


def moved_of(
    o: Observations,
    series: Series,
    navigation: NavigationData,
    place_ecef_m: Reals,
    *,
    carrier_error_m: float,
    alpha: float,
) -> SkyMotion | None:
    """The least likely motion of a receiver that stands, of those over `carrier_spans_s` up to the last epoch.

    o : one signal a transmission, and `series` of it (`steps.series_of`). place_ecef_m : (3,) to some metres.
    carrier_error_m : of a carrier at one epoch beside noise, one sigma. alpha : at which the motion is looked for
    without some of the satellites. P-values are those of all spans together: bounds. None where the carriers of fewer
    than five satellites reach over a span.
    """
    sats, found = np.array([signal.sat for signal in o.signals]), list[SkyMotion | None]()
    for span_s in POLICY.carrier_spans_s:
        rows = _ends(series, span_s)
        if rows is None:
            continue
        change_m, variance_m2 = _changes(o, series, navigation, place_ecef_m, rows)
        variance_m2 = variance_m2 + 2.0 * carrier_error_m**2
        time_s = float(series.elapsed_s[rows[1]] - series.elapsed_s[rows[0]])
        unit, share = series.unit[rows[1]], alpha / len(POLICY.carrier_spans_s)
        found.append(motion_of(sats, unit, change_m, variance_m2, time_s, alpha=share))
    return least_likely(found)


def _ends(series: Series, span_s: float) -> tuple[int, int] | None:
    """Rows at the start of a span and at its end, the last; None if it is not there, or nothing bridges it."""
    t, last = series.elapsed_s, series.elapsed_s.size - 1
    first = int(np.searchsorted(t, t[last] - span_s - 1e-6))
    if t[last] - t[first] < (1.0 - POLICY.span_late_share) * span_s or series.divides[first + 1 :].any():
        return None
    return first, last


def _changes(
    o: Observations, series: Series, navigation: NavigationData, place_ecef_m: Reals, rows: tuple[int, int]
) -> tuple[Reals, Reals]:
    """(m,) of each carrier from one row to the other, but for the air's, and its variance without reflections."""
    first, last = rows
    there = np.isfinite(series.offset_m[[first, last]]).all(axis=0)
    satellite_m = place_ecef_m + _FAR_M * series.unit[[first, last]]
    tow_s = week_and_tow(o.gpst[[first, last]])[1]
    places = np.broadcast_to(place_ecef_m, (2, 3))
    air = compute_atmosphere(places, satellite_m, tow_s, navigation.ionosphere, carrier_hz=o.carrier_hz)
    slowed_m = np.diff(air.delay_m - 2.0 * air.ionosphere_m, axis=0)[0]  # what delays code puts carriers ahead
    change_m = np.where(there, series.move_m[last] - series.move_m[first] - slowed_m, np.nan)
    return change_m, series.bridge_m2[last] - series.bridge_m2[first] + (POLICY.air_share * slowed_m) ** 2
