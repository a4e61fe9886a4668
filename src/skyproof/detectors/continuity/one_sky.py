"""Reduce observations with several signals a transmission to one sky with one each, whatever the channel."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.records import OBSERVABLES, CellStatus, Observations, SignalId, Transmission

__all__ = [
    "group_columns",
    "join_later",
    "select_columns",
    "select_one_per_transmission",
]


_WHATEVER = np.array(False)  # half a cycle is 10 cm


def select_one_per_transmission(
    o: Observations, members: Sequence[SignalId], before: Sequence[SignalId], sources: Mapping[Transmission, SignalId]
) -> tuple[Observations, Mapping[Transmission, SignalId]]:
    """Select one signal of each transmission at each epoch.

    It is the signal in `members`, else that in `before`, else the only one that is received. A change from one signal
    to another is a slip. Epochs with fewer than five are left out. Also returned is the signal of each transmission
    that continues unbroken from the last epoch kept to the end; `sources` are those at the start.
    """
    measured = np.isfinite(o.pseudorange_m) & np.isfinite(o.pseudorange_sigma_m)
    forward = np.diff(np.maximum.accumulate(o.elapsed_s), prepend=-np.inf) > 0.0
    columns: dict[Transmission, list[int]] = {}
    for k, signal in enumerate(o.signals):
        columns.setdefault(signal.transmission, []).append(k)
    sent = sorted(columns)
    first = np.array([columns[transmission][0] for transmission in sent], np.intp)
    chosen = np.where(measured[:, first], first, -1)
    several = [n for n, transmission in enumerate(sent) if len(columns[transmission]) > 1]
    wanted = [set(before), set(members)] if several else []
    for n in several:
        candidates = np.array(columns[sent[n]])
        chosen[:, n] = np.where(
            measured[:, candidates].sum(axis=1) == 1, candidates[measured[:, candidates].argmax(axis=1)], -1
        )
        for signals in wanted:
            for k in candidates:
                if o.signals[k] in signals:
                    chosen[measured[:, k], n] = k
    kept = np.flatnonzero(forward & ((chosen >= 0).sum(axis=1) >= POLICY.one_sky_satellites))
    breaks = np.cumsum(_find_breaks(chosen, o, sent, sources), axis=0)
    slipped = np.diff(breaks[kept], axis=0, prepend=0) > 0  # those of epochs that are left out count as well
    used = chosen[kept]
    cells: dict[str, Any] = {name: _take_chosen(getattr(o, name)[kept], used) for name in OBSERVABLES}
    status = np.where(used < 0, CellStatus.NOT_TRACKED, np.where(slipped, CellStatus.SLIP, CellStatus.OK))
    whole = (chosen[-1] >= 0) & (breaks[-1] == (breaks[kept[-1]] if kept.size else 0))
    last = {sent[n]: o.signals[chosen[-1, n]] for n in np.flatnonzero(whole)}
    sky = replace(
        o,
        gpst=o.gpst[kept],
        elapsed_s=o.elapsed_s[kept],
        signals=tuple(map(_first_copy, sent)),
        status=status.astype(np.uint8),
        carrier_hz=o.carrier_hz[first],
        found_elapsed_s=np.zeros(len(sent)),
        missed_elapsed_s=np.full(len(sent), np.nan),
        half_cycle_open=_WHATEVER,
        quadrature_m=_take_chosen(o.quadrature_m[kept], used),
        **cells,
    )
    return sky, last


@lru_cache(1024)
def _first_copy(transmission: Transmission) -> SignalId:
    """Return the signal of a transmission as one object, so that equal signals of two windows compare fast."""
    return SignalId(*transmission)


def _find_breaks(
    chosen: Integers, o: Observations, sent: Sequence[Transmission], sources: Mapping[Transmission, SignalId]
) -> Booleans:
    """Find where a transmission's carrier breaks: a slip, a gap, or another signal since the epoch before."""
    first = [-1 if (source := sources.get(name)) is None else o.column_of.get(source, -1) for name in sent]
    before = np.vstack((np.array(first, np.int64)[None], chosen[:-1]))
    slip = np.take_along_axis(o.status, np.maximum(chosen, 0), axis=1) == CellStatus.SLIP
    return np.asarray((chosen >= 0) & (slip | (chosen != before)))


def _take_chosen(cells: Reals, chosen: Integers) -> Reals:
    return np.where(chosen >= 0, np.take_along_axis(cells, np.maximum(chosen, 0), axis=1), np.nan)


def join_later(before: Observations, after: Observations) -> Observations:
    """Join two stretches, with the transmissions of both; epochs of `after` that are not later are left out."""
    later = after.select(after.elapsed_s > before.elapsed_s[-1]) if before.gpst.size else after
    return Observations.join((before, later))


def select_columns(o: Observations, columns: Indices) -> Observations:
    """Select the chosen signals, at the epochs at which five or more of them were measured."""
    chosen = o.select_channels(columns)
    kept = np.isfinite(chosen.pseudorange_m).sum(axis=1) >= POLICY.one_sky_satellites
    return chosen if kept.all() else chosen.select(kept)


def group_columns(o: Observations) -> list[Indices]:
    """Group the columns by kinds of signals that may step alone.

    Each kind of five or more satellites is a group. The largest takes all kinds with fewer.

    The offsets between kinds are constant, so a step that several kinds share is a clock's. But an attack that
    exchanges the signals of one kind moves these alone; beside them, other kinds would look like most of the sky.
    """
    kinds: dict[tuple[str, str, str], list[int]] = {}
    for k in np.flatnonzero(np.isfinite(o.carrier_hz) & np.isfinite(o.pseudorange_m).any(axis=0)):
        kinds.setdefault(o.signals[k].kind, []).append(int(k))
    by_size = sorted(kinds.values(), key=len, reverse=True)
    alone = [columns for columns in by_size[1:] if len(columns) >= POLICY.one_sky_satellites]
    few = [k for columns in by_size[1:] if len(columns) < POLICY.one_sky_satellites for k in columns]
    return [np.array(columns, np.intp) for columns in ([*by_size[0], *few], *alone)] if by_size else []
