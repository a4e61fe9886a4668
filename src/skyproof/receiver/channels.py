"""What is known of a followed signal beside its loops, and which signal a new channel is.

A channel proves itself before it gets a letter: that of a signal lost a moment ago if it goes on with it, else the next
one of its satellite. Letters say nothing of authenticity.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Final, Literal, overload

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.lnav import Subframe
from skyproof.gnss.signals import SignalDescription
from skyproof.receiver import telemetry as tm
from skyproof.receiver.polarity import Stretch
from skyproof.records import SignalId

__all__ = ["Arc", "Channel", "Gap", "LostSignal", "Place", "arc_of", "continued", "letter"]

FORGET_S = 30.0
"""A lost signal that is found again within this time, near its old delay, keeps its letter."""
GAP_VOTES = 3
"""So many signals that come back with one common shift of delay say that samples are missing."""

_ALIKE_CHIPS: Final = 0.5
_HIGHEST_HZ: Final = 5e3  # of a satellite's Doppler

Began = Literal["found", "found again", "pulled away", "after a gap"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Channel:
    """One tracked signal.

    copy is None until the channel is confirmed. missed_s is NaN if the first search found it.
    began : why its arc began; "pulled away": code and carrier parted, so what it follows now may be another signal.
    """

    sat: str
    began_s: float
    found_s: float
    missed_s: float
    arc: int
    copy: str | None = None
    began: Began = "found"
    telemetry: tm.Telemetry = field(default_factory=tm.Telemetry)


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a signal was: the delay of a code period's start after a moment of receiver time, and its Doppler."""

    at_s: float
    delay_s: float
    doppler_hz: float

    def delay_at_s(self, at_s: float, signal: SignalDescription) -> float:
        """The delay carried by its Doppler to another moment."""
        return self.delay_s - self.doppler_hz / signal.carrier_hz * (at_s - self.at_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class LostSignal:
    """A confirmed signal that is not tracked at the moment."""

    sat: str
    copy: str
    found_s: float
    missed_s: float
    place: Place


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Samples that are missing: the carriers of all signals jumped at once, or they came back with one shift of code.

    shift_s : of the code's delay, modulo a code period; that many seconds less are missing, modulo the same.
    missing_s : roughly, by how far the satellites moved meanwhile; 0 where that is too little to tell.
    """

    elapsed_s: float
    shift_s: float
    signals: int
    missing_s: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Arc:
    """A stretch of uninterrupted tracking: which signal, and what its message stated (as of the last frame)."""

    signal: SignalId
    found_s: float
    missed_s: float
    began: Began
    tow_ms_at_period_0: int | None
    bit_synchronised: bool
    bits_period: int
    subframes: Mapping[int, Subframe]
    stretches: tuple[Stretch, ...] = ()


def arc_of(channel: Channel, signal: SignalDescription) -> Arc:
    """The arc of a confirmed channel as it stands."""
    assert channel.copy is not None
    return Arc(
        signal=SignalId(channel.sat, signal.band, signal.code_name, channel.copy),
        found_s=channel.found_s,
        missed_s=channel.missed_s,
        began=channel.began,
        tow_ms_at_period_0=channel.telemetry.tow_ms_at_period_0,
        bit_synchronised=channel.telemetry.synchronised,
        bits_period=channel.telemetry.bits_period,
        subframes=channel.telemetry.subframes,
        stretches=channel.telemetry.stretches,
    )


def continued(
    lost: Sequence[LostSignal], found: Sequence[tuple[str, Place]], signal: SignalDescription
) -> tuple[list[LostSignal | None], Gap | None]:
    """Which lost signal each of the found ones (satellite, place) goes on with.

    One goes on with the other if their delays agree after the time between. Where they do not, but those of several
    satellites do once the same time is taken to be missing, samples are.
    """
    matches: list[LostSignal | None] = [None] * len(found)
    free = list(lost)

    def match(shift_chips: float, missing_s: float) -> int:
        count = 0
        for i, (sat, place) in enumerate(found):
            if matches[i] is not None:
                continue
            for old in free:
                apart = _wrapped(_shift_chips(old.place, place, signal, missing_s) - shift_chips, signal)
                if old.sat == sat and abs(apart) < 0.3 + 0.02 * (place.at_s - old.place.at_s):
                    matches[i] = old
                    free.remove(old)
                    count += 1
                    break
        return count

    match(0.0, 0.0)
    open_found = [item for item, old in zip(found, matches, strict=True) if old is None]
    pairs = [(old, place) for old, (sat, place) in product(free, open_found) if old.sat == sat]
    common = _common_shift(pairs, signal) if len({old.sat for old, _ in pairs}) >= GAP_VOTES else None
    if common is None:
        return matches, None
    shift, missing_s = common
    gone_s = max(old.place.at_s for old in free)
    count = match(shift, missing_s)
    return matches, Gap(elapsed_s=gone_s, shift_s=shift / signal.chip_rate_hz, signals=count, missing_s=missing_s)


def _common_shift(pairs: Sequence[tuple[LostSignal, Place]], signal: SignalDescription) -> tuple[float, float] | None:
    """The shift of code (chips) that most satellites share, and the missing time (s) that makes them share it.

    Missing time shifts all codes alike, and each by its own range rate besides: half a chip in 0.15 s at 5 kHz. The
    shortest is taken, for without need none is reported. None if fewer than `GAP_VOTES` satellites share one.
    """
    sats = np.array([old.sat for old, _ in pairs])
    steps_s = np.arange(0.0, FORGET_S, 0.5 * _ALIKE_CHIPS * signal.carrier_hz / signal.chip_rate_hz / _HIGHEST_HZ)
    shifts = np.stack([_shift_chips(old.place, place, signal, steps_s) for old, place in pairs])  # (pair, step)
    votes = np.empty(shifts.shape, np.int64)
    for i in range(len(pairs)):
        alike = np.abs(_wrapped(shifts - shifts[i], signal)) < _ALIKE_CHIPS
        votes[i] = sum(alike[sats == sat].any(axis=0) for sat in np.unique(sats))
    step = int(np.argmax(votes.max(axis=0)))
    best = int(np.argmax(votes[:, step]))
    if votes[best, step] < GAP_VOTES:
        return None
    apart = _wrapped(shifts[:, step] - shifts[best, step], signal)
    alike = np.abs(apart) < _ALIKE_CHIPS
    if step == 0:
        return float(shifts[best, 0] + np.mean(apart[alike])), 0.0
    rates = _wrapped(shifts[:, 1] - shifts[:, 0], signal) / steps_s[1]  # chips a second that is missing
    design = np.stack([np.ones(int(alike.sum())), -rates[alike]], axis=1)
    (further, later_s), *_ = np.linalg.lstsq(design, apart[alike], rcond=None)
    return float(shifts[best, step] + further), float(steps_s[step] + later_s)


@overload
def _shift_chips(old: Place, new: Place, signal: SignalDescription, missing_s: float) -> float: ...
@overload
def _shift_chips(old: Place, new: Place, signal: SignalDescription, missing_s: Reals) -> Reals: ...
def _shift_chips(old: Place, new: Place, signal: SignalDescription, missing_s: float | Reals) -> float | Reals:
    """By how much the code comes later than it should, if so much time is missing as well."""
    predicted_s = old.delay_at_s(new.at_s, signal)
    moved_s = 0.5 * (old.doppler_hz + new.doppler_hz) / signal.carrier_hz * missing_s
    return _wrapped((new.delay_s - predicted_s + moved_s) * signal.chip_rate_hz, signal)


@overload
def _wrapped(chips: float, signal: SignalDescription) -> float: ...
@overload
def _wrapped(chips: Reals, signal: SignalDescription) -> Reals: ...
def _wrapped(chips: float | Reals, signal: SignalDescription) -> float | Reals:
    return chips - signal.code_length * np.rint(chips / signal.code_length)


def letter(number: int) -> str:
    """a, b, ... z, aa, ab, ...: the name of the n-th copy found."""
    text = ""
    number += 1
    while number > 0:
        number, digit = divmod(number - 1, 26)
        text = chr(ord("a") + digit) + text
    return text
