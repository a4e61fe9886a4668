"""Find late copies of a whole sky: a repeater, or a reflector far from all satellites' paths alike.

A delay that is common to all satellites is a shift of the receiver's clock; it shows the same place. So a set of
signals that shows the place of another, later and weaker, attacks no position: it is named for what it is, and the
earlier set stands for both. Both are compared in the kinds of signals that they share: clocks and strengths of
different kinds cannot be compared.
"""

from collections.abc import Sequence

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.second_signals.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import ConsistentSet, Observations
from skyproof.statistics.distributions import chi_square_threshold

__all__ = ["is_late_copy", "remove_late_copies"]


def remove_late_copies(observations: Observations, sets: Sequence[ConsistentSet]) -> list[ConsistentSet]:
    """Remove a receiver's sets that are late copies of another one of them."""
    return [s for s in sets if not any(is_late_copy(s, other, observations) for other in sets)]


def is_late_copy(late: ConsistentSet, early: ConsistentSet, observations: Observations) -> bool:
    """Tell if a set shows the same place as another one of its receiver, later and by weaker signals."""
    kinds = {s.kind for s in late.signals} & {s.kind for s in early.signals}
    if late is early or not kinds:
        return False
    by_s = [late.clock_of_s(kind) - early.clock_of_s(kind) for kind in kinds]
    if not 0.0 < min(by_s) <= max(by_s) <= POLICY.most_late_m / SPEED_OF_LIGHT_M_S:
        return False
    if any(
        _level_dbhz(early, k, observations) - _level_dbhz(late, k, observations) < POLICY.copy_weaker_db for k in kinds
    ):
        return False
    off_m = late.position_ecef_m - early.position_ecef_m
    covariance_m2 = late.covariance_m2[:3, :3] + early.covariance_m2[:3, :3]
    squared = float(off_m @ np.linalg.solve(covariance_m2, off_m))
    return squared <= float(chi_square_threshold(POLICY.same_place_probability, 3))


def _level_dbhz(chosen: ConsistentSet, kind: tuple[str, str, str], observations: Observations) -> float:
    """Return the median C/N0 of a set's signals of a kind."""
    of_kind = [signal for signal in chosen.signals if signal.kind == kind and signal in observations.signals]
    columns = [observations.signals.index(signal) for signal in of_kind]
    values: Reals = observations.cn0_dbhz[:, columns]
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else -np.inf
