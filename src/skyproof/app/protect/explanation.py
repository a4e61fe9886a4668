"""Why the word of a run is no stronger, what would have passed unseen, and what to give."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from skyproof.app.protect.outcome import Outcome
from skyproof.app.receive.observed import ObservedFile
from skyproof.detectors.base import NEEDS
from skyproof.explain import explain
from skyproof.explain.entry import join
from skyproof.fusion.unexplained import Kind, Unexplained
from skyproof.records import (
    CauseName,
    Need,
)

__all__ = ["WordReason", "describe_unexplained", "explain_word", "why_untested"]


_UNSEEN: dict[Need, str] = {
    Need.NAVIGATION: "any false position and time, as no position was computed for lack of orbits",
    Need.SETS: "a false position, as there are too few satellites to compare their ranges",
    Need.CCAF: "a second signal within a chip (300 m) of the true one, which only samples show",
}
"""Attacks that pass unseen where records are lacking."""


UNRANGED = "any false position and time without a jump, as the log holds no ranges"


RANGES = "the receiver's measurements with ranges (UBX-RXM-RAWX, SBF MeasEpoch, RTCM MSM7)"
"""What a log of fixes and C/N0 alone does not show, and what would."""


GIVEN = (Need.NAVIGATION, Need.TWO_RECEIVERS, Need.SETS, Need.ARRAY_PHASES, Need.NAV_STATE, Need.SPIN_ARMS)
"""Records that users can bring, the easiest first; the others are the receiver's own affair."""


MOST_CURES = 2


PREDICTS = (
    'a platform file that says where the receiver is or how it moves: that it stands still (motion = "static"), its '
    "surveyed position, its oscillator, or an inertial unit"
)


@dataclass(frozen=True, kw_only=True)
class WordReason:
    """Why the word is no stronger, and what belongs to that, as the document's keys have it.

    of_unexplained : the reason tells of the signals that could not be explained.
    """

    reason: str | None
    of_unexplained: bool = False
    may_also_be: tuple[CauseName, ...] = ()
    not_excluded: tuple[str, ...] = ()
    remedy: str | None = None


def explain_word(outcome: Outcome) -> WordReason:
    """Return why the word of a run is no stronger, from the finding that matters most."""
    decision = outcome.decision
    unexplained = describe_unexplained(decision.unexplained)
    if decision.suspicion is not None:
        found = decision.suspicion
        words = None if found.finding is None else explain(found.finding)
        to_do = (words and words.remedy) or _suggest_remedy(outcome) or "a longer recording"
        causes: Any = tuple(str(cause) for cause in found.may_also_be)
        reason = words.sentence if words else unexplained
        return WordReason(reason=reason, of_unexplained=words is None, may_also_be=causes, remedy=to_do)
    question = decision.open
    if question is None:
        return WordReason(reason=None)
    names = join(question.receivers)
    about = f"which signals of {names} are true"
    why = unexplained or "none of these tests can decide"
    remedy = _suggest_remedy(outcome) or ("a longer recording" if unexplained else None)
    if question.finding is not None:
        words = explain(question.finding)
        why, remedy = words.sentence, words.remedy or _suggest_remedy(outcome) or None
        why += f"; the same holds for {join(question.also)}" if question.also else ""
        if remedy is not None and question.distance_m is not None:
            distance_m, sigma_m = question.distance_m
            remedy += (
                f"; if the antennas stand {distance_m:.1f} ± {sigma_m:.1f} m apart, these signals come from the sky"
            )
    because = f": {why}" if unexplained or question.finding is not None else ""
    if decision.verdict == "spoofed":
        return WordReason(reason=f"{about}: {why}", remedy=remedy)
    return WordReason(
        reason=f"none of these tests can prove the signals of {names} authentic{because}",
        of_unexplained=question.finding is None,
        not_excluded=_list_unseen_attacks(outcome),
        remedy=remedy,
    )


def _list_unseen_attacks(outcome: Outcome) -> tuple[str, ...]:
    """List attacks that tests which all passed would not see, by what was received and what was missing."""
    ran = {e.detector for e in outcome.evidence if e.p_value is not None}
    lacking = {need for e in outcome.evidence if e.detector not in ran for need in e.lacking}
    found = [words for need, words in _UNSEEN.items() if need in lacking]
    if _has_no_ranges(outcome):
        found = [UNRANGED, _UNSEEN[Need.CCAF]]
    receivers = [r for r in outcome.receivers if r.reception.left_out is None]
    by_directions = not {Need.ARRAY_PHASES, Need.SPIN_ARMS} <= lacking
    if len(receivers) > 1:
        found.append("a false sky that reaches only one of the receivers")
    elif not by_directions:
        found.append("a false sky present from the start, which one antenna cannot tell from the true one")
    done = ran | {e.detector for e in outcome.evidence if e.lacking}
    reasons = {(e.detector, e.code): e for e in outcome.evidence if e.detector not in done}
    idle = {e.detector for e in reasons.values() if explain(e).remedy not in (None, "nothing")}
    found += [f"what {join(sorted(idle))} would find, given more data"] if idle else []
    return (*found, "an attack that drags position and time too slowly for these tests")


def why_untested(outcome: Outcome) -> str | None:
    """Explain why no test at all could run, and what to give; None if any did."""
    if outcome.decision.verdict == "spoofed" or any(e.p_value is not None for e in outcome.evidence):
        return None
    receptions = [r.reception for r in outcome.receivers]
    reasons: list[str] = [
        f"{r.source.path or r.source.name}: {r.left_out}" for r in receptions if r.left_out is not None
    ]
    if len(reasons) < len(receptions):
        names = [r.source.path or r.source.name for r in receptions if r.left_out is None]
        remedy = _suggest_remedy(outcome) or "a longer recording"
        reasons.append(f"{', '.join(names)}: no test could run on what was received; give {remedy}")
    return "; ".join([*reasons, *(words for r in receptions for words in (*r.source.remarks, *r.remarks))])


def _suggest_remedy(outcome: Outcome) -> str:
    """Describe what the user could add that was missing; with two open skies, first what says where he is."""
    lacking = {need for e in outcome.evidence for need in e.lacking}
    remedies = (explain(e).remedy for e in outcome.evidence if e.says in ("spoofed", "attack"))
    suggested = [remedy for remedy in remedies if remedy is not None]
    cures = [*dict.fromkeys(suggested), *(NEEDS[need] for need in GIVEN if need in lacking)]
    if _has_no_ranges(outcome):
        cures.insert(0, RANGES)
    if outcome.decision.skies and Need.NAVIGATION not in lacking:
        cures.insert(0, PREDICTS)
    return ", or ".join(cures[:MOST_CURES])


def _has_no_ranges(outcome: Outcome) -> bool:
    """Test whether no receiver gave ranges."""
    sources = [r.reception.source for r in outcome.receivers]
    return all(isinstance(source, ObservedFile) and not source.ranged for source in sources)


_EXPLAINS: dict[Kind, str] = {
    "double": "beside another signal of the satellite, as an echo or a false signal would be",
    "rival": "earlier or stronger than a true signal of the satellite, as a false signal would be",
    "misfit": "in conflict with the others, as a fault, an echo alone or a false signal would be",
    "echo": "later and weaker than a true signal of the satellite, as an echo would be",
    "untested": "not comparable: too short, too similar to others, or received by one receiver only",
}


def describe_unexplained(left: Sequence[Unexplained]) -> str:
    """Return how many signals stay unknown, how strong, and what would explain them; empty if there are none."""
    words_of_kinds = []
    for kind, words in _EXPLAINS.items():
        signals = [u for u in left if u.kind == kind]
        if not signals:
            continue
        over = [u.over_db for u in signals if u.over_db is not None and np.isfinite(u.over_db)]
        levels = [u.cn0_dbhz for u in signals if np.isfinite(u.cn0_dbhz)]
        strong = f"up to {max(levels):.0f} dB-Hz" if levels else "of unknown strength"
        if over:
            strong += f", {abs(max(over)):.0f} dB {'above' if max(over) > 0.0 else 'below'} the other"
        words_of_kinds.append(f"{len(signals)} {words} ({strong})")
    if not words_of_kinds:
        return ""
    n = len(left)
    return f"{n} more signal{'s' if n > 1 else ''} could not be explained: {'; '.join(words_of_kinds)}"
