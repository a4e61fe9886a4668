"""Inner loops: correlate and steer every channel over a stretch of samples in one call.

A kernel sees arrays and numbers only. One call advances all channels over all code periods that lie in the samples: no
Python runs per millisecond. Correlators are summed coherently over `INTEGRATION` code periods, aligned to the data bits
once these are known, and the loops are closed with the sum.
"""

import math

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Floats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.receiver.correlator import allocate_scratch, correlate_period

# Columns of the channel state, one row a channel (float64).
START = 0  # absolute index of the first sample of the next code period
CHIP = 1  # code phase at that sample, chips in [0, chips a sample)
PHASE = 2  # carrier phase at that sample, cycles, never wrapped
FREQUENCY = 3  # carrier frequency used for the next period, Hz, intermediate frequency included
CODE_RATE = 4  # chips/s used for the next period
PERIODS = 5  # code periods since the channel began
PLL_VELOCITY = 6  # loop filter memories: Hz and Hz/s
PLL_ACCELERATION = 7
POWER = 8  # smoothed power of the prompt correlator, signal only, a code period
LAST_I = 9
LAST_Q = 10
PLL_BANDWIDTH = 11  # Hz; the steering may change it
FLL_BANDWIDTH = 12  # Hz; zero once the phase loop holds alone
DLL_BANDWIDTH = 13  # Hz
INTEGRATION = 14  # code periods summed before the loops are closed; divides the periods of a bit
BIT_START = 15  # code period, modulo those of a bit, with which bits begin; -1 unknown
SUM_PERIODS = 16  # periods in the sums so far
SUM_SHIFT = 17
SUM_SAMPLES = 18
SUM_TAPS = 19  # early, prompt, late: real and imaginary parts, 6 columns
LOCK_I = 25  # since the frame began: sums of squares of the prompt a period of integration, over its length
LOCK_Q = 26
LOCK_COUNT = 27
RESIDUAL = 28  # of the measurements: mean carrier phase minus the loop's at the end of the last one, cycles
HALF_CYCLES = 29  # of the measurements: slips of the loop mended so far, half cycles
CN0_DBHZ = 30  # smoothed over a second
CODE_MINUS_CARRIER = 31  # seconds, slow mean; NaN before the first measurement
SHIFT_OWED = 32  # chips by which the replica was late so far, all periods together
RESIDUAL_VARIANCE = 33  # of the measurements: how well that residual is known, cycles squared
CODE_STEER = 34  # chips/s beside all else; where other signals of the satellite swing the discriminator, instead of it
SLIPPED = 35  # of the measurements: 1 if the carrier slipped, or may have, since the last row that was given out
CARRIER_CORRECTION = 36  # cycles beside what the phase discriminator says
N_STATE = 37

# Columns of what one code period of one channel gives (float64), followed by real and imaginary part of every tap, of
# the antennas' weighted sum; then, where there are several, by those of early, prompt and late of each antenna.
OUT_START = 0
OUT_CHIP = 1
OUT_PHASE = 2
OUT_FREQUENCY = 3
OUT_PERIOD = 4
OUT_SHIFT = 5  # chips, mean of the wanted minus the used code phase of early and late replica
OUT_TAPS = 6

POWER_MEMORY_S = 0.05


def row_size(n_taps: int, n_antennas: int) -> int:
    """Return the columns of a code period's row."""
    return OUT_TAPS + 2 * n_taps + (6 * n_antennas if n_antennas > 1 else 0)


@compiled
def steer(
    state: Reals,
    sample_power: float,
    rate_hz: float,
    if_hz: float,
    code_rate_hz: float,
    carrier_hz: float,
    code_gain: float,
) -> None:
    """Close the loops with the sums: third-order Costas PLL with FLL assistance, carrier-aided first-order DLL.

    Loop coefficients after Kaplan & Hegarty, table 8.23 (third-order PLL: w0 = B/0.7845, a3 = 1.1, b3 = 2.4;
    second-order FLL: w0 = B/0.53, a2 = 1.414). The code discriminator is the normalised dot product (8.7). Early
    means ahead in code phase: positive when the signal is ahead of the replica.
    """
    periods = state[SUM_PERIODS]
    duration_s = state[SUM_SAMPLES] / rate_hz
    i_early, q_early, i_prompt, q_prompt, i_late, q_late = state[SUM_TAPS : SUM_TAPS + 6]
    power = i_prompt * i_prompt + q_prompt * q_prompt
    if power <= 0.0:  # samples of zero, where some are missing: the loops go on as they were
        state[SUM_PERIODS : SUM_TAPS + 6] = 0.0
        return
    noise = state[SUM_SAMPLES] * sample_power
    if state[POWER] <= 0.0:
        state[POWER] = power / periods**2
    state[POWER] += min(duration_s / POWER_MEMORY_S, 1.0) * ((power - noise) / periods**2 - state[POWER])
    # Noise alone must not blow the code loop's gain up.
    signal = max(state[POWER] * periods**2, 0.2 * noise)
    dot = (i_early - i_late) * i_prompt + (q_early - q_late) * q_prompt
    code_error = dot / signal / code_gain - state[SUM_SHIFT] / periods
    phase_error = math.atan(q_prompt / i_prompt) / (2.0 * math.pi) if i_prompt != 0.0 else 0.25
    phase_error += state[CARRIER_CORRECTION]
    w_pll = state[PLL_BANDWIDTH] / 0.7845
    state[PLL_ACCELERATION] += duration_s * w_pll**3 * phase_error
    state[PLL_VELOCITY] += duration_s * (state[PLL_ACCELERATION] + 1.1 * w_pll**2 * phase_error)
    if state[FLL_BANDWIDTH] > 0.0 and state[LAST_I] != 0.0:
        cross = state[LAST_I] * q_prompt - state[LAST_Q] * i_prompt
        turn = state[LAST_I] * i_prompt + state[LAST_Q] * q_prompt
        if turn < 0.0:  # a data bit turned over, or half a cycle: the two-quadrant difference ignores both
            cross, turn = -cross, -turn
        # A sum that the turn of a bit has cut down is all noise, and counts for what it has.
        share = min(math.hypot(cross, turn) / signal, 1.0)
        frequency_error = share * math.atan2(cross, turn) / (2.0 * math.pi * duration_s)
        w_fll = state[FLL_BANDWIDTH] / 0.53
        state[PLL_ACCELERATION] += duration_s * w_fll**2 * frequency_error
        state[PLL_VELOCITY] += duration_s * 1.414 * w_fll * frequency_error
    state[FREQUENCY] = if_hz + state[PLL_VELOCITY] + 2.4 * w_pll * phase_error
    aiding = code_rate_hz * (1.0 + state[PLL_VELOCITY] / carrier_hz)
    state[CODE_RATE] = aiding + 4.0 * state[DLL_BANDWIDTH] * min(max(code_error, -0.5), 0.5) + state[CODE_STEER]
    state[LAST_I] = i_prompt
    state[LAST_Q] = q_prompt
    state[LOCK_I] += i_prompt * i_prompt / periods
    state[LOCK_Q] += q_prompt * q_prompt / periods
    state[LOCK_COUNT] += 1.0
    state[SUM_PERIODS : SUM_TAPS + 6] = 0.0


@compiled
def close_period(state: Reals, row: Reals, n: int, rate_hz: float, chips_per_sample: float, code_length: int) -> None:
    """Add a code period's row, of `n` samples, to the sums, and carry the replica on to the next period."""
    for k in range(6):
        state[SUM_TAPS + k] += row[OUT_TAPS + k]
    state[SUM_PERIODS] += 1.0
    state[SUM_SHIFT] += row[OUT_SHIFT]
    state[SUM_SAMPLES] += n
    state[PHASE] += n * state[FREQUENCY] / rate_hz
    state[CHIP] += n * chips_per_sample - code_length
    state[START] += n
    state[PERIODS] += 1.0


@compiled
def advance(
    samples: Floats,
    n_samples: int,
    first_sample: int,
    sample_power: float,
    weights: Reals,
    states: Reals,
    tables: NDArray[np.int8],
    pad: int,
    table_of_channel: Integers,
    taps_chips: Reals,
    taps_hz: Reals,
    look_samples: float,
    look_share: float,
    rate_hz: float,
    if_hz: float,
    code_rate_hz: float,
    carrier_hz: float,
    code_length: int,
    code_gain: float,
    out: Reals,
    counts: Integers,
) -> None:
    """Run every channel over all code periods that lie wholly inside the samples.

    The interpreter is not held: callers share channels among threads. Numba's own parallel loops would do, but their
    threads burn a core while they wait for the next frame, 40 % of all processor time.

    All antennas of a channel are correlated with one replica. Their sums, each times the conjugate of its weight, make
    the sums that close the loops: what one antenna loses the others hold.

    samples : (n_antennas, 2, n) float32, contiguous, I and Q; the first `n_samples` count. Element 0 is the sample of
        absolute index `first_sample`.
    sample_power : mean of I^2 + Q^2 times that of the replica, of the weighted sum of the antennas' noise: tells the
        noise in a correlator, to unbias the normalisation of the discriminator.
    weights : (n_channels, n_antennas, 2) real and imaginary part; 1 and 0 of a single antenna.
    states : (n_channels, N_STATE), advanced in place.
    tables : (n_tables, n_phases, columns) of `replica.code_table`, `pad` columns before the code's start;
        table_of_channel : (n_channels,).
    taps_chips : (n_delays,), ahead of prompt positive; the first three are early, prompt, late.
    taps_hz : (n_dopplers,), off the carrier's frequency; the first is zero. Every delay is taken at every Doppler.
    look_samples, look_share : all taps are taken in the periods that begin in the first `look_share` of every
        `look_samples` samples, counted from absolute index 0; in the others early, prompt and late alone.
    code_gain : of the discriminator (E - L)/P, a chip.
    out : (n_channels, max_periods, columns of `row_size`), filled, NaN for taps not taken; counts :
        (n_channels,) periods written.
    """
    nominal = code_rate_hz / rate_hz
    n_antennas = samples.shape[0]
    n_taps = taps_hz.shape[0] * taps_chips.shape[0]
    antenna_column = OUT_TAPS + 2 * n_taps  # first column of the antennas' own sums
    near_chips, all_chips = taps_chips[:3].copy(), taps_chips.copy()
    carrier, dopplers = np.zeros(1), taps_hz / rate_hz
    for channel in range(states.shape[0]):
        state = states[channel]
        table = tables[table_of_channel[channel]]
        longest = math.ceil(code_length / nominal) + 64
        scratch, scratch_near = allocate_scratch(longest, taps_chips.shape[0]), allocate_scratch(longest, 3)
        grid, grid_near = np.empty((taps_hz.shape[0], taps_chips.shape[0], 2)), np.empty((1, 3, 2))
        shifts_all, shifts_near = np.empty(taps_chips.shape[0]), np.empty(3)
        count = 0
        while count < out.shape[1]:
            chips_per_sample = state[CODE_RATE] / rate_hz
            n = math.ceil((code_length - state[CHIP]) / chips_per_sample)
            begin = int(state[START]) - first_sample
            if begin + n > n_samples:
                break
            row = out[channel, count]
            looked = state[START] % look_samples < look_share * look_samples
            shifts = shifts_all if looked else shifts_near
            sums = (grid if looked else grid_near).reshape(-1)
            row[OUT_TAPS : OUT_TAPS + sums.size] = 0.0
            row[OUT_TAPS + sums.size : antenna_column] = math.nan
            for antenna in range(n_antennas):
                correlate_period(
                    samples[antenna, 0],
                    samples[antenna, 1],
                    begin,
                    n,
                    state[CHIP] + state[SHIFT_OWED],
                    chips_per_sample,
                    state[PHASE],
                    state[FREQUENCY] / rate_hz,
                    table,
                    pad,
                    nominal,
                    all_chips if looked else near_chips,
                    dopplers if looked else carrier,
                    scratch if looked else scratch_near,
                    grid if looked else grid_near,
                    shifts,
                )
                real, imaginary = weights[channel, antenna, 0], weights[channel, antenna, 1]
                for k in range(sums.size // 2):
                    row[OUT_TAPS + 2 * k] += real * sums[2 * k] + imaginary * sums[2 * k + 1]
                    row[OUT_TAPS + 2 * k + 1] += real * sums[2 * k + 1] - imaginary * sums[2 * k]
                if n_antennas > 1:
                    row[antenna_column + 6 * antenna : antenna_column + 6 * antenna + 6] = sums[:6]
            # Rounding is made up for in the next period, so that its mean vanishes also where the code stands still.
            shift = 0.5 * (shifts[0] + shifts[2]) - state[SHIFT_OWED]
            state[SHIFT_OWED] += shift
            row[OUT_START] = state[START]
            row[OUT_CHIP] = state[CHIP]
            row[OUT_PHASE] = state[PHASE]
            row[OUT_FREQUENCY] = state[FREQUENCY]
            row[OUT_PERIOD] = state[PERIODS]
            row[OUT_SHIFT] = shift
            close_period(state, row, n, rate_hz, chips_per_sample, code_length)
            if (state[PERIODS] - max(state[BIT_START], 0.0)) % state[INTEGRATION] == 0.0:
                steer(state, sample_power, rate_hz, if_hz, code_rate_hz, carrier_hz, code_gain)
            count += 1
        counts[channel] = count
