"""Find a motion that all satellites of a sky show, and not some two of them alone: arrays only.

For changes of ranges, or rates, of one receiver's satellites

    change = -u . moved + clock + errors                                    u receiver to satellite

independent normal errors give a `moved` that over its covariance is chi-square with 3 degrees if nothing moves.
Reflections, and a loop that tracks two beating signals, change those of some satellites by more than that. So a motion
is that of the whole sky only if it remains without any two of the satellites. The largest p-value without two of them
is no smaller than that without those two that err.

And only where errors are as stated: a motion and a clock have to explain all changes, of no satellite more or less.
Between houses all ranges err by many times what is stated, and without the satellites that fit least the rest show any
motion.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.detectors.continuity.steps import Jump, chance, fit_jump
from skyproof.records import NOTICED
from skyproof.statistics.distributions import (
    chi_square_survival,
    chi_square_threshold,
    noncentrality_for_power,
)
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["SkyChange", "SkyMotion", "estimate_motion", "estimate_motions", "select_least_likely"]


class SkyMotion(NamedTuple):
    """metres : of `moved`, within a time. satellites : that show it. p_value : of "nothing moves", by all satellites.
    whole_sky_p_value : the largest one without any two of them; 1 with fewer than seven satellites, and where motion
    and clock leave residuals that are larger than stated. noticed_m_s : the least speed that the tests notice.
    """

    metres: float
    time_s: float
    satellites: int
    p_value: float
    whole_sky_p_value: float
    noticed_m_s: float


def select_least_likely(motions: Iterable[SkyMotion | None]) -> SkyMotion | None:
    """Select the least likely of several motions, with p-values that bound those of all tests together."""
    found = [motion for motion in motions if motion is not None]
    if not found:
        return None
    worst = min(found, key=lambda motion: (motion.whole_sky_p_value, motion.p_value))
    return worst._replace(
        p_value=min(1.0, len(found) * min(motion.p_value for motion in found)),
        whole_sky_p_value=min(1.0, len(found) * worst.whole_sky_p_value),
        noticed_m_s=min(motion.noticed_m_s for motion in found),
    )


class SkyChange(NamedTuple):
    """Changes (m,) within a time with their variance (m,) and directions (m, 3).

    sats : (m,) whose they are; of one satellite there may be several.
    """

    sats: NDArray[np.str_]
    unit: Reals
    change: Reals
    variance: Reals
    time_s: float


def estimate_motion(
    sats: NDArray[np.str_], unit: Reals, change: Reals, variance: Reals, time_s: float, *, alpha: float
) -> SkyMotion | None:
    """Estimate the motion of one `SkyChange`, as `estimate_motions`."""
    return estimate_motions([SkyChange(sats, unit, change, variance, time_s)], alpha=alpha)[0]


def estimate_motions(changes: Sequence[SkyChange], *, alpha: float) -> list[SkyMotion | None]:
    """Estimate the motion that each of several changes shows; None with fewer than five of them.

    alpha : only below this p-value are satellites left out to test the others.
    """
    if not changes:
        return []
    shape = len(changes), max(sky_change.change.size for sky_change in changes)
    unit, change, variance = np.full((*shape, 3), np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    for row, sky_change in enumerate(changes):
        columns = slice(sky_change.change.size)
        unit[row, columns], change[row, columns], variance[row, columns] = (
            sky_change.unit,
            sky_change.change,
            sky_change.variance,
        )
    fitted = fit_jump(unit, change, variance)
    p_values = _p_values(fitted)
    return [
        _motion(sky_change, fitted.take(np.array([row])), float(p_values[row]), alpha)
        for row, sky_change in enumerate(changes)
    ]


def _motion(sky_change: SkyChange, fitted: Jump, p_value: float, alpha: float) -> SkyMotion | None:
    if not fitted.dof[0]:
        return None
    known = np.isfinite(sky_change.change) & np.isfinite(sky_change.variance)
    used = sorted(set(sky_change.sats[known]))

    def without(pairs: Iterable[tuple[str, ...]]) -> Reals:
        fewer = np.array([np.where(np.isin(sky_change.sats, pair), np.nan, sky_change.change) for pair in pairs])
        units = np.broadcast_to(sky_change.unit, (len(fewer), *sky_change.unit.shape))
        return _p_values(fit_jump(units, fewer, np.broadcast_to(sky_change.variance, fewer.shape)))

    whole = 1.0
    if p_value < alpha and _fits_stated_errors(fitted, int(known.sum())):
        whole = largest_p_value_without(used, without, least=POLICY.one_sky_satellites)
    moved_m = float(np.linalg.norm(fitted.jump[0, :3]))
    return SkyMotion(
        moved_m, sky_change.time_s, len(used), p_value, whole, _noticeable_m(fitted, alpha) / sky_change.time_s
    )


def _noticeable_m(fitted: Jump, alpha: float) -> float:
    """Return the motion that is noticed at `alpha`, in the direction in which it shows least, metres."""
    variance_m2 = np.linalg.eigvalsh(fitted.covariance[0, :3, :3])[-1]
    return float(np.sqrt(variance_m2 * noncentrality_for_power(chi_square_threshold(alpha, 3), 3, power=NOTICED)))


def _fits_stated_errors(fitted: Jump, changes: int) -> bool:
    """Test if no change was excluded, and residuals are as large as errors are stated to be."""
    dof = int(fitted.dof[0])
    return dof == changes - 4 and float(chi_square_survival(fitted.misfit[0], dof)) >= POLICY.misfit_probability


def _p_values(fitted: Jump) -> Reals:
    return chance(fitted.jump[:, :3], fitted.covariance[:, :3, :3], np.zeros(len(fitted.jump)), fitted)
