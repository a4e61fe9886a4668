"""Test if position, velocity, clock and time of a receiver move as a platform and an oscillator can.

Two windows may each look good, and still not continue one another: the halves of two receivers' recordings joined, a
recording that begins again, an attack that takes over in one step. For each receiver the satellites of its consistent
set are followed from window to window, by what was sent and not by channel: signals that were lost and found again
under another name are the same satellite's. What does not fit the set's position in this window is left out, as it
moves by itself. `steps` finds where the others step. Each kind of signal (time scale, band, code) is looked at alone,
for it may be imitated alone; kinds of few satellites together with the largest.

A receiver that is stated to stand and moves by all its carriers (`standing`) is attacked, or the statement is wrong:
the word is "attack" under that assumption. Codes that show a motion which carriers do not show (`code_drag`) indicate
an attack whatever is stated.

Any other step is *undecided*, and not an attack: a recording that was cut and joined steps as well. But it
overrules what single windows say, from the window of the step on: evidence from before the step does not cover the
signals after it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.base import NotTested, Reporter
from skyproof.detectors.continuity.causes import p_values_by_cause
from skyproof.detectors.continuity.code_drag import find_code_drags
from skyproof.detectors.continuity.one_sky import group_columns, join_later, select_one_per_transmission
from skyproof.detectors.continuity.policy import POLICY
from skyproof.detectors.continuity.series import Limits, Series, build_group_series
from skyproof.detectors.continuity.standing import find_carrier_motion
from skyproof.detectors.continuity.steps import Step, find_largest_steps
from skyproof.detectors.continuity.whole_sky import SkyMotion, select_least_likely
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.time import format_iso
from skyproof.records import (
    BY_NAME,
    Cause,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    Kind,
    NavigationData,
    Need,
    NoticedAttack,
    NoticedKind,
    Observations,
    Records,
    SignalId,
    SignalRef,
    Transmission,
    list_refs,
)

__all__ = ["Continuity", "ContinuitySettings", "explain_few_epochs", "explain_no_step"]


_SHARES = 3  # of the false alarms: steps, motion by carriers, by codes alone


@dataclass(frozen=True)
class ContinuitySettings:
    """Settings of `Continuity`.

    false_alarm_probability : of each receiver and window, for all tests together.
    multipath_sigma_m : of one pseudorange, one sigma; it may change altogether within seconds.
    span_s : over which ranges and levels are averaged before and after a moment.
    acceleration_max_m_s2 : no platform exceeds it; what it may do unseen while nothing is received follows from it.
    speed_max_m_s : no platform exceeds it, if it is known.
    clock_jump, clock_pace_s : what an oscillator's rate may step by, and change by in a second.
    carrier_error_m : of a carrier beside noise, by reflections, one sigma: a quarter of a wavelength at most.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    span_s: float = 5.0
    acceleration_max_m_s2: float = 50.0
    speed_max_m_s: float | None = None
    clock_jump: float = 1e-8
    clock_pace_s: float = 1e-8
    carrier_error_m: float = 0.04

    def __post_init__(self) -> None:
        require_probability("continuity", "false_alarm_probability", self.false_alarm_probability)
        for name in ("span_s", "acceleration_max_m_s2", "carrier_error_m"):
            if not getattr(self, name) > 0.0:
                raise SettingsError(f"continuity: {name} is {getattr(self, name)}, expected more than 0")

    @property
    def limits(self) -> Limits:
        return Limits(
            span_s=self.span_s,
            multipath_sigma_m=self.multipath_sigma_m,
            acceleration_m_s2=self.acceleration_max_m_s2,
            speed_m_s=np.inf if self.speed_max_m_s is None else self.speed_max_m_s,
            clock_jump=self.clock_jump,
            clock_pace_s=self.clock_pace_s,
        )


_NOTICED: Final[tuple[NoticedKind, ...]] = ("position_jump", "clock_jump", "velocity_jump", "clock_push")
"""What each of the steps' KINDS is as an attack."""


class _Break(NamedTuple):
    """A step that broke kinds of signals: its epoch, and the statistic of the window in which it was found."""

    step: Step
    gpst: np.datetime64
    statistic: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class _Past:
    """What is remembered of a receiver: bounded by the number of transmissions and twice `span_s`.

    tail : the last epochs, one signal per transmission. sources : which signal of each continued unbroken from it.
    members : the last consistent set's signals. broke : the kinds of signals that broke, and why.
    attacked : motions that are none were shown. stepped_s, first_step_s : when the last step was, and the first.
    """

    tail: Observations
    sources: Mapping[Transmission, SignalId]
    members: tuple[SignalId, ...]
    place_ecef_m: Reals
    broke: Mapping[Kind, _Break] = field(default_factory=dict)
    attacked: bool = False
    stepped_s: float = -np.inf
    first_step_s: float = np.inf


@dataclass(frozen=True, eq=False, kw_only=True)
class _Look:
    """A candidate for the sky that continues: its signals, the epochs joined with those before, and the steps found."""

    members: tuple[SignalId, ...]
    place_ecef_m: Reals
    stretch: Observations
    sources: Mapping[Transmission, SignalId]
    new: int  # the first row of this window
    steps: tuple[tuple[frozenset[Kind], Step], ...] = ()  # the largest of each group of kinds
    moved: SkyMotion | None = None  # by carriers, of a receiver that is stated to stand
    code_drag: SkyMotion | None = None  # by codes, and not by carriers
    untested: NotTested | None = None  # why no moment could be tested

    @property
    def p_value(self) -> float:
        return min((step.p_value for _, step in self.steps), default=1.0)


class Continuity:
    """The detector: see the module's text. It remembers the last seconds of each receiver."""

    name = "continuity"
    needs = (Need.OBSERVATIONS, Need.NAVIGATION, Need.SETS)

    def __init__(self, settings: ContinuitySettings | None = None) -> None:
        self.settings = settings or ContinuitySettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        pasts: dict[str, _Past] = dict(state or {})
        if not records.observations or records.navigation is None or not (records.sets or pasts):
            return Reporter(self, records, Hypothesis.CONTINUOUS).name_missing(), state
        findings: list[Finding] = []
        for o in records.observations:
            before = pasts.get(o.receiver)
            if before is not None and o.elapsed_s[-1] <= before.tail.elapsed_s[-1]:
                before = None  # another recording
            evidence, past = _Window(self, records, records.navigation, o, before).examine_sky()
            findings += evidence
            if past is not None:
                pasts[o.receiver] = past
        return findings, pasts


class _Window:
    """One receiver in one window, after what came before."""

    def __init__(
        self, detector: Continuity, records: Records, navigation: NavigationData, o: Observations, past: _Past | None
    ) -> None:
        self.detector, self.records, self.settings = detector, records, detector.settings
        self.navigation, self.o, self.past = navigation, o, past
        self.limits = self.settings.limits
        self.alpha = self.settings.false_alarm_probability / _SHARES
        self.report = Reporter(detector, records, Hypothesis.CONTINUOUS)

    def examine_sky(self) -> tuple[list[Finding], _Past | None]:
        candidates = [self._look_at(members, place) for members, place in self._list_candidates()]
        looks = [look for look in candidates if look.stretch.gpst.size > 1]
        if not looks:
            return [self._report_untested(candidates[0] if candidates else None)], self.past
        look = max(looks, key=lambda look: look.p_value)
        return [
            *self._report_continuity(look),
            *self._report_standing(look),
            *self._report_code_drag(look),
        ], self._remember(look)

    def _list_candidates(self) -> list[tuple[tuple[SignalId, ...], Reals]]:
        """List the sets that may be the sky that was followed: those that share most signals with it, or all."""
        sets = [s for s in self.records.sets if s.receiver == self.o.receiver]
        if self.past is None:
            return [(s.signals, s.position_ecef_m) for s in _largest(sets)]
        if not sets:
            return [(self.past.members, self.past.place_ecef_m)]
        shared = [len(set(s.signals) & set(self.past.members)) for s in sets]
        return [(s.signals, s.position_ecef_m) for s, n in zip(sets, shared, strict=True) if n == max(shared)]

    def _look_at(self, members: tuple[SignalId, ...], place_ecef_m: Reals) -> _Look:
        before = () if self.past is None else self.past.members
        sources_before = {} if self.past is None else self.past.sources
        now, sources = select_one_per_transmission(self.o, members, before, sources_before)
        stretch = now if self.past is None else join_later(self.past.tail, now)
        look = _Look(
            members=members,
            place_ecef_m=place_ecef_m,
            stretch=stretch,
            sources=sources,
            new=stretch.gpst.size - now.gpst.size,
        )
        if stretch.gpst.size < POLICY.untested_epochs or now.gpst.size == 0:
            return replace(look, untested=explain_few_epochs(self.o, stretch.gpst.size, stepped=False))
        sent = {signal.transmission for signal in members}
        sky = stretch.select_channels(np.flatnonzero([s.transmission in sent for s in stretch.signals]))
        groups = self._group_kinds(sky, place_ecef_m)
        code_drag = self._find_code_drag(groups)
        if code_drag is not None and self.past is not None:
            span_from_s = float(stretch.elapsed_s[-1]) - max(POLICY.code_spans_s)
            if self.past.first_step_s < span_from_s:  # by reflections larger than stated: some in a row are a motion
                code_drag = code_drag._replace(whole_sky_p_value=1.0)
        kept = stretch.elapsed_s >= (-np.inf if self.past is None else self.past.stepped_s)
        unbroken = groups if kept.all() else self._group_kinds(sky.select(kept), place_ecef_m)
        steps, n_kept = self._find_steps(look, unbroken), int(kept.sum())
        untested = None
        if not steps and n_kept < POLICY.untested_epochs:
            untested = explain_few_epochs(self.o, n_kept, stepped=True)
        elif not steps:
            untested = explain_no_step(stretch.select(kept))
        return replace(
            look,
            steps=steps,
            untested=untested,
            moved=self._find_motion(groups, place_ecef_m),
            code_drag=code_drag,
        )

    def _group_kinds(self, stretch: Observations, place_ecef_m: Reals) -> list[tuple[Observations, Series]]:
        """Group the kinds of signals that may step alone, each with its series."""
        return build_group_series(stretch, group_columns(stretch), self.navigation, place_ecef_m, self.limits)

    def _find_steps(
        self, look: _Look, groups: Sequence[tuple[Observations, Series]]
    ) -> tuple[tuple[frozenset[Kind], Step], ...]:
        """Find the largest step of each group of kinds.

        Rows are the stretch's, p-values those of all groups together.
        """
        stretch = look.stretch
        since_s = stretch.elapsed_s[min(look.new, stretch.gpst.size - 1)] - self.limits.span_s
        found: list[tuple[frozenset[Kind], Step]] = []
        rows = [(series.unseen, np.flatnonzero(group.elapsed_s > since_s)) for group, series in groups]
        number, looked_s = len(groups), float(stretch.elapsed_s[-1] - since_s)

        def count_groups(step: Step) -> Step:
            return replace(step, p_value=min(1.0, number * step.p_value), tests=number * step.tests)

        steps = find_largest_steps(rows, self.limits, alpha=self.alpha / max(number, 1))
        for (group, series), (unseen, looked), step in zip(groups, rows, steps, strict=True):
            if step is None:
                continue
            whole = count_groups(step)
            if whole.p_value < self.alpha:
                causes = p_values_by_cause(unseen, step.row, whole, self.limits, span_s=looked_s)
                whole = replace(whole, causes=tuple(causes.items()))
                if series is not unseen and causes[Cause.REFLECTIONS] >= self.alpha:
                    (shown,) = find_largest_steps([(series, looked)], self.limits, alpha=self.alpha / number)
                    if shown is not None and count_groups(shown).p_value >= self.alpha:
                        whole = count_groups(shown)
            row = int(np.searchsorted(stretch.elapsed_s, group.elapsed_s[whole.row]))
            found.append((frozenset(signal.kind for signal in group.signals), replace(whole, row=row)))
        return tuple(found)

    def _find_motion(self, groups: Sequence[tuple[Observations, Series]], place_ecef_m: Reals) -> SkyMotion | None:
        """Find the least likely motion of a receiver stated to stand, by the carriers of any group of kinds."""
        if self.settings.speed_max_m_s != 0.0:
            return None
        alpha, error_m = self.alpha / max(len(groups), 1), self.settings.carrier_error_m
        return select_least_likely(
            find_carrier_motion(group, series, self.navigation, place_ecef_m, carrier_error_m=error_m, alpha=alpha)
            for group, series in groups
        )

    def _find_code_drag(self, groups: Sequence[tuple[Observations, Series]]) -> SkyMotion | None:
        """Find the least likely motion that the codes of any group of kinds show, and not the carriers."""
        alpha, multipath_m = self.alpha / max(len(groups), 1), self.settings.multipath_sigma_m

        def find(series: Sequence[tuple[Observations, Series]]) -> SkyMotion | None:
            return select_least_likely(find_code_drags(series, multipath_sigma_m=multipath_m, alpha=alpha))

        motion = find([(group, series.unseen) for group, series in groups])
        if motion is None or motion.p_value >= self.alpha or motion.whole_sky_p_value < self.alpha:
            return motion
        shown = find(groups)
        return motion if shown is None or shown.p_value < self.alpha else shown

    def _report_continuity(self, look: _Look) -> list[Finding]:
        """Report the kinds of signals that broke, by what broke them, and the others."""
        broke = self._find_breaks(look)
        subject = self._subject(look)
        found = []
        for why in dict.fromkeys(broke.values()):
            broken = tuple(ref for ref in subject if broke.get(ref.signal.kind) == why)
            found += [self._report_broken(broken, why)] if broken else []
        unbroken = tuple(ref for ref in subject if ref.signal.kind not in broke)
        steps = [step for kinds, step in look.steps if not kinds <= broke.keys()]
        if not steps:
            return found or [self._report_untested(look)]
        return [*found, *([self._report_unbroken(unbroken, look, steps)] if unbroken else [])]

    def _find_breaks(self, look: _Look) -> dict[Kind, _Break]:
        """Find what broke each kind, now or before."""
        broke = {} if self.past is None else dict(self.past.broke)
        for kinds, step in look.steps:
            if step.p_value < self.alpha:
                why = _Break(step, look.stretch.gpst[step.row], step.statistic)
                broke |= dict.fromkeys(kinds, why)
        return broke

    def _report_unbroken(self, signals: tuple[SignalRef, ...], look: _Look, steps: Sequence[Step]) -> Finding:
        step = min(steps, key=lambda step: (-step.missing_s, step.p_value))
        if step.missing_s > 0.0 and step.row >= look.new:
            data: dict[str, Datum] = {"at": format_iso(look.stretch.gpst[step.row], 1), "missing_s": step.missing_s}
            return self.report.pass_over(signals, NotTested("time_ahead", data))
        statistic: dict[str, Datum] = {"statistic": step.statistic}
        noticed = tuple(
            NoticedAttack(kind, min(sizes))
            for kind, sizes in zip(_NOTICED, zip(*(step.noticed for step in steps), strict=True), strict=True)
        )
        p = {Cause.CLEAN: step.p_value}
        return self.report.find(signals, "goes_on", p, alpha=self.alpha, estimates={"noticed": noticed}, data=statistic)

    def _report_broken(self, signals: tuple[SignalRef, ...], why: _Break) -> Finding:
        step = why.step
        data: dict[str, Datum] = {
            "kinds": step.kinds,
            "position_m": step.position_m,
            "clock_s": step.clock_s,
            "speed_m_s": step.speed_m_s,
            "rate": step.rate,
            "broke": step.broke,
            "outage_s": step.outage_s,
            "multipath_sigma_m": self.settings.multipath_sigma_m,
        }
        if why.statistic is not None:
            data["statistic"] = why.statistic
        return self.report.find(
            signals,
            "step",
            {Cause.CLEAN: step.p_value, **dict(step.causes)},
            alpha=self.alpha,
            data=data,
            dated_gpst=why.gpst,
        )

    def _report_standing(self, look: _Look) -> list[Finding]:
        """Return what carriers show of a receiver that is stated to stand."""
        if look.moved is None:
            return []
        codes = ("stands", "moves_by_some", "moves")
        return [self._report_motion(look, look.moved, "motion", codes, ("receiver_stands",))]

    def _report_code_drag(self, look: _Look) -> list[Finding]:
        """Return whether codes and carriers show one motion."""
        motion = look.code_drag
        if motion is None or (motion.whole_sky_p_value >= self.alpha > motion.p_value and self._find_breaks(look)):
            return []  # a step, which is said
        return [self._report_motion(look, motion, "code_drag", ("one_motion", "dragged_by_some", "dragged"), ())]

    def _report_motion(
        self, look: _Look, motion: SkyMotion, kind: NoticedKind, codes: tuple[str, str, str], assumes: tuple[str, ...]
    ) -> Finding:
        """Report a motion of the whole sky, or of some satellites, which reflections may drag off.

        codes : where nothing moves, some satellites do, and all do.
        """
        number = int(motion.p_value < self.alpha) + int(max(motion.p_value, motion.whole_sky_p_value) < self.alpha)
        data: dict[str, Datum] = {
            "statistic": motion.metres,
            "moved_m": motion.metres,
            "time_s": motion.time_s,
            "satellites": motion.satellites,
        }
        if number == len(codes) - 1:
            data["assumes"] = assumes
        return self.report.find(
            self._subject(look),
            codes[number],
            {Cause.CLEAN: motion.p_value, Cause.REFLECTIONS: motion.whole_sky_p_value},
            alpha=self.alpha,
            estimates={"noticed": (NoticedAttack(kind, motion.noticed_m_s),)},
            data=data,
        )

    def _report_untested(self, look: _Look | None) -> Finding:
        """Return why the signals of a candidate could not be tested, or that there is none."""
        why = NotTested("no_set") if look is None else look.untested or explain_no_step(look.stretch)
        return self.report.pass_over(list_refs(self.o.receiver, self.o.signals), why)

    def _subject(self, look: _Look) -> tuple[SignalRef, ...]:
        measured = np.isfinite(self.o.pseudorange_m).any(axis=0)
        measured_signals = {self.o.signals[k] for k in np.flatnonzero(measured)}
        chosen = sorted((set(look.members) | set(look.sources.values())) & measured_signals, key=BY_NAME)
        return list_refs(self.o.receiver, chosen)

    def _remember(self, look: _Look) -> _Past:
        stretch = look.stretch
        first = np.searchsorted(stretch.elapsed_s, stretch.elapsed_s[-1] - 2.0 * self.limits.span_s - 1e-6)
        stepped = [float(stretch.elapsed_s[step.row]) for _, step in look.steps if step.p_value < self.alpha]
        return _Past(
            tail=stretch.select(slice(int(first), None)),
            sources=look.sources,
            members=look.members,
            place_ecef_m=look.place_ecef_m,
            # What came before a step is no measure of the steps that come next.
            stepped_s=max([-np.inf if self.past is None else self.past.stepped_s, *stepped]),
            first_step_s=min([np.inf if self.past is None else self.past.first_step_s, *stepped]),
            broke={kind: why._replace(statistic=None) for kind, why in self._find_breaks(look).items()},
            attacked=(self.past is not None and self.past.attacked)
            or any(
                motion is not None and motion.whole_sky_p_value < self.alpha for motion in (look.moved, look.code_drag)
            ),
        )


def _largest(sets: Sequence[ConsistentSet]) -> Sequence[ConsistentSet]:
    return sorted(sets, key=lambda s: (-len(s.signals), s.statistic))[:1]


def explain_few_epochs(o: Observations, epochs: int, *, stepped: bool) -> NotTested:
    """Explain a stretch of too few epochs.

    o : of the window. epochs : that have enough satellites, those before the window included. stepped : whether those
    before the last step were left out.
    """
    most = int(np.isfinite(o.pseudorange_m).sum(axis=1).max(initial=0))
    if most < POLICY.one_sky_satellites:
        return NotTested("few_satellites", {"most": most, "needed": POLICY.one_sky_satellites})
    data = {"epochs": epochs, "needed": POLICY.untested_epochs, "satellites": POLICY.one_sky_satellites}
    return NotTested("few_epochs_since_step" if stepped else "few_epochs", data)


def explain_no_step(o: Observations) -> NotTested:
    """Explain a stretch in which no moment can be tested, whatever its epochs.

    o : the stretch, one signal a transmission.
    """
    ranged = np.isfinite(o.pseudorange_m).any(axis=0)
    tuned = ranged & np.isfinite(o.carrier_hz)
    if tuned.sum() < POLICY.one_sky_satellites <= ranged.sum():
        return NotTested("no_frequency", {"without": int((ranged & ~tuned).sum()), "ranged": int(ranged.sum())})
    moving = tuned & (np.isfinite(o.carrier_cyc) | np.isfinite(o.doppler_hz)).any(axis=0)
    if moving.sum() < POLICY.one_sky_satellites <= tuned.sum():
        return NotTested("ranges_alone", {"without": int((tuned & ~moving).sum()), "tuned": int(tuned.sum())})
    return NotTested("one_side", {"needed": POLICY.one_sky_satellites})
