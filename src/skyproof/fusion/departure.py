"""Does what a receiver shows leave what its inertial unit lets expect?

The navigator is corrected by the fixes of every window that goes on as it expects and in which no other test fails, and
at the end of each the next fix, position and velocity, is held against it: the squared distance over both covariances
is chi-square if the signals are true and the unit errs no more than is stated of it (`navigation.inertial_foresight`).
From the first window on that does not go on, or in which any receiver is attacked, the unit runs free. Clocks are not
compared here, and correct the navigator for the first `clean_start_s` only: inertia does not see one that is pushed.

What leaves it may be false signals, reflections or the unit. It is an attack only where the rest shows it too without
any two of the satellites, for reflections are some satellites', and the unit is not to blame. Whatever a unit errs by
stands in position and velocity alike: positions part by what velocities part by, added up over time. Codes that are
drawn off alone break that, for velocities go on. Else the unit is not to blame only where

- it has gone on with the signals before, through changes of velocity at least half as large as those that it
  shows while they part: a log with wrong axes, units, times or gains errs where it is moved;
- the velocities part within two seconds and stay so for four: what a unit errs by adds up for as long as it errs;
- no single reading is to blame.

Else it stays undecided, with the reason.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.fusion.policy import POLICY
from skyproof.fusion.rivals import FixMaker, Rivals, reference_kind, rivals_of
from skyproof.gnss.time import seconds_between, timedelta_from_s
from skyproof.navigation.foresight import Foresight, SkyFix
from skyproof.navigation.inertial_foresight import Inertial
from skyproof.navigation.known import Known, without
from skyproof.navigation.prediction import fit_p_value
from skyproof.records import UNTESTED, Cause, ConsistentSet, Datum, Finding, Hypothesis, list_refs
from skyproof.statistics.distributions import chi_square_survival
from skyproof.statistics.leave_out import largest_p_value_without

__all__ = ["DETECTOR", "CorrectedNavigator", "departures"]

DETECTOR: Final = "inertia"
_CLOCK: Final = np.array([6, 7])


@dataclass(frozen=True, eq=False, kw_only=True)
class CorrectedNavigator:
    """A receiver's navigator, and the windows whose fixes corrected it, in order.

    starts : of those windows. bias_s : the receiver's clock in the last of them.
    """

    foresight: Inertial
    starts: tuple[np.datetime64, ...]
    bias_s: float


def departures(
    evidence: Sequence[Finding],
    sets: Sequence[ConsistentSet],
    makers: Sequence[FixMaker],
    foresights: Mapping[str, Foresight],
    alpha: float,
    clean_start_s: float,
) -> tuple[list[Finding], dict[str, CorrectedNavigator]]:
    """Test the receivers whose antenna an inertial unit carries: a finding for each window that leaves it.

    alpha : probability of a false alarm in a window. clean_start_s : for so long clocks correct the navigator.

    Returns the findings, and by receiver its navigator.
    """
    found, navigators = list[Finding](), dict[str, CorrectedNavigator]()
    # Whoever attacks one receiver is within reach of the others.
    attacked = min((_date(e) for e in evidence if e.says in ("attack", "spoofed")), default=None)
    for maker in makers:
        receiver = maker.log.receiver
        foresight = foresights.get(receiver)
        if isinstance(foresight, Inertial):
            walk = _Walk(maker, foresight, alpha, clean_start_s, attacked, _failed_spans(evidence, receiver))
            found += walk.through(rivals_of(maker.log, evidence, sets))
            navigators[receiver] = walk.navigator
    return found, navigators


def _date(e: Finding) -> np.datetime64:
    """Return from when on a finding doubts the signals."""
    return e.start_gpst if e.dated_gpst is None else min(e.start_gpst, e.dated_gpst)


def _failed_spans(evidence: Sequence[Finding], receiver: str) -> list[tuple[np.datetime64, np.datetime64]]:
    """Return when tests of a receiver fail, by what dates them."""
    return [(_date(e), e.end_gpst) for e in evidence if e.failed and any(ref.receiver == receiver for ref in e.signals)]


@dataclass(frozen=True, eq=False)
class _Shown:
    """What a window's set shows, its last fix and what was expected then. p_value : of so large a distance."""

    sky: ConsistentSet
    fix: SkyFix
    last: Known
    expected: Known
    p_value: float


@dataclass(frozen=True, eq=False)
class _Look:
    """At one instant: velocity by the unit (3,), and what position and velocity by the signals are more (6,).

    covariance : (6, 6) of those of the signals.
    """

    gpst: np.datetime64
    speed_m_s: Reals
    apart: Reals
    covariance: Reals


class _Walk:
    """Of one receiver, window by window."""

    def __init__(
        self,
        maker: FixMaker,
        foresight: Inertial,
        alpha: float,
        clean_start_s: float,
        attacked: np.datetime64 | None,
        failed: Sequence[tuple[np.datetime64, np.datetime64]],
    ) -> None:
        """attacked : since when any receiver is. failed : when tests of this one fail."""
        self.maker, self.foresight, self.alpha = maker, foresight, alpha
        self.clock_until = maker.log.gpst[0] + timedelta_from_s(clean_start_s)
        self.attacked, self.failed = attacked, failed
        self.starts: list[np.datetime64] = []
        self.bias_s = 0.0
        self.went_on, self.tried_m_s = 0, 0.0
        self.looks: list[_Look] = []  # since they part
        self.named = False

    def through(self, windows: Iterable[Rivals]) -> list[Finding]:
        found: list[Finding] = []
        for window in windows:
            shown = [one for s in window.sets if (one := self._shown(window, s)) is not None]
            if not shown:
                self._begin(window)
                continue
            best = max(shown, key=lambda one: one.p_value)
            if best.p_value < self.alpha:
                self.looks += self._looked(best.fix)
                found.append(self._report(window, best))
                self.named |= found[-1].says == "attack"
            elif self._is_clean(window):
                self._learn(window, best.fix, best.sky)
                self.went_on += 1
        return found

    @property
    def navigator(self) -> CorrectedNavigator:
        return CorrectedNavigator(foresight=self.foresight, starts=tuple(self.starts), bias_s=self.bias_s)

    def _is_clean(self, window: Rivals) -> bool:
        """Tell whether nothing speaks against the window's only sky."""
        if self.looks or window.doubted or (self.attacked is not None and window.end > self.attacked):
            return False
        return not any(begin < window.end and window.start < end for begin, end in self.failed)

    def _begin(self, window: Rivals) -> None:
        """Before the unit is aligned there is nothing to hold a window against."""
        if len(window.sets) == 1 and self._is_clean(window):
            (sky,) = window.sets
            self._learn(window, self._fix(window, sky), sky)

    def _learn(self, window: Rivals, fix: SkyFix, sky: ConsistentSet) -> None:
        self.tried_m_s = max(self.tried_m_s, _change_m_s(self._looked(fix)))
        if window.end > self.clock_until:
            fix = SkyFix(whole=without(fix.whole, _CLOCK), each=tuple(without(one, _CLOCK) for one in fix.each))
        self.foresight, self.bias_s = self.foresight.learned(fix), sky.clock_bias_s
        self.starts.append(window.start)

    def _fix(self, window: Rivals, sky: ConsistentSet) -> SkyFix:
        return self.maker.shown(window, sky, kind=reference_kind(sky), bias_s=self.bias_s, epochs=True)

    def _shown(self, window: Rivals, sky: ConsistentSet) -> _Shown | None:
        if self.foresight.state is None:
            return None
        fix = self._fix(window, sky)
        moving = [one for one in fix.each if one.there.size >= 6]
        expected = self.foresight.at(moving[-1].gpst) if moving else None
        if expected is None:
            return None
        expected = without(expected, _CLOCK)
        return _Shown(sky, fix, moving[-1], expected, fit_p_value(expected, moving[-1]))

    def _looked(self, fix: SkyFix) -> list[_Look]:
        """At both velocities through a window."""
        ahead, found = self.foresight, list[_Look]()
        for one in fix.each:
            near = found and float(seconds_between(one.gpst, found[-1].gpst)) < POLICY.look_interval_s
            if near or one.there.size < 6:
                continue
            ahead = ahead.until(one.gpst)
            if (expected := ahead.at(one.gpst)) is not None:
                apart = one.mean[:6] - expected.mean[:6]
                found.append(_Look(one.gpst, expected.mean[3:6], apart, one.covariance[:6, :6]))
        return found

    def _report(self, window: Rivals, shown: _Shown) -> Finding:
        """Return the window's finding: an attack where no benign cause remains."""
        off = shown.last.mean - shown.expected.mean
        why, benign = self._find_benign(window, shown)
        off_m = float(np.linalg.norm(off[:3]))
        data: dict[str, Datum] = {"statistic": off_m, "off_m_s": float(np.linalg.norm(off[3:6]))}
        if why is None:
            data["assumes"] = self.foresight.assumes
        return Finding(
            detector=DETECTOR,
            start_gpst=window.start,
            end_gpst=window.end,
            signals=list_refs(self.maker.log.receiver, shown.sky.signals),
            hypothesis=Hypothesis.PREDICTED,
            code=why or "departs",
            p={Cause.CLEAN: shown.p_value} | benign,
            alpha=self.alpha,
            data=data,
        )

    def _find_benign(self, window: Rivals, shown: _Shown) -> tuple[str | None, dict[Cause, float]]:
        """Return the code of why a benign cause may have done it, None if none may; and p-values of benign causes."""
        if self.named:
            return None, {}
        by_unit = _find_unit_p_value(self.looks)
        if by_unit >= self.alpha and (why := self._find_unit_error(window)) is not None:
            return why, dict.fromkeys((Cause.STATEMENT, Cause.FAULT, Cause.REFLECTIONS), UNTESTED)
        without_two = self._without_two(window, shown)
        benign = {Cause.REFLECTIONS: without_two}
        if by_unit < self.alpha:
            benign |= {Cause.STATEMENT: by_unit, Cause.FAULT: by_unit}
        return "by_some" if without_two >= self.alpha else None, benign

    def _find_unit_error(self, window: Rivals) -> str | None:
        """Return the code of why the unit may be to blame, None if it is not."""
        if self.went_on < POLICY.tried_windows:
            return "not_tried"
        if _change_m_s(self.looks) > max(POLICY.tried_ratio * self.tried_m_s, POLICY.quiet_m_s):
            return "moved_more"
        if not _at_once(self.looks):
            return "parts_slowly"
        return "blow" if self._blow_m_s(window) > POLICY.blow_m_s else None

    def _without_two(self, window: Rivals, shown: _Shown) -> float:
        """Return the largest p-value without any two satellites; 1 where too few are left."""

        def p_values(pairs: Iterable[tuple[str, ...]]) -> Iterator[float]:
            for pair in pairs:
                fix = self.maker.at_end(window, shown.sky, pair)
                expected = None if fix is None else self.foresight.at(fix.gpst)
                if fix is None or expected is None:
                    yield 1.0
                else:
                    yield fit_p_value(without(expected, _CLOCK), fix)

        sats = sorted({signal.sat for signal in shown.sky.signals})
        return largest_p_value_without(sats, p_values, least=POLICY.least_satellites, enough=self.alpha)

    def _blow_m_s(self, window: Rivals) -> float:
        """The largest change of velocity that one reading makes beside its neighbours, since the last fix learned."""
        readings, state = self.foresight.readings, self.foresight.state
        start = window.start if state is None else state.gpst
        rows = slice(*np.searchsorted(readings.gpst, np.array([start, window.end])))
        force = readings.select(rows).specific_force_m_s2
        if len(force) < 3:
            return np.inf
        alone = force[1:-1] - 0.5 * (force[2:] + force[:-2])
        return float(np.linalg.norm(alone, axis=1).max() * readings.interval_s)


def _change_m_s(looks: Sequence[_Look]) -> float:
    """By how much the unit shows the velocity to change at most."""
    return float(np.linalg.norm(np.ptp([one.speed_m_s for one in looks], axis=0))) if looks else 0.0


def _find_unit_p_value(looks: Sequence[_Look]) -> float:
    """Return the largest p-value of how positions part, whatever the unit errs by: as velocities add up to.

    Errors of the signals' velocities are taken to last, as reflections may.
    """
    if len(looks) < POLICY.least_looks:
        return UNTESTED
    first, last = looks[0], looks[-1]
    t = np.asarray(seconds_between(np.array([one.gpst for one in looks]), first.gpst), np.float64)
    added_m = np.trapezoid(np.array([one.apart[3:] for one in looks]), t, axis=0)
    off_m = last.apart[:3] - first.apart[:3] - added_m
    spread = first.covariance[:3, :3] + last.covariance[:3, :3] + t[-1] ** 2 * last.covariance[3:, 3:]
    return float(chi_square_survival(off_m @ np.linalg.solve(spread, off_m), off_m.size))


def _at_once(looks: Sequence[_Look]) -> bool:
    """Whether velocities part within moments and stay so."""
    if len(looks) < POLICY.least_looks:
        return False
    t = np.asarray(seconds_between(np.array([one.gpst for one in looks]), looks[0].gpst), np.float64)
    apart = np.array([one.apart[3:] for one in looks])
    late = apart[t >= t[-1] - POLICY.parts_within_s].mean(axis=0)
    size = float(np.linalg.norm(late))
    if not size:
        return False
    along = apart @ (late / size)
    begun = np.searchsorted(t, t + POLICY.parts_within_s)
    early = np.flatnonzero((begun < t.size) & (t + POLICY.parts_within_s <= t[-1] - POLICY.stays_parted_s))
    return bool(np.any(along[begun[early]] - along[early] >= POLICY.parted_share * size))
