"""What is known of a followed signal beside its loops, and which signal a new channel is.

A channel proves itself before it gets a letter: that of a signal lost a moment ago if it goes on with it, else the next
one of its satellite. Letters say nothing of authenticity.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

from skyproof.gnss.lnav import Subframe
from skyproof.gnss.signals import SignalDescription
from skyproof.receiver import telemetry as tm
from skyproof.records import SignalId

__all__ = ["Arc", "Channel", "Gap", "LostSignal", "Place", "arc_of", "continued", "letter"]

FORGET_S = 30.0
"""A lost signal that is found again within this time, near its old delay, keeps its letter."""
GAP_VOTES = 3
"""So many signals that come back with one common shift of delay say that samples are missing."""

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
    """

    elapsed_s: float
    shift_s: float
    signals: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Arc:
    """A stretch of uninterrupted tracking: which signal, and what its message told (as of the last frame)."""

    signal: SignalId
    found_s: float
    missed_s: float
    began: Began
    tow_ms_at_period_0: int | None
    bit_synchronised: bool
    bits_period: int
    subframes: Mapping[int, Subframe]


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
    )


def continued(
    lost: Sequence[LostSignal], found: Sequence[tuple[str, Place]], signal: SignalDescription
) -> tuple[list[LostSignal | None], Gap | None]:
    """Which lost signal each of the found ones (satellite, place) goes on with.

    One goes on with the other if their delays agree after the time between. Where they do not, but several disagree by
    the same shift, samples are missing.
    """
    matches: list[LostSignal | None] = [None] * len(found)
    free = list(lost)

    def match(shift_chips: float) -> int:
        count = 0
        for i, (sat, place) in enumerate(found):
            if matches[i] is not None:
                continue
            for old in free:
                if old.sat == sat and _agree(old.place, place, shift_chips, signal):
                    matches[i] = old
                    free.remove(old)
                    count += 1
                    break
        return count

    match(0.0)
    open_found = [item for item, old in zip(found, matches, strict=True) if old is None]
    shifts = [
        _shift_chips(old.place, place, signal) for old, (sat, place) in product(free, open_found) if old.sat == sat
    ]
    votes = [sum(abs(_wrapped(a - b, signal)) < 0.5 for b in shifts) for a in shifts]
    if not votes or max(votes) < GAP_VOTES:
        return matches, None
    shift = shifts[votes.index(max(votes))]
    gone_s = max(old.place.at_s for old in free)
    count = match(shift)
    return matches, Gap(elapsed_s=gone_s, shift_s=shift / signal.chip_rate_hz, signals=count)


def _shift_chips(old: Place, new: Place, signal: SignalDescription) -> float:
    return _wrapped((new.delay_s - old.delay_at_s(new.at_s, signal)) * signal.chip_rate_hz, signal)


def _agree(old: Place, new: Place, shift_chips: float, signal: SignalDescription) -> bool:
    apart = _wrapped(_shift_chips(old, new, signal) - shift_chips, signal)
    return abs(apart) < 0.3 + 0.02 * (new.at_s - old.at_s)


def _wrapped(chips: float, signal: SignalDescription) -> float:
    return chips - signal.code_length * round(chips / signal.code_length)


def letter(number: int) -> str:
    """a, b, ... z, aa, ab, ...: the name of the n-th copy found."""
    text = ""
    number += 1
    while number > 0:
        number, digit = divmod(number - 1, 26)
        text = chr(ord("a") + digit) + text
    return text
