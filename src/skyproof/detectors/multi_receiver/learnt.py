"""Learn how far apart the antennas stood in earlier windows, for the windows after that.

An attack that begins beside the true sky and then drowns it leaves one set of signals in each receiver, which one
antenna sends. Windows of the beginning, which separated the true sky from the false one, showed how far apart the
antennas stand. On a body that turns this distance is all that lasts.

A window in which the antennas may stand as stated keeps what it shows as well (`keep_shown`). If a later window shows
them elsewhere, the statement is not what is wrong: antennas that stood elsewhere all along would have shown it before.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from skyproof.detectors.multi_receiver.known_geometry import Fit, LearntBaseline, LearntDistance
from skyproof.detectors.multi_receiver.pairing import Pairing
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.records import Baseline

__all__ = ["LearntDistances", "keep_shown"]


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


def keep_shown(pairing: Pairing, *, places: bool) -> Fit | None:
    """Return what a pairing shows of the antennas, under the largest noise; None if it shows nothing that lasts.

    places : whether the antennas keep their places, east, north, up; else two of them keep their distance.
    """
    baseline = pairing.widest_baseline
    if baseline is None or not (places or len(pairing.sets) == 2):
        return None
    return LearntBaseline(baseline) if places else LearntDistance(*baseline.distances_m[0])
