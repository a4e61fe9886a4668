"""The one loop, of files and of what comes live: windows in, what the tests find and the words so far out."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from heapq import merge
from itertools import groupby
from typing import Any, TypeVar

import numpy as np

from skyproof.app.common.body import Carried, body_states
from skyproof.app.common.epoch_source import EpochSource
from skyproof.app.common.packed_log import PACKED, PackedLog
from skyproof.app.common.progress import Progress
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import Windows, find_tier, instantiate_detectors, windows_of
from skyproof.detectors.base import Detector
from skyproof.detectors.prediction.inertia import list_navigators
from skyproof.detectors.registry import examine_window, instantiate, review_evidence
from skyproof.fusion.decide import Deciding, decide, weigh
from skyproof.gnss.time import seconds_between
from skyproof.interruption import watch
from skyproof.navigation.predictor import Predictor
from skyproof.records import ConsistentSet, Finding, NavigationData, Records

__all__ = ["DecidedWindow", "Session", "examine_all", "open_session", "reviewed"]

H = TypeVar("H", bound=Hashable)


@dataclass(frozen=True, eq=False, kw_only=True)
class DecidedWindow:
    """One window: its records, what was found in it, and what is decided so far."""

    records: Records
    findings: tuple[Finding, ...]
    deciding: Deciding


@dataclass(eq=False)
class Session:
    """Examine and decide windows in order of time, in bounded state.

    windows : of a run, as they become complete. detectors : with the error rate of a whole window; a shorter one gets
    less, so that the budget is paid by time. Those that need what others find come after them.
    """

    windows: Windows
    detectors: Sequence[Detector]
    _states: Mapping[str, Any] = field(default_factory=dict)
    _deciding: Deciding = field(default_factory=Deciding)
    _carried: Carried = field(default_factory=Carried)

    def state_of(self, name: str) -> Any:
        """Return what a detector remembers; None before the first window."""
        return self._states.get(name)

    def steps(self) -> Iterator[DecidedWindow]:
        """Yield each window that is complete and was not given before."""
        for records in self.windows:
            share = seconds_between(records.end_gpst, records.start_gpst) / self.windows.window_s
            receivers = [o.receiver for o in records.observations]
            findings = list[Finding]()
            states = dict(self._states)
            if (body := self.windows.run.body) is not None:
                navigators = list_navigators(states.get("inertia"))
                nav_state, self._carried = body_states(body, records, self._carried, navigators)
                records = replace(records, nav_state=nav_state)
            for _, tier in groupby(_share_alpha(self.detectors, float(share)), find_tier):
                findings += filter(None, (weigh(findings, receiver) for receiver in receivers))
                expected = {**records.expected, **list_navigators(states.get("inertia"))}
                records = replace(records, findings=tuple(findings), expected=expected)
                for detector in tier:
                    found, states[detector.name] = examine_window(detector, records, states.get(detector.name))
                    findings += found
            self._states = states
            now = [e for e in findings if e.start_gpst == records.start_gpst]  # some are of windows before
            self._deciding, together = decide(self._deciding, now, receivers, records.start_gpst, records.end_gpst)
            yield DecidedWindow(records=records, findings=(*findings, *together), deciding=self._deciding)


def _share_alpha(detectors: Sequence[Detector], share: float) -> Sequence[Detector]:
    """Return the detectors with a share of their false-alarm probability; a whole one at most."""
    if not 0.0 < share < 1.0:  # a run without epochs has one window without times
        return detectors
    rates = [share * detector.settings.false_alarm_probability for detector in detectors]
    return [
        instantiate(type(detector), replace(detector.settings, false_alarm_probability=rate))
        for detector, rate in zip(detectors, rates, strict=True)
    ]


def open_session(
    sources: Sequence[EpochSource],
    navigation: NavigationData,
    settings: Settings,
    predictors: Mapping[str, Predictor] | None = None,
) -> Session:
    """Return a session of receivers whose epochs come in, with every installed detector.

    sources : one a receiver. navigation : orbits that hold while the session lasts. settings : a window (`window_s`)
        holds five epochs or more of each receiver. predictors : what is expected of receivers that stand or have an
        inertial unit, by receiver.
    """
    windows = windows_of(sources, navigation, settings, predictors=predictors)
    return Session(windows, instantiate_detectors(settings, windows.run))


def reviewed(detectors: Sequence[Detector], evidence: Sequence[Finding]) -> Sequence[Finding]:
    """Return the evidence of all windows, after each detector with a method `review` looked at it once more."""
    seen = evidence
    for detector in detectors:
        if (after := review_evidence(detector, seen)) is not seen:
            seen = PackedLog(after)
    return seen


def examine_all(
    session: Session, progress: Progress, take: Callable[[DecidedWindow], None] | None = None
) -> tuple[Sequence[Finding], Sequence[ConsistentSet], bool]:
    """Return the evidence of all windows, the sets found in them, and whether a signal left windows out.

    take : is called with each window as it comes.
    """
    evidence, sets = _Kept(), PackedLog[ConsistentSet]()
    interrupted, cut_short = watch(), False
    total = len(session.windows)
    with progress.stage("examining the signals, window by window", total) as stage:
        for number, step in enumerate(session.steps(), 1):
            evidence.take(step)
            if take is not None:
                take(step)
            sets.extend(step.records.sets)
            stage.advance(number)
            if interrupted() and number < total:
                cut_short = True
                break
    return reviewed(session.detectors, evidence.merge_in_order()), sets, cut_short


class _Kept:
    """Evidence in little memory: what is equal in windows that follow each other is kept once, and that a test cannot
    run is said once in a row.
    """

    def __init__(self) -> None:
        self.all = PackedLog[Finding]()
        self._same: dict[Hashable, Any] = {}
        self._before: list[Finding] = []
        self._lacking: set[Hashable] = set()

    def take(self, step: DecidedWindow) -> None:
        """Take the evidence of one more window."""
        lacking = set[Hashable]()
        for finding in step.findings:
            if finding.start_gpst < step.records.start_gpst:
                self._before.append(finding)
                continue
            subject = self._same.get(finding.signals) or self._share_equal(
                tuple(self._share_equal(ref) for ref in finding.signals)
            )
            if finding.lacking:
                key = finding.detector, subject, finding.lacking
                lacking.add(key)
                if key in self._lacking:
                    continue
            self.all.extend((replace(finding, signals=subject),))
        self._lacking = lacking
        if len(self._same) > PACKED:  # words with figures in them hardly ever come again
            self._same.clear()

    def merge_in_order(self) -> Sequence[Finding]:
        """Return all evidence in the order of its windows."""
        return PackedLog(merge(self.all, self._before, key=_get_window)) if self._before else self.all

    def _share_equal(self, value: H) -> H:
        kept: H = self._same.setdefault(value, value)
        return kept


def _get_window(e: Finding) -> tuple[np.datetime64, np.datetime64]:
    return e.start_gpst, e.end_gpst
