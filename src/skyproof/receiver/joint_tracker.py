"""From samples to the looks of a joint channel, and back from its rows to code and carrier of each signal.

The replica runs open between rows: its carrier at the Doppler of the strongest signal, its code with the carrier, in
the middle between the signals. The filter says where the signals are beside it; after each row it is moved there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Complexes, Floats, Reals
from skyproof.compiled import compiled
from skyproof.receiver import joint as j
from skyproof.receiver.correlator import correlate_period, scratch_for, table_pad
from skyproof.receiver.joint_channel import JointChannel, JointRow, bits, rebased, replica_of
from skyproof.receiver.joint_model import QUIET_TAPS, JointModel
from skyproof.receiver.replica import code_table

__all__ = ["Followed", "JointState", "JointTracker", "Replica"]

NOISE_LOOKS = 500
CODE_PHASES = 32


@dataclass(frozen=True, kw_only=True)
class Replica:
    """Where the replica is: at absolute sample `start` so many chips after its code's start, and so many cycles on.

    hz : of the carrier, intermediate frequency included. periods : code periods since the channel began.
    owed_chips : by which rounding has made the replica late so far.
    """

    start: int
    chip: float
    phase_cyc: float
    hz: float
    periods: int = 0
    owed_chips: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Followed:
    """One signal as it is at sample `at` (absolute, fractional).

    code_chips : that it shows there, since the start of the channel's code period 0.
    phase_cyc : of its carrier, half a cycle and whole ones unknown but steady.
    hz, hz_s : intermediate frequency included, and how it changes.
    alone : estimates and sigmas are those of a row by itself, white from row to row; of the filter where it is False:
        there the looks of one row do not tell the signals apart.
    """

    name: int
    at: float
    code_chips: float
    phase_cyc: float
    hz: float
    hz_s: float
    cn0_dbhz: float
    code_sigma_chips: float
    phase_sigma_cyc: float
    hz_sigma: float
    alone: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class JointState:
    """All that a joint channel remembers: its replica, its signals, the noise of a tap, the replica at the row's start.

    noise : mean power of a quiet tap over a look; noise_looks : how many it is the mean of. What it begins with counts
        for a few, so that missing samples, of which there is no noise, are not divided by.
    """

    replica: Replica
    row_began: Replica
    channel: JointChannel
    noise: float
    noise_looks: int = 20


@dataclass(frozen=True, eq=False)
class JointTracker:
    """The unchanging part: the model, the table of the code.

    epoch_samples : a row tells of the next multiple of so many samples after its middle, within a data bit, and its
        bits are chosen so; of its middle, whatever its bits, where this is 0.
    """

    model: JointModel
    if_hz: float = 0.0
    epoch_samples: float = 0.0
    _table: NDArray[np.int8] = field(init=False)
    _pad: int = field(init=False)
    _whiten: Complexes = field(init=False)

    def __post_init__(self) -> None:
        model, reach = self.model, float(np.max(np.abs(self.model.taps_chips))) + 2.0
        n = math.ceil(model.rate_hz * model.signal.period_s) + 64
        table = code_table(model.code, model.chips_per_sample, CODE_PHASES, n, reach, model.low_pass)
        object.__setattr__(self, "_table", table)
        object.__setattr__(self, "_whiten", model.dictionary.whiten.astype(np.complex128))
        object.__setattr__(self, "_pad", table_pad(model.chips_per_sample, reach))

    @property
    def replica_power(self) -> float:
        """Mean square of the replica: noise of a sample times this is what a correlator has of it, a sample."""
        return float(np.mean(self._table.astype(np.float64) ** 2))

    def step(
        self, state: JointState, planes: Floats, first: int, least_dbhz: float = -math.inf
    ) -> tuple[list[tuple[JointRow, list[Followed]]], JointState]:
        """All data bits that lie wholly in the samples, (2, n) float32, of which the first has absolute index `first`.

        least_dbhz : up to which strength a further signal may be another satellite's.

        Gives the rows that were completed, with the signals in them.
        """
        rows: list[tuple[JointRow, list[Followed]]] = []
        least = math.sqrt(self.model.energy(least_dbhz))
        while True:
            looks, replica = self._looks(state, planes, first)
            if not len(looks):
                return rows, state
            state, noise = self._quiet(replace(state, replica=replica), looks)
            white: Complexes = looks[..., :-QUIET_TAPS] @ self._whiten.T / np.sqrt(noise)[:, None, None]
            channel, row = bits(self.model, [state.channel], white[None], least)[0]
            state = replace(state, channel=channel)
            if row is not None:
                rows.append((row, self._followed(state, row)))
                state = self._moved(state)

    def _quiet(self, state: JointState, looks: Complexes) -> tuple[JointState, Reals]:
        """The noise's power goes on from bit to bit, (bits,)."""
        n, known, noise, of_bits = looks.shape[1], state.noise_looks, state.noise, []
        for power in np.mean(np.abs(looks[..., -QUIET_TAPS:]) ** 2, axis=(1, 2)).tolist():
            noise = (known * noise + n * power) / (known + n)
            known = min(known + n, NOISE_LOOKS)
            of_bits.append(noise)
        return replace(state, noise=noise, noise_looks=known), np.array(of_bits)

    def _moved(self, state: JointState) -> JointState:
        """The replica where the signals are, for the next row."""
        hz, chips = replica_of(state.channel)
        old, later_s = state.replica, 0.5 * self.model.bit_s
        # Both replicas show the same at the middle of the last bit, of which the filter's state is.
        replica = replace(old, hz=old.hz + hz, phase_cyc=old.phase_cyc + later_s * hz, chip=old.chip - chips)
        return self.aligned(replace(state, replica=replica, channel=rebased(state.channel, hz, chips)))

    def aligned(self, state: JointState) -> JointState:
        """Between rows: without as many data bits as it takes for the middle of the next row to be in the last bit
        before an epoch.
        """
        model, replica = self.model, state.replica
        bit = model.bit_s * model.rate_hz
        skipped = 0
        if self.epoch_samples:
            skipped = int((-(replica.start + 0.5 * model.bits_per_row * bit)) % self.epoch_samples // bit)
        if skipped:
            chips = skipped * model.signal.periods_per_symbol * model.signal.code_length
            rate = self._code_rate_hz(replica.hz) / model.rate_hz
            n = math.ceil((chips - replica.chip) / rate)
            replica = replace(
                replica,
                start=replica.start + n,
                chip=replica.chip + n * rate - chips,
                phase_cyc=replica.phase_cyc + n / model.rate_hz * replica.hz,
                periods=replica.periods + skipped * model.signal.periods_per_symbol,
            )
            skipped_s, rho = skipped * model.bit_s, model.settings.chips_per_cycle
            joint = j.predict(state.channel.joint, skipped_s)
            before = replace(joint, mean=j.carried(state.channel.before.mean, skipped_s, rho))
            state = replace(state, channel=replace(state.channel, joint=joint, before=before))
        return replace(state, replica=replica, row_began=replica)

    def now(self, state: JointState) -> list[Followed]:
        """The signals where the replica is, by the filter."""
        channel, model = state.channel, self.model
        mean = j.carried(channel.joint.mean, 0.5 * model.bit_s, model.settings.chips_per_cycle)
        sigma = np.stack([channel.joint.sigma(column) for column in range(j.N_FITTED)], axis=-1)
        spreads = [np.diag(one**2) for one in sigma]
        return self._signals(channel.names, mean, spreads, state.replica, 0.0, 0.0, alone=False)

    def _followed(self, state: JointState, row: JointRow) -> list[Followed]:
        model, began = self.model, state.row_began
        middle = 0.5 * (began.start + state.replica.start)
        later_s = (-middle) % self.epoch_samples / model.rate_hz if self.epoch_samples else 0.0
        alone = bool(np.isfinite(row.alone.covariance).all() and _told_apart(row))
        mean = row.alone.mean if alone else row.filtered
        if alone:
            spreads = [_of_signal(row.alone.covariance, n) for n in range(len(row.names))]
        else:
            spreads = [np.diag(one[: j.N_FITTED] ** 2) for one in row.sigma]
        gone_s = (middle - began.start) / model.rate_hz
        found = self._signals(row.names, mean, spreads, began, gone_s, later_s, alone=alone)
        strengths = model.cn0_dbhz(row.filtered).tolist()  # an amplitude of one row alone may be anything
        return [replace(one, cn0_dbhz=strength) for one, strength in zip(found, strengths, strict=True)]

    def _signals(
        self,
        names: Sequence[int],
        mean: Reals,
        spreads: Sequence[Reals],
        replica: Replica,
        gone_s: float,
        later_s: float,
        *,
        alone: bool,
    ) -> list[Followed]:
        """Signals (n, N_STATE), known with covariances (N_FITTED, N_FITTED), beside a replica as it is after `gone_s`,
        carried on by `later_s`.
        """
        model, rho = self.model, self.model.settings.chips_per_cycle
        after_s = gone_s + later_s
        code = replica.periods * model.signal.code_length + replica.chip + after_s * self._code_rate_hz(replica.hz)
        phase = replica.phase_cyc + after_s * replica.hz
        there, strengths = j.carried(mean, later_s, rho), model.cn0_dbhz(mean)
        found = []
        for n, name in enumerate(names):
            energy = max(mean[n, j.RE] ** 2 + mean[n, j.IM] ** 2, 1e-9)
            turn = np.array([-mean[n, j.IM], mean[n, j.RE]]) / (2.0 * math.pi * energy)
            by_phase = np.array([*turn, later_s, 0.5 * later_s**2, 0.0])
            by_hz = np.array([0.0, 0.0, 1.0, later_s, 0.0])
            by_chips = np.array([0.0, 0.0, -rho * later_s, -0.5 * rho * later_s**2, 1.0])
            sigmas = [math.sqrt(max(float(g @ spreads[n] @ g), 0.0)) for g in (by_phase, by_hz, by_chips)]
            found.append(
                Followed(
                    name=name,
                    at=replica.start + after_s * model.rate_hz,
                    code_chips=code - float(there[n, j.CHIPS]),
                    phase_cyc=phase + math.atan2(there[n, j.IM], there[n, j.RE]) / (2.0 * math.pi),
                    hz=replica.hz + float(there[n, j.HZ]),
                    hz_s=float(there[n, j.HZ_S]),
                    cn0_dbhz=float(strengths[n]),
                    phase_sigma_cyc=sigmas[0],
                    hz_sigma=sigmas[1],
                    code_sigma_chips=sigmas[2],
                    alone=alone,
                )
            )
        return found

    def _code_rate_hz(self, hz: float) -> float:
        signal = self.model.signal
        return signal.chip_rate_hz * (1.0 + (hz - self.if_hz) / signal.carrier_hz)

    def _looks(self, state: JointState, planes: Floats, first: int) -> tuple[Complexes, Replica]:
        """Correlators (bits, n_looks, taps) of the data bits that are all there, up to the row's last."""
        model, replica = self.model, state.replica
        n = model.signal.periods_per_symbol
        left = model.bits_per_row - len(state.channel.looks)
        out = np.zeros((left, n // model.periods_per_look, model.taps_chips.size), np.complex128)
        count, start, chip, phase_cyc, owed = _correlate_bits(
            planes[0],
            planes[1],
            replica.start - first,
            replica.chip,
            self._code_rate_hz(replica.hz) / model.rate_hz,
            replica.phase_cyc,
            replica.hz / model.rate_hz,
            replica.owed_chips,
            self._table,
            self._pad,
            model.chips_per_sample,
            -model.taps_chips,
            model.signal.code_length,
            model.periods_per_look,
            out,
        )
        moved = Replica(
            start=start + first,
            chip=chip,
            phase_cyc=phase_cyc,
            hz=replica.hz,
            periods=replica.periods + count * n,
            owed_chips=owed,
        )
        return out[:count], moved


def _told_apart(row: JointRow) -> bool:
    """Whether the row by itself tells its delays apart."""
    chips, p = row.alone.mean[:, j.CHIPS], row.alone.covariance
    for k in range(chips.size):
        for m in range(k):
            a, b = k * j.N_FITTED + j.CHIPS, m * j.N_FITTED + j.CHIPS
            if abs(chips[k] - chips[m]) < 3.0 * math.sqrt(max(p[a, a] + p[b, b] - 2.0 * p[a, b], 0.0)):
                return False
    return True


def _of_signal(covariance: Reals, n: int) -> Reals:
    part = slice(n * j.N_FITTED, (n + 1) * j.N_FITTED)
    return covariance[part, part]


@compiled
def _correlate_bits(
    i_samples: Floats,
    q_samples: Floats,
    start: int,
    chip: float,
    chips_per_sample: float,
    phase_cyc: float,
    cycles_per_sample: float,
    owed_chips: float,
    table: NDArray[np.int8],
    pad: int,
    nominal: float,
    delays_chips: Reals,
    code_length: int,
    periods_per_look: int,
    out: Complexes,
) -> tuple[int, int, float, float, float]:
    """Sum all taps over each look of the bits (bits, looks, taps) that lie in the samples, in place.

    Returns how many bits those are, and where the replica then is: sample, chip, phase, and what rounding owes it.
    """
    scratch = scratch_for(math.ceil(code_length / nominal) + 64, delays_chips.size)
    sums, shifts, carrier = np.empty((1, delays_chips.size, 2)), np.empty(delays_chips.size), np.zeros(1)
    chips = out.shape[1] * periods_per_look * code_length
    for bit in range(out.shape[0]):
        if start + math.ceil((chips - chip) / chips_per_sample) + 1 > i_samples.size:
            return bit, start, chip, phase_cyc, owed_chips
        for look in range(out.shape[1]):
            for _ in range(periods_per_look):
                n = math.ceil((code_length - chip) / chips_per_sample)
                correlate_period(
                    i_samples,
                    q_samples,
                    start,
                    n,
                    chip + owed_chips,
                    chips_per_sample,
                    phase_cyc,
                    cycles_per_sample,
                    table,
                    pad,
                    nominal,
                    delays_chips,
                    carrier,
                    scratch,
                    sums,
                    shifts,
                )
                # Made up for in the next period: the mean of rounding vanishes where the code stands still, too.
                owed_chips = float(np.mean(shifts))
                for tap in range(delays_chips.size):
                    out[bit, look, tap] += complex(sums[0, tap, 0], sums[0, tap, 1])
                phase_cyc += n * cycles_per_sample
                chip += n * chips_per_sample - code_length
                start += n
    return out.shape[0], start, chip, phase_cyc, owed_chips
