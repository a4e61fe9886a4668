"""Subtract what the signals of one satellite add to each other's correlators before anything is measured.

Away from its peak a code's autocorrelation is not zero: that of C/A has steps of 0.06 between neighbouring chips. So a
second signal of a satellite adds to all taps of the first. Code, carrier and strength swing with the carrier's phase
between the two: metres of code by one of equal strength, tens of metres by one 20 dB stronger. It is multipath
(Kaplan & Hegarty, 9.5) whose delay, amplitude and phase are known, since the other signal is tracked as well.

A code period of the other signal is a pulse with the amplitude and phase of its own prompt, data bit included. A tap
sees parts of two of them. Each part is the aperiodic autocorrelation of the code at the distance between the two,
behind the replica's low-pass. So nothing need be known of data bits. Signals are cleaned of each other in turn, the
strongest first, each of what remains of the others.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from skyproof.arrays import Complexes, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import SignalPlan, prn_of
from skyproof.receiver import kernels as k
from skyproof.receiver.replica import low_pass_gain

__all__ = ["autocorrelate_period", "take_out"]

Rows = tuple[Reals, Integers]
"""Rows (n_channels, max_periods, columns) of the kernel and how many of them count."""

POINTS = 32
"""A chip, at which correlations are tabled."""
ROUNDS = 2
"""After each, the square of the correlation between two signals is left of what one did to the other."""
LEAST_CHIPS = 0.75
"""Channels nearer to each other may follow one signal: they are left alone."""
STEERED_CHIPS = 1.4
"""From here on a loop may stand where the other's flank would not let it: there are two signals."""


def autocorrelate_period(code: NDArray[np.int8], chips_per_sample: float) -> Reals:
    """Compute the correlation of one single code period with the replica, 0, 1, 2 ... 1/`POINTS` chips off.

    It is 1 at 0.

    code : (n_chips,) of +1 and -1. Returns (n_chips POINTS + 1,); it is symmetric.
    """
    n = 2 * code.size
    spectrum = np.abs(fft.fft(code.astype(np.float64), n)) ** 2
    lines = np.arange(code.size * POINTS + 1)
    cycles = lines / n  # a chip
    lobes = fft.irfft(spectrum[lines % n] * np.sinc(cycles) ** 2 * low_pass_gain(cycles * chips_per_sample), n * POINTS)
    return np.asarray(lobes[: code.size * POINTS + 1] / lobes[0])


def take_out(
    sats: Sequence[str],
    before: Rows,
    now: Rows,
    *,
    taps_chips: Reals,
    rate_hz: float,
    if_hz: float,
    signal: SignalPlan,
    code_gain: float,
) -> Reals:
    """Clean early, prompt and late in the rows of two frames on end, in place, of the satellite's other signals.

    sats : (n_channels,). taps_chips : as of the kernel. code_gain : of the discriminator.

    Gives by how much (chips, (n_channels,)) each signal then is ahead of its replica; NaN where a satellite has one
    signal, or they are too near to each other to tell.
    """
    channels: dict[str, list[int]] = {}
    for channel, sat in enumerate(sats):
        channels.setdefault(sat, []).append(channel)
    error_chips = np.full(len(sats), np.nan)
    for sat, group in channels.items():
        if len(group) > 1:
            _clean(
                np.array(group),
                *before,
                *now,
                _build_table(signal, sat, rate_hz),
                taps_chips[:3],
                rate_hz,
                if_hz,
                signal.chip_rate_hz,
                signal.carrier_hz,
                signal.code_length,
                code_gain,
                error_chips,
            )
    return error_chips


@lru_cache(maxsize=64)
def _build_table(signal: SignalPlan, sat: str, rate_hz: float) -> Reals:
    return autocorrelate_period(signal.code(prn_of(sat)), signal.chip_rate_hz / rate_hz)


@compiled
def _clean(
    group: Integers,
    rows_before: Reals,
    count_before: Integers,
    rows_now: Reals,
    count_now: Integers,
    table: Reals,
    taps_chips: Reals,
    rate_hz: float,
    if_hz: float,
    chip_rate_hz: float,
    carrier_hz: float,
    code_length: int,
    code_gain: float,
    error_chips: Reals,
) -> None:
    """Clean the channels of one satellite, in place; fill in their errors."""
    n = group.size
    counts = count_before[group] + count_now[group]
    rows = np.empty((n, counts.max(), k.OUT_TAPS + 6))
    seen = np.zeros((n, rows.shape[1], 3), np.complex128)
    starts, ahead, off_hz = np.zeros((3, n, rows.shape[1]))
    turned = np.zeros((n, rows.shape[1]), np.complex128)
    power = np.zeros(n)
    for i in range(n):
        channel, first = group[i], count_before[group[i]]
        rows[i, :first] = rows_before[channel, :first, : k.OUT_TAPS + 6]
        rows[i, first : counts[i]] = rows_now[channel, : counts[i] - first, : k.OUT_TAPS + 6]
    reference_hz = np.mean(rows[counts > 0, 0, k.OUT_FREQUENCY])
    origin = rows[np.argmax(counts), 0, k.OUT_START]
    chips_per_sample = chip_rate_hz / rate_hz
    length = code_length / chips_per_sample
    for i in range(n):
        channel_rows = rows[i, : counts[i]]
        _locate(channel_rows, rate_hz, if_hz, chip_rate_hz, carrier_hz, code_length, starts[i], ahead[i])
        for r in range(counts[i]):
            # All as if one carrier had been wiped off, the channels' own turning against it about the period's middle.
            middle = starts[i, r] + 0.5 * length
            off_hz[i, r] = channel_rows[r, k.OUT_FREQUENCY] - reference_hz
            cycles = (
                channel_rows[r, k.OUT_PHASE]
                + channel_rows[r, k.OUT_FREQUENCY] * (middle - channel_rows[r, k.OUT_START]) / rate_hz
            )
            cycles -= reference_hz * (middle - origin) / rate_hz
            angle_rad = 2.0 * math.pi * (cycles - math.floor(cycles))
            turned[i, r] = complex(math.cos(angle_rad), math.sin(angle_rad))
            for tap in range(3):
                value = complex(channel_rows[r, k.OUT_TAPS + 2 * tap], channel_rows[r, k.OUT_TAPS + 2 * tap + 1])
                seen[i, r, tap] = value * turned[i, r]
            power[i] += abs(seen[i, r, 1]) ** 2 / counts[i]
    order = np.argsort(-power, kind="mergesort")
    cleaned = seen.copy()
    near = np.zeros(n, np.bool_)
    for turn in range(ROUNDS):
        for place in range(n):
            i = order[place]
            mine = cleaned[i, : counts[i]]
            mine[:] = seen[i, : counts[i]]
            for j in order[: place if turn == 0 else n]:
                if j == i or counts[i] == 0 or counts[j] == 0:
                    continue
                other = cleaned[j, : counts[j]]
                off_chips = ahead[j, : counts[j]] + _error_chips(other, code_gain)
                signal_starts = starts[j, : counts[j]] - off_chips / chips_per_sample
                apart = (signal_starts[0] - starts[i, 0]) * chips_per_sample / code_length
                apart_chips = abs(apart - math.floor(apart + 0.5)) * code_length
                near[i] |= apart_chips < STEERED_CHIPS
                if apart_chips > LEAST_CHIPS:
                    _subtract(
                        mine,
                        off_hz[i],
                        starts[i],
                        other[:, 1],
                        off_hz[j],
                        signal_starts,
                        table,
                        taps_chips,
                        rate_hz,
                        chips_per_sample,
                        length,
                    )
    for i in range(n):
        channel, first = group[i], count_before[group[i]]
        if not near[i] and counts[i] > 0:
            error_chips[channel] = _error_chips(cleaned[i, : counts[i]], code_gain)
        for r in range(counts[i]):
            row = rows_before[channel, r] if r < first else rows_now[channel, r - first]
            for tap in range(3):
                value = cleaned[i, r, tap] * turned[i, r].conjugate()
                row[k.OUT_TAPS + 2 * tap] = value.real
                row[k.OUT_TAPS + 2 * tap + 1] = value.imag


@compiled
def _locate(
    rows: Reals,
    rate_hz: float,
    if_hz: float,
    chip_rate_hz: float,
    carrier_hz: float,
    code_length: int,
    starts: Reals,
    ahead_chips: Reals,
) -> None:
    """Locate the start (samples) of the replica's code in each period, and the lead of a code in step with the carrier.

    That code is as often ahead of the replica as behind.
    """
    n = rows.shape[0]
    for r in range(n):
        chip = rows[r, k.OUT_CHIP] - rows[r, k.OUT_SHIFT]
        starts[r] = rows[r, k.OUT_START] - chip * rate_hz / chip_rate_hz
        gone_s = (rows[r, k.OUT_START] - rows[0, k.OUT_START]) / rate_hz
        cycles = rows[r, k.OUT_PHASE] - rows[0, k.OUT_PHASE] - if_hz * gone_s
        code = (rows[r, k.OUT_PERIOD] - rows[0, k.OUT_PERIOD]) * code_length + chip
        ahead_chips[r] = (gone_s + cycles / carrier_hz) * chip_rate_hz - code
    if n > 0:
        ahead_chips[:n] -= np.mean(ahead_chips[:n])


@compiled
def _error_chips(taps: Complexes, code_gain: float) -> float:
    """Estimate how far ahead of the replica the signal is, from taps (n, 3); too little if noise is as strong as it."""
    dot, power = 0.0, 0.0
    for r in range(taps.shape[0]):
        prompt = taps[r, 1]
        dot += ((taps[r, 0] - taps[r, 2]) * prompt.conjugate()).real
        power += prompt.real * prompt.real + prompt.imag * prompt.imag
    return min(max(dot / power / code_gain, -0.5), 0.5) if power > 0.0 else 0.0


@compiled
def _subtract(
    taps: Complexes,
    off_hz: Reals,
    starts: Reals,
    others: Complexes,
    other_off_hz: Reals,
    other_starts: Reals,
    table: Reals,
    taps_chips: Reals,
    rate_hz: float,
    chips_per_sample: float,
    length: float,
) -> None:
    """Subtract from taps (n, 3) what another signal of these prompts (m,) and starts of its code adds to them.

    The first and the last pulse are taken to last one period more: frames do not end for all channels at once.
    """
    last = others.size - 1
    pulse = -1
    for r in range(taps.shape[0]):
        while pulse < last and other_starts[pulse + 1] <= starts[r]:
            pulse += 1
        for p in range(pulse, pulse + 2):
            known = min(max(p, 0), last)
            later = other_starts[known] + (p - known) * length - starts[r]
            common = length - abs(later)
            if common <= 0.0:
                continue
            # What they have in common lies half of `later` before the one's middle and behind the other's.
            angle_rad = -math.pi * later * (other_off_hz[known] + off_hz[r]) / rate_hz
            turn_rad = math.pi * common * (other_off_hz[known] - off_hz[r]) / rate_hz
            coherence = max(1.0 - turn_rad * turn_rad / 6.0, 0.0)  # of the sum while the one turns against the other
            amplitude = others[known] * coherence * complex(1.0 - 0.5 * angle_rad * angle_rad, angle_rad)
            for tap in range(taps.shape[1]):
                at = abs(later * chips_per_sample + taps_chips[tap]) * POINTS
                point = int(at)
                if point + 1 < table.size:
                    taps[r, tap] -= amplitude * (table[point] + (at - point) * (table[point + 1] - table[point]))
