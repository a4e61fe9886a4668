"""Compare orbits of one satellite with each other, and find the one that contradicts the others.

Two successive data sets of a healthy satellite both hold in the middle between their times. There they give one place
within some metres, 20 m at most in the files of five systems that this was tried on. Data that differ by far more were
edited, damaged or converted wrongly. Of data sets for one time that differ, one is not what was sent.
"""

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import MAX_AGE_S, BroadcastEphemeris
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.time import format_iso, seconds_between

__all__ = ["find_contradicted"]

_MOST_APART_M: Final = 106.0
"""4.42 times an accuracy of 24 m, index 7: of a healthy satellite a range that errs by more is said to be (GPS Standard
Positioning Service Performance Standard, 5th edition, 2020, 3.5.1; IS-GPS-200N, 6.2.1)."""


def find_contradicted(ephemerides: Sequence[BroadcastEphemeris]) -> dict[int, str]:
    """Find the data sets that contradict others of their satellite and message, by their places, and say which.

    Of several that contradict each other those are named that most others of the satellite contradict; of two alone
    both, for nothing says which of them is right. Data sets are compared that both serve between their times.
    """
    by_sat: dict[tuple[str, str], list[int]] = {}
    for place, ephemeris in enumerate(ephemerides):
        if ephemeris.healthy:
            by_sat.setdefault((ephemeris.sat, getattr(ephemeris, "message", "")), []).append(place)
    found: dict[int, str] = {}
    pairs = [pair for places in by_sat.values() for pair in _pair_neighbours(ephemerides, places)]
    apart_m = _compute_apart_m(ephemerides, pairs)
    suspects = {ephemerides[a].sat for (a, _), m in zip(pairs, apart_m, strict=True) if not m <= _MOST_APART_M}
    for (sat, _), places in by_sat.items():
        if sat in suspects:
            found |= _find_outvoted(ephemerides, places)
    return found


def _pair_neighbours(ephemerides: Sequence[BroadcastEphemeris], places: Sequence[int]) -> list[tuple[int, int]]:
    """Pair data sets that follow each other so soon that both serve in between."""
    ordered = sorted(places, key=lambda place: ephemerides[place].reference_gpst)
    return [pair for pair in pairwise(ordered) if _do_serve_together(ephemerides, *pair)]


def _do_serve_together(ephemerides: Sequence[BroadcastEphemeris], a: int, b: int) -> bool:
    first, second = ephemerides[a], ephemerides[b]
    between_s = abs(float(seconds_between(second.reference_gpst, first.reference_gpst)))
    return first != second and between_s <= 2.0 * MAX_AGE_S[first.sat[0]]


def _compute_apart_m(ephemerides: Sequence[BroadcastEphemeris], pairs: Sequence[tuple[int, int]]) -> Reals:
    """Compute (n,) by how much place or clock of two data sets differ midway between their times."""
    if not pairs:
        return np.zeros(0)
    first, second = ([ephemerides[pair[side]] for pair in pairs] for side in (0, 1))
    begin, end = (np.array([ephemeris.reference_gpst for ephemeris in some]) for some in (first, second))
    middle = begin + (end - begin) // 2
    place_m, clock_s = _compute_states(first, middle)
    other_m, other_s = _compute_states(second, middle)
    range_m: Reals = np.maximum(
        np.linalg.norm(place_m - other_m, axis=1), SPEED_OF_LIGHT_M_S * np.abs(clock_s - other_s)
    )
    return range_m


def _compute_states(ephemerides: Sequence[BroadcastEphemeris], gpst: Instants) -> tuple[Reals, Reals]:
    """Compute position (n, 3) and clock (n,), metres and seconds, each at its instant (n,)."""
    states = [compute_satellite_state(ephemeris, when) for ephemeris, when in zip(ephemerides, gpst, strict=True)]
    return np.array([s.position_ecef_m for s in states]), np.array([float(s.clock_s) for s in states])


def _find_outvoted(ephemerides: Sequence[BroadcastEphemeris], places: Sequence[int]) -> dict[int, str]:
    """Find the data sets of one satellite that most others contradict, and of these those with least support."""
    pairs = [
        (a, b) for a, b in combinations(range(len(places)), 2) if _do_serve_together(ephemerides, places[a], places[b])
    ]
    against, agreeing = np.zeros((2, len(places), len(places)), np.bool_)
    for (a, b), m in zip(pairs, _compute_apart_m(ephemerides, [(places[a], places[b]) for a, b in pairs]), strict=True):
        which = agreeing if m <= _MOST_APART_M else against
        which[a, b] = which[b, a] = True
    remaining: Booleans = np.ones(len(places), np.bool_)
    found: dict[int, str] = {}
    while (count := against[:, remaining].sum(axis=1) * remaining).any():
        most = np.flatnonzero(count == count.max())
        support = agreeing[most][:, remaining].sum(axis=1)
        worst = [int(k) for k in most[support == support.min()]]
        for k in worst:
            opponents = [ephemerides[places[int(j)]] for j in np.flatnonzero(against[k] & remaining)]
            found[places[k]] = _describe(ephemerides[places[k]], opponents)
        remaining[worst] = False
    return found


def _describe(one: BroadcastEphemeris, others: Sequence[BroadcastEphemeris]) -> str:
    same = any(other.reference_gpst == one.reference_gpst for other in others)
    counterpart = "another one of the same time" if same else f"that of {format_iso(others[0].reference_gpst, 0)}"
    return f"its orbit or clock of {format_iso(one.reference_gpst, 0)} contradicts {counterpart}"
