"""Signals of a receiver while no test has failed: not shown to be true, and nothing speaks against them."""

import numpy as np

from skyproof.arrays import Booleans
from skyproof.fusion.fuse import Decision
from skyproof.fusion.trusted import carries
from skyproof.records import ObservationLog

__all__ = ["find_doubtful_epochs", "find_unsuspected_epochs", "select_consistent_cells"]


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


def find_doubtful_epochs(log: ObservationLog, decision: Decision, *, within_s: float) -> Booleans:
    """Return which of the unsuspected epochs, (n_epochs,), are followed by suspected ones within some time: an attack
    may have been there already, for too short to make a test fail."""
    unsuspected = find_unsuspected_epochs(log, decision)
    row = np.arange(unsuspected.size)
    after = np.minimum.accumulate(np.where(unsuspected, row.size, row)[::-1])[::-1]
    ahead_s = np.append(log.elapsed_s, np.inf)[after] - log.elapsed_s
    return np.asarray(unsuspected & (ahead_s <= within_s))


def select_consistent_cells(log: ObservationLog, decision: Decision) -> Booleans:
    """Return which cells (n_epochs, n_signals) were received while no test had failed, but for those that carry the
    label of a false signal or of a reflection."""
    mask = log.measured & find_unsuspected_epochs(log, decision)[:, None]
    return mask & ~carries(log, decision.labels, "spoofed") & ~carries(log, decision.labels, "multipath")
