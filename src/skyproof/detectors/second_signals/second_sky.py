"""How improbable a second consistent set is, if a receiver's second signals have nothing to do with each other."""

from collections import Counter

import numpy as np

from skyproof.navigation.chance import chance_p_value, set_combinations
from skyproof.navigation.window import window_mean
from skyproof.records import ConsistentSet, Observations

__all__ = ["second_sky_p_value"]


def second_sky_p_value(
    observations: Observations,
    sets: tuple[ConsistentSet, ...],
    *,
    unrelated_spread_m: float,
    multipath_sigma_m: float = 1.0,
) -> float:
    """Chance that one of a receiver's `sets` beside the largest comes from unrelated signals; 1 with fewer than two.

    Given that there are second signals at all: how many there are is another question (`peaks`), so the two p-values
    are of independent things. The signals outside the largest set are taken as independent and uniform over
    `unrelated_spread_m`, and a set's own statistic as the limit that another would have had to meet; the union bound
    runs over all sets of this size that they could form, and over the sets that were found.
    """
    ordered = sorted(sets, key=lambda s: (-len(s.signals), s.statistic))
    if len(ordered) < 2:
        return 1.0
    mean = window_mean(observations)
    sigma_m = {signal: np.hypot(s, multipath_sigma_m) for signal, s in zip(mean.signals, mean.sigma_m, strict=True)}
    beside = Counter(signal.sat for signal in observations.signals if signal not in ordered[0].signals)
    p_values = [
        float(
            chance_p_value(
                np.array([sigma_m.get(signal, multipath_sigma_m) for signal in chosen.signals]),
                window_m=unrelated_spread_m,
                largest_statistic=max(chosen.statistic, 1e-6),
                combinations=set_combinations(np.array(list(beside.values())), len(chosen.signals)),
            )
        )
        for chosen in ordered[1:]
    ]
    return min(1.0, len(p_values) * min(p_values))
