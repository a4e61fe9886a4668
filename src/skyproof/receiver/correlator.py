"""Correlate one code period of one signal with any number of replicas: several delays, several Dopplers, in one pass.

Four things keep a sample cheap (`bench/kernel.py` measures them; docs/design/receiver.md lists what is omitted):

- The samples are worked through in chunks. Within one, the carrier is wiped off with a table of rotations that is
  rebuilt when the frequency changes; what the carrier had turned by until the chunk began turns the sums, not the
  samples.
- The code is a table of the resampled code at fractions of a sample, read in a row as int8. What rounding to the
  nearest fraction shifts the replica by is known and reported, so it causes no bias.
- The carrier is wiped off and the first three delays are summed in one loop; further delays go four at a time over what
  it left, so that a wiped sample is loaded once for four. Rows are reached by offsets into the flat table: a slice
  would count references, which costs as much as sixty samples.
- A Doppler offset turns the chunks' sums against each other and touches no sample.

Sums are float32 within a chunk, float64 beyond. Reductions may be reassociated (SIMD), which NaN survives; no other
liberty of fast-math is taken.
"""

import math

import numpy as np
from numba import uint64
from numpy.typing import NDArray

from skyproof.arrays import Floats, Reals
from skyproof.compiled import compiled

__all__ = ["CHUNK", "REACH_CHIPS", "allocate_scratch", "correlate_period", "table_pad"]

CHUNK = 768
"""Samples that share one look-up of the code, about: a period is cut into equal chunks. At 10 ppm of Doppler the code
drifts by 0.004 sample to either side of the middle of one. Shorter ones cost speed, longer ones Doppler taps."""

REACH_CHIPS = 2.0
"""How far from the prompt a delay may lie, unless tables are made for more."""

_BLOCK = 16  # rotations that are made one by one; and chunks are a multiple of it
_FAST = {"reassoc", "contract", "nsz"}

Scratch = tuple[Floats, NDArray[np.uint64], Reals, Reals]
"""Planes of samples, rows of the table, sums of chunks; and which rotations stand in the planes: step, how many."""


def table_pad(chips_per_sample: float, reach_chips: float = REACH_CHIPS) -> int:
    """Return the columns of a table of the resampled code before the code's start and after its end."""
    return math.ceil(reach_chips / chips_per_sample) + 4


@compiled
def allocate_scratch(n_samples: int, n_delays: int) -> Scratch:
    """Allocate room for `correlate_period` to work in, for periods of up to `n_samples`.

    One thread may use it again.
    """
    n_chunks = n_samples // CHUNK + 2
    # Rows a multiple of 4 KiB apart would look alike to the processor's check of loads against earlier stores.
    planes = np.empty((4, 2 * CHUNK + 48), np.float32)
    rows, chunk_sums = np.empty((n_chunks, n_delays), np.uint64), np.empty((n_chunks, n_delays, 2), np.float64)
    return planes, rows, chunk_sums, np.zeros(2)


@compiled
def _chunk_length(n_samples: int) -> int:
    """Return the length of equal parts of about CHUNK samples, so that no short one remains at the end."""
    n_chunks = max(1, round(n_samples / CHUNK))
    return int(_BLOCK * math.ceil(n_samples / (_BLOCK * n_chunks)))


@compiled
def _rotation(cycles: float) -> tuple[float, float]:
    """Return the real and imaginary part of exp(-j 2 pi cycles)."""
    angle_rad = -2.0 * math.pi * (cycles - math.floor(cycles))
    return math.cos(angle_rad), math.sin(angle_rad)


@compiled(fastmath=_FAST)
def _extend_rotations(
    cosines: Floats, sines: Floats, known: np.uint64, more: int, cosine: np.float32, sine: np.float32
) -> None:
    """Extend the known rotations by more of them: the known ones, each turned by the same."""
    for k in range(uint64(more)):
        cosines[known + k] = cosines[k] * cosine - sines[k] * sine
        sines[known + k] = cosines[k] * sine + sines[k] * cosine


@compiled
def _fill_rotations(cycles_per_sample: float, length: int, cosines: Floats, sines: Floats) -> None:
    """Compute exp(-j 2 pi k cycles_per_sample) for k < length.

    The first _BLOCK are computed one by one, the others by doubling.

    The rotations that double are float64 squares: their error grows by 1e-16 a sample.
    """
    cosine_1, sine_1 = _rotation(cycles_per_sample)
    cosine, sine = 1.0, 0.0
    for k in range(_BLOCK):
        cosines[k] = np.float32(cosine)
        sines[k] = np.float32(sine)
        cosine, sine = cosine * cosine_1 - sine * sine_1, cosine * sine_1 + sine * cosine_1
    known = _BLOCK
    while known < length:
        more = min(known, length - known)
        _extend_rotations(cosines, sines, uint64(known), more, np.float32(cosine), np.float32(sine))
        cosine, sine = cosine * cosine - sine * sine, 2.0 * cosine * sine
        known *= 2


@compiled(fastmath=_FAST)
def _locate(
    first_sample: float,
    samples_per_chip: float,
    delays_chips: Reals,
    n_phases: float,
    columns: float,
    pad: float,
    weight: float,
    rows: NDArray[np.uint64],
    chunk: int,
    shifts_chips: Reals,
) -> None:
    """Locate in the flat table the replica of each delay whose first sample lies `first_sample` after the code's.

    Adds `weight` times what rounding to the table's fractions takes off the wanted sample to `shifts_chips`.
    """
    for delay in range(delays_chips.shape[0]):
        wanted = first_sample + delays_chips[delay] * samples_per_chip
        steps = math.floor(wanted * n_phases + 0.5)
        whole = math.floor(steps / n_phases)
        rows[chunk, delay] = uint64((steps - whole * n_phases) * columns + whole + pad)
        shifts_chips[delay] += (wanted - steps / n_phases) * weight


@compiled(fastmath=_FAST)
def _sum_three_wiped(
    i_samples: Floats,
    q_samples: Floats,
    begin: np.uint64,
    length: int,
    cosines: Floats,
    sines: Floats,
    i_base: Floats,
    q_base: Floats,
    keep: bool,
    chips: NDArray[np.int8],
    row_0: np.uint64,
    row_1: np.uint64,
    row_2: np.uint64,
) -> tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]:
    """Sum three replicas times the samples without carrier, which stay in `i_base` and `q_base` if `keep`."""
    i_0 = i_1 = i_2 = q_0 = q_1 = q_2 = np.float32(0.0)
    for k in range(uint64(length)):
        i_sample, q_sample = i_samples[begin + k], q_samples[begin + k]
        i_wiped = i_sample * cosines[k] - q_sample * sines[k]
        q_wiped = i_sample * sines[k] + q_sample * cosines[k]
        if keep:
            i_base[k] = i_wiped
            q_base[k] = q_wiped
        chip_0, chip_1 = np.float32(chips[row_0 + k]), np.float32(chips[row_1 + k])
        chip_2 = np.float32(chips[row_2 + k])
        i_0 += i_wiped * chip_0
        q_0 += q_wiped * chip_0
        i_1 += i_wiped * chip_1
        q_1 += q_wiped * chip_1
        i_2 += i_wiped * chip_2
        q_2 += q_wiped * chip_2
    return i_0, q_0, i_1, q_1, i_2, q_2


@compiled(fastmath=_FAST)
def _sum_two(
    i_base: Floats,
    q_base: Floats,
    length: int,
    chips: NDArray[np.int8],
    row_0: np.uint64,
    row_1: np.uint64,
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    i_0 = i_1 = q_0 = q_1 = np.float32(0.0)
    for k in range(uint64(length)):
        chip_0, chip_1 = np.float32(chips[row_0 + k]), np.float32(chips[row_1 + k])
        i_0 += i_base[k] * chip_0
        q_0 += q_base[k] * chip_0
        i_1 += i_base[k] * chip_1
        q_1 += q_base[k] * chip_1
    return i_0, q_0, i_1, q_1


@compiled(fastmath=_FAST)
def _sum_four(
    i_base: Floats,
    q_base: Floats,
    length: int,
    chips: NDArray[np.int8],
    row_0: np.uint64,
    row_1: np.uint64,
    row_2: np.uint64,
    row_3: np.uint64,
) -> tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]:
    i_0 = i_1 = i_2 = i_3 = q_0 = q_1 = q_2 = q_3 = np.float32(0.0)
    for k in range(uint64(length)):
        chip_0, chip_1 = np.float32(chips[row_0 + k]), np.float32(chips[row_1 + k])
        chip_2, chip_3 = np.float32(chips[row_2 + k]), np.float32(chips[row_3 + k])
        i_0 += i_base[k] * chip_0
        q_0 += q_base[k] * chip_0
        i_1 += i_base[k] * chip_1
        q_1 += q_base[k] * chip_1
        i_2 += i_base[k] * chip_2
        q_2 += q_base[k] * chip_2
        i_3 += i_base[k] * chip_3
        q_3 += q_base[k] * chip_3
    return i_0, q_0, i_1, q_1, i_2, q_2, i_3, q_3


@compiled
def _add_chunks(
    chunk_sums: Reals,
    n_chunks: int,
    chunk_length: int,
    n_samples: int,
    dopplers_cycles_per_sample: Reals,
    sums: Reals,
) -> None:
    """Sum over the chunks for each Doppler, whose phase across a chunk is taken as that at its middle."""
    sums[:] = 0.0
    for doppler in range(dopplers_cycles_per_sample.shape[0]):
        offset = dopplers_cycles_per_sample[doppler]
        for chunk in range(n_chunks):
            begin = chunk * chunk_length
            end = min(begin + chunk_length, n_samples)
            cosine, sine = 1.0, 0.0
            if offset != 0.0:
                cosine, sine = _rotation(offset * 0.5 * (begin + end - 1))
            for delay in range(chunk_sums.shape[1]):
                i_sum, q_sum = chunk_sums[chunk, delay, 0], chunk_sums[chunk, delay, 1]
                sums[doppler, delay, 0] += i_sum * cosine - q_sum * sine
                sums[doppler, delay, 1] += i_sum * sine + q_sum * cosine


@compiled
def _put(
    chunk_sums: Reals, chunk: int, delay: int, cosine: float, sine: float, i_sum: np.float32, q_sum: np.float32
) -> None:
    """Keep one sum, turned by what the carrier had turned until its chunk began."""
    chunk_sums[chunk, delay, 0] = i_sum * cosine - q_sum * sine
    chunk_sums[chunk, delay, 1] = i_sum * sine + q_sum * cosine


@compiled
def correlate_period(
    i_samples: Floats,
    q_samples: Floats,
    begin: int,
    n_samples: int,
    chip: float,
    chips_per_sample: float,
    phase_cyc: float,
    cycles_per_sample: float,
    table: NDArray[np.int8],
    pad: int,
    nominal_chips_per_sample: float,
    delays_chips: Reals,
    dopplers_cycles_per_sample: Reals,
    scratch: Scratch,
    sums: Reals,
    shifts_chips: Reals,
) -> None:
    """Correlate samples [begin, begin + n_samples) with a replica at each delay and Doppler.

    Sample k of the stretch is multiplied by code(chip + k chips_per_sample + delay) and by
    exp(-j 2 pi (phase_cyc + k (cycles_per_sample + doppler))), and summed.

    i_samples, q_samples : (n,) contiguous.
    chip, chips_per_sample : code phase of the prompt replica at the first sample, in chips after the code's start, and
        its advance.
    table, pad, nominal_chips_per_sample : of `code_table`, `table_pad`; (n_phases, columns).
    delays_chips : (n_delays,) at least one, ahead of the prompt positive, anywhere within the table's reach.
    dopplers_cycles_per_sample : (n_dopplers,) offsets from the carrier, made of the chunks' sums. A signal there keeps
        sinc(f T) of its amplitude, T one chunk. One zero gives the plain sums.
    scratch : of `allocate_scratch`.
    sums : (n_dopplers, n_delays, 2) real and imaginary part, filled.
    shifts_chips : (n_delays,) wanted minus used code phase of the replica, mean over the samples, filled.

    A stretch that leaves the samples, the table or the scratch has no sums: NaN.
    """
    n_delays = delays_chips.shape[0]
    n_phases, columns = table.shape
    planes, rows, chunk_sums, made = scratch
    shifts_chips[:] = 0.0
    if n_samples < 1:
        sums[:] = 0.0
        return
    length = _chunk_length(n_samples)
    n_chunks = (n_samples + length - 1) // length
    samples_per_chip = 1.0 / nominal_chips_per_sample
    inside = begin >= 0 and begin + n_samples <= i_samples.shape[0] and n_chunks <= rows.shape[0]
    # A code rate so far off would drift out of the table within a chunk. All is written so that NaN is outside.
    inside = inside and abs(chips_per_sample * samples_per_chip - 1.0) <= 1e-3
    for delay in range(n_delays):
        first = (chip + delays_chips[delay]) * samples_per_chip
        last = first + n_samples * chips_per_sample * samples_per_chip
        inside = inside and first >= 1 - pad and last <= columns - pad - 1
    if not inside:
        sums[:] = math.nan
        shifts_chips[:] = math.nan
        return
    for chunk in range(n_chunks):
        size = min(length, n_samples - chunk * length)
        # Rounded at the middle of the chunk, so that what the code drifts against the table cancels.
        middle = chip + (chunk * length + 0.5 * (size - 1)) * chips_per_sample
        _locate(
            middle * samples_per_chip - 0.5 * (size - 1),
            samples_per_chip,
            delays_chips,
            float(n_phases),
            float(columns),
            float(pad),
            nominal_chips_per_sample * size / n_samples,
            rows,
            chunk,
            shifts_chips,
        )
    cosines, sines, i_base, q_base = planes[0], planes[1], planes[2], planes[3]
    if made[0] != cycles_per_sample or made[1] < length:  # loops that sum over several periods keep their frequency
        _fill_rotations(cycles_per_sample, length, cosines, sines)
        made[0], made[1] = cycles_per_sample, length
    cosine_chunk, sine_chunk = _rotation(cycles_per_sample * length)
    cosine, sine = _rotation(phase_cyc)
    chips = table.reshape(-1)
    end = n_delays - 1  # a group that is not full repeats the last delay
    second, third = min(1, end), min(2, end)
    for chunk in range(n_chunks):
        size = min(length, n_samples - chunk * length)
        i_0, q_0, i_1, q_1, i_2, q_2 = _sum_three_wiped(
            i_samples,
            q_samples,
            uint64(begin + chunk * length),
            size,
            cosines,
            sines,
            i_base,
            q_base,
            n_delays > 3,
            chips,
            rows[chunk, 0],
            rows[chunk, second],
            rows[chunk, third],
        )
        _put(chunk_sums, chunk, 0, cosine, sine, i_0, q_0)
        _put(chunk_sums, chunk, second, cosine, sine, i_1, q_1)
        _put(chunk_sums, chunk, third, cosine, sine, i_2, q_2)
        delay = 3
        while delay < n_delays:
            b, c, d = min(delay + 1, end), min(delay + 2, end), min(delay + 3, end)
            if n_delays - delay <= 2:
                i_0, q_0, i_1, q_1 = _sum_two(i_base, q_base, size, chips, rows[chunk, delay], rows[chunk, b])
            else:
                i_0, q_0, i_1, q_1, i_2, q_2, i_3, q_3 = _sum_four(
                    i_base, q_base, size, chips, rows[chunk, delay], rows[chunk, b], rows[chunk, c], rows[chunk, d]
                )
                _put(chunk_sums, chunk, c, cosine, sine, i_2, q_2)
                _put(chunk_sums, chunk, d, cosine, sine, i_3, q_3)
            _put(chunk_sums, chunk, delay, cosine, sine, i_0, q_0)
            _put(chunk_sums, chunk, b, cosine, sine, i_1, q_1)
            delay += 4
        cosine, sine = cosine * cosine_chunk - sine * sine_chunk, cosine * sine_chunk + sine * cosine_chunk
    _add_chunks(chunk_sums, n_chunks, length, n_samples, dopplers_cycles_per_sample, sums)
