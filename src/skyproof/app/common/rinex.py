"""RINEX files of signals: a file has room for one per transmission, so several of one stand in several files."""

import re
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from skyproof.arrays import Booleans
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.time import utc_from_gpst
from skyproof.records import ObservationLog, SignalId

__all__ = ["first_epoch_utc", "group_by_transmission", "is_ours", "write_channels"]

_MADE_BY = re.compile(rb"^skyproof\b.{,52} *PGM / RUN BY / DATE", re.MULTILINE)


def is_ours(path: Path) -> bool:
    """Test whether the header of a RINEX file names skyproof as its maker; no if it is unreadable."""
    try:
        with path.open("rb") as file:
            return _MADE_BY.search(file.read(1000)) is not None
    except OSError:
        return False


def first_epoch_utc(observations: Iterable[ObservationLog | None]) -> np.datetime64 | None:
    """Return the date (UTC) of the first epoch, so that equal inputs make equal bytes."""
    starts = [o.gpst[0] for o in observations if o is not None]
    return utc_from_gpst(min(starts)) if starts else None


def group_by_transmission(o: ObservationLog, mask: Booleans | None = None) -> list[tuple[SignalId, ...]]:
    """Group the measured signals so that no group has two of one satellite, band and code.

    mask : (n_epochs, n_signals), which measurements count.
    """
    groups: list[dict[tuple[str, str, str], SignalId]] = []
    channels = np.flatnonzero(np.any(o.measured if mask is None else o.measured & mask, axis=0))
    for signal in (o.signals[channel] for channel in channels):
        free = next((g for g in groups if signal.transmission not in g), None)
        if free is None:
            free = {}
            groups.append(free)
        free[signal.transmission] = signal
    return [tuple(g.values()) for g in groups]


def write_channels(
    path: Path,
    o: ObservationLog,
    holds: str,
    place: Any,
    signals: tuple[SignalId, ...],
    mask: Booleans | None = None,
) -> None:
    """Write those signals, where `mask` (n_epochs, n_signals) holds; not two of a transmission at one epoch."""
    write_obs(
        path,
        o,
        signals=signals,
        mask=mask,
        holds=holds,
        marker=o.receiver,
        version=version("skyproof"),
        position_ecef_m=place,
        created_utc=first_epoch_utc([o]),
    )
