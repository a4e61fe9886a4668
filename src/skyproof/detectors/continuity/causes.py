"""Explain a step without an exchange of signals: its largest p-value under each benign cause.

The clock is left free in all of them, so that any two together explain no more than one of them does:

- an oscillator steps the clock and its rate, and nothing else;
- samples that are missing, or recorded twice, step the clock by their length, and the platform moves meanwhile;
- a recording that is joined from those of several receivers is as rare as the policy says. Its clock continues with the
  same time and rate by chance only. Each receiver's clock has an error and a rate of its own: if they spread about
  zero with one peak, the density at x is at most 1 / (2 |x|);
- two channels or satellites fail by any amount: the step is there without any two of them;
- reflections, interference and orbits change ranges by up to `unrelated_spread_m`, each by an amount of its own. They
  move a position no farther than the largest sum of such changes, and fit one jump by chance only
  (`navigation.chance`). Satellites without a step do not count in that chance.
"""

from collections.abc import Iterable
from math import comb
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.detectors.continuity.series import Limits, Series
from skyproof.detectors.continuity.steps import (
    KINDS,
    Jump,
    Sides,
    Step,
    chance,
    compare_sides,
    contrast,
    fit_jump,
    mean_rates,
    motion_slack_m,
    sigma_of_fitting,
)
from skyproof.navigation.chance import bound_chance_p_value
from skyproof.navigation.least_squares import design_matrix
from skyproof.records import Cause
from skyproof.statistics.leave_out import largest_p_value_without
from skyproof.statistics.medians import medians

__all__ = ["p_values_by_cause"]

_UNKNOWNS: Final = 4
_HOUR_S: Final = 3600.0


def p_values_by_cause(series: Series, row: int, step: Step, limits: Limits, *, span_s: float) -> dict[Cause, float]:
    """Return the largest p-value of a step of a series before its `row` under each benign cause, the likeliest first.

    span_s : length of the recording that the tests counted by `step.tests` cover.
    """
    sides = compare_sides(series, np.array([row]), limits)
    jump = fit_jump(sides.unit, sides.level_m, sides.level_m2)
    rate = fit_jump(sides.unit, sides.rate_m_s, sides.rate_m2_s2)
    unseen_s = float(sides.gap_s[0]) if sides.divides[0] else 0.0
    position = _motion_p_value(jump.jump[:, :3], jump, motion_slack_m(np.array([unseen_s]), limits))
    speed = _speed_p_value(rate, float(sides.gap_s[0]), limits)
    p = {Cause.OSCILLATOR: min(position, speed)}
    if sides.all_broke[0]:
        p[Cause.MISSING_SAMPLES] = _missing_samples_p_value(sides, jump, rate, step, unseen_s, limits)
    p[Cause.FAULT] = _fault_p_value(sides, unseen_s, limits)
    # At each epoch all four kinds of step are tested; unrelated changes make one of position and clock together.
    unrelated = _p_value_of_unrelated(sides, jump, unseen_s, limits) / len(KINDS)
    p |= dict.fromkeys((Cause.REFLECTIONS, Cause.INTERFERENCE, Cause.ORBITS), unrelated)
    p = {cause: min(1.0, step.tests * value) for cause, value in p.items()}
    mean_rate = fit_jump(
        sides.unit, *contrast(series, series.rate_m_s, series.rate_m2_s2, np.array([row]), limits.span_s)
    )
    same_clock = _same_chance(_clock_m(series, row), jump) * _same_chance(float(mean_rates(sides)[0, 3]), mean_rate)
    p[Cause.JOINED] = min(1.0, POLICY.joined_per_hour * span_s / _HOUR_S * same_clock)
    return dict(sorted(p.items(), key=lambda each: -each[1]))


def _motion_p_value(moved_m: Reals, jump: Jump, slack_m: Reals) -> float:
    return float(chance(moved_m, jump.covariance[:, :3, :3], slack_m, jump)[0])


def _speed_p_value(rate: Jump, apart_s: float, limits: Limits) -> float:
    slack_m_s = np.array([limits.acceleration_m_s2 * apart_s])
    return float(chance(rate.jump[:, :3], rate.covariance[:, :3, :3], slack_m_s, rate)[0])


def _missing_samples_p_value(
    sides: Sides, jump: Jump, rate: Jump, step: Step, unseen_s: float, limits: Limits
) -> float:
    """Return the p-value of position and velocity, if the clock's step is how long the platform moved unseen."""
    ahead_s = -step.clock_s
    unseen_s += abs(ahead_s)
    moved_m = jump.jump[:, :3] - mean_rates(sides)[:, :3] * ahead_s
    position = _motion_p_value(moved_m, jump, motion_slack_m(np.array([unseen_s]), limits))
    return min(position, _speed_p_value(rate, float(sides.gap_s[0]) + abs(ahead_s), limits))


def _clock_m(series: Series, row: int) -> float:
    """Return the receiver's clock error before a row, times the speed of light; the position error may be smaller."""
    return float(medians(series.offset_m[row - 1] + series.move_m[row - 1]))


def _same_chance(usual: float, jump: Jump) -> float:
    """Return the probability that another receiver's clock has so nearly the same error, or rate, as before a jump."""
    apart = abs(float(jump.jump[0, 3])) + POLICY.sure_sigmas * float(np.sqrt(jump.covariance[0, 3, 3]))
    return apart / (abs(usual) - apart) if 2.0 * apart < abs(usual) else 1.0


def _fault_p_value(sides: Sides, unseen_s: float, limits: Limits) -> float:
    """Return the largest p-value of the position's step, any two satellites left out."""
    slack_m = motion_slack_m(np.array([unseen_s]), limits)

    def without(pairs: Iterable[tuple[int, ...]]) -> Reals:
        fewer = np.array([_blank(sides.level_m[0], pair) for pair in pairs])
        shape = fewer.shape
        fitted = fit_jump(np.broadcast_to(sides.unit, (*shape, 3)), fewer, np.broadcast_to(sides.level_m2, shape))
        return chance(fitted.jump[:, :3], fitted.covariance[:, :3, :3], np.broadcast_to(slack_m, shape[:1]), fitted)

    known = np.flatnonzero(np.isfinite(sides.level_m[0])).tolist()
    return largest_p_value_without(known, without, least=POLICY.one_sky_satellites)


def _blank(values: Reals, columns: tuple[int, ...]) -> Reals:
    fewer = values.copy()
    fewer[list(columns)] = np.nan
    return fewer


def _p_value_of_unrelated(sides: Sides, jump: Jump, unseen_s: float, limits: Limits) -> float:
    """Return the p-value of the position's step if ranges change by amounts unrelated to each other.

    It is the smaller of two bounds, doubled. Neither counts the part of the jump that unseen motion explains.
    """
    sigma_m = sigma_of_fitting(sides.unit, sides.level_m, sides.level_m2)[0]
    used, known = np.isfinite(sigma_m), np.isfinite(sides.level_m[0] + sides.level_m2[0])
    unit, sigma_m, slack_m = sides.unit[0, used], sigma_m[used], motion_slack_m(np.array([unseen_s]), limits)
    if _motion_p_value(jump.jump[:, :3], jump, slack_m) > POLICY.faulty_channel_probability:
        return 1.0
    far = _motion_p_value(jump.jump[:, :3], jump, slack_m + _reach_m(unit, sigma_m))
    moved_m = float(np.linalg.norm(jump.jump[0, :3]))
    beyond_m = jump.jump[0, :3] * max(1.0 - float(slack_m[0]) / moved_m, 0.0)
    fitting = _fitting_chance(-unit @ beyond_m, sigma_m, float(jump.misfit[0]), int(known.sum()))
    return min(1.0, 2.0 * min(far, fitting))


def _reach_m(unit: Reals, sigma_m: Reals) -> float:
    """Return how far changes of up to `unrelated_spread_m` each move the position at most."""
    solving = np.linalg.pinv(design_matrix(unit) / sigma_m[:, None]) / sigma_m
    return POLICY.unrelated_spread_m * float(np.linalg.norm(np.abs(solving[:3]).sum(axis=1)))


def _fitting_chance(change_m: Reals, sigma_m: Reals, misfit: float, known: int) -> float:
    """Return the probability that unrelated changes of `known` channels fit one jump as well as these that do."""
    alike = np.abs(change_m[:, None] - change_m) <= POLICY.sure_sigmas * np.hypot(sigma_m[:, None], sigma_m)
    as_before = int(alike.sum(axis=1).max())
    free_m = np.sort(sigma_m)[max(as_before - _UNKNOWNS, 0) :]
    return float(
        bound_chance_p_value(
            free_m,
            window_m=POLICY.unrelated_spread_m,
            largest_statistic=max(misfit, float(sigma_m.size - _UNKNOWNS)),
            combinations=comb(known, sigma_m.size),
        )
    )
