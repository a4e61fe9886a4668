"""One satellite's signals within a chip and a half as one channel: data bit in, rows of measurements out.

The filter of `joint` goes from bit to bit; ten bits make a row, which is measured anew by itself and searched for
signals that begin; signals end by the tests of `components`. Between rows the replica may be moved to where the signals
are: `rebased`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Complexes, Reals
from skyproof.decomposition.fit import Dictionary
from skyproof.decomposition.shape import Filter, code_dictionary, filter_loss, quiet_lags
from skyproof.gnss.signals import SignalDescription
from skyproof.receiver import joint as j
from skyproof.receiver.components import Candidates, birth_threshold, born, faint, newcomer, unresolved
from skyproof.receiver.joint import Joint, JointSettings, Row
from skyproof.receiver.replica import passed

__all__ = ["JointChannel", "JointModel", "JointRow", "bits", "rebased", "started", "strongest"]

WINDOW_CHIPS = 1.6
REACH_CHIPS = 2.2
QUIET_TAPS = 4
BORN_CHIPS_S = 0.02
"""How fast code and carrier of a newcomer may part, rms: 6 m/s."""
SUSPICION = 0.05
"""Of rows with nothing more in them, so many are followed by another."""
SURE_SIGMAS = 4.0
RESIGNED = 3
LEAVE_ROWS = 5
"""So many rows on end a signal is faint, or not told from another, before it is given up."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JointModel:
    """What does not change while a satellite is followed.

    code : (n,) of +1 and -1. false_births_per_h : of a channel on clean sky. most : signals at once.
    low_pass : amplitude that the replica keeps at frequencies in cycles a sample, nothing from half a cycle on.
    front_end : likewise of the samples; None where they hold all that the replica lets through.
    """

    signal: SignalDescription
    code: NDArray[np.int8]
    rate_hz: float
    periods_per_look: int = 4
    bits_per_row: int = 10
    false_births_per_h: float = 0.01
    most: int = 2
    settings: JointSettings = field(default_factory=JointSettings)
    low_pass: Filter = passed
    front_end: Filter | None = None

    @property
    def look_s(self) -> float:
        """Duration of a look."""
        return self.periods_per_look * self.signal.period_s

    @property
    def bit_s(self) -> float:
        """Duration of a data bit."""
        return self.signal.periods_per_symbol * self.signal.period_s

    @cached_property
    def bit_times_s(self) -> Reals:
        """Of the looks of a bit, about its middle."""
        n = self.signal.periods_per_symbol // self.periods_per_look
        return np.asarray((np.arange(n) + 0.5) * self.look_s - 0.5 * self.bit_s, np.float64)

    @cached_property
    def row_times_s(self) -> Reals:
        """Of the looks of a row, about its middle."""
        n = self.bits_per_row * self.bit_times_s.size
        return np.asarray((np.arange(n) + 0.5) * self.look_s - 0.5 * self.bits_per_row * self.bit_s, np.float64)

    @property
    def chips_per_sample(self) -> float:
        """At the nominal rate."""
        return self.signal.chip_rate_hz / self.rate_hz

    @cached_property
    def taps_chips(self) -> Reals:
        """Delays of the replicas, later positive: one a sample, and then `QUIET_TAPS` that show noise alone."""
        side = int(REACH_CHIPS / self.chips_per_sample)
        near = np.arange(-side, side + 1) * self.chips_per_sample
        # A whole number of samples as well, so that all are rounded alike.
        quiet = quiet_lags(self.code, QUIET_TAPS)
        return np.concatenate([near, np.rint(quiet / self.chips_per_sample) * self.chips_per_sample])

    @property
    def band_cycles(self) -> float:
        """Highest frequency of the replica, cycles a chip."""
        return 0.5 / self.chips_per_sample

    @cached_property
    def dictionary(self) -> Dictionary:
        """Of the taps that show signals."""
        return code_dictionary(
            self.code,
            self.taps_chips[:-QUIET_TAPS].tolist(),
            self._replica,
            None if self.front_end is None else self._front_end,
            band_cycles=self.band_cycles,
            window_chips=WINDOW_CHIPS,
        )

    @cached_property
    def loss(self) -> float:
        """Of C/N0 by the replica's low-pass."""
        return filter_loss(self._replica, band_cycles=self.band_cycles)

    @cached_property
    def candidates(self) -> Candidates:
        """Where further signals are looked for."""
        return Candidates.of(self.dictionary, self.band_cycles, self.bits_per_row * self.bit_s)

    @cached_property
    def threshold(self) -> float:
        """Of the score at which a signal is born."""
        probability = self.false_births_per_h * self.bits_per_row * self.bit_s / 3600.0
        return birth_threshold(probability, self.dictionary, self.candidates, self.row_times_s, self.look_s)

    @cached_property
    def suspicion(self) -> float:
        """Of the score at which another row is worth its time."""
        return birth_threshold(SUSPICION, self.dictionary, self.candidates, self.row_times_s, self.look_s)

    def _replica(self, cycles: Reals) -> Reals:
        return self.low_pass(cycles * self.chips_per_sample)

    def _front_end(self, cycles: Reals) -> Reals:
        assert self.front_end is not None
        return self.front_end(cycles * self.chips_per_sample)

    def energy(self, cn0_dbhz: float) -> float:
        """Amplitude squared, in sigmas of a look, of a signal of this strength."""
        return float(10.0 ** (0.1 * cn0_dbhz) * self.look_s * self.loss)

    def cn0_dbhz(self, mean: Reals) -> Reals:
        """Strengths (n,) of signals (n, N_STATE)."""
        energy = mean[..., j.RE] ** 2 + mean[..., j.IM] ** 2
        return np.asarray(10.0 * np.log10(np.maximum(energy, 1e-9) / (self.look_s * self.loss)))


@dataclass(frozen=True, eq=False, kw_only=True)
class JointRow:
    """A row: signals by name, as the filter has them at the row's middle and as its looks alone show them.

    names : of the n signals, in their order in `filtered` and `alone`. filtered : (n, N_STATE); sigma : (n, N_STATE).
    alone : white from row to row. score : largest of a further signal. came, went : names.
    suspected : whether there may be a further signal that is no other satellite's.
    dark : whether the signs of half the data bits were not to be seen.
    """

    names: tuple[int, ...]
    filtered: Reals
    sigma: Reals
    alone: Row
    score: float
    suspected: bool = False
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
    looks = _wiped(raw, np.array(row_signs))
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
            dark=2 * channel.signs.count(0.0) >= model.bits_per_row,
        )
        expected = j.carried(channel.before.mean, back_s + model.bit_s, rho)
        joint = channel.joint
        if channel.young and np.isfinite(by_itself.covariance).all():
            joint = j.predict(_filter_of(by_itself, joint), back_s)
        # As long as there is clearly more than is known, the filter may be drawn away: what is foretold stays.
        later = j.carried(expected, back_s, rho)
        before = replace(joint, mean=later) if score[i] > model.threshold and later.shape == joint.mean.shape else joint
        channel = replace(channel, joint=joint, looks=(), signs=(), before=before, young=False)
        if score[i] > model.threshold and len(channel.names) < model.most:
            fitted = _born(model, raw[i], np.array(row_signs[i]), middle[i], expected, state[i])
            if fitted is not None and _stronger_than(fitted, least):
                done.append(_with_the_newcomer(channel, row, _in_order(fitted, expected), back_s))
                continue
        done.append(_without_the_lost(channel, row))
    return done


def _wiped(looks: Complexes, signs: Reals) -> Complexes:
    """Looks (..., bits, looks of a bit, d) with the bits' signs (..., bits) taken off, bit behind bit."""
    signed = looks * signs[..., None, None]
    return np.asarray(signed.reshape(*looks.shape[:-3], -1, looks.shape[-1]))


def _born(model: JointModel, looks: Complexes, signs: Reals, seen: Reals, expected: Reals, state: Reals) -> Row | None:
    """A row (bits, looks, d) fitted with a newcomer, None where no fit with one holds.

    signs : of the bits, as the filter saw them. seen, expected : where the filter has the signals known, and where they
    were expected, (n, N_STATE); state : (N_STATE,) of the newcomer beside those seen. A sudden strong newcomer has
    drawn the filter to somewhere between the two, from where no fit finds either: so one begins with the strongest
    alone.
    """
    births = [
        _birth(model, looks, signs, seen),
        _birth(model, looks, _signs_beside(model, looks, expected, state), expected),
    ]
    if len(expected) == 1:
        births.append(_birth(model, looks, *strongest(model, looks)))
    fewer = min(misfit for _, misfit, _ in births)
    there = [fitted for fitted, _, holds in births if holds and 2.0 * (fewer - fitted.misfit) > model.threshold]
    return min(there, key=lambda fitted: float(fitted.misfit), default=None)


def strongest(model: JointModel, looks: Complexes) -> tuple[Reals, Reals]:
    """The strongest signal in a row (bits, looks, d) whose bits' signs are not known: the signs, and its state
    (1, N_STATE).
    """
    candidates, times_s = model.candidates, model.row_times_s.reshape(looks.shape[:-1])
    value, _ = model.dictionary.at(candidates.chips)
    coarse_hz = np.arange(-60.0, 61.0, 10.0)
    turned = (
        np.exp(-2j * np.pi * coarse_hz[:, None] * model.bit_times_s) / np.linalg.norm(value, axis=-1)[:, None, None]
    )
    of_bits = turned @ (looks @ value.conj().T).transpose(2, 1, 0)  # (chips, hz, bits)
    place, step = np.unravel_index(np.argmax(np.sum(np.abs(of_bits) ** 2, axis=-1)), of_bits.shape[:2])
    # Squares have no signs: twice the rest of the Doppler is what they turn by from bit to bit.
    bits_s, fine_hz = times_s.mean(axis=-1), np.arange(-12.5, 12.5, 0.25)
    seen = of_bits[place, step] * np.exp(-2j * np.pi * coarse_hz[step] * bits_s)
    turns = np.exp(-2j * np.pi * fine_hz[:, None] * bits_s)
    squares = turns**2 @ seen**2
    best = int(np.argmax(np.abs(squares)))
    told = seen * turns[best] * np.exp(-0.5j * np.angle(squares[best]))
    signs = np.where(told.real < 0.0, -1.0, 1.0)
    size = np.sum(signs * seen * turns[best]) / (times_s.size * np.linalg.norm(value[place]))
    state = np.zeros((1, j.N_STATE))
    state[0, [j.RE, j.IM]] = size.real, size.imag
    state[0, [j.HZ, j.CHIPS]] = coarse_hz[step] + fine_hz[best], candidates.chips[place]
    return signs, state


def _birth(model: JointModel, looks: Complexes, signs: Reals, start: Reals) -> tuple[Row, float, bool]:
    """A row (bits, looks, d) fitted with one signal more than there are in `start`, the misfit without it, and whether
    it holds; signs of the bits are gone over again with what was fitted.
    """
    times_s, look_s, dictionary = model.row_times_s, model.look_s, model.dictionary
    for _ in range(RESIGNED):
        told = _wiped(looks, signs)
        fewer = j.fit_row(told, times_s, look_s, start, dictionary)
        _, state = newcomer(told, times_s, look_s, fewer, dictionary, model.candidates)
        fitted, holds = born(told, times_s, look_s, fewer, state, dictionary, model.threshold)
        again = _signs_of(model, looks, fitted)
        if np.array_equal(again, signs):
            break
        signs = again
    return fitted, float(fewer.misfit), bool(holds)


def _signs_of(model: JointModel, looks: Complexes, row: Row) -> Reals:
    """Signs of the bits of a row (bits, looks, d), by the signals fitted to it."""
    shown = j.signals_in(row.mean, model.row_times_s, model.look_s, model.dictionary).reshape(looks.shape)
    return np.asarray(np.where(np.sum((shown.conj() * looks).real, axis=(-2, -1)) < 0.0, -1.0, 1.0), np.float64)


def _signs_beside(model: JointModel, looks: Complexes, expected: Reals, state: Reals) -> Reals:
    """Signs of the bits of a row (bits, looks, d) in which a newcomer (N_STATE,) came beside those that were expected.

    A filter that does not know the newcomer sees the sum, which turns over at each null of the beat: it takes that for
    data. So amplitudes are solved for at the delays of all, bit by bit, and the signs are those of the signals known.
    """
    mean = np.concatenate([expected, state[None]])
    n, d = len(mean), looks.shape[-1]
    turn = j.turns(mean, model.row_times_s, model.look_s).reshape(n, len(looks), -1)
    value, _ = model.dictionary.at(mean[:, j.CHIPS])
    shown = (turn[..., None] * value[:, None, None, :]).transpose(1, 0, 2, 3).reshape(len(looks), n, -1)
    gram = shown.conj() @ np.swapaxes(shown, -1, -2)
    seen = shown.conj() @ looks.reshape(len(looks), -1, 1)
    amplitude = np.linalg.solve(gram + 1e-6 * d * np.eye(n), seen)[..., 0]
    foretold = expected[:, j.RE] + 1j * expected[:, j.IM]
    agreement = np.sum((amplitude[:, : n - 1] * foretold.conj()).real, axis=-1)
    return np.asarray(np.where(agreement < 0.0, -1.0, 1.0), np.float64)


def _stronger_than(row: Row, least: float) -> bool:
    """Whether all amplitudes are surely larger."""
    size = np.hypot(row.mean[:, j.RE], row.mean[:, j.IM])
    sigma = np.hypot(row.sigma(j.RE), row.sigma(j.IM)) / math.sqrt(2.0)
    return bool(np.all(size - SURE_SIGMAS * sigma > least))


def _with_the_newcomer(
    channel: JointChannel, row: JointRow, fitted: Row, later_s: float
) -> tuple[JointChannel, JointRow]:
    joint, came = j.predict(_filter_of(fitted, channel.joint), later_s), channel.next_name
    channel = replace(
        channel, joint=joint, before=joint, names=(*channel.names, came), next_name=came + 1, doubtful=0, young=True
    )
    return channel, replace(row, came=(came,))


def _in_order(row: Row, expected: Reals) -> Row:
    """The row with its signals in the order of those that were expected, the newcomer last.

    A sudden strong newcomer draws the filter of one signal over to itself within a row: what was there before is what
    the row before foretold.
    """
    chips, foretold = row.mean[:, j.CHIPS], expected[:, j.CHIPS]
    orders = list(permutations(range(chips.size)))
    off = [float(np.sum(np.abs(chips[list(order[: foretold.size])] - foretold))) for order in orders]
    order = np.array(orders[int(np.argmin(off))])
    states = (order[:, None] * j.N_FITTED + np.arange(j.N_FITTED)).ravel()
    return replace(row, mean=row.mean[order], covariance=row.covariance[np.ix_(states, states)])


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
