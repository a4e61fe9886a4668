"""Observations of several signals a transmission as one sky with one: by what was sent, and not by channel."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, Indices, Integers, Reals
from skyproof.detectors.continuity.policy import POLICY
from skyproof.records import OBSERVABLES, CellStatus, Observations, SignalId, Transmission

__all__ = [
    "columns_of",
    "followed_by",
    "groups_of",
    "one_signal_a_transmission",
]


_WHATEVER = np.array(False)  # half a cycle is 10 cm


def one_signal_a_transmission(
    o: Observations, members: Sequence[SignalId], before: Sequence[SignalId], sources: Mapping[Transmission, SignalId]
) -> tuple[Observations, Mapping[Transmission, SignalId]]:
    """Of each transmission and epoch the signal in `members`, else that in `before`, else the only one that is there.

    A change from one signal to another is a slip. Epochs with fewer than five are left out. Also gives which signal of
    each transmission goes on unbroken from the last epoch kept to the end; `sources` are those at the start.
    """
    there = np.isfinite(o.pseudorange_m) & np.isfinite(o.pseudorange_sigma_m)
    forward = np.diff(np.maximum.accumulate(o.elapsed_s), prepend=-np.inf) > 0.0
    columns: dict[Transmission, list[int]] = {}
    for k, signal in enumerate(o.signals):
        columns.setdefault(signal.transmission, []).append(k)
    sent = sorted(columns)
    first = np.array([columns[transmission][0] for transmission in sent], np.intp)
    chosen = np.where(there[:, first], first, -1)
    several = [n for n, transmission in enumerate(sent) if len(columns[transmission]) > 1]
    wanted = [set(before), set(members)] if several else []
    for n in several:
        own = np.array(columns[sent[n]])
        chosen[:, n] = np.where(there[:, own].sum(axis=1) == 1, own[there[:, own].argmax(axis=1)], -1)
        for signals in wanted:
            for k in own:
                if o.signals[k] in signals:
                    chosen[there[:, k], n] = k
    kept = np.flatnonzero(forward & ((chosen >= 0).sum(axis=1) >= POLICY.one_sky_satellites))
    breaks = np.cumsum(_breaks(chosen, o, sent, sources), axis=0)
    slipped = np.diff(breaks[kept], axis=0, prepend=0) > 0  # those of epochs that are left out count as well
    used = chosen[kept]
    cells: dict[str, Any] = {name: _picked(getattr(o, name)[kept], used) for name in OBSERVABLES}
    status = np.where(used < 0, CellStatus.NOT_TRACKED, np.where(slipped, CellStatus.SLIP, CellStatus.OK))
    whole = (chosen[-1] >= 0) & (breaks[-1] == (breaks[kept[-1]] if kept.size else 0))
    last = {sent[n]: o.signals[chosen[-1, n]] for n in np.flatnonzero(whole)}
    one = replace(
        o,
        gpst=o.gpst[kept],
        elapsed_s=o.elapsed_s[kept],
        signals=tuple(map(_first_copy, sent)),
        status=status.astype(np.uint8),
        carrier_hz=o.carrier_hz[first],
        found_elapsed_s=np.zeros(len(sent)),
        missed_elapsed_s=np.full(len(sent), np.nan),
        half_cycle_open=_WHATEVER,
        **cells,
    )
    return one, last


@lru_cache(1024)
def _first_copy(transmission: Transmission) -> SignalId:
    """The signal of a transmission; one object, so that the same signals of two windows are equal at a glance."""
    return SignalId(*transmission)


def _breaks(
    chosen: Integers, o: Observations, sent: Sequence[Transmission], sources: Mapping[Transmission, SignalId]
) -> Booleans:
    """Where a transmission's carrier does not go on from the epoch before: a slip, a gap, or another signal."""
    first = [-1 if (source := sources.get(name)) is None else o.column_of.get(source, -1) for name in sent]
    before = np.vstack((np.array(first, np.int64)[None], chosen[:-1]))
    slip = np.take_along_axis(o.status, np.maximum(chosen, 0), axis=1) == CellStatus.SLIP
    return np.asarray((chosen >= 0) & (slip | (chosen != before)))


def _picked(cells: Reals, chosen: Integers) -> Reals:
    return np.where(chosen >= 0, np.take_along_axis(cells, np.maximum(chosen, 0), axis=1), np.nan)


def followed_by(before: Observations, after: Observations) -> Observations:
    """The epochs of both, with the transmissions of both; those of `after` that do not come later are left out."""
    later = after.select(after.elapsed_s > before.elapsed_s[-1]) if before.gpst.size else after
    return Observations.joined((before, later))


def columns_of(o: Observations, columns: Indices) -> Observations:
    """The chosen signals, at the epochs at which five or more of them were measured."""
    chosen = o.select_channels(columns)
    kept = np.isfinite(chosen.pseudorange_m).sum(axis=1) >= POLICY.one_sky_satellites
    return chosen if kept.all() else chosen.select(kept)


def groups_of(o: Observations) -> list[Indices]:
    """The columns of the kinds of signals that may step alone: each of five or more satellites, with the largest all
    that are of fewer.

    The offsets between kinds stay what they are, so that what several kinds step by together is one clock's; but who
    exchanges the signals of one kind moves these alone, and others beside them would pass for most of the sky.
    """
    kinds: dict[tuple[str, str, str], list[int]] = {}
    for k in np.flatnonzero(np.isfinite(o.carrier_hz) & np.isfinite(o.pseudorange_m).any(axis=0)):
        kinds.setdefault(o.signals[k].kind, []).append(int(k))
    own = sorted(kinds.values(), key=len, reverse=True)
    alone = [columns for columns in own[1:] if len(columns) >= POLICY.one_sky_satellites]
    few = [k for columns in own[1:] if len(columns) < POLICY.one_sky_satellites for k in columns]
    return [np.array(columns, np.intp) for columns in ([*own[0], *few], *alone)] if own else []
