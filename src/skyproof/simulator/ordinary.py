"""Reduce measurements to those of a receiver with one channel a signal, which does not track every copy."""

from dataclasses import replace
from typing import Any

import numpy as np

from skyproof.records import OBSERVABLES, CellStatus, Observations, SignalId

__all__ = ["follow_strongest"]


def follow_strongest(observations: Observations) -> Observations:
    """Return the measurements with one copy of each transmission: at every epoch the one with the most C/N0.

    Where another copy becomes the strongest, its carrier does not continue that of the one before. All copies are named
    "a": such a receiver does not know of others.
    """
    o = observations
    transmissions = list(dict.fromkeys(signal.transmission for signal in o.signals))
    shape = o.gpst.size, len(transmissions)
    cells: dict[str, Any] = {name: np.full(shape, np.nan) for name in OBSERVABLES}
    status = np.full(shape, CellStatus.NOT_TRACKED, np.uint8)
    half_open, quadrature_m = np.zeros(shape, np.bool_), np.full(shape, np.nan)
    firsts, rows = [], np.arange(o.gpst.size)
    for column, transmission in enumerate(transmissions):
        copies = np.array([k for k, signal in enumerate(o.signals) if signal.transmission == transmission])
        level_dbhz = np.where(np.isfinite(o.pseudorange_m[:, copies]), o.cn0_dbhz[:, copies], -np.inf)
        chosen = copies[np.argmax(level_dbhz, axis=1)]
        for name, values in cells.items():
            values[:, column] = getattr(o, name)[rows, chosen]
        status[:, column] = o.status[rows, chosen]
        half_open[:, column] = o.half_cycle_open[rows, chosen]
        quadrature_m[:, column] = o.quadrature_m[rows, chosen]
        seen = np.flatnonzero(np.isfinite(cells["pseudorange_m"][:, column]))
        other = seen[1:][np.diff(chosen[seen]) != 0]
        status[other, column] = CellStatus.SLIP
        firsts.append(int(copies[np.argmin(o.found_elapsed_s[copies])]))
    return replace(
        o,
        signals=tuple(SignalId(*transmission) for transmission in transmissions),
        status=status,
        half_cycle_open=half_open,
        quadrature_m=quadrature_m,
        found_elapsed_s=o.found_elapsed_s[firsts],
        missed_elapsed_s=o.missed_elapsed_s[firsts],
        carrier_hz=o.carrier_hz[firsts],
        **cells,
    )
