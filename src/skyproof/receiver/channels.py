"""Keep what is known of a followed signal beside its loops, and decide which signal a new channel is.

A channel proves itself before it gets a letter: that of a signal lost a moment ago if it continues it, else the next
one of its satellite. Letters have nothing to do with authenticity.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Final, Literal, overload

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.lnav import Subframe
from skyproof.gnss.signals import SignalPlan
from skyproof.receiver import telemetry as tm
from skyproof.receiver.polarity import Stretch
from skyproof.records import SignalId

__all__ = [
    "Arc",
    "Channel",
    "DelayDoppler",
    "Gap",
    "LostSignal",
    "arc_from_channel",
    "build_lost_signal",
    "continue_tow",
    "letter",
    "match_lost",
]

FORGET_S = 30.0
"""A lost signal that is found again within this time, near its old delay, keeps its letter."""
GAP_VOTES = 3
"""So many signals, at least, must come back with one common shift of delay to say that samples are missing."""
FALSE_GAP_PROBABILITY: Final = 1e-3
"""That signals which come back anywhere in the code share a shift by chance."""

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
class DelayDoppler:
    """Where a signal was: the delay of a code period's start after a moment of receiver time, and its Doppler.

    period : which code period that is, counted since its channel began.
    """

    at_s: float
    delay_s: float
    doppler_hz: float
    period: int = 0

    def delay_at_s(self, at_s: float, signal: SignalPlan) -> float:
        """Return the delay propagated by its Doppler to another moment."""
        return self.delay_s - self.doppler_hz / signal.carrier_hz * (at_s - self.at_s)

    def periods_to(self, later: "DelayDoppler", signal: SignalPlan) -> int:
        """Count code periods from this one's start to the other's, of one signal that continued between."""
        away_s = (later.at_s - self.at_s) + (later.delay_s - self.delay_s)
        doppler_hz = 0.5 * (self.doppler_hz + later.doppler_hz)
        return round(away_s * (1.0 + doppler_hz / signal.carrier_hz) / signal.period_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class LostSignal:
    """A confirmed signal that is not tracked at the moment.

    tow_ms : time of week at which the code period of `place` was sent; None where it was not read.
    """

    sat: str
    copy: str
    found_s: float
    missed_s: float
    place: DelayDoppler
    tow_ms: int | None = None


@dataclass(frozen=True, kw_only=True)
class Gap:
    """Samples that are missing: the data bits of all signals moved at once, or they came back with one shift of code.

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


def arc_from_channel(channel: Channel, signal: SignalPlan) -> Arc:
    """Build the arc of a confirmed channel in its present state."""
    assert channel.copy is not None
    return Arc(
        signal=SignalId(channel.sat, signal.band, signal.codes[0], channel.copy),
        found_s=channel.found_s,
        missed_s=channel.missed_s,
        began=channel.began,
        tow_ms_at_period_0=channel.telemetry.tow_ms_at_period_0,
        bit_synchronised=channel.telemetry.synchronised,
        bits_period=channel.telemetry.bits_period,
        subframes=channel.telemetry.subframes,
        stretches=channel.telemetry.stretches,
    )


def build_lost_signal(channel: Channel, place: DelayDoppler, signal: SignalPlan) -> LostSignal:
    """Convert a confirmed channel to a lost signal, last received at this place."""
    assert channel.copy is not None
    began_ms = channel.telemetry.tow_ms_at_period_0
    return LostSignal(
        sat=channel.sat,
        copy=channel.copy,
        found_s=channel.found_s,
        missed_s=channel.missed_s,
        place=place,
        tow_ms=None if began_ms is None else began_ms + place.period * signal.period_ms,
    )


def continue_tow(old: LostSignal, place: DelayDoppler, signal: SignalPlan) -> int | None:
    """Return the time of week at code period 0 of the channel that continues a lost signal from `place`.

    Code periods count on through a fade. Data bits, once found, show whether they still begin where that time has them.
    """
    if old.tow_ms is None:
        return None
    return old.tow_ms + (old.place.periods_to(place, signal) - place.period) * signal.period_ms


def match_lost(
    lost: Sequence[LostSignal],
    found: Sequence[tuple[str, DelayDoppler]],
    signal: SignalPlan,
    held: Sequence[tuple[float, DelayDoppler]] = (),
) -> tuple[list[LostSignal | None], Gap | None]:
    """Match lost signals with the found ones (satellite, place) that continue them.

    One continues the other if their delays agree after the time between. If they do not, but those of several
    satellites agree once the same time is taken to be missing, samples are missing. They are not if as many signals
    were `held` all the time, as missing samples would have thrown their codes off. held : since when, and their place.
    """
    matches: list[LostSignal | None] = [None] * len(found)
    free = list(lost)

    def match(shift_chips: float, missing_s: float) -> int:
        count = 0
        for i, (sat, place) in enumerate(found):
            if matches[i] is not None:
                continue
            for old in free:
                apart = _wrap(_shift_chips(old.place, place, signal, missing_s) - shift_chips, signal)
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
    against = sum(
        abs(_wrap(_shift_chips(place, place, signal, missing_s) - shift, signal)) > _ALIKE_CHIPS
        for since_s, place in held
        if since_s < gone_s
    )
    if against >= GAP_VOTES:
        return matches, None
    count = match(shift, missing_s)
    return matches, Gap(elapsed_s=gone_s, shift_s=shift / signal.chip_rate_hz, signals=count, missing_s=missing_s)


def _common_shift(pairs: Sequence[tuple[LostSignal, DelayDoppler]], signal: SignalPlan) -> tuple[float, float] | None:
    """Find the shift of code (chips) that most satellites share, and the missing time (s) that explains it.

    Missing time shifts all codes alike, and each by its own range rate besides: half a chip in 0.15 s at 5 kHz. The
    shortest time is taken, so that none is reported without need. None if fewer satellites share one than
    `_votes_needed`.
    """
    sats = np.array([old.sat for old, _ in pairs])
    steps_s = np.arange(0.0, FORGET_S, 0.5 * _ALIKE_CHIPS * signal.carrier_hz / signal.chip_rate_hz / _HIGHEST_HZ)
    shifts = np.stack([_shift_chips(old.place, place, signal, steps_s) for old, place in pairs])  # (pair, step)
    votes = np.empty(shifts.shape, np.int64)
    for i in range(len(pairs)):
        alike = np.abs(_wrap(shifts - shifts[i], signal)) < _ALIKE_CHIPS
        votes[i] = sum(alike[sats == sat].any(axis=0) for sat in np.unique(sats))
    step = int(np.argmax(votes.max(axis=0)))
    best = int(np.argmax(votes[:, step]))
    if votes[best, step] < _votes_needed(np.unique(sats).size, step + 1, signal):
        return None
    apart = _wrap(shifts[:, step] - shifts[best, step], signal)
    alike = np.abs(apart) < _ALIKE_CHIPS
    if step == 0:
        return float(shifts[best, 0] + np.mean(apart[alike])), 0.0
    rates = _wrap(shifts[:, 1] - shifts[:, 0], signal) / steps_s[1]  # chips a second that is missing
    design = np.stack([np.ones(int(alike.sum())), -rates[alike]], axis=1)
    (further, later_s), *_ = np.linalg.lstsq(design, apart[alike], rcond=None)
    return float(shifts[best, step] + further), float(steps_s[step] + later_s)


def _votes_needed(n_sats: int, n_steps: int, signal: SignalPlan) -> int:
    """Return how many satellites must share a shift so that delays anywhere in the code rarely do by chance.

    It holds at any of the first steps, with `FALSE_GAP_PROBABILITY` at most (the union over all choices of them).
    """
    alike = 2.0 * _ALIKE_CHIPS / signal.code_length
    votes = GAP_VOTES
    while votes < n_sats and n_steps * math.comb(n_sats, votes) * alike ** (votes - 1) > FALSE_GAP_PROBABILITY:
        votes += 1
    return votes


@overload
def _shift_chips(old: DelayDoppler, new: DelayDoppler, signal: SignalPlan, missing_s: float) -> float: ...
@overload
def _shift_chips(old: DelayDoppler, new: DelayDoppler, signal: SignalPlan, missing_s: Reals) -> Reals: ...
def _shift_chips(old: DelayDoppler, new: DelayDoppler, signal: SignalPlan, missing_s: float | Reals) -> float | Reals:
    """Return by how much the code comes later than it should, if so much time is missing as well."""
    predicted_s = old.delay_at_s(new.at_s, signal)
    moved_s = 0.5 * (old.doppler_hz + new.doppler_hz) / signal.carrier_hz * missing_s
    return _wrap((new.delay_s - predicted_s + moved_s) * signal.chip_rate_hz, signal)


@overload
def _wrap(chips: float, signal: SignalPlan) -> float: ...
@overload
def _wrap(chips: Reals, signal: SignalPlan) -> Reals: ...
def _wrap(chips: float | Reals, signal: SignalPlan) -> float | Reals:
    return chips - signal.code_length * np.rint(chips / signal.code_length)


def letter(number: int) -> str:
    """Return the name of the n-th copy found: a, b, ... z, aa, ab, ..."""
    text = ""
    number += 1
    while number > 0:
        number, digit = divmod(number - 1, 26)
        text = chr(ord("a") + digit) + text
    return text
