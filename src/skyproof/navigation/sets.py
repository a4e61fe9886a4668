"""Find the consistent sets of one receiver's window: which signals, together, look like one sky?

A set is no evidence of authenticity: a meaconed sky is as consistent as the true one. Four signals always fit, so that
sets begin at five; and small sets can fit by chance (`chance.bound_chance_p_value`).

Each kind of signal (time scale, band, code) is searched alone, by satellite, with one clock. Then kinds that show one
position are one set, with a clock each (`skies.join_skies`), and kinds of fewer satellites join where they fit.
"""

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.ranges import UNKNOWN_DELAY_SIGMA_M, Ranges, compute_space_sigma_m, correct_ranges
from skyproof.navigation.reflections import estimate_reflection_sigma_m
from skyproof.navigation.search import SetCandidates, SetSearch, WindowRanges, compute_innovation, is_plausible, solve
from skyproof.navigation.skies import (
    ConsistentSky,
    Part,
    extend_sky,
    group_by_kind,
    join_lone_sky,
    join_skies,
    select_few,
    solve_sky,
)
from skyproof.navigation.window import WindowMean, average_window
from skyproof.records import BY_NAME, ConsistentSet, Kind, NavigationData, Observations, SignalId
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["find_consistent_sets", "measure_window"]

_FORBIDDEN = 1e6  # cost of an assignment that cannot be


def find_consistent_sets(
    window: Observations,
    navigation: NavigationData,
    *,
    multipath_sigma_m: float = 1.0,
    ionosphere_share: float = 0.25,
    false_alarm_probability: float = 1e-4,
    min_satellites: int = 5,
    max_sets: int = 4,
    min_share: float = 0.5,
) -> tuple[ConsistentSet, ...]:
    """Find disjoint sets of signals that fit one position, the largest first.

    Each set has at most one signal per transmission.

    For each kind of signal the largest consistent set is found (of several the one with the smallest statistic), its
    signals are taken out, and so on. A set within the noise of an earlier one of its kind, in position and clock, is
    the same sky tracked twice and is not reported. Then every satellite's signals are assigned again among the kind's
    sets, by the likelihood of each beside the others of a set. The first set may have taken a signal that fits it by
    chance, or the wrong one of two that are within the noise of each other.

    Sets of different kinds that show one position are one set, with a clock for each kind. A kind with fewer than
    `min_satellites` satellites joins each set with those of its signals, two at least, that fit there with one clock;
    one signal alone of its kind is in no set. Where no kind has enough satellites, all together make a set if they fit
    one position, every transmission being there once.

    Under the null (a true sky, noise as stated) the full set of a kind fails its chi-square test, and loses a signal,
    with `false_alarm_probability`; and kinds are parted with `skies.JOIN_PROBABILITY`.

    Parameters
    ----------
    window : one receiver's observations, all of the window.
    multipath_sigma_m : what stays over the window: multipath, orbit and clock errors, the same for all; what the orbits
        of a system are worse than those of GPS comes on top (`ranges.compute_space_sigma_m`).
    ionosphere_share : of the ionosphere's delay, one sigma of what the model leaves.
    min_satellites : five at least. Wrong sets of five signals are frequent where there are many signals.
    max_sets : of one kind.
    min_share : signals with a pseudorange in less than this share of the window are left out.

    Returns
    -------
    Sets below 20 km underground or beyond 50 000 km of the Earth's centre are dropped. `gpst` is the label of the
    middle epoch, by the receiver's clock, and position and clock hold there.
    """
    if min_satellites < 5:
        raise ValueError(f"min_satellites is {min_satellites}: four signals always fit one position, take 5 or more")
    mean, measurements, usable = measure_window(
        window,
        navigation,
        multipath_sigma_m=multipath_sigma_m,
        ionosphere_share=ionosphere_share,
        min_share=min_share,
    )
    parts: list[Part] = []
    few: dict[Kind, Indices] = {}
    for kind, rows in group_by_kind(mean.signals, np.flatnonzero(usable)).items():
        if len({mean.signals[k].sat for k in rows}) < min_satellites:
            few[kind] = rows
            continue
        found = _find_sets_of_kind(measurements, mean.signals, rows, false_alarm_probability, min_satellites, max_sets)
        parts += [Part(kind, candidate.choice[0], candidate) for candidate in found]
    skies = [solve_sky(measurements, mean.signals, sky_parts) for sky_parts in join_skies(measurements, parts)]
    if not skies and (sky := join_lone_sky(measurements, mean.signals, few, false_alarm_probability)) is not None:
        skies = [sky]
    for kind, rows in few.items() if parts else ():
        remaining = rows
        for number, sky in enumerate(skies):
            fitting = select_few(measurements, mean.signals, sky, remaining, false_alarm_probability)
            if fitting.size:
                skies[number] = extend_sky(measurements, sky, kind, fitting)
                remaining = np.setdiff1d(remaining, fitting)
    skies.sort(key=lambda sky: (-sky.rows.size, sky.statistic))
    return tuple(_record(window.receiver, mean, sky) for sky in skies)


def _find_sets_of_kind(
    measurements: WindowRanges,
    signals: tuple[SignalId, ...],
    rows: Indices,
    false_alarm_probability: float,
    min_satellites: int,
    max_sets: int,
) -> list[SetCandidates]:
    """Find the consistent sets among the signals of one kind, each as `solve` gives it."""
    free = np.zeros(len(signals), np.bool_)
    free[rows] = True
    copies = list(_group_by_satellite(signals, free).values())
    search = SetSearch(measurements, copies)
    found: list[SetCandidates] = []
    size = len(copies)
    while size >= min_satellites and len(found) < max_sets:
        candidates = search.find_of_size(size, free, false_alarm_probability=false_alarm_probability)
        if not candidates.choice.size:
            size -= 1
        for k, chosen in enumerate(candidates.choice):
            if free[chosen].all() and len(found) < max_sets:
                free[chosen] = False
                candidate = solve(measurements, chosen[None, :], candidates.state_m[k : k + 1], rounds=2)
                if not any(_is_same_sky(candidate, other, false_alarm_probability) for other in found):
                    found.append(candidate)
    return _reassign_signals(measurements, signals, found, false_alarm_probability, min_satellites)


def measure_window(
    window: Observations,
    navigation: NavigationData,
    *,
    multipath_sigma_m: float,
    ionosphere_share: float,
    min_share: float = 0.5,
    reflected: bool = False,
) -> tuple[WindowMean, WindowRanges, Booleans]:
    """Bring the window's signals to its middle, and mark those with an ephemeris and a carrier.

    Arguments as in `find_consistent_sets`. Signals whose group delay no message gives are included, with its sigma.

    reflected : whether the errors are also those of reflections that discriminators show.
    """
    mean, ranges = _average_and_range(window, navigation, min_share)
    unknown_delay_m2 = np.where(ranges.delay_unknown[0], UNKNOWN_DELAY_SIGMA_M, 0.0) ** 2
    reflected_m = estimate_reflection_sigma_m(mean.quadrature_m, mean.sigma_m) if reflected else 0.0
    measurements = WindowRanges(
        satellite_ecef_m=ranges.satellite_ecef_m[0],
        range_m=ranges.range_m[0],
        sigma_m=np.sqrt(
            mean.sigma_m**2
            + multipath_sigma_m**2
            + reflected_m**2
            + compute_space_sigma_m(mean.signals) ** 2
            + unknown_delay_m2
        ),
        carrier_hz=mean.carrier_hz,
        tow_s=week_and_tow(mean.gpst)[1],
        ionosphere=navigation.ionosphere,
        ionosphere_share=ionosphere_share,
    )
    return mean, measurements, np.isfinite(ranges.range_m[0]) & np.isfinite(mean.carrier_hz)


@lru_cache(16)  # several tests look at the same windows
def _average_and_range(window: Observations, navigation: NavigationData, min_share: float) -> tuple[WindowMean, Ranges]:
    mean = average_window(window, min_share=min_share)
    gpst, pseudorange_m = np.array([mean.gpst]), mean.pseudorange_m[None, :]
    return mean, correct_ranges(mean.signals, gpst, pseudorange_m, navigation, with_unknown_delay=True)


def _group_by_satellite(signals: tuple[SignalId, ...], free: Booleans) -> dict[str, Indices]:
    of: dict[str, list[int]] = {}
    for k in np.flatnonzero(free):
        of.setdefault(signals[k].sat, []).append(int(k))
    return {sat: np.array(of[sat]) for sat in sorted(of)}


def _is_same_sky(one: SetCandidates, other: SetCandidates, false_alarm_probability: float) -> bool:
    """Test whether two disjoint sets' positions and clocks differ by no more than their covariances explain."""
    difference_m = one.state_m[0] - other.state_m[0]
    covariance_m2 = one.covariance_m2[0] + other.covariance_m2[0]
    distance = difference_m @ np.linalg.solve(covariance_m2, difference_m)
    return bool(distance <= chi_square_threshold(false_alarm_probability, 4))


def _reassign_signals(
    measurements: WindowRanges,
    signals: tuple[SignalId, ...],
    found: list[SetCandidates],
    false_alarm_probability: float,
    min_satellites: int,
) -> list[SetCandidates]:
    """Assign each satellite's signals to their likeliest sets, as long as every set stays consistent."""
    if len(found) < 2:
        return found
    sats = np.array([signal.sat for signal in signals])
    for _ in range(3):
        owner = np.full(len(signals), -1)
        for k, candidate in enumerate(found):
            owner[candidate.choice] = k
        cost = _compute_costs(measurements, sats, found)
        dealt = owner.copy()
        for rows in _group_by_satellite(signals, owner >= 0).values():
            _, dealt[rows] = scipy.optimize.linear_sum_assignment(cost[rows])
        if np.array_equal(dealt, owner):
            break
        sizes = np.bincount(dealt[dealt >= 0], minlength=len(found))
        if np.any(sizes < min_satellites):
            break
        solved = [
            solve(measurements, np.flatnonzero(dealt == k)[None, :], found[k].state_m, rounds=2)
            for k in range(len(found))
        ]
        limits = chi_square_threshold(false_alarm_probability, sizes - 4)
        if not all(
            c.statistic[0] <= t and is_plausible(c.state_m[:, :3])[0] for c, t in zip(solved, limits, strict=True)
        ):
            break
        found = solved
    return found


def _compute_costs(measurements: WindowRanges, sats: NDArray[np.str_], found: list[SetCandidates]) -> Reals:
    """Compute minus twice the log-likelihood (n_signals, n_sets) of each signal beside a set's other satellites."""
    rows = np.arange(sats.size)
    cost = np.empty((sats.size, len(found)))
    for k, candidate in enumerate(found):
        choice = np.repeat(candidate.choice, rows.size, axis=0)
        other_choice = np.where(sats[choice] == sats[:, None], -1, choice)
        alone = solve(measurements, other_choice, np.repeat(candidate.state_m, rows.size, axis=0))
        misfit_m, variance_m2 = compute_innovation(measurements, rows, alone.state_m, alone.covariance_m2)
        cost[:, k] = misfit_m**2 / variance_m2 + np.log(variance_m2)
    return np.minimum(np.nan_to_num(cost, nan=_FORBIDDEN), _FORBIDDEN)


def _record(receiver: str, mean: WindowMean, sky: ConsistentSky) -> ConsistentSet:
    clock_m = float(sky.state_m[3])
    several = sky.clock_m if len(sky.clock_m) > 1 else {}
    return ConsistentSet(
        receiver=receiver,
        signals=tuple(sorted((mean.signals[k] for k in sky.rows), key=BY_NAME)),
        gpst=mean.gpst,
        position_ecef_m=sky.state_m[:3],
        clock_bias_s=clock_m / SPEED_OF_LIGHT_M_S,
        covariance_m2=sky.covariance_m2,
        statistic=sky.statistic,
        dof=sky.dof,
        p_value=float(chi_square_survival(sky.statistic, sky.dof)),
        offsets_s={kind: (own_m - clock_m) / SPEED_OF_LIGHT_M_S for kind, own_m in several.items()},
    )
