"""Follow one receiver's navigators window by window, and find where its signals leave them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from skyproof.detectors.base import Reporter
from skyproof.detectors.prediction.course import ComparedFix, run_through
from skyproof.detectors.prediction.free_navigators import FreeNavigator, RefusedWindow, TaughtWindow, keep_useful
from skyproof.detectors.prediction.noticed import compute_least_move_m
from skyproof.detectors.prediction.policy import POLICY
from skyproof.detectors.prediction.unit_errors import (
    Departure,
    find_blow_m_s,
    find_change_m_s,
    find_unit_p_value,
    is_sudden,
)
from skyproof.fusion.candidates import FixMaker, SkyCandidates, find_reference_kind
from skyproof.fusion.corrected import CorrectedNavigator
from skyproof.fusion.policy import POLICY as FUSION
from skyproof.gnss.time import seconds_between
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.nav_estimate import NavEstimate, mark_unknown
from skyproof.navigation.prediction import fit_p_value
from skyproof.navigation.predictor import SkyFix
from skyproof.records import UNTESTED, Cause, ConsistentSet, Datum, Finding, Kind, NoticedAttack, list_refs
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["Walk"]

_CLOCK: Final = np.array([6, 7])


@dataclass(eq=False, kw_only=True)
class Walk:
    """One receiver, window by window. Its lists are replaced, never changed.

    clock_until : when clocks cease to correct the navigator. kind : of the signals that corrected it first.
    early : starts of those windows that did until then; clean : the navigator after them. until : the end of the last.
    learned : how many did. attacked : since when any receiver is. free : navigators from before windows that corrected
    the youngest, the youngest first. recent : those windows. refused : the first of them that was, while that is no
    chance. parted : when inertia and signals did. looks : since then.
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
    clean: Inertial | None = None
    went_on: int = 0
    tried_m_s: float = 0.0
    attacked: np.datetime64 | None = None
    free: list[FreeNavigator] = field(default_factory=list)
    recent: list[TaughtWindow] = field(default_factory=list)
    refused: RefusedWindow | None = None
    parted: np.datetime64 | None = None
    looks: list[Departure] = field(default_factory=list)
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

    def _follow(self, window: SkyCandidates, shown: ComparedFix) -> None:
        """Correct the navigator, and keep the one from before a window that was refused while that is no chance.

        Of so many windows as since then one is refused by chance as likely as the least p-value so many times.
        """
        if shown.p_value < (1.0 if self.refused is None else self.refused.p_value):
            self.refused = RefusedWindow(self.learned if self.refused is None else self.refused.number, shown.p_value)
        if self.refused is not None and self.refused.is_chance(self.learned + 1):
            self.refused = None
        every = self._list_free(shown)
        kept = keep_useful(every, shown.last.gpst)
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
            clean=self.clean,
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

    def _add_hidden(self, window: SkyCandidates, shown: ComparedFix) -> None:
        """Add what a drag that this window does not notice may lead the navigator away by.

        One that has just begun may be as fast as the youngest navigator, which it has led away least, does not notice,
        and has moved the position by no more than a jump that no test notices.
        """
        if window.end > self.clock_until:
            jump_m, drag_m_s = self._find_least(shown)
            begun_m = 0.0 if self.hidden_m else jump_m
            self.clean = self.clean or self.predictor
            self.hidden_m += begun_m + drag_m_s * float(seconds_between(window.end, window.start))
            self.hidden_m_s = self._compute_least(shown, 0, (3, 4, 5, 0, 1, 2))

    def _list_free(self, shown: ComparedFix) -> list[FreeNavigator]:
        """Return all navigators as they are without a window's fixes, and the drags that they notice."""
        before = [
            (self.predictor, self.learned, self.until, self.hidden_m),
            *((navigator.predictor, navigator.learned, navigator.until, navigator.hidden_m) for navigator in self.free),
        ]
        return [
            FreeNavigator(predictor, course.carried, learned, until, self._find_noticed(shown, number)[1], hidden)
            for number, ((predictor, learned, until, hidden), course) in enumerate(
                zip(before, shown.courses, strict=True)
            )
        ]

    def _learn(self, window: SkyCandidates, fix: SkyFix, sky: ConsistentSet, free: list[FreeNavigator]) -> None:
        """Correct the navigator. free : those that run on without."""
        self.tried_m_s = max(self.tried_m_s, find_change_m_s(self._compare_velocities(fix)))
        if window.end > self.clock_until:
            fix = SkyFix(
                whole=mark_unknown(fix.whole, _CLOCK), each=tuple(mark_unknown(taught, _CLOCK) for taught in fix.each)
            )
        lesson = TaughtWindow(
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

    def _compare_fix(self, window: SkyCandidates, sky: ConsistentSet) -> ComparedFix | None:
        if self.predictor.state is None:
            return None
        fix = self._fix(window, sky)
        moving = tuple(estimate for estimate in fix.each if estimate.there.size >= 6)
        if not moving:
            return None
        navigators = ((self.learned, self.predictor), *((free.learned, free.carried) for free in self.free))
        every = (run_through(moving, navigator, learned) for learned, navigator in navigators)
        courses = tuple(course for course in every if course.at(moving[-1].gpst) is not None)
        if len(courses) < len(navigators):
            self.free = []  # readings end, or are missing
            courses = courses[:1]
        if not courses:
            return None
        return ComparedFix(sky, fix, moving, courses, tuple(course.fit_p_value(moving) for course in courses))

    def _start_free_run(self, window: SkyCandidates, shown: ComparedFix) -> None:
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

    def _compare_velocities(self, fix: SkyFix) -> list[Departure]:
        """Compare both velocities through a window."""
        return (
            []
            if self.predictor.state is None
            else run_through(fix.each, self.predictor, self.learned).compare(fix.each)
        )

    def _report(self, window: SkyCandidates, shown: ComparedFix) -> Finding:
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

    def _report_pass(self, shown: ComparedFix) -> Finding:
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

    def _find_least(self, shown: ComparedFix) -> tuple[float, float]:
        """Return the smallest jump, m, and the slowest drag, m/s, that any of the navigators would have noticed."""
        found = [self._find_noticed(shown, number) for number in range(len(shown.courses))]
        jump_m, drag_m_s = np.min(found, axis=0)
        return float(jump_m), float(drag_m_s)

    def _find_noticed(self, shown: ComparedFix, number: int) -> tuple[float, float]:
        """Return the smallest level jump and the slowest level drag that one of the navigators would have noticed.

        A drag that began when the navigator was corrected last has moved the position by its speed times the time
        since. Where carriers stay least of it shows: they leave the velocity unchanged.
        """
        free = self.predictor if number == 0 else self.free[number - 1].predictor
        assert free.state is not None
        jump_m = self._compute_least(shown, number, range(6))
        return jump_m, jump_m / float(seconds_between(shown.last.gpst, free.state.gpst))

    def _compute_least(self, shown: ComparedFix, number: int, order: Sequence[int]) -> float:
        """Return the smallest level change that one of the navigators would have noticed, of the first three rows."""
        expected = shown.predict_last(number)
        rows = [row for row in order if row in expected.there and row in shown.last.there]
        block = np.ix_(rows, rows)
        return compute_least_move_m(
            expected.covariance[block] + shown.courses[number].average(shown.moving, expected).covariance[block],
            shown.last.mean[:3],
            dof=len(rows),
            false_alarm_probability=self.alpha / (2 * len(shown.courses)),
        )

    def _find_benign(self, window: SkyCandidates, shown: ComparedFix) -> tuple[str | None, dict[Cause, float]]:
        """Return the code of why a benign cause may have done it, None if none may; and p-values of benign causes."""
        if self.named:
            return None, {}
        by_unit = find_unit_p_value(self.looks)
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
        if find_change_m_s(self.looks) > max(POLICY.tried_ratio * self.tried_m_s, POLICY.quiet_m_s):
            return "moved_more"
        if not is_sudden(self.looks):
            return "parts_slowly"
        start = window.start if self.predictor.state is None else self.predictor.state.gpst
        blow_m_s = find_blow_m_s(self.predictor.readings, start, window.end)
        return "blow" if blow_m_s > POLICY.blow_m_s else None

    def _drop_two_satellites(self, window: SkyCandidates, shown: ComparedFix) -> float:
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
