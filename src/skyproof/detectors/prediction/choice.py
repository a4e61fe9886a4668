"""Which of two skies of a receiver is true, where nothing else decides it: the one that was to be expected.

Two skies within one receiver cannot both be true, so that one is false is evidence already; which one, a predictor
says (`navigation.predictor`), by `navigation.prediction.choose`. It rests on an assumption that no measurement shows:
that the signals were true until a certain time.

- Where an inertial unit carries the antenna: in every window that its navigator was corrected by (`inertia`), as long
  as no test fails and each follows the inertial prediction.
- Else, where the second sky was seen from its first moment on, farther from the first than a search can hide: until
  then, if no two transmitters act in concert, one that leads the receiver away unseen and one that is seen from afar.
  Every window before has to follow those before it as predicted, and a place that stays is learned of
  in the first ones only.
- Where it may have been hidden in the first one for any time, or still is, or a window does not follow: for the first
  `clean_start_s` seconds of the run only. What was received in between may have been led away by a false sky already,
  and no prediction learns of it.
- Where it was there from the first moment, or an alarm was: not at all; then nothing but a surveyed place chooses.

Nothing is chosen by half: where skies have parted in place and the clock alone is expected, or the other way round, a
false sky may be true in what is compared, and the other one a mixture that fits by chance; both have to be more.

What is chosen is a finding of each window: the chosen sky is authentic under those assumptions, the others are spoofed.
Above the limit of the probability of a wrong choice the window stays open. At the first sign of an attack the windows
of the clean start are said to be authentic under the same assumptions.

Skies that overlap within a chip are no signals that the receiver follows: its channels follow their sum. A detector
that took them apart hands on their fixes, and where a window shows no second sky otherwise, these are compared alike,
whether or not that window alone shows that the second one is no reflection. Nothing is named by that; the fixes of the
chosen sky are trusted, and the predictor follows them.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from scipy import special

from skyproof.detectors.base import Reporter
from skyproof.detectors.prediction.choice_findings import (
    DETECTOR,
    chosen,
    report_chosen_overlapping,
    report_not_chosen,
    report_only_sky,
)
from skyproof.errors import require_probability
from skyproof.fusion.candidates import FixMaker, SkyCandidates, align_clock, find_reference_kind, select_candidates
from skyproof.fusion.corrected import CorrectedNavigator
from skyproof.fusion.policy import POLICY
from skyproof.fusion.skies import date_sky, name_skies
from skyproof.fusion.timeline import Onset, Pair, compare_pairs
from skyproof.gnss.time import format_iso, seconds_between, timedelta_from_s
from skyproof.navigation.nav_estimate import NavEstimate
from skyproof.navigation.prediction import Choice, are_parted_unseen, choose, fit_p_value
from skyproof.navigation.predictor import Predictor, SkyFix
from skyproof.records import (
    NOTICED,
    ConsistentSet,
    Datum,
    Finding,
    Hypothesis,
    Kind,
    Need,
    Observations,
    Records,
    SignalId,
    SignalRef,
    list_refs,
)

__all__ = ["Compared", "Prediction", "PredictionSettings", "collect_overlapping_fixes", "list_compared_skies"]

_Data = Mapping[str, Datum]
_IN_SIGMAS: Final = float(special.ndtri(0.5 + 0.5 * NOTICED))  # a bound that holds with that probability
_SIDES: Final = {"authentic": 1, "spoofed": -1}


@dataclass(frozen=True, kw_only=True)
class PredictionSettings:
    """Settings of `Prediction`.

    wrong_choice_probability : of a wrong choice, above which nothing is chosen. clean_start_s : for so long from the
    start of the run the signals are taken as true, unless there is a sign against it. The others are those of fixes.
    false_alarm_probability : not used, for nothing is chosen where no other test shows an attack.
    """

    false_alarm_probability: float = 1e-3
    wrong_choice_probability: float = 1e-3
    clean_start_s: float = 30.0
    multipath_sigma_m: float = 1.0
    elevation_mask_deg: float = 5.0

    def __post_init__(self) -> None:
        require_probability(DETECTOR, "wrong_choice_probability", self.wrong_choice_probability)


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


class Prediction:
    """The detector: see the module's text. It remembers what it expects of each receiver, and what it chose."""

    name = DETECTOR
    needs = (Need.EXPECTED, Need.SETS, Need.FINDINGS)
    share = 0.0

    def __init__(self, settings: PredictionSettings | None = None) -> None:
        self.settings = settings or PredictionSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return what prediction says of each receiver that is attacked, where nothing else names true signals
        or false ones."""
        # An attack counts in a window without sets, too.
        found = Reporter(self, records, Hypothesis.FALSE_SKY).name_missing()
        watches: dict[str, _Watch] = dict(state or {})
        windows = {o.receiver: select_candidates(records, o.receiver) for o in records.observations}
        # Whoever attacks one receiver is within reach of the others: none starts clean where one does not.
        doubted = any(window.doubted for window in windows.values())
        for o in records.observations:
            if o.receiver not in records.expected:
                continue
            expected = records.expected[o.receiver]
            watch = watches.get(o.receiver) or _Watch.begin(o, expected, self.settings.clean_start_s)
            named = any(
                e.says in _SIDES and any(ref.receiver == o.receiver for ref in e.signals) for e in records.findings
            )
            receiver_now = _Here(
                maker=FixMaker.build_for_window(o, records, self.settings),
                settings=self.settings,
                window=windows[o.receiver],
                navigator=expected if isinstance(expected, CorrectedNavigator) else None,
            )
            watch = watch.look(receiver_now, doubted=doubted, named=named)
            findings, watches[o.receiver] = ([], watch) if watch.named else receiver_now.report_window(watch)
            found += findings
        return found, watches

    def review(self, evidence: Sequence[Finding]) -> Iterable[Finding]:
        """Return all findings with each signal on the side only where it was found most.

        While skies are near, a false signal may fit the true one. What a channel followed before the choice does not
        count.
        """
        count: Counter[SignalRef] = Counter()
        for e in evidence:
            if e.detector == DETECTOR and e.code != "only_sky":
                count.update(dict.fromkeys(e.signals, _SIDES.get(e.says, 0)))
        return _keep_at_home(evidence, count) if count else evidence


def _keep_at_home(evidence: Iterable[Finding], count: Mapping[SignalRef, int]) -> Iterator[Finding]:
    """Yield findings without the signals that are at home in another sky. count : above nothing, in the true one."""
    for e in evidence:
        side = _SIDES.get(e.says) if e.detector == DETECTOR and e.code != "only_sky" else None
        if side is None:
            yield e
        elif at_home := tuple(ref for ref in e.signals if side * count[ref] > 0):
            yield replace(e, signals=at_home)


def list_compared_skies(state: Any) -> tuple[Compared, ...]:
    """Return the skies of each receiver that had two, beside what was expected. state : of `Prediction`, at the end."""
    watches: dict[str, _Watch] = state or {}
    return tuple(watch.compared for watch in watches.values() if watch.compared is not None)


def collect_overlapping_fixes(evidence: Iterable[Finding], state: Any) -> dict[str, tuple[NavEstimate, ...]]:
    """Return by receiver the fixes of chosen skies that overlapped with others, in order. state : of `Prediction`."""
    watches: dict[str, _Watch] = state or {}
    if not any(watch.overlapped for watch in watches.values()):
        return {}
    fixes: dict[str, tuple[NavEstimate, ...]] = {}
    for e in evidence:
        if e.detector == DETECTOR and (true := e.estimates.get("true_fixes")):
            receiver = e.signals[0].receiver
            fixes[receiver] = (*fixes.get(receiver, ()), *true)
    return fixes


@dataclass(frozen=True, eq=False, kw_only=True)
class _Expectation:
    """What is carried from window to window of what the true sky shows.

    until : the end of the windows that taught it; None before any. kind : of the signals whose clock is compared.
    bias_s : of the last fix that was taken for true.
    """

    predictor: Predictor
    until: np.datetime64 | None = None
    kind: Kind | None = None
    bias_s: float = 0.0

    def follow(self, fix: SkyFix, s: ConsistentSet) -> "_Expectation":
        return replace(self, predictor=self.predictor.followed(fix), bias_s=s.clock_bias_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Watch:
    """Over one receiver, window by window.

    clean_until : the end of the clean start. clean : its windows, as long as they are taken for true. learned : what
    was expected after windows that were taken for true, the latest first. learning : whether more may teach it.
    broken : the end of a window that broke the prediction. alone : signals of windows with one sky. pairs : signals of
    one transmission that were compared. hidden : signals that began near another one. attacked : a test showed an
    attack. named : other tests name its signals as true or false. chosen, refused : the signals of the skies called
    true and false last. walking : what is expected, once skies were compared.
    """

    clean_until: np.datetime64
    learned: tuple[_Expectation, ...]
    clean: tuple[SkyCandidates, ...] = ()
    learning: bool = True
    broken: np.datetime64 | None = None
    alone: frozenset[SignalRef] = frozenset()
    pairs: frozenset[Pair] = frozenset()
    hidden: frozenset[SignalRef] = frozenset()
    attacked: bool = False
    named: bool = False
    walking: _Expectation | None = None
    rests_on: _Data = field(default_factory=dict)
    chosen: frozenset[SignalId] = frozenset()
    refused: frozenset[SignalId] = frozenset()
    overlapped: bool = False
    compared: Compared | None = None

    @classmethod
    def begin(cls, o: Observations, expected: Predictor | CorrectedNavigator, clean_start_s: float) -> "_Watch":
        """Return a watch before the first window."""
        predictor = expected.predictor if isinstance(expected, CorrectedNavigator) else expected
        end: np.datetime64 = o.gpst[0] + timedelta_from_s(clean_start_s)
        return cls(clean_until=end, learned=(_Expectation(predictor=predictor),))

    def look(self, here: "_Here", *, doubted: bool, named: bool) -> "_Watch":
        """Return the watch after a window that names nothing. doubted : there is doubt of any receiver."""
        window = here.window
        new = [pair for pair in compare_pairs(here.maker.log) if pair not in self.pairs]
        refs = list_refs(here.maker.log.receiver, window.sets[0].signals) if len(window.sets) == 1 else ()
        watch = replace(
            self,
            pairs=self.pairs.union(new),
            hidden=self.hidden.union(pair.later for pair in new if pair.is_near),
            alone=self.alone.union(refs) if self.walking is None else self.alone,
            named=self.named or named,
            attacked=self.attacked or window.attacked,
            learning=self.learning and not doubted,
        )
        return here.learn(watch) if watch.learning and window.sets else watch


@dataclass(frozen=True, eq=False, kw_only=True)
class _Here:
    """One receiver in one window. navigator : of its inertial unit."""

    maker: FixMaker
    settings: PredictionSettings
    window: SkyCandidates
    navigator: CorrectedNavigator | None

    @property
    def log(self) -> Any:
        return self.maker.log

    def learn(self, watch: _Watch) -> _Watch:
        """Return the watch after a window that is taken for true; one that breaks the prediction ends that."""
        window, (only, *_) = self.window, self.window.sets
        in_clean_start = window.end <= watch.clean_until
        if self.navigator is not None:
            return replace(watch, clean=(*watch.clean, window)) if in_clean_start else watch
        now = watch.learned[0]
        now = replace(now, kind=now.kind or find_reference_kind(only), until=window.end)
        fix = self._fix(only, now)
        expected = now.predictor.at(fix.whole.gpst)
        if expected is not None:
            fix = align_clock(fix, expected)
            if not _is_continuation(expected, fix.whole):
                return replace(watch, learning=False, broken=window.end)
        if in_clean_start:
            now = replace(now, predictor=now.predictor.learned(fix), bias_s=only.clock_bias_s)
            return replace(watch, learned=(now, *watch.learned), clean=(*watch.clean, window))
        return replace(watch, learned=_thin_expectations((now.follow(fix, only), *watch.learned), watch.clean_until))

    def report_window(self, watch: _Watch) -> tuple[list[Finding], _Watch]:
        """Return what is said of the window, and the watch after it."""
        window = self.window
        if not watch.attacked:
            return [], watch
        found = list[Finding]()
        if watch.clean:
            found, watch = self._report_clean_start(watch), replace(watch, clean=())
        two = window.attacked and len(window.sets) > 1
        if watch.walking is None and (two or window.overlapping):
            watch = self._begin_walking(watch, self._date_second_sky(watch))
        if watch.walking is None:
            return found, watch
        walking = replace(watch.walking, predictor=watch.walking.predictor.until(window.start))
        watch = replace(watch, walking=walking)
        findings, watch = self._compare_skies(watch) if window.sets else ([], watch)
        if not findings:
            findings, watch = self._compare_overlapping(watch)
        return [*found, *findings], watch

    def _report_clean_start(self, watch: _Watch) -> list[Finding]:
        """Return that the windows of the clean start are authentic as assumed, unless one breaks the prediction."""
        clean = watch.clean
        if self.navigator is not None:
            clean = tuple(window for window in clean if window.start in self.navigator.early)
            from_start = (onset := self._date_second_sky(watch)) is not None and onset.from_start
            clean = () if from_start or self.navigator.until is None else clean
        elif watch.broken is not None and watch.broken <= watch.clean_until:
            clean = ()
        if not clean:
            return []
        rests_on = self._list_assumptions(watch, clean[-1].end, watch.learned[0].predictor.assumes)
        return [report_only_sky(self.log, window, window.end, "only_sky", rests_on) for window in clean]

    def _date_second_sky(self, watch: _Watch) -> Onset | None:
        """Return when the second sky of the window came; None while they have not parted."""
        groups = [list_refs(self.log.receiver, s.signals) for s in self.window.sets]
        skies = name_skies(groups, watch.alone)
        onsets = [onset for sky in skies if (onset := date_sky(sky, [self.log], watch.hidden)) is not None]
        return sorted(onsets, key=lambda onset: onset.seen)[1] if len(onsets) > 1 else None

    def _begin_walking(self, watch: _Watch, onset: Onset | None) -> _Watch:
        """Return the watch with what is expected by the time before the second sky; without where nothing was true."""
        if (navigator := self.navigator) is not None:
            from_start = onset is not None and onset.from_start
            if navigator.until is None or from_start or not self.settings.clean_start_s:
                return watch
            # A velocity that a drag has moved within a window, the navigator may have taken for a tilt.
            window_s = float(seconds_between(self.window.end, self.window.start))
            bounds = (navigator.hidden_m, navigator.hidden_m_s, navigator.hidden_m_s / window_s)
            walking = _Expectation(
                predictor=navigator.predictor.doubted(*(bound / _IN_SIGMAS for bound in bounds)),
                until=navigator.until,
                kind=navigator.kind,
                bias_s=navigator.bias_s,
            )
            if navigator.clean is not None:
                clean = replace(walking, predictor=navigator.clean, until=min(navigator.until, watch.clean_until))
                walking = min(walking, clean, key=self._measure_doubt)
        else:
            latest = self._find_latest(watch, onset)
            if watch.broken is not None and watch.broken <= latest:
                return watch
            walking = next(
                expectation for expectation in watch.learned if expectation.until is None or expectation.until <= latest
            )
        return replace(
            watch, walking=walking, rests_on=self._list_assumptions(watch, walking.until, walking.predictor.assumes)
        )

    def _measure_doubt(self, expectation: _Expectation) -> float:
        """Return the variance of where the receiver is expected at the window's start, m^2."""
        expected = expectation.predictor.at(self.window.start)
        return np.inf if expected is None else float(np.trace(expected.covariance[:3, :3]))

    def _find_latest(self, watch: _Watch, onset: Onset | None) -> np.datetime64:
        """Return until when the signals may be taken for true."""
        if onset is not None and onset.from_start:
            start: np.datetime64 = self.log.gpst[0] - timedelta_from_s(float(self.log.elapsed_s[0]))
            return start
        if onset is None or onset.earliest is None:
            return watch.clean_until
        # Until then every window has to go on.
        return onset.earliest if watch.broken is None or onset.earliest < watch.broken else watch.clean_until

    def _list_assumptions(
        self, watch: _Watch, until: np.datetime64 | None, assumes: tuple[str, ...]
    ) -> dict[str, Datum]:
        """Return the codes of what is assumed: of the windows before the second sky, and by what is expected."""
        if until is None:
            return {"assumes": assumes}
        concert = () if until <= watch.clean_until else ("no_concert",)
        return {"assumes": (*concert, "clean_start", *assumes), "clean_until": format_iso(until, 0)[11:]}

    def _compare_skies(self, watch: _Watch) -> tuple[list[Finding], _Watch]:
        """Return what is said of the skies that the receiver's channels follow."""
        window, now = self.window, watch.walking
        assert now is not None
        fixes = [self._fix(s, now) for s in window.sets]
        expected = now.predictor.at(fixes[0].whole.gpst)
        if expected is None:
            return [], watch
        fixes = [align_clock(fix, expected) for fix in fixes]
        if not set(expected.there).intersection(*(fix.whole.there for fix in fixes)):
            return [], watch
        if len(fixes) == 1:
            return self._check_alone(fixes[0], expected, watch)
        if not window.attacked:
            return [], watch
        by, most_wrong = now.predictor.by, self.settings.wrong_choice_probability
        choice, watch = self._compare(expected, fixes, watch)
        if choice.chosen is None or self._is_half_expected([fix.whole for fix in fixes], choice):
            return [report_not_chosen(self.log, window, window.sets, fixes, choice, by, most_wrong)], watch
        taken = window.sets[choice.chosen]
        first = not watch.chosen
        findings = chosen(self.log, window, fixes, choice, by, watch.rests_on, most_wrong=most_wrong, first=first)
        return findings, replace(
            watch,
            walking=now.follow(fixes[choice.chosen], taken),
            chosen=frozenset(taken.signals),
            refused=frozenset(signal for s in window.sets if s is not taken for signal in s.signals),
        )

    def _check_alone(self, fix: SkyFix, expected: NavEstimate, watch: _Watch) -> tuple[list[Finding], _Watch]:
        """Return what is said of a sky without another one beside it: it is taken if it was chosen before."""
        (only,), now = self.window.sets, watch.walking
        assert now is not None
        same = len(watch.chosen.intersection(only.signals)) >= POLICY.same_sky_share * len(only.signals)
        if not same or watch.refused.intersection(only.signals) or not _is_continuation(expected, fix.whole):
            return [], watch
        data = dict(watch.rests_on) | {"by": now.predictor.by}
        finding = report_only_sky(self.log, self.window, self.window.end, "goes_on", data)
        return [finding], replace(watch, walking=now.follow(fix, only), chosen=watch.chosen.union(only.signals))

    def _compare_overlapping(self, watch: _Watch) -> tuple[list[Finding], _Watch]:
        """Return what is said of the skies that were taken apart, instant by instant; it is said of the last one.

        That they are two skies, and not one and what happens to fit, is known of them: what is expected need not say
        all that they differ in. One that may have made the other by reflections is not chosen: then it may be the only
        sky, and false.
        """
        findings, true_fixes = list[Finding](), list[NavEstimate]()
        for skies in self.window.overlapping:
            now = watch.walking
            assert now is not None
            fixes = [self._fix_at_once(s, now) for s in skies.sets]
            expected = now.predictor.at(fixes[0].whole.gpst)
            if expected is None:
                continue
            fixes = [align_clock(fix, expected) for fix in fixes]
            if not set(expected.there).intersection(*(fix.whole.there for fix in fixes)):
                continue
            likeliest = int(np.argmax(choose(expected, [fix.whole for fix in fixes]).probabilities))
            doubt = skies.doubt + skies.reflected[likeliest]
            choice, watch = self._compare(expected, fixes, watch, doubt)
            by, most_wrong = now.predictor.by, self.settings.wrong_choice_probability
            if choice.chosen is not None:
                true = fixes[choice.chosen]
                true_fixes.append(true.whole)
                watch = replace(watch, walking=now.follow(true, skies.sets[choice.chosen]), overlapped=True)
                findings = [
                    report_chosen_overlapping(self.log, self.window, skies, fixes, choice, by, watch.rests_on, doubt)
                ]
            elif not true_fixes:
                findings = [report_not_chosen(self.log, self.window, skies.sets, fixes, choice, by, most_wrong, doubt)]
        if true_fixes:
            findings = [replace(findings[0], estimates={"true_fixes": tuple(true_fixes)})]
        return findings, watch

    def _compare(
        self, expected: NavEstimate, fixes: Sequence[SkyFix], watch: _Watch, doubt: float = 0.0
    ) -> tuple[Choice, _Watch]:
        """Return the choice, and the watch with it where none was made before.

        doubt : that these are not skies to choose from.
        """
        skies = tuple(fix.whole for fix in fixes)
        most_wrong = max(self.settings.wrong_choice_probability - doubt, 0.0)
        choice = choose(expected, skies, most_wrong=most_wrong, false_alarm_probability=POLICY.refused_probability)
        if watch.chosen or watch.overlapped or watch.walking is None:
            return choice, watch
        by = watch.walking.predictor.by
        compared = Compared(receiver=self.log.receiver, by=by, expected=expected, skies=skies, choice=choice)
        return choice, replace(watch, compared=compared)

    def _is_half_expected(self, skies: Sequence[NavEstimate], choice: Choice) -> bool:
        """Tell whether what is expected cannot choose: skies have parted in what is not predicted, and one may be
        chance.

        Then both may be false: one that is true in what is expected, and some true and false signals that fit together.
        """
        assert choice.chosen is not None
        taken, most_wrong = skies[choice.chosen], self.settings.wrong_choice_probability
        parted = any(are_parted_unseen(taken, sky, choice.used, probability=most_wrong) for sky in skies)
        fewest = min(len({signal.sat for signal in s.signals}) for s in self.window.sets)
        return parted and fewest < POLICY.no_chance_satellites

    def _fix(self, s: ConsistentSet, now: _Expectation) -> SkyFix:
        kind = now.kind or find_reference_kind(s)
        return self.maker.shown(self.window, s, kind=kind, bias_s=now.bias_s, epochs=now.predictor.moves)

    def _fix_at_once(self, s: ConsistentSet, now: _Expectation) -> SkyFix:
        """Return what a set of one instant shows."""
        kind = now.kind or find_reference_kind(s)
        fix = self.maker.shown(self.window, s, kind=kind, bias_s=now.bias_s, epochs=False)
        return replace(fix, each=(fix.whole,))


def _thin_expectations(learned: Sequence[_Expectation], clean_until: np.datetime64) -> tuple[_Expectation, ...]:
    """Return two expectations at most of any age to twice that age, and all of the clean start."""
    early = [expectation for expectation in learned if expectation.until is None or expectation.until <= clean_until]
    late = [
        (expectation.until, expectation)
        for expectation in learned
        if expectation.until is not None and expectation.until > clean_until
    ]
    newest = late[0][0]
    for number in range(len(late) - 2, 0, -1):
        if newest - late[number + 1][0] < 2 * (newest - late[number - 1][0]):
            del late[number]
    return (*(expectation for _, expectation in late), *early)


def _is_continuation(expected: NavEstimate, fix: NavEstimate) -> bool:
    """Tell whether a fix is no farther from what was expected than chance allows; also where nothing was expected."""
    if not set(expected.there).intersection(fix.there):
        return True
    return fit_p_value(expected, fix) >= POLICY.goes_on_probability
