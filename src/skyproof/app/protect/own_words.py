"""What a receiver says of itself in its log, made ready to stand beside our answer; it is never evidence."""

from collections.abc import Iterator
from typing import Any, Final, cast

import numpy as np

from skyproof.app.protect.outcome import DIGITS
from skyproof.app.protect.positions import Track
from skyproof.app.receive.observed import ObservedFile, OwnWords
from skyproof.app.receive.reception import Reception
from skyproof.arrays import Integers, Reals
from skyproof.fusion.policy import POLICY
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import format_iso
from skyproof.logs.content import ReceiverStates
from skyproof.records import ReceiverFixes
from skyproof.verdict import OwnFix, OwnState

__all__ = ["compare_receiver_fix", "list_receiver_states", "select_receiver_words", "select_rows_with_place"]

_MOST_STATES: Final = 20
"""Spells of a subject that are listed: those that alarm first."""


def select_receiver_words(reception: Reception) -> OwnWords:
    """Return what the receiver says of itself; nothing of a recording."""
    return reception.source.own if isinstance(reception.source, ObservedFile) else OwnWords()


def select_rows_with_place(fixes: ReceiverFixes | None) -> Integers:
    """Return the rows of fixes that have a place."""
    return np.empty(0, np.intp) if fixes is None else np.flatnonzero(np.isfinite(fixes.position_ecef_m).all(axis=1))


def list_receiver_states(states: ReceiverStates | None) -> tuple[OwnState, ...]:
    """Return spells of one word of each subject, in order of time; of several front ends the one that alarms."""
    if states is None:
        return ()
    found = [spell for subject in dict.fromkeys(states.subject.tolist()) for spell in _spells(states, subject)]
    return tuple(sorted(found, key=lambda spell: spell.since_gpst))


def _spells(states: ReceiverStates, subject: str) -> Iterator[OwnState]:
    rows = np.flatnonzero(states.subject == subject)
    rows = rows[np.lexsort((~states.alarm[rows], states.gpst[rows]))]
    rows = rows[np.unique(states.gpst[rows], return_index=True)[1]]
    words, alarms = states.state[rows], states.alarm[rows]
    first = np.flatnonzero(np.append(True, words[1:] != words[:-1]))
    last = np.append(first[1:], rows.size) - 1
    chosen = np.sort(np.argsort(~alarms[first], kind="stable")[:_MOST_STATES])
    for begin, end in zip(first[chosen].tolist(), last[chosen].tolist(), strict=True):
        yield OwnState(
            subject=cast(Any, subject),
            state=str(words[begin]),
            alarm=bool(alarms[begin]),
            since_gpst=format_iso(states.gpst[rows[begin]], DIGITS),
            until_gpst=format_iso(states.gpst[rows[end]], DIGITS),
        )


def compare_receiver_fix(fixes: ReceiverFixes | None, trusted: Track | None) -> OwnFix | None:
    """Return the receiver's last fix, and how far its fixes lie from the trusted ones of the same epochs."""
    rows = select_rows_with_place(fixes)
    if fixes is None or not rows.size:
        return None
    last = int(rows[-1])
    lat, lon, height_m = (float(value) for value in geodetic_from_ecef(fixes.position_ecef_m[last]))
    sigma_m = float(fixes.horizontal_sigma_m[last])
    away_m, epochs = _away_m(fixes, rows, trusted)
    most = int(np.argmax(away_m)) if away_m.size else None
    return OwnFix(
        gpst=format_iso(fixes.gpst[last], DIGITS),
        lat_deg=float(np.degrees(lat)),
        lon_deg=float(np.degrees(lon)),
        height_m=height_m,
        horizontal_sigma_m=sigma_m if np.isfinite(sigma_m) else None,
        from_trusted_m=float(away_m[-1]) if away_m.size else None,
        most_from_trusted_m=None if most is None else float(away_m[most]),
        most_from_trusted_gpst=None if most is None else format_iso(fixes.gpst[epochs[most]], DIGITS),
    )


def _away_m(fixes: ReceiverFixes, rows: Integers, trusted: Track | None) -> tuple[Reals, Integers]:
    """Return horizontal distances at common epochs, and the rows of fixes of those."""
    if trusted is None or not trusted.fixed.any():
        return np.empty(0), np.empty(0, np.intp)
    ours = np.flatnonzero(trusted.fixed)
    times, theirs = trusted.gpst[ours].astype(np.int64), fixes.gpst[rows].astype(np.int64)
    after = np.clip(np.searchsorted(times, theirs), 1, max(times.size - 1, 1))
    after = np.minimum(after, times.size - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(times[before] - theirs) <= np.abs(times[after] - theirs), before, after)
    same = np.abs(times[nearest] - theirs) <= 1e9 * POLICY.same_epoch_s
    apart_m = fixes.position_ecef_m[rows[same]] - trusted.position_ecef_m[ours[nearest[same]]]
    lat, lon, _ = geodetic_from_ecef(trusted.position_ecef_m[ours[0]])
    enu_m = apart_m @ rot_enu_ecef(lat, lon).T
    return np.asarray(np.hypot(enu_m[:, 0], enu_m[:, 1])), rows[same]
