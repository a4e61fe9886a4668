"""Evidence of many windows to one label per signal and stretch of time, and to the sources of the false ones.

A signal that is tracked without interruption is one transmitter's, unless the evidence itself changes: what some
windows say of it holds for silent neighbours: *spoofed* as long as it is tracked on, *authentic* from
one such window to the next. A channel can be captured without a slip, so that what it follows does not show
what it followed long before. Where windows contradict each other the signal was captured and its life is cut there;
where one window contradicts itself the label is unknown.

A window in which a test of the signal failed (its p-value is below its false-alarm probability, and it says
"undecided") is not silent: true and false signals may be mixed in it. What was authentic before is open there, unless
the window itself has evidence for nearly all of the signals that failed together, that they are authentic or that they
are false. (Of two signals of one transmission one is not the sky's: where one is shown to be authentic, the other may
have made the test fail.) Not even that helps where the test overrules the others, unless false signals are named in the
window. A test that singles a signal out makes that one open, and no other.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TypeVar

import numpy as np

from skyproof.arrays import Integers, Reals
from skyproof.fusion.policy import POLICY
from skyproof.navigation.window import median_interval_s
from skyproof.records import LABELS, Finding, Label, ObservationLog, SignalRef

__all__ = ["FalseSource", "LabelledSignal", "find_usual_window_s", "group_false_sources", "label_signals"]

SILENT = -1
Node = TypeVar("Node", bound=Hashable)


@dataclass(frozen=True, eq=False, kw_only=True)
class LabelledSignal:
    """A signal from its first to its last epoch with this label (epochs as rows of its receiver's observations).

    because : detector and p-value of its most telling evidence for the label.
    """

    ref: SignalRef
    label: Label
    first_epoch: int
    last_epoch: int
    because: tuple[tuple[str, float | None], ...]


@dataclass(frozen=True, kw_only=True)
class FalseSource:
    """Signals that belong together: of one transmitter of false signals, or of one sky.

    one_antenna : evidence shows that they come from one antenna. parted : of a sky, its signals were of one sky with
    the others' in an earlier window, and no satellite sends to both: when they were found does not date it.
    """

    name: str
    signals: tuple[SignalRef, ...]
    one_antenna: bool = False
    parted: bool = False


@dataclass(frozen=True, kw_only=True)
class _Vote:
    """What one piece of evidence says of one signal, in the epochs of its window."""

    label: Label
    first_epoch: int
    last_epoch: int
    detector: str
    p_value: float | None


def label_signals(evidence: Sequence[Finding], observations: Sequence[ObservationLog]) -> tuple[LabelledSignal, ...]:
    """Label every signal of every receiver, cut where its label changes; in order of receiver, signal and time."""
    labelled: list[LabelledSignal] = []
    window_s = find_usual_window_s(evidence)
    evidence = _sort_by_window(evidence)
    for o in observations:
        votes = _collect_votes(evidence, o)
        for column, signal in enumerate(o.signals):
            ref = SignalRef(o.receiver, signal)
            arcs = _find_arcs(o, column)
            by_arc = _give_to_arcs(votes.get(ref, ()), arcs)
            pieces = [
                p for arc, given in zip(arcs, by_arc, strict=True) for p in _label_arc(ref, o, arc, given, window_s)
            ]
            labelled += _join_pieces(pieces)
    return tuple(labelled)


def _sort_by_window(evidence: Sequence[Finding]) -> Sequence[Finding]:
    """Sort evidence by the windows' times.

    Evidence of a run is in that order and may be too much to hold, so it is returned unchanged.
    """
    times = np.fromiter((t for e in evidence for t in (e.start_gpst, e.end_gpst)), "datetime64[ns]").reshape(-1, 2)
    order = np.lexsort((times[:, 1], times[:, 0]))
    return evidence if np.array_equal(order, np.arange(order.size)) else [evidence[place] for place in order]


def _collect_votes(evidence: Sequence[Finding], o: ObservationLog) -> dict[SignalRef, list[_Vote]]:
    """Collect what is said of each signal of a receiver. A failed test votes for "unknown" where nothing else speaks.

    evidence : window by window.
    """

    def rows(e: Finding) -> tuple[int, int]:
        first, end = (int(np.searchsorted(o.gpst, t)) for t in (e.start_gpst, e.end_gpst))
        return first, end - 1

    votes: dict[SignalRef, list[_Vote]] = {}
    for (first, last), of_window in groupby(evidence, rows):
        if last < first:
            continue
        findings = list(of_window)
        # Where false signals are named beside the true ones it is no wonder that what is received does not go on.
        false = {ref for e in findings if e.says == "spoofed" for ref in e.signals if ref.receiver == o.receiver}
        attacked = bool(false)
        tests = [
            (e, {r for r in e.signals if r.receiver == o.receiver})
            for e in findings
            if e.failed and not (e.overrules and attacked)
        ]
        failed = [refs for e, refs in tests if refs and not e.overrules and not e.singled_out]
        overruled = set[SignalRef]().union(*(refs for e, refs in tests if e.overrules or e.singled_out))
        spoken: set[SignalRef] = set()
        for e in findings:
            refs = {ref for ref in e.signals if ref.receiver == o.receiver}
            label: Label = e.says if e.says in ("authentic", "spoofed", "multipath") else "unknown"
            known = refs | false | set(e.withheld)  # what is withheld fits as well: it did not make a test fail
            sent = {ref.signal.transmission for ref in refs}  # once: another signal of it is none of the sky's
            if label == "authentic" and any(
                sum(ref in known or ref.signal.transmission in sent for ref in f) < POLICY.nearly_all_share * len(f)
                for f in failed
            ):
                label = "unknown"
            if e.says == "authentic":
                refs -= overruled
            if e.says in LABELS:
                spoken |= refs
                vote = _Vote(label=label, first_epoch=first, last_epoch=last, detector=e.detector, p_value=e.p_value)
                for ref in refs:
                    votes.setdefault(ref, []).append(vote)
        doubt = _Vote(label="unknown", first_epoch=first, last_epoch=last, detector="", p_value=None)
        for ref in overruled.union(*failed) - spoken:
            votes.setdefault(ref, []).append(doubt)
    return votes


def find_usual_window_s(evidence: Sequence[Finding]) -> float:
    """Return the length of most windows, seconds: the last of a run may be longer or shorter."""
    windows = {(e.start_gpst, e.end_gpst) for e in evidence}
    lengths_s = [float((end - start) / np.timedelta64(1, "s")) for start, end in windows]
    return float(np.median(lengths_s)) if lengths_s else 0.0


def group_false_sources(evidence: Sequence[Finding]) -> tuple[FalseSource, ...]:
    """Group false signals that belong together: what evidence calls spoofed, joined over windows by shared signals."""
    groups: dict[tuple[SignalRef, ...], bool] = {}
    for e in evidence:
        if e.says == "spoofed":
            groups[e.signals] = groups.get(e.signals, False) or not e.whole_sky
    from_one = {ref for subject, is_one_antenna in groups.items() if is_one_antenna for ref in subject}
    return tuple(
        FalseSource(name=f"S{number}", signals=tuple(sorted(signals)), one_antenna=bool(signals & from_one))
        for number, signals in enumerate(linked(groups), 1)
    )


def linked(groups: Iterable[Iterable[Node]]) -> list[set[Node]]:
    """Join groups wherever they share a member, in order of first appearance."""
    joined: list[set[Node]] = []
    for group in groups:
        members = set(group)
        touching = [other for other in joined if other & members]
        if not touching:
            joined.append(members)
            continue
        touching[0] |= members.union(*touching[1:])
        joined = [other for other in joined if not any(other is t for t in touching[1:])]
    return joined


def _find_arcs(o: ObservationLog, column: int) -> list[tuple[int, int]]:
    """List the first and last epoch of every stretch without a slip in which the signal was measured."""
    rows = np.flatnonzero(o.measured[:, column])
    if rows.size == 0:
        return []
    cuts = np.flatnonzero(o.slipped[rows, column])
    starts = np.unique(np.concatenate([[0], cuts]))
    ends = np.append(starts[1:] - 1, rows.size - 1)
    return [(int(rows[a]), int(rows[b])) for a, b in zip(starts, ends, strict=True)]


def _label_arc(
    ref: SignalRef, o: ObservationLog, arc: tuple[int, int], votes: Sequence[_Vote], window_s: float
) -> list[LabelledSignal]:
    """Cut an arc into stretches of one label: what windows say, and between them what both neighbours say.

    What only one side says holds on if it is *spoofed*; *authentic* does not.
    """
    spoken = np.full(arc[1] - arc[0] + 1, SILENT)
    for vote in votes:
        window_codes = spoken[vote.first_epoch - arc[0] : vote.last_epoch - arc[0] + 1]
        code = LABELS.index(vote.label)
        window_codes[:] = np.where((window_codes == SILENT) | (window_codes == code), code, LABELS.index("unknown"))
    bridge_s = max(POLICY.bridged_s, window_s + POLICY.gap_intervals * median_interval_s(o.elapsed_s))
    before_s = max(POLICY.begins_before_s, POLICY.begins_before_share * window_s)
    codes = _fill_silent(spoken, o.elapsed_s[arc[0] : arc[1] + 1], bridge_s, before_s)
    starts = np.flatnonzero(np.diff(codes, prepend=SILENT))
    ends = np.append(starts[1:], codes.size) - 1
    return [
        _make_piece(ref, LABELS[codes[first]], arc[0] + int(first), arc[0] + int(last), votes)
        for first, last in zip(starts, ends, strict=True)
    ]


def _give_to_arcs(votes: Sequence[_Vote], arcs: Sequence[tuple[int, int]]) -> list[list[_Vote]]:
    """Cut votes to the arcs that they speak of: a window speaks for what fills it.

    Where no arc does, since a false signal keeps slipping, *spoofed* is said of all that it touches.
    """
    given: list[list[_Vote]] = [[] for _ in arcs]
    firsts, lasts = np.array(arcs, np.intp).reshape(-1, 2).T
    for vote in votes:
        within = np.minimum(lasts, vote.last_epoch) - np.maximum(firsts, vote.first_epoch) + 1
        chosen = within >= POLICY.window_in_arc_share * (vote.last_epoch - vote.first_epoch + 1)
        if vote.label == "spoofed" and not chosen.any():
            chosen = within > 0
        for k in np.flatnonzero(chosen).tolist():
            first, last = max(vote.first_epoch, arcs[k][0]), min(vote.last_epoch, arcs[k][1])
            given[k].append(replace(vote, first_epoch=first, last_epoch=last))
    return given


def _fill_silent(said: Integers, elapsed_s: Reals, bridge_s: float, before_s: float) -> Integers:
    """Fill the silent codes of labels, (n_epochs,), from the nearest that are not silent, before and after."""
    unknown, authentic = LABELS.index("unknown"), LABELS.index("authentic")
    row = np.arange(said.size)
    before = np.maximum.accumulate(np.where(said != SILENT, row, -1))
    after = np.minimum.accumulate(np.where(said != SILENT, row, said.size)[::-1])[::-1]
    before[before < 0] = said.size
    codes, times_s = np.append(said, SILENT), np.append(elapsed_s, np.inf)  # the last cell stands for "none"
    earlier, later = codes[before], codes[after]
    agreed = np.where(earlier == SILENT, later, np.where((later == SILENT) | (earlier == later), earlier, unknown))
    agreed[agreed == SILENT] = unknown
    begun = before < said.size
    bridged = times_s[after] - np.where(begun, times_s[before], -np.inf) <= bridge_s
    early = ~begun & (times_s[after] - elapsed_s[0] > before_s)
    return np.where(((agreed == authentic) & ~bridged) | early, unknown, agreed)


def _make_piece(ref: SignalRef, label: Label, first: int, last: int, votes: Sequence[_Vote]) -> LabelledSignal:
    strongest: dict[str, float | None] = {}
    for vote in votes:
        if vote.label == label and vote.detector and vote.first_epoch <= last and vote.last_epoch >= first:
            known = strongest.get(vote.detector)
            if vote.detector not in strongest or known is None or (vote.p_value is not None and vote.p_value < known):
                strongest[vote.detector] = vote.p_value
    because = tuple(strongest.items()) if label != "unknown" else ()
    return LabelledSignal(ref=ref, label=label, first_epoch=first, last_epoch=last, because=because)


def _join_pieces(pieces: Sequence[LabelledSignal]) -> list[LabelledSignal]:
    """Join neighbours with the same label."""
    joined: list[LabelledSignal] = []
    for piece in pieces:
        if joined and joined[-1].label == piece.label:
            before = joined[-1]
            merged: Mapping[str, float | None] = dict(before.because) | dict(piece.because)
            joined[-1] = LabelledSignal(
                ref=piece.ref,
                label=piece.label,
                first_epoch=before.first_epoch,
                last_epoch=piece.last_epoch,
                because=tuple(merged.items()),
            )
        else:
            joined.append(piece)
    return joined
