"""Which signals a position by code takes: one of each satellite, of the band that all receivers have."""

from typing import Final

import numpy as np

from skyproof.records import Observations, SignalId

__all__ = ["select_code_signals"]

_PREFERRED: Final = {
    "G": (("L1", ("CA",)),),
    "J": (("L1", ("CA",)),),
    "E": (("E1", ("C", "X", "B", "Z")),),
    "C": (("B1", ("2I", "2X", "2Q")), ("B1C", ("1P", "1X", "1D"))),
    "R": (("G1", ("CA",)),),
}


def select_code_signals(observations: Observations) -> tuple[SignalId, ...]:
    """Select one signal of each satellite of GPS, QZSS, Galileo, BeiDou and GLONASS.

    Only signals with a pseudorange somewhere count; of several the one of a satellite with most, then the one named
    first. Several copies of a satellite's signal are not distinguished here: the first is taken.
    """
    epochs = np.isfinite(observations.pseudorange_m).sum(axis=0)
    best: dict[str, tuple[int, int, int, SignalId]] = {}
    for count, signal in zip(epochs.tolist(), observations.signals, strict=True):
        for rank, (band, codes) in enumerate(_PREFERRED.get(signal.sat[0], ())):
            if count and signal.band == band and signal.code in codes:
                key = (rank, -count, codes.index(signal.code), signal)
                best[signal.sat] = min(best.get(signal.sat, key), key)
    return tuple(sorted(key[3] for key in best.values()))
