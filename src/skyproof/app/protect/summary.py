"""What a run comes to, in some sentences."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from skyproof.app.protect.explanation import WordReason, describe_unexplained
from skyproof.app.protect.outcome import Outcome
from skyproof.app.protect.positions import sigmas_enu_m
from skyproof.app.protect.sources import describe_direction, describe_distance, describe_origin
from skyproof.explain import explain, stands_beside
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource
from skyproof.gnss.time import format_clock, format_iso
from skyproof.records import Finding
from skyproof.verdict import radius_95_m, write_word

__all__ = ["summarize"]


def summarize(outcome: Outcome, why: WordReason) -> str:
    """Return what a run comes to, why the word is no stronger, and what stands beside it."""
    words = _summary(outcome, why) + _describe_nulls(outcome) + _describe_beside(outcome) + _describe_left_out(outcome)
    return words[:1].upper() + words[1:]


def _summary(outcome: Outcome, why: WordReason) -> str:
    decision = outcome.decision
    going_on = {r.reception.source.name for r in outcome.receivers if r.has_rest_fixes}
    left = [u for u in decision.unexplained if u.kind != "misfit" or u.ref.receiver not in going_on]
    unexplained = f" {words}." if (words := describe_unexplained(left)) else ""
    if decision.verdict == "authentic":
        n = len({s.ref.signal.sat for s in decision.labels if s.label == "authentic"})
        kept = f" The {within}." if (within := _describe_accuracy(outcome)) else ""
        sign = (
            (f".{unexplained}" if unexplained else "; no sign of spoofing.")
            + _describe_missing_fixes(outcome)
            + _describe_times_alone(outcome)
        )
        return f"The signals of {n} satellites come from the sky{sign}{_describe_copies(outcome)}{kept}"
    if decision.verdict in ("suspect", "no_attack_seen"):
        rest = "" if why.of_unexplained else unexplained
        passed = "" if decision.verdict == "suspect" else "every test that could run passed, but "
        return f"{passed}{why.reason or ''}.{rest}{_describe_missing_fixes(outcome)}{_describe_copies(outcome)}"
    return _attack_words(outcome) + unexplained + _describe_missing_fixes(outcome) + _describe_copies(outcome)


def _attack_words(outcome: Outcome) -> str:
    decision = outcome.decision
    since = _since(decision)
    if decision.sources:
        sats = {s.signal.sat for source in decision.sources for s in source.signals}
        n = _count_transmitters(decision.sources)
        by = "one transmitter" if n == 1 else f"{n} transmitters" if n else "a second sky beside the true one"
        if n < len([source for source in decision.sources if source.one_antenna]):
            by += " or more"
        if n == 1 and len(decision.sources) == 1:
            by += describe_direction(describe_origin(decision.sources[0], outcome))
            by += describe_distance(outcome.bearings.get(decision.sources[0].name))
        kept = f"the {within}" if (within := _describe_accuracy(outcome)) else ""
        if not kept and any(r.has_rest_fixes for r in outcome.receivers):
            kept = "no test rejects the position that the other signals give"
        were = "satellite was" if len(sats) == 1 else "satellites were"
        return f"{since}{len(sats)} {were} imitated by {by}{f'; {kept}' if kept else ''}."
    if decision.skies:
        return (
            f"{since}two or more skies are received, each with a position and time of its own; "
            "no test could decide which of them is true."
        )
    return f"{since}some of the received signals cannot be authentic; no test could decide which of them are true."


def _count_transmitters(sources: Sequence[FalseSource]) -> int:
    """Count the transmitters that there are at least.

    Signals of different kinds may still come from one transmitter, so the most of one kind count.
    """
    kinds = Counter(
        kind for source in sources if source.one_antenna for kind in {ref.signal.kind for ref in source.signals}
    )
    return max(kinds.values(), default=0)


def _describe_missing_fixes(outcome: Outcome) -> str:
    """State for how long receivers without a fix could not have been misled."""
    together: dict[str, list[str]] = {}
    for receiver, seconds in outcome.decision.without_fix_s:
        together.setdefault(f"{seconds:.0f}", []).append(receiver)
    return "".join(
        f" For {seconds} s {' and '.join(receivers)} received too few signals for a position."
        for seconds, receivers in together.items()
    )


def _describe_nulls(outcome: Outcome) -> str:
    """State what arrays receive behind a null."""
    words = ""
    for r in outcome.receivers:
        behind = None if r.positions is None else r.positions.behind_null
        if behind is None:
            continue
        name, source_db = r.reception.source.name, 10.0 * np.log10(behind.source_to_noise)
        words += f" A source {source_db:.0f} dB above the noise of an antenna was taken out of the samples of {name}"
        if not r.has_fixes_behind_null:
            said = "" if behind.word == "no_attack_seen" else f" (its signals are {write_word(behind.word)})"
            words += f", but no position may be used behind this null either{said}."
            continue
        cost = "" if behind.cost_db is None else f"; C/N0 is {behind.cost_db:.1f} dB lower there than without a source"
        words += (
            f": behind this null a consistent position lasts for {behind.seconds:.0f} s, which no test rejects{cost}."
        )
    return words


def _describe_times_alone(outcome: Outcome) -> str:
    """State for how long receivers were recorded without the others, which the word leaves out."""
    return "".join(
        f" The verdict does not cover {seconds:.0f} s in which {receiver} was recorded and another receiver was not."
        for receiver, seconds in outcome.decision.alone_s
    )


MOST_NOTED = 2


def _describe_beside(outcome: Outcome) -> str:
    """Name what stands beside the verdict, whatever it is, each sentence once."""
    noted: dict[tuple[Any, ...], Finding] = {}
    for e in outcome.evidence:
        if stands_beside(e):
            key = (e.detector, e.code, *sorted({ref.receiver for ref in e.signals}))
            noted.setdefault(key, e)
    in_order = sorted(noted.values(), key=lambda e: e.says == "attack")
    sentences = list(dict.fromkeys(explain(e).sentence for e in in_order))
    more = (
        f" The evidence lists {len(sentences) - MOST_NOTED} more such moments." if len(sentences) > MOST_NOTED else ""
    )
    return "".join(f" {text[:1].upper()}{text[1:]}." for text in sentences[:MOST_NOTED]) + more


def _describe_copies(outcome: Outcome) -> str:
    """Name late copies of a whole sky for what they are."""
    words = []
    for r in outcome.receivers:
        name = r.reception.source.name
        late = {s.ref.signal.sat for s in outcome.decision.labels if s.ref.receiver == name and s.label == "multipath"}
        if late:
            words.append(f"{len(late)} satellites in {name}")
    if not words:
        return ""
    return (
        f" The signals of {' and '.join(words)} are received twice, the second time later and weaker, as from a "
        "repeater or a reflector; they show no other position."
    )


def _describe_left_out(outcome: Outcome) -> str:
    """Name the receivers that had no part in the decision, where others had."""
    receptions = [r.reception for r in outcome.receivers if r.reception.left_out is not None]
    if len(receptions) == len(outcome.receivers):
        return ""
    words = "".join(
        f" {r.source.name} holds the same noise as {r.same_as}: one antenna or file, recorded twice. The two count as "
        "one receiver."
        for r in receptions
        if r.same_as is not None
    )
    names = [r.source.name for r in receptions if r.same_as is None]
    if names:
        words += f" {' and '.join(names)} gave no measurements (the remarks on the inputs say why)."
    return words


def _since(decision: Decision) -> str:
    onset = decision.onset
    if onset is None:
        return ""
    clock = format_clock(format_iso(onset.seen if onset.earliest is None else onset.gpst, 0))
    if onset.from_start:
        return f"From the start of the recording, {clock}, "
    return f"From {clock} on, " if onset.earliest is not None else f"From {clock} at the latest, "


def _describe_accuracy(outcome: Outcome) -> str:
    """State how far trusted positions are reliable: the largest 95 % horizontal radius of the last fixes."""
    radii = []
    for r in outcome.receivers:
        if (track := r.tracks.get("trusted")) is not None:
            east, north, _ = sigmas_enu_m(track.last)
            radii.append(radius_95_m(east, north))
    return f"true position is known to within {max(radii):.1f} m horizontally (95 %)" if radii else ""
