"""All evidence to one decision.

The words are never stronger than the evidence: *spoofed* needs evidence of an attack, *authentic* needs positive
evidence for every receiver, all the time that the receivers have in common, no sign of an attack, and no failed test
that overrules it; everything else is *undecided*, with what would decide it.
Nothing here knows a particular detector.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from skyproof.fusion.labels import FalseSource, LabelledSignal, label_signals, sources_of
from skyproof.fusion.open_question import OpenQuestion, open_question
from skyproof.fusion.skies import skies_of, sky_onset
from skyproof.fusion.timeline import Onset, end_of, onset_of
from skyproof.fusion.unexplained import Unexplained, unexplained
from skyproof.navigation.window import interval_s
from skyproof.records import ConsistentSet, Evidence, ObservationLog

__all__ = ["Decision", "fuse"]

VerdictWord = Literal["authentic", "spoofed", "undecided"]
ENOUGH = 4  # signals for a fix
MOMENT_S = 5.0  # after a loss of all signals it takes so long until a window can speak for the new ones


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """The partition of all signals and what follows from it.

    open : what is left open, and why; None if nothing is.
    unexplained : signals that no evidence says anything of.
    assumed : under what the word and the labels hold, in words.
    skies : under an attack that leaves open which signals of a receiver are true, its consistent sets of signals,
        linked over the windows; each is one position and time. None of a receiver of which false signals are named.
    """

    verdict: VerdictWord
    labels: tuple[LabelledSignal, ...]
    sources: tuple[FalseSource, ...]
    skies: tuple[FalseSource, ...]
    onset: Onset | None
    until: np.datetime64 | None
    open: OpenQuestion | None
    unexplained: tuple[Unexplained, ...] = ()
    assumed: tuple[str, ...] = ()


def fuse(
    evidence: Sequence[Evidence], observations: Sequence[ObservationLog], sets: Sequence[ConsistentSet]
) -> Decision:
    """The decision that the evidence of all windows bears."""
    labels = label_signals(evidence, observations)
    sources = sources_of(evidence)
    attacked = any(e.says in ("spoofed", "attack") for e in evidence)
    left = unexplained(labels, evidence, observations, parts=not attacked)
    false = [s for s in labels if s.label == "spoofed"]
    everyone = {o.receiver for o in observations}
    if attacked:
        trusted = _vouched_for(labels, observations, evidence)
        named = {ref.receiver for source in sources for ref in source.signals}
        skies = skies_of((s for s in sets if s.receiver not in named), first=len(sources) + 1)
        onset, until = _time_line(false, skies, observations)
        onset = onset or _first_seen(evidence)
        verdict: VerdictWord = "spoofed"
        settled = trusted == everyone
    else:
        trusted = {o.receiver for o in observations if _always_authentic(o, labels, _common(observations))}
        trusted -= {ref.receiver for e in evidence if e.overrules and e.failed for ref in e.subject}
        # What neither the sky nor an echo explains leaves the whole open, though the rest is authentic.
        odd = {u.ref.receiver for u in left if u.kind in ("rival", "misfit")}
        settled = bool(observations) and trusted == everyone and not odd
        verdict = "authentic" if settled else "undecided"
        trusted -= odd
        sources, skies, onset, until = (), (), None, None
    return Decision(
        verdict=verdict,
        labels=labels,
        sources=sources,
        skies=skies,
        onset=onset,
        until=until,
        unexplained=left,
        assumed=_assumed(evidence),
        open=None if settled else open_question(evidence, observations, trusted),
    )


def _vouched_for(
    labels: Sequence[LabelledSignal], observations: Sequence[ObservationLog], evidence: Sequence[Evidence]
) -> set[str]:
    """Receivers with authentic signals; those before the first evidence of an attack on the receiver do not count."""
    since: dict[str, np.datetime64] = {}
    for e in evidence:
        for receiver in {ref.receiver for ref in e.subject} if e.says == "attack" else ():
            since[receiver] = min(e.start_gpst, since.get(receiver, e.start_gpst))
    gpst_of = {o.receiver: o.gpst for o in observations}
    return {
        s.ref.receiver
        for s in labels
        if s.label == "authentic"
        and (s.ref.receiver not in since or gpst_of[s.ref.receiver][s.last_epoch] >= since[s.ref.receiver])
    }


def _assumed(evidence: Sequence[Evidence]) -> tuple[str, ...]:
    """Each assumption of what was found once, in the order of the windows."""
    found = ("authentic", "spoofed", "attack")
    return tuple(dict.fromkeys(words for e in evidence if e.says in found for words in e.assumes))


def _common(observations: Sequence[ObservationLog]) -> tuple[np.datetime64, np.datetime64]:
    """First and last epoch of the time in which all receivers were recorded."""
    received = [o.gpst for o in observations if o.gpst.size]
    return max(gpst[0] for gpst in received), min(gpst[-1] for gpst in received)


def _always_authentic(
    o: ObservationLog, labels: Sequence[LabelledSignal], common: tuple[np.datetime64, np.datetime64]
) -> bool:
    """Whether a fix could be made of authentic signals, but for moments, whenever enough signals were received.

    Moments last `MOMENT_S`, or as long as two epochs that are missing.
    """
    received = o.measured
    authentic = np.zeros(o.gpst.size, np.int64)
    for s in labels:
        if s.ref.receiver == o.receiver and s.label == "authentic":
            rows = slice(s.first_epoch, s.last_epoch + 1)
            authentic[rows] += received[rows, o.signals.index(s.ref.signal)]
    matters = (received.sum(axis=1) > ENOUGH) & (o.gpst >= common[0]) & (o.gpst <= common[1])
    kept_s = o.elapsed_s[~matters | (authentic >= ENOUGH)]
    edges_s = np.concatenate([o.elapsed_s[:1], kept_s, o.elapsed_s[-1:]])
    return bool(authentic.any() and np.diff(edges_s).max() <= max(MOMENT_S, 2.5 * interval_s(o.elapsed_s)))


def _time_line(
    false: Sequence[LabelledSignal], skies: Sequence[FalseSource], observations: Sequence[ObservationLog]
) -> tuple[Onset | None, np.datetime64 | None]:
    if false:
        came = [s.ref for s in false if not _was_tracked_before(s, observations)]
        onsets = [onset_of(came, observations), *(_capture(s, observations) for s in false if s.ref not in came)]
        known = [onset for onset in onsets if onset is not None]
        return min(known, key=lambda onset: onset.seen, default=None), end_of(false, observations)
    # Who is false is open, but from when on a second sky was there is not: the last of them to appear.
    # Which of them is false is open, and with it whether the one that was seen first is: it may have begun earlier.
    onsets = [sky_onset(sky, observations) for sky in skies]
    known = [replace(onset, earliest=None) for onset in onsets if onset is not None]
    return max(known, key=lambda onset: onset.seen, default=None), None


def _first_seen(evidence: Sequence[Evidence]) -> Onset:
    """Of an attack that no signal or sky dates: at the end of the first window that shows it."""
    return Onset(seen=min(e.end_gpst for e in evidence if e.says in ("spoofed", "attack")), earliest=None)


def _capture(s: LabelledSignal, observations: Sequence[ObservationLog]) -> Onset:
    """Of a channel that went over from one signal to another: the false one may have lain upon the true one before."""
    o = next(o for o in observations if o.receiver == s.ref.receiver)
    return Onset(seen=o.gpst[s.first_epoch], earliest=None)


def _was_tracked_before(s: LabelledSignal, observations: Sequence[ObservationLog]) -> bool:
    """Whether the signal was measured before this stretch: a channel pulled away from what it followed."""
    o = next(o for o in observations if o.receiver == s.ref.receiver)
    column = o.signals.index(s.ref.signal)
    return bool(o.measured[: s.first_epoch, column].any())
