"""All evidence to one decision.

The words are never stronger than the evidence: *spoofed* needs evidence of an attack, *authentic* needs positive
evidence for every receiver, all the time but for half a minute before and after the time that the receivers have in
common, no sign of an attack, and no failed test that overrules it. Else a run is *suspect* if any test failed in any
window, or signals stay that only a fault or a false one would explain (`suspicion`); and *no attack seen* if every test
that could run passed, with what would show more (`open_question`). Nothing here knows a particular detector.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skyproof.arrays import Booleans
from skyproof.fusion.decide import WindowWord, decide_all
from skyproof.fusion.interference import Spell, join_spells
from skyproof.fusion.labels import FalseSource, LabelledSignal, group_false_sources, label_signals
from skyproof.fusion.open_question import OpenQuestion, open_question
from skyproof.fusion.policy import POLICY
from skyproof.fusion.skies import date_sky, link_skies
from skyproof.fusion.suspicion import ODD, Suspicion, find_suspicion
from skyproof.fusion.timeline import Onset, date_end, date_onset
from skyproof.fusion.unexplained import Unexplained, unexplained
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.window import median_interval_s
from skyproof.records import ConsistentSet, Finding, ObservationLog, VerdictWord

__all__ = ["Decision", "fuse"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """The partition of all signals and what follows from it.

    onset : of the attack, or of what makes the run suspect.
    open : which signals are not shown to be true, and why; None if all are. suspicion : of a suspect run.
    unexplained : signals that no evidence says anything of.
    without_fix_s : receivers that received too few signals for a fix for more than a moment, and for how long; of an
        authentic run, too few authentic ones.
    alone_s : of an authentic run, receivers that were recorded for more than a moment while another was not and that
        nothing confirms then, and for how long.
    interference : of all receivers, in the order of its onset; None if no test looked for it.
    skies : under an attack that leaves open which signals of a receiver are true, its consistent sets of signals,
        linked over the windows; each is one position and time. None of a receiver with named false signals.
    windows : the word of each receiver over time; none is worse than the verdict.
    """

    verdict: VerdictWord
    labels: tuple[LabelledSignal, ...]
    sources: tuple[FalseSource, ...]
    skies: tuple[FalseSource, ...]
    onset: Onset | None
    until: np.datetime64 | None
    open: OpenQuestion | None
    suspicion: Suspicion | None = None
    unexplained: tuple[Unexplained, ...] = ()
    without_fix_s: tuple[tuple[str, float], ...] = ()
    alone_s: tuple[tuple[str, float], ...] = ()
    interference: tuple[Spell, ...] | None = None
    windows: tuple[WindowWord, ...] = ()


def fuse(
    evidence: Sequence[Finding], observations: Sequence[ObservationLog], sets: Sequence[ConsistentSet]
) -> Decision:
    """Make the decision that the evidence of all windows bears."""
    state = decide_all(evidence, observations)
    labels = label_signals(evidence, observations)
    sources = group_false_sources(evidence)
    attacked = any(e.says in ("spoofed", "attack") for e in evidence)
    open_signals = unexplained(labels, evidence, observations, parts=not attacked)
    false = [s for s in labels if s.label == "spoofed"]
    everyone = {o.receiver for o in observations}
    suspicion: Suspicion | None = None
    if attacked:
        trusted = _list_shown_true(labels, observations, evidence)
        named = {ref.receiver for source in sources for ref in source.signals}
        skies = link_skies((s for s in sets if s.receiver not in named), first=len(sources) + 1)
        open_signals = tuple(u for u in open_signals if not any(u.ref in sky.signals for sky in skies))
        onset, until = _time_line(false, skies, observations)
        onset = onset or _date_first_sign(evidence)
        verdict: VerdictWord = "spoofed"
        settled = trusted == everyone
    else:
        trusted = {o.receiver for o in observations if _is_always_authentic(o, labels, observations)}
        trusted -= {ref.receiver for e in evidence if e.overrules and e.failed for ref in e.signals}
        # What neither the sky nor an echo explains leaves the whole open, though the rest is authentic.
        odd = {u.ref.receiver for u in open_signals if u.kind in ODD} | set(_find_reflected_alone(labels))
        settled = bool(observations) and trusted == everyone and not odd
        suspicion = None if settled else find_suspicion(evidence, open_signals, observations, state.words)
        verdict = "authentic" if settled else "no_attack_seen" if suspicion is None else "suspect"
        trusted -= odd
        sources, skies, until = (), (), None
        onset = None if suspicion is None else suspicion.onset
    return Decision(
        verdict=verdict,
        labels=labels,
        sources=sources,
        skies=skies,
        onset=onset,
        until=until,
        unexplained=open_signals,
        without_fix_s=tuple(_measure_time_without_fix(labels, observations, authentic=verdict == "authentic")),
        alone_s=tuple(_measure_time_alone(labels, observations)) if verdict == "authentic" else (),
        open=None if settled else open_question(evidence, observations, trusted),
        suspicion=suspicion,
        interference=join_spells(evidence, observations),
        windows=_smooth_words(_clip_to_epochs(state.words, observations), verdict, onset, suspicion),
    )


def _clip_to_epochs(words: Sequence[WindowWord], observations: Sequence[ObservationLog]) -> list[WindowWord]:
    """Return words from the first to the last epoch of each receiver: windows begin and end between epochs."""
    gpst_of = {o.receiver: o.gpst for o in observations}
    return [
        replace(
            word,
            start_gpst=max(word.start_gpst, gpst_of[word.receiver][0]),
            end_gpst=min(word.end_gpst, gpst_of[word.receiver][-1]),
        )
        for word in words
    ]


def _smooth_words(
    words: Sequence[WindowWord], verdict: VerdictWord, onset: Onset | None, suspicion: Suspicion | None
) -> tuple[WindowWord, ...]:
    """Return the words of windows with what only the whole run shows.

    A silent window between two that show the same signals authentic is authentic, too. Odd signals that no test of a
    window tells make a receiver suspect from when they came.
    """
    if verdict == "authentic":
        return _join(replace(word, word=verdict, causes=()) for word in words)
    if suspicion is None or not words or any(word.word == "suspect" for word in words):
        return _join(words)
    seen = words[0].start_gpst if onset is None else onset.seen
    found = list[WindowWord]()
    for word in words:
        if word.receiver not in suspicion.receivers or word.end_gpst <= seen:
            found.append(word)
            continue
        found += [replace(word, end_gpst=seen)] if word.start_gpst < seen else []
        found.append(replace(word, start_gpst=max(seen, word.start_gpst), word="suspect"))
    return _join(found)


def _join(words: Iterable[WindowWord]) -> tuple[WindowWord, ...]:
    """Return words of each receiver that follow each other and are the same as one."""
    joined: dict[str, list[WindowWord]] = {}
    for word in words:
        before = joined.setdefault(word.receiver, [])
        if before and before[-1].word == word.word:
            before[-1] = replace(before[-1], end_gpst=word.end_gpst)
        else:
            before.append(word)
    return tuple(word for each in joined.values() for word in each)


def _list_shown_true(
    labels: Sequence[LabelledSignal], observations: Sequence[ObservationLog], evidence: Sequence[Finding]
) -> set[str]:
    """List receivers with authentic signals; those before the first evidence of an attack on them do not count."""
    since: dict[str, np.datetime64] = {}
    for e in evidence:
        for receiver in {ref.receiver for ref in e.signals} if e.says == "attack" else ():
            since[receiver] = min(e.start_gpst, since.get(receiver, e.start_gpst))
    gpst_of = {o.receiver: o.gpst for o in observations}
    return {
        s.ref.receiver
        for s in labels
        if s.label == "authentic"
        and (s.ref.receiver not in since or gpst_of[s.ref.receiver][s.last_epoch] >= since[s.ref.receiver])
    }


def _is_always_authentic(o: ObservationLog, labels: Sequence[LabelledSignal], all_of: Sequence[ObservationLog]) -> bool:
    """Tell whether authentic signals gave a fix, but for moments, whenever enough signals were received for one.

    Without any such epoch they did not.

    Without any epoch nothing was received. What was recorded alone does not matter for `alone_s`.
    """
    fixed, interval = _find_fixed(o, labels), median_interval_s(o.elapsed_s)
    matters = (o.measured.sum(axis=1) >= POLICY.fix_signals) & _find_common_time(o, all_of, POLICY.alone_s)
    received_s = np.concatenate([[0.0], np.cumsum(np.minimum(np.diff(o.elapsed_s), interval))])
    edges_s = np.concatenate([received_s[:1], received_s[~matters | fixed], received_s[-1:]])
    return bool(fixed.any() and np.diff(edges_s).max() <= _compute_moment_s(interval))


def _compute_moment_s(interval_s: float) -> float:
    """Compute how long a gap may last and still count as a moment: two missing epochs always do."""
    return max(POLICY.moment_s, POLICY.moment_intervals * interval_s)


def _measure_time_without_fix(
    labels: Sequence[LabelledSignal], observations: Sequence[ObservationLog], *, authentic: bool
) -> Iterator[tuple[str, float]]:
    """Yield receivers that had no fix for more than a moment, and for how many seconds.

    authentic : of authentic signals, in the time that all have in common.
    """
    for o in observations:
        enough = o.measured.sum(axis=1) >= POLICY.fix_signals
        good = _find_fixed(o, labels) | ~_find_common_time(o, observations) if authentic else enough
        apart_s = np.diff(np.concatenate([o.elapsed_s[:1], o.elapsed_s[good], o.elapsed_s[-1:]]))
        seconds = float(apart_s[apart_s > _compute_moment_s(median_interval_s(o.elapsed_s))].sum())
        if seconds > 0.0:
            yield o.receiver, seconds


def _find_reflected_alone(labels: Sequence[LabelledSignal]) -> Iterator[str]:
    """Yield receivers that receive a satellite by a reflection only: a false signal may look the same."""
    direct = {(s.ref.receiver, s.ref.signal.transmission) for s in labels if s.label == "authentic"}
    for s in labels:
        if s.label == "multipath" and (s.ref.receiver, s.ref.signal.transmission) not in direct:
            yield s.ref.receiver


def _find_fixed(o: ObservationLog, labels: Sequence[LabelledSignal]) -> Booleans:
    """Return the epochs, (n_epochs,), in which enough authentic signals were received for a fix."""
    authentic = np.zeros(o.gpst.size, np.int64)
    for s in labels:
        if s.ref.receiver == o.receiver and s.label == "authentic":
            rows = slice(s.first_epoch, s.last_epoch + 1)
            authentic[rows] += o.measured[rows, o.signals.index(s.ref.signal)]
    fixed: Booleans = authentic >= POLICY.fix_signals
    return fixed


def _measure_time_alone(
    labels: Sequence[LabelledSignal], observations: Sequence[ObservationLog]
) -> Iterator[tuple[str, float]]:
    for o in observations:
        alone = (
            ~_find_fixed(o, labels)
            & ~_find_common_time(o, observations)
            & (o.measured.sum(axis=1) >= POLICY.fix_signals)
        )
        seconds = float(alone.sum() * median_interval_s(o.elapsed_s))
        if seconds > POLICY.moment_s:
            yield o.receiver, seconds


def _find_common_time(
    o: ObservationLog, observations: Sequence[ObservationLog], beside_s: float | None = None
) -> Booleans:
    """Return the epochs, (n_epochs,), of the time in which all receivers were recorded.

    beside_s : also those that are farther than that before or after it.
    """
    received = [other.gpst for other in observations if other.gpst.size]
    begin, end = max(gpst[0] for gpst in received), min(gpst[-1] for gpst in received)
    common: Booleans = (o.gpst >= begin) & (o.gpst <= end)
    if beside_s is None:
        return common
    beside = timedelta_from_s(beside_s)
    far: Booleans = (o.gpst < begin - beside) | (o.gpst > end + beside)
    return common | far


def _time_line(
    false: Sequence[LabelledSignal], skies: Sequence[FalseSource], observations: Sequence[ObservationLog]
) -> tuple[Onset | None, np.datetime64 | None]:
    if false:
        came = [s.ref for s in false if not _was_tracked_before(s, observations)]
        onsets = [date_onset(came, observations), *(_date_capture(s, observations) for s in false if s.ref not in came)]
        known = [onset for onset in onsets if onset is not None]
        return min(known, key=lambda onset: onset.seen, default=None), date_end(false, observations)
    # Who is false is open, but from when on a second sky was there is not: the last of them to appear.
    # Which of them is false is open, and with it whether the one that was seen first is: it may have begun earlier.
    onsets = [date_sky(sky, observations) for sky in skies]
    known = [replace(onset, earliest=None) for onset in onsets if onset is not None]
    return max(known, key=lambda onset: onset.seen, default=None), None


def _date_first_sign(evidence: Sequence[Finding]) -> Onset:
    """Date an attack that no signal or sky dates.

    A test that shows it does so, one that failed in the first window in which any does, or one that overrules others in
    the window before, which an attack may need to show; else it is the end of that window.
    """
    start, end = min(((e.start_gpst, e.end_gpst) for e in evidence if e.says in ("spoofed", "attack")), key=_get_end)
    before = start - (end - start)
    dated = [
        e.dated_gpst
        for e in evidence
        if e.dated_gpst is not None
        and e.dated_gpst < end
        and (e.says == "attack" or e.dated_gpst >= (before if e.overrules else start))
    ]
    return Onset(seen=min([*dated, end]), earliest=None)


def _get_end(window: tuple[np.datetime64, np.datetime64]) -> np.datetime64:
    return window[1]


def _date_capture(s: LabelledSignal, observations: Sequence[ObservationLog]) -> Onset:
    """Date a channel that went over to another signal: the false one may have overlapped the true one before."""
    o = next(o for o in observations if o.receiver == s.ref.receiver)
    return Onset(seen=o.gpst[s.first_epoch], earliest=None)


def _was_tracked_before(s: LabelledSignal, observations: Sequence[ObservationLog]) -> bool:
    """Tell whether the signal was measured before this stretch: a channel pulled away from what it followed."""
    o = next(o for o in observations if o.receiver == s.ref.receiver)
    column = o.signals.index(s.ref.signal)
    return bool(o.measured[: s.first_epoch, column].any())
