"""Compute where a window's signals stand as seen from the place that they show."""

from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.navigation.elevation_mask import find_low
from skyproof.navigation.least_squares import design_matrix
from skyproof.navigation.search import WindowRanges, compute_misfits, find_point_below, solve
from skyproof.navigation.sets import measure_window
from skyproof.records import NavigationData, Observations, SignalId

__all__ = ["Directions", "compute_directions"]

_UNKNOWNS: Final = 4


class Directions(NamedTuple):
    """Of signals (n,): rows of the geometry (n, 4), and the error that a range may keep over a window, one sigma; NaN
    where no orbit is known."""

    design: Reals
    sigma_m: Reals


def compute_directions(
    observations: Observations,
    navigation: NavigationData,
    signals: tuple[SignalId, ...],
    *,
    multipath_sigma_m: float = 1.0,
    ionosphere_share: float = 0.25,
    elevation_mask_deg: float = 5.0,
) -> Directions | None:
    """Compute directions from where the signals place the receiver, except for satellites below the elevation mask.

    None if they give no position. `multipath_sigma_m` and `ionosphere_share` are as of `sets.find_consistent_sets`.
    """
    mean, measurements, usable = measure_window(
        observations,
        navigation,
        multipath_sigma_m=multipath_sigma_m,
        ionosphere_share=ionosphere_share,
        min_share=0.0,
    )
    row_of = {signal: row for row, signal in enumerate(mean.signals) if usable[row]}
    rows = np.array([row_of[signal] for signal in signals if signal in row_of], np.intp)
    state_m = _solve(measurements, rows)
    if np.all(np.isfinite(state_m)):
        low = find_low(state_m[:3], measurements.satellite_ecef_m, elevation_mask_deg)
        row_of = {signal: row for signal, row in row_of.items() if not low[row]}
        rows = rows[~low[rows]]
        state_m = _solve(measurements, rows)
    if not np.all(np.isfinite(state_m)):
        return None
    _, fitted_sigma_m, unit = compute_misfits(measurements, rows, state_m)
    design, sigma_m = np.full((len(signals), _UNKNOWNS), np.nan), np.full(len(signals), np.nan)
    places = [k for k, signal in enumerate(signals) if signal in row_of]
    design[places], sigma_m[places] = design_matrix(unit), fitted_sigma_m
    return Directions(design, sigma_m)


def _solve(measurements: WindowRanges, rows: Indices) -> Reals:
    """Solve for position and clock (4,); NaN with fewer than four satellites."""
    if rows.size < _UNKNOWNS:
        return np.full(_UNKNOWNS, np.nan)
    start_m = np.append(find_point_below(measurements, rows), 0.0)
    return np.asarray(solve(measurements, rows[None], start_m[None], rounds=3).state_m[0])
