"""Evidence of many windows to one label per signal and stretch of time, and to the sources of the false ones.

A signal that is tracked without interruption is one transmitter's, unless the evidence itself changes: what some
windows say of it holds for its neighbours that say nothing. Where windows contradict each other the signal was captured
and its life is cut there; where one window contradicts itself the label is unknown.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeVar

import numpy as np

from skyproof.records import Evidence, Observations, SignalRef

__all__ = ["Label", "LabelledSignal", "Source", "label_signals", "sources_of"]

Label = Literal["authentic", "spoofed", "unknown"]
SLIP = 3  # a code of records.CELL_STATUS
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
class Source:
    """Signals that evidence ascribes to one transmitter of false signals."""

    name: str
    signals: tuple[SignalRef, ...]


@dataclass(frozen=True, kw_only=True)
class _Vote:
    label: Label
    first_epoch: int
    last_epoch: int
    detector: str
    p_value: float | None


def label_signals(evidence: Sequence[Evidence], observations: Sequence[Observations]) -> tuple[LabelledSignal, ...]:
    """Every signal of every receiver, cut where its label changes; in order of receiver, signal and time."""
    labelled: list[LabelledSignal] = []
    for o in observations:
        by_signal: dict[SignalRef, list[Evidence]] = {}
        for e in evidence:
            if e.says in ("authentic", "spoofed"):
                for ref in e.subject:
                    by_signal.setdefault(ref, []).append(e)
        for column, signal in enumerate(o.signals):
            ref = SignalRef(o.receiver, signal)
            told = by_signal.get(ref, [])
            pieces = [p for arc in _arcs(o, column) for p in _label_arc(ref, o, arc, told)]
            labelled += _joined(pieces)
    return tuple(labelled)


def sources_of(evidence: Sequence[Evidence]) -> tuple[Source, ...]:
    """Transmitters of false signals: groups that evidence calls spoofed, joined over windows by shared signals."""
    groups = [e.subject for e in evidence if e.says == "spoofed"]
    return tuple(
        Source(name=f"S{number + 1}", signals=tuple(sorted(signals)))
        for number, signals in enumerate(linked(groups))
    )  # fmt: skip


def linked(groups: Iterable[Iterable[Node]]) -> list[set[Node]]:
    """Groups joined wherever they share a member, in order of first appearance."""
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


def _arcs(o: Observations, column: int) -> list[tuple[int, int]]:
    """First and last epoch of every stretch without a slip in which the signal was measured."""
    there = np.flatnonzero(np.isfinite(o.pseudorange_m[:, column]))
    if there.size == 0:
        return []
    cuts = np.flatnonzero(o.status[there, column] == SLIP)
    starts = np.unique(np.concatenate([[0], cuts]))
    ends = np.append(starts[1:] - 1, there.size - 1)
    return [(int(there[a]), int(there[b])) for a, b in zip(starts, ends, strict=True)]


def _label_arc(
    ref: SignalRef, o: Observations, arc: tuple[int, int], told: Sequence[Evidence]
) -> list[LabelledSignal]:
    """One label if all windows that say something agree; else one piece a window's worth."""
    votes = []
    for e in told:
        inside = np.flatnonzero((o.gpst >= e.start_gpst) & (o.gpst < e.end_gpst))
        if inside.size and inside[0] <= arc[1] and inside[-1] >= arc[0]:
            first, last = max(int(inside[0]), arc[0]), min(int(inside[-1]), arc[1])
            # A window speaks for the stretch of the signal that fills most of it.
            if last - first + 1 >= 0.4 * inside.size:
                label: Label = "authentic" if e.says == "authentic" else "spoofed"
                votes.append(
                    _Vote(label=label, first_epoch=first, last_epoch=last, detector=e.detector, p_value=e.p_value)
                )
    if len({vote.label for vote in votes}) <= 1:
        return [_piece(ref, votes[0].label if votes else "unknown", arc[0], arc[1], votes)]
    votes.sort(key=lambda vote: vote.first_epoch)
    pieces: list[LabelledSignal] = []
    edges = [arc[0], *sorted({v.first_epoch for v in votes} - {arc[0]}), arc[1] + 1]
    for first, end in pairwise(edges):
        here = [v for v in votes if v.first_epoch <= first <= v.last_epoch]
        labels = {v.label for v in here}
        pieces.append(_piece(ref, labels.pop() if len(labels) == 1 else "unknown", first, end - 1, here))
    return _joined(pieces)


def _piece(ref: SignalRef, label: Label, first: int, last: int, votes: Sequence[_Vote]) -> LabelledSignal:
    strongest: dict[str, float | None] = {}
    for vote in votes:
        if vote.label == label:
            known = strongest.get(vote.detector)
            if vote.detector not in strongest or known is None or (vote.p_value is not None and vote.p_value < known):
                strongest[vote.detector] = vote.p_value
    return LabelledSignal(
        ref=ref, label=label, first_epoch=first, last_epoch=last, because=tuple(strongest.items())
    )  # fmt: skip


def _joined(pieces: Sequence[LabelledSignal]) -> list[LabelledSignal]:
    """Neighbours with the same label as one."""
    joined: list[LabelledSignal] = []
    for piece in pieces:
        if joined and joined[-1].label == piece.label:
            before = joined[-1]
            merged: Mapping[str, float | None] = dict(before.because) | dict(piece.because)
            joined[-1] = LabelledSignal(
                ref=piece.ref, label=piece.label, first_epoch=before.first_epoch, last_epoch=piece.last_epoch,
                because=tuple(merged.items()),
            )  # fmt: skip
        else:
            joined.append(piece)
    return joined
