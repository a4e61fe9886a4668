"""Whose signals are not shown to be true, why (the reason that matters for the whole run), and the remedy."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skyproof.records import Evidence, ObservationLog

__all__ = ["OpenQuestion", "open_question"]


@dataclass(frozen=True, kw_only=True)
class OpenQuestion:
    """receivers: whose signals are open; why: in words, None if nothing was compared; remedy: what would settle it, if
    anything is known to."""

    receivers: tuple[str, ...]
    why: str | None
    remedy: str | None


def open_question(
    evidence: Sequence[Evidence], observations: Sequence[ObservationLog], trusted: set[str]
) -> OpenQuestion:
    """The reason that left most of the time open, of tests that ran before those that could not. Under an attack it is
    no wonder that nothing goes on as it was, so what overrules other tests is the last of the reasons.

    The windows' sentences differ by their numbers; the same test with the same remedy is the same reason, and the
    window that was compared last speaks for all of them.
    """
    reasons: dict[tuple[str, str | None], _Reason] = defaultdict(_Reason)
    for e in evidence:
        if e.says == "undecided" or (e.says == "attack" and e.would_need):
            reasons[e.detector, e.would_need].add(e)
    open_receivers = tuple(o.receiver for o in observations if o.receiver not in trusted)
    ran = [reason for reason in reasons.values() if reason.compared]
    if not ran:
        return OpenQuestion(receivers=open_receivers, why=None, remedy=None)
    chosen = max(ran, key=_Reason.weight)
    *before, last = chosen.latest
    remedy = last.would_need
    far = _distance_m(chosen.distances)
    if remedy is not None and far is not None:
        remedy += f"; these signals come from the sky if the antennas stand {far[0]:.1f} ± {far[1]:.1f} m apart"
    others = _kinds(before) - _kinds([last])
    why = last.because + (f"; the same holds for {', '.join(sorted(others))}" if others else "")
    return OpenQuestion(receivers=open_receivers, why=why, remedy=remedy)


@dataclass(kw_only=True)
class _Reason:
    """Undecided pieces of evidence of one test with one remedy.

    compared : how many had something to look at; latest : of these those of the last window. distances : of two
    antennas and its sigma, metres, by each piece over its whole window. overrules : whether a failed one overrules
    other tests.
    """

    compared: int = 0
    latest: list[Evidence] = field(default_factory=list)
    distances: list[tuple[float, float]] = field(default_factory=list)
    overrules: bool = False
    has_remedy: bool = False

    def add(self, e: Evidence) -> None:
        self.distances += [b.distances_m[0] for b in e.baselines[:1] if len(b.receivers) == 2]
        self.overrules |= e.overrules and e.failed
        self.has_remedy = e.would_need is not None
        if _compared(e):
            self.compared += 1
            self.latest = [*(one for one in self.latest if one.start_gpst == e.start_gpst), e]

    def weight(self) -> tuple[bool, int, bool]:
        return not self.overrules, self.compared, self.has_remedy


def _kinds(evidence: Sequence[Evidence]) -> set[str]:
    """The kinds of signal that were tested: system, band and code."""
    return {f"{ref.signal.sat[0]} {ref.signal.band} {ref.signal.code}" for e in evidence for ref in e.subject}


def _distance_m(distances: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Distance of two antennas by all windows, and its sigma; None where no window shows it.

    Errors that stay from window to window do not average out: the sigma is that of one window.
    """
    if not distances:
        return None
    return float(np.mean([d for d, _ in distances])), float(np.median([s for _, s in distances]))


def _compared(e: Evidence) -> bool:
    """Whether the test had something to look at: it gives a p-value, or compared signals of several receivers."""
    return e.p_value is not None or (not e.lacking and len({ref.receiver for ref in e.subject}) > 1)
