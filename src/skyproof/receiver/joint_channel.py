"""One satellite's signals within a chip and a half as one channel: data bit in, rows of measurements out.

The filter of `joint` goes from bit to bit; ten bits make a row, which is measured anew by itself and searched for
signals that begin; signals end by the tests of `components`. Between rows the replica may be moved to where the signals
are: `rebased`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from skyproof.arrays import Complexes, Reals
from skyproof.receiver import joint as j
from skyproof.receiver.births import found_anew, wiped, with_newcomer
from skyproof.receiver.components import faint, newcomer, unresolved
from skyproof.receiver.joint import Joint, Row
from skyproof.receiver.joint_model import JointModel

__all__ = ["JointChannel", "JointRow", "bits", "rebased", "replica_of", "started"]

BORN_CHIPS_S = 0.02
"""How fast code and carrier of a newcomer may part, rms: 6 m/s."""
LEAVE_ROWS = 5
"""So many rows on end a signal is faint, or not told from another, before it is given up."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointRow:
    """A row: signals by name, as the filter has them at the row's middle and as its looks alone show them.

    names : of the n signals, in their order in `filtered` and `alone`. filtered : (n, N_STATE); sigma : (n, N_STATE).
    alone : white from row to row. score : largest of a further signal. came, went : names.
    suspected : whether there may be a further signal that is no other satellite's.
    lost : whether it shows that the filter does not have the signals, so that nothing of it is to be believed.
    dark : whether the signs of half the data bits were not to be seen.
    """

    names: tuple[int, ...]
    filtered: Reals
    sigma: Reals
    alone: Row
    score: float
    suspected: bool = False
    lost: bool = False
    dark: bool = False
    came: tuple[int, ...] = ()
    went: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class JointChannel:
    """What is remembered: the filter at the middle of the last bit, and at that of the last one of the row before; the
    bits of the row begun, and their signs; names of the signals.
    young : whether a signal was born in the row before, of whose bits some may have been read with the wrong sign: the
        filter is set anew by the first whole row.
    """

    joint: Joint
    before: Joint
    names: tuple[int, ...] = (0,)
    next_name: int = 1
    looks: tuple[Complexes, ...] = ()
    signs: tuple[float, ...] = ()
    doubtful: int = 0  # rows on end
    young: bool = False

    @property
    def is_lost(self) -> bool:
        """Whether its only signal has been faint for long enough to be given up."""
        return self.doubtful >= LEAVE_ROWS


def started(
    model: JointModel, amplitude: complex, hz: float, *, hz_sigma: float = 2.0, chips_sigma: float = 0.05
) -> JointChannel:
    """A channel of one signal, on the replica; its amplitude in sigmas of a look at half a bit before the first one."""
    mean = np.zeros((1, j.N_STATE))
    mean[0, j.RE], mean[0, j.IM], mean[0, j.HZ] = amplitude.real, amplitude.imag, hz
    spread = 0.3 * abs(amplitude) + 1.0
    variance = np.array([spread, spread, hz_sigma, model.settings.common_hz_s, chips_sigma, 2e-3]) ** 2
    joint = Joint(mean=mean, covariance=np.diag(variance), settings=model.settings)
    return JointChannel(joint=joint, before=joint)


def bits(
    model: JointModel, channels: Sequence[JointChannel], looks: Complexes, least: float = 0.0
) -> list[tuple[JointChannel, JointRow | None]]:
    """Data bits on: looks (n_channels, n_bits, n_looks, d), whitened, in sigmas of the noise of one; no more bits than
    the row begun still takes. A row where it is complete.

    least : amplitude, in sigmas of a look, up to which a further signal may be another satellite's.

    Channels of as many signals are worked on at once.
    """
    done: list[tuple[JointChannel, JointRow | None]] = [(channel, None) for channel in channels]
    for group in _alike([len(channel.names) for channel in channels]):
        joint = _stacked([channels[i].joint for i in group])
        joint, signs = j.follow(joint, looks[group], model.bit_times_s, model.look_s, model.bit_s, model.dictionary)
        for place, i in enumerate(group):
            one = replace(joint, mean=joint.mean[place], covariance=joint.covariance[place])
            known = (*channels[i].signs, *signs[place].tolist())
            done[i] = replace(channels[i], joint=one, looks=(*channels[i].looks, *looks[i]), signs=known), None
    full = [i for i, (channel, _) in enumerate(done) if len(channel.looks) == model.bits_per_row]
    for group in _alike([len(done[i][0].names) for i in full]):
        chosen = [full[place] for place in group]
        for i, row in zip(chosen, _rows(model, [done[i][0] for i in chosen], least), strict=True):
            done[i] = row
    return done


def _alike(counts: Sequence[int]) -> list[list[int]]:
    """Places of equal counts."""
    return [[i for i, n in enumerate(counts) if n == count] for count in sorted(set(counts))]


def _stacked(joints: Sequence[Joint]) -> Joint:
    return replace(
        joints[0],
        mean=np.stack([joint.mean for joint in joints]),
        covariance=np.stack([joint.covariance for joint in joints]),
    )


def _rows(
    model: JointModel, channels: Sequence[JointChannel], least: float
) -> list[tuple[JointChannel, JointRow | None]]:
    """Rows of channels of as many signals, and what becomes of the channels."""
    raw = np.stack([channel.looks for channel in channels])  # (channels, bits, looks of a bit, d)
    row_signs = [channel.signs for channel in channels]
    looks = wiped(raw, np.array(row_signs))
    back_s, rho = 0.5 * (model.bits_per_row - 1) * model.bit_s, model.settings.chips_per_cycle
    times_s, look_s, dictionary = model.row_times_s, model.look_s, model.dictionary
    middle = j.carried(np.stack([channel.joint.mean for channel in channels]), -back_s, rho)
    alone = j.fit_row(looks, times_s, look_s, middle, dictionary)
    score, state = newcomer(looks, times_s, look_s, alone, dictionary, model.candidates)
    done: list[tuple[JointChannel, JointRow | None]] = []
    for i, channel in enumerate(channels):
        by_itself = Row(mean=alone.mean[i], covariance=alone.covariance[i], misfit=alone.misfit[i])
        row = JointRow(
            names=channel.names,
            filtered=middle[i],
            sigma=np.stack([channel.joint.sigma(column) for column in range(j.N_STATE)], axis=-1),
            alone=by_itself,
            score=float(score[i]),
            suspected=bool(score[i] > model.suspicion and math.hypot(*state[i, [j.RE, j.IM]]) > least),
            lost=bool(channel.young and score[i] > model.threshold),
            dark=2 * channel.signs.count(0.0) >= model.bits_per_row,
        )
        expected = j.carried(channel.before.mean, back_s + model.bit_s, rho)
        joint = channel.joint
        if channel.young and np.isfinite(by_itself.covariance).all():
            joint = j.predict(_filter_of(by_itself, joint), back_s)
        # As long as there is clearly more than is known, the filter may be drawn away: what is foretold stays.
        later = j.carried(expected, back_s, rho)
        before = replace(joint, mean=later) if score[i] > model.threshold else joint
        channel = replace(channel, joint=joint, looks=(), signs=(), before=before, young=False)
        fitted, more = None, score[i] > model.threshold
        if more and len(channel.names) < model.most:
            signs = np.array(row_signs[i])
            fitted = with_newcomer(model, raw[i], signs, middle[i], expected, state[i], least)
        elif more and len(channel.names) == 2:
            fitted = found_anew(model, raw[i], float(by_itself.misfit), expected, least)
        if fitted is not None:
            done.append(_set_anew(channel, row, fitted, back_s))
            continue
        done.append(_without_the_lost(channel, row))
    return done


def _set_anew(channel: JointChannel, row: JointRow, fitted: Row, later_s: float) -> tuple[JointChannel, JointRow]:
    """The channel with the signals of a fitted row: those it had, and maybe a newcomer."""
    joint, known = j.predict(_filter_of(fitted, channel.joint), later_s), len(channel.names)
    came = tuple(channel.next_name + n for n in range(len(fitted.mean) - known))
    channel = replace(
        channel,
        joint=joint,
        before=joint,
        names=(*channel.names, *came),
        next_name=channel.next_name + len(came),
        doubtful=0,
        young=True,
    )
    return channel, replace(row, came=came, lost=row.lost or not came)


def _filter_of(row: Row, before: Joint) -> Joint:
    """A filter that begins with what a row alone shows."""
    n = row.mean.shape[-2]
    covariance = np.zeros((n, j.N_STATE, n, j.N_STATE))
    mean = row.mean.copy()
    mean[:, j.CHIPS_S] = 0.0  # what the filter had of it before is of a sum that was taken for one signal
    covariance[:, : j.N_FITTED, :, : j.N_FITTED] = row.covariance.reshape(n, j.N_FITTED, n, j.N_FITTED)
    for k in range(n):
        covariance[k, j.CHIPS_S, k, j.CHIPS_S] = BORN_CHIPS_S**2
    return replace(before, mean=mean, covariance=covariance.reshape(n * j.N_STATE, n * j.N_STATE))


def _without_the_lost(channel: JointChannel, row: JointRow) -> tuple[JointChannel, JointRow]:
    """Give up a signal that has been faint, or not to be told from another, for long enough."""
    joint, names = channel.joint, channel.names
    is_faint, weakest = faint(joint)
    if not (is_faint or row.dark or unresolved(joint)):
        return replace(channel, doubtful=0), row
    channel = replace(channel, doubtful=channel.doubtful + 1)
    if not channel.is_lost or len(names) == 1:
        return channel, row
    stay = [k for k in range(len(names)) if k != int(weakest)]
    states = (np.array(stay)[:, None] * j.N_STATE + np.arange(j.N_STATE)).ravel()
    mean, covariance = joint.mean[stay], joint.covariance[np.ix_(states, states)].copy()
    if not is_faint:  # what was there as two goes on as one, which is where their sum is
        amplitude = mean[0, j.RE] + 1j * mean[0, j.IM] + joint.amplitude[int(weakest)]
        mean[0, j.RE], mean[0, j.IM] = amplitude.real, amplitude.imag
        covariance[[0, 1], [0, 1]] += 0.1 * abs(amplitude) ** 2
    left = tuple(names[k] for k in stay)
    joint = replace(joint, mean=mean, covariance=covariance)
    channel = replace(channel, joint=joint, before=joint, names=left, doubtful=0)
    return channel, replace(row, went=(names[int(weakest)],))


def rebased(channel: JointChannel, hz: float, chips: float) -> JointChannel:
    """The same signals beside a replica that is `hz` higher and `chips` later; between rows."""
    if channel.looks:
        raise ValueError(f"a row of {len(channel.looks)} bits has begun: the replica stays until it is complete")
    moved = channel.joint.mean.copy()
    moved[..., j.HZ] -= hz
    moved[..., j.CHIPS] -= chips
    joint = replace(channel.joint, mean=moved)
    return replace(channel, joint=joint, before=joint)


def replica_of(channel: JointChannel) -> tuple[float, float]:
    """By how much (Hz, chips) the replica is best moved: to the strongest carrier, to the middle of the delays."""
    mean = channel.joint.mean
    strongest = int(np.argmax(np.abs(channel.joint.amplitude)))
    middle = 0.5 * float(mean[:, j.CHIPS].min() + mean[:, j.CHIPS].max())
    return float(mean[strongest, j.HZ]), middle if math.isfinite(middle) else 0.0
