"""Hold the fixes of a window against what a navigator predicts of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from skyproof.detectors.prediction.policy import POLICY
from skyproof.detectors.prediction.unit_errors import Departure
from skyproof.fusion.policy import POLICY as FUSION
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.nav_estimate import NavEstimate, mark_unknown
from skyproof.navigation.prediction import fit_p_value
from skyproof.navigation.predictor import SkyFix
from skyproof.records import ConsistentSet

__all__ = ["ComparedFix", "PredictedCourse", "run_through"]

_CLOCK: Final = np.array([6, 7])


@dataclass(frozen=True, eq=False)
class PredictedCourse:
    """What a navigator predicts through a window, at the instants of its fixes.

    learned : how many windows had corrected it. carried : to the last fix.
    """

    learned: int
    carried: Inertial
    each: tuple[NavEstimate, ...]

    def at(self, gpst: np.datetime64) -> NavEstimate | None:
        """Return what it predicts for an instant; a fix without some satellites is off theirs by nanoseconds."""
        if not self.each:
            return None
        off_s = np.asarray(seconds_between(np.array([expected.gpst for expected in self.each]), gpst), np.float64)
        nearest = int(np.argmin(np.abs(off_s)))
        if abs(off_s[nearest]) > POLICY.label_off_s:
            return None
        expected = self.each[nearest]
        moved_m = np.append(-off_s[nearest] * expected.mean[3:6], np.zeros(5))
        return replace(expected, gpst=gpst, mean=expected.mean + moved_m)

    def compare(self, fixes: Sequence[NavEstimate]) -> list[Departure]:
        """Compare both velocities."""
        found = list[Departure]()
        for fix in fixes:
            near = found and float(seconds_between(fix.gpst, found[-1].gpst)) < POLICY.look_interval_s
            if near or fix.there.size < 6 or (expected := self.at(fix.gpst)) is None:
                continue
            apart = fix.mean[:6] - expected.mean[:6]
            found.append(Departure(fix.gpst, expected.mean[3:6], apart, fix.covariance[:6, :6]))
        return found

    def average(self, fixes: Sequence[NavEstimate], expected: NavEstimate) -> NavEstimate:
        """Return the last fix with a velocity that is off the predicted one as all are on average.

        Reflections differ from second to second, as where fixes correct a navigator. What is predicted errs no more on
        average than at the end.
        """
        last, looks = fixes[-1], self.compare(fixes)
        mean, covariance = last.mean.copy(), last.covariance.copy()
        mean[3:6] = expected.mean[3:6] + np.mean([look.apart[3:] for look in looks], axis=0)
        lasted_s = float(seconds_between(looks[-1].gpst, looks[0].gpst))
        covariance[3:6] /= 1.0 + np.floor(lasted_s / FUSION.learned_interval_s)
        covariance[:, 3:6] = covariance[3:6].T
        return replace(last, mean=mean, covariance=covariance)

    def fit_p_value(self, fixes: Sequence[NavEstimate]) -> float:
        """Return the chance that fixes are so far off, by the last velocity or by all: of a drag that has just begun,
        or that lasts. Of fixes of other instants it is 1."""
        if not fixes or (expected := self.at(fixes[-1].gpst)) is None:
            return 1.0
        return min(1.0, 2.0 * min(fit_p_value(expected, fix) for fix in (fixes[-1], self.average(fixes, expected))))


@dataclass(frozen=True, eq=False)
class ComparedFix:
    """What a window's set shows, those of its fixes that have velocities, and what navigators predict of them.

    courses : the youngest first. p_value : of so large a distance from any of them.
    """

    sky: ConsistentSet
    fix: SkyFix
    moving: tuple[NavEstimate, ...]
    courses: tuple[PredictedCourse, ...]
    p_values: tuple[float, ...]

    @property
    def p_value(self) -> float:
        return min(1.0, len(self.p_values) * min(self.p_values))

    @property
    def last(self) -> NavEstimate:
        return self.moving[-1]

    def predict_last(self, number: int) -> NavEstimate:
        """Return what a navigator predicts of the last fix."""
        return self.courses[number].each[-1]


def run_through(fixes: Sequence[NavEstimate], navigator: Inertial, learned: int) -> PredictedCourse:
    """Run a navigator through the instants of fixes. learned : how many windows had corrected it."""
    each = list[NavEstimate]()
    for fix in fixes:
        navigator = navigator.until(fix.gpst)
        if (expected := navigator.at(fix.gpst)) is not None:
            each.append(mark_unknown(expected, _CLOCK))
    return PredictedCourse(learned, navigator, tuple(each))
