"""Between the loops of single channels and joint channels: handed over and back, and the channels of a receiver that
are followed jointly beside its loops.

A joint channel begins with the data bit that comes next, on the replica of a loop: carrier phase, code and count of
code periods go on as they were. What it says of a signal later is of the same count, so an arc of the loop's goes on
through it; and a loop that is handed back goes on where the filter is.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Floats, Reals
from skyproof.gnss.signals import SignalDescription, prn_of
from skyproof.receiver import joint as j
from skyproof.receiver import kernels as k
from skyproof.receiver.joint import Joint
from skyproof.receiver.joint_channel import JointChannel, JointModel
from skyproof.receiver.joint_tracker import Followed, JointState, JointTracker, Replica

__all__ = ["Components", "JointReceiver", "JointStates", "handed_back", "handed_over"]

JointStates = Mapping[int, tuple[str, JointState]]
"""Joint channels with their satellites, by the arc of the loop from which each was handed over."""

TOGETHER_CHIPS = 1.5
"""Signals of a satellite nearer to each other than this are of one joint channel."""
HZ_SIGMA = 2.0
CHIPS_SIGMA = 0.05


def handed_over(tracker: JointTracker, loops: Reals, sample_power: float) -> JointState:
    """A joint channel on the loops (n, N_STATE) of one satellite's signals, the first of which gives the replica.

    Its data bits must be known. sample_power : mean of I^2 + Q^2 of the samples' noise.

    A loop knows its carrier up to half a cycle, and beside another signal less than that: of all but the first the
    amplitude's size alone is taken over, and phases are what the first bit shows.
    """
    model, signal = tracker.model, tracker.model.signal
    replica = _next_bit(loops[0], model)
    n = len(loops)
    mean, variance = np.zeros((n, j.N_STATE)), np.empty((n, j.N_STATE))
    for i, loop in enumerate(loops):
        size = math.sqrt(model.energy(float(loop[k.CN0_DBHZ])))
        mean[i, j.HZ] = loop[k.FREQUENCY] - replica.hz
        mean[i, j.CHIPS] = _later_chips(loop, replica, signal, model.rate_hz)
        if i == 0:  # half a bit before the first one, to where the filter's first step begins
            mean[i, j.RE] = size
        spread = 0.3 * size + 1.0 if i == 0 else size + 1.0
        sigmas = [spread, spread, HZ_SIGMA, model.settings.common_hz_s, CHIPS_SIGMA, 2e-3]
        variance[i] = np.array(sigmas) ** 2
    joint = Joint(mean=mean, covariance=np.diag(variance.ravel()), settings=model.settings)
    channel = JointChannel(joint=joint, before=joint, names=tuple(range(n)), next_name=n)
    noise = model.look_s * model.rate_hz * sample_power * tracker.replica_power
    return JointState(replica=replica, row_began=replica, channel=channel, noise=noise)


def _next_bit(loop: Reals, model: JointModel) -> Replica:
    """The loop's replica where the next data bit begins."""
    signal = model.signal
    bit = signal.periods_per_symbol
    left = (int(loop[k.BIT_START]) - int(loop[k.PERIODS])) % bit
    chips = left * signal.code_length - loop[k.CHIP]
    start = int(loop[k.START]) + max(math.ceil(chips / loop[k.CODE_RATE] * model.rate_hz), 0)
    gone_s = (start - loop[k.START]) / model.rate_hz
    return Replica(
        start=start,
        chip=float(gone_s * loop[k.CODE_RATE] - chips),
        phase_cyc=float(loop[k.PHASE] + gone_s * loop[k.FREQUENCY]),
        hz=float(loop[k.FREQUENCY]),
        periods=int(loop[k.PERIODS]) + left,
    )


def _later_chips(loop: Reals, replica: Replica, signal: SignalDescription, rate_hz: float) -> float:
    """By how much a loop's code is later than the replica's, within half a code period."""
    length = signal.code_length
    gone_s = (replica.start - loop[k.START]) / rate_hz
    shown = loop[k.CHIP] + gone_s * loop[k.CODE_RATE]
    return float((replica.chip - shown + 0.5 * length) % length - 0.5 * length)


def handed_back(loop: Reals, one: Followed, model: JointModel, if_hz: float = 0.0) -> Reals:
    """A loop (N_STATE,) that goes on, at its own next code period, where the joint channel has the signal.

    Count of code periods and whole cycles stay the loop's, if it followed the signal before.
    """
    signal, steered = model.signal, loop.copy()
    gone_s = (loop[k.START] - one.middle) / model.rate_hz
    code_rate = signal.chip_rate_hz * (1.0 + (one.hz - if_hz) / signal.carrier_hz)
    shown = one.code_chips + gone_s * code_rate
    length = signal.code_length
    # The next period begins at the first sample after the code's start.
    off = (shown - loop[k.CHIP] + 0.5 * length) % length - 0.5 * length
    chip = loop[k.CHIP] + off
    skip = math.ceil(-chip / code_rate * model.rate_hz) if chip < 0.0 else 0
    steered[k.START] += skip
    steered[k.CHIP] = chip + skip * code_rate / model.rate_hz
    steered[k.PHASE] = one.phase_cyc + (steered[k.START] - one.middle) / model.rate_hz * one.hz
    steered[k.FREQUENCY] = one.hz
    steered[k.PLL_VELOCITY], steered[k.PLL_ACCELERATION] = one.hz - if_hz, 0.0
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


@dataclass(frozen=True, eq=False)
class JointReceiver:
    """Joint channels of a receiver: one for each satellite's signals within a chip and a half of each other."""

    signal: SignalDescription
    rate_hz: float
    if_hz: float = 0.0
    _trackers: dict[str, JointTracker] = field(default_factory=dict)

    def tracker(self, sat: str) -> JointTracker:
        """Of a satellite; made when first asked for."""
        if sat not in self._trackers:
            code: NDArray[np.int8] = self.signal.code(prn_of(sat))
            model = JointModel(signal=self.signal, code=code, rate_hz=self.rate_hz)
            self._trackers[sat] = JointTracker(model, self.if_hz)
        return self._trackers[sat]

    def begin(
        self,
        states: JointStates,
        channels: Sequence[tuple[int, str]],
        loops: Reals,
        sample_power: float,
    ) -> dict[int, tuple[str, JointState]]:
        """Joint channels, by arc, with new ones on loops that none follows yet.

        channels : arc and satellite of each of the loops (n, N_STATE), whose bits are known. Loops of one satellite
        that are near to each other make one channel, of the strongest.
        """
        now = dict(states)
        by_strength = sorted(range(len(channels)), key=lambda i: -float(loops[i, k.CN0_DBHZ]))
        for i in by_strength:
            arc, sat = channels[i]
            if any(sat == other and self._near(loops[i], state) for other, state in now.values()):
                continue
            tracker = self.tracker(sat)
            replica = _next_bit(loops[i], tracker.model)
            near = [
                m
                for m in by_strength
                if m != i
                and channels[m][1] == sat
                and abs(_later_chips(loops[m], replica, self.signal, self.rate_hz)) < TOGETHER_CHIPS
            ]
            now[arc] = sat, handed_over(tracker, loops[[i, *near[: tracker.model.most - 1]]], sample_power)
        return now

    def _near(self, loop: Reals, state: JointState) -> bool:
        """Whether a joint channel has a signal near a loop's."""
        later = _later_chips(loop, state.replica, self.signal, self.rate_hz)
        return bool(np.any(np.abs(later - state.channel.joint.mean[:, j.CHIPS]) < TOGETHER_CHIPS))

    def step(
        self, states: JointStates, planes: Floats, first: int
    ) -> tuple[list[Components], dict[int, tuple[str, JointState]]]:
        """All joint channels over the samples (2, n), of which the first has absolute index `first`.

        Gives what the rows that were completed say, and the channels that still have a signal.
        """
        found, now = [], {}
        for arc, (sat, state) in states.items():
            rows, state = self.tracker(sat).step(state, planes, first)
            for row, followed in rows:
                found += [Components(arc=arc, sat=sat, followed=one, score=row.score) for one in followed]
            if not state.channel.is_lost:
                now[arc] = sat, state
        return found, now
