"""Learn how far apart the antennas stood while both skies were received, for the windows after that.

An attack that begins beside the true sky and then drowns it leaves one set of signals in each receiver, which one
antenna sends. Windows of the beginning, which separated the true sky from the false one, showed how far apart the
antennas stand. On a body that turns this distance is all that lasts.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from skyproof.detectors.multi_receiver.known_geometry import LearntDistance
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.records import Baseline

__all__ = ["LearntDistances"]


@dataclass(frozen=True, eq=False)
class LearntDistances:
    """Of pairs of receivers. baselines : of the last windows in which both skies were received."""

    baselines: Mapping[tuple[str, ...], tuple[Baseline, ...]] = field(default_factory=dict)

    def and_of(self, baseline: Baseline) -> "LearntDistances":
        """Return the distances with one window more."""
        if len(baseline.receivers) != 2:
            return self
        kept = (*self.baselines.get(baseline.receivers, ()), baseline)[-POLICY.remembered_windows :]
        return LearntDistances({**self.baselines, baseline.receivers: kept})

    def of(self, receivers: tuple[str, ...]) -> LearntDistance | None:
        """Return the receivers' distance; None if few windows showed it, or not the same one.

        The sigma is that of one window, as lasting errors do not average out.
        """
        distances = np.array([b.distances_m[0] for b in self.baselines.get(receivers, ())]).reshape(-1, 2)
        if len(distances) < POLICY.learnt_windows:
            return None
        middle_m, sigma_m = float(np.median(distances[:, 0])), float(np.max(distances[:, 1]))
        if np.any(np.abs(distances[:, 0] - middle_m) > POLICY.learnt_spread_sigmas * sigma_m):
            return None
        return LearntDistance(middle_m, sigma_m)
