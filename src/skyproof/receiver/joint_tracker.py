"""From samples to the looks of a joint channel, and back from its rows to code and carrier of each signal.

The replica runs open between rows: its carrier at the Doppler of the strongest signal, its code with the carrier, in
the middle between the signals. The filter says where the signals are beside it; after each row it is moved there.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Complexes, Floats, Reals
from skyproof.compiled import compiled
from skyproof.receiver import joint as j
from skyproof.receiver.correlator import correlate_period, scratch_for, table_pad
from skyproof.receiver.joint_channel import (
    QUIET_TAPS,
    JointChannel,
    JointModel,
    JointRow,
    bits,
    rebased,
    replica_of,
)
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
    """One signal over a row, at the sample `middle` (absolute, fractional).

    code_chips : that the signal shows there, since the start of the channel's code period 0.
    phase_cyc : of its carrier, half a cycle and whole ones unknown but steady.
    hz : intermediate frequency included.
    alone : estimates and sigmas are those of the row by itself, white from row to row; of the filter where it is False:
        there the looks of one row do not tell the signals apart.
    """

    name: int
    middle: float
    code_chips: float
    phase_cyc: float
    hz: float
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
    """The unchanging part: the model, the table of the code."""

    model: JointModel
    if_hz: float = 0.0
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
        self, state: JointState, planes: Floats, first: int
    ) -> tuple[list[tuple[JointRow, list[Followed]]], JointState]:
        """All data bits that lie wholly in the samples, (2, n) float32, of which the first has absolute index `first`.

        Gives the rows that were completed, with the signals in them.
        """
        rows: list[tuple[JointRow, list[Followed]]] = []
        while True:
            looks, replica = self._looks(state, planes, first)
            if not len(looks):
                return rows, state
            state, noise = self._quiet(replace(state, replica=replica), looks)
            white: Complexes = looks[..., :-QUIET_TAPS] @ self._whiten.T / np.sqrt(noise)[:, None, None]
            channel, row = bits(self.model, [state.channel], white[None])[0]
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
        replica = replace(state.replica, hz=state.replica.hz + hz, chip=state.replica.chip - chips)
        return replace(state, replica=replica, row_began=replica, channel=rebased(state.channel, hz, chips))

    def _followed(self, state: JointState, row: JointRow) -> list[Followed]:
        model, began, ended = self.model, state.row_began, state.replica
        middle = 0.5 * (began.start + ended.start)
        gone_s = (middle - began.start) / model.rate_hz
        code = began.periods * model.signal.code_length + began.chip + gone_s * self._code_rate_hz(began.hz)
        phase = began.phase_cyc + gone_s * began.hz
        alone = np.isfinite(row.alone.covariance).all() and _told_apart(row)
        mean = row.alone.mean if alone else row.filtered
        strengths = model.cn0_dbhz(row.filtered)
        found = []
        for n, name in enumerate(row.names):
            a = mean[n, j.RE] + 1j * mean[n, j.IM]
            energy = max(abs(a) ** 2, 1e-9)
            sigma = _row_sigma(row, n) if alone else row.sigma[n]
            found.append(
                Followed(
                    name=name,
                    middle=middle,
                    code_chips=code - float(mean[n, j.CHIPS]),
                    phase_cyc=phase + float(np.angle(a)) / (2.0 * math.pi),
                    hz=began.hz + float(mean[n, j.HZ]),
                    cn0_dbhz=float(strengths[n]),
                    code_sigma_chips=float(sigma[j.CHIPS]),
                    phase_sigma_cyc=math.sqrt(0.5 * (sigma[j.RE] ** 2 + sigma[j.IM] ** 2) / energy) / (2.0 * math.pi),
                    hz_sigma=float(sigma[j.HZ]),
                    alone=bool(alone),
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


def _row_sigma(row: JointRow, n: int) -> Reals:
    part = slice(n * j.N_FITTED, (n + 1) * j.N_FITTED)
    return np.asarray(np.sqrt(np.diagonal(row.alone.covariance)[part]))


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
