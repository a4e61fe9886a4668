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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.detectors.continuity.series import Limits, Series, sum_from_zero
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.least_squares import design_matrix, invert_spd
from skyproof.navigation.raim import exclude_several, fit_whitened
from skyproof.records import NOTICED, Cause
from skyproof.statistics.distributions import (
    chi_square_survival,
    chi_square_threshold,
    f_survival,
    noncentrality_for_power,
)

__all__ = [
    "KINDS",
    "Jump",
    "Sides",
    "Step",
    "chance",
    "contrast",
    "fitted_jump",
    "jumps",
    "largest_steps",
    "mean_rates",
    "motion_slack_m",
    "p_values",
    "sides_of",
    "sigma_of_fitting",
]

KINDS = ("position", "clock", "velocity", "rate")
"""What is tested at each epoch: jumps of the position, the clock, the velocity and the clock's rate."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """The largest step of a series. `row` is the first epoch after it.

    p_value : at least that of all tests that were made together. broke : all carriers broke there. outage_s : how long
    nothing was measured before. missing_s : samples that are missing, if that explains the clock's step.
    clock_s : positive where the signals' time goes back against the counter of samples.
    kinds : those of KINDS that cannot go on. tests : that were made together, which the p-value is multiplied by.
    causes : p-value under each benign cause, of a step that fails. noticed : of each of KINDS, in m, s, m/s and s/s,
    what would have been noticed at any of the epochs.
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
    tests: int
    noticed: tuple[float, ...]
    causes: tuple[tuple[Cause, float], ...] = ()


class Jump(NamedTuple):
    """A jump (K, 4) of position and c clock, or of their rates, its covariance (K, 4, 4), and the residuals' chi-square
    with its degrees (K,)."""

    jump: Reals
    covariance: Reals
    misfit: Reals
    dof: Integers

    def take(self, rows: Booleans | Indices) -> "Jump":
        return Jump(self.jump[rows], self.covariance[rows], self.misfit[rows], self.dof[rows])


def largest_steps(groups: Sequence[tuple[Series, Indices]], limits: Limits, *, alpha: float) -> list[Step | None]:
    """Of each series the step that is least likely by chance, of all before its `rows`; None where no epoch has five
    satellites on both sides.

    A step ahead of time where all carriers break is what missing samples make; it counts neither as a step of the
    clock nor, with the motion of that time, of the position, and is reported in `missing_s` if no other step fails.
    """
    inner = [rows[(rows > 0) & (rows < series.elapsed_s.size)] for series, rows in groups]
    parts = [sides_of(series, rows, limits) for (series, _), rows in zip(groups, inner, strict=True) if rows.size]
    if not parts:
        return [None] * len(groups)
    sides, group = _side_by_side(parts), np.repeat(np.arange(len(groups)), [rows.size for rows in inner])
    jump, rate, usable = jumps(sides)
    sides, group, rows = sides.take(usable), group[usable], np.concatenate(inner)[usable]
    jump, rate = jump.take(usable), rate.take(usable)
    count = np.bincount(group, minlength=len(groups))[group]
    missing_s = _missing(sides, jump, limits, alpha / count)
    chances = p_values(sides, jump, rate, missing_s, limits)
    noticed = _noticed(sides, jump, rate, limits, alpha / (len(KINDS) * count))
    together = np.minimum(1.0, (chances.shape[1] * count)[:, None] * chances)
    steps: list[Step | None] = []
    for number, (series, _) in enumerate(groups):
        own = np.flatnonzero(group == number)
        if own.size == 0:
            steps.append(None)
            continue
        best = int(own[_to_name(together[own].min(axis=1), jump.take(own), missing_s[own], alpha)])
        gap_s = float(sides.gap_s[best])
        steps.append(
            Step(
                row=int(rows[best]),
                p_value=float(together[best].min()),
                kinds=tuple(kind for kind, p in zip(KINDS, together[best], strict=True) if p < alpha),
                position_m=float(np.linalg.norm(jump.jump[best, :3])),
                clock_s=float(jump.jump[best, 3]) / SPEED_OF_LIGHT_M_S,
                speed_m_s=float(np.linalg.norm(rate.jump[best, :3])),
                rate=float(rate.jump[best, 3]) / SPEED_OF_LIGHT_M_S,
                broke=bool(sides.broke[best]),
                outage_s=gap_s if gap_s > POLICY.outage_intervals * _usual(series) else 0.0,
                missing_s=float(missing_s[best]),
                statistic=float(_quadratic(jump.jump[[best]], jump.covariance[[best]])[0]),
                tests=int(chances.shape[1] * count[best]),
                noticed=tuple(noticed[own].max(axis=0).tolist()),
            )
        )
    return steps


class Sides(NamedTuple):
    """What lies on the two sides of K epochs of a series: (K, m), but for unit (K, m, 3) and what is of the epoch (K,).

    level, rate : the contrasts of offsets and of rates, and their variances. before, after : the rates at the epochs
    next to it, and their variances. gap_s : between those. divides, broke, all_broke : as of `Series`.
    """

    level_m: Reals
    level_m2: Reals
    rate_m_s: Reals
    rate_m2_s2: Reals
    before_m_s: Reals
    before_m2_s2: Reals
    after_m_s: Reals
    after_m2_s2: Reals
    unit: Reals
    gap_s: Reals
    divides: Booleans
    broke: Booleans
    all_broke: Booleans

    def take(self, rows: Booleans | Indices) -> "Sides":
        return Sides(*(np.asarray(getattr(self, name))[rows] for name in self._fields))


def sides_of(series: Series, rows: Indices, limits: Limits) -> Sides:
    """What lies on the two sides of each of `rows` (K,), the first epochs after them."""
    level_m, level_m2 = contrast(series, series.offset_m, series.variance_m2, rows, limits.span_s)
    bridged_m2 = _between(series, rows, limits.span_s)
    rate, rate_m2 = contrast(series, series.rate_m_s, series.rate_m2_s2, rows, 0.0)  # one epoch: speeds change
    return Sides(
        level_m=level_m,
        level_m2=level_m2 + bridged_m2 + 2.0 * limits.multipath_sigma_m**2,
        rate_m_s=rate,
        rate_m2_s2=rate_m2,
        before_m_s=series.rate_m_s[rows - 1],
        before_m2_s2=series.rate_m2_s2[rows - 1],
        after_m_s=series.rate_m_s[rows],
        after_m2_s2=series.rate_m2_s2[rows],
        unit=_unit_at(series, rows),
        gap_s=series.elapsed_s[rows] - series.elapsed_s[rows - 1],
        divides=series.divides[rows],
        broke=series.broke[rows],
        all_broke=series.all_broke[rows],
    )


def _side_by_side(parts: Sequence[Sides]) -> Sides:
    """Those of several series as one; where a series has fewer signals the others are NaN, which no fit uses."""
    most = max(part.level_m.shape[1] for part in parts)

    def stacked(name: str) -> Any:
        arrays = [getattr(part, name) for part in parts]
        if arrays[0].ndim == 1:
            return np.concatenate(arrays)
        shape = sum(len(array) for array in arrays), most, *arrays[0].shape[2:]
        whole, first = np.full(shape, np.nan), 0
        for array in arrays:
            whole[first : first + len(array), : array.shape[1]] = array
            first += len(array)
        return whole

    return Sides(*map(stacked, Sides._fields))


def p_values(sides: Sides, jump: Jump, rate: Jump, missing_s: Reals, limits: Limits) -> Reals:
    """(K, 4) of "goes on", by `KINDS`."""
    unseen_s = np.where(sides.divides, sides.gap_s, 0.0) + missing_s
    apart_s = sides.gap_s + missing_s
    moved_m = jump.jump[:, :3]
    if missing_s.any():
        moved_m = moved_m - mean_rates(sides)[:, :3] * missing_s[:, None]
    slack_m = motion_slack_m(unseen_s, limits)
    clock_m = _clock_slack_m(unseen_s, limits)
    stepped_m = np.where(missing_s > 0.0, 0.0, jump.jump[:, 3])
    pace_m_s = _pace_slack_m_s(apart_s, limits)
    return np.stack(
        [
            chance(moved_m, jump.covariance[:, :3, :3], slack_m, jump),
            chance(stepped_m[:, None], jump.covariance[:, 3:, 3:], clock_m, jump),
            chance(rate.jump[:, :3], rate.covariance[:, :3, :3], limits.acceleration_m_s2 * apart_s, rate),
            chance(rate.jump[:, 3:], rate.covariance[:, 3:, 3:], pace_m_s, rate),
        ],
        axis=1,
    )


def _noticed(sides: Sides, jump: Jump, rate: Jump, limits: Limits, alpha: Reals) -> Reals:
    """Return the steps (K, 4) of each of KINDS, in m, s, m/s and s/s, that a test at `alpha` (K,) notices.

    Platform and oscillator may do what they can against the attack: what they are allowed counts twice.
    """
    unseen_s = np.where(sides.divides, sides.gap_s, 0.0)

    def sigma(fitted: Jump, of_clock: bool) -> Reals:
        covariance = np.nan_to_num(fitted.covariance)
        variance = covariance[:, 3, 3] if of_clock else np.linalg.eigvalsh(covariance[:, :3, :3])[:, -1]
        dof = 1 if of_clock else 3
        return np.sqrt(variance * noncentrality_for_power(chi_square_threshold(alpha, dof), dof, power=NOTICED))

    clock_m, pace_m_s = _clock_slack_m(unseen_s, limits), _pace_slack_m_s(sides.gap_s, limits)
    return np.stack(
        [
            2.0 * motion_slack_m(unseen_s, limits) + sigma(jump, False),
            (2.0 * clock_m + sigma(jump, True)) / SPEED_OF_LIGHT_M_S,
            2.0 * limits.acceleration_m_s2 * sides.gap_s + sigma(rate, False),
            (2.0 * pace_m_s + sigma(rate, True)) / SPEED_OF_LIGHT_M_S,
        ],
        axis=1,
    )


def _missing(sides: Sides, jump: Jump, limits: Limits, alpha: Reals) -> Reals:
    """(K,) time that the signals are ahead by where carriers of all kinds break, if noise and oscillator do not show
    it; else zero. alpha : (K,)."""
    ahead_m = -jump.jump[:, 3]
    beyond_m = ahead_m - _clock_slack_m(sides.gap_s, limits)
    with np.errstate(invalid="ignore"):
        real = (beyond_m > 0.0) & (chi_square_survival(beyond_m**2 / jump.covariance[:, 3, 3], 1) < alpha)
    return np.where(sides.broke & sides.all_broke & real, ahead_m / SPEED_OF_LIGHT_M_S, 0.0)


def motion_slack_m(unseen_s: Reals, limits: Limits) -> Reals:
    """Return by how much a platform may part from the mean of its velocities before and after, metres."""
    slack_m: Reals = np.minimum(0.25 * limits.acceleration_m_s2 * unseen_s, 2.0 * limits.speed_m_s) * unseen_s
    return slack_m


def _clock_slack_m(unseen_s: Reals, limits: Limits) -> Reals:
    """By how much an oscillator may part from the mean of its rates before and after."""
    return SPEED_OF_LIGHT_M_S * (0.5 * limits.clock_jump + 0.25 * limits.clock_pace_s * unseen_s) * unseen_s


def _pace_slack_m_s(apart_s: Reals, limits: Limits) -> Reals:
    """Return by how much an oscillator's rate may part from what it was."""
    return SPEED_OF_LIGHT_M_S * (limits.clock_jump + limits.clock_pace_s * apart_s)


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
        fits = chi_square_survival(fitted.misfit, np.maximum(fitted.dof, 1)) >= POLICY.faulty_channel_probability
        scaled = squared / d / np.maximum(fitted.misfit / np.maximum(fitted.dof, 1), 1.0)
        p = np.where(fits, chi_square_survival(squared, d), f_survival(scaled, d, np.maximum(fitted.dof, 1)))
    return np.where(np.isfinite(p) & (fitted.dof > 0), p, 1.0)


def jumps(sides: Sides) -> tuple[Jump, Jump, Booleans]:
    """Jumps of position and clock, and of velocity and rate, before each row; and where there are enough satellites."""
    usable = np.isfinite(sides.level_m).sum(axis=1) >= POLICY.one_sky_satellites
    level = fitted_jump(sides.unit, sides.level_m, sides.level_m2)
    return level, fitted_jump(sides.unit, sides.rate_m_s, sides.rate_m2_s2), usable


def fitted_jump(unit: Reals, difference: Reals, variance: Reals) -> Jump:
    """The jump that explains differences (K, m) best, without the channels that jump by themselves.

    unit : (K, m, 3) to the satellites. variance : (K, m) of the differences; what is not finite is left out.
    """
    design = np.nan_to_num(design_matrix(unit))
    sigma = sigma_of_fitting(unit, difference, variance)
    residual, _, _ = fit_whitened(design, difference, sigma)
    misfit, dof = np.nansum(residual**2, axis=1), np.isfinite(sigma).sum(axis=1) - 4
    weight = np.where(np.isfinite(sigma), 1.0 / np.where(np.isfinite(sigma), sigma, 1.0) ** 2, 0.0)
    weighted = np.swapaxes(design, -1, -2) * weight[:, None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = invert_spd(weighted @ design)
    jump = (covariance @ (weighted @ np.nan_to_num(difference)[..., None]))[..., 0]
    return Jump(jump, covariance, misfit, np.maximum(dof, 0))


def sigma_of_fitting(unit: Reals, difference: Reals, variance: Reals) -> Reals:
    """Return the sigma (K, m) of differences, NaN where a channel jumps by itself, or where too few are known.

    Arguments as of `fitted_jump`.
    """
    design, sigma = np.nan_to_num(design_matrix(unit)), np.sqrt(variance)
    sigma = np.where(np.isfinite(difference) & np.isfinite(sigma), sigma, np.nan)
    enough = np.isfinite(sigma).sum(axis=1) >= POLICY.one_sky_satellites
    sigma = np.where(enough[:, None], sigma, np.nan)
    residual, _, _ = fit_whitened(design, difference, sigma)
    misfit, dof = np.nansum(residual**2, axis=1), np.isfinite(sigma).sum(axis=1) - 4
    faulty = np.flatnonzero(
        enough & (chi_square_survival(misfit, np.maximum(dof, 1)) < POLICY.faulty_channel_probability)
    )
    if faulty.size:
        excluded, _ = exclude_several(
            design[faulty], difference[faulty], sigma[faulty], false_alarm_probability=POLICY.faulty_channel_probability
        )
        sigma[faulty] = np.where(excluded, np.nan, sigma[faulty])
    return sigma


def contrast(series: Series, values: Reals, variance: Reals, rows: Indices, span_s: float) -> tuple[Reals, Reals]:
    """Return the mean over `span_s` from each row on less that up to the row before, (K, m), and its variance."""
    known = np.isfinite(values) & np.isfinite(variance) & (variance > 0.0)
    weight = np.where(known, 1.0 / np.where(known, variance, 1.0), 0.0)
    first = np.take_along_axis(values, known.argmax(axis=0)[None], axis=0)  # sums of small numbers keep their digits
    weights, sums = sum_from_zero(weight), sum_from_zero(weight * np.where(known, values - first, 0.0))
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


def mean_rates(sides: Sides) -> Reals:
    """Return the mean velocity and clock rate of the two sides, (K, 4) in m/s; zero where Dopplers give none."""
    before = _rates(sides.unit, sides.before_m_s, sides.before_m2_s2)
    return np.asarray(0.5 * (before + _rates(sides.unit, sides.after_m_s, sides.after_m2_s2)))


def _rates(unit: Reals, rate_m_s: Reals, rate_m2_s2: Reals) -> Reals:
    sigma = np.sqrt(rate_m2_s2)
    known = np.isfinite(rate_m_s) & np.isfinite(sigma)
    weight = np.where(known, 1.0 / np.where(known, sigma, 1.0) ** 2, 0.0)
    design = np.nan_to_num(design_matrix(unit))
    weighted = np.swapaxes(design, -1, -2) * weight[:, None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        solved = invert_spd(weighted @ design) @ (weighted @ np.nan_to_num(rate_m_s)[..., None])
    return np.asarray(np.nan_to_num(solved[..., 0]))


def _to_name(least: Reals, jump: Jump, missing_s: Reals, alpha: float) -> int:
    """The test to name: of those that fail the one with the largest jump over its noise, else the longest gap."""
    if least.min() < alpha:
        with np.errstate(invalid="ignore", divide="ignore"):
            size = np.nan_to_num(_quadratic(jump.jump, jump.covariance), nan=-1.0)
        return int(np.argmax(np.where(least < alpha, size, -1.0)))
    return int(np.argmax(missing_s)) if np.any(missing_s > 0.0) else int(np.argmin(least))


def _usual(series: Series) -> float:
    return float(np.median(np.diff(series.elapsed_s)))


def _quadratic(jump: Reals, covariance: Reals) -> Reals:
    """(K,) squared length of jumps (K, d) in the metric of their covariance."""
    return np.asarray(np.einsum("...i,...ij,...j->...", jump, invert_spd(covariance), jump))
