"""What a receiver without protection makes of the signals: of each transmission it follows the strongest it finds."""

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.fusion.trusted import masked
from skyproof.navigation.window import interval_s
from skyproof.records import Observations

__all__ = ["HOLD_S", "unprotected"]

HOLD_S = 1.0
"""A signal that is not measured for so long still counts as followed: a receiver's loops coast through a short fade.
At least from one epoch to the next."""


def unprotected(observations: Observations) -> Observations:
    """The observations with every cell emptied that a receiver without protection would not have.

    Of what a satellite sends on one band in one code it begins with the strongest signal, keeps it while it is
    received, and takes the strongest again when it has lost it for more than `HOLD_S`: who jams it first and then
    transmits the strongest signals leads it.
    """
    o = observations
    mask = np.zeros(o.pseudorange_m.shape, np.bool_)
    hold_s = max(HOLD_S, 1.5 * interval_s(o.elapsed_s))
    for transmission in {signal.transmission for signal in o.signals}:
        columns = [i for i, signal in enumerate(o.signals) if signal.transmission == transmission]
        there = np.isfinite(o.pseudorange_m[:, columns])
        mask[:, columns] = _followed(o.elapsed_s, there, o.cn0_dbhz[:, columns], hold_s)
    return masked(o, mask)


def _followed(elapsed_s: Reals, there: Booleans, cn0_dbhz: Reals, hold_s: float) -> Booleans:
    """Which of one transmission's signals is followed when; arrays and the answer are (n_epochs, n_signals)."""
    mask = np.zeros_like(there)
    strength = np.where(there, np.nan_to_num(cn0_dbhz), -np.inf)
    epoch = 0
    while there[epoch:].any():
        epoch += int(np.argmax(there[epoch:].any(axis=1)))
        column = int(np.argmax(strength[epoch]))
        own = epoch + np.flatnonzero(there[epoch:, column])
        lost = np.append(np.diff(elapsed_s[own]), np.inf) > hold_s
        kept = own[: int(np.argmax(lost)) + 1]
        mask[kept, column] = True
        epoch = int(kept[-1]) + 1
    return mask
