"""Signals of a receiver that no test rejects: not shown to be true, and nothing speaks against them.

These are all signals while no test of the receiver has failed. Once single ones are named as false they are the others,
if tests of these alone reject nothing (`Rest`). An attacker of the whole sky gains nothing by it: what the others are
held against is what he would have to pass without the named ones. But he is known to be there, so it is kept to names
that are not of the sky that most signals fit, and a fix of the rest has to bear as many false signals again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Booleans, Integers
from skyproof.fusion.fuse import Decision
from skyproof.fusion.trusted import carries, mask_signals
from skyproof.records import ConsistentSet, Finding, ObservationLog, SignalRef

__all__ = [
    "Consistent",
    "Rest",
    "find_doubtful_epochs",
    "find_unsuspected_epochs",
    "name_against_rest",
    "select_consistent",
]


@dataclass(frozen=True, eq=False, kw_only=True)
class Rest:
    """Hold what is decided of all signals but the named false ones, by tests of these alone."""

    named: frozenset[SignalRef]
    decision: Decision

    @property
    def faults(self) -> int:
        """Return how many satellites of the rest may be false unnoticed: as many as are named, one at least."""
        return max(1, len({ref.signal.sat for ref in self.named}))


def name_against_rest(
    decision: Decision, evidence: Sequence[Finding], sets: Sequence[ConsistentSet]
) -> frozenset[SignalRef]:
    """Return the signals that are named as false by themselves; none where the others may be of the same sky.

    They may be where it is open which sky is true, where a whole sky was refused, and where a named signal stands in
    the set that most signals of a window fit, or in one as large: what moves all signals together moves that set.
    """
    naming = [e for e in evidence if e.says == "spoofed"]
    if decision.skies or any(e.whole_sky for e in naming):
        return frozenset()
    since: dict[SignalRef, np.datetime64] = {}
    for e in naming:
        for ref in e.signals:
            since[ref] = min(e.start_gpst, since.get(ref, e.start_gpst))
    largest: dict[tuple[str, np.datetime64], int] = {}
    for found in sets:
        key = found.receiver, found.gpst
        largest[key] = max(len(found.signals), largest.get(key, 0))
    for found in sets:
        refs = [SignalRef(found.receiver, signal) for signal in found.signals]
        of_most = len(refs) == largest[found.receiver, found.gpst]
        if of_most and any(ref in since and found.gpst >= since[ref] for ref in refs):
            return frozenset()
    return frozenset(since)


def find_unsuspected_epochs(log: ObservationLog, decision: Decision) -> Booleans:
    """Return at which epochs, (n_epochs,), no test of the receiver has failed since the start or since its signals
    were shown to be true.

    The word of a window may forget a test that failed before; the position cannot: it may have been moved meanwhile.
    An attack on one receiver is taken for one on all, from its earliest onset on.
    """
    words = [word for word in decision.windows if word.receiver == log.receiver and word.word != "no_attack_seen"]
    changes = [(word.start_gpst, word.word == "authentic") for word in words]
    # Of skies of which one is true, when they were found does not date the false one.
    onset, suspicion = None if decision.skies else decision.onset, decision.suspicion
    if decision.verdict == "spoofed" or (suspicion is not None and log.receiver in suspicion.receivers):
        if onset is not None:
            changes.append((onset.seen if onset.earliest is None else onset.earliest, False))
        elif all(is_true for _, is_true in changes):
            return np.zeros(log.gpst.size, np.bool_)  # nothing dates it
    unsuspected = np.ones(log.gpst.size, np.bool_)
    for since, is_true in sorted(changes):
        unsuspected[log.gpst >= since] = is_true
    return unsuspected


def find_doubtful_epochs(log: ObservationLog, unsuspected: Booleans, *, within_s: float) -> Booleans:
    """Return which of the unsuspected epochs, (n_epochs,), are followed by suspected ones within some time: an attack
    may have been there already, for too short to make a test fail."""
    row = np.arange(unsuspected.size)
    after = np.minimum.accumulate(np.where(unsuspected, row.size, row)[::-1])[::-1]
    ahead_s = np.append(log.elapsed_s, np.inf)[after] - log.elapsed_s
    return np.asarray(unsuspected & (ahead_s <= within_s))


@dataclass(frozen=True, eq=False, kw_only=True)
class Consistent:
    """Hold what consistent fixes of a receiver are made of.

    cells : (n_epochs, n_signals). doubtful : (n_epochs,) where they may be false already. of_rest : (n_epochs,) where
    they are those of the rest. faults : (n_epochs,) how many satellites a fix has to bear.
    """

    cells: Booleans
    doubtful: Booleans
    of_rest: Booleans
    faults: Integers


def select_consistent(log: ObservationLog, decision: Decision, rest: Rest | None, *, within_s: float) -> Consistent:
    """Select the cells that were received while no test had failed, but for those that carry the label of a false
    signal or of a reflection; and from where tests failed, or soon after did, those of the rest.

    within_s : how long an attack may be there before a test fails.
    """
    unsuspected = find_unsuspected_epochs(log, decision)
    doubtful = find_doubtful_epochs(log, unsuspected, within_s=within_s)
    cells = _select_cells(log, decision, unsuspected)
    of_rest, faults = np.zeros_like(unsuspected), np.ones(log.gpst.size, np.intp)
    if rest is not None:
        of_rest = find_unsuspected_epochs(log, rest.decision) & (~unsuspected | doubtful)
        named = mask_signals(log, {ref.signal for ref in rest.named if ref.receiver == log.receiver})
        cells = np.where(of_rest[:, None], _select_cells(log, rest.decision, of_rest) & ~named, cells)
        doubtful = find_doubtful_epochs(log, unsuspected | of_rest, within_s=within_s)
        faults[of_rest] = rest.faults
    return Consistent(cells=cells, doubtful=doubtful, of_rest=of_rest, faults=faults)


def _select_cells(log: ObservationLog, decision: Decision, unsuspected: Booleans) -> Booleans:
    mask = log.measured & unsuspected[:, None]
    return mask & ~carries(log, decision.labels, "spoofed") & ~carries(log, decision.labels, "multipath")
