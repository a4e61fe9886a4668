"""Smooth a whole file's code: its level comes from a window on both sides, its motion from the carrier."""

from dataclasses import dataclass, replace

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import CellStatus, Observations

__all__ = ["smooth"]


def smooth(observations: Observations, *, window_s: float = 100.0, max_gap_epochs: int = 3) -> Observations:
    """Smooth pseudoranges by their own carrier, within `window_s`/2 on either side and within one arc.

    Each becomes carrier plus the mean of (code - carrier), weighted by 1/sigma^2, over the cells of its arc in the
    window (R. Hatch, "The synergism of GPS code and carrier measurements", 1982, made two-sided). Running sums: the
    cost does not depend on the window.

    An arc ends at a slip and at a gap of more than `max_gap_epochs` epochs. A cell with code and no carrier keeps its
    code; a cell without code stays NaN, with its status.

    Noise: the new sigma^2 is 1 / sum(1/sigma^2) plus that of the carrier at the epoch, if the code noise is white from
    epoch to epoch with the `pseudorange_sigma_m` given. Neighbouring epochs then share their noise (so `averaged_s`
    becomes 0: nothing is promised of it). Code noise that is correlated over a time tau averages over window/tau values
    only, and errors that stay (multipath of a receiver at rest) not at all: the sigma does not know of them.

    Ionosphere: code is late and carrier early, so code minus carrier drifts by twice the ionosphere's rate. Over the
    full window that cancels to first order; at the ends of an arc, where the window has one side only, it leaves up to
    window_s/2 times the rate: 5 cm at an ordinary 1 mm/s and 100 s.

    Parameters
    ----------
    window_s : full length. max_gap_epochs : missing epochs that the carrier may bridge.
    """
    n, channels = observations.pseudorange_m.shape
    if n == 0 or channels == 0:
        return replace(observations, averaged_s=0.0)
    wavelength_m = SPEED_OF_LIGHT_M_S / observations.carrier_hz
    carrier_m = observations.carrier_cyc * wavelength_m
    code_sigma_m = observations.pseudorange_sigma_m
    present = np.isfinite(observations.pseudorange_m) & np.isfinite(carrier_m) & np.isfinite(code_sigma_m)
    arcs = _find_arcs(present, observations.status == CellStatus.SLIP, max_gap_epochs)

    # Levels count from their arc's first, so that the running sums keep millimetres beside carriers of any start.
    difference_m = np.where(present, observations.pseudorange_m - carrier_m, 0.0)
    level_m = np.take_along_axis(difference_m, arcs.first, axis=0)
    weight = np.where(present, 1.0 / np.where(present, code_sigma_m, 1.0) ** 2, 0.0)
    half_s = 0.5 * window_s * (1.0 + 1e-9)  # epochs at the window's very edge count
    begin = np.searchsorted(observations.elapsed_s, observations.elapsed_s - half_s, side="left")
    end = np.searchsorted(observations.elapsed_s, observations.elapsed_s + half_s, side="right") - 1
    begin, end = np.maximum(begin[:, None], arcs.first), np.minimum(end[:, None], arcs.last)
    weights = _sum_between(weight, begin, end)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_m = _sum_between(weight * (difference_m - level_m), begin, end) / weights + level_m
        sigma_m = np.sqrt(1.0 / weights + (observations.carrier_sigma_cyc * wavelength_m) ** 2)
    return replace(
        observations,
        pseudorange_m=np.where(present, carrier_m + mean_m, observations.pseudorange_m),
        pseudorange_sigma_m=np.where(present & np.isfinite(sigma_m), sigma_m, code_sigma_m),
        averaged_s=0.0,
    )


@dataclass(frozen=True)
class _Arcs:
    """first, last : (n_epochs, n_channels) row of the first and last cell of the arc that a cell lies in."""

    first: Indices
    last: Indices


def _find_arcs(present: Booleans, slip: Booleans, max_gap_epochs: int) -> _Arcs:
    """Find the arc of each cell: it begins at a slip and after a longer gap than the carrier may bridge."""
    n = len(present)
    row = np.broadcast_to(np.arange(n)[:, None], present.shape)
    latest = np.maximum.accumulate(np.where(present, row, -1), axis=0)
    previous = np.vstack((np.full((1, present.shape[1]), -1), latest[:-1]))  # the latest cell before each
    slips = np.cumsum(slip, axis=0)
    slipped = slips != np.take_along_axis(slips, np.maximum(previous, 0), axis=0)
    starts = present & ((previous < 0) | slipped | (row - previous > max_gap_epochs + 1))
    first = np.maximum.accumulate(np.where(starts, row, 0), axis=0)
    next_start = np.minimum.accumulate(np.where(starts, row, n)[::-1], axis=0)[::-1]
    last = np.vstack((next_start[1:], np.full((1, present.shape[1]), n))) - 1
    return _Arcs(first, last)


def _sum_between(values: Reals, begin: Indices, end: Indices) -> Reals:
    """Sum rows begin..end, both included, column by column."""
    running = np.vstack((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)))
    return np.asarray(np.take_along_axis(running, end + 1, axis=0) - np.take_along_axis(running, begin, axis=0))
