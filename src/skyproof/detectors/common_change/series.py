"""Compute rates of code against carrier, and turns of all carriers, from one sky's observations."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.detectors.common_change.laws import Rate, fit_rates
from skyproof.detectors.common_change.policy import POLICY
from skyproof.detectors.continuity.policy import POLICY as CONTINUITY
from skyproof.detectors.continuity.steps import fit_jump
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between
from skyproof.navigation.least_squares import compute_line_of_sight, fit_position
from skyproof.navigation.ranges import correct_ranges
from skyproof.records import CellStatus, NavigationData, Observations, SignalId
from skyproof.statistics.same_rows import group_by_rows

__all__ = ["Turn", "estimate_rates", "estimate_turn"]


class Turn(NamedTuple):
    """Second difference of c times the clock over two times `apart_s`, and the variance of its measurement."""

    turn_m: float
    variance_m2: float
    apart_s: float


def estimate_rates(o: Observations, span_s: float, multipath_sigma_m: float) -> Mapping[SignalId, Rate]:
    """Estimate each signal's rate of code minus carrier over the last `span_s`, if its carrier is unbroken."""
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    apart_m = o.pseudorange_m - wavelength_m * o.carrier_cyc
    begin = int(np.searchsorted(o.elapsed_s, o.elapsed_s[-1] - span_s - 1e-6))
    last = _find_last_runs(o, apart_m, begin)
    found: dict[SignalId, Rate] = {}
    # Signals that are there at the same epochs have the same weights, and most are.
    for rows, columns in group_by_rows(last):
        if (
            rows.size < 3
            or o.elapsed_s[begin + rows[-1]] - o.elapsed_s[begin + rows[0]] < POLICY.whole_span_share * span_s
        ):
            continue
        cells = np.ix_(begin + rows, columns)
        elapsed_s = o.elapsed_s[begin + rows]
        rates = fit_rates(elapsed_s, apart_m[cells], o.pseudorange_sigma_m[cells], multipath_sigma_m)
        found |= {o.signals[k]: rate for k, rate in zip(columns, rates, strict=True)}
    return {signal: found[signal] for signal in o.signals if signal in found}


def _find_last_runs(o: Observations, apart_m: Reals, begin: int) -> Booleans:
    """Find the rows (n - begin, m) in which a carrier continues without a break to its last."""
    apart_m, elapsed_s = apart_m[begin:], o.elapsed_s[begin:]
    known = np.isfinite(apart_m) & np.isfinite(o.pseudorange_sigma_m[begin:])
    n = elapsed_s.size
    usual_s = float(np.median(np.diff(o.elapsed_s))) if o.elapsed_s.size > 1 else 0.0
    before = np.maximum.accumulate(np.where(known, np.arange(n)[:, None], -1), axis=0)
    before = np.vstack((np.full((1, known.shape[1]), -1), before[:-1]))  # the last row that is known, of each row
    earlier = np.maximum(before, 0)
    with np.errstate(invalid="ignore"):
        jumped = np.abs(apart_m - np.take_along_axis(apart_m, earlier, axis=0)) > POLICY.jump_m
    broken = (
        (o.status[begin:] == CellStatus.SLIP)
        | jumped
        | (elapsed_s[:, None] - elapsed_s[earlier] > POLICY.gap_intervals * usual_s)
    )
    starts = np.where(known & (before >= 0) & broken, np.arange(n)[:, None], 0).max(axis=0, initial=0)
    return np.asarray(known & (np.arange(n)[:, None] >= starts))


def estimate_turn(
    o: Observations, navigation: NavigationData, place_ecef_m: Reals, apart_s: float, carrier_error_m: float
) -> Turn | None:
    """Estimate the clock's second difference over the last twice `apart_s`, whatever the antenna's motion.

    place_ecef_m : (3,) within kilometres of the antenna. carrier_error_m : of each carrier at each epoch, one sigma,
        beside noise. None without three epochs, or with fewer than five carriers that are unbroken over all of them.

    With p the motion since the first epoch, a carrier less the way to the satellite is -u.p + c clock and a constant.
    Motion turns u. So the ranges give where it began, and each epoch's difference from the first gives its course.
    The remaining error of both is linear in the second difference.
    """
    rows = _select_three_epochs(o.elapsed_s, apart_s)
    if rows is None:
        return None
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    ranges = correct_ranges(o.signals, o.gpst[rows], o.pseudorange_m[rows], navigation)
    between = slice(int(rows[0]), int(rows[2]) + 1)
    unbroken = np.isfinite(o.carrier_cyc[between]).all(axis=0)
    unbroken &= (o.status[between][1:] != CellStatus.SLIP).all(axis=0)
    ahead_m = SPEED_OF_LIGHT_M_S * (
        seconds_between(o.gpst[rows], o.gpst[rows[0]]) - (o.elapsed_s[rows] - o.elapsed_s[rows[0]])
    )
    sent_m = wavelength_m * o.carrier_cyc[rows] + ranges.range_m - o.pseudorange_m[rows] - ahead_m[:, None]
    sent_m = np.where(unbroken, sent_m, np.nan)
    if np.isfinite(sent_m).all(axis=0).sum() < CONTINUITY.one_sky_satellites:
        return None
    variance_m2 = (wavelength_m * o.carrier_sigma_cyc[rows]) ** 2 + carrier_error_m**2
    begun = fit_position(
        ranges.satellite_ecef_m[0], ranges.range_m[0], o.pseudorange_sigma_m[rows[0]], np.append(place_ecef_m, 0.0)
    )
    place_m = np.tile(begun.state_m[:3], (3, 1))
    for _ in range(2):
        left_m, unit = _subtract_ways(ranges.satellite_ecef_m, sent_m, place_m)
        moved = fit_jump(unit[1:], left_m[1:] - left_m[0], variance_m2[1:] + variance_m2[0])
        place_m = place_m + np.vstack((np.zeros(3), moved.jump[:, :3]))
    left_m, unit = _subtract_ways(ranges.satellite_ecef_m, sent_m, place_m)
    share = (o.elapsed_s[rows[2]] - o.elapsed_s[rows[0]]) / (o.elapsed_s[rows[1]] - o.elapsed_s[rows[0]])
    weight = np.array([share - 1.0, -share, 1.0])  # 1, -2, 1: no time and no rate is left of it
    fitted = fit_jump(unit[1:2], (weight @ left_m)[None], (weight**2 @ variance_m2)[None])
    turn = Turn(float(fitted.jump[0, 3]), float(fitted.covariance[0, 3, 3]), apart_s)
    return turn if np.isfinite(turn.turn_m) and np.isfinite(turn.variance_m2) else None


def _subtract_ways(satellite_ecef_m: Reals, sent_m: Reals, place_m: Reals) -> tuple[Reals, Reals]:
    """Subtract ways from places (3, 3) from carriers (3, m), relative to the first epoch; also return unit vectors."""
    _, unit, distance_m = compute_line_of_sight(satellite_ecef_m, place_m)
    left_m = sent_m - distance_m
    return left_m - left_m[0], unit


def _select_three_epochs(elapsed_s: Reals, apart_s: float) -> Indices | None:
    """Return the last epoch, and those once and twice `apart_s` before; None if none are within a fiftieth of it."""
    wanted_s = elapsed_s[-1] - apart_s * np.array([2.0, 1.0, 0.0])
    after = np.clip(np.searchsorted(elapsed_s, wanted_s), 1, elapsed_s.size - 1)
    nearer = wanted_s - elapsed_s[after - 1] < elapsed_s[after] - wanted_s
    rows = np.where(nearer, after - 1, after)
    return rows if np.all(np.abs(elapsed_s[rows] - wanted_s) < 0.5 * POLICY.even_share * apart_s) else None
