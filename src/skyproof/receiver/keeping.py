"""Decide which channels stay, which signal each one is, and where arcs end."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.gnss.signals import SignalPlan
from skyproof.receiver import coasting
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver import telemetry as tm
from skyproof.receiver.channels import (
    FORGET_S,
    Arc,
    Began,
    Channel,
    DelayDoppler,
    Gap,
    LostSignal,
    arc_from_channel,
    build_lost_signal,
    continue_tow,
    letter,
    match_lost,
)
from skyproof.receiver.grids import Grids
from skyproof.receiver.guidance import is_guided
from skyproof.receiver.lock import lock_threshold
from skyproof.receiver.measurement import Measurements
from skyproof.receiver.settings import LOCK_FRAMES, TELEMETRY_FRAMES, ReceiverSettings
from skyproof.receiver.state import ReceiverState, keep_channels, place_of

__all__ = ["StepCollector", "confirm", "drop", "end_diverged_arcs", "forget_time", "holds_signal", "read_messages"]

MERGE_HZ = 100.0
SIDE_LOBE_NOISE = 2.5
"""By which noise may raise the power of a side lobe: 4 dB."""
BRIEF_ERROR = 1e-2
"""A short look at the lock may err more often: it decides on one row of measurements, not on the channel."""


@dataclass(kw_only=True)
class StepCollector:
    """What a step gives, as it comes together frame by frame."""

    measured: list[Measurements]
    arcs: dict[int, Arc] = field(default_factory=dict)
    gaps: list[Gap] = field(default_factory=list)
    grids: list[Grids] = field(default_factory=list)
    noncoherent: list[Measurements] = field(default_factory=list)


def holds_signal(state: ReceiverState, n_frames: int, settings: ReceiverSettings) -> Booleans:
    """Tell if each channel holds its signal, by its last `n_frames` frames (fewer if it is younger, or came back)."""
    value, prompts = state.lock[:, -n_frames:, 0], state.lock[:, -n_frames:, 1]
    counted = ~np.isnan(value)
    frames = np.maximum(counted.sum(axis=1), 1)
    mean_value = np.sum(value, axis=1, where=counted) / frames
    mean_prompts = np.maximum(np.sum(prompts, axis=1, where=counted) / frames, 1.0)
    error = settings.false_hold_probability if n_frames == LOCK_FRAMES else BRIEF_ERROR
    return np.asarray(mean_value > lock_threshold(mean_prompts, frames, error))


# ---------------------------------------------------------------------- arcs


def forget_time(
    state: ReceiverState, signal: SignalPlan, given: StepCollector, *, before_s: float = math.inf
) -> ReceiverState:
    """Begin new arcs for all channels that began before; their bits and time of week are to be found again.

    Missing samples shift both by the same time, and only a part of it is known. An arc's time, once read, holds from
    its beginning.
    """
    channels, loops, last_phases = list(state.channels), state.loops.copy(), state.last_phases.copy()
    number = state.next_arc
    for i, channel in enumerate(channels):
        if channel.began_s >= before_s:
            continue
        loops[i, k.BIT_START] = -1.0
        loops[i, [k.RESIDUAL, k.CODE_MINUS_CARRIER]] = np.nan
        last_phases[i] = np.nan
        if channel.copy is not None:
            channel = _start_arc(channel, number, "after a gap", signal, given)
            number += 1
        channels[i] = replace(channel, telemetry=tm.Telemetry())
    return replace(state, channels=tuple(channels), loops=loops, last_phases=last_phases, next_arc=number)


def end_diverged_arcs(
    state: ReceiverState,
    table: Reals,
    good: Booleans,
    elapsed_s: float,
    settings: ReceiverSettings,
    given: StepCollector,
) -> ReceiverState:
    """End the arc of a channel whose code has left its carrier: it was pulled to another signal's peak.

    On one signal code minus carrier moves with the ionosphere only, millimetres a second.
    """
    signal = settings.signal
    loops, channels = state.loops.copy(), list(state.channels)
    code_s = table[:, m.PERIODS] * signal.period_s - elapsed_s + table[:, m.FRACTION_S]
    apart_s = code_s + table[:, m.CARRIER_CYC] / signal.carrier_hz
    reference = loops[:, k.CODE_MINUS_CARRIER]
    limit_s = np.maximum(settings.pulled_chips / signal.chip_rate_hz, 6.0 * table[:, m.CODE_SIGMA_S])
    new = good & ~np.isfinite(reference)
    pulled = good & (np.abs(apart_s - reference) > limit_s)
    loops[good, k.CODE_MINUS_CARRIER] += 0.02 * (apart_s - reference)[good]
    loops[new | pulled, k.CODE_MINUS_CARRIER] = apart_s[new | pulled]
    number = state.next_arc
    for i in np.flatnonzero(pulled):
        if channels[i].copy is not None:
            channels[i] = _start_arc(channels[i], number, "pulled away", signal, given)
            number += 1
    return replace(state, loops=loops, channels=tuple(channels), next_arc=number)


def read_messages(state: ReceiverState, settings: ReceiverSettings, given: StepCollector) -> ReceiverState:
    """Read telemetry every few frames, of channels past their pull-in; tell the loops where bits begin.

    A time of week that moves against the counted code periods means that samples are missing: a new arc.
    """
    if (state.frame + 1) % TELEMETRY_FRAMES:
        return state
    now_s = (state.frame + 1) * settings.frame_s
    channels, loops = list(state.channels), state.loops.copy()
    prompts = list(state.prompts)
    number = state.next_arc
    for i, channel in enumerate(channels):
        new = np.concatenate(prompts[i])
        prompts[i] = ()
        if new.size == 0 or now_s - channel.began_s <= settings.pull_in_s:
            continue
        first = int(loops[i, k.PERIODS]) - new.size
        known_ms = channel.telemetry.tow_ms_at_period_0
        telemetry = tm.step(channel.telemetry, new, first, settings.signal)
        begins = tm.bit_start(telemetry, settings.signal)
        loops[i, k.BIT_START] = -1.0 if begins is None else begins
        if channel.copy is not None and known_ms is not None and known_ms != telemetry.tow_ms_at_period_0:
            channel = _start_arc(channel, number, "after a gap", settings.signal, given)
            number += 1
        channels[i] = replace(channel, telemetry=telemetry)
    return replace(state, channels=tuple(channels), loops=loops, prompts=tuple(prompts), next_arc=number)


def _start_arc(channel: Channel, number: int, began: Began, signal: SignalPlan, given: StepCollector) -> Channel:
    """Begin a new arc of the channel; record the one before as it ended."""
    given.arcs[channel.arc] = arc_from_channel(channel, signal)
    return replace(channel, arc=number, began=began)


# ---------------------------------------------------------------------- which channels stay


def confirm(state: ReceiverState, settings: ReceiverSettings, given: StepCollector) -> ReceiverState:
    """Give channels that have proved themselves a letter.

    It is that of a signal, lost or coasting, that they continue, or the next one.
    """
    if all(channel.copy is not None for channel in state.channels):
        return state
    end_s = (state.frame + 1) * settings.frame_s
    held = holds_signal(state, LOCK_FRAMES, settings)
    due = [
        i
        for i, channel in enumerate(state.channels)
        if channel.copy is None and held[i] and end_s - channel.began_s >= settings.confirm_s - 1e-9
    ]
    if not due:
        return state
    places = [(state.channels[i].sat, place_of(state.locked_at[i])) for i in due]
    coasted = _list_coasting(state, settings.signal)
    still = [
        (channel.began_s, place_of(state.locked_at[i]))
        for i, channel in enumerate(state.channels)
        if channel.copy is not None and held[i] and not _is_on_side_lobe(state, settings.signal, i, due)
    ]
    matches, gap = match_lost((*state.lost, *coasted.values()), places, settings.signal, still)
    letters, channels = dict(state.letters), list(state.channels)
    for i, old, (_, place) in zip(due, matches, places, strict=True):
        channels[i] = _name_channel(channels[i], old, place, letters, settings.signal, goes_on=gap is None)
    lost = tuple(old for old in state.lost if not any(old is match for match in matches))
    state = replace(state, channels=tuple(channels), letters=letters, lost=lost)
    taken = {i for i, old in coasted.items() if any(old is match for match in matches)}
    for i in taken:
        given.arcs[state.channels[i].arc] = arc_from_channel(state.channels[i], settings.signal)
    state = keep_channels(state, [i for i in range(len(state.channels)) if i not in taken])
    if gap is None:
        return state
    given.gaps.append(gap)
    return forget_time(state, settings.signal, given, before_s=gap.elapsed_s)


def _is_on_side_lobe(state: ReceiverState, signal: SignalPlan, channel: int, found: Sequence[int]) -> bool:
    """Tell if only a side lobe of a `found` channel's signal may hold a channel.

    When codes are thrown off, one in four lands on a side lobe, and continues as if nothing had happened.
    """
    power = state.loops[:, k.LOCK_I] - state.loops[:, k.LOCK_Q]
    sat, share = state.channels[channel].sat, SIDE_LOBE_NOISE * signal.highest_side_lobe**2
    return any(state.channels[i].sat == sat and power[channel] < share * power[i] for i in found)


def _name_channel(
    channel: Channel,
    old: LostSignal | None,
    place: DelayDoppler,
    letters: dict[str, int],
    signal: SignalPlan,
    *,
    goes_on: bool,
) -> Channel:
    """Give a channel the letter of its signal: the old signal's if it continues that, else the next one.

    goes_on : whether code periods were counted on since the old signal was lost.
    """
    if old is None:
        number = letters.get(channel.sat, 0)
        letters[channel.sat] = number + 1
        return replace(channel, copy=letter(number))
    telemetry = channel.telemetry
    if goes_on and not telemetry.synchronised:
        telemetry = replace(telemetry, tow_ms_at_period_0=continue_tow(old, place, signal))
    return replace(
        channel, copy=old.copy, found_s=old.found_s, missed_s=old.missed_s, began="found again", telemetry=telemetry
    )


def _list_coasting(state: ReceiverState, signal: SignalPlan) -> Mapping[int, LostSignal]:
    """Return the channels that coast, as signals that may be found elsewhere."""
    coast = np.flatnonzero(np.isfinite(state.courses[:, coasting.SINCE_S]))
    return {
        i: build_lost_signal(state.channels[i], place_of(state.locked_at[i]), signal)
        for i in coast.tolist()
        if state.channels[i].copy is not None
    }


def drop(state: ReceiverState, delays_s: Reals, settings: ReceiverSettings, given: StepCollector) -> ReceiverState:
    """Release channels that never locked, lost lock, or fell on the signal of another channel.

    A confirmed channel whose signal has faded is kept for `coast_s`, and for as long as a lock takes to be judged after
    that; a guided one for `guided_s`.

    delays_s : (n_channels,) of a code period's start after the frame's end.
    """
    end_s = (state.frame + 1) * settings.frame_s
    held = holds_signal(state, LOCK_FRAMES, settings)
    doubles = _find_doubles(state, delays_s, settings)
    lost = tuple(old for old in state.lost if end_s - old.place.at_s < FORGET_S)
    if held.all() and not doubles:
        return replace(state, lost=lost) if lost != state.lost else state
    judged = ~np.isnan(state.lock[:, :, 0]).any(axis=1)
    away_s = end_s - state.locked_at[:, 0]
    lasts = ~judged & (away_s < settings.coast_s) | is_guided(state.guides, end_s) & (away_s < settings.guided_s)
    stay: list[int] = []
    for i, channel in enumerate(state.channels):
        is_young = end_s - channel.began_s < settings.confirm_s - 1e-9
        if i not in doubles and (is_young or held[i] or (channel.copy is not None and lasts[i])):
            stay.append(i)
        elif channel.copy is not None:
            given.arcs[channel.arc] = arc_from_channel(channel, settings.signal)
            lost = (*lost, build_lost_signal(channel, place_of(state.locked_at[i]), settings.signal))
    return replace(keep_channels(state, stay), lost=lost)


def _find_doubles(state: ReceiverState, delays_s: Reals, settings: ReceiverSettings) -> set[int]:
    """Find channels that follow the signal of another one of their satellite with a better right to it.

    The better one was not pulled there, or is older.
    """
    signal, hz = settings.signal, state.loops[:, k.FREQUENCY].tolist()
    of_sat: dict[str, list[int]] = {}
    for i, channel in enumerate(state.channels):
        of_sat.setdefault(channel.sat, []).append(i)
    doubles = set()
    for numbers in of_sat.values():
        by_right = sorted(numbers, key=lambda i: (state.channels[i].began == "pulled away", i))
        for place, i in enumerate(by_right):
            for j in by_right[:place]:
                apart_s = math.remainder(float(delays_s[i] - delays_s[j]), signal.period_s)
                same_hz = abs(hz[i] - hz[j]) < MERGE_HZ
                if same_hz and abs(apart_s) * signal.chip_rate_hz < settings.merge_chips:
                    doubles.add(i)
    return doubles
