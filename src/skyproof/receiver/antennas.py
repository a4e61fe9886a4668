"""Combine several antennas of one receiver: their sum closes the loops, and each is measured beside it.

The antennas share the sampling clock and the oscillator, so that one replica serves all of them. From one antenna to
the next the carrier's phase differs, by the direction that the signal comes from, and much less the code's delay.

The loops follow the sum with the best ratio of signal to noise, each antenna weighted by its amplitude and turned by
its phase (maximal-ratio combining: Van Trees, Optimum Array Processing, 2.6.1 and 6.2). So a signal is kept as long as
any antenna has it, and is up to 10 log10(antennas) dB stronger than on one. The weights of a frame are the projections
of the antennas' prompts on the sum in the frame before. To first order they do not turn the sum: it keeps its phase
from frame to frame.

Carrier and data bits that are found in the sum are taken off every antenna's prompts, which may then be averaged
over a whole block: no antenna has to be locked alone, and their phases are known against each other without an
ambiguity of half a cycle.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from skyproof.arrays import Booleans, Complexes, ComplexFloats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.receiver import kernels as k
from skyproof.receiver import measurement as m
from skyproof.receiver.crosstalk import Rows, take_out
from skyproof.receiver.discriminator import Discriminator

__all__ = [
    "N_LAST",
    "compute_weights",
    "find_first_prompt",
    "first_weights",
    "measure_antennas",
    "subtract_by_antenna",
    "unwrap_phases",
]

N_LAST = 3
"""What is remembered of an antenna from one row of measurements to the next: phase, its rate, and its sigma."""
_SIGMAS = 6.0
"""By so many a phase may be off before it is taken for a whole cycle's step."""


def first_weights(antenna: int, n_antennas: int) -> Reals:
    """Return the weights (1, n_antennas, 2) of a channel that follows a signal found on one antenna."""
    weights = np.zeros((1, n_antennas, 2))
    weights[0, antenna, 0] = 1.0
    return weights


def compute_weights(rows: Reals, weights: Reals, power: Reals) -> Reals:
    """Compute the weights (n_channels, n_antennas, 2), real and imaginary part, for the next frame.

    rows, weights : of the frame before, as of the kernel; zero where there is none.
    power : (n_antennas,) of the antennas' noise.

    The weighted sum of the antennas' noise has the largest of the powers. One antenna has the weight 1.
    """
    n_antennas = power.size
    if n_antennas == 1 or not np.any(power > 0.0):
        return weights
    scale = np.sqrt(np.max(power) / np.where(power > 0.0, power, np.inf))
    prompts = _antenna_taps(rows, n_antennas)[..., 1]
    turned = _complex(weights)
    total = np.einsum("cra,ca->cr", prompts, turned.conj())
    seen = np.einsum("cra,cr->ca", prompts, total.conj()) * scale
    length = np.linalg.norm(seen, axis=1, keepdims=True)
    turned = np.where(length > 0.0, seen / np.where(length > 0.0, length, 1.0) * scale, turned)
    return np.stack([turned.real, turned.imag], axis=-1)


def subtract_by_antenna(
    sats: Sequence[str], before: Rows, now: Rows, weights: tuple[Reals, Reals], **correlation: Any
) -> Reals:
    """Subtract a satellite's other signals antenna by antenna, as `crosstalk.take_out` does.

    To each antenna, another signal of the satellite adds with another phase.

    weights : of the frame before and of this one, (n_channels, n_antennas, 2). correlation : as `take_out` takes it.

    Returns what `take_out` returns, for the weighted sum.
    """
    n_antennas = weights[0].shape[1]
    if n_antennas == 1:
        return take_out(sats, before, now, **correlation)
    errors_chips = np.full((len(sats), n_antennas), np.nan)
    if len(set(sats)) == len(sats):
        return errors_chips[:, 0]
    for antenna in range(n_antennas):
        parts = [(_select_antenna(rows, antenna, n_antennas), counts) for rows, counts in (before, now)]
        errors_chips[:, antenna] = take_out(sats, *parts, **correlation)
        for (rows, _), (part, _) in zip((before, now), parts, strict=True):
            first = _first_column(rows, n_antennas) + 6 * antenna
            rows[..., first : first + 6] = part[..., k.OUT_TAPS :]
    for (rows, _), those in zip((before, now), weights, strict=True):
        summed = np.einsum("crat,ca->crt", _antenna_taps(rows, n_antennas), _complex(those).conj())
        pairs = np.stack([summed.real, summed.imag], axis=-1)
        rows[..., k.OUT_TAPS : k.OUT_TAPS + 6] = pairs.reshape(*summed.shape[:2], 6)
    share = np.sum(weights[1] ** 2, axis=-1)
    return np.asarray(np.sum(errors_chips * share, axis=1) / np.sum(share, axis=1))


def measure_antennas(
    before: Rows,
    now: Rows,
    wipe: Complexes,
    taps: ComplexFloats,
    elapsed_s: float,
    n_antennas: int,
    rate_hz: float,
    period_s: float,
    chip_rate_hz: float,
    discriminator: Discriminator,
    false_hold_probability: float,
) -> Reals:
    """Measure each antenna beside the sum, (n_channels, n_antennas, N_OWN); NaN where it has no signal.

    before, now : as `measure` takes them; wipe, taps : as it returns them. Phases lie within half a cycle.
    false_hold_probability : that noise passes for a signal in one row.

    Let R be the signal's energy over the noise density in the block. The phase's sigma is 1 / sqrt(2 R) radians (Kay,
    Estimation Theory, example 3.4), and noise alone exceeds R with exp(-R).
    """
    per_antenna = np.full((wipe.shape[0], n_antennas, m.N_OWN), np.nan)
    with np.errstate(invalid="ignore"):
        summed_chips = (taps[:, 0] - taps[:, 2]).real / taps[:, 1].real / discriminator.gain
    _measure(
        *before,
        *now,
        wipe,
        _first_column(now[0], n_antennas),
        elapsed_s * rate_hz,
        rate_hz,
        period_s,
        chip_rate_hz,
        discriminator.gain,
        discriminator.noise_chips2,
        summed_chips,
        -math.log(false_hold_probability),
        per_antenna,
    )
    return per_antenna


def unwrap_phases(own: Reals, last: Reals, good: Booleans, interval_s: float) -> Reals:
    """Unwrap the phases in `own`, in place, from `last`; return what to remember, (n_channels, n_antennas, N_LAST).

    good : (n_channels,) whose rows are output. If a whole cycle more or less cannot be excluded, or nothing is known
    from `interval_s` ago, the phase counts as slipped.
    """
    phase, rate, sigma = own[..., m.OWN_PHASE_CYC], own[..., m.OWN_DOPPLER_HZ], own[..., m.OWN_PHASE_SIGMA_CYC]
    expected = last[..., 0] + 0.5 * interval_s * (last[..., 1] + rate)
    known = np.isfinite(expected) & np.isfinite(phase)
    phase[known] += np.rint(expected - phase)[known]
    off = np.abs(expected - phase) + _SIGMAS * np.hypot(sigma, last[..., 2])
    own[..., m.OWN_SLIP] = np.where(known & (off < 0.5), 0.0, 1.0)
    now = np.stack([phase, rate, sigma], axis=-1)
    return np.where(good[:, None, None], now, np.nan)


def find_first_prompt(rows: Reals, n_antennas: int) -> int:
    """Return the column of the kernel's output in which the first antenna's prompt stands."""
    return _first_column(rows, n_antennas) + 2


def _first_column(rows: Reals, n_antennas: int) -> int:
    return int(rows.shape[2]) - 6 * n_antennas


def _select_antenna(rows: Reals, antenna: int, n_antennas: int) -> Reals:
    """Return rows as of a receiver with this antenna alone, a copy."""
    first = _first_column(rows, n_antennas) + 6 * antenna
    return np.concatenate([rows[..., : k.OUT_TAPS], rows[..., first : first + 6]], axis=-1)


def _antenna_taps(rows: Reals, n_antennas: int) -> Complexes:
    """Return early, prompt and late of each antenna, (n_channels, periods, n_antennas, 3)."""
    sums = rows[..., _first_column(rows, n_antennas) :].reshape(*rows.shape[:2], n_antennas, 3, 2)
    return _complex(sums)


def _complex(parts: Reals) -> Complexes:
    return np.asarray(parts[..., 0] + 1j * parts[..., 1])


@compiled
def _measure(
    rows_before: Reals,
    count_before: Integers,
    rows_now: Reals,
    count_now: Integers,
    wipe: Complexes,
    first_column: int,
    epoch: float,
    rate_hz: float,
    period_s: float,
    chip_rate_hz: float,
    code_gain: float,
    code_noise_chips2: float,
    summed_chips: Reals,
    least_energy: float,
    own: Reals,
) -> None:
    for channel in range(wipe.shape[0]):
        n_before, n = count_before[channel], count_before[channel] + count_now[channel]
        if n_before == 0 or n == n_before or not math.isfinite(summed_chips[channel]):
            continue
        t = np.empty(n)
        for r in range(n):
            row = rows_before[channel, r] if r < n_before else rows_now[channel, r - n_before]
            t[r] = (row[k.OUT_START] - epoch) / rate_hz + 0.5 * period_s
        middle_s = np.mean(t)
        square_s2 = np.mean((t - middle_s) ** 2)
        for antenna in range(own.shape[1]):
            first = first_column + 6 * antenna
            early, prompt, late, moment = 0.0j, 0.0j, 0.0j, 0.0j
            last, steps = 0.0j, 0.0
            for r in range(n):
                row = rows_before[channel, r] if r < n_before else rows_now[channel, r - n_before]
                value = complex(row[first + 2], row[first + 3]) * wipe[channel, r]
                early += complex(row[first], row[first + 1]) * wipe[channel, r] / n
                late += complex(row[first + 4], row[first + 5]) * wipe[channel, r] / n
                prompt += value / n
                moment += value * (t[r] - middle_s) / n
                if r > 0:
                    steps += abs(value - last) ** 2
                last = value
            noise = 0.5 * steps / (n - 1)
            power = abs(prompt) ** 2 - noise / n
            if not power * n > least_energy * noise or noise <= 0.0:
                continue
            energy = power * n / noise * (1.0 - 1.5 / (n - 1))  # as of `_carrier_to_noise_hz`
            cn0_hz = energy / (n * period_s)
            rate = (moment * prompt.conjugate()).imag / abs(prompt) ** 2 / square_s2 / (2.0 * math.pi)
            code_chips = ((early - late) * prompt.conjugate()).real / abs(prompt) ** 2 / code_gain
            phase = math.atan2(prompt.imag, prompt.real) / (2.0 * math.pi) - rate * middle_s
            sigma_cyc = 1.0 / math.sqrt(2.0 * energy) / (2.0 * math.pi)
            result = own[channel, antenna]
            result[m.OWN_CODE_S] = (code_chips - summed_chips[channel]) / chip_rate_hz
            result[m.OWN_PHASE_CYC] = phase
            result[m.OWN_DOPPLER_HZ] = rate
            result[m.OWN_CN0_DBHZ] = 10.0 * math.log10(cn0_hz)
            result[m.OWN_CODE_SIGMA_S] = math.sqrt(code_noise_chips2 / (n * period_s * cn0_hz)) / chip_rate_hz
            result[m.OWN_PHASE_SIGMA_CYC] = sigma_cyc
            result[m.OWN_DOPPLER_SIGMA_HZ] = sigma_cyc / math.sqrt(square_s2)
            result[m.OWN_SLIP] = 0.0
