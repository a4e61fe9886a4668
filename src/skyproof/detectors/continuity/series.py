"""Carry the ranges of one sky by their own carriers and Dopplers, so that they stay constant: arrays only."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.detectors.continuity.one_sky import select_columns
from skyproof.detectors.continuity.policy import POLICY
from skyproof.gnss.constants import MILLISECOND_M, SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between
from skyproof.navigation.fix import compute_range_rates
from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.ranges import correct_ranges
from skyproof.navigation.window import fill_gaps
from skyproof.records import CellStatus, NavigationData, Observations
from skyproof.statistics.medians import medians

__all__ = ["Limits", "Series", "build_group_series", "build_series", "sum_from_zero"]


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What errors, platform and oscillator may do.

    span_s : over which ranges are averaged on either side of an epoch.
    multipath_sigma_m : of one range, one sigma; it may change altogether from one side to the other.
    acceleration_m_s2, speed_m_s : no platform exceeds them; the speed is infinite if it is not known.
    clock_jump : by so much the oscillator's rate (a number, 1e-6 is one in a million) may step, as quartz does under
        shock. clock_pace_s : by so much more a second it may change (1/s), as quartz does while it warms up.
    """

    span_s: float = 5.0
    multipath_sigma_m: float = 1.0
    acceleration_m_s2: float = 50.0
    speed_m_s: float = np.inf
    clock_jump: float = 1e-8
    clock_pace_s: float = 1e-8


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """One sky's satellites over time: (n_epochs, n_satellites) but for elapsed_s (n_epochs,) and unit (.., 3).

    offset_m : level - move, constant but for jumps. variance_m2 : of its noise. move_m : what carriers and Dopplers
    show, -u . p + c clock from the first epoch on. bridge_m2 : accumulated variance of bridges by Doppler.
    quadrature_m : what discriminators show off the carriers, as in `Observations`.
    rate_m_s, rate_m2_s2 : -u . v + c drift, and its variance.
    divides : (n_epochs,) nothing was measured for a while before, or nearly all carriers broke: what lies on the two
    sides is compared at this epoch only. broke : (n_epochs,) that it was the carriers. all_broke : (n_epochs,) that
    those of all kinds of signals did, as where samples are missing.
    """

    elapsed_s: Reals
    offset_m: Reals
    variance_m2: Reals
    move_m: Reals
    bridge_m2: Reals
    quadrature_m: Reals
    rate_m_s: Reals
    rate_m2_s2: Reals
    divides: Booleans
    broke: Booleans
    all_broke: Booleans
    unit: Reals

    @property
    def unseen(self) -> "Series":
        """Return the same without what discriminators show of reflections; itself where nothing is known."""
        known = np.isfinite(self.quadrature_m).any()
        return replace(self, quadrature_m=np.full(self.quadrature_m.shape, np.nan)) if known else self


class _Columns(NamedTuple):
    """Hold each signal's own part: `Series` with the steps of the receiver's clock, (n, m), and its breaks.

    there : where it was measured. broke : where its carrier breaks.
    """

    offset_m: Reals
    variance_m2: Reals
    move_m: Reals
    bridge_m2: Reals
    quadrature_m: Reals
    rate_m_s: Reals
    rate_m2_s2: Reals
    unit: Reals
    there: Booleans
    broke: Booleans

    def take(self, columns: Indices) -> "_Columns":
        return _Columns(*(np.asarray(getattr(self, name))[:, columns] for name in self._fields))


def build_series(o: Observations, navigation: NavigationData, place_ecef_m: Reals, limits: Limits) -> Series:
    """Build the series of observations with one signal per satellite.

    `place_ecef_m` (3,) need be right to a few kilometres.

    Gaps of a signal beside others are bridged by its Dopplers on both sides, with the variance that the largest
    acceleration gives.
    """
    columns = _compute_columns(o, navigation, place_ecef_m, limits)
    return _join_columns(o.elapsed_s, columns, _find_common_breaks(columns.broke, columns.there))


def build_group_series(
    o: Observations, groups: Sequence[Indices], navigation: NavigationData, place_ecef_m: Reals, limits: Limits
) -> list[tuple[Observations, Series]]:
    """Build the observations (`one_sky.select_columns`) and series of each group of columns.

    A group of two epochs or fewer has none. Each signal's own part is computed once for all groups.
    """
    whole = _compute_columns(o, navigation, place_ecef_m, limits)
    all_broke = _find_common_breaks(whole.broke, whole.there)
    found = []
    for columns in groups:
        selected = select_columns(o, columns)
        if selected.gpst.size == o.gpst.size:
            found.append((selected, _join_columns(o.elapsed_s, whole.take(columns), all_broke)))
        elif selected.gpst.size > 2:
            rows = np.searchsorted(o.elapsed_s, selected.elapsed_s)
            found.append(
                (selected, replace(build_series(selected, navigation, place_ecef_m, limits), all_broke=all_broke[rows]))
            )
    return found


def _compute_columns(o: Observations, navigation: NavigationData, place_ecef_m: Reals, limits: Limits) -> _Columns:
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    ranges = correct_ranges(o.signals, o.gpst, o.pseudorange_m, navigation)
    turned, unit, distance_m = compute_line_of_sight(ranges.satellite_ecef_m, place_ecef_m)
    rates = compute_range_rates(ranges, turned, unit, distance_m, o.doppler_hz, o.doppler_sigma_hz, o.carrier_hz)
    ahead_m = SPEED_OF_LIGHT_M_S * (seconds_between(o.gpst, o.gpst[0]) - (o.elapsed_s - o.elapsed_s[0]))
    level_m = ranges.range_m - distance_m - ahead_m[:, None]
    carrier_m = wavelength_m * o.carrier_cyc - ahead_m[:, None]
    # What the satellites' motion makes, also where no Doppler is: that matters by millionths.
    near_hz = np.nan_to_num(fill_gaps(o.elapsed_s, o.doppler_hz))
    near = compute_range_rates(ranges, turned, unit, distance_m, near_hz, o.doppler_sigma_hz, o.carrier_hz)
    passing_m_s = -wavelength_m * near_hz - near.measured_m_s
    dt_s = np.diff(o.elapsed_s)[:, None]

    measured = np.isfinite(level_m)
    rate, passing = fill_gaps(o.elapsed_s, rates.measured_m_s), fill_gaps(o.elapsed_s, passing_m_s)
    rate_m2 = fill_gaps(o.elapsed_s, rates.sigma_m_s) ** 2
    whole = measured[1:] & measured[:-1] & np.isfinite(np.diff(carrier_m, axis=0)) & (o.status[1:] != CellStatus.SLIP)
    by_carrier = np.diff(carrier_m, axis=0) - 0.5 * dt_s * (passing[1:] + passing[:-1])
    by_doppler = 0.5 * dt_s * (rate[1:] + rate[:-1])
    unseen_s = np.where(
        measured[1:], _time_since_measured(measured, o.elapsed_s), 0.0
    )  # an outage of all is not noise: see `_slack`
    alone_s = np.where(unseen_s > dt_s, unseen_s, 0.0)
    bridge_m2 = 0.25 * dt_s**2 * (rate_m2[1:] + rate_m2[:-1]) + (0.25 * limits.acceleration_m_s2 * alone_s**2) ** 2
    move_m = sum_from_zero(np.where(whole, by_carrier, by_doppler))
    return _Columns(
        offset_m=level_m - move_m,
        variance_m2=o.pseudorange_sigma_m**2,
        move_m=move_m,
        bridge_m2=sum_from_zero(np.where(whole, 0.0, np.nan_to_num(bridge_m2))),
        quadrature_m=o.quadrature_m,
        rate_m_s=rates.measured_m_s,
        rate_m2_s2=rates.sigma_m_s**2,
        unit=unit,
        there=measured,
        broke=np.vstack((np.zeros((1, measured.shape[1]), np.bool_), ~whole & measured[1:])),
    )


def _join_columns(elapsed_s: Reals, columns: _Columns, all_broke: Booleans) -> Series:
    """Build the series of signals that are tested together. all_broke : as of `Series`."""
    broke = _find_common_breaks(columns.broke, columns.there)
    dt_s = np.diff(elapsed_s)
    gap = np.concatenate(([False], dt_s > POLICY.outage_intervals * np.median(dt_s)))
    return Series(
        elapsed_s=elapsed_s,
        offset_m=_remove_steering(columns.offset_m),
        variance_m2=columns.variance_m2,
        move_m=columns.move_m,
        bridge_m2=columns.bridge_m2,
        quadrature_m=columns.quadrature_m,
        rate_m_s=columns.rate_m_s,
        rate_m2_s2=columns.rate_m2_s2,
        divides=broke | gap,
        broke=broke,
        all_broke=all_broke,
        unit=columns.unit,
    )


def _find_common_breaks(broke: Booleans, there: Booleans) -> Booleans:
    """Find epochs (n,) at which nearly all carriers (n, m) broke; of neighbours the one where most did."""
    wide, n = broke.copy(), broke.shape[0]
    wide[:-1] |= broke[1:]
    wide[1:] |= broke[:-1]
    around = there.copy()
    around[:-1] |= there[1:]
    count = broke.sum(axis=1)
    at_once = wide.sum(axis=1) >= np.maximum(
        POLICY.broken_together_share * around.sum(axis=1), POLICY.one_sky_satellites
    )
    before, after = np.append(-1, count[: n - 1]), np.append(count[1:], -1)
    return np.asarray(at_once & (count > before) & (count >= after))


def _remove_steering(offset_m: Reals) -> Reals:
    """Remove from offsets the steps of a millisecond by which receivers keep their clocks near GPS time."""
    step_m = np.diff(offset_m, axis=0)
    common_m = np.nan_to_num(medians(step_m, axis=1))
    whole = np.rint(common_m / MILLISECOND_M)
    steered = (np.abs(whole) == 1.0) & (np.abs(common_m - whole * MILLISECOND_M) < POLICY.steered_within_m)
    return np.asarray(offset_m - MILLISECOND_M * sum_from_zero(np.where(steered, whole, 0.0)[:, None]))


def sum_from_zero(steps: Reals) -> Reals:
    """Compute running sums that start with a row of zeros."""
    return np.vstack((np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)))


def _time_since_measured(there: Booleans, elapsed_s: Reals) -> Reals:
    """Compute (n - 1, m) the time since the signal was last measured, at each row but the first; zero if never."""
    latest = np.maximum.accumulate(np.where(there, np.arange(there.shape[0])[:, None], -1), axis=0)[:-1]
    return np.where(latest >= 0, elapsed_s[1:, None] - elapsed_s[np.maximum(latest, 0)], 0.0)
