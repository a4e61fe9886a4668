"""Where the ranges of one sky do not go on as their own carriers and Dopplers carry them: arrays only.

A range less what it would be at a fixed place, and less what the label of its epoch is ahead of the counter of samples,
is

    level = -u . p + c clock + slow errors + noise        u receiver to satellite, p from the fixed place

and carrier and Doppler show how it moves, whatever the platform and its oscillator do. So `level - move` is constant
for every satellite: orbits, atmosphere and the constant part of multipath are in it on both sides of any moment. At
each epoch the means over a few seconds before and after it are compared:

    difference = -u . jump of p + jump of c clock + noise

The noise has the variance of both means, of what bridges slips by Doppler, and twice that of multipath: it may have
changed altogether. Under the null (the platform and the clock go on) the jumps over their covariance are chi-square
with 3 and 1 degrees where multipath does change so, and smaller where it stays. Where nothing was measured for a while
the platform may have accelerated, and the oscillator drifted, unseen: the jump then counts from the farthest that this
explains, which errs to the safe side.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.detectors.continuity.one_sky import MIN_SATELLITES
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import seconds_between
from skyproof.navigation.fix import range_rates
from skyproof.navigation.least_squares import design_matrix, line_of_sight, spd_inverse
from skyproof.navigation.raim import exclude_several, whitened_fit
from skyproof.navigation.ranges import corrected_ranges
from skyproof.navigation.window import fill_gaps
from skyproof.records import CellStatus, NavigationData, Observations
from skyproof.statistics.distributions import chi_square_survival, f_survival

__all__ = [
    "KINDS",
    "Jump",
    "Limits",
    "Series",
    "Step",
    "chance",
    "fitted_jump",
    "jumps",
    "largest_step",
    "p_values",
    "series_of",
]

KINDS = ("position", "clock", "velocity", "rate")
"""What is tested at each epoch: jumps of the position, the clock, the velocity and the clock's rate."""
_GAP = 1.5  # usual intervals; a longer one is an outage
_AT_ONCE = 0.75  # of the channels: their carriers break together
_FAULTY = 1e-4  # chance at which residuals show that a channel jumps by itself
_STEERED_M = 1e-3 * SPEED_OF_LIGHT_M_S
_STEERED_WITHIN_M = 150.0  # one epoch shows a step of a millisecond by this; what it leaves is tested


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What errors, platform and oscillator may do.

    span_s : over which ranges are averaged on either side of an epoch.
    multipath_sigma_m : of one range, one sigma; it may change altogether from one side to the other.
    acceleration_m_s2 : no platform exceeds it. speed_m_s : likewise; infinite if that is not known.
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
    rate_m_s, rate_m2_s2 : -u . v + c drift, and its variance.
    divides : (n_epochs,) nothing was measured for a while before, or nearly all carriers broke: what lies on the two
    sides is compared at this epoch only. broke : (n_epochs,) that it was the carriers.
    """

    elapsed_s: Reals
    offset_m: Reals
    variance_m2: Reals
    move_m: Reals
    bridge_m2: Reals
    rate_m_s: Reals
    rate_m2_s2: Reals
    divides: Booleans
    broke: Booleans
    unit: Reals


@dataclass(frozen=True, kw_only=True)
class Step:
    """The largest step of a series. `row` is the first epoch after it.

    p_value : at least that of all tests that were made together. broke : all carriers broke there. outage_s : how long
    nothing was measured before. missing_s : samples that are missing, if that explains the clock's step.
    clock_s : positive where the signals' time goes back against the counter of samples.
    kinds : those of KINDS that cannot go on.
    """

    row: int
    p_value: float
    kinds: tuple[str, ...]
    position_m: float
    clock_s: float
    speed_m_s: float
    rate: float
    broke: bool
    outage_s: float
    missing_s: float
    statistic: float


class Jump(NamedTuple):
    """A jump (K, 4) of position and c clock, or of their rates, its covariance (K, 4, 4), and the residuals' chi-square
    with its degrees (K,)."""

    jump: Reals
    covariance: Reals
    misfit: Reals
    dof: Integers


def series_of(o: Observations, navigation: NavigationData, place_ecef_m: Reals, limits: Limits) -> Series:
    """The series of observations with one signal per satellite. `place_ecef_m` (3,) need be right to a few kilometres.

    Gaps of a signal beside others are bridged by its Dopplers on both sides, with the variance that the largest
    acceleration gives.
    """
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    ranges = corrected_ranges(o.signals, o.gpst, o.pseudorange_m, navigation)
    turned, unit, distance_m = line_of_sight(ranges.satellite_ecef_m, place_ecef_m)
    rates = range_rates(ranges, turned, unit, distance_m, o.doppler_hz, o.doppler_sigma_hz, o.carrier_hz)
    ahead_m = SPEED_OF_LIGHT_M_S * (seconds_between(o.gpst, o.gpst[0]) - (o.elapsed_s - o.elapsed_s[0]))
    level_m = ranges.range_m - distance_m - ahead_m[:, None]
    carrier_m = wavelength_m * o.carrier_cyc - ahead_m[:, None]
    passing_m_s = -wavelength_m * o.doppler_hz - rates.measured_m_s  # what the satellites' motion makes
    dt_s = np.diff(o.elapsed_s)[:, None]

    there = np.isfinite(level_m)
    rate, passing = fill_gaps(o.elapsed_s, rates.measured_m_s), fill_gaps(o.elapsed_s, passing_m_s)
    rate_m2 = fill_gaps(o.elapsed_s, rates.sigma_m_s) ** 2
    whole = there[1:] & there[:-1] & np.isfinite(np.diff(carrier_m, axis=0)) & (o.status[1:] != CellStatus.SLIP)
    by_carrier = np.diff(carrier_m, axis=0) - 0.5 * dt_s * (passing[1:] + passing[:-1])
    by_doppler = 0.5 * dt_s * (rate[1:] + rate[:-1])
    unseen_s = np.where(there[1:], _since(there, o.elapsed_s), 0.0)  # an outage of all is not noise: see `_slack`
    alone_s = np.where(unseen_s > dt_s, unseen_s, 0.0)
    bridge_m2 = 0.25 * dt_s**2 * (rate_m2[1:] + rate_m2[:-1]) + (0.25 * limits.acceleration_m_s2 * alone_s**2) ** 2
    move_m = _summed(np.where(whole, by_carrier, by_doppler))
    broke = _broke_at_once(np.vstack((np.zeros((1, there.shape[1]), np.bool_), ~whole & there[1:])), there)
    gap = np.concatenate(([False], dt_s[:, 0] > _GAP * np.median(dt_s)))
    return Series(
        elapsed_s=o.elapsed_s,
        offset_m=_unsteered(level_m - move_m),
        variance_m2=o.pseudorange_sigma_m**2,
        move_m=move_m,
        bridge_m2=_summed(np.where(whole, 0.0, np.nan_to_num(bridge_m2))),
        rate_m_s=rates.measured_m_s,
        rate_m2_s2=rates.sigma_m_s**2,
        divides=broke | gap,
        broke=broke,
        unit=unit,
    )


def largest_step(series: Series, rows: Indices, limits: Limits, *, alpha: float) -> Step | None:
    """The step that is least likely by chance, of all before `rows`; None where no epoch has five satellites on both
    sides.

    A step ahead of time where all carriers break is what missing samples make; it counts neither as a step of the
    clock nor, with the motion of that time, of the position, and is reported in `missing_s` if no other step fails.
    """
    rows = rows[(rows > 0) & (rows < series.elapsed_s.size)]
    if rows.size == 0:
        return None
    jump, rate, usable = jumps(series, rows, limits)
    if not usable.any():
        return None
    rows, jump, rate = rows[usable], _taken(jump, usable), _taken(rate, usable)
    missing_s = _missing(series, rows, jump, limits, alpha / rows.size)
    chances = p_values(series, rows, jump, rate, missing_s, limits)
    together = np.minimum(1.0, chances.size * chances)
    best = _to_name(together.min(axis=1), jump, missing_s, alpha)
    k, gap_s = int(rows[best]), float(series.elapsed_s[rows[best]] - series.elapsed_s[rows[best] - 1])
    return Step(
        row=k,
        p_value=float(together[best].min()),
        kinds=tuple(kind for kind, p in zip(KINDS, together[best], strict=True) if p < alpha),
        position_m=float(np.linalg.norm(jump.jump[best, :3])),
        clock_s=float(jump.jump[best, 3]) / SPEED_OF_LIGHT_M_S,
        speed_m_s=float(np.linalg.norm(rate.jump[best, :3])),
        rate=float(rate.jump[best, 3]) / SPEED_OF_LIGHT_M_S,
        broke=bool(series.broke[k]),
        outage_s=gap_s if gap_s > _GAP * _usual(series) else 0.0,
        missing_s=float(missing_s[best]),
        statistic=float(_quadratic(jump.jump[[best]], jump.covariance[[best]])[0]),
    )


def p_values(series: Series, rows: Indices, jump: Jump, rate: Jump, missing_s: Reals, limits: Limits) -> Reals:
    """(K, 4) of "goes on", by `KINDS`."""
    gap_s = series.elapsed_s[rows] - series.elapsed_s[rows - 1]
    unseen_s = np.where(series.divides[rows], gap_s, 0.0) + missing_s
    apart_s = gap_s + missing_s
    moved_m = jump.jump[:, :3] - _velocity(series, rows) * missing_s[:, None]
    slack_m = np.minimum(0.25 * limits.acceleration_m_s2 * unseen_s, 2.0 * limits.speed_m_s) * unseen_s
    clock_m = _clock_slack_m(unseen_s, limits)
    stepped_m = np.where(missing_s > 0.0, 0.0, jump.jump[:, 3])
    pace_m_s = SPEED_OF_LIGHT_M_S * (limits.clock_jump + limits.clock_pace_s * apart_s)
    return np.stack(
        [
            chance(moved_m, jump.covariance[:, :3, :3], slack_m, jump),
            chance(stepped_m[:, None], jump.covariance[:, 3:, 3:], clock_m, jump),
            chance(rate.jump[:, :3], rate.covariance[:, :3, :3], limits.acceleration_m_s2 * apart_s, rate),
            chance(rate.jump[:, 3:], rate.covariance[:, 3:, 3:], pace_m_s, rate),
        ],
        axis=1,
    )


def _missing(series: Series, rows: Indices, jump: Jump, limits: Limits, alpha: float) -> Reals:
    """(K,) time that the signals are ahead by where all carriers break, if noise and oscillator do not show it; else
    zero."""
    ahead_m = -jump.jump[:, 3]
    beyond_m = ahead_m - _clock_slack_m(series.elapsed_s[rows] - series.elapsed_s[rows - 1], limits)
    with np.errstate(invalid="ignore"):
        real = (beyond_m > 0.0) & (chi_square_survival(beyond_m**2 / jump.covariance[:, 3, 3], 1) < alpha)
    return np.where(series.broke[rows] & real, ahead_m / SPEED_OF_LIGHT_M_S, 0.0)


def _clock_slack_m(unseen_s: Reals, limits: Limits) -> Reals:
    """By how much an oscillator may part from the mean of its rates before and after."""
    return SPEED_OF_LIGHT_M_S * (0.5 * limits.clock_jump + 0.25 * limits.clock_pace_s * unseen_s) * unseen_s


def chance(jump: Reals, covariance: Reals, slack: Reals, fitted: Jump) -> Reals:
    """P(so far out) of jumps (K, d): chi-square with d degrees, from the rim of what `slack` (K,) explains.

    Where residuals show that more than jumps is the matter, and no exclusion cured it, the covariance is taken as known
    up to a factor, which the residuals give: F.
    """
    far = np.linalg.norm(jump, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        exact = _quadratic(jump, covariance)
        widest = np.linalg.eigvalsh(np.where(np.isfinite(covariance), covariance, 1.0))[:, -1]
        squared = np.where(slack > 0.0, np.maximum(far - slack, 0.0) ** 2 / widest, exact)
        d = jump.shape[-1]
        fits = chi_square_survival(fitted.misfit, np.maximum(fitted.dof, 1)) >= _FAULTY
        scaled = squared / d / np.maximum(fitted.misfit / np.maximum(fitted.dof, 1), 1.0)
        p = np.where(fits, chi_square_survival(squared, d), f_survival(scaled, d, np.maximum(fitted.dof, 1)))
    return np.where(np.isfinite(p) & (fitted.dof > 0), p, 1.0)


def jumps(series: Series, rows: Indices, limits: Limits) -> tuple[Jump, Jump, Booleans]:
    """Jumps of position and clock, and of velocity and rate, before each row; and where there are enough satellites."""
    level, level_m2 = _contrast(series, series.offset_m, series.variance_m2, rows, limits.span_s)
    bridged = _between(series, rows, limits.span_s)
    total = level_m2 + bridged + 2.0 * limits.multipath_sigma_m**2
    rate, rate_m2 = _contrast(series, series.rate_m_s, series.rate_m2_s2, rows, 0.0)  # one epoch: speeds change
    unit = _unit_at(series, rows)
    usable = np.isfinite(level).sum(axis=1) >= MIN_SATELLITES
    return fitted_jump(unit, level, total), fitted_jump(unit, rate, rate_m2), usable


def fitted_jump(unit: Reals, difference: Reals, variance: Reals) -> Jump:
    """The jump that explains differences (K, m) best, without the channels that jump by themselves.

    unit : (K, m, 3) to the satellites. variance : (K, m) of the differences; what is not finite is left out.
    """
    design, sigma = design_matrix(unit), np.sqrt(variance)
    sigma = np.where(np.isfinite(difference) & np.isfinite(sigma), sigma, np.nan)
    enough = np.isfinite(sigma).sum(axis=1) >= MIN_SATELLITES
    sigma = np.where(enough[:, None], sigma, np.nan)
    design = np.nan_to_num(design)
    excluded = np.zeros(sigma.shape, np.bool_)
    residual, _, _ = whitened_fit(design, difference, sigma)
    misfit, dof = np.nansum(residual**2, axis=1), np.isfinite(sigma).sum(axis=1) - 4
    faulty = np.flatnonzero(enough & (chi_square_survival(misfit, np.maximum(dof, 1)) < _FAULTY))
    if faulty.size:
        excluded[faulty], _ = exclude_several(
            design[faulty], difference[faulty], sigma[faulty], false_alarm_probability=_FAULTY
        )
        sigma = np.where(excluded, np.nan, sigma)
        residual, _, _ = whitened_fit(design, difference, sigma)
        misfit, dof = np.nansum(residual**2, axis=1), np.isfinite(sigma).sum(axis=1) - 4
    weight = np.where(np.isfinite(sigma), 1.0 / np.where(np.isfinite(sigma), sigma, 1.0) ** 2, 0.0)
    weighted = np.swapaxes(design, -1, -2) * weight[:, None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = spd_inverse(weighted @ design)
    jump = (covariance @ (weighted @ np.nan_to_num(difference)[..., None]))[..., 0]
    return Jump(jump, covariance, misfit, np.maximum(dof, 0))


def _contrast(series: Series, values: Reals, variance: Reals, rows: Indices, span_s: float) -> tuple[Reals, Reals]:
    """Mean over `span_s` from each row on less that over `span_s` up to the row before, (K, m), and its variance."""
    known = np.isfinite(values) & np.isfinite(variance) & (variance > 0.0)
    weight = np.where(known, 1.0 / np.where(known, variance, 1.0), 0.0)
    first = np.take_along_axis(values, known.argmax(axis=0)[None], axis=0)  # sums of small numbers keep their digits
    weights, sums = _summed(weight), _summed(weight * np.where(known, values - first, 0.0))
    low, high = _sides(series, rows, span_s)
    with np.errstate(invalid="ignore", divide="ignore"):
        before, after = weights[rows] - weights[low], weights[high] - weights[rows]
        difference = (sums[high] - sums[rows]) / after - (sums[rows] - sums[low]) / before
        enough = (before > 0.0) & (after > 0.0)
        return np.where(enough, difference, np.nan), np.where(enough, 1.0 / before + 1.0 / after, np.nan)


def _sides(series: Series, rows: Indices, span_s: float) -> tuple[Indices, Indices]:
    """First row of the stretch before each row, and one past the last of the stretch from it on; no divide within."""
    t, n, half = series.elapsed_s, series.elapsed_s.size, 1e-6
    index = np.arange(n)
    begun = np.maximum.accumulate(np.where(series.divides, index, 0))
    ends = np.minimum.accumulate(np.append(np.where(series.divides, index, n), n)[::-1])[::-1]
    return (
        np.maximum(np.searchsorted(t, t[rows - 1] - span_s - half), begun[rows - 1]),
        np.minimum(np.searchsorted(t, t[rows] + span_s + half), ends[rows + 1]),
    )


def _between(series: Series, rows: Indices, span_s: float) -> Reals:
    low, high = _sides(series, rows, span_s)
    return np.asarray(series.bridge_m2[high - 1] - series.bridge_m2[low])


def _unit_at(series: Series, rows: Indices) -> Reals:
    """(K, m, 3): the next known line of sight of each satellite, else the last one."""
    known = np.isfinite(series.unit[..., 0])
    index = np.arange(known.shape[0])[:, None]
    after = np.minimum.accumulate(np.where(known, index, known.shape[0])[::-1], axis=0)[::-1]
    before = np.maximum.accumulate(np.where(known, index, -1), axis=0)
    nearest = np.where(after < known.shape[0], after, np.maximum(before, 0))[rows]
    return np.asarray(series.unit[nearest, np.arange(known.shape[1])[None]])


def _velocity(series: Series, rows: Indices) -> Reals:
    """(K, 3) mean of the velocities just before and after, zero where Dopplers do not give it."""
    unit, found = _unit_at(series, rows), []
    for near in (rows - 1, rows):
        sigma = np.sqrt(series.rate_m2_s2[near])
        known = np.isfinite(series.rate_m_s[near]) & np.isfinite(sigma)
        weight = np.where(known, 1.0 / np.where(known, sigma, 1.0) ** 2, 0.0)
        design = np.nan_to_num(design_matrix(unit))
        weighted = np.swapaxes(design, -1, -2) * weight[:, None, :]
        with np.errstate(invalid="ignore", divide="ignore"):
            solved = spd_inverse(weighted @ design) @ (weighted @ np.nan_to_num(series.rate_m_s[near])[..., None])
        found.append(np.nan_to_num(solved[:, :3, 0]))
    return np.asarray(0.5 * (found[0] + found[1]))


def _broke_at_once(broke: Booleans, there: Booleans) -> Booleans:
    """(n,) the epochs at which nearly all carriers (n, m) broke; of neighbours the one where most did."""
    wide, n = broke.copy(), broke.shape[0]
    wide[:-1] |= broke[1:]
    wide[1:] |= broke[:-1]
    around = there.copy()
    around[:-1] |= there[1:]
    count = broke.sum(axis=1)
    at_once = wide.sum(axis=1) >= np.maximum(_AT_ONCE * around.sum(axis=1), MIN_SATELLITES)
    before, after = np.append(-1, count[: n - 1]), np.append(count[1:], -1)
    return np.asarray(at_once & (count > before) & (count >= after))


def _to_name(least: Reals, jump: Jump, missing_s: Reals, alpha: float) -> int:
    """The test to name: of those that fail the one with the largest jump over its noise, else the longest gap."""
    if least.min() < alpha:
        with np.errstate(invalid="ignore", divide="ignore"):
            size = np.nan_to_num(_quadratic(jump.jump, jump.covariance), nan=-1.0)
        return int(np.argmax(np.where(least < alpha, size, -1.0)))
    return int(np.argmax(missing_s)) if np.any(missing_s > 0.0) else int(np.argmin(least))


def _unsteered(offset_m: Reals) -> Reals:
    """Offsets without the steps of a millisecond by which receivers keep their clocks near GPS time."""
    step_m = np.diff(offset_m, axis=0)
    common_m = np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else 0.0 for row in step_m])
    whole = np.rint(common_m / _STEERED_M)
    steered = (np.abs(whole) == 1.0) & (np.abs(common_m - whole * _STEERED_M) < _STEERED_WITHIN_M)
    return np.asarray(offset_m - _STEERED_M * _summed(np.where(steered, whole, 0.0)[:, None]))


def _usual(series: Series) -> float:
    return float(np.median(np.diff(series.elapsed_s)))


def _quadratic(jump: Reals, covariance: Reals) -> Reals:
    """(K,) squared length of jumps (K, d) in the metric of their covariance."""
    return np.asarray(np.einsum("...i,...ij,...j->...", jump, spd_inverse(covariance), jump))


def _taken(jump: Jump, rows: Booleans) -> Jump:
    return Jump(jump.jump[rows], jump.covariance[rows], jump.misfit[rows], jump.dof[rows])


def _summed(steps: Reals) -> Reals:
    """Running sums that start with a row of zeros."""
    return np.vstack((np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)))


def _since(there: Booleans, elapsed_s: Reals) -> Reals:
    """(n - 1, m) time since the signal was there last, at each row but the first; zero if it never was."""
    latest = np.maximum.accumulate(np.where(there, np.arange(there.shape[0])[:, None], -1), axis=0)[:-1]
    return np.where(latest >= 0, elapsed_s[1:, None] - elapsed_s[np.maximum(latest, 0)], 0.0)
