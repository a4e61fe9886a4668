"""Measure how far an epoch's code position and clock lie from where the two epochs before allow them.

Model. Fixes x[k] of single epochs, independent, with covariance P[k] known up to a common factor that the residuals
of the fixes give. The place extrapolated from two epochs is y[k] = x[k-1] + r (x[k-1] - x[k-2]), where r is the ratio
of the intervals d1 and d0 after and before epoch k-1. Then x[k] - y[k] has the covariance P[k] + (1+r)^2 P[k-1] +
r^2 P[k-2]. Its mean lies in a ball whose radius is A d1 (d0 + d1) / 2 for accelerations up to A, since velocities
averaged over the two intervals lie half their sum apart.

The statistic is the squared distance beyond that ball over the largest variance. Under a clean sky it is chi-square.
Reflections may exceed their model by any factor. Then the residuals give that factor, and the statistic has the F
distribution (Kay, Detection Theory, 9.3: unknown noise level). Both err to the safe side for directions of smaller
variance.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import MILLISECOND_M, SPEED_OF_LIGHT_M_S
from skyproof.navigation.fix import FixGeometry
from skyproof.navigation.least_squares import invert_spd
from skyproof.statistics.distributions import f_survival
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = [
    "CodeMotionLimits",
    "CodeStep",
    "chance_of_clock",
    "chance_of_motion",
    "chance_without_two",
    "compute_code_steps",
]


@dataclass(frozen=True, kw_only=True)
class CodeMotionLimits:
    """What a platform and an oscillator can do.

    acceleration_m_s2, speed_m_s : no platform exceeds them; infinite where not known. clock_jump : what an
    oscillator's rate may step by; clock_pace_s : change by in a second.
    """

    acceleration_m_s2: float
    speed_m_s: float
    clock_jump: float
    clock_pace_s: float


@dataclass(frozen=True, eq=False, kw_only=True)
class CodeStep:
    """A row for each epoch after the second: what does not follow from the two before.

    row : (n,) index of the epoch. position_m : (n, 3) beyond the extrapolated one; moved_m : (n, 3) since the epoch
    before. covariance_m2, moved_m2 : (n, 3, 3) of them. clock_m, clock_m2 : (n,) the same of c times the clock bias.
    gap_s, before_s : (n,) the intervals after and before the middle epoch.
    """

    row: Indices
    position_m: Reals
    covariance_m2: Reals
    moved_m: Reals
    moved_m2: Reals
    clock_m: Reals
    clock_m2: Reals
    gap_s: Reals
    before_s: Reals


def compute_code_steps(elapsed_s: Reals, position_m: Reals, clock_m: Reals, covariance_m2: Reals) -> CodeStep:
    """Compare each epoch with the two before.

    elapsed_s : (n,) rising. position_m : (n, 3). clock_m : (n,) c times the clock bias, NaN where it has another
    reference. covariance_m2 : (n, 4, 4) of both.
    """
    row = np.arange(2, elapsed_s.size)
    gap_s, before_s = elapsed_s[row] - elapsed_s[row - 1], elapsed_s[row - 1] - elapsed_s[row - 2]
    ratio = gap_s / before_s
    weights = np.stack([np.ones_like(ratio), -(1.0 + ratio), ratio], axis=1)
    rows = row[:, None] - np.arange(3)
    together = np.einsum("nk,nkij->nij", weights**2, covariance_m2[rows])
    return CodeStep(
        row=row,
        position_m=np.einsum("nk,nki->ni", weights, position_m[rows]),
        covariance_m2=together[:, :3, :3],
        moved_m=position_m[row] - position_m[row - 1],
        moved_m2=covariance_m2[row, :3, :3] + covariance_m2[row - 1, :3, :3],
        clock_m=np.einsum("nk,nk->n", weights, clock_m[rows]),
        clock_m2=together[:, 3, 3],
        gap_s=gap_s,
        before_s=before_s,
    )


def chance_of_motion(motion: CodeStep, limits: CodeMotionLimits, variance_factor: Reals, dof: Reals) -> Reals:
    """Return the chance (n,) of positions at least so far beyond what the limits allow.

    variance_factor : (n,) by which variances exceed their model. dof : (n,) degrees of freedom behind that factor,
    infinite where it is known; the chance is 1 without any. A clock error counts as time for which nothing was
    recorded.
    """
    missing_s = np.nan_to_num(np.abs(motion.clock_m)) / SPEED_OF_LIGHT_M_S
    gap_s = motion.gap_s + missing_s
    bend_m = 0.5 * limits.acceleration_m_s2 * gap_s * (gap_s + motion.before_s)
    found = [_chance(motion.position_m, motion.covariance_m2, bend_m, variance_factor, dof)]
    if np.isfinite(limits.speed_m_s):
        way_m = limits.speed_m_s * gap_s
        found.append(_chance(motion.moved_m, motion.moved_m2, way_m, variance_factor, dof))
    return np.asarray(np.minimum(1.0, len(found) * np.min(found, axis=0)))


def chance_of_clock(motion: CodeStep, limits: CodeMotionLimits, variance_factor: Reals, dof: Reals) -> Reals:
    """Return the chance (n,) of clocks at least so far beyond what an oscillator does; 1 where the clock is not known.

    Whole milliseconds, by which receivers set their clocks, are removed.
    """
    whole_m = MILLISECOND_M * np.rint(motion.clock_m / MILLISECOND_M)
    pace = limits.clock_jump + 0.5 * limits.clock_pace_s * (motion.gap_s + motion.before_s)
    slack_m = SPEED_OF_LIGHT_M_S * pace * motion.gap_s
    rest_m = (motion.clock_m - whole_m)[:, None]
    return _chance(rest_m, motion.clock_m2[:, None, None], slack_m, variance_factor, dof)


def chance_without_two(
    geometry: FixGeometry, rows: Indices, position_m: Reals, elapsed_s: Reals, limits: CodeMotionLimits, dof_left: int
) -> float:
    """Return the largest chance of the motion at the last of three epochs, any one or two measurements left out.

    The same measurements are left out at all three. The chance is 1 if the others have fewer than `dof_left` degrees of
    freedom at any epoch: two of the satellites may then show anything.

    geometry : the linear problem at each fix. rows : (3,) of the epochs, the last first. position_m : (3, 3) of their
    fixes. elapsed_s : (3,) when they were.
    """
    design, misfit_m, sigma_m = geometry.design[rows], geometry.misfit_m[rows], geometry.sigma_m[rows]
    used = np.isfinite(sigma_m) & np.isfinite(misfit_m)
    weight = np.where(used, 1.0 / np.where(used, sigma_m, 1.0) ** 2, 0.0)
    misfit_m = np.where(used, misfit_m, 0.0)

    def p_values(sets: Iterable[tuple[int, ...]]) -> Iterator[float]:
        for out in sets:
            kept = weight.copy()
            kept[:, list(out)] = 0.0
            touched = np.any((kept > 0.0)[..., None] & (design != 0.0), axis=1)
            dof = (kept > 0.0).sum(axis=1) - touched.sum(axis=1)
            if dof.min() < dof_left:
                yield 1.0
                continue
            weighted = np.swapaxes(design, -1, -2) * kept[:, None, :]
            ridge = np.where(touched, 0.0, 1.0)[:, None, :] * np.eye(design.shape[-1])
            inverse = invert_spd(weighted @ design + ridge)
            change = (inverse @ (weighted @ misfit_m[..., None]))[..., 0]
            left_m = misfit_m - np.einsum("eki,ei->ek", design, change)
            factor = max(float((kept * left_m**2).sum() / dof.sum()), 1.0)
            covariance = np.zeros((3, 4, 4))
            covariance[:, :3, :3] = inverse[:, :3, :3]
            covariance[:, 3, 3] = 1.0
            places_m = position_m + change[:, :3]
            motion = compute_code_steps(elapsed_s[::-1], places_m[::-1], np.full(3, np.nan), covariance[::-1])
            dof_least = dof.min(keepdims=True).astype(np.float64)
            yield chance_of_motion(motion, limits, np.array([factor]), dof_least)[0]

    present = np.flatnonzero(used.any(axis=0)).tolist()
    return largest_p_value_without(present, p_values, counts=(0, 1, 2), least=0, enough=0.5)


def _chance(value_m: Reals, covariance_m2: Reals, slack_m: Reals, variance_factor: Reals, dof: Reals) -> Reals:
    """Return the chance (n,) of values (n, d) so far beyond a ball: F with d and `dof` degrees."""
    d = value_m.shape[-1]
    known = np.isfinite(value_m).all(axis=-1) & np.isfinite(covariance_m2).all(axis=(-1, -2)) & (dof > 0)
    widest_m2 = np.linalg.eigvalsh(np.where(known[:, None, None], covariance_m2, np.eye(d)))[:, -1]
    far_m = np.linalg.norm(np.where(known[:, None], value_m, 0.0), axis=-1)
    beyond = np.maximum(far_m - slack_m, 0.0) ** 2 / widest_m2 / d / variance_factor
    return np.where(known, f_survival(beyond, d, np.maximum(dof, 1)), 1.0)
