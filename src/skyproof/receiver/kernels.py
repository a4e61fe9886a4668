"""The inner loops: correlate and steer every channel over a stretch of samples in one call.

A kernel sees arrays and numbers only. What costs time was measured (docs/design/receiver.md):

- The carrier is wiped off by one complex multiplication a sample with a table of `CHUNK` rotations made anew each code
  period (by doubling); the phase at the chunk's start is applied to the sums, not to the samples.
- The code is a table of the resampled code at `n_phases` fractions of a sample (int8), read contiguously; a further tap
  is one more pass over a chunk that sits in the first-level cache. What rounding to the nearest fraction shifts the
  replica by is known and taken off the discriminator, so it causes no bias.
- Reductions may be reassociated (SIMD), which NaN survives; no other liberty of fast-math is taken.
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

CHUNK = 512
"""Samples between two look-ups of the code table: at 10 ppm and this length the code drifts 0.005 sample."""

# Columns of the channel state, one row a channel (float64).
START = 0  # absolute index of the first sample of the next code period
CHIP = 1  # code phase at that sample, chips in [0, chips a sample)
PHASE = 2  # carrier phase at that sample, cycles, never wrapped
FREQUENCY = 3  # carrier frequency used for the next period, Hz, intermediate frequency included
CODE_RATE = 4  # chips/s used for the next period
PERIODS = 5  # code periods since the channel began
PLL_VELOCITY = 6  # loop filter memories: Hz and Hz/s
PLL_ACCELERATION = 7
POWER = 8  # smoothed power of the prompt correlator
LAST_I = 9
LAST_Q = 10
PLL_BANDWIDTH = 11  # Hz; the steering may change it
FLL_BANDWIDTH = 12  # Hz; zero once the phase loop holds alone
DLL_BANDWIDTH = 13  # Hz
N_STATE = 14

# Columns of what one code period of one channel gives (float64), followed by real and imaginary part of every tap.
OUT_START = 0
OUT_CHIP = 1
OUT_PHASE = 2
OUT_FREQUENCY = 3
OUT_CODE_RATE = 4
OUT_PERIOD = 5
OUT_CODE_ERROR = 6  # chips, true code phase minus the one used
OUT_PHASE_ERROR = 7  # cycles, two-quadrant
OUT_TAPS = 8

_FAST = {"reassoc", "contract", "nsz"}


def code_table(code: NDArray[np.int8], chips_per_sample: float, n_phases: int, n_samples: int) -> NDArray[np.int8]:
    """The code resampled at `n_phases` fractions of a sample.

    Row p, column k is the chip at (k - pad + p / n_phases) samples after the start of the code, pad being
    `table_pad(chips_per_sample)`. Shape (n_phases, n_samples + 2 pad).
    """
    pad = table_pad(chips_per_sample)
    samples = np.arange(-pad, n_samples + pad)[None, :] + np.arange(n_phases)[:, None] / n_phases
    table: NDArray[np.int8] = code[np.floor(samples * chips_per_sample).astype(np.int64) % code.size]
    return table


def table_pad(chips_per_sample: float) -> int:
    """Columns before the code's start and after its end: taps may lie up to two chips off the prompt."""
    return math.ceil(2.0 / chips_per_sample) + 4


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def _rotations(cycles_per_sample: float, cosines: NDArray[np.float32], sines: NDArray[np.float32]) -> None:
    """exp(-j 2 pi k cycles_per_sample) for k < CHUNK, each doubling in double-precision angle."""
    cosines[0] = np.float32(1.0)
    sines[0] = np.float32(0.0)
    length = 1
    while length < CHUNK:
        angle = -2.0 * math.pi * ((length * cycles_per_sample) % 1.0)
        c = np.float32(math.cos(angle))
        s = np.float32(math.sin(angle))
        for k in range(length):
            cosines[length + k] = cosines[k] * c - sines[k] * s
            sines[length + k] = cosines[k] * s + sines[k] * c
        length *= 2


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def _wipe(
    i_samples: NDArray[np.float32],
    q_samples: NDArray[np.float32],
    cosines: NDArray[np.float32],
    sines: NDArray[np.float32],
    i_base: NDArray[np.float32],
    q_base: NDArray[np.float32],
) -> None:
    for k in range(i_samples.shape[0]):
        i_base[k] = i_samples[k] * cosines[k] - q_samples[k] * sines[k]
        q_base[k] = i_samples[k] * sines[k] + q_samples[k] * cosines[k]


@numba.njit(cache=True, nogil=True, fastmath=_FAST)
def _dot(
    i_base: NDArray[np.float32], q_base: NDArray[np.float32], replica: NDArray[np.int8]
) -> tuple[np.float32, np.float32]:
    i_sum = np.float32(0.0)
    q_sum = np.float32(0.0)
    for k in range(replica.shape[0]):
        chip = np.float32(replica[k])
        i_sum += i_base[k] * chip
        q_sum += q_base[k] * chip
    return i_sum, q_sum


@numba.njit(cache=True, nogil=True)
def _correlate_period(
    i_samples: NDArray[np.float32],
    q_samples: NDArray[np.float32],
    chip: float,
    chips_per_sample: float,
    phase_cyc: float,
    cycles_per_sample: float,
    table: NDArray[np.int8],
    nominal_chips_per_sample: float,
    taps_chips: NDArray[np.float64],
    scratch: NDArray[np.float32],
    sums: NDArray[np.float64],
    shifts_chips: NDArray[np.float64],
) -> None:
    """Correlate one code period with every tap.

    sums : (2 n_taps,) real and imaginary parts, filled.
    shifts_chips : (n_taps,) mean of the wanted minus the used code phase of the replica, filled.
    """
    n_phases = table.shape[0]
    pad = math.ceil(2.0 / nominal_chips_per_sample) + 4
    n = i_samples.shape[0]
    cosines, sines, i_base, q_base = scratch[0], scratch[1], scratch[2], scratch[3]
    _rotations(cycles_per_sample, cosines, sines)
    sums[:] = 0.0
    shifts_chips[:] = 0.0
    for begin in range(0, n, CHUNK):
        length = min(CHUNK, n - begin)
        _wipe(
            i_samples[begin : begin + length], q_samples[begin : begin + length],
            cosines[:length], sines[:length], i_base, q_base,
        )  # fmt: skip
        angle = -2.0 * math.pi * ((phase_cyc + begin * cycles_per_sample) % 1.0)
        c, s = math.cos(angle), math.sin(angle)
        middle = begin + 0.5 * (length - 1)
        for tap in range(taps_chips.shape[0]):
            wanted = (chip + middle * chips_per_sample + taps_chips[tap]) / nominal_chips_per_sample
            steps = math.floor((wanted - 0.5 * (length - 1)) * n_phases + 0.5)
            used = steps / n_phases + 0.5 * (length - 1)
            first = steps // n_phases + pad
            i_sum, q_sum = _dot(i_base[:length], q_base[:length], table[steps % n_phases, first : first + length])
            sums[2 * tap] += i_sum * c - q_sum * s
            sums[2 * tap + 1] += i_sum * s + q_sum * c
            shifts_chips[tap] += (wanted - used) * nominal_chips_per_sample * length / n


@numba.njit(cache=True, nogil=True)
def _early_minus_late(sums: NDArray[np.float64], power: float) -> float:
    """Code error in chips from taps early (0), prompt (1), late (2): half of Re((E - L) P*) over the prompt's power.

    The triangle's slope makes (E - L)/P twice the error, whatever the spacing (Kaplan & Hegarty, 8.7.3: coherent dot
    product, normalised). Early means ahead in code phase: positive when the signal is ahead of the replica.
    """
    dot = float((sums[0] - sums[4]) * sums[2] + (sums[1] - sums[5]) * sums[3])
    return 0.5 * dot / power


@numba.njit(cache=True, nogil=True)
def _steer(state: NDArray[np.float64], sums: NDArray[np.float64], code_error: float, duration_s: float,
           if_hz: float, code_rate_hz: float, carrier_hz: float) -> float:  # fmt: skip
    """Close the loops after one period: third-order Costas PLL with FLL assistance, carrier-aided first-order DLL.

    Loop coefficients after Kaplan & Hegarty, table 8.23 (third-order PLL: w0 = B/0.7845, a3 = 1.1, b3 = 2.4;
    second-order FLL: w0 = B/0.53, a2 = 1.414). Gives the phase error in cycles.
    """
    i_prompt, q_prompt = sums[2], sums[3]
    phase_error = math.atan(q_prompt / i_prompt) / (2.0 * math.pi) if i_prompt != 0.0 else 0.25
    w_pll = state[PLL_BANDWIDTH] / 0.7845
    state[PLL_ACCELERATION] += duration_s * w_pll**3 * phase_error
    state[PLL_VELOCITY] += duration_s * (state[PLL_ACCELERATION] + 1.1 * w_pll**2 * phase_error)
    if state[FLL_BANDWIDTH] > 0.0 and state[PERIODS] > 0.0:
        cross = state[LAST_I] * q_prompt - state[LAST_Q] * i_prompt
        dot = state[LAST_I] * i_prompt + state[LAST_Q] * q_prompt
        if dot < 0.0:  # a data bit turned over, or half a cycle: the two-quadrant difference ignores both
            cross, dot = -cross, -dot
        frequency_error = math.atan2(cross, dot) / (2.0 * math.pi * duration_s)
        w_fll = state[FLL_BANDWIDTH] / 0.53
        state[PLL_ACCELERATION] += duration_s * w_fll**2 * frequency_error
        state[PLL_VELOCITY] += duration_s * 1.414 * w_fll * frequency_error
    state[FREQUENCY] = if_hz + state[PLL_VELOCITY] + 2.4 * w_pll * phase_error
    aiding = code_rate_hz * (1.0 + state[PLL_VELOCITY] / carrier_hz)
    state[CODE_RATE] = aiding + 4.0 * state[DLL_BANDWIDTH] * code_error
    state[LAST_I] = i_prompt
    state[LAST_Q] = q_prompt
    return phase_error


@numba.njit(cache=True, nogil=True, parallel=True)
def advance(
    i_samples: NDArray[np.float32],
    q_samples: NDArray[np.float32],
    first_sample: int,
    sample_power: float,
    states: NDArray[np.float64],
    tables: NDArray[np.int8],
    table_of_channel: NDArray[np.int64],
    taps_chips: NDArray[np.float64],
    rate_hz: float,
    if_hz: float,
    code_rate_hz: float,
    carrier_hz: float,
    code_length: int,
    out: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> None:
    """Advance every channel over all code periods that lie wholly inside the samples given.

    i_samples, q_samples : (n,) float32; element 0 is the sample of absolute index `first_sample`.
    sample_power : mean of I^2 + Q^2: tells the noise in a correlator, to unbias the normalisation of the discriminator.
    states : (n_channels, N_STATE), advanced in place.
    tables : (n_tables, n_phases, columns) of `code_table`; table_of_channel : (n_channels,).
    taps_chips : (n_taps,), ahead of prompt positive; the first three are early, prompt, late.
    out : (n_channels, max_periods, OUT_TAPS + 2 n_taps), filled; counts : (n_channels,) periods written.
    """
    nominal = code_rate_hz / rate_hz
    n_taps = taps_chips.shape[0]
    for channel in numba.prange(states.shape[0]):
        state = states[channel]
        scratch = np.empty((4, CHUNK), np.float32)
        sums = np.empty(2 * n_taps, np.float64)
        shifts = np.empty(n_taps, np.float64)
        count = 0
        while count < out.shape[1]:
            chips_per_sample = state[CODE_RATE] / rate_hz
            n = math.ceil((code_length - state[CHIP]) / chips_per_sample)
            begin = int(state[START]) - first_sample
            if begin + n > i_samples.shape[0]:
                break
            _correlate_period(
                i_samples[begin : begin + n], q_samples[begin : begin + n], state[CHIP], chips_per_sample,
                state[PHASE], state[FREQUENCY] / rate_hz, tables[table_of_channel[channel]], nominal, taps_chips,
                scratch, sums, shifts,
            )  # fmt: skip
            row = out[channel, count]
            row[OUT_START] = state[START]
            row[OUT_CHIP] = state[CHIP]
            row[OUT_PHASE] = state[PHASE]
            row[OUT_FREQUENCY] = state[FREQUENCY]
            row[OUT_CODE_RATE] = state[CODE_RATE]
            row[OUT_PERIOD] = state[PERIODS]
            for k in range(2 * n_taps):
                row[OUT_TAPS + k] = sums[k]
            power = sums[2] * sums[2] + sums[3] * sums[3]
            if state[POWER] <= 0.0:
                state[POWER] = power
            # 20 ms of memory; the noise's own share of the power is known and taken off
            state[POWER] += 0.05 * (power - state[POWER])
            signal_power = max(state[POWER] - n * sample_power, 0.1 * state[POWER])
            code_error = _early_minus_late(sums, signal_power) - 0.5 * (shifts[0] + shifts[2])
            row[OUT_CODE_ERROR] = code_error
            duration_s = n / rate_hz
            state[PHASE] += n * state[FREQUENCY] / rate_hz
            state[CHIP] += n * chips_per_sample - code_length
            state[START] += n
            row[OUT_PHASE_ERROR] = _steer(
                state, sums, min(max(code_error, -0.5), 0.5), duration_s, if_hz, code_rate_hz, carrier_hz
            )
            state[PERIODS] += 1.0
            count += 1
        counts[channel] = count
