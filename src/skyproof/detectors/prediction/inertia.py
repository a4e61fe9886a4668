"""Test whether a fix departs from the inertial prediction.

Fixes of every window that follows its prediction and in which no other test fails correct the navigator, and the last
fix of the next, position and velocity, is held against it: the squared distance over both covariances is chi-square if
the signals are true and the unit errs no more than is stated of it (`navigation.inertial_predictor`). So is that fix
with the velocity of the whole window: where a drag lasts, it shows above the noise of one. From the first window on
that departs, or in which any receiver is attacked, the unit runs free. Clocks are not compared here, and correct the
navigator for the first `clean_start_s` only: inertia does not see one that is pushed.

A drag that is slower than what one window notices draws the navigator along. So some navigators run free beside it,
from before the last windows on: each fix is held against all of them, and as old ones notice slow drags better, up to
an age at which their drift outweighs it, those are kept that notice slower ones than all younger do; and that from
before a window that is refused without failing, as long as one of so many windows is not refused so by chance. Once the
signals part, the unit goes back to the youngest navigator that all older ones predict, one window earlier at least and
before any such window, and that dates the parting. The younger ones still notice best, and fixes are held against them,
too; without some satellites only against those that no such window corrected, which the same satellites may have put
off. The slowest drag that any of them notices stands in each finding: what is slower may have led the navigator away
all the time (`CorrectedNavigator`).

What leaves it may be false signals, reflections or the unit. It is an attack only where the rest shows it too without
any two of the satellites, for reflections are some satellites', and the unit is not to blame. Whatever a unit errs by
stands in position and velocity alike: positions part by what velocities part by, added up over time. Codes that are
dragged alone break that, for velocities stay. Else the unit is not to blame only where

- it has gone on with the signals before, through changes of velocity at least half as large as those that it
  shows while they part: a log with wrong axes, units, times or gains errs where it is moved;
- the velocities part within two seconds and stay so for four: what a unit errs by adds up for as long as it errs;
- no single reading is to blame.

Else it stays undecided, with the reason.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.prediction.noticed import compute_least_move_m
from skyproof.detectors.prediction.policy import POLICY
from skyproof.errors import require_probability
from skyproof.fusion.candidates import FixMaker, SkyCandidates, find_reference_kind, select_candidates
from skyproof.fusion.corrected import CorrectedNavigator
from skyproof.fusion.policy import POLICY as FUSION
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.nav_estimate import NavEstimate, mark_unknown
from skyproof.navigation.prediction import fit_p_value
from skyproof.navigation.predictor import SkyFix
from skyproof.records import (
    UNTESTED,
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    Kind,
    Need,
    NoticedAttack,
    Records,
    list_refs,
)
from skyproof.statistics.distributions import f_survival
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["Inertia", "InertiaSettings", "list_navigators"]

_CLOCK: Final = np.array([6, 7])
_UNTRIED: Final = NotTested("not_aligned")


@dataclass(frozen=True)
class InertiaSettings:
    """Settings of `Inertia`.

    false_alarm_probability : of each receiver and window. clean_start_s : for so long clocks correct the navigator.
    multipath_sigma_m : of one pseudorange, one sigma. elevation_mask_deg : satellites below are left out of fixes.
    """

    false_alarm_probability: float = 1e-3
    clean_start_s: float = 30.0
    multipath_sigma_m: float = 1.0
    elevation_mask_deg: float = 5.0

    def __post_init__(self) -> None:
        require_probability("inertia", "false_alarm_probability", self.false_alarm_probability)


class Inertia:
    """The detector: see the module's text. It remembers the navigator of each receiver, and those that run free."""

    name = "inertia"
    needs = (Need.INERTIAL, Need.SETS, Need.FINDINGS)

    def __init__(self, settings: InertiaSettings | None = None) -> None:
        self.settings = settings or InertiaSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return a finding for each receiver in a window that its navigator predicts."""
        report = Reporter(self, records, Hypothesis.PREDICTED)
        lacking = report.name_missing()
        walks: dict[str, _Walk] = dict(state or {})
        # Whoever attacks one receiver is within reach of the others.
        attacked = min((_date(e) for e in records.findings if e.says in ("attack", "spoofed")), default=None)
        found = list(lacking)  # an attack counts in a window without sets, too
        for o in records.observations:
            if o.receiver not in records.inertial:
                continue
            maker = FixMaker.build_for_window(o, records, self.settings)
            if o.receiver in walks:
                walk = replace(walks[o.receiver], maker=maker, report=report)
            else:
                until = o.gpst[0] + timedelta_from_s(self.settings.clean_start_s)
                walk = _Walk(predictor=records.inertial[o.receiver], clock_until=until, maker=maker, report=report)
            walks[o.receiver] = walk
            about = [e for e in records.findings if any(ref.receiver == o.receiver for ref in e.signals)]
            failed = min((_date(e) for e in about if e.failed), default=None)
            finding = walk.examine(select_candidates(records, o.receiver), attacked, failed)
            if finding is not None:
                found.append(finding)
            elif not lacking:
                found.append(report.pass_over(list_refs(o.receiver, o.signals), _UNTRIED))
        return found, walks


def list_navigators(state: Any) -> dict[str, CorrectedNavigator]:
    """Return the navigator of each receiver. state : of `Inertia` after some windows."""
    walks: dict[str, _Walk] = state or {}
    return {receiver: walk.navigator for receiver, walk in walks.items()}


def _date(e: Finding) -> np.datetime64:
    """Return from when on a finding doubts the signals."""
    return e.start_gpst if e.dated_gpst is None else min(e.start_gpst, e.dated_gpst)


@dataclass(frozen=True, eq=False)
class _Free:
    """A navigator that no window has corrected since. carried : to the last window. learned : how many windows had
    corrected it, up to `until`. notices_m_s : the slowest drag that it would have noticed in the last window.
    hidden_m : see `CorrectedNavigator`."""

    predictor: Inertial
    carried: Inertial
    learned: int
    until: np.datetime64 | None
    notices_m_s: float
    hidden_m: float


@dataclass(frozen=True, eq=False)
class _Look:
    """At one instant: velocity by the unit (3,), and what position and velocity by the signals are more (6,).

    covariance : (6, 6) of those of the signals.
    """

    gpst: np.datetime64
    speed_m_s: Reals
    apart: Reals
    covariance: Reals


@dataclass(frozen=True, eq=False)
class _Course:
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

    def compare(self, fixes: Sequence[NavEstimate]) -> list[_Look]:
        """Compare both velocities."""
        found = list[_Look]()
        for fix in fixes:
            near = found and float(seconds_between(fix.gpst, found[-1].gpst)) < POLICY.look_interval_s
            if near or fix.there.size < 6 or (expected := self.at(fix.gpst)) is None:
                continue
            apart = fix.mean[:6] - expected.mean[:6]
            found.append(_Look(fix.gpst, expected.mean[3:6], apart, fix.covariance[:6, :6]))
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
class _Shown:
    """What a window's set shows, those of its fixes that have velocities, and what navigators predict of them.

    courses : the youngest first. p_value : of so large a distance from any of them.
    """

    sky: ConsistentSet
    fix: SkyFix
    moving: tuple[NavEstimate, ...]
    courses: tuple[_Course, ...]
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


@dataclass(frozen=True, eq=False, kw_only=True)
class _Learned:
    """A window that corrected the navigator. number : of such windows before. bias_s, hidden_m : before it."""

    number: int
    start: np.datetime64
    end: np.datetime64
    fix: SkyFix
    bias_s: float
    hidden_m: float


@dataclass(frozen=True)
class _Refused:
    """The first window that hardly follows, and the least p-value since. number : of windows that taught before it."""

    number: int
    p_value: float

    def is_chance(self, learned: int) -> bool:
        """Tell whether one of so many windows may be refused so by chance. learned : how many have taught by now."""
        return (learned - self.number) * self.p_value >= FUSION.refused_probability


@dataclass(eq=False, kw_only=True)
class _Walk:
    """Of one receiver, window by window. Its lists are replaced, never changed.

    clock_until : when clocks cease to correct the navigator. kind : of the signals that corrected it first. early :
    starts of those windows that did until then. until : the end of the last. learned : how many did.
    attacked : since when any receiver is. free : navigators from before windows that corrected the youngest, the
    youngest first. recent : those windows. refused : one of them that was,
    while that is no chance. parted : when inertia and signals did. looks : since then.
    """

    predictor: Inertial
    clock_until: np.datetime64
    maker: FixMaker
    report: Reporter
    kind: Kind | None = None
    early: tuple[np.datetime64, ...] = ()
    until: np.datetime64 | None = None
    learned: int = 0
    bias_s: float = 0.0
    hidden_m: float = 0.0
    hidden_m_s: float = 0.0
    went_on: int = 0
    tried_m_s: float = 0.0
    attacked: np.datetime64 | None = None
    free: list[_Free] = field(default_factory=list)
    recent: list[_Learned] = field(default_factory=list)
    refused: _Refused | None = None
    parted: np.datetime64 | None = None
    looks: list[_Look] = field(default_factory=list)
    named: bool = False

    @property
    def alpha(self) -> float:
        return float(self.report.detector.settings.false_alarm_probability)

    def examine(
        self, window: SkyCandidates, attacked: np.datetime64 | None, failed: np.datetime64 | None
    ) -> Finding | None:
        """Return what a window shows. attacked, failed : since when findings of it say that any receiver is attacked,
        and that a test of this one fails."""
        if attacked is not None:
            self.attacked = attacked if self.attacked is None else min(self.attacked, attacked)
        doubted = min((at for at in (attacked, failed) if at is not None), default=None)
        if doubted is not None and self.parted is None:
            self._take_back(doubted)
        is_clean = not window.doubted and doubted is None and self.attacked is None and self.parted is None
        comparisons = [comparison for s in window.sets if (comparison := self._compare_fix(window, s)) is not None]
        if not comparisons:
            if len(window.sets) == 1 and is_clean:  # before the unit is aligned nothing is held against it
                (sky,) = window.sets
                self._learn(window, self._fix(window, sky), sky, [])
            return None
        best = max(comparisons, key=lambda comparison: comparison.p_value)
        if best.p_value < self.alpha:
            self._start_free_run(window, best)
            self.looks = [*self.looks, *self._compare_velocities(best.fix)]
            found = self._report(window, best)
            self.named |= found.says == "attack"
            return found
        going_on = self._report_pass(best) if self.parted is None else None
        if self.attacked is not None:
            self._start_free_run(window, best)
        elif is_clean:
            self._add_hidden(window, best)
            self._follow(window, best)
        return going_on

    def _follow(self, window: SkyCandidates, shown: _Shown) -> None:
        """Correct the navigator, and keep the one from before a window that was refused while that is no chance.

        Of so many windows as since then one is refused by chance as likely as the least p-value so many times.
        """
        if shown.p_value < (1.0 if self.refused is None else self.refused.p_value):
            self.refused = _Refused(self.learned if self.refused is None else self.refused.number, shown.p_value)
        if self.refused is not None and self.refused.is_chance(self.learned + 1):
            self.refused = None
        every = self._list_free(shown)
        kept = _keep_useful(every, shown.last.gpst)
        if self.refused is not None:
            kept += [free for free in every if free.learned == self.refused.number and free not in kept]
        self._learn(window, shown.fix, shown.sky, sorted(kept, key=lambda free: -free.learned))
        self.went_on += 1

    @property
    def navigator(self) -> CorrectedNavigator:
        return CorrectedNavigator(
            predictor=self.predictor,
            kind=self.kind,
            early=self.early,
            until=self.until,
            bias_s=self.bias_s,
            hidden_m=self.hidden_m,
            hidden_m_s=self.hidden_m_s,
        )

    def _take_back(self, since: np.datetime64) -> None:
        """Undo what windows taught that end later, as far as a navigator from before them runs on."""
        doubted = [window for window in self.recent if window.end > since]
        if not doubted or not self.free:
            return
        back_to = doubted[0]
        older = [window for window in self.free if window.learned <= back_to.number] or self.free[-1:]
        base, kept = older[0], [window for window in self.recent if window.number < back_to.number]
        self.predictor, self.learned, self.until, self.hidden_m = (
            base.predictor,
            base.learned,
            base.until,
            base.hidden_m,
        )
        for window in kept:
            if window.number >= base.learned:
                self.predictor, self.learned, self.until = (
                    self.predictor.learned(window.fix),
                    window.number + 1,
                    window.end,
                )
                self.hidden_m = back_to.hidden_m
        self.bias_s, self.early = back_to.bias_s, self.early[: self.learned]
        self.free = [window for window in older if window.learned < self.learned]
        self.recent = [window for window in kept if self.free and window.number >= self.free[-1].learned]

    def _add_hidden(self, window: SkyCandidates, shown: _Shown) -> None:
        """Add what a drag that this window does not notice may lead the navigator away by."""
        if window.end > self.clock_until:
            _, self.hidden_m_s = self._find_least(shown)
            self.hidden_m += self.hidden_m_s * float(seconds_between(window.end, window.start))

    def _list_free(self, shown: _Shown) -> list[_Free]:
        """Return all navigators as they are without a window's fixes, and the drags that they notice."""
        before = [
            (self.predictor, self.learned, self.until, self.hidden_m),
            *((navigator.predictor, navigator.learned, navigator.until, navigator.hidden_m) for navigator in self.free),
        ]
        return [
            _Free(predictor, course.carried, learned, until, self._find_noticed(shown, number)[1], hidden)
            for number, ((predictor, learned, until, hidden), course) in enumerate(
                zip(before, shown.courses, strict=True)
            )
        ]

    def _learn(self, window: SkyCandidates, fix: SkyFix, sky: ConsistentSet, free: list[_Free]) -> None:
        """Correct the navigator. free : those that run on without."""
        self.tried_m_s = max(self.tried_m_s, _find_change_m_s(self._compare_velocities(fix)))
        if window.end > self.clock_until:
            fix = SkyFix(
                whole=mark_unknown(fix.whole, _CLOCK), each=tuple(mark_unknown(taught, _CLOCK) for taught in fix.each)
            )
        lesson = _Learned(
            number=self.learned,
            start=window.start,
            end=window.end,
            fix=fix,
            bias_s=self.bias_s,
            hidden_m=self.hidden_m,
        )
        self.free = free
        self.recent = [taught for taught in (*self.recent, lesson) if free and taught.number >= free[-1].learned]
        self.predictor, self.bias_s = self.predictor.learned(fix), sky.clock_bias_s
        self.kind = self.kind or find_reference_kind(sky)
        if window.end <= self.clock_until:
            self.early = (*self.early, window.start)
        self.learned, self.until = self.learned + 1, window.end

    def _fix(self, window: SkyCandidates, sky: ConsistentSet) -> SkyFix:
        return self.maker.shown(window, sky, kind=find_reference_kind(sky), bias_s=self.bias_s, epochs=True)

    def _compare_fix(self, window: SkyCandidates, sky: ConsistentSet) -> _Shown | None:
        if self.predictor.state is None:
            return None
        fix = self._fix(window, sky)
        moving = tuple(estimate for estimate in fix.each if estimate.there.size >= 6)
        if not moving:
            return None
        navigators = ((self.learned, self.predictor), *((free.learned, free.carried) for free in self.free))
        every = (_run_through(moving, navigator, learned) for learned, navigator in navigators)
        courses = tuple(course for course in every if course.at(moving[-1].gpst) is not None)
        if len(courses) < len(navigators):
            self.free = []  # readings end, or are missing
            courses = courses[:1]
        if not courses:
            return None
        return _Shown(sky, fix, moving, courses, tuple(course.fit_p_value(moving) for course in courses))

    def _start_free_run(self, window: SkyCandidates, shown: _Shown) -> None:
        """Let the unit run free from now on: from the latest window until which the signals may have been true.

        That is where the youngest navigator was corrected last that all older ones predict: a drag that began before
        would have drawn it away from those that it has not touched.
        """
        if self.parted is not None:
            return
        learned = (self.learned, *(navigator.learned for navigator in self.free))
        expected = [shown.predict_last(number) for number in range(len(shown.courses))]
        for young, mean in enumerate(expected):
            older = expected[young + 1 :]
            certain = NavEstimate(
                gpst=mean.gpst, mean=mean.mean, covariance=np.where(np.isfinite(mean.covariance), 0.0, np.inf)
            )
            untouched = self.refused is None or learned[young] <= self.refused.number
            if untouched and all(fit_p_value(navigator, certain) >= FUSION.refused_probability for navigator in older):
                break
        self.parted = next((taught.start for taught in self.recent if taught.number >= learned[young]), window.start)
        # The window before may hold the beginning of what is noticed now.
        back = max(young, min(len(self.free), 1))
        younger = self._list_free(shown)[:back]
        if back > 0:
            free = self.free[back - 1]
            self.predictor, self.learned, self.hidden_m = free.predictor, free.learned, free.hidden_m
            self.early, self.until = self.early[: free.learned], free.until
        fixes = (taught.fix for taught in self.recent if taught.number >= self.learned)
        self.looks = [*self.looks, *(look for fix in fixes for look in self._compare_velocities(fix))]
        self.free, self.recent = younger, []  # the younger notice best

    def _compare_velocities(self, fix: SkyFix) -> list[_Look]:
        """Compare both velocities through a window."""
        return (
            []
            if self.predictor.state is None
            else _run_through(fix.each, self.predictor, self.learned).compare(fix.each)
        )

    def _report(self, window: SkyCandidates, shown: _Shown) -> Finding:
        """Return the window's finding: an attack where no benign cause remains."""
        off = shown.last.mean - shown.predict_last(int(np.argmin(shown.p_values))).mean
        why, benign = self._find_benign(window, shown)
        off_m = float(np.linalg.norm(off[:3]))
        data: dict[str, Datum] = {"statistic": off_m, "off_m_s": float(np.linalg.norm(off[3:6]))}
        if why is None:
            data["assumes"] = self.predictor.assumes
        return self.report.find(
            list_refs(self.maker.log.receiver, shown.sky.signals),
            why or "departs",
            {Cause.CLEAN: shown.p_value} | benign,
            data=data,
            dated_gpst=self.parted,
        )

    def _report_pass(self, shown: _Shown) -> Finding:
        """Return that a window follows the prediction, and what drag would have been noticed in it."""
        off = shown.last.mean - shown.predict_last(0).mean
        jump_m, drag_m_s = self._find_least(shown)
        return self.report.find(
            list_refs(self.maker.log.receiver, shown.sky.signals),
            "goes_on",
            {Cause.CLEAN: shown.p_value},
            estimates={"noticed": (NoticedAttack("position_jump", jump_m), NoticedAttack("drag", drag_m_s))},
            data={"statistic": float(np.linalg.norm(off[:3])), "off_m_s": float(np.linalg.norm(off[3:6]))},
        )

    def _find_least(self, shown: _Shown) -> tuple[float, float]:
        """Return the smallest jump, m, and the slowest drag, m/s, that any of the navigators would have noticed."""
        found = [self._find_noticed(shown, number) for number in range(len(shown.courses))]
        jump_m, drag_m_s = np.min(found, axis=0)
        return float(jump_m), float(drag_m_s)

    def _find_noticed(self, shown: _Shown, number: int) -> tuple[float, float]:
        """Return the smallest level jump and the slowest level drag that one of the navigators would have noticed.

        A drag that began when the navigator was corrected last has moved the position by its speed times the time
        since. Where carriers stay least of it shows: they leave the velocity unchanged.
        """
        free = self.predictor if number == 0 else self.free[number - 1].predictor
        assert free.state is not None
        expected = shown.predict_last(number)
        rows = np.intersect1d(expected.there, shown.last.there)[:6]
        block = np.ix_(rows, rows)
        jump_m = compute_least_move_m(
            expected.covariance[block] + shown.courses[number].average(shown.moving, expected).covariance[block],
            shown.last.mean[:3],
            dof=rows.size,
            false_alarm_probability=self.alpha / (2 * len(shown.courses)),
        )
        return jump_m, jump_m / float(seconds_between(shown.last.gpst, free.state.gpst))

    def _find_benign(self, window: SkyCandidates, shown: _Shown) -> tuple[str | None, dict[Cause, float]]:
        """Return the code of why a benign cause may have done it, None if none may; and p-values of benign causes."""
        if self.named:
            return None, {}
        by_unit = _find_unit_p_value(self.looks)
        if by_unit >= self.alpha and (why := self._find_unit_error(window)) is not None:
            return why, dict.fromkeys((Cause.STATEMENT, Cause.FAULT, Cause.REFLECTIONS), UNTESTED)
        without_two = self._drop_two_satellites(window, shown)
        benign = {Cause.REFLECTIONS: without_two}
        if by_unit < self.alpha:
            benign |= {Cause.STATEMENT: by_unit, Cause.FAULT: by_unit}
        return "by_some" if without_two >= self.alpha else None, benign

    def _find_unit_error(self, window: SkyCandidates) -> str | None:
        """Return the code of why the unit may be to blame, None if it is not."""
        if self.went_on < POLICY.tried_windows:
            return "not_tried"
        if _find_change_m_s(self.looks) > max(POLICY.tried_ratio * self.tried_m_s, POLICY.quiet_m_s):
            return "moved_more"
        if not _is_sudden(self.looks):
            return "parts_slowly"
        return "blow" if self._find_blow_m_s(window) > POLICY.blow_m_s else None

    def _drop_two_satellites(self, window: SkyCandidates, shown: _Shown) -> float:
        """Return the largest p-value without any two satellites; 1 where too few are left.

        By the navigator that notices best of those that no refused window has corrected: reflections of the two in such
        a one would have put it off what the others show.
        """
        number = len(shown.courses)
        pure = [
            (p_value, course)
            for p_value, course in zip(shown.p_values, shown.courses, strict=True)
            if self.refused is None or course.learned <= self.refused.number
        ]
        if not pure:
            return UNTESTED
        course = min(pure, key=lambda held: held[0])[1]

        def p_values(pairs: Iterable[tuple[str, ...]]) -> Iterator[float]:
            for pair in pairs:
                each = self.maker.compute_fixes(window, shown.sky, pair)
                yield min(1.0, number * course.fit_p_value([fix for fix in each if fix.there.size >= 6]))

        sats = sorted({signal.sat for signal in shown.sky.signals})
        return largest_p_value_without(sats, p_values, least=POLICY.least_satellites, enough=self.alpha)

    def _find_blow_m_s(self, window: SkyCandidates) -> float:
        """Return the largest change of velocity, since the last fix, that one reading makes beside its neighbours."""
        readings, state = self.predictor.readings, self.predictor.state
        start = window.start if state is None else state.gpst
        rows = slice(*np.searchsorted(readings.gpst, np.array([start, window.end])))
        force = readings.select(rows).specific_force_m_s2
        if len(force) < 3:
            return np.inf
        alone = force[1:-1] - 0.5 * (force[2:] + force[:-2])
        return float(np.linalg.norm(alone, axis=1).max() * readings.interval_s)


def _run_through(fixes: Sequence[NavEstimate], navigator: Inertial, learned: int) -> _Course:
    """Run a navigator through the instants of fixes. learned : how many windows had corrected it."""
    each = list[NavEstimate]()
    for fix in fixes:
        navigator = navigator.until(fix.gpst)
        if (expected := navigator.at(fix.gpst)) is not None:
            each.append(mark_unknown(expected, _CLOCK))
    return _Course(learned, navigator, tuple(each))


def _keep_useful(free: Sequence[_Free], gpst: np.datetime64) -> list[_Free]:
    """Return the navigators that each notice slower drags than the younger ones, two of any age to twice that."""
    kept = list[_Free]()
    for navigator in free:
        if not kept or navigator.notices_m_s < kept[-1].notices_m_s:
            kept.append(navigator)
    return _thin_navigators(kept, gpst)


def _thin_navigators(free: Sequence[_Free], gpst: np.datetime64) -> list[_Free]:
    """Return two navigators at most of any age to twice that age."""
    kept = list(free)
    for number in range(len(kept) - 2, 0, -1):
        younger, older = (kept[k].predictor.state for k in (number - 1, number + 1))
        assert younger is not None
        assert older is not None
        if seconds_between(gpst, older.gpst) < 2.0 * seconds_between(gpst, younger.gpst):
            del kept[number]
    return kept


def _find_change_m_s(looks: Sequence[_Look]) -> float:
    """Return by how much the unit shows the velocity to change at most."""
    return float(np.linalg.norm(np.ptp([look.speed_m_s for look in looks], axis=0))) if looks else 0.0


def _find_unit_p_value(looks: Sequence[_Look]) -> float:
    """Return the largest p-value of how positions part, whatever the unit errs by: as velocities add up to.

    Errors of the signals' velocities are taken to last, as reflections may. Between looks the unit's velocity may
    wander off and back unseen: as a random walk with the steps that it shows from look to look, whose bridges have
    dt^3 / 12 of its rate in position. That rate is estimated, so the law is F with the degrees of freedom of Welch
    (Biometrika 34, 1947).
    """
    if len(looks) < POLICY.least_looks:
        return UNTESTED
    first, last = looks[0], looks[-1]
    t = np.asarray(seconds_between(np.array([look.gpst for look in looks]), first.gpst), np.float64)
    apart_m_s, each_s = np.array([look.apart[3:] for look in looks]), np.diff(t)
    off_m = last.apart[:3] - first.apart[:3] - np.trapezoid(apart_m_s, t, axis=0)
    spread = first.covariance[:3, :3] + last.covariance[:3, :3] + t[-1] ** 2 * last.covariance[3:, 3:]
    wander_m2_s3 = float(np.mean(np.diff(apart_m_s, axis=0) ** 2 / each_s[:, None]))
    unseen_m2 = wander_m2_s3 * float(np.sum(each_s**3)) / 12.0
    total = spread + unseen_m2 * np.eye(3)
    dof = off_m.size * each_s.size * (np.trace(total) / max(3.0 * unseen_m2, np.finfo(float).tiny)) ** 2
    return float(f_survival(off_m @ np.linalg.solve(total, off_m) / off_m.size, off_m.size, dof))


def _is_sudden(looks: Sequence[_Look]) -> bool:
    """Tell whether velocities part within moments and stay so."""
    if len(looks) < POLICY.least_looks:
        return False
    t = np.asarray(seconds_between(np.array([look.gpst for look in looks]), looks[0].gpst), np.float64)
    apart = np.array([look.apart[3:] for look in looks])
    late = apart[t >= t[-1] - POLICY.parts_within_s].mean(axis=0)
    size = float(np.linalg.norm(late))
    if not size:
        return False
    along = apart @ (late / size)
    begun = np.searchsorted(t, t + POLICY.parts_within_s)
    early = np.flatnonzero((begun < t.size) & (t + POLICY.parts_within_s <= t[-1] - POLICY.stays_parted_s))
    return bool(np.any(along[begun[early]] - along[early] >= POLICY.parted_share * size))
