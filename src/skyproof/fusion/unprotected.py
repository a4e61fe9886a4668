"""What a receiver without protection makes of the signals: of each transmission it follows the strongest it finds."""

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.fusion.policy import POLICY
from skyproof.navigation.window import median_interval_s
from skyproof.records import ObservationLog

__all__ = ["followed"]


def followed(log: ObservationLog) -> Booleans:
    """Mark the cells, (n_epochs, n_signals), that a receiver without protection would have.

    Of what a satellite sends on one band in one code it begins with the strongest signal that a search finds, keeps it
    while it is received, and searches again when it has lost it for more than `coasts_s`: who jams it first and then
    transmits the strongest signals leads it.
    """
    mask = np.array(log.measured)
    hold_s = max(POLICY.coasts_s, POLICY.gap_intervals * median_interval_s(log.elapsed_s))
    for transmission in {signal.transmission for signal in log.signals}:
        columns = [i for i, signal in enumerate(log.signals) if signal.transmission == transmission]
        if len(columns) > 1:
            cn0_dbhz = np.stack([log.series("cn0_dbhz", column) for column in columns], axis=1)
            mask[:, columns] = _select_followed(log.elapsed_s, mask[:, columns], cn0_dbhz, hold_s)
    return mask


def _select_followed(elapsed_s: Reals, there: Booleans, cn0_dbhz: Reals, hold_s: float) -> Booleans:
    """Mark which of one transmission's signals is followed when; arrays and the answer are (n_epochs, n_signals)."""
    mask = np.zeros_like(there)
    strength = np.where(there, np.nan_to_num(cn0_dbhz), -np.inf)
    epoch = 0
    while there[epoch:].any():
        epoch += int(np.argmax(there[epoch:].any(axis=1)))
        found = (elapsed_s >= elapsed_s[epoch]) & (elapsed_s <= elapsed_s[epoch] + POLICY.searches_s)
        column = int(np.argmax(np.max(strength, axis=0, initial=-np.inf, where=found[:, np.newaxis])))
        measured = epoch + np.flatnonzero(there[epoch:, column])
        lost = np.append(np.diff(elapsed_s[measured]), np.inf) > hold_s
        kept = measured[: int(np.argmax(lost)) + 1]
        mask[kept, column] = True
        epoch = int(kept[-1]) + 1
    return mask
