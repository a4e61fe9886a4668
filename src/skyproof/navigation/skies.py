"""Sets of one kind of signal each, joined to skies: one position, and a clock for each kind.

A kind (`SignalId.kind`: time scale, band, code) takes its own way through the receiver, and its satellites' delays have
a mean of their own; with the offset between time scales that makes one unknown a kind. It is estimated and has no prior
but a bound, `OFFSET_MAX_S`: nothing is known of it to the precision of a range, and a prior that is wrong would make a
clean sky look false. The rest of a satellite's delay is in the range (TGD, BGD) or in its sigma.

So kinds are compared by the positions that they show alone. That compares what an attacker would have to keep alike,
and a kind with a clock of its own costs no more than one measurement. The ionosphere's error is common to a
satellite's bands, in the ratio of 1 / f^2; taking it as independent between kinds makes their positions look less
certain against each other than they are, never more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.search import (
    SetCandidates,
    WindowRanges,
    compute_misfits,
    find_point_below,
    is_plausible,
    solve,
)
from skyproof.records import Kind, SignalId
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = [
    "OFFSET_MAX_S",
    "ConsistentSky",
    "Part",
    "compute_apart_p_value",
    "extend_sky",
    "group_by_kind",
    "join_lone_sky",
    "join_skies",
    "select_few",
    "solve_sky",
]


OFFSET_MAX_S = 1e-6
"""By which the clocks of two kinds differ at most: time scales by 0.1 us, the ways through a receiver by less than the
inverse of its narrowest filter."""
ERROR_BOUND_M = 3.0
"""No range's error that stays has a larger sigma, as reflections make it in a street."""
JOIN_PROBABILITY = 1e-6
"""Of parting two kinds of one sky: rarer than what a day's windows make."""
_MOST_CHOICES = 4096


@dataclass(frozen=True, eq=False)
class Part:
    """The signals of one kind in a sky, with the position and clock that they show alone."""

    kind: Kind
    rows: Indices
    alone: SetCandidates


@dataclass(frozen=True, eq=False)
class ConsistentSky:
    """Parts of different kinds that show one position; `state_m` (4,) is that and the clock of the first part's kind.

    The position is by one signal per satellite, so that no error counts twice: of the first kind of each time scale, L1
    before L2; the scale with most signals is first. rows : of all parts. clock_m : kind to clock. statistic, dof : of
    the signals that the position is by.
    """

    rows: Indices
    state_m: Reals
    covariance_m2: Reals
    clock_m: dict[Kind, float]
    statistic: float
    dof: int


def group_by_kind(signals: Sequence[SignalId], rows: Indices) -> dict[Kind, Indices]:
    """Group rows by kind, in the order of the kinds."""
    of: dict[Kind, list[int]] = {}
    for k in rows:
        of.setdefault(signals[k].kind, []).append(int(k))
    return {kind: np.array(of[kind], dtype=np.intp) for kind in sorted(of)}


def compute_apart_p_value(
    off_m: Reals,
    covariance_m2: Reals,
    clock_m: float,
    clock_m2: float,
    *,
    statistic: float,
    dof: int,
    sigma_m: float,
) -> float:
    """Test whether two kinds of one sky show positions `off_m` (3,) and clocks `clock_m` apart by chance.

    The position's squared distance is chi-square with 3 degrees; the clock counts from `OFFSET_MAX_S` on. There are two
    tests, so the result is twice the smaller chance. Kinds apart are taken for an attack, so the variances are those of
    the largest possible errors. Ranges get `ERROR_BOUND_M` beside their sigma, `sigma_m` (rms of the two fits); more
    where `statistic` over `dof` of the two fits together is larger.
    """
    scale = max(statistic / max(dof, 1), 1.0 + (ERROR_BOUND_M / sigma_m) ** 2)
    squared = float(off_m @ np.linalg.solve(covariance_m2, off_m)) / scale
    beyond_m = max(abs(clock_m) - SPEED_OF_LIGHT_M_S * OFFSET_MAX_S, 0.0)
    chances = chi_square_survival(squared, 3), chi_square_survival(beyond_m**2 / clock_m2 / scale, 1)
    return min(1.0, 2.0 * float(min(chances)))


def join_skies(measurements: WindowRanges, parts: Sequence[Part]) -> list[list[Part]]:
    """Join parts to skies, the largest first.

    Each goes to the sky whose parts it fits best, if it fits them all.

    A sky has one part of a kind. Parts of one kind are different skies, by time if not by position.
    """
    skies: list[list[Part]] = []
    for part in sorted(parts, key=lambda p: (-p.rows.size, p.alone.statistic[0])):
        fits = [
            (min(_test_parts(measurements, part, other) for other in sky), -number)
            for number, sky in enumerate(skies)
            if all(other.kind != part.kind for other in sky)
        ]
        chance, number = max(fits, default=(0.0, 0))
        if chance >= JOIN_PROBABILITY:
            skies[-number].append(part)
        else:
            skies.append([part])
    return skies


def _test_parts(measurements: WindowRanges, one: Part, other: Part) -> float:
    difference_m = one.alone.state_m[0] - other.alone.state_m[0]
    covariance_m2 = one.alone.covariance_m2[0] + other.alone.covariance_m2[0]
    return compute_apart_p_value(
        difference_m[:3],
        covariance_m2[:3, :3],
        float(difference_m[3]),
        float(covariance_m2[3, 3]),
        statistic=float(one.alone.statistic[0] + other.alone.statistic[0]),
        dof=one.rows.size + other.rows.size - 8,
        sigma_m=float(np.sqrt(np.mean(measurements.sigma_m[np.concatenate((one.rows, other.rows))] ** 2))),
    )


def solve_sky(measurements: WindowRanges, signals: Sequence[SignalId], parts: Sequence[Part]) -> ConsistentSky:
    """Solve the common position of parts, by the first signal of each satellite, and the clock of each."""
    kinds = sorted(part.kind for part in parts)
    rank = {kind: sum(other[0] == kind[0] for other in kinds[: kinds.index(kind)]) for kind in kinds}
    parts = sorted(parts, key=lambda part: (rank[part.kind], -part.rows.size))
    first = parts[0]
    if len(parts) == 1:
        return ConsistentSky(
            first.rows,
            first.alone.state_m[0],
            first.alone.covariance_m2[0],
            {first.kind: float(first.alone.state_m[0, 3])},
            float(first.alone.statistic[0]),
            first.rows.size - 4,
        )
    start = first.alone.state_m[0]
    return _solve_groups(measurements, signals, [part.rows for part in parts], start)


def _solve_groups(
    measurements: WindowRanges, signals: Sequence[SignalId], groups: Sequence[Indices], start_m: Reals
) -> ConsistentSky:
    """Solve the position by one signal per satellite from groups of rows, each of one kind, with a clock each."""
    taken: set[str] = set()
    used: list[Indices] = []
    for rows in groups:
        group_rows = np.array([k for k in rows if signals[k].sat not in taken], dtype=np.intp)
        if group_rows.size >= 2 or not used:  # one signal beside its own clock proves nothing
            used.append(group_rows)
            taken |= {signals[k].sat for k in group_rows}
    choice = np.concatenate(used)
    clocks = np.repeat(np.eye(len(used)), [rows.size for rows in used], axis=0)
    start = np.concatenate((start_m[:3], np.full(len(used), start_m[3])))
    found = solve(measurements, choice[None, :], start[None, :], rounds=2, clocks=clocks)
    state = found.state_m[0, :4]
    return ConsistentSky(
        np.concatenate(groups),
        state,
        found.covariance_m2[0, :4, :4],
        {signals[rows[0]].kind: _estimate_clock_m(measurements, rows, state) for rows in groups},
        float(found.statistic[0]),
        choice.size - 3 - len(used),
    )


def _estimate_clock_m(measurements: WindowRanges, rows: Indices, state_m: Reals) -> float:
    """Estimate the clock that these signals show at a position."""
    misfit_m, sigma_m, _ = compute_misfits(measurements, rows, state_m)
    return float(state_m[3] + np.average(misfit_m, weights=sigma_m**-2.0))


def select_few(
    measurements: WindowRanges,
    signals: Sequence[SignalId],
    sky: ConsistentSky,
    rows: Indices,
    false_alarm_probability: float,
) -> Indices:
    """Select signals of a kind with few satellites that fit a sky's position, with a clock of their own.

    At most one of each satellite, as many as fit, two at least. One alone fits anywhere with its clock and is left out,
    since nothing is known of it. k signals leave k - 1 degrees.
    """
    misfit_m, sigma_m, unit = compute_misfits(measurements, rows, sky.state_m)
    position_m2 = unit @ sky.covariance_m2[:3, :3] @ unit.T
    sats = sorted({signals[k].sat for k in rows})
    copies = [[-1, *(n for n, k in enumerate(rows) if signals[k].sat == sat)] for sat in sats]
    if np.prod([len(chosen) for chosen in copies]) > _MOST_CHOICES:
        return np.empty(0, np.intp)
    best: tuple[int, float, list[int]] = 1, 0.0, []
    for choice in product(*copies):
        chosen = [n for n in choice if n >= 0]
        if len(chosen) < best[0] or len(chosen) < 2:
            continue
        statistic = _compute_beside_clock(
            misfit_m[chosen], np.diag(sigma_m[chosen] ** 2) + position_m2[np.ix_(chosen, chosen)]
        )
        bound_m = SPEED_OF_LIGHT_M_S * OFFSET_MAX_S
        fits = statistic <= chi_square_threshold(false_alarm_probability, len(chosen) - 1)
        if (
            fits
            and abs(float(np.mean(misfit_m[chosen]))) <= bound_m
            and (len(chosen), -statistic) > (best[0], -best[1])
        ):
            best = len(chosen), statistic, chosen
    return rows[np.array(best[2], dtype=np.intp)]


def _compute_beside_clock(misfit_m: Reals, covariance_m2: Reals) -> float:
    """Compute the squared Mahalanobis length of misfits after their common part is taken off."""
    ones = np.ones(misfit_m.size)
    weighted = np.linalg.solve(covariance_m2, np.column_stack((misfit_m, ones)))
    return float(misfit_m @ weighted[:, 0] - (ones @ weighted[:, 0]) ** 2 / (ones @ weighted[:, 1]))


def join_lone_sky(
    measurements: WindowRanges, signals: Sequence[SignalId], kinds: dict[Kind, Indices], false_alarm_probability: float
) -> ConsistentSky | None:
    """Join kinds that all have too few satellites for sets of their own: all their signals, or none.

    Only where every transmission is there once: so few signals do not show which copies belong together. None without
    two signals beyond the unknowns, or where they fit no one position.
    """
    groups = [rows for rows in sorted(kinds.values(), key=lambda rows: -rows.size) if rows.size >= 2]
    names = [signals[k].transmission for rows in groups for k in rows]
    n_sats = len({signals[k].sat for rows in groups for k in rows})
    if not groups or len(set(names)) < len(names) or n_sats < 5:
        return None
    sky = _solve_groups(
        measurements, signals, groups, np.append(find_point_below(measurements, np.concatenate(groups)), 0.0)
    )
    if sky.dof < 1 or not np.all(np.isfinite(sky.state_m)) or not is_plausible(sky.state_m[None, :3])[0]:
        return None
    return sky if sky.statistic <= chi_square_threshold(false_alarm_probability, sky.dof) else None


def extend_sky(measurements: WindowRanges, sky: ConsistentSky, kind: Kind, rows: Indices) -> ConsistentSky:
    """Add further signals of a kind to the sky, without moving its position."""
    return ConsistentSky(
        np.concatenate((sky.rows, rows)),
        sky.state_m,
        sky.covariance_m2,
        sky.clock_m | {kind: _estimate_clock_m(measurements, rows, sky.state_m)},
        sky.statistic,
        sky.dof,
    )
