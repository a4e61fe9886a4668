"""Decide which signals come from one transmit antenna, and which from the sky: several receivers decide as groups.

In each receiver the signals that fit one position and clock form a set (`navigation.sets`). A pairing takes one set
from each receiver. Signals of one antenna have the same range difference between two receivers for every satellite.
Signals of the sky have the one that the baseline gives each satellite. So a pairing is

- of one antenna, if its between-satellite contrasts have zero mean (`one_antenna.one_antenna_test`);
- of the sky, if it is not, and if where it puts the antennas is possible;
- mixed, if it puts them where they cannot be.

One set in each receiver: rejecting "one antenna" proves that not all of them follow one transmitter, not that none
does. A transmitter that reaches some receivers only shows a baseline of its choice. So the signals are authentic only
if what is known of the antennas agrees (`known_geometry`). That is their places, their distance, or the baseline of
windows in which both skies were received. If "one antenna" cannot be rejected, rejecting "antennas so far apart" names
the signals false. Several sets in each: the pairing with the least contrast is the false one if every other is much
worse, by tests that need no law of the noise over time (`one_antenna.ratio_test`, `along_baselines.span_test`). The
other sets are authentic if these tests, or the one by the noise over time, reject one antenna for them. Decisions are
for whole groups.

The distance of the antennas in windows in which both skies were received holds after them, where none is given: when
the true sky is drowned, one antenna does not show it (`learnt`).

A window may stay open because its noise hides a baseline. Successive windows decide it together (`runs`), if it is
known how the antennas stand. Their decision is evidence of each window.

A group holds one kind of signal (time scale, band, code; `pairing`): each kind has its own delay in each receiver, and
each may be imitated alone. Kinds that show different places are different sets.

Assumed: one transmitter of one false sky, or several that do not act in concert. Nothing is assumed about its place,
the receivers it reaches, or the beginning of the attack. Receivers need share neither a clock nor satellites, and the
noise need not be white.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from skyproof.detectors.base import NotTested, Reporter, leave_open, signals_of
from skyproof.detectors.multi_receiver.further_signals import Rates, find_further_signals
from skyproof.detectors.multi_receiver.known_geometry import Fit, LearntBaseline, consistency_p_value
from skyproof.detectors.multi_receiver.learnt import LearntDistances
from skyproof.detectors.multi_receiver.one_set import decide_one_set
from skyproof.detectors.multi_receiver.over_time import decide_over_time
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.detectors.multi_receiver.runs import WindowRun
from skyproof.detectors.multi_receiver.same_direction import withhold_doubtful
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.multi_receiver.several_sets import BESIDE_FALSE_SKY, decide_several_sets
from skyproof.detectors.multi_receiver.statements import Statements
from skyproof.detectors.multi_receiver.window import Window
from skyproof.records import Baseline, Cause, Finding, Hypothesis, Need, Records

__all__ = ["MultiReceiver"]


class _Memory(NamedTuple):
    """What goes from window to window."""

    runs: tuple[WindowRun, ...]
    learnt: LearntDistances
    shown: Mapping[tuple[str, ...], Fit]


class MultiReceiver:
    """The detector: see the module's text. It remembers two minutes of what its pairings measured, and how far
    apart they put the antennas."""

    name = "multi_receiver"
    needs = (Need.TWO_RECEIVERS, Need.SETS)

    def __init__(self, settings: MultiReceiverSettings | None = None) -> None:
        self.settings = settings or MultiReceiverSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return findings of this window, and of those before it that it helps to decide; never raises for what data
        lack."""
        memory: _Memory = state or _Memory((), LearntDistances(), {})
        report = Reporter(self, records, Hypothesis.SKY_DIRECTIONS)
        lacking = report.name_missing()
        if lacking:
            return lacking, memory
        window = Window(report, self.settings.place_antennas(records), memory.learnt, memory.shown)
        found = _decide_groups(window)
        learnt = memory.learnt
        for e in found:
            if self._shows_true_baseline(e):
                learnt = learnt.and_of(e.baselines[0])
        late, runs = decide_over_time(window, memory.runs, found)
        found += late
        found += _find_further_signals(window, found) if window.skies else []
        return withhold_doubtful(records, window.skies, found), _Memory(runs, learnt, window.keep_shown())

    def review(self, findings: Sequence[Any]) -> Iterator[Any]:
        """Yield the findings of all windows again, revised by what the other windows show.

        Windows in which every receiver got both skies give the baseline. Others with the same baseline are authentic
        as well: a false sky in some of the receivers would have had to show the true place. A window with another
        baseline than most is open again, since true and false signals overlap while they separate.

        A contradiction stays open if the user's statement may as well be wrong (`statements`).
        """
        with_both_skies: dict[tuple[str, ...], list[Baseline]] = {}
        for e in findings:
            if self._shows_true_baseline(e):
                with_both_skies.setdefault(e.baselines[0].receivers, []).append(e.baselines[0])
        learnt = {receivers: self._learn_baseline(baselines) for receivers, baselines in with_both_skies.items()}
        statements = Statements(self.settings, (e for e in findings if e.detector == self.name))
        for e in findings:
            seen = self._review_one(e, learnt.get(e.baselines[0].receivers)) if self._is_own(e) else e
            yield statements.weigh(seen) if e.detector == self.name else seen

    def _is_own(self, e: Any) -> bool:
        return e.detector == self.name and bool(e.baselines)

    def _shows_true_baseline(self, e: Any) -> bool:
        """Tell if both skies were received in a window, and the true one shows a baseline."""
        return self._is_own(e) and e.code == BESIDE_FALSE_SKY and e.says == "authentic"

    def _learn_baseline(self, whole: Sequence[Baseline]) -> LearntBaseline | None:
        """Return the baseline that most of the windows agree on."""
        middle = LearntBaseline(
            replace(
                whole[0],
                enu_m=np.median([b.enu_m for b in whole], axis=0),
                covariance_m2=np.mean([b.covariance_m2 for b in whole], axis=0),
            )
        )
        agreeing = sum(consistency_p_value(middle, (b,)) >= self.settings.accept_probability for b in whole)
        return middle if agreeing > POLICY.agreeing_windows_share * len(whole) else None

    def _review_one(self, e: Finding, learnt: LearntBaseline | None) -> Finding:
        if learnt is None:
            return e
        p_value, data = consistency_p_value(learnt, e.baselines), {**e.data, **learnt.data}
        agrees = p_value >= self.settings.accept_probability
        if e.code == "one_may_be_false" and agrees:
            p_one: Any = e.data["p_one_antenna"]
            return replace(
                e,
                hypothesis=Hypothesis.ONE_ANTENNA,
                code="as_learnt",
                p={Cause.FALSE_SKY: p_one},
                data={**data, "assumes": ("no_concert", "one_false_sky", *learnt.assumes)},
            )
        if e.says == "authentic" and not agrees:
            failed = p_value < self.settings.false_alarm_probability
            causes = leave_open((Cause.REFLECTIONS, Cause.MOTION) if failed else (Cause.FALSE_SKY,))
            return replace(
                e,
                hypothesis=Hypothesis.SKY_DIRECTIONS if failed else Hypothesis.FALSE_SKY,
                code="elsewhere_than_learnt",
                p={Cause.CLEAN: p_value, **causes},
                data=data,
            )
        return e


def _decide_groups(window: Window) -> list[Finding]:
    """Return findings of sets as wholes, by this window alone."""
    observed = window.records.observations
    if len(window.sets) < 2:
        without = tuple(o.receiver for o in observed if o.receiver not in window.sets)
        return [window.report.pass_over(signals_of(observed), NotTested("one_set", {"without": without}))]
    if not window.pairings:
        return [window.report.pass_over(window.signals(), _explain_no_pairing(window))]
    if window.one_choice:
        # what is said last is reported
        by_size = sorted(window.pairings, key=lambda pairing: len(pairing.ranges.signals))
        return [e for pairing in by_size for e in decide_one_set(window, pairing)]
    return decide_several_sets(window)


def _explain_no_pairing(window: Window) -> NotTested:
    """Return whether satellites or epochs in common are what is missing."""
    least, receivers = window.settings.min_satellites, tuple(window.sets)
    sats = [{signal.sat for chosen in sets for signal in chosen.signals} for sets in window.sets.values()]
    n = len(set.intersection(*sats))
    if n < least:
        return NotTested("few_in_common", {"common": n, "needed": least, "receivers": receivers})
    epochs = window.settings.min_epochs
    return NotTested("few_common_epochs", {"needed": least, "epochs": epochs, "receivers": receivers})


def _find_further_signals(window: Window, said: Sequence[Finding]) -> list[Finding]:
    """Return what is false beside the skies that are true, signal by signal."""
    settings = window.settings
    rates = Rates(
        alarm=settings.false_alarm_probability,
        mistaken=settings.mistaken_probability,
        multipath_sigma_m=settings.multipath_sigma_m,
        unrelated_spread_m=settings.unrelated_spread_m,
    )
    spoofed = [(e, max(e.p.values())) for e in said if e.says == "spoofed"]
    named = {ref: p_value for e, p_value in spoofed for ref in e.signals}
    return [
        window.report.find(
            further.subject,
            further.code,
            {Cause.CLEAN: further.p_value, Cause.REFLECTIONS: further.p_value},
            hypothesis=Hypothesis.ONE_SKY,
            singled_out=True,
            data={"group": next(window.groups), "whole_sky": not further.together},
        )
        for further in find_further_signals(window.records, window.skies, window.sets, named, rates)
    ]
