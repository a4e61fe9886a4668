"""Test if data bits begin where expected, or if they all begin so many code periods earlier.

Samples that are missing move the bits of all signals by the same number of code periods. Fades, slips and a second
signal move none. For each bit the energy of its sum is compared with that of two sums which overlap it. They begin so
many periods earlier, modulo a bit. The difference is a share of both, so that strong and weak bits count alike. The two
are weighted to cover the same time as the bit, so that a changing strength makes no difference. If bits begin as
expected, the mean is negative where the bit turns over and zero where it does not. Strength, phase and common
disturbances of all three sums do not matter. So the mean over all bits of all signals, over its standard error, exceeds
a normal quantile with at most the stated probability.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy import special

from skyproof.arrays import Booleans, Complexes, Integers, Reals
from skyproof.receiver import kernels as k
from skyproof.receiver.crosstalk import Rows

__all__ = ["EdgeSums", "add_bits", "collect_prompts", "edge_scores", "shift_limit"]

_PROMPT: Final = slice(k.OUT_TAPS + 2, k.OUT_TAPS + 4)
_FEWEST_BITS = 15
"""The mean of fewer differences is not normal enough."""


@dataclass(frozen=True, eq=False, kw_only=True)
class EdgeSums:
    """Differences of energy so far: sums over `n_bits` bits, for bits that begin 1, 2, ... periods earlier.

    periods_per_bit : code periods in a bit. There are as many sums, less one; (1,) of zero before the first look.
    since_s : receiver time of the look that asked for it; is_fresh : when nothing had asked for a while. looks : taken
    since.
    """

    periods_per_bit: int
    since_s: float
    is_fresh: bool = False
    looks: int = 0
    n_bits: int = 0
    total: Reals = field(default_factory=lambda: np.zeros(1))
    squares: Reals = field(default_factory=lambda: np.zeros(1))


def collect_prompts(blocks: Sequence[Rows], chosen: Booleans) -> tuple[Complexes, Integers]:
    """Collect prompts (n_signals, n_periods) of the chosen channels in successive blocks of the kernel's rows.

    All have as many periods as the shortest. Also returned is the code period (n_signals,) of each one's first.
    """
    channels = np.flatnonzero(chosen)
    counts = np.array([count[channels] for _, count in blocks])
    n_periods = int(counts.sum(axis=0).min()) if channels.size else 0
    prompts = np.empty((channels.size, n_periods), np.complex128)
    firsts = np.zeros(channels.size, np.int64)
    for number, channel in enumerate(channels if n_periods else ()):
        parts = [rows[channel, : count[channel]] for rows, count in blocks]
        columns = np.concatenate([part[:, _PROMPT] for part in parts])
        prompts[number] = columns[:n_periods].view(np.complex128)[:, 0]
        firsts[number] = round(next(part[0, k.OUT_PERIOD] for part in parts if part.size))
    return prompts, firsts


def add_bits(sums: EdgeSums, prompts: Complexes, first_periods: Integers, bit_starts: Reals) -> EdgeSums:
    """Add one more look to the sums.

    prompts : (n_signals, n_periods) of successive code periods, of each signal from `first_periods` (n_signals,) on.
    bit_starts : (n_signals,) period, modulo those of a bit, with which its bits are expected to begin.
    """
    offsets = np.mod(bit_starts - first_periods, sums.periods_per_bit).astype(np.int64)
    difference = _differences(prompts, offsets, sums.periods_per_bit)
    return replace(
        sums,
        looks=sums.looks + 1,
        n_bits=sums.n_bits + difference.shape[0],
        total=sums.total + difference.sum(axis=0),
        squares=sums.squares + (difference**2).sum(axis=0),
    )


def _differences(prompts: Complexes, offsets: Integers, periods: int) -> Reals:
    """Compute (n_bits, periods - 1): energy of each bit's sum moved, less that of the sum, over the sum of both."""
    shifts, longest = np.arange(1, periods), periods - 1
    away = np.concatenate([[0], -shifts, periods - shifts])  # of a bit's sum, and of those before it and behind it
    offsets = np.where(offsets < longest, offsets + periods, offsets)  # what begins earliest must be there
    stop = prompts.shape[1] - periods - longest + 1  # and what ends last
    first = np.arange(0, max(stop - int(offsets.max(initial=0)), 0), periods)
    begins = offsets[:, np.newaxis, np.newaxis] + first[:, np.newaxis] + away
    summed = np.concatenate([np.zeros((prompts.shape[0], 1)), np.cumsum(prompts, axis=1)], axis=1)
    of_signal = np.arange(prompts.shape[0])[:, np.newaxis, np.newaxis]
    energy = np.abs(summed[of_signal, begins + periods] - summed[of_signal, begins]) ** 2
    still, moved = energy[..., :1], energy[..., 1:]
    total = moved + still
    share = np.divide(moved - still, total, out=np.zeros_like(total), where=total > 0.0)
    earlier, later = np.split(share.reshape(-1, 2 * shifts.size), 2, axis=-1)
    # Each share for itself has the mean zero on noise, as it is the same with both sums exchanged but for its sign.
    later_share = shifts / periods
    return np.asarray((1.0 - later_share) * earlier + later_share * later)


def edge_scores(sums: EdgeSums) -> Reals:
    """Compute the mean difference over its standard error for each shift (periods_per_bit - 1,).

    It is zero with too few bits.

    It is standard normal or lower if bits begin as expected.
    """
    if sums.n_bits < _FEWEST_BITS:
        return np.zeros(sums.periods_per_bit - 1)
    mean = sums.total / sums.n_bits
    variance = np.maximum(sums.squares / sums.n_bits - mean**2, np.finfo(float).tiny)
    return np.asarray(mean / np.sqrt(variance / sums.n_bits))


def shift_limit(probability: float, periods_per_bit: int) -> float:
    """Return the value that the largest score exceeds with at most this probability if no bit moved."""
    return -float(special.ndtri(probability / (periods_per_bit - 1)))
