"""What is suspected: the tests of a run that failed, and the signals that only a fault or a false one would explain."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.fusion.decide import WindowWord, select_common_causes
from skyproof.fusion.open_question import identify_reason
from skyproof.fusion.timeline import Onset, date_onset
from skyproof.fusion.unexplained import Kind, Unexplained
from skyproof.records import Finding, ObservationLog

__all__ = ["ODD", "Suspicion", "find_suspicion"]

ODD: tuple[Kind, ...] = ("rival", "misfit")
"""Kinds of unexplained signals that neither the sky nor an echo explains."""
_CAUSES: dict[Kind, tuple[str, ...]] = {"rival": ("fault",), "misfit": ("fault", "reflections")}


@dataclass(frozen=True, kw_only=True)
class Suspicion:
    """Signals that may be false.

    receivers : whose signals; onset : since when at the latest, None if that is not known. finding : of the test that
    failed; None where signals alone are odd. may_also_be : what else than an attack would explain it, on which the
    windows' words agree.
    """

    receivers: tuple[str, ...]
    onset: Onset | None
    finding: Finding | None
    may_also_be: tuple[str, ...]


def find_suspicion(
    evidence: Sequence[Finding],
    unexplained: Sequence[Unexplained],
    observations: Sequence[ObservationLog],
    words: Sequence[WindowWord],
) -> Suspicion | None:
    """Find what the failed tests of all windows and the unexplained signals make suspect; None if that is nothing.

    The test that overrules others gives the reason, then the one that failed in most windows, by the window in which
    it is least likely to have failed by chance.
    """
    failures: dict[tuple[str, str | None], _Failure] = {}
    receivers = set[str]()
    seen: np.datetime64 | None = None
    for e in evidence:
        if e.failed:
            key = identify_reason(e)
            failures[key] = failures[key].and_of(e) if key in failures else _Failure(1, e)
            receivers |= {ref.receiver for ref in e.signals}
            since = e.end_gpst if e.dated_gpst is None else e.dated_gpst
            seen = since if seen is None else min(seen, since)
    odd = [u for u in unexplained if u.kind in ODD]
    if not failures and not odd:
        return None
    ranked = sorted(failures.values(), key=_Failure.weight, reverse=True)
    worst = ranked[0].worst if ranked else None
    causes: list[str] = list(select_common_causes(word.causes for word in words if word.word == "suspect"))
    causes = causes or [cause for failure in ranked for cause in failure.worst.may_also_be]
    causes += [cause for u in odd for cause in _CAUSES[u.kind]]
    receivers |= {u.ref.receiver for u in odd}
    return Suspicion(
        receivers=tuple(o.receiver for o in observations if o.receiver in receivers),
        onset=_date_suspicion(seen, odd, observations),
        finding=worst,
        may_also_be=tuple(dict.fromkeys(causes)),
    )


@dataclass(frozen=True)
class _Failure:
    """A test that failed in so many windows. worst : the piece of the least p-value, the first of several."""

    windows: int
    worst: Finding

    def and_of(self, e: Finding) -> "_Failure":
        return _Failure(self.windows + 1, min(self.worst, e, key=_get_p_value))

    def weight(self) -> tuple[bool, int]:
        return self.worst.overrules, self.windows


def _get_p_value(e: Finding) -> float:
    return 1.0 if e.p_value is None else e.p_value


def _date_suspicion(
    seen: np.datetime64 | None, odd: Sequence[Unexplained], observations: Sequence[ObservationLog]
) -> Onset | None:
    """Return when a test failed first or an odd signal came, whichever was before.

    A test that fails dates what it sees, not how long that was there unseen.
    """
    came = date_onset([u.ref for u in odd if u.kind == "rival"], observations)
    if seen is None or (came is not None and came.seen < seen):
        return came
    return Onset(seen=seen, earliest=None)
