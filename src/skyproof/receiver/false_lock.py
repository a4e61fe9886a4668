"""Test if a carrier turns within data bits: a phase loop that sums over a bit may hold it half cycles a bit off.

Such a loop cannot tell half a cycle a bit (25 Hz for GPS L1 C/A) from bits that turn over. It holds on, 4 dB down at
one half cycle a bit and 13.5 dB down at three. Its range rate is 4.8 m/s off for each half cycle. The parts of a bit
show it: the product of each with the one before, conjugated, points along the real axis on a true lock. It turns
by 36 degrees for each half cycle a bit. Student's t of the bits' products tests if it points further
than half way to the first false lock, whatever the signal's strength and the noise.
"""

from collections.abc import Sequence

import numpy as np
from scipy import special

from skyproof.arrays import Booleans, Complexes, Integers, Reals
from skyproof.gnss.signals import SignalPlan
from skyproof.receiver import kernels as k
from skyproof.receiver.bit_edges import collect_prompts
from skyproof.receiver.crosstalk import Rows

__all__ = ["N_TURNS", "WINDOW_BITS", "false_lock_hz", "is_turning", "leave_false_locks", "sum_turns"]

# Columns of what is summed of a channel's bits (float64): their number, products, and squares of these.
N_BITS, SUM_I, SUM_Q, SQUARES_II, SQUARES_QQ, SQUARES_IQ = range(6)
N_TURNS = 6

PARTS = 5
"""Of a bit: shorter ones are lost in noise; longer ones turn half round at the 100 Hz that loops of 5 ms may hold."""
WINDOW_BITS = 50
"""Summed before it is decided where the carrier is."""
FALSE_TURNING = 1e-2
"""Probability, at most, that a row of measurements of a carrier half way to a false lock is withheld. On a true lock
hardly any is, beside strong signals either, whose sidelobes are no white noise."""
FALSE_MOVE = 1e-6
"""Probability, at most, that a true lock is left, a window."""
_FEWEST_BITS = 5
_TURN_CYC = 0.5 / PARTS
"""Of a part against the one before, for each half cycle a bit."""


def leave_false_locks(
    loops: Reals, turns: Reals, blocks: Sequence[Rows], good: Booleans, signal: SignalPlan
) -> tuple[Booleans, Reals, Reals]:
    """Move loops off false locks, by one row of measurements of the `good` channels, made of two frames' blocks.

    Returns which channels turn in it, the loops, and the sums of the windows so far. Loops move to their carriers where
    a window shows a false lock.
    """
    known = good & (loops[:, k.BIT_START] >= 0.0)
    loops, turns, turning = loops.copy(), np.where(known[:, np.newaxis], turns, 0.0), np.zeros(good.size, np.bool_)
    prompts, firsts = collect_prompts(blocks, known)
    if not prompts.size:
        return turning, loops, turns
    row = sum_turns(prompts, firsts, loops[known, k.BIT_START], signal.periods_per_symbol)
    turning[known] = is_turning(row, FALSE_TURNING)
    turns[known] += row
    whole = np.flatnonzero(turns[:, N_BITS] >= WINDOW_BITS)
    more_hz = false_lock_hz(turns[whole], signal.periods_per_symbol * signal.period_s)
    turns[whole] = 0.0
    off, more_hz = whole[more_hz != 0.0], more_hz[more_hz != 0.0]
    loops[off, k.PLL_VELOCITY] += more_hz
    loops[off, k.FREQUENCY] += more_hz
    loops[off, k.CODE_RATE] += more_hz * signal.chip_rate_hz / signal.carrier_hz
    loops[off, k.SLIPPED] = 1.0
    loops[np.ix_(off, [k.RESIDUAL, k.CODE_MINUS_CARRIER])] = np.nan
    turning[off] = True
    return turning, loops, turns


def sum_turns(prompts: Complexes, first_periods: Integers, bit_starts: Reals, periods_per_bit: int) -> Reals:
    """Sum turns (n_signals, N_TURNS) over the whole bits in the prompts.

    prompts : (n_signals, n_periods) of successive code periods, of each signal from `first_periods` (n_signals,) on.
    bit_starts : (n_signals,) period, modulo those of a bit, with which its bits begin.
    """
    offsets = np.mod(bit_starts - first_periods, periods_per_bit).astype(np.int64)
    n_bits = max((prompts.shape[1] - int(offsets.max(initial=0))) // periods_per_bit, 0)
    at = offsets[:, np.newaxis] + np.arange(n_bits * periods_per_bit)
    parts = np.take_along_axis(prompts, at, axis=1).reshape(prompts.shape[0], n_bits, PARTS, -1).sum(axis=-1)
    product = np.sum(parts[..., 1:] * np.conj(parts[..., :-1]), axis=-1)
    i, q = product.real, product.imag
    ones = np.ones_like(i)
    return np.stack([part.sum(axis=1) for part in (ones, i, q, i * i, q * q, i * q)], axis=-1)


def is_turning(turns: Reals, probability: float) -> Booleans:
    """Test if each carrier turns further than half way to the first false lock; (n_signals,), False with few bits.

    turns : (n_signals, N_TURNS). probability : of a false answer for a carrier that turns half way to one side or
    the other, at most; it is lower for one that turns less.
    """
    n = turns[:, N_BITS]
    enough = n >= _FEWEST_BITS
    n = np.where(enough, n, _FEWEST_BITS)
    half_way = 2.0 * np.pi * 0.5 * _TURN_CYC
    limit = -special.stdtrit(n - 1.0, 0.5 * probability)
    says = np.zeros(n.size, np.bool_)
    for sign in (1.0, -1.0):  # beyond half way to the one side, and to the other
        c, s = np.cos(half_way), np.sin(half_way)
        mean = (sign * c * turns[:, SUM_Q] - s * turns[:, SUM_I]) / n
        square = c * c * turns[:, SQUARES_QQ] + s * s * turns[:, SQUARES_II] - 2.0 * sign * c * s * turns[:, SQUARES_IQ]
        variance = np.maximum(square / n - mean**2, np.finfo(float).tiny) / (n - 1.0)
        says |= mean > limit * np.sqrt(variance)
    return enough & says


def false_lock_hz(turns: Reals, bit_s: float) -> Reals:
    """Return by how much each signal's carrier is above the loop's, (n_signals,) Hz.

    It is 0, or multiples of half a cycle a bit.
    """
    turned_cyc = np.angle(turns[:, SUM_I] + 1j * turns[:, SUM_Q]) / (2.0 * np.pi)
    half_cycles = np.where(is_turning(turns, FALSE_MOVE), np.rint(turned_cyc / _TURN_CYC), 0.0)
    return np.asarray(0.5 * half_cycles / bit_s)
