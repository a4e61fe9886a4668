"""RINEX files of signals: a file has room for one a transmission, so several of one stand in several files."""

from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.time import utc_from_gpst
from skyproof.records import Observations, SignalId

__all__ = ["date_of", "one_a_transmission", "write_channels"]


def date_of(observations: Iterable[Observations | None]) -> np.datetime64 | None:
    """The date (UTC) of files made of these: of the first epoch, so that equal inputs make equal bytes."""
    starts = [o.gpst[0] for o in observations if o is not None]
    return utc_from_gpst(min(starts)) if starts else None


def one_a_transmission(o: Observations) -> list[tuple[SignalId, ...]]:
    """The signals that were measured, dealt into groups with at most one of a satellite, band and code in each."""
    groups: list[dict[tuple[str, str, str], SignalId]] = []
    for column, signal in enumerate(o.signals):
        if np.isfinite(o.pseudorange_m[:, column]).any():
            free = next((g for g in groups if signal.transmission not in g), None)
            if free is None:
                free = {}
                groups.append(free)
            free[signal.transmission] = signal
    return [tuple(g.values()) for g in groups]


def write_channels(
    path: Path, o: Observations, holds: str, place: Any, signals: tuple[SignalId, ...] | None = None
) -> None:
    """Write those signals, by default the first group of `one_a_transmission`; nothing if there are none."""
    if signals is None:
        groups = one_a_transmission(o)
        signals = groups[0] if groups else ()
    if signals:
        write_obs(
            path,
            o,
            signals=signals,
            holds=holds,
            marker=o.receiver,
            version=version("skyproof"),
            position_ecef_m=place,
            created_utc=date_of([o]),
        )
