"""Whose signals are not shown to be true, and the finding that says why: the one that matters for the whole run."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skyproof.records import Finding, ObservationLog

__all__ = ["OpenQuestion", "identify_reason", "open_question"]


@dataclass(frozen=True, kw_only=True)
class OpenQuestion:
    """Signals that are open, and why.

    receivers : whose signals. finding : that left them open, None if nothing was compared. also : further kinds of
    signals (system, band, code) that the same holds for. distance_m : of two antennas, by these signals, and its sigma.
    """

    receivers: tuple[str, ...]
    finding: Finding | None = None
    also: tuple[str, ...] = ()
    distance_m: tuple[float, float] | None = None


def identify_reason(finding: Finding) -> tuple[str, str]:
    """Return what findings for one reason share: windows differ by their numbers."""
    return finding.detector, finding.code


def open_question(
    evidence: Sequence[Finding], observations: Sequence[ObservationLog], trusted: set[str]
) -> OpenQuestion:
    """Return the reason that left most of the time open, of tests that ran before those that could not.

    Under an attack continuity is expected to fail, so what overrules other tests is the last of the reasons. The window
    that was compared last speaks for all that have its reason.
    """
    reasons: dict[tuple[str, str, str], _Reason] = defaultdict(_Reason)
    for e in evidence:
        if e.says in ("undecided", "attack"):
            reasons[*identify_reason(e), e.says].add(e)
    open_receivers = tuple(o.receiver for o in observations if o.receiver not in trusted)
    compared = [reason for reason in reasons.values() if reason.compared]
    ran = [reason for reason in compared if not reason.attack] or compared
    if not ran:
        return OpenQuestion(receivers=open_receivers)
    chosen = max(ran, key=_Reason.weight)
    *before, last = chosen.latest
    return OpenQuestion(
        receivers=open_receivers,
        finding=last,
        also=tuple(sorted(_list_kinds(before) - _list_kinds([last]))),
        distance_m=_average_distance_m(chosen.distances),
    )


@dataclass(kw_only=True)
class _Reason:
    """Undecided findings of one test for one reason.

    compared : how many had something to look at; latest : of these those of the last window. distances : of two
    antennas and its sigma, metres, by each finding over its whole window. overrules : whether a failed one overrules
    other tests. attack : they show an attack, and leave open which signals are true.
    """

    compared: int = 0
    latest: list[Finding] = field(default_factory=list)
    distances: list[tuple[float, float]] = field(default_factory=list)
    overrules: bool = False
    attack: bool = False

    def add(self, e: Finding) -> None:
        self.distances += [b.distances_m[0] for b in e.baselines[:1] if len(b.receivers) == 2]
        self.overrules |= e.overrules and e.failed
        self.attack = e.says == "attack"
        if _has_compared(e):
            self.compared += 1
            self.latest = [*(statement for statement in self.latest if statement.start_gpst == e.start_gpst), e]

    def weight(self) -> tuple[bool, int]:
        return not self.overrules, self.compared


def _list_kinds(evidence: Sequence[Finding]) -> set[str]:
    """List the kinds of signal that were tested: system, band and code."""
    return {f"{ref.signal.sat[0]} {ref.signal.band} {ref.signal.code}" for e in evidence for ref in e.signals}


def _average_distance_m(distances: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Average the distance of two antennas over all windows, with its sigma; None where no window shows it.

    Errors that stay from window to window do not average out: the sigma is that of one window.
    """
    if not distances:
        return None
    return float(np.mean([d for d, _ in distances])), float(np.median([s for _, s in distances]))


def _has_compared(e: Finding) -> bool:
    """Tell whether the test had something to look at: it gives a p-value, or compared signals of several receivers."""
    return e.p_value is not None or (not e.lacking and len({ref.receiver for ref in e.signals}) > 1)
