"""What a decision leaves open: whose signals, why (the reason that matters for the whole run), and the remedy."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.records import Baseline, Evidence, ObservationLog

__all__ = ["OpenQuestion", "measured_distance_m", "open_question"]


@dataclass(frozen=True, kw_only=True)
class OpenQuestion:
    """receivers: whose signals are open; why: in words; remedy: what would settle it, if anything is known to."""

    receivers: tuple[str, ...]
    why: str | None
    remedy: str | None

    @property
    def about(self) -> str:
        return f"which signals of {', '.join(self.receivers)} are true"


def open_question(
    evidence: Sequence[Evidence], observations: Sequence[ObservationLog], trusted: set[str]
) -> OpenQuestion:
    """The reason that left most of the time open, of tests that ran before those that could not; first of all what
    overrules other tests.

    The windows' sentences differ by their numbers; the same test with the same remedy is the same reason, and the
    window that was compared last speaks for all of them.
    """
    groups: dict[tuple[str, str | None], list[Evidence]] = defaultdict(list)
    for e in evidence:
        if e.says == "undecided" or (e.says == "attack" and e.would_need):
            groups[e.detector, e.would_need].append(e)
    open_receivers = tuple(o.receiver for o in observations if o.receiver not in trusted)
    ran = {key: own for key, own in groups.items() if any(_compared(e) for e in own)}
    if not ran:
        return OpenQuestion(receivers=open_receivers, why=None, remedy=None)
    attacked = any(e.says in ("attack", "spoofed") for e in evidence)
    chosen = max(ran.values(), key=lambda own: _weight(own, attacked))
    *before, last = [e for e in chosen if _compared(e)]
    remedy = last.would_need
    far = measured_distance_m([b for e in chosen for b in e.baselines[:1]])
    if remedy is not None and far is not None:
        remedy += f"; these signals come from the sky if the antennas stand {far[0]:.1f} ± {far[1]:.1f} m apart"
    others = _kinds([e for e in before if e.start_gpst == last.start_gpst]) - _kinds([last])
    why = last.because + (f"; the same holds for {', '.join(sorted(others))}" if others else "")
    return OpenQuestion(receivers=open_receivers, why=why, remedy=remedy)


def _kinds(evidence: Sequence[Evidence]) -> set[str]:
    """The kinds of signal that were tested: system, band and code."""
    return {f"{ref.signal.sat[0]} {ref.signal.band} {ref.signal.code}" for e in evidence for ref in e.subject}


def measured_distance_m(baselines: Sequence[Baseline]) -> tuple[float, float] | None:
    """Distance of two antennas by all windows, and its sigma; None for none, or more than two receivers.

    Errors that stay from window to window do not average out: the sigma is that of one window.
    """
    pairs = [b.distances_m[0] for b in baselines if len(b.receivers) == 2]
    if not pairs:
        return None
    return float(np.mean([d for d, _ in pairs])), float(np.median([s for _, s in pairs]))


def _weight(own: Sequence[Evidence], attacked: bool) -> tuple[bool, int, bool]:
    """Under an attack it is no wonder that nothing goes on as it was: that is not what leaves the signals open."""
    overrules = any(e.overrules and e.failed for e in own)
    return overrules != attacked, sum(_compared(e) for e in own), own[0].would_need is not None


def _compared(e: Evidence) -> bool:
    """Whether the test had something to look at: it gives a p-value, or compared signals of several receivers."""
    return e.p_value is not None or (not e.lacking and len({ref.receiver for ref in e.subject}) > 1)
