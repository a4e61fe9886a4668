"""Find where the ranges of one sky depart from what their own carriers and Dopplers predict: arrays only.

From each range, subtract what it would be at a fixed place, and by how much the label of its epoch is ahead of the
counter of samples:

    level = -u . p + c clock + slow errors + noise        u receiver to satellite, p from the fixed place

Carrier and Doppler show how it moves, whatever the platform and its oscillator do. So `level - move` is constant for
every satellite: it holds orbits, atmosphere and the constant part of multipath on both sides of any moment. At each
epoch the means over a few seconds before and after it are compared:

    difference = -u . jump of p + jump of c clock + noise

The noise has the variance of both means, of bridges of slips by Doppler, and twice that of multipath: it may have
changed altogether. Under the null (platform and clock continue) the jumps over their covariance are chi-square with 3
and 1 degrees if multipath does change so, and smaller if it stays. During an outage the platform may have accelerated,
and the oscillator drifted, unseen. Then the jump counts from the farthest that this explains, which errs to the safe
side.
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
from skyproof.navigation.reflections import estimate_reflection_sigma_m
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
    "compare_sides",
    "contrast",
    "find_largest_steps",
    "fit_jump",
    "fit_jumps",
    "mean_rates",
    "motion_slack_m",
    "p_values",
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
    kinds : those of KINDS that step. tests : number made together, which the p-value is multiplied by.
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


def find_largest_steps(groups: Sequence[tuple[Series, Indices]], limits: Limits, *, alpha: float) -> list[Step | None]:
    """Find each series' least likely step, of all before its `rows`; None where no epoch has five satellites.

    The satellites must be measured on both sides of the step.

    Missing samples make a step ahead of time where all carriers break. It counts neither as a step of the clock nor,
    with the motion of that time, of the position. It is reported in `missing_s` if no other step fails.
    """
    inner = [rows[(rows > 0) & (rows < series.elapsed_s.size)] for series, rows in groups]
    parts = [compare_sides(series, rows, limits) for (series, _), rows in zip(groups, inner, strict=True) if rows.size]
    if not parts:
        return [None] * len(groups)
    sides, group = _join_sides(parts), np.repeat(np.arange(len(groups)), [rows.size for rows in inner])
    jump, rate, usable = fit_jumps(sides)
    sides, group, rows = sides.take(usable), group[usable], np.concatenate(inner)[usable]
    jump, rate = jump.take(usable), rate.take(usable)
    count = np.bincount(group, minlength=len(groups))[group]
    missing_s = _missing_samples_s(sides, jump, limits, alpha / count)
    chances = p_values(sides, jump, rate, missing_s, limits)
    noticed = _noticeable_steps(sides, jump, rate, limits, alpha / (len(KINDS) * count))
    together = np.minimum(1.0, (chances.shape[1] * count)[:, None] * chances)
    steps: list[Step | None] = []
    for number, (series, _) in enumerate(groups):
        of_group = np.flatnonzero(group == number)
        if of_group.size == 0:
            steps.append(None)
            continue
        best = int(
            of_group[
                _select_named_test(together[of_group].min(axis=1), jump.take(of_group), missing_s[of_group], alpha)
            ]
        )
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
                outage_s=gap_s if gap_s > POLICY.outage_intervals * _usual_interval_s(series) else 0.0,
                missing_s=float(missing_s[best]),
                statistic=float(_quadratic(jump.jump[[best]], jump.covariance[[best]])[0]),
                tests=int(chances.shape[1] * count[best]),
                noticed=tuple(noticed[of_group].max(axis=0).tolist()),
            )
        )
    return steps


class Sides(NamedTuple):
    """The two sides of K epochs of a series: (K, m), but for unit (K, m, 3) and values of an epoch (K,).

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


def compare_sides(series: Series, rows: Indices, limits: Limits) -> Sides:
    """Compare the two sides of each of `rows` (K,), the first epochs after the border."""
    level_m, level_m2 = contrast(series, series.offset_m, series.variance_m2, rows, limits.span_s)
    bridged_m2 = _bridge_variance(series, rows, limits.span_s)
    quadrature_m, _ = contrast(series, series.quadrature_m, series.variance_m2, rows, limits.span_s)
    reflected_m2 = estimate_reflection_sigma_m(quadrature_m, np.sqrt(level_m2)) ** 2
    rate, rate_m2 = contrast(series, series.rate_m_s, series.rate_m2_s2, rows, 0.0)  # one epoch: speeds change
    return Sides(
        level_m=level_m,
        level_m2=level_m2 + bridged_m2 + reflected_m2 + 2.0 * limits.multipath_sigma_m**2,
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


def _join_sides(parts: Sequence[Sides]) -> Sides:
    """Join several series; where one has fewer signals the rest is NaN, which no fit uses."""
    most = max(part.level_m.shape[1] for part in parts)

    def stack_field(name: str) -> Any:
        arrays = [getattr(part, name) for part in parts]
        if arrays[0].ndim == 1:
            return np.concatenate(arrays)
        shape = sum(len(array) for array in arrays), most, *arrays[0].shape[2:]
        whole, first = np.full(shape, np.nan), 0
        for array in arrays:
            whole[first : first + len(array), : array.shape[1]] = array
            first += len(array)
        return whole

    return Sides(*map(stack_field, Sides._fields))


def p_values(sides: Sides, jump: Jump, rate: Jump, missing_s: Reals, limits: Limits) -> Reals:
    """Compute the p-values (K, 4) of "no step", by `KINDS`."""
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


def _noticeable_steps(sides: Sides, jump: Jump, rate: Jump, limits: Limits, alpha: Reals) -> Reals:
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


def _missing_samples_s(sides: Sides, jump: Jump, limits: Limits, alpha: Reals) -> Reals:
    """Estimate the time (K,) that signals are ahead where carriers of all kinds break; zero if noise explains it.

    The oscillator's drift may explain it as well. alpha : (K,).
    """
    ahead_m = -jump.jump[:, 3]
    beyond_m = ahead_m - _clock_slack_m(sides.gap_s, limits)
    with np.errstate(invalid="ignore"):
        real = (beyond_m > 0.0) & (chi_square_survival(beyond_m**2 / jump.covariance[:, 3, 3], 1) < alpha)
    return np.where(sides.broke & sides.all_broke & real, ahead_m / SPEED_OF_LIGHT_M_S, 0.0)


def motion_slack_m(unseen_s: Reals, limits: Limits) -> Reals:
    """Return by how much a platform may depart from the mean of its velocities before and after, metres."""
    slack_m: Reals = np.minimum(0.25 * limits.acceleration_m_s2 * unseen_s, 2.0 * limits.speed_m_s) * unseen_s
    return slack_m


def _clock_slack_m(unseen_s: Reals, limits: Limits) -> Reals:
    """Return by how much an oscillator may depart from the mean of its rates before and after, metres."""
    return SPEED_OF_LIGHT_M_S * (0.5 * limits.clock_jump + 0.25 * limits.clock_pace_s * unseen_s) * unseen_s


def _pace_slack_m_s(apart_s: Reals, limits: Limits) -> Reals:
    """Return by how much an oscillator's rate may depart from what it was."""
    return SPEED_OF_LIGHT_M_S * (limits.clock_jump + limits.clock_pace_s * apart_s)


def chance(jump: Reals, covariance: Reals, slack: Reals, fitted: Jump) -> Reals:
    """Compute the probability of jumps (K, d) so far out, beyond what `slack` (K,) explains: chi-square, d degrees.

    If residuals show more than jumps, and no exclusion mended it, the covariance is known up to a factor only. The
    residuals estimate that factor, and the law is F.
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


def fit_jumps(sides: Sides) -> tuple[Jump, Jump, Booleans]:
    """Fit jumps of position and clock, and of velocity and rate, before each row.

    Also returned are the rows with enough satellites.
    """
    usable = np.isfinite(sides.level_m).sum(axis=1) >= POLICY.one_sky_satellites
    level = fit_jump(sides.unit, sides.level_m, sides.level_m2)
    return level, fit_jump(sides.unit, sides.rate_m_s, sides.rate_m2_s2), usable


def fit_jump(unit: Reals, difference: Reals, variance: Reals) -> Jump:
    """Fit the jump that explains differences (K, m) best, without the channels that jump alone.

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
    """Return the sigma (K, m) of differences, NaN where a channel jumps alone, or too few are known.

    Arguments as of `fit_jump`.
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
    """Average over `span_s` from each row on, less the average up to the row before, (K, m), and its variance."""
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
    """Return the first row of the stretch before each row, and one past the last after it, without a divide."""
    t, n, half = series.elapsed_s, series.elapsed_s.size, 1e-6
    index = np.arange(n)
    begun = np.maximum.accumulate(np.where(series.divides, index, 0))
    ends = np.minimum.accumulate(np.append(np.where(series.divides, index, n), n)[::-1])[::-1]
    return (
        np.maximum(np.searchsorted(t, t[rows - 1] - span_s - half), begun[rows - 1]),
        np.minimum(np.searchsorted(t, t[rows] + span_s + half), ends[rows + 1]),
    )


def _bridge_variance(series: Series, rows: Indices, span_s: float) -> Reals:
    low, high = _sides(series, rows, span_s)
    return np.asarray(series.bridge_m2[high - 1] - series.bridge_m2[low])


def _unit_at(series: Series, rows: Indices) -> Reals:
    """Return the next known line of sight (K, m, 3) of each satellite, else the last one."""
    known = np.isfinite(series.unit[..., 0])
    index = np.arange(known.shape[0])[:, None]
    after = np.minimum.accumulate(np.where(known, index, known.shape[0])[::-1], axis=0)[::-1]
    before = np.maximum.accumulate(np.where(known, index, -1), axis=0)
    nearest = np.where(after < known.shape[0], after, np.maximum(before, 0))[rows]
    return np.asarray(series.unit[nearest, np.arange(known.shape[1])[None]])


def mean_rates(sides: Sides) -> Reals:
    """Return the mean velocity and clock rate of the two sides, (K, 4) in m/s; zero without Dopplers."""
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


def _select_named_test(least: Reals, jump: Jump, missing_s: Reals, alpha: float) -> int:
    """Select the test to name: of those that fail the one with the largest jump over its noise, else the widest gap."""
    if least.min() < alpha:
        with np.errstate(invalid="ignore", divide="ignore"):
            size = np.nan_to_num(_quadratic(jump.jump, jump.covariance), nan=-1.0)
        return int(np.argmax(np.where(least < alpha, size, -1.0)))
    return int(np.argmax(missing_s)) if np.any(missing_s > 0.0) else int(np.argmin(least))


def _usual_interval_s(series: Series) -> float:
    return float(np.median(np.diff(series.elapsed_s)))


def _quadratic(jump: Reals, covariance: Reals) -> Reals:
    """Compute the squared length (K,) of jumps (K, d) in the metric of their covariance."""
    return np.asarray(np.einsum("...i,...ij,...j->...", jump, invert_spd(covariance), jump))
