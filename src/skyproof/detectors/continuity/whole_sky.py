"""A motion that all satellites of a sky show, and not some two of them alone: arrays only.

For changes of ranges, or rates, of one receiver's satellites

    change = -u . moved + clock + errors                                    u receiver to satellite

independent normal errors give a `moved` that over its covariance is chi-square with 3 degrees where nothing moves.
Reflections, and what a loop makes of two signals that beat, change those of some satellites by more than that. So a
motion is that of the whole sky only where it is there without any two of the satellites, too: the largest p-value
without two of them is no smaller than that without those two that err.

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
from skyproof.detectors.continuity.steps import Jump, chance, fitted_jump
from skyproof.records import NOTICED
from skyproof.statistics.distributions import (
    chi_square_survival,
    chi_square_threshold,
    noncentrality_for_power,
)
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["SkyChange", "SkyMotion", "least_likely", "motion_of", "motions_of"]


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


def least_likely(motions: Iterable[SkyMotion | None]) -> SkyMotion | None:
    """The one of several tests that is least likely by chance, with the p-values of all together: bounds."""
    found = [one for one in motions if one is not None]
    if not found:
        return None
    worst = min(found, key=lambda one: (one.whole_sky_p_value, one.p_value))
    return worst._replace(
        p_value=min(1.0, len(found) * min(one.p_value for one in found)),
        whole_sky_p_value=min(1.0, len(found) * worst.whole_sky_p_value),
        noticed_m_s=min(one.noticed_m_s for one in found),
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


def motion_of(
    sats: NDArray[np.str_], unit: Reals, change: Reals, variance: Reals, time_s: float, *, alpha: float
) -> SkyMotion | None:
    """Of one `SkyChange`, as `motions_of`."""
    return motions_of([SkyChange(sats, unit, change, variance, time_s)], alpha=alpha)[0]


def motions_of(changes: Sequence[SkyChange], *, alpha: float) -> list[SkyMotion | None]:
    """The motion that each of several changes shows; None with fewer than five of them.

    alpha : where the p-value is above it, none is left out to see what the others show.
    """
    if not changes:
        return []
    shape = len(changes), max(one.change.size for one in changes)
    unit, change, variance = np.full((*shape, 3), np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    for row, one in enumerate(changes):
        own = slice(one.change.size)
        unit[row, own], change[row, own], variance[row, own] = one.unit, one.change, one.variance
    fitted = fitted_jump(unit, change, variance)
    p_values = _p_values(fitted)
    return [_motion(one, fitted.take(np.array([row])), float(p_values[row]), alpha) for row, one in enumerate(changes)]


def _motion(one: SkyChange, fitted: Jump, p_value: float, alpha: float) -> SkyMotion | None:
    if not fitted.dof[0]:
        return None
    known = np.isfinite(one.change) & np.isfinite(one.variance)
    used = sorted(set(one.sats[known]))

    def without(pairs: Iterable[tuple[str, ...]]) -> Reals:
        left = np.array([np.where(np.isin(one.sats, pair), np.nan, one.change) for pair in pairs])
        units = np.broadcast_to(one.unit, (len(left), *one.unit.shape))
        return _p_values(fitted_jump(units, left, np.broadcast_to(one.variance, left.shape)))

    whole = 1.0
    if p_value < alpha and _as_stated(fitted, int(known.sum())):
        whole = largest_p_value_without(used, without, least=POLICY.one_sky_satellites)
    moved_m = float(np.linalg.norm(fitted.jump[0, :3]))
    return SkyMotion(moved_m, one.time_s, len(used), p_value, whole, _noticed_m(fitted, alpha) / one.time_s)


def _noticed_m(fitted: Jump, alpha: float) -> float:
    """Return the motion that is noticed at `alpha`, in the direction in which it shows least, metres."""
    variance_m2 = np.linalg.eigvalsh(fitted.covariance[0, :3, :3])[-1]
    return float(np.sqrt(variance_m2 * noncentrality_for_power(chi_square_threshold(alpha, 3), 3, power=NOTICED)))


def _as_stated(fitted: Jump, changes: int) -> bool:
    """Whether no change was excluded, and residuals are as large as errors are stated to be."""
    dof = int(fitted.dof[0])
    return dof == changes - 4 and float(chi_square_survival(fitted.misfit[0], dof)) >= POLICY.misfit_probability


def _p_values(fitted: Jump) -> Reals:
    return chance(fitted.jump[:, :3], fitted.covariance[:, :3, :3], np.zeros(len(fitted.jump)), fitted)
