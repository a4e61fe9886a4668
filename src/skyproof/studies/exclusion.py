"""Which of several fixes is the true one? The one that an inertial navigator, free-running since the last clean fix,
allows, by the covariance of both.

Ahmed, Khanafseh, Pervan (decomposition with INS aiding) take the nearest fix and leave the covariance for later. It
matters: a tactical unit drifts 92 m to the side in 233 s and 12 m up, so that the nearer of two fixes 100 m apart
up-east is the wrong one in a quarter of all cases, and the one with the smaller d^2 in two of a thousand.

    d_j^2 = (x_INS - x_j)^T (P_INS + P_j)^-1 (x_INS - x_j),     chi-square with 3 degrees for the true fix.

Leading axes are free; axes and frame are the caller's, the same for all arguments.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Integers, Reals
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["FixChoice", "choose_fix", "distance_squared", "wrong_choice_probability", "wrong_choice_rule"]


@dataclass(frozen=True, eq=False, kw_only=True)
class FixChoice:
    """chosen (...): number of the fix, -1 for undecided. nearest (...): the one with the smallest d^2, whatever it is.
    distance2 (..., k): d^2 of each fix, its p-value in `p_value`, uniform for the true fix."""

    chosen: Integers
    nearest: Integers
    distance2: Reals
    p_value: Reals


def distance_squared(apart: ArrayLike, covariance: ArrayLike) -> Reals:
    """Compute v^T P^-1 v (...) of vectors (..., d) and covariances (..., d, d)."""
    v = np.asarray(apart, np.float64)[..., None]
    return np.asarray(np.sum(v * np.linalg.solve(np.asarray(covariance, np.float64), v), axis=(-2, -1)))


def choose_fix(
    position_m: ArrayLike,
    covariance_m2: ArrayLike,
    fixes_m: ArrayLike,
    fix_covariance_m2: ArrayLike,
    *,
    false_alarm_probability: float = 1e-3,
    wrong_probability: float = 1e-3,
) -> FixChoice:
    """Choose among fixes (..., k, d) with covariances (..., k, d, d) by a navigator's place (..., d) and its own.

    The nearest by d^2 is chosen if it passes its chi-square test, and every other either fails its own or is so much
    farther that the odds against it, of fixes equally likely before, are those of `wrong_probability`: d_2^2 - d_1^2 >
    2 ln((1 - p) / p), 13.8 at 1e-3. Else undecided (-1): coast, do not restart. A single fix is judged by its own test.

    false_alarm_probability : that the true fix fails its chi-square test.
    """
    fixes = np.asarray(fixes_m, np.float64)
    apart = np.asarray(position_m, np.float64)[..., None, :] - fixes
    total = np.asarray(covariance_m2, np.float64)[..., None, :, :] + np.asarray(fix_covariance_m2, np.float64)
    distance2 = distance_squared(apart, total)
    nearest = np.argmin(distance2, axis=-1)
    limit = float(chi_square_threshold(false_alarm_probability, fixes.shape[-1]))
    margin = 2.0 * np.log((1.0 - wrong_probability) / wrong_probability)
    least = np.take_along_axis(distance2, nearest[..., None], axis=-1)
    is_nearest = np.arange(fixes.shape[-2]) == nearest[..., None]
    beaten = is_nearest | (distance2 > limit) | (distance2 - least > margin)
    sure = (least[..., 0] < limit) & np.all(beaten, axis=-1)
    return FixChoice(
        chosen=np.where(sure, nearest, -1),
        nearest=np.asarray(nearest),
        distance2=distance2,
        p_value=chi_square_survival(distance2, fixes.shape[-1]),
    )


def wrong_choice_probability(offset_m: ArrayLike, covariance_m2: ArrayLike, fix_covariance_m2: ArrayLike) -> Reals:
    """Compute the chance (...) that the false one of two fixes (..., d) apart has the smaller d^2.

    covariance_m2 : (..., d, d) of the navigator; fix_covariance_m2 : (d, d) of each fix, their noises independent.

    The false fix is nearer if v^T P^-1 m > 0, with v the difference of the fixes, m the navigator's place from their
    middle and P = P_INS + P_fix. Both are independent, of means D and -D/2, covariances 2 P_fix and P_INS + P_fix / 2;
    so the chance is known given v, and is averaged over v by Gauss-Hermite quadrature.
    """
    offset, ins = np.asarray(offset_m, np.float64), np.asarray(covariance_m2, np.float64)
    fix = np.asarray(fix_covariance_m2, np.float64)
    d = offset.shape[-1]
    nodes, weights = np.polynomial.hermite_e.hermegauss(9)
    grid = np.stack(np.meshgrid(*[nodes] * d, indexing="ij"), axis=-1).reshape(-1, d)
    weight = np.prod(np.stack(np.meshgrid(*[weights] * d, indexing="ij"), axis=-1), axis=-1).ravel()
    apart = offset[..., None, :] + grid @ np.linalg.cholesky(2.0 * fix).T
    along = np.linalg.solve((ins + fix)[..., None, :, :], apart[..., None])[..., 0]
    spread = np.einsum("...ni,...ij,...nj->...n", along, ins + 0.5 * fix, along)
    chance = special.ndtr(-0.5 * np.sum(along * offset[..., None, :], axis=-1) / np.sqrt(spread))
    return np.asarray(chance @ weight / weight.sum())


def wrong_choice_rule(offset_m: ArrayLike, covariance_m2: ArrayLike) -> Reals:
    """Estimate the chance (...) that the false one of two fixes has the smaller d^2, to first order.

    Q(sqrt(D^T P^-1 D) / 2), with P (..., d, d) the sum of the navigator's covariance and that of one fix. The rule of
    thumb: `wrong_choice_probability` to first order in the fixes' noise over their offset.
    """
    return np.asarray(special.ndtr(-0.5 * np.sqrt(distance_squared(offset_m, covariance_m2))))
