"""Which of two skies of a receiver is true, where nothing else decides it: the one that was to be expected.

Two skies within one receiver cannot both be true, so that one is false is evidence already; which one, a predictor
says (`navigation.predictor`), by `navigation.prediction.choose`. It rests on an assumption that no measurement shows:
that the signals were true until a certain time.

- Where an inertial unit carries the antenna: in every window that its navigator was corrected by (`departure`), as long
  as no test fails and each goes on as inertia expects.
- Else, where the second sky was seen from its first moment on, farther from the first than a search can hide: until
  then, if no two transmitters act in concert, one that leads the receiver away unseen and one that is seen from afar.
  Every window before has to go on from those before it as the predictor expects, and a place that stays is learned of
  in the first ones only.
- Where it may have been hidden in the first one for any time, or still is, or a window does not go on so: for the first
  `clean_start_s` seconds of the run only. What was received in between may have been led away by a false sky already,
  and no prediction learns of it.
- Where it was there from the first moment, or an alarm was: not at all; then nothing but a surveyed place chooses.

Nothing is chosen by half: where skies have parted in place and the clock alone is expected, or the other way round, a
false sky may be true in what is compared, and the other one a mixture that fits by chance; both have to be more.

What is chosen is evidence, window by window: the chosen sky is authentic under those assumptions, the others are
spoofed. Above the limit of the probability of a wrong choice the window stays open.

Skies that overlap within a chip are no signals that the receiver follows: its channels follow their sum. A detector
that took them apart hands on their fixes, and where a window shows no second sky otherwise, these are compared alike,
whether or not that window alone shows that the second one is no reflection. Nothing is named by that; the fixes of the
chosen sky are trusted, and the predictor follows them.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy import special

from skyproof.fusion.candidates import FixMaker, SkyCandidates, candidates_of, reference_kind, with_clock_near
from skyproof.fusion.choice_findings import DETECTOR, chosen, chosen_overlapping, not_chosen, taken_for_true
from skyproof.fusion.corrected import CorrectedNavigator
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource
from skyproof.fusion.policy import POLICY
from skyproof.fusion.skies import sky_onset
from skyproof.fusion.timeline import Onset
from skyproof.gnss.time import iso, timedelta_from_s
from skyproof.navigation.nav_estimate import NavEstimate
from skyproof.navigation.prediction import Choice, are_parted_unseen, choose, fit_p_value
from skyproof.navigation.predictor import Predictor, SkyFix
from skyproof.records import (
    NOTICED,
    ConsistentSet,
    Datum,
    Finding,
    Kind,
    NavigationData,
    ObservationLog,
    SignalId,
    SignalRef,
)

__all__ = ["DETECTOR", "ChoiceRules", "Chosen", "Compared", "choices"]

_Data = Mapping[str, Datum]
_IN_SIGMAS: Final = float(special.ndtri(0.5 + 0.5 * NOTICED))  # a bound that holds with that probability
_SIDES: Final = {"authentic": 1, "spoofed": -1}


@dataclass(frozen=True, kw_only=True)
class ChoiceRules:
    """most_wrong : probability of a wrong choice above which nothing is chosen. clean_start_s : for so long from the
    start of the run the signals are taken as true, unless there is a sign against it. The others are those of fixes.
    """

    most_wrong: float = 1e-3
    clean_start_s: float = 30.0
    multipath_sigma_m: float = 1.0
    elevation_mask_deg: float = 5.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Compared:
    """Skies of one receiver beside what was expected of the true one, in the first window in which one was chosen, or
    the last one in which none was.

    by : codes of what `expected` rests on. skies : what each shows, in the order of `choice`.
    """

    receiver: str
    by: tuple[str, ...]
    expected: NavEstimate
    skies: tuple[NavEstimate, ...]
    choice: Choice


@dataclass(frozen=True, eq=False, kw_only=True)
class Chosen:
    """evidence : by prediction. compared : one a receiver that had two skies. fixes : by receiver, those of chosen
    skies that overlapped with others, in order."""

    evidence: Sequence[Finding]
    compared: Sequence[Compared]
    fixes: Mapping[str, tuple[NavEstimate, ...]]


@dataclass(frozen=True, eq=False)
class _State:
    """What is carried from window to window.

    kind : of the signals whose clock is compared. bias_s : of the last fix that was taken for true. chosen, refused :
    the signals of the skies called true and false last. fixes : of chosen skies that overlapped with others.
    compared : None as long as there were no two skies.
    """

    predictor: Predictor
    kind: Kind | None = None
    bias_s: float = 0.0
    chosen: frozenset[SignalId] = field(default_factory=frozenset)
    refused: frozenset[SignalId] = field(default_factory=frozenset)
    fixes: tuple[NavEstimate, ...] = ()
    compared: Compared | None = None

    def followed(self, shown: SkyFix, s: ConsistentSet) -> "_State":
        return replace(self, predictor=self.predictor.followed(shown), bias_s=s.clock_bias_s)


def choices(
    decision: Decision,
    evidence: Sequence[Finding],
    observations: Sequence[ObservationLog],
    sets: Sequence[ConsistentSet],
    predictors: Mapping[str, Predictor],
    rules: ChoiceRules,
    navigation: NavigationData | None = None,
    navigators: Mapping[str, CorrectedNavigator] | None = None,
) -> Chosen:
    """What prediction says of the receivers that are attacked, of which nothing is named as true or false, and of which
    there is a predictor.

    navigation : orbits, for a predictor that learns from the fixes of epochs. navigators : of receivers with an
        inertial unit.
    """
    named = {s.ref.receiver for s in decision.labels if s.label in ("authentic", "spoofed")}
    attacked = {ref.receiver for e in evidence if e.says == "attack" for ref in e.signals} - named
    asked = attacked & predictors.keys()
    every = {o.receiver: list(candidates_of(o, evidence, sets)) for o in observations} if asked else {}
    # Whoever attacks one receiver is within reach of the others: the start of none is clean where that of one is not.
    doubted = [w.start for windows in every.values() for w in windows if w.doubted]
    found, compared, fixes = list[Finding](), list[Compared](), dict[str, tuple[NavEstimate, ...]]()
    for o in observations:
        own = [sky for sky in decision.skies if any(ref.receiver == o.receiver for ref in sky.signals)]
        if o.receiver in asked:
            maker = FixMaker(
                log=o,
                navigation=navigation,
                multipath_sigma_m=rules.multipath_sigma_m,
                elevation_mask_deg=rules.elevation_mask_deg,
            )
            chooser = _Chooser(maker, rules, _second_onset(own, o), (navigators or {}).get(o.receiver))
            said, last = chooser.of_windows(every[o.receiver], predictors[o.receiver], doubted)
            found += said
            compared += [last.compared] if last.compared is not None else []
            fixes[o.receiver] = last.fixes
    return Chosen(evidence=found, compared=compared, fixes=fixes)


def _second_onset(skies: Sequence[FalseSource], o: ObservationLog) -> Onset | None:
    """When the first of the skies came that joined another one; None while they have not parted."""
    onsets = [onset for sky in skies if (onset := sky_onset(sky, [o])) is not None]
    return sorted(onsets, key=lambda onset: onset.seen)[1] if len(onsets) > 1 else None


@dataclass(frozen=True, eq=False)
class _Chooser:
    """Of one receiver. onset : of its second sky. navigator : of its inertial unit."""

    maker: FixMaker
    rules: ChoiceRules
    onset: Onset | None
    navigator: CorrectedNavigator | None = None

    @property
    def log(self) -> ObservationLog:
        return self.maker.log

    @property
    def clean_start(self) -> np.datetime64:
        end: np.datetime64 = self.log.gpst[0] + timedelta_from_s(self.rules.clean_start_s)
        return end

    def of_windows(
        self, every: Sequence[SkyCandidates], predictor: Predictor, doubted: Sequence[np.datetime64]
    ) -> tuple[list[Finding], _State]:
        """By what is true before the second sky, or in the first windows alone; nothing where these do not go on.

        doubted : when windows begin in which the signals of any receiver are.
        """
        if self.navigator is not None:
            return self._by_inertia(every, self.navigator)
        until = min([self._latest(), *doubted])
        for last in (until, min(until, self.clean_start)):
            before = [w for w in every if w.sets and w.end <= last]
            learned = self._learned(_State(predictor), before)
            if learned is not None:
                after = [w for w in every if (w.sets or w.overlapping) and w.end > last]
                return self._walked(learned, before, before[-1].end if before else None, after, every)
        return [], _State(predictor)

    def _by_inertia(
        self, every: Sequence[SkyCandidates], navigator: CorrectedNavigator
    ) -> tuple[list[Finding], _State]:
        """By what was true while inertia went on with it."""
        from_start = self.onset is not None and self.onset.from_start
        until = navigator.until
        if until is None or from_start or not self.rules.clean_start_s:
            return [], _State(navigator.predictor)
        hidden = (one / _IN_SIGMAS for one in (navigator.hidden_m, navigator.hidden_m_s))
        state = _State(navigator.predictor.doubted(*hidden), kind=navigator.kind, bias_s=navigator.bias_s)
        # Later than the clean start inertia alone says that they go on, which a slow drag gets past.
        early = [w for w in every if w.start in navigator.early]
        after = [w for w in every if (w.sets or w.overlapping) and w.end > until]
        return self._walked(state, early, until, after, every)

    def _latest(self) -> np.datetime64:
        """Until when the signals may be taken for true."""
        if self.onset is not None and self.onset.from_start:
            start: np.datetime64 = self.log.gpst[0]
            return start
        return self.clean_start if self.onset is None or self.onset.earliest is None else self.onset.earliest

    def _learned(self, state: _State, windows: Sequence[SkyCandidates]) -> _State | None:
        """The state after windows that are taken as true; None where one does not go on from those before it."""
        for window in windows:
            only = window.sets[0]
            kind = state.kind or reference_kind(only)
            state = replace(state, kind=kind)
            shown = self._shown(window, only, state)
            expected = state.predictor.at(shown.whole.gpst)
            if expected is not None:
                shown = with_clock_near(shown, expected)
                if not _goes_on(expected, shown.whole):
                    return None
            if window.end > self.clean_start:
                state = state.followed(shown, only)
            else:
                state = replace(state, predictor=state.predictor.learned(shown), bias_s=only.clock_bias_s)
        return state

    def _walked(
        self,
        state: _State,
        before: Sequence[SkyCandidates],
        until: np.datetime64 | None,
        windows: Sequence[SkyCandidates],
        every: Sequence[SkyCandidates],
    ) -> tuple[list[Finding], _State]:
        """before : windows whose only sky is taken for true. until : the end of those that the predictor learned of."""
        rests_on = self._rest_on(until, state.predictor.assumes)
        found: list[Finding] = []
        for window in windows:
            state = replace(state, predictor=state.predictor.until(window.start))
            said, state = self._judged(window, state, rests_on) if window.sets else ([], state)
            if not said:
                said, state = self._overlapping(window, state, rests_on)
            found += said
        spans = zip(before, _ends(before, every), strict=True)
        clean = [taken_for_true(self.log, window, end, "only_sky", rests_on) for window, end in spans]
        return [*clean, *_at_home(found)], state

    def _rest_on(self, until: np.datetime64 | None, assumes: tuple[str, ...]) -> dict[str, Datum]:
        """Return the codes of what is assumed: of the windows before the second sky, and by what is expected."""
        if until is None:
            return {"assumes": assumes}
        concert = () if until <= self.clean_start else ("no_concert",)
        return {"assumes": (*concert, "clean_start", *assumes), "clean_until": iso(until, 0)[11:]}

    def _judged(self, window: SkyCandidates, state: _State, rests_on: _Data) -> tuple[list[Finding], _State]:
        shown = [self._shown(window, s, state) for s in window.sets]
        expected = state.predictor.at(shown[0].whole.gpst)
        if expected is None:
            return [], state
        shown = [with_clock_near(one, expected) for one in shown]
        if not set(expected.there).intersection(*(one.whole.there for one in shown)):
            return [], state
        if len(shown) == 1:
            return self._alone(window, shown[0], expected, state, rests_on)
        if not window.attacked:
            return [], state
        by, most_wrong = state.predictor.by, self.rules.most_wrong
        choice, state = self._compared(expected, shown, state)
        if choice.chosen is None or self._by_half(window, [one.whole for one in shown], choice):
            return [not_chosen(self.log, window, window.sets, shown, choice, by, most_wrong)], state
        taken = window.sets[choice.chosen]
        first = not state.chosen
        said = chosen(self.log, window, shown, choice, by, rests_on, most_wrong=most_wrong, first=first)
        return said, replace(
            state.followed(shown[choice.chosen], taken),
            chosen=frozenset(taken.signals),
            refused=frozenset(signal for s in window.sets if s is not taken for signal in s.signals),
        )

    def _compared(
        self, expected: NavEstimate, shown: Sequence[SkyFix], state: _State, doubt: float = 0.0
    ) -> tuple[Choice, _State]:
        """doubt : that these are not skies to choose from."""
        skies = tuple(one.whole for one in shown)
        most_wrong = max(self.rules.most_wrong - doubt, 0.0)
        choice = choose(expected, skies, most_wrong=most_wrong, false_alarm_probability=POLICY.refused_probability)
        if state.chosen or state.fixes:
            return choice, state
        by = state.predictor.by
        seen = Compared(receiver=self.log.receiver, by=by, expected=expected, skies=skies, choice=choice)
        return choice, replace(state, compared=seen)

    def _overlapping(
        self, window: SkyCandidates, state: _State, rests_on: Mapping[str, Datum]
    ) -> tuple[list[Finding], _State]:
        """The skies that were taken apart, instant by instant; what is said is of the last one.

        That they are two skies, and not one and what happens to fit, is known of them: what is expected need not say
        all that they differ in. One that may have made the other by reflections is not chosen: then it may be the only
        sky, and false.
        """
        said, before = list[Finding](), state
        for skies in window.overlapping:
            shown = [self._at_once(window, s, state) for s in skies.sets]
            expected = state.predictor.at(shown[0].whole.gpst)
            if expected is None:
                continue
            shown = [with_clock_near(one, expected) for one in shown]
            if not set(expected.there).intersection(*(one.whole.there for one in shown)):
                continue
            likeliest = int(np.argmax(choose(expected, [one.whole for one in shown]).probabilities))
            doubt = skies.doubt + skies.reflected[likeliest]
            choice, state = self._compared(expected, shown, state, doubt)
            by = state.predictor.by
            if choice.chosen is not None:
                true = shown[choice.chosen]
                state = replace(state.followed(true, skies.sets[choice.chosen]), fixes=(*state.fixes, true.whole))
                said = [chosen_overlapping(self.log, window, skies, shown, choice, by, rests_on, doubt)]
            elif state.fixes == before.fixes:
                said = [not_chosen(self.log, window, skies.sets, shown, choice, by, self.rules.most_wrong, doubt)]
        return said, state

    def _at_once(self, window: SkyCandidates, s: ConsistentSet, state: _State) -> SkyFix:
        """What a set shows that is of one instant."""
        kind = state.kind or reference_kind(s)
        shown = self.maker.shown(window, s, kind=kind, bias_s=state.bias_s, epochs=False)
        return replace(shown, each=(shown.whole,))

    def _by_half(self, window: SkyCandidates, skies: Sequence[NavEstimate], choice: Choice) -> bool:
        """Whether what is expected cannot choose: skies have parted in what it says nothing of, and one may be chance.

        Then both may be false: one that is true in what is expected, and some true and false signals that fit together.
        """
        assert choice.chosen is not None
        taken, most_wrong = skies[choice.chosen], self.rules.most_wrong
        parted = any(are_parted_unseen(taken, one, choice.used, probability=most_wrong) for one in skies)
        fewest = min(len({signal.sat for signal in s.signals}) for s in window.sets)
        return parted and fewest < POLICY.no_chance_satellites

    def _alone(
        self, window: SkyCandidates, shown: SkyFix, expected: NavEstimate, state: _State, rests_on: Mapping[str, Datum]
    ) -> tuple[list[Finding], _State]:
        """A sky without another one beside it, after the second was seen: it is taken if it was chosen before."""
        (only,) = window.sets
        same = len(state.chosen.intersection(only.signals)) >= POLICY.same_sky_share * len(only.signals)
        if not same or state.refused.intersection(only.signals) or not _goes_on(expected, shown.whole):
            return [], state
        data = dict(rests_on) | {"by": state.predictor.by}
        said = taken_for_true(self.log, window, window.end, "goes_on", data)
        return [said], replace(state.followed(shown, only), chosen=state.chosen.union(only.signals))

    def _shown(self, window: SkyCandidates, s: ConsistentSet, state: _State) -> SkyFix:
        kind = state.kind or reference_kind(s)
        return self.maker.shown(window, s, kind=kind, bias_s=state.bias_s, epochs=state.predictor.moves)


def _goes_on(expected: NavEstimate, fix: NavEstimate) -> bool:
    """Whether a fix is no farther from what was expected than chance allows; also where nothing of it was."""
    if not set(expected.there).intersection(fix.there):
        return True
    return fit_p_value(expected, fix) >= POLICY.goes_on_probability


def _ends(windows: Sequence[SkyCandidates], every: Sequence[SkyCandidates]) -> list[np.datetime64]:
    """Return up to when each window speaks: to the start of the next one, for of a long run not every one is kept."""
    starts = sorted(window.start for window in every)
    ends = [starts[bisect_right(starts, window.start)] for window in windows[:-1]]
    return [*ends, *(window.end for window in windows[-1:])]


def _at_home(found: Sequence[Finding]) -> Iterator[Finding]:
    """Each signal on the side only where it was found most: while skies are near, a false signal may fit the true one.

    What a channel followed before the choice is of no account.
    """
    count: Counter[SignalRef] = Counter()
    for e in found:
        count.update(dict.fromkeys(e.signals, _SIDES.get(e.says, 0)))
    for e in found:
        side = _SIDES.get(e.says)
        own = tuple(ref for ref in e.signals if side is None or side * count[ref] > 0)
        if own:
            yield replace(e, signals=own)
