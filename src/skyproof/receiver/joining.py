"""Between the loops of single channels and joint channels: handed over and back, and when joint channels are needed.

A joint channel begins with a data bit on the replica of a loop: carrier phase, code and count of code periods go on as
they were. What it says of a signal later is of the same count, so an arc of the loop's goes on through it; and a loop
that is handed back goes on where the filter is.

A joint channel costs as much as two loops, so it runs only where it is needed: on signals of one satellite that are
near to each other; on a single one for one row now and then, to see whether there is another one beside it, or when a
search has found one, or its strength or its carrier moves as a second signal would move them; and then for as long as
rows say that there may be.
"""

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Floats, Reals
from skyproof.gnss.signals import SignalPlan, prn_of
from skyproof.receiver import joint as j
from skyproof.receiver import kernels as k
from skyproof.receiver.joint import Joint
from skyproof.receiver.joint_channel import JointChannel, JointRow
from skyproof.receiver.joint_model import JointModel
from skyproof.receiver.joint_tracker import Followed, JointState, JointTracker, Replica

__all__ = [
    "PARTED_CHIPS",
    "Components",
    "JointReceiver",
    "JointlyFollowed",
    "apart_chips",
    "handed_back",
    "handed_over",
    "is_needed",
    "shown_chips",
]

TOGETHER_CHIPS = 1.4
"""Signals of a satellite nearer to each other than this are of one joint channel."""
PARTED_CHIPS = 1.6
"""Further apart they are of loops of their own again."""
HZ_SIGMA = 2.0
CHIPS_SIGMA = 0.05


def handed_over(
    tracker: JointTracker, loops: Reals, sample_power: float, at: float, pulled_chips: float = 0.0
) -> JointState:
    """A joint channel on the loops (n, N_STATE) of one satellite's signals, the first of which gives the replica: from
    the last data bit that has begun at sample `at`, or where its rows fit epochs.

    Its data bits must be known. sample_power : mean of I^2 + Q^2 of the samples' noise. pulled_chips : by how much the
    first one's code has become later than its carrier says: a newcomer that draws it away is told from it by where it
    is expected.

    A loop knows its carrier up to half a cycle, and beside another signal less than that: of all but the first the
    amplitude's size alone is taken over, and phases are what the first bit shows.
    """
    model, signal = tracker.model, tracker.model.signal
    replica = _bit_at(loops[0], model, at)
    n = len(loops)
    mean, variance = np.zeros((n, j.N_STATE)), np.empty((n, j.N_STATE))
    for i, loop in enumerate(loops):
        size = math.sqrt(model.energy(float(loop[k.CN0_DBHZ])))
        mean[i, j.HZ] = loop[k.FREQUENCY] - replica.hz
        mean[i, j.CHIPS] = apart_chips(shown_chips(loop, replica.start, model.rate_hz), replica.chip, signal)
        if i == 0:  # half a bit before the first one, to where the filter's first step begins
            mean[i, j.RE] = size
        spread = 0.3 * size + 1.0 if i == 0 else size + 1.0
        sigmas = [spread, spread, HZ_SIGMA, model.settings.common_hz_s, CHIPS_SIGMA, 2e-3]
        variance[i] = np.array(sigmas) ** 2
    joint = Joint(mean=mean, covariance=np.diag(variance.ravel()), settings=model.settings)
    before = mean.copy()
    before[0, j.CHIPS] -= pulled_chips
    channel = JointChannel(joint=joint, before=replace(joint, mean=before), names=tuple(range(n)), next_name=n)
    noise = model.look_s * model.rate_hz * sample_power * tracker.replica_power
    return tracker.aligned(JointState(replica=replica, row_began=replica, channel=channel, noise=noise))


def _bit_at(loop: Reals, model: JointModel, at: float) -> Replica:
    """The loop's replica where the last data bit began before sample `at`.

    Whole and half cycles by which the loop has slipped, as its measurements mend them, are in its phase.
    """
    signal = model.signal
    bit, length = signal.periods_per_symbol, signal.code_length
    shown = loop[k.PERIODS] + shown_chips(loop, at, model.rate_hz) / length
    periods = math.floor((shown - loop[k.BIT_START]) / bit) * bit + int(loop[k.BIT_START])
    chips = (periods - loop[k.PERIODS]) * length - loop[k.CHIP]
    start = int(loop[k.START]) + math.ceil(chips / loop[k.CODE_RATE] * model.rate_hz)
    gone_s = (start - loop[k.START]) / model.rate_hz
    return Replica(
        start=start,
        chip=float(gone_s * loop[k.CODE_RATE] - chips),
        phase_cyc=float(loop[k.PHASE] + 0.5 * loop[k.HALF_CYCLES] + gone_s * loop[k.FREQUENCY]),
        hz=float(loop[k.FREQUENCY]),
        periods=periods,
    )


def shown_chips(loop: Reals, at: float, rate_hz: float) -> float:
    """Chips that a loop's code shows at a sample, since its next code period's start."""
    return float(loop[k.CHIP] + (at - loop[k.START]) / rate_hz * loop[k.CODE_RATE])


def apart_chips(one: float, other: float, signal: SignalPlan) -> float:
    """By how much a code that shows `one` is later than a code that shows `other`, within half a code period."""
    length = signal.code_length
    return (other - one + 0.5 * length) % length - 0.5 * length


def handed_back(loop: Reals, one: Followed, model: JointModel, if_hz: float = 0.0) -> Reals:
    """A loop (N_STATE,) that goes on, at its own next code period, where the joint channel has the signal.

    Count of code periods, whole cycles, and half ones that its measurements mend, stay the loop's.
    """
    signal, steered = model.signal, loop.copy()
    gone_s = (loop[k.START] - one.at) / model.rate_hz
    hz = one.hz + one.hz_s * gone_s
    code_rate = signal.chip_rate_hz * (1.0 + (hz - if_hz) / signal.carrier_hz)
    shown = one.code_chips + gone_s * code_rate
    length = signal.code_length
    # The next period begins at the first sample after the code's start.
    off = (shown - loop[k.CHIP] + 0.5 * length) % length - 0.5 * length
    chip = loop[k.CHIP] + off
    skip = math.ceil(-chip / code_rate * model.rate_hz) if chip < 0.0 else 0
    steered[k.START] += skip
    steered[k.CHIP] = chip + skip * code_rate / model.rate_hz
    mended, gone_s = 0.5 * loop[k.HALF_CYCLES], (steered[k.START] - one.at) / model.rate_hz
    phase = one.phase_cyc + gone_s * one.hz + 0.5 * gone_s**2 * one.hz_s
    whole = np.rint(loop[k.PHASE] + skip / model.rate_hz * loop[k.FREQUENCY] + mended - phase)
    steered[k.PHASE] = phase + whole - mended
    steered[k.FREQUENCY] = hz
    steered[k.PLL_VELOCITY], steered[k.PLL_ACCELERATION] = hz - if_hz, one.hz_s
    steered[k.CODE_RATE] = code_rate
    steered[k.CN0_DBHZ] = one.cn0_dbhz
    steered[[k.LAST_I, k.LAST_Q, k.CODE_STEER]] = 0.0
    steered[k.SUM_PERIODS : k.SUM_TAPS + 6] = 0.0
    return steered


@dataclass(frozen=True, eq=False, kw_only=True)
class Components:
    """What joint channels say of their signals, one a row.

    arc : of the loop from which the joint channel was handed over; code periods are counted as in it.
    """

    arc: int
    sat: str
    followed: Followed
    score: float


@dataclass(frozen=True, eq=False, kw_only=True)
class JointlyFollowed:
    """One satellite's joint channel beside the loops that it was handed over from.

    arcs : of the loops, by the names that the channel gives its signals. periods : by which the code periods of each
        are counted further than the channel's. row, seen : the row that was completed in the last step and its signals,
        None and nothing where there was none. rows : how many were completed. suspects : whether there may be a further
        signal, by the last one.
    """

    sat: str
    state: JointState
    arcs: Mapping[int, int]
    periods: Mapping[int, int]
    row: JointRow | None = None
    rows: int = 0
    suspects: bool = True
    seen: tuple[Followed, ...] = ()

    @property
    def arc(self) -> int:
        """Of the first of its loops."""
        return next(iter(self.arcs.values()))

    @property
    def leads(self) -> bool:
        """Whether it has several signals, whose loops follow it."""
        return len(self.arcs) > 1

    def tells(self, arcs: Set[int]) -> bool:
        """Whether it tells two arcs apart, or looks whether they are of two signals."""
        known = arcs & set(self.arcs.values())
        return len(known) == len(arcs) if self.leads else bool(known)

    @property
    def strongest(self) -> int:
        """Name of the strongest signal."""
        channel = self.state.channel
        return channel.names[int(np.argmax(np.abs(channel.joint.amplitude)))]


@dataclass(frozen=True, eq=False)
class JointReceiver:
    """Joint channels of a receiver: one for each satellite's signals within a chip and a half of each other."""

    signal: SignalPlan
    rate_hz: float
    if_hz: float = 0.0
    epoch_samples: float = 0.0
    _trackers: dict[str, JointTracker] = field(default_factory=dict)

    def tracker(self, sat: str) -> JointTracker:
        """Of a satellite; made when first asked for."""
        if sat not in self._trackers:
            code: NDArray[np.int8] = self.signal.code(prn_of(sat))
            model = JointModel(signal=self.signal, code=code, rate_hz=self.rate_hz)
            self._trackers[sat] = JointTracker(model, self.if_hz, self.epoch_samples)
        return self._trackers[sat]

    def begin(
        self,
        followed: Sequence[JointlyFollowed],
        channels: Sequence[tuple[int, str]],
        loops: Reals,
        wanted: Booleans,
        sample_power: float,
        at: float,
        pulled_chips: Reals | None = None,
    ) -> list[JointlyFollowed]:
        """Joint channels with new ones on loops that none follows yet: where several are near to each other, and where
        a look is `wanted` (n,).

        channels : arc and satellite of each of the loops (n, N_STATE), whose bits are known. at : sample from which on
        they begin. pulled_chips : (n,) by which their codes have become later than their carriers say.
        """
        now, sats = list(followed), [sat for _, sat in channels]
        for i in sorted(range(len(channels)), key=lambda i: -float(loops[i, k.CN0_DBHZ])):
            sat = channels[i][1]
            if not wanted[i] and sats.count(sat) == 1:
                continue
            if any(sat == one.sat and self._near(loops[i], one.state) for one in now):
                continue
            tracker = self.tracker(sat)
            replica = _bit_at(loops[i], tracker.model, at)
            near = [
                m
                for m, (_, other) in enumerate(channels)
                if m != i and other == sat and abs(self._later(loops[m], replica)) < TOGETHER_CHIPS
            ]
            if not near and not wanted[i]:
                continue
            chosen = [i, *near[: tracker.model.most - 1]]
            state = handed_over(
                tracker, loops[chosen], sample_power, at, 0.0 if pulled_chips is None else pulled_chips[i]
            )
            counted = [round(self._shown(loops[m], at) - self._shown(loops[i], at)) for m in chosen]
            arcs = {name: channels[m][0] for name, m in enumerate(chosen)}
            now.append(JointlyFollowed(sat=sat, state=state, arcs=arcs, periods=dict(enumerate(counted))))
        return now

    def _shown(self, loop: Reals, at: float) -> float:
        """Code periods that a loop has counted at a sample."""
        return float(loop[k.PERIODS] + shown_chips(loop, at, self.rate_hz) / self.signal.code_length)

    def _near(self, loop: Reals, state: JointState) -> bool:
        """Whether a joint channel has a signal near a loop's."""
        later = self._later(loop, state.replica)
        return bool(np.any(np.abs(later - state.channel.joint.mean[:, j.CHIPS]) < TOGETHER_CHIPS))

    def _later(self, loop: Reals, replica: Replica) -> float:
        """By how much (chips) a loop's code is later than a replica's."""
        return apart_chips(shown_chips(loop, replica.start, self.rate_hz), replica.chip, self.signal)

    def step(
        self,
        followed: Sequence[JointlyFollowed],
        planes: Floats,
        first: int,
        strengths: Mapping[int, tuple[str, float]],
    ) -> tuple[list[Components], list[JointlyFollowed]]:
        """All joint channels over the samples (2, n), of which the first has absolute index `first`.

        strengths : satellite, and C/N0 as a ratio, Hz, of each loop's arc.

        Gives what the rows that were completed say, and the channels that are needed further.
        """
        found, now = [], []
        for one in followed:
            least_dbhz = 10.0 * math.log10(max(self.signal.highest_side_lobe**2 * _beside(one, strengths), 1e-9))
            rows, state = self.tracker(one.sat).step(one.state, planes, first, least_dbhz)
            one = replace(one, state=state, row=None, seen=())
            for row, seen in rows:
                seen = [] if row.lost else seen
                found += [Components(arc=one.arc, sat=one.sat, followed=each, score=row.score) for each in seen]
                one = replace(one, row=row, rows=one.rows + 1, suspects=row.suspected, seen=tuple(seen))
            now.append(one)
        return found, now


def _beside(one: JointlyFollowed, strengths: Mapping[int, tuple[str, float]]) -> float:
    """C/N0 as a ratio, Hz, of all whose side lobes reach a joint channel: the strongest of each other satellite, and
    signals of its own that lie farther away.
    """
    others: dict[str | int, float] = {}
    for arc, (sat, strength) in strengths.items():
        if arc not in one.arcs.values():
            source = sat if sat != one.sat else arc
            others[source] = max(others.get(source, 0.0), strength)
    return sum(others.values())


def is_needed(one: JointlyFollowed) -> bool:
    """Whether there are several signals near to each other, or may be."""
    channel = one.state.channel
    if channel.is_lost:
        return False
    if len(channel.names) > 1:
        return float(np.ptp(channel.joint.mean[:, j.CHIPS])) < PARTED_CHIPS
    return one.suspects
