"""Build the replica that samples are correlated with: the code as a front end passes it, at fractions of a sample."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Reals
from skyproof.compiled import compiled
from skyproof.receiver.correlator import REACH_CHIPS, table_pad

__all__ = ["CODE_SCALE", "code_table", "low_pass_gain"]

CODE_SCALE = 92
"""What a chip is in the code tables: a filtered code overshoots by up to a third."""
POINTS = 16
"""Points a sample, with straight lines between them, from which the table is read."""


def low_pass_gain(cycles_per_sample: Reals) -> Reals:
    """Return the amplitude of the replica's low-pass at a frequency: 1 to 0.3, 0 from 0.5 on, a cosine between."""
    falling = np.clip((np.abs(cycles_per_sample) - 0.3) / 0.2, 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * falling))


def code_table(
    code: NDArray[np.int8],
    chips_per_sample: float,
    n_phases: int,
    n_samples: int,
    reach_chips: float = REACH_CHIPS,
    low_pass: Callable[[Reals], Reals] = low_pass_gain,
) -> NDArray[np.int8]:
    """Build a table of the code resampled at `n_phases` fractions of a sample behind a low-pass, times `CODE_SCALE`.

    code : (n_chips,) of +1 and -1, repeated without end.
    chips_per_sample : at the nominal code rate.
    n_samples : of the longest period to correlate.
    reach_chips : how far from the prompt a delay may lie.
    low_pass : amplitude that remains at frequencies, cycles a sample; nothing from half a cycle on.

    Returns (n_phases, n_samples + 2 pad), pad being `table_pad(chips_per_sample, reach_chips)`. Row p, column k is the
    filtered code at the time (k - pad + p / n_phases) samples after the start of the code.

    Samples are band-limited to half their rate and the edges of chips are not: read at the samples' instants alone, a
    replica's spectrum folds back and shifts the code by metres, differently for every delay. The low-pass removes
    all that would fold; the rest is the matched filter of a front end that passes 0.8 of the rate.
    """
    pad = table_pad(chips_per_sample, reach_chips)
    points = 2 ** math.ceil(math.log2(max(POINTS / chips_per_sample, POINTS)))  # a chip
    line = np.arange(min(code.size * points // 2, math.ceil(0.5 * code.size / chips_per_sample)) + 1)
    cycles_per_chip = line / code.size
    chip = (
        np.sinc(cycles_per_chip) * np.exp(-1j * np.pi * cycles_per_chip) * low_pass(cycles_per_chip * chips_per_sample)
    )
    period = np.fft.irfft(np.fft.fft(code)[line % code.size] * chip, code.size * points) * points
    table = np.empty((n_phases, n_samples + 2 * pad), np.int8)
    _fill_table(period, chips_per_sample * points, pad, table)
    return table


@compiled
def _fill_table(period: Reals, points_per_sample: float, pad: int, table: NDArray[np.int8]) -> None:
    """Read a table from straight lines between evenly spaced points of one period."""
    n_phases, columns = table.shape
    for phase in range(n_phases):
        for column in range(columns):
            at = (column - pad + phase / n_phases) * points_per_sample
            whole = math.floor(at)
            point = int(whole) % period.size
            after = point + 1 if point + 1 < period.size else 0
            smooth = period[point] + (at - whole) * (period[after] - period[point])
            table[phase, column] = np.int8(min(max(np.rint(CODE_SCALE * smooth), -127.0), 127.0))
