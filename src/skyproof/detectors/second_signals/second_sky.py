"""Compute how improbable a consistent set is, if signals, or second ones, are echoes of one path each."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.second_signals.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.chance import bound_chance_p_value, count_set_combinations
from skyproof.navigation.ranges import time_scale
from skyproof.navigation.skies import compute_apart_p_value
from skyproof.navigation.window import average_window
from skyproof.records import ConsistentSet, Observations, SignalId
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["echoes_p_value", "second_sky_p_value"]


def echoes_p_value(
    observations: Observations,
    chosen: ConsistentSet,
    *,
    unrelated_spread_m: float,
    multipath_sigma_m: float = 1.0,
) -> float:
    """Return the chance that echoes in place of blocked direct signals make such a set at a wrong place.

    True signals pin a position down where they are four or more; so all that is beyond four has to fit by chance, as in
    `second_sky_p_value`, among all sets of so many satellites that the receiver could form. A satellite's signals of
    several kinds take one path: they count once, also among the possible sets. Each further time scale takes one
    satellite for its clock.
    """
    mean = average_window(observations)
    sigma_m = dict(zip(mean.signals, np.hypot(mean.sigma_m, multipath_sigma_m), strict=True))
    kinds = {signal.kind for signal in chosen.signals}
    sent = Counter((signal.sat, signal.kind) for signal in observations.signals if signal.kind in kinds)
    copies: dict[str, int] = {}
    for (sat, _), count in sent.items():
        copies[sat] = max(count, copies.get(sat, 0))
    each_m: dict[str, float] = {}
    for signal in chosen.signals:
        each_m[signal.sat] = max(each_m.get(signal.sat, 0.0), float(sigma_m.get(signal, multipath_sigma_m)))
    free = len({time_scale(signal) for signal in chosen.signals}) - 1
    largest_m = np.sort(list(each_m.values()))[free:]
    single_kind = len(kinds) == 1
    fits = float(chi_square_threshold(POLICY.sets_fit_probability, max(largest_m.size - 4, 1)))
    return float(
        bound_chance_p_value(
            largest_m,
            window_m=unrelated_spread_m,
            largest_statistic=max(chosen.statistic, 1e-6) if single_kind else fits,
            combinations=count_set_combinations(np.array(list(copies.values())), len(each_m)),
        )
    )


def second_sky_p_value(
    observations: Observations,
    sets: tuple[ConsistentSet, ...],
    *,
    unrelated_spread_m: float,
    multipath_sigma_m: float = 1.0,
) -> float:
    """Return the chance that one of a receiver's `sets` beside the largest is no second sky; 1 with fewer than two.

    A set with signals of a kind that the largest has as well consists of second signals. The p-value holds given that
    there are second signals at all. Their number is another question (`second_signals`), so the two p-values are
    independent. The signals outside the largest set are taken as independent and uniform over `unrelated_spread_m`. A
    set's own statistic is the limit that another would have had to meet. The union bound runs over all sets of this
    size that they could form, and over the sets that were found. Of several kinds all have to fit, and the least likely
    counts.

    Kinds that the largest has not (GPS shows one place, Galileo another) need no second signal. They belong to the same
    sky unless the places are farther apart than errors explain (`skies.compute_apart_p_value`). And few satellites with
    wrong orbits, clocks or numbers, each by its own amount, fit one place by chance. Their delays spread at least as
    far as its ranges are off at the other place (`_spread_m`).
    """
    ordered = sorted(sets, key=lambda s: (-len(s.signals), s.statistic))
    if len(ordered) < 2:
        return 1.0
    mean = average_window(observations)
    sigma_m = {signal: np.hypot(s, multipath_sigma_m) for signal, s in zip(mean.signals, mean.sigma_m, strict=True)}
    first = ordered[0]
    known = {signal.kind for signal in first.signals}
    p_values = []
    for chosen in ordered[1:]:
        chances = []
        for kind in sorted({signal.kind for signal in chosen.signals} & known):
            of_kind = [signal for signal in chosen.signals if signal.kind == kind]
            beside = [s for s in observations.signals if s.kind == kind and s not in first.signals]
            own_sigma_m = np.array([sigma_m.get(signal, multipath_sigma_m) for signal in of_kind])
            chances.append(_chance_of_fit(chosen, of_kind, own_sigma_m, beside, unrelated_spread_m))
        other_kinds = tuple(signal for signal in chosen.signals if signal.kind not in known)
        if other_kinds:
            both_m = [sigma_m.get(s, multipath_sigma_m) for s in (*first.signals, *chosen.signals)]
            apart = _p_value_of_same_place(first, chosen, float(np.sqrt(np.mean(np.square(both_m)))))
            by_chance = echoes_p_value(
                observations,
                replace(chosen, signals=other_kinds),
                unrelated_spread_m=max(unrelated_spread_m, _spread_m(first, chosen, sigma_m)),
                multipath_sigma_m=multipath_sigma_m,
            )
            chances.append(max(apart, by_chance))
        p_values.append(min(1.0, len(chances) * min(chances)))
    return min(1.0, len(p_values) * min(p_values))


def _chance_of_fit(
    chosen: ConsistentSet, own: Sequence[SignalId], sigma_m: Reals, beside: Sequence[SignalId], spread_m: float
) -> float:
    """Return the chance of the signals `own` of one kind fitting, among those `beside` the largest set."""
    limit = max(chosen.statistic, 1e-6)
    if len(own) < len(chosen.signals):  # what part of the statistic is theirs is not known
        limit = max(limit, float(chi_square_threshold(POLICY.sets_fit_probability, max(len(own) - 4, 1))))
    copies = np.array(list(Counter(signal.sat for signal in beside).values()))
    count = count_set_combinations(copies, len(own))
    return float(bound_chance_p_value(sigma_m, window_m=spread_m, largest_statistic=limit, combinations=count))


def _p_value_of_same_place(first: ConsistentSet, other: ConsistentSet, sigma_m: float) -> float:
    covariance_m2 = first.covariance_m2 + other.covariance_m2
    return compute_apart_p_value(
        first.position_ecef_m - other.position_ecef_m,
        covariance_m2[:3, :3],
        SPEED_OF_LIGHT_M_S * (first.clock_bias_s - other.clock_bias_s),
        float(covariance_m2[3, 3]),
        statistic=first.statistic + other.statistic,
        dof=first.dof + other.dof,
        sigma_m=sigma_m,
    )


def _spread_m(first: ConsistentSet, chosen: ConsistentSet, sigma_m: Mapping[SignalId, float]) -> float:
    """Return the least spread of the errors that a set's ranges have at the place of another one, metres.

    Let w be the weights of the ranges and P the covariance of the position, whatever its clock. The weighted variance
    of what a step changes the ranges by is step' P^-1 step / sum w. No values spread over less than twice its root.
    """
    step_m = first.position_ecef_m - chosen.position_ecef_m
    weights = sum(sigma_m[signal] ** -2.0 for signal in chosen.signals if signal in sigma_m)
    if not weights > 0.0:
        return 0.0
    return 2.0 * float(np.sqrt(step_m @ np.linalg.solve(chosen.covariance_m2[:3, :3], step_m) / weights))
