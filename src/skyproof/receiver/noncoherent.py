"""Measure a guided channel while its phase is not held: code and Doppler without a phase.

Prompts are turned from the loop's own replica to a carrier of the predicted Doppler. They are summed over each data
bit, whose sign does not matter:

    S(f) of a bit T long: sum of prompts times exp(-2 pi i f t);  E+ and E- : sums of |S|^2 over bits, f = +-1/(2 T)

For a carrier off by x/T the energies go as sinc^2(x - 1/2) and sinc^2(x + 1/2), so that

    R = (E+ - E-) / (E+ + E- - noise) = 4 x / (1 + 4 x^2),   x = tan(arcsin(R) / 2) / 2,   unique to half of 1/T.

The code's error is the dot product of early less late and prompt, bit by bit, over the prompts' power. Both are means
over one row, independent from row to row: several such channels drive a filter where none of them holds a phase. With
C/N0 T = s and m bits, from the moments of |signal + noise|^2, at x = 0:

    var x = (1 + 0.81 s) / (5.25 s^2 m) (1 + 3 r),   var code = v (1 + 1/s),

Here r = 2 (1 + 0.81 s) / (0.66 s^2 m) is the variance of the ratio's denominator over its square. To second order the
mean of 1/D^2 is 1 + 3 r times the squared inverse of the mean: at 20 dB-Hz and 10 bits 29 % of the sigma. And v is the
variance of the coherent discriminator (`discriminator`): E. D. Kaplan and C. J. Hegarty, "Understanding GPS/GNSS", 8.9,
squaring loss of the dot product.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy import special

from skyproof.arrays import Complexes, ComplexFloats, Integers, Reals
from skyproof.gnss.signals import SignalPlan
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.crosstalk import Rows
from skyproof.receiver.discriminator import Discriminator

__all__ = ["NoncoherentMeasurement", "measure_noncoherent", "measure_without_phase"]

SIDE: Final = (2.0 / np.pi) ** 2
"""Of a signal's energy what either side has of one in the middle, 0.405."""


class NoncoherentMeasurement(NamedTuple):
    """code_chips : received code ahead of the replica. doppler_hz, and one sigma of either. cn0_dbhz : over the row."""

    code_chips: float
    code_sigma_chips: float
    doppler_hz: float
    doppler_sigma_hz: float
    cn0_dbhz: float


def measure_without_phase(
    table: Reals,
    taps: ComplexFloats,
    frames: tuple[Rows, Rows],
    bit_start: Reals,
    near_hz: Reals,
    noise: float,
    *,
    rate_hz: float,
    if_hz: float,
    signal: SignalPlan,
    discriminator: Discriminator,
    probability: float,
) -> Reals:
    """Measure code and Doppler without a phase: a table (n_channels, N_COLUMNS), NaN of all other channels.

    table, taps : as `measurement.measure` returns them. frames : of the kernel, as it takes them. bit_start :
    (n_channels,), -1 where unknown. near_hz : (n_channels,) predicted Doppler, NaN of channels not requested.
    """
    found = np.full(table.shape, np.nan)
    asked = np.isfinite(near_hz) & (bit_start >= 0.0) & np.isfinite(table[:, m.FRACTION_S])
    for i in np.flatnonzero(asked).tolist():
        result = measure_noncoherent(
            np.concatenate([rows[i, : counts[i]] for rows, counts in frames]),
            float(bit_start[i]),
            noise,
            float(near_hz[i]),
            rate_hz=rate_hz,
            if_hz=if_hz,
            signal=signal,
            discriminator=discriminator,
            probability=probability,
        )
        if result is None:
            continue
        early, prompt, late = taps[i, :3].real.tolist()
        coherent_chips = (early - late) / prompt / discriminator.gain  # what the table has beside the replica
        found[i, m.PERIODS] = table[i, m.PERIODS]
        found[i, m.FRACTION_S] = table[i, m.FRACTION_S] + (result.code_chips - coherent_chips) / signal.chip_rate_hz
        found[i, m.DOPPLER_HZ], found[i, m.DOPPLER_SIGMA_HZ] = result.doppler_hz, result.doppler_sigma_hz
        found[i, m.CODE_SIGMA_S] = result.code_sigma_chips / signal.chip_rate_hz
        found[i, m.CN0_DBHZ] = result.cn0_dbhz
    return found


def measure_noncoherent(
    rows: Reals,
    bit_start: float,
    noise: float,
    near_hz: float,
    *,
    rate_hz: float,
    if_hz: float,
    signal: SignalPlan,
    discriminator: Discriminator,
    probability: float,
) -> NoncoherentMeasurement | None:
    """Measure one channel from its code periods (n, columns of the kernel), around a predicted Doppler.

    bit_start : code period, modulo those of a bit, with which bits begin. noise : power of noise alone in the prompt of
    one code period. None if noise alone exceeds the prompts' power with this probability (a Gamma variable, whole bits
    its shape), or without three whole bits.
    """
    bit = _label_whole_bits(rows[:, k.OUT_PERIOD], bit_start, signal.periods_per_symbol)
    rows, bit = rows[bit >= 0], bit[bit >= 0]
    n = int(bit[-1]) + 1 if bit.size else 0
    if n < 3 or not noise > 0.0:
        return None
    t_s = (rows[:, k.OUT_START] - rows[0, k.OUT_START]) / rate_hz + 0.5 * signal.period_s
    own_cyc = rows[:, k.OUT_PHASE] + 0.5 * signal.period_s * rows[:, k.OUT_FREQUENCY]
    turned = np.exp(2j * np.pi * (own_cyc - own_cyc[0] - (if_hz + near_hz) * (t_s - t_s[0])))
    early, prompt, late = (
        (rows[:, k.OUT_TAPS + 2 * tap] + 1j * rows[:, k.OUT_TAPS + 2 * tap + 1]) * turned for tap in range(3)
    )
    periods = signal.periods_per_symbol
    power, of_noise = _energy(prompt, bit, n), noise * periods * n
    if power < noise * periods * special.gammainccinv(n, probability):
        return None
    bit_s = periods * signal.period_s
    side = np.exp(-1j * np.pi * t_s / bit_s)
    ahead, behind = _energy(prompt * side, bit, n), _energy(prompt * side.conj(), bit, n)
    ratio = np.clip((ahead - behind) / max(ahead + behind - 2.0 * of_noise, 0.1 * of_noise), -1.0, 1.0)
    off = 0.5 * np.tan(0.5 * np.arcsin(ratio))
    # At least what the gate lets pass, so that a weak row does not pass for a sharp one.
    strength = max(power - of_noise, 0.1 * of_noise) / (n * periods**2 * noise)  # over noise, of one code period
    summed = strength * periods
    dot = np.real(np.vdot(_sums(prompt, bit, n), _sums(early - late, bit, n)))
    code_chips = dot / max(power - of_noise, 0.1 * of_noise) / discriminator.gain
    of_sides = 2.0 * (1.0 + 2.0 * SIDE * summed) / ((2.0 * SIDE * summed) ** 2 * n)  # r, and var R without 3 r
    coherent = discriminator.noise_chips2 / (n * summed)
    return NoncoherentMeasurement(
        code_chips=float(np.clip(code_chips, -0.5, 0.5)),
        code_sigma_chips=float(np.sqrt(coherent * (1.0 + 1.0 / summed))),
        doppler_hz=near_hz + float(off) / bit_s,
        doppler_sigma_hz=float(0.25 * np.sqrt(of_sides * (1.0 + 3.0 * of_sides)) / bit_s),
        cn0_dbhz=float(10.0 * np.log10(strength / signal.period_s)),
    )


def _label_whole_bits(periods: Reals, bit_start: float, length: int) -> Integers:
    """Label the bit of each code period, from 0 on; -1 in bits with a missing part."""
    of = np.floor((periods - bit_start) / length).astype(np.int64)
    first, counts = np.unique(of, return_inverse=True, return_counts=True)[1:]
    whole = counts == length
    return np.where(whole[first], (np.cumsum(whole) - 1)[first], -1)


def _sums(values: Complexes, bit: Integers, n: int) -> Complexes:
    return np.bincount(bit, values.real, n) + 1j * np.bincount(bit, values.imag, n)


def _energy(values: Complexes, bit: Integers, n: int) -> float:
    return float(np.sum(np.abs(_sums(values, bit, n)) ** 2))
