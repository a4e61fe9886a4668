"""Measure a signal on all antennas in a recording too short to track: one sum over everything, and its phases.

The antennas share clock and oscillator. What the search found is wiped off every antenna's samples, code period by code
period. The antennas' shares in those sums are one vector, whatever the data bits and the residual Doppler: the
strongest singular vector of antennas by periods. Added with it, the antennas' samples are those of one antenna that is
up to 10 log10(antennas) dB better (maximal-ratio combining: Van Trees, Optimum Array Processing, 6.2), whose code,
Doppler and bits are found as of any other snapshot. With these every antenna is summed up coherently.

Let R be the signal's energy over the noise density in the sum. An antenna's phase has the sigma 1 / sqrt(2 R) radians
(Kay, Estimation Theory, example 3.4). What remains of the code, the Doppler and the bits is common to all antennas.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Complexes, Floats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan, prn_of
from skyproof.receiver.snapshot import (
    CodePhase,
    estimate_symbols,
    grid_sigma_chips,
    measure_code_phase,
    sample_code,
    spacing_chips,
)

__all__ = ["MOST_LATE", "SnapshotSignal", "measure_snapshot"]

MOST_LATE: Final = 25
"""Code periods, by which an antenna's samples may begin later or earlier and be found out by its data bits."""

_REACH_HZ: Final = 40.0  # of what the search leaves open of a Doppler
_LEFT_HZ: Final = 4.0  # the same once it has been measured
_THERE: Final = -np.log(1e-6) - 1.0
_OFFSETS: Final = np.array([-0.3, 0.0, 0.3])  # delays over which early minus late is averaged: the samples' grid


@dataclass(frozen=True, eq=False, kw_only=True)
class SnapshotSignal:
    """One signal in one stretch of samples, cut into parts of whole code periods.

    code : of the antennas' sum, in the middle of the stretch; its C/N0 is that of the sum.
    middle_s : (n_parts,) from the first sample on. code_s, code_sigma_s : (n_parts,) as in `CodePhase`, part by part:
    the noise is each part's own, and what they share is in the sigma as often as makes that of their mean right.
    phase_cyc, sigma_cyc : (n_parts, n_antennas), modulo one cycle; what the antennas share is arbitrary.
    cn0_dbhz : (n_antennas,). energy : over the noise density, of all antennas, of the sum of everything.
    there : (n_antennas,) whether an antenna has more energy than noise once in a million.
    sums : (n_parts, n_antennas) what `phase_cyc` is the phase of, in units of its noise (the mean square of that is 1).
    later : (n_antennas, 2 `MOST_LATE` + 1) gain of an antenna's logarithmic likelihood, in the periods that both have.
    It is the gain if its data bits are so many code periods ahead of the others': its samples begin so much later.
    """

    code: CodePhase
    middle_s: Reals
    code_s: Reals
    code_sigma_s: Reals
    phase_cyc: Reals
    sigma_cyc: Reals
    cn0_dbhz: Reals
    energy: float
    there: Booleans
    sums: Complexes
    later: Reals


def measure_snapshot(
    planes: Floats,
    rate_hz: float,
    if_hz: float,
    sat: str,
    delay_s: float,
    doppler_hz: float,
    *,
    part_s: float = 0.016,
    signal: SignalPlan = GPS_L1_CA,
) -> SnapshotSignal:
    """Measure the code, the Doppler, and the phase on every antenna, of a signal that a search found.

    Parameters
    ----------
    planes : (n_antennas, 2, n) I and Q (Q zero for real samples), as long as `measure_code_phase` takes.
    if_hz, delay_s, doppler_hz : as of `measure_code_phase`.
    part_s : about so long are the parts; there are two at least.

    Raises
    ------
    ValueError : as `measure_code_phase`.
    """
    n, n_antennas = planes.shape[-1], len(planes)
    power = np.array([np.mean(plane[0] ** 2 + plane[1] ** 2, dtype=np.float64) for plane in planes])
    power = np.where(power > 0.0, power, np.inf)  # an antenna that gives nothing has no share
    middle_s = 0.5 * (n - 1) / rate_hz
    searched = _Replica(rate_hz, if_hz, sat, middle_s - delay_s, doppler_hz, n, signal)
    prompts = searched.sums(planes)
    share = np.linalg.svd(prompts / np.sqrt(power)[:, None], full_matrices=False)[0][:, 0]
    weights = share.conj() / np.sqrt(power)
    summed = _add_weighted(planes, weights)
    code = measure_code_phase(
        summed, rate_hz, if_hz, sat, delay_s, doppler_hz, doppler_reach_hz=_REACH_HZ, signal=signal
    )
    fine = _Replica(rate_hz, if_hz, sat, code.code_s, code.doppler_hz, n, signal)
    prompts = fine.sums(planes)
    off_hz, sign = estimate_symbols(weights @ prompts, fine.centre_s, fine.period, _LEFT_HZ, n / rate_hz, signal)
    wiped = sign * np.exp(-2j * np.pi * off_hz * fine.centre_s)
    firsts = _split_parts(fine.counts, max(round(n / rate_hz / part_s), 2))
    counts = np.add.reduceat(fine.counts, firsts)
    sums = np.add.reduceat(prompts * wiped, firsts, axis=1).T
    energy = np.maximum(np.abs(sums.sum(axis=0)) ** 2 / (power * n) - 1.0, 0.0)
    with np.errstate(divide="ignore"):
        # By the strength of the whole: by its own a part that noise has made strong would look sure.
        sigma_cyc = 1.0 / np.sqrt(2.0 * energy * counts[:, None] / n) / (2.0 * np.pi)
        cn0_dbhz = 10.0 * np.log10(energy * rate_hz / n)
    at_s = np.add.reduceat(fine.centre_s * fine.counts, firsts) / counts
    ahead_chips = _estimate_lead_chips(fine, summed, wiped, firsts)
    code_s = code.code_s + at_s * (1.0 + code.doppler_hz / signal.carrier_hz) + ahead_chips / signal.chip_rate_hz
    white = spacing_chips(rate_hz, signal) / (4.0 * counts / rate_hz * 10.0 ** (0.1 * code.cn0_dbhz))
    # What the samples' grid does is about the same in all parts: their mean must not look surer than that.
    grid = firsts.size * grid_sigma_chips(rate_hz, signal) ** 2
    return SnapshotSignal(
        code=code,
        middle_s=middle_s + at_s,
        code_s=np.mod(code_s, signal.period_s),
        code_sigma_s=np.sqrt(white + grid) / signal.chip_rate_hz,
        phase_cyc=np.where(np.isfinite(sigma_cyc), np.angle(sums) / (2.0 * np.pi), np.nan),
        sigma_cyc=np.where(np.isfinite(sigma_cyc), sigma_cyc, np.nan).reshape(-1, n_antennas),
        cn0_dbhz=cn0_dbhz,
        energy=float(energy.sum()),
        there=energy > _THERE,
        sums=sums / np.sqrt(power * counts[:, None]),
        later=_compare_delayed(prompts * np.exp(-2j * np.pi * off_hz * fine.centre_s), sign, fine.counts)
        / power[:, None],
    )


def _compare_delayed(prompts: Complexes, sign: Reals, counts: Integers) -> Reals:
    """Compare antennas' prompts (n_antennas, n_periods) with delayed bits, as `SnapshotSignal.later` states.

    The result is times their power.
    """
    better = np.zeros((len(prompts), 2 * MOST_LATE + 1))
    n = sign.size
    for column, ahead in enumerate(range(-MOST_LATE, MOST_LATE + 1)):
        overlap = slice(max(-ahead, 0), min(n - ahead, n))
        if overlap.stop - overlap.start < n // 2:
            continue
        aligned, delayed = sign[overlap], sign[overlap.start + ahead : overlap.stop + ahead]
        powers = [np.abs(prompts[:, overlap] @ bits) ** 2 for bits in (delayed, aligned)]
        better[:, column] = (powers[0] - powers[1]) / counts[overlap].sum()
    return better


class _Replica:
    """A signal's code and carrier over a whole stretch, cut where code periods begin.

    period, counts, centre_s : (n_periods,) their numbers, how many samples they have (those at the ends fewer), and
    their middles from that of the stretch.
    """

    def __init__(
        self,
        rate_hz: float,
        if_hz: float,
        sat: str,
        code_s: float,
        doppler_hz: float,
        n: int,
        signal: SignalPlan,
    ) -> None:
        """code_s : what the code shows in the middle of the stretch."""
        k = np.arange(n)
        from_middle_s = (k - 0.5 * (n - 1)) / rate_hz
        pace = 1.0 + doppler_hz / signal.carrier_hz
        self.chips: Reals = np.asarray((code_s + from_middle_s * pace) * signal.chip_rate_hz, np.float64)
        self.code = signal.code(prn_of(sat)).astype(np.float64)
        self.spacing_chips = spacing_chips(rate_hz, signal)
        angle_cyc = np.mod((if_hz + doppler_hz) / rate_hz * k, 1.0).astype(np.float32)
        self._turn = np.exp(np.complex64(-2j * np.pi) * angle_cyc)
        number = np.floor(self.chips / signal.code_length).astype(np.int64)
        self._first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
        self.period = number[self._first]
        self.counts = np.diff(self._first, append=n)
        self.centre_s = (self._first + 0.5 * (self.counts - 1)) / rate_hz - 0.5 * (n - 1) / rate_hz

    def sums(self, planes: Floats, ahead_chips: float = 0.0, *, apart_chips: float = 0.0) -> Complexes:
        """Sum samples (n_antennas, 2, n), wiped off, so much ahead, by period: (n_antennas, n_periods).

        With `apart_chips`, the replica is the difference of two codes so far apart.
        """
        code = sample_code(self.code, self.chips, ahead_chips + 0.5 * apart_chips)
        if apart_chips:
            code = code - sample_code(self.code, self.chips, ahead_chips - 0.5 * apart_chips)
        replica = self._turn * code.astype(np.float32)
        real, imag = np.ascontiguousarray(replica.real), np.ascontiguousarray(replica.imag)
        sums = np.empty((len(planes), self.period.size), np.complex128)
        for plane, plane_sums in zip(planes, sums, strict=True):
            _add_periods(plane[0], real, imag, self._first, plane_sums)
            if plane[1].any():
                turned = np.empty_like(plane_sums)
                _add_periods(plane[1], real, imag, self._first, turned)
                plane_sums += 1j * turned
        return sums


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _add_periods(plane: Floats, real: Floats, imag: Floats, first: Integers, sums: Complexes) -> None:
    """Add up a plane (n,) times a replica, from each of the first samples to the next."""
    for number in range(first.size):
        end = first[number + 1] if number + 1 < first.size else plane.size
        i, q = np.float32(0.0), np.float32(0.0)
        for k in range(first[number], end):
            i += plane[k] * real[k]
            q += plane[k] * imag[k]
        sums[number] = complex(i, q)


def _add_weighted(planes: Floats, weights: Complexes) -> Floats:
    """Compute the weighted sum (2, n) of antennas (n_antennas, 2, n)."""
    real, imag = weights.real.astype(np.float32), weights.imag.astype(np.float32)
    i, q = planes[:, 0], planes[:, 1]
    return np.stack([real @ i - imag @ q, imag @ i + real @ q])


def _split_parts(counts: Integers, number: int) -> Integers:
    """Return the first period of each of `number` parts of about equal length."""
    ends = np.cumsum(counts)
    firsts = np.searchsorted(ends, np.arange(number) * ends[-1] / number, side="right")
    return np.unique(firsts)


def _estimate_lead_chips(fine: _Replica, summed: Floats, wiped: Complexes, firsts: Integers) -> Reals:
    """Estimate by how much the received code is ahead of the replica in each part (n_parts,)."""
    total = np.add.reduceat((fine.sums(summed[None]) * wiped)[0], firsts)
    ahead = np.zeros(firsts.size)
    for offset in fine.spacing_chips * _OFFSETS:
        apart = np.add.reduceat((fine.sums(summed[None], offset, apart_chips=fine.spacing_chips) * wiped)[0], firsts)
        ahead += offset + 0.5 * (apart * total.conj()).real / np.abs(total) ** 2
    return np.asarray(ahead / _OFFSETS.size)
