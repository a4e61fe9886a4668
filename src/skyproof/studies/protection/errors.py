"""How far fixes of a simulated scene are off, beside what they promise: the numbers of a Stanford diagram."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import seconds_between
from skyproof.records import Fix, FixStatus
from skyproof.simulator.received import ReceiverSky, Scene

__all__ = ["STANFORD", "FixErrors", "compare_with_truth", "fix_errors", "protection_columns", "stanford_rows"]

_TO_95: Final = 2.45  # of a circle about two equal sigmas
_TO_95_IN_SPACE: Final = 2.80  # of a sphere
STANFORD: Final = "stanford"
BIN_RATIO: Final = 10.0**0.05
"""Of the edges of a bin of a Stanford diagram: twenty a decade."""
LEAST_M: Final = 0.01
"""Errors are counted as no smaller, that they have a logarithm."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FixErrors:
    """Of the epochs that have a fix.

    off_enu_m : (n, 3) fix minus truth. sigma_enu_m : (n, 3) that it states. protection_m : (n, 2) its levels, NaN where
        none is promised. hidden_m : (n,) by how much more an attack may have moved it, NaN where nothing bounds that.
    """

    off_enu_m: Reals
    sigma_enu_m: Reals
    protection_m: Reals
    hidden_m: Reals

    @property
    def bound_m(self) -> Reals:
        """Return what the fix states at 95 %, level, (n,)."""
        return np.asarray(_TO_95 * self.sigma_enu_m[:, :2].max(axis=1))

    @property
    def space_bound_m(self) -> Reals:
        """Return what the fix states at 95 %, in space, (n,)."""
        return np.asarray(_TO_95_IN_SPACE * self.sigma_enu_m.max(axis=1))

    @property
    def horizontal_m(self) -> Reals:
        """Return the horizontal errors, (n,)."""
        return np.asarray(np.hypot(self.off_enu_m[:, 0], self.off_enu_m[:, 1]))

    @property
    def space_m(self) -> Reals:
        """Return the errors in space, (n,)."""
        return np.asarray(np.linalg.norm(self.off_enu_m, axis=1))

    def beyond(self, bounds: float) -> Booleans:
        """Return which fixes, (n,), are off, level, by more than so many bounds and what is hidden; none of those of
        which nothing bounds that."""
        return np.asarray(self.horizontal_m > bounds * self.bound_m + self.hidden_m)

    @property
    def sizes_m(self) -> Reals:
        """Return the errors that the levels bound, (n, 2): horizontally, vertically."""
        return np.stack((self.horizontal_m, np.abs(self.off_enu_m[:, 2])), axis=1)


def fix_errors(scene: Scene, sky: ReceiverSky, fix: Fix) -> FixErrors:
    """Compare a receiver's fixes with where its first antenna was."""
    good = np.flatnonzero(fix.status == FixStatus.OK)
    at_s = np.asarray(seconds_between(fix.gpst[good], scene.scenario.start_gpst), np.float64)
    return compare_with_truth(fix, good, sky.point(at_s).position_ecef_m)


def compare_with_truth(fix: Fix, epochs: Indices, truth_ecef_m: Reals) -> FixErrors:
    """Compare some epochs of a fix with where the antenna was, (n, 3)."""
    if not epochs.size:
        empty = np.empty((0, 3))
        return FixErrors(off_enu_m=empty, sigma_enu_m=empty, protection_m=empty[:, :2], hidden_m=empty[:, 0])
    rot = rot_enu_ecef(*geodetic_from_ecef(truth_ecef_m[0])[:2])
    return FixErrors(
        off_enu_m=(fix.position_ecef_m[epochs] - truth_ecef_m) @ rot.T,
        sigma_enu_m=np.sqrt(np.einsum("ij,njk,ik->ni", rot, fix.covariance_m2[epochs, :3, :3], rot)),
        protection_m=fix.protection_m[epochs],
        hidden_m=fix.hidden_m[epochs],
    )


def protection_columns(found: Sequence[FixErrors]) -> dict[str, Any]:
    """Compute of trusted fixes the share with a level, the median of the levels, and how many exceed it.

    Those without a level cannot be: what promises nothing does not break it.
    """
    levels_m, sizes_m = _levels_and_sizes(found)
    has_level = np.isfinite(levels_m)
    p50_m = [float(np.median(levels_m[has_level[:, k], k])) if has_level[:, k].any() else None for k in range(2)]
    beyond = [int(np.sum(sizes_m[:, k] > levels_m[:, k])) for k in range(2)]  # never true of NaN
    return {
        "protection_share": round(float(has_level[:, 0].mean()), 3) if has_level.size else None,
        "protection_p50_m": p50_m[0],
        "vertical_protection_p50_m": p50_m[1],
        "beyond_protection": beyond[0],
        "beyond_vertical_protection": beyond[1],
    }


def stanford_rows(found: Sequence[FixErrors]) -> list[dict[str, Any]]:
    """Build a row for each bin of level and error that holds a fix, horizontally and vertically."""
    levels_m, sizes_m = _levels_and_sizes(found)
    rows = []
    for k, axis in enumerate(("horizontal", "vertical")):
        has_level = np.isfinite(levels_m[:, k])
        pairs_m = np.stack((levels_m[has_level, k], np.maximum(sizes_m[has_level, k], LEAST_M)), axis=1)
        bins = np.floor(np.log(pairs_m) / np.log(BIN_RATIO))
        for (level, size), fixes in zip(*np.unique(bins, axis=0, return_counts=True), strict=True):
            level_m, error_m = (round(float(BIN_RATIO ** (number + 0.5)), 4) for number in (level, size))
            rows.append({"axis": axis, "protection_m": level_m, "error_m": error_m, "fixes": int(fixes)})
    return rows


def _levels_and_sizes(found: Sequence[FixErrors]) -> tuple[Reals, Reals]:
    """Join the levels and errors of all fixes, (n, 2) each."""
    empty = np.empty((0, 2))
    return (
        np.concatenate([empty, *(errors.protection_m for errors in found)]),
        np.concatenate([empty, *(errors.sizes_m for errors in found)]),
    )
