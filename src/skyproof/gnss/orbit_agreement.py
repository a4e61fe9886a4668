"""Orbits of one satellite held against each other: which of them contradicts the others.

Two data sets of a healthy satellite that follow each other both hold in the middle between their times, where they put
it in one place: within some metres, 20 m at most in the files of five systems that this was tried on. What differs by
far more was edited, damaged or converted wrongly, and of data sets for one time that differ one is not what was sent.
"""

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Instants, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import MAX_AGE_S, BroadcastEphemeris
from skyproof.gnss.orbits import satellite_state
from skyproof.gnss.time import iso, seconds_between

__all__ = ["contradicted"]

_MOST_APART_M: Final = 106.0
"""4.42 times an accuracy of 24 m, index 7: of a healthy satellite a range that errs by more is said to be (GPS Standard
Positioning Service Performance Standard, 5th edition, 2020, 3.5.1; IS-GPS-200N, 6.2.1)."""


def contradicted(ephemerides: Sequence[BroadcastEphemeris]) -> dict[int, str]:
    """Find the data sets that contradict others of their satellite and message, by their places, and say which.

    Of several that contradict each other those are named that most others of the satellite contradict; of two alone
    both, for nothing says which of them is right. Data sets are compared that both serve between their times.
    """
    by_sat: dict[tuple[str, str], list[int]] = {}
    for place, one in enumerate(ephemerides):
        if one.healthy:
            by_sat.setdefault((one.sat, getattr(one, "message", "")), []).append(place)
    found: dict[int, str] = {}
    pairs = [pair for places in by_sat.values() for pair in _neighbours(ephemerides, places)]
    apart_m = _apart_m(ephemerides, pairs)
    suspects = {ephemerides[a].sat for (a, _), m in zip(pairs, apart_m, strict=True) if not m <= _MOST_APART_M}
    for (sat, _), places in by_sat.items():
        if sat in suspects:
            found |= _outvoted(ephemerides, places)
    return found


def _neighbours(ephemerides: Sequence[BroadcastEphemeris], places: Sequence[int]) -> list[tuple[int, int]]:
    """Those that follow each other so soon that both serve in between."""
    ordered = sorted(places, key=lambda place: ephemerides[place].reference_gpst)
    return [pair for pair in pairwise(ordered) if _serve_together(ephemerides, *pair)]


def _serve_together(ephemerides: Sequence[BroadcastEphemeris], a: int, b: int) -> bool:
    one, other = ephemerides[a], ephemerides[b]
    between_s = abs(float(seconds_between(other.reference_gpst, one.reference_gpst)))
    return one != other and between_s <= 2.0 * MAX_AGE_S[one.sat[0]]


def _apart_m(ephemerides: Sequence[BroadcastEphemeris], pairs: Sequence[tuple[int, int]]) -> Reals:
    """(n,) by how much place or clock of two data sets differ in the middle between their times, the larger one."""
    if not pairs:
        return np.zeros(0)
    first, second = ([ephemerides[pair[side]] for pair in pairs] for side in (0, 1))
    begin, end = (np.array([one.reference_gpst for one in some]) for some in (first, second))
    middle = begin + (end - begin) // 2
    place_m, clock_s = _states(first, middle)
    other_m, other_s = _states(second, middle)
    range_m: Reals = np.maximum(
        np.linalg.norm(place_m - other_m, axis=1), SPEED_OF_LIGHT_M_S * np.abs(clock_s - other_s)
    )
    return range_m


def _states(ephemerides: Sequence[BroadcastEphemeris], gpst: Instants) -> tuple[Reals, Reals]:
    """Position (n, 3) and clock (n,), metres and seconds, of each at an instant (n,) of its own."""
    states = [satellite_state(one, when) for one, when in zip(ephemerides, gpst, strict=True)]
    return np.array([s.position_ecef_m for s in states]), np.array([float(s.clock_s) for s in states])


def _outvoted(ephemerides: Sequence[BroadcastEphemeris], places: Sequence[int]) -> dict[int, str]:
    """The data sets of one satellite that most of the others contradict, and of these those that fewest agree with."""
    pairs = [
        (a, b) for a, b in combinations(range(len(places)), 2) if _serve_together(ephemerides, places[a], places[b])
    ]
    against, agreeing = np.zeros((2, len(places), len(places)), np.bool_)
    for (a, b), m in zip(pairs, _apart_m(ephemerides, [(places[a], places[b]) for a, b in pairs]), strict=True):
        which = agreeing if m <= _MOST_APART_M else against
        which[a, b] = which[b, a] = True
    left: Booleans = np.ones(len(places), np.bool_)
    found: dict[int, str] = {}
    while (count := against[:, left].sum(axis=1) * left).any():
        most = np.flatnonzero(count == count.max())
        support = agreeing[most][:, left].sum(axis=1)
        worst = [int(k) for k in most[support == support.min()]]
        for k in worst:
            others = [ephemerides[places[int(j)]] for j in np.flatnonzero(against[k] & left)]
            found[places[k]] = _words(ephemerides[places[k]], others)
        left[worst] = False
    return found


def _words(one: BroadcastEphemeris, others: Sequence[BroadcastEphemeris]) -> str:
    same = any(other.reference_gpst == one.reference_gpst for other in others)
    what = "another one of the same time" if same else f"that of {iso(others[0].reference_gpst, 0)}"
    return f"its orbit or clock of {iso(one.reference_gpst, 0)} contradicts {what}"
