"""Resolve the carrier's half cycles by the message.

A Costas loop holds a signal's carrier or its opposite and cannot tell which: its data bits then come inverted. Known
bits can: the preamble, and the zeros in which words 2 and 10 of a subframe end. Parity does not detect an inversion,
since each of its equations takes in one of the last two bits of the word before. But it breaks in the word in which the
sign turns. So the sign given by known bits holds as far as the words around them hold without a break.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Integers
from skyproof.gnss.lnav import Bits
from skyproof.gnss.signals import MessageDecoder, SignalPlan

__all__ = ["BRIDGED_WORDS", "HalfCycles", "Stretch", "find_stretches", "join_stretches", "resolve_half_cycles"]

BRIDGED_WORDS: Final = 2
"""Damage that is no longer, between bits of one sign, is taken for noise and not for two turns."""


@dataclass(frozen=True)
class Stretch:
    """Code periods, from the first to before the end, in which the loop's bits are known to be inverted or not."""

    first_period: int
    end_period: int
    inverted: bool


def find_stretches(
    bits: Bits, start: int, first_period: int, signal: SignalPlan, decoder: MessageDecoder
) -> list[Stretch]:
    """Find where the sign of these bits (n,) is known.

    A frame starts at bit `start`, and bit 0 with `first_period`.
    """
    at, holds, signs = decoder.sign_words(bits, start)
    known = _spread_signs(holds, signs)
    edges = np.flatnonzero(np.diff(known, prepend=0, append=0))
    ends = np.append(at, at[-1] + decoder.word_bits if at.size else 0) * signal.periods_per_symbol + first_period
    return [Stretch(int(ends[a]), int(ends[b]), bool(known[a] < 0)) for a, b in pairwise(edges.tolist()) if known[a]]


def _spread_signs(holds: Booleans, signs: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return the sign (+1 upright, -1 inverted, 0 unknown) of each word.

    It is that of the next word that shows it, on both sides, with no broken word between.

    Words after the last one that shows it wait for the next, which may be still to come.
    """
    before, after = np.zeros_like(signs), np.zeros_like(signs)
    sign = np.int8(0)
    for word in range(signs.size):
        sign = (signs[word] or sign) if holds[word] else np.int8(0)
        before[word] = sign
    sign, waits = np.int8(0), True
    for word in reversed(range(signs.size)):
        waits &= bool(holds[word] and not signs[word])
        sign = (signs[word] or sign) if holds[word] else np.int8(0)
        after[word] = sign
        before[word] *= not waits
    return np.where(before * after >= 0, np.sign(before + after), 0).astype(np.int8)


def join_stretches(known: Sequence[Stretch], new: Sequence[Stretch], bridged_periods: int) -> tuple[Stretch, ...]:
    """Join all stretches in order; those of one sign within `bridged_periods` of each other become one."""
    found: list[Stretch] = []
    for stretch in sorted({*known, *new}, key=lambda s: (s.first_period, s.end_period)):
        last = found[-1] if found else None
        if last and last.inverted == stretch.inverted and stretch.first_period - last.end_period <= bridged_periods:
            found[-1] = replace(last, end_period=max(last.end_period, stretch.end_period))
        else:
            found.append(stretch)
    return tuple(found)


@dataclass(frozen=True, eq=False)
class HalfCycles:
    """Of each row (n,): half cycles to add to the carrier, whether that is unknown, and whether it slipped."""

    added: Integers
    open: Booleans
    slipped: Booleans


def resolve_half_cycles(
    periods: Integers,
    turned: Booleans,
    slipped: Booleans,
    stretches: Sequence[Stretch],
    reach_periods: int,
) -> HalfCycles:
    """Return what one arc's carrier lacks, row by row.

    Rows from one slip to the next share one answer, also those before the message could be read. The sign of the bits
    on the measured carrier may turn without a detected slip. Then the rows from the last one before to the first one
    after count as slipped, and those between them are open.

    Parameters
    ----------
    periods : (n,) code period at each row, which uses those up to `reach_periods` to either side.
    turned : (n,) whether the measured carrier is half a cycle off the loop's. slipped : (n,) of the measurements.
    """
    slip = slipped.copy()
    told = np.full(periods.size, -1)  # -1 nothing, else the half cycles to add
    for stretch in stretches:
        inside = (periods - reach_periods >= stretch.first_period) & (periods + reach_periods <= stretch.end_period)
        told = np.where(inside & ~slipped, stretch.inverted ^ turned, told)
    tells = np.flatnonzero(told >= 0)
    run = np.cumsum(slipped)
    for a, b in pairwise(tells.tolist()):
        if run[a] == run[b] and told[a] != told[b]:
            slip[a + 1 : b + 1] = True
    run = np.cumsum(slip)
    counts = np.zeros((periods.size + 1, 2), np.int64)
    np.add.at(counts, (run[tells], told[tells]), 1)
    return HalfCycles(np.argmax(counts, axis=1)[run], counts.sum(axis=1)[run] == 0, slip)
