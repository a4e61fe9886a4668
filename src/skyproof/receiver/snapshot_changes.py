"""Test if a signal stays constant throughout a snapshot. In tens of milliseconds a true one does.

A snapshot is summed up as a whole, and a transmitter that begins within it is hidden in the sum. Here the parts are
held against each other: what a signal is on the antennas (its direction) before a part and from it on, and whether it
is there at all. What its carrier, its data bits and the oscillator do is common to all antennas and plays no part.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy import special

from skyproof.arrays import Complexes

__all__ = ["CHANCE", "Change", "find_change"]

CHANCE: Final = 1e-9
"""That noise makes a change of one signal that does not change."""
_TURNED: Final = 0.05
"""Sine squared of the angle between what a signal is on the antennas before and after: less is noise of the sky (a
platform that turns, a reflection) or an attack so weak that it moves no receiver."""
_ABSENT: Final = 0.15  # of its power: less is what the side lobes of another signal, and a part begun within, leave


Kind = Literal["begins", "ends", "turns"]


@dataclass(frozen=True, kw_only=True)
class Change:
    """kind : the signal begins or ends, or comes from elsewhere from `part` on. p_value : that noise makes it."""

    kind: Kind
    part: int
    p_value: float


def find_change(sums: Complexes) -> Change | None:
    """Find the likeliest change of a signal between its parts, if noise makes it with less than `CHANCE`.

    sums : (n_parts, n_antennas) in units of their noise, as `SnapshotSignal` has them, of any number of snapshots in a
    row. An antenna that fails must not be among them.

    Before and after a part the sums are a direction on the antennas times any amplitude and phase. Twice the likelihood
    ratio of two directions to one is chi-square with 2 (n_antennas - 1) degrees. A signal of the mean power A falls
    below B, in n parts, with probability exp(-n (A - B)^2 / (4 A + 2 n_antennas)) at most (Birge, "An alternative point
    of view on Lepski's method", 2001, lemma 8.1).
    """
    n_parts, n_antennas = sums.shape
    whole, _ = _strongest_direction(sums)
    power = np.sum(np.abs(sums) ** 2, axis=1) - n_antennas
    best: tuple[float, Change | None] = 0.0, None
    for part in range(1, n_parts):
        (before, direction_before), (after, direction_after) = (
            _strongest_direction(sums[:part]),
            _strongest_direction(sums[part:]),
        )
        early, late = (max(float(some.mean()), 0.0) for some in (power[:part], power[part:]))
        if min(early, late) < _ABSENT * max(early, late):
            kind: Kind = "begins" if early < late else "ends"
            n = part if early < late else n_parts - part
            gain = n * (early - late) ** 2 / (4.0 * max(early, late) + 2.0 * n_antennas)
            p_value = float(np.exp(-gain))
        elif 1.0 - np.abs(direction_before.conj() @ direction_after) ** 2 > _TURNED:
            kind, gain = "turns", before + after - whole
            p_value = float(special.gammaincc(n_antennas - 1, gain))  # chi-square of 2 gain
        else:
            continue
        if gain > best[0] and (n_parts - 1) * p_value < CHANCE:
            best = gain, Change(kind=kind, part=part, p_value=(n_parts - 1) * p_value)
    return best[1]


def _strongest_direction(sums: Complexes) -> tuple[float, Complexes]:
    """Return the greatest sum of powers (n_antennas,) that one direction explains, and that unit direction."""
    _, strength, rows = np.linalg.svd(sums, full_matrices=False)
    return float(strength[0] ** 2), np.asarray(rows[0])
