"""Joint channels in the receiver: when one looks, what its signals are called, and what it measures for their loops.

Every signal of a joint channel has a channel with loops of its own, so that searches, letters and messages know it. As
long as there are several signals, the loops are open and are put where the joint channel has their signals, frame by
frame; their measurements are those of its rows. Data bits are those of the strongest signal's prompts: the sum of all
is in phase with that one, if with any.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.receiver import joining
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.channels import Channel, arc_of, letter, lost_of
from skyproof.receiver.joining import JointlyFollowed, JointReceiver, apart_chips, handed_back, is_needed, shown_chips
from skyproof.receiver.joint_tracker import Followed
from skyproof.receiver.keeping import Given
from skyproof.receiver.measurement import SLIP_SUSPECTED_CYC
from skyproof.receiver.settings import MEASURE_FRAMES, ReceiverSettings
from skyproof.receiver.state import ReceiverState, kept, place_of, with_channel

__all__ = [
    "followed_jointly",
    "joined",
    "led",
    "led_on",
    "looked_into",
    "measured_jointly",
    "unheard",
    "with_bits_of_the_strongest",
]

MOVED_DB = 1.0
MOVED_SIGMAS = 4.0
"""A strength that differs so much from its mean over a second moves."""
JUMP_SIGMAS = 6.0
LOOK_ROWS = 3
"""A joint channel that has found nothing in so many rows will not find anything soon."""
POWER_STRIDE = 61


def led(state: ReceiverState) -> Booleans:
    """Which channels' loops follow a joint channel (n_channels,)."""
    arcs = {arc for one in state.joint if one.leads for arc in one.arcs.values()}
    return np.array([channel.arc in arcs for channel in state.channels], np.bool_)


def joined(state: ReceiverState) -> Booleans:
    """Which channels follow a joint channel, or will once this frame is done (n_channels,)."""
    arcs = {arc for one in state.joint if one.leads or (one.row and one.row.came) for arc in one.arcs.values()}
    return np.array([channel.arc in arcs for channel in state.channels], np.bool_)


def looked_into(state: ReceiverState) -> Booleans:
    """Of which channels a joint channel, this one or one that can begin, has yet to say whether there is another signal
    (n_channels,).
    """
    arcs = {one.arc for one in state.joint if one.rows < LOOK_ROWS and one.suspects}
    taken = {one.sat for one in state.joint}
    begun = state.loops[:, k.BIT_START] >= 0.0
    found = [channel.arc in arcs or channel.sat not in taken for channel in state.channels]
    return np.array(found, np.bool_) & begun & np.array([c.copy is not None for c in state.channels], np.bool_)


def unheard(state: ReceiverState) -> Booleans:
    """Which of these are beside a stronger signal, so that their own prompts tell nothing (n_channels,)."""
    arcs = {arc for one in state.joint if one.leads for name, arc in one.arcs.items() if name != one.strongest}
    return np.array([channel.arc in arcs for channel in state.channels], np.bool_)


def followed_jointly(joint: JointReceiver, state: ReceiverState, given: Given, end: int) -> ReceiverState:
    """Joint channels over the samples up to `end` (absolute), the end of a frame."""
    if not state.joint:
        return state
    ratios = (10.0 ** (0.1 * state.loops[:, k.CN0_DBHZ])).tolist()
    strengths = {channel.arc: (channel.sat, ratio) for channel, ratio in zip(state.channels, ratios, strict=True)}
    samples = state.tail[0, :, : end - state.tail_start]
    found, now = joint.step(state.joint, samples, state.tail_start, strengths)
    given.components += found
    return replace(state, joint=tuple(now))


def led_on(
    joint: JointReceiver,
    state: ReceiverState,
    settings: ReceiverSettings,
    given: Given,
    end: int,
    rows_shape: tuple[int, int],
) -> ReceiverState:
    """At the end of a frame, sample `end`: channels for signals that came, none for those that went; loops where their
    signals are; joint channels where they are needed from now on.
    """
    arcs = {channel.arc for channel in state.channels}
    state = replace(state, joint=tuple(one for one in state.joint if arcs.issuperset(one.arcs.values())))
    for one in state.joint:
        if one.row is not None and one.row.came:
            state = _with_newcomers(joint, state, one, one.row.came, settings, rows_shape)
        elif one.row is not None and one.row.went:
            state = _without(state, one, one.row.went, settings, given)
    state = _steered(joint, state)
    if state.frame % MEASURE_FRAMES:
        return state
    ready = [i for i, c in enumerate(state.channels) if c.copy is not None and state.loops[i, k.BIT_START] >= 0.0]
    if not ready:
        return state
    fresh = state.tail[0, :, end - state.tail_start - round(settings.frame_s * joint.rate_hz) : end - state.tail_start]
    power = 2.0 * float(np.mean(fresh[:, ::POWER_STRIDE] ** 2))
    channels = [(state.channels[i].arc, state.channels[i].sat) for i in ready]
    wanted = _wanted([arc for arc, _ in channels], state, settings, given.measured[-1])
    wanted |= _beside_others(joint, state, end)[ready] | (state.loops[ready, k.SLIPPED] > 0.0)
    state = _without_the_needless(state)
    followed = state.loops[ready]
    now = joint.begin(state.joint, channels, followed, wanted, power, end, _pulled_chips(joint, followed, end))
    loops = state.loops.copy()
    unknown = {arc for one in now[len(state.joint) :] for arc in list(one.arcs.values())[1:]}
    for i, channel in enumerate(state.channels):
        if channel.arc in unknown:  # its carrier beside the first one's
            loops[i, k.SLIPPED] = 1.0
    return replace(state, joint=tuple(now), loops=loops)


def _without_the_needless(state: ReceiverState) -> ReceiverState:
    """Joint channels that are needed; loops that are not led any more go on where they are."""
    loops, were_led = state.loops.copy(), led(state)
    state = replace(state, joint=tuple(one for one in state.joint if is_needed(one)))
    freed = were_led & ~led(state)
    loops[freed, k.RESIDUAL] = loops[freed, k.CODE_MINUS_CARRIER] = np.nan
    return replace(state, loops=loops)


def _wanted(arcs: Sequence[int], state: ReceiverState, settings: ReceiverSettings, last: m.Measurements) -> Booleans:
    """Which arcs are to be looked at: each every few seconds, one after the other, those that moved in their last row
    as a second signal would move them, and those without one: a loop between two signals of some tens of hertz has
    neither.
    """
    rows = round(settings.joint_look_s / settings.frame_s / MEASURE_FRAMES)
    due = np.array([(state.frame // MEASURE_FRAMES + arc) % rows == 0 for arc in arcs])
    mean_dbhz = {c.arc: loop[k.CN0_DBHZ] for c, loop in zip(state.channels, state.loops, strict=True)}
    for place, arc in enumerate(arcs):
        row = np.flatnonzero(last.arc == arc)
        due[place] |= not row.size
        if row.size:
            due[place] |= _moves(last.table[row[-1]], mean_dbhz[arc], MEASURE_FRAMES * settings.frame_s)
    return due


def _beside_others(joint: JointReceiver, state: ReceiverState, end: int) -> Booleans:
    """Which channels have another one of their satellite near to them, proved or not (n_channels,)."""
    shown = [shown_chips(loop, end, joint.rate_hz) for loop in state.loops]
    found = np.zeros(len(shown), np.bool_)
    for i, channel in enumerate(state.channels):
        for n in range(i):
            same = state.channels[n].sat == channel.sat
            if same and abs(apart_chips(shown[i], shown[n], joint.signal)) < joining.PARTED_CHIPS:
                found[[i, n]] = True
    return found


def _pulled_chips(joint: JointReceiver, loops: Reals, end: int) -> Reals:
    """By how much the codes of loops (n, N_STATE) have become later than their carriers say, (n,); 0 where those were
    not compared yet.
    """
    signal, at_s = joint.signal, end / joint.rate_hz
    gone_s = at_s - loops[:, k.START] / joint.rate_hz
    code_s = loops[:, k.PERIODS] * signal.period_s - at_s
    code_s += (loops[:, k.CHIP] + gone_s * loops[:, k.CODE_RATE]) / signal.chip_rate_hz
    phase_cyc = loops[:, k.PHASE] + 0.5 * loops[:, k.HALF_CYCLES] + gone_s * loops[:, k.FREQUENCY]
    apart_s = code_s + (joint.if_hz * at_s - phase_cyc) / signal.carrier_hz
    return np.asarray(np.nan_to_num(loops[:, k.CODE_MINUS_CARRIER] - apart_s) * signal.chip_rate_hz)


def _moves(row: Reals, mean_dbhz: float, duration_s: float) -> bool:
    """Whether a row of measurements (N_COLUMNS,) shows a carrier or a strength that moves."""
    sigma_db = 10.0 / np.log(10.0) * np.sqrt(1.5e-3 / duration_s + 2.0 / (10.0 ** (0.1 * mean_dbhz) * duration_s))
    moved_db = abs(row[m.CN0_DBHZ] - mean_dbhz)
    return bool(row[m.JUMP] > JUMP_SIGMAS or row[m.SLIP] > 0.0 or moved_db > max(MOVED_DB, MOVED_SIGMAS * sigma_db))


# Who is who -----------------------------------------------------------------------------------------------------------


def _with_newcomers(
    joint: JointReceiver,
    state: ReceiverState,
    one: JointlyFollowed,
    names: Sequence[int],
    settings: ReceiverSettings,
    rows_shape: tuple[int, int],
) -> ReceiverState:
    """With a channel for each new signal; where loops are on it already, those."""
    signals, new = {each.name: each for each in joint.tracker(one.sat).now(one.state)}, one
    for name in names:
        state = _without_unproved(joint, state, one.sat, signals[name], settings)
        place = {channel.arc: i for i, channel in enumerate(state.channels)}
        elder, known = place[one.arc], _on(joint, state, one, signals[name], settings)
        if known is None:
            state = _with_channel(joint, state, elder, signals[name], settings, rows_shape)
            arc, counted = state.channels[-1].arc, new.periods[next(iter(one.arcs))]
        else:
            arc = state.channels[known].arc
            more = shown_chips(state.loops[known], signals[name].at, joint.rate_hz) - signals[name].code_chips
            counted = round(state.loops[known, k.PERIODS] + more / joint.signal.code_length)
        new = replace(new, arcs={**new.arcs, name: arc}, periods={**new.periods, name: counted})
    return replace(state, joint=tuple(new if each is one else each for each in state.joint))


def _near(joint: JointReceiver, loop: Reals, signal: Followed, settings: ReceiverSettings) -> bool:
    """Whether a loop is on a signal."""
    shown = shown_chips(loop, signal.at, joint.rate_hz)
    return abs(apart_chips(shown, signal.code_chips, joint.signal)) < settings.merge_chips


def _on(
    joint: JointReceiver, state: ReceiverState, one: JointlyFollowed, signal: Followed, settings: ReceiverSettings
) -> int | None:
    """Number of a channel that is on a signal beside those of the joint channel."""
    for i, channel in enumerate(state.channels):
        other = channel.sat == one.sat and channel.arc not in one.arcs.values()
        if other and _near(joint, state.loops[i], signal, settings):
            return i
    return None


def _without_unproved(
    joint: JointReceiver, state: ReceiverState, sat: str, signal: Followed, settings: ReceiverSettings
) -> ReceiverState:
    """Without channels on a signal that have no letter yet: the joint channel has proved it."""
    near = [
        channel.sat == sat and channel.copy is None and _near(joint, loop, signal, settings)
        for channel, loop in zip(state.channels, state.loops, strict=True)
    ]
    return kept(state, [i for i, is_near in enumerate(near) if not is_near])


def _with_channel(
    joint: JointReceiver,
    state: ReceiverState,
    elder: int,
    signal: Followed,
    settings: ReceiverSettings,
    rows_shape: tuple[int, int],
) -> ReceiverState:
    """With a channel for a new signal: it counts code periods as the elder of its joint channel, and so its message is
    that one's as far as it was read.
    """
    now_s, letters, old = (state.frame + 1) * settings.frame_s, dict(state.letters), state.channels[elder]
    number = letters.get(old.sat, 0)
    letters[old.sat] = number + 1
    channel = Channel(
        sat=old.sat,
        began_s=now_s,
        found_s=now_s,
        missed_s=now_s - 2.0 * MEASURE_FRAMES * settings.frame_s,
        arc=state.next_arc,
        copy=letter(number),
        telemetry=old.telemetry,
    )
    loop = handed_back(state.loops[elder], signal, joint.tracker(old.sat).model, joint.if_hz)
    prompts, delay_s = state.prompts[elder], float(state.locked_at[elder, 1])
    state = with_channel(state, channel, loop, delay_s, antenna=0, rows_shape=rows_shape)
    return replace(state, letters=letters, prompts=(*state.prompts[:-1], prompts))


def _without(
    state: ReceiverState, one: JointlyFollowed, names: Sequence[int], settings: ReceiverSettings, given: Given
) -> ReceiverState:
    """Without the channels of signals that have gone: they are lost where they were."""
    gone = {one.arcs[name] for name in names}
    lost, stay = list(state.lost), []
    for i, channel in enumerate(state.channels):
        if channel.arc in gone:
            given.arcs[channel.arc] = arc_of(channel, settings.signal)
            lost.append(lost_of(channel, place_of(state.locked_at[i]), settings.signal))
        else:
            stay.append(i)
    arcs = {name: arc for name, arc in one.arcs.items() if name not in names}
    periods = {name: count for name, count in one.periods.items() if name not in names}
    new = replace(one, arcs=arcs, periods=periods)
    rest = tuple(new if each is one else each for each in state.joint)
    return replace(kept(state, stay), lost=tuple(lost), joint=rest)


# Loops ----------------------------------------------------------------------------------------------------------------


def _steered(joint: JointReceiver, state: ReceiverState) -> ReceiverState:
    """Loops where joint channels have their signals."""
    loops, place = state.loops.copy(), {channel.arc: i for i, channel in enumerate(state.channels)}
    for one in state.joint:
        if one.leads:
            tracker = joint.tracker(one.sat)
            for signal in tracker.now(one.state):
                i = place[one.arcs[signal.name]]
                loops[i] = handed_back(loops[i], signal, tracker.model, joint.if_hz)
    return replace(state, loops=loops)


def with_bits_of_the_strongest(state: ReceiverState) -> ReceiverState:
    """The prompts of the last frame, of signals beside a stronger one in a joint channel, as that one's: where the
    other is in the way, their own have any sign.
    """
    place, prompts = {channel.arc: i for i, channel in enumerate(state.channels)}, list(state.prompts)
    for one in state.joint:
        if not one.leads or not all(arc in place for arc in one.arcs.values()):
            continue
        voice = place[one.arcs[one.strongest]]
        heard = dict(zip(_counted(state, voice).tolist(), prompts[voice][-1].tolist(), strict=True))
        for name, arc in one.arcs.items():
            i = place[arc]
            if i != voice:
                turned = round(state.loops[i, k.HALF_CYCLES] - state.loops[voice, k.HALF_CYCLES]) % 2
                count = _counted(state, i) - one.periods[name] + one.periods[one.strongest]
                bits = np.array([heard.get(number, 0.0) for number in count.tolist()], np.float32)
                prompts[i] = (*prompts[i][:-1], -bits if turned else bits)
    return replace(state, prompts=tuple(prompts))


def _counted(state: ReceiverState, i: int) -> Reals:
    """Numbers of a channel's code periods in the last frame."""
    return np.asarray(state.rows[i, : state.counts[i], k.OUT_PERIOD])


# Measurements ---------------------------------------------------------------------------------------------------------


def measured_jointly(joint: JointReceiver, state: ReceiverState, table: Reals, elapsed_s: float) -> Reals:
    """The table of measurements (n_channels, N_COLUMNS) with what joint channels measured at this time; NaN of the
    channels they lead where they did not.
    """
    table, place = table.copy(), {channel.arc: i for i, channel in enumerate(state.channels)}
    table[led(state)] = np.nan
    for one in state.joint:
        for signal in one.seen if one.leads else ():
            arc = one.arcs.get(signal.name)
            if arc is not None and abs(signal.at - elapsed_s * joint.rate_hz) < 1.0:
                i = place[arc]
                table[i] = _row_of(joint, signal, state.loops[i], one.periods[signal.name], elapsed_s)
    return table


def _row_of(joint: JointReceiver, one: Followed, loop: Reals, periods: int, elapsed_s: float) -> Reals:
    """A row of measurements (N_COLUMNS,) of a signal, whose loop (N_STATE,) counts whole cycles."""
    signal, row = joint.signal, np.zeros(m.N_COLUMNS)
    code = one.code_chips + periods * signal.code_length
    row[m.PERIODS] = np.floor(code / signal.code_length)
    row[m.FRACTION_S] = (code - row[m.PERIODS] * signal.code_length) / signal.chip_rate_hz
    gone_s = loop[k.START] / joint.rate_hz - elapsed_s
    counted = loop[k.PHASE] + 0.5 * loop[k.HALF_CYCLES] - gone_s * loop[k.FREQUENCY]
    counted += 0.5 * gone_s**2 * loop[k.PLL_ACCELERATION]
    phase = one.phase_cyc + np.rint(counted - one.phase_cyc)
    row[m.CARRIER_CYC] = joint.if_hz * elapsed_s - phase
    row[m.DOPPLER_HZ] = one.hz - joint.if_hz
    row[m.CN0_DBHZ] = one.cn0_dbhz
    row[m.CODE_SIGMA_S] = one.code_sigma_chips / signal.chip_rate_hz
    row[m.CARRIER_SIGMA_CYC] = one.phase_sigma_cyc
    row[m.DOPPLER_SIGMA_HZ] = one.hz_sigma
    row[m.SLIP] = 1.0 if abs(counted - phase) > SLIP_SUSPECTED_CYC else loop[k.SLIPPED]
    row[m.TURNED] = loop[k.HALF_CYCLES] % 2.0
    return row
