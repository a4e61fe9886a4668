"""Choose between several consistent skies by a prediction from the last trusted fix.

The prediction carries a trusted fix to a later time by any of these:

- an inertial navigator that it corrected (`ins`, `ins_updates.expect_fix`);
- a body that stands: its position stays, its velocity is nothing (`predict_standing`);
- the clock, by its oscillator's class, in either case (`gnss.oscillators.compute_clock_step`).

`choose` then compares it with the fix that each sky gives. With z_j the fix of sky j, R_j its covariance and N(m, P)
the prediction, it takes for given that at most one sky is true, that each is as likely to be so before, and that a
false one may be anywhere: the density of its fix is the same wherever it lies. Then what the false ones show cancels:

    P(j is true | one is) = N(z_j - m; 0, P + R_j) / sum over k of N(z_k - m; 0, P + R_k).

An attacker who chooses where his sky lies gains nothing by this as long as he does not know the prediction's error:
with both fixes given, and only not which is which, the probability holds for that pair. A sky that lies nearer than the
prediction's error cannot be told from the true one, and then the probability is near a half: nothing is chosen.

"Anywhere" makes a sky that lies as near as the fixes' own noise improbable beforehand, and that is where an attacker's
begins. For one that is held at a fixed small distance the probability is too sure of itself (2 m apart, fixes of 2 m:
0.35 predicted, 0.48 counted). So nothing is chosen before the fixes have parted by more than their noise.

That none is true is not among the hypotheses (it would need the density); instead a sky is only taken if its distance
from the prediction is not larger than chance allows: its normalised square is chi-square if it is true.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import Oscillator, compute_clock_step
from skyproof.gnss.time import seconds_between
from skyproof.navigation.nav_estimate import KNOWN, NavEstimate
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["Choice", "are_parted_unseen", "choose", "fit_p_value", "predict_standing"]

_PLACE, _SPEED, _CLOCK = slice(0, 3), slice(3, 6), slice(6, 8)


@dataclass(frozen=True, eq=False, kw_only=True)
class Choice:
    """Which sky is true, if that can be said.

    chosen : its number; None if the probability of a wrong choice is above the limit, it does not fit, or another one
        has not parted from it.
    probabilities : (n,) that each is the true one, if one is. fits : (n,) p-value of each one's distance from the
        prediction, if it is true.
    wrong_probability : that the likeliest is not the true one, if one is.
    used : which of the eight numbers of `NavEstimate` were compared.
    """

    chosen: int | None
    probabilities: Reals
    fits: Reals
    wrong_probability: float
    used: tuple[int, ...]


def predict_standing(
    last: NavEstimate, gpst: np.datetime64, oscillator: Oscillator, *, sway_m_s: float = 0.01
) -> NavEstimate:
    """Predict the fix of a standing body from its last trusted fix: the position stays, the clock runs on.

    sway_m_s : of the antenna. The clock is not known where the fix had no drift.
    """
    seconds = float(seconds_between(gpst, last.gpst))
    moves, noise = np.eye(KNOWN), np.zeros((KNOWN, KNOWN))
    moves[_PLACE, _SPEED] = moves[_SPEED, _SPEED] = 0.0
    moves[_CLOCK, _CLOCK], noise_s2 = compute_clock_step(oscillator, seconds)
    noise[_CLOCK, _CLOCK] = SPEED_OF_LIGHT_M_S**2 * noise_s2
    noise[_SPEED, _SPEED] = sway_m_s**2 * np.eye(3)
    open_ = ~np.isfinite(np.diag(last.covariance))
    before = np.where(open_[:, None] | open_[None, :], 0.0, last.covariance)
    covariance = moves @ before @ moves.T + noise
    lost = np.flatnonzero((moves != 0.0) @ open_)
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    return NavEstimate(gpst=gpst, mean=moves @ np.where(open_, 0.0, last.mean), covariance=covariance)


def choose(
    prediction: NavEstimate,
    candidates: Sequence[NavEstimate],
    *,
    most_wrong: float = 1e-3,
    false_alarm_probability: float = 1e-3,
) -> Choice:
    """Choose the true sky among those whose fixes at the prediction's time are `candidates`.

    most_wrong : probability of a wrong choice above which nothing is chosen; also that of two fixes of one sky to be as
        far apart as those between which is chosen. false_alarm_probability : that the true
    one is refused because it does not fit the prediction.

    Raises
    ------
    ValueError : no candidate, or nothing that prediction and all candidates have in common.
    """
    common = set(prediction.there).intersection(*(candidate.there for candidate in candidates))
    if not candidates or not common:
        raise ValueError("prediction and candidates have nothing to compare; give fixes with position or clock")
    used = np.array(sorted(common))
    block = np.ix_(used, used)
    logs, fits = np.empty(len(candidates)), np.empty(len(candidates))
    for number, candidate in enumerate(candidates):
        spread = prediction.covariance[block] + candidate.covariance[block]
        distance2 = _compute_squared_distance(prediction, candidate, used)
        logs[number] = -0.5 * (distance2 + np.linalg.slogdet(2.0 * np.pi * spread)[1])
        fits[number] = chi_square_survival(distance2, used.size)
    probabilities = special.softmax(logs)
    best = int(np.argmax(probabilities))
    wrong = float(np.sum(np.delete(probabilities, best)))  # not 1 - p, which has no digits below 1e-16
    sure = wrong <= most_wrong and fits[best] >= false_alarm_probability
    for number, other in enumerate(candidates):
        sure &= number == best or _test_alike(candidates[best], other, used) <= most_wrong
    return Choice(
        chosen=best if sure else None,
        probabilities=probabilities,
        fits=fits,
        wrong_probability=wrong,
        used=tuple(int(k) for k in used),
    )


def fit_p_value(prediction: NavEstimate, fix: NavEstimate) -> float:
    """Return the chance that a true fix is as far from what was predicted for its time, in all that both know.

    Raises ValueError where they have nothing in common.
    """
    used = np.intersect1d(prediction.there, fix.there)
    if not used.size:
        raise ValueError("prediction and fix have nothing to compare; give a fix with position or clock")
    return _test_alike(prediction, fix, used)


def are_parted_unseen(one: NavEstimate, other: NavEstimate, used: Sequence[int], *, probability: float) -> bool:
    """Test whether two fixes are apart in a part of place or clock that was not `used` to choose.

    "Apart" is farther than noise has it with `probability`. "Anywhere" does not hold there for a false sky: an attacker
    who drags the position off can leave the clock alone, and the reverse. Its fix is then the true one in all that is
    compared.
    """
    for numbers in (range(*_PLACE.indices(KNOWN)), (6,)):
        rest = np.array(sorted(set(numbers).intersection(one.there, other.there) - set(used)), np.int64)
        if rest.size and _test_alike(one, other, rest) <= probability:
            return True
    return False


def _compute_squared_distance(one: NavEstimate, other: NavEstimate, used: Indices) -> float:
    """Return the squared distance of two independent ones over the sum of their covariances."""
    off = other.mean[used] - one.mean[used]
    block = np.ix_(used, used)
    return float(off @ np.linalg.solve(one.covariance[block] + other.covariance[block], off))


def _test_alike(one: NavEstimate, other: NavEstimate, used: Indices) -> float:
    """Return the chance that two fixes of one sky are as far apart as these."""
    return float(chi_square_survival(_compute_squared_distance(one, other, used), used.size))
