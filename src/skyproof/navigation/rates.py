"""Take Dopplers from the slope of the carrier phase where a receiver reports none."""

from dataclasses import replace

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.records import CellStatus, Observations

__all__ = ["RIM_EPOCHS", "fill_dopplers"]

_GAP = 1.5  # usual intervals; phases across a longer one are not joined


RIM_EPOCHS = 2
"""Epochs beside a stretch of a run from which its Dopplers may come."""


def fill_dopplers(observations: Observations, usual_s: float | None = None) -> tuple[Observations, Booleans]:
    """Fill missing Dopplers from the carrier phase.

    Returns the observations, and which cells (n_epochs, n_channels) were filled.

    The slope of the parabola through the phase of three epochs in a row, the cell's own in their middle where it can
    be: exact for a steady acceleration. What the acceleration changes by, j in m/s^3, leaves j times the interval
    squared over 6 (over 3 at the ends of an arc): 1 cm/s over 30 s for a GPS satellite and an antenna at rest. The
    sigma is that of the phases. Arcs of one or two epochs stay without.

    usual_s : from one epoch to the next, if these are a stretch of more.
    """
    o = observations
    missing = np.isfinite(o.carrier_cyc) & ~np.isfinite(o.doppler_hz)
    if o.gpst.size < 3 or not missing.any():
        return o, np.zeros_like(missing)
    first = _find_triples(_mark_continuous(o, float(np.median(np.diff(o.elapsed_s))) if usual_s is None else usual_s))
    cells = missing & (first >= 0)
    rows, columns = np.nonzero(cells)
    three = first[rows, columns, None] + np.arange(3)
    weight = _weigh_slope(o.elapsed_s[three], o.elapsed_s[rows])
    phase_cyc, sigma_cyc = o.carrier_cyc[three, columns[:, None]], o.carrier_sigma_cyc[three, columns[:, None]]
    doppler_hz, sigma_hz = o.doppler_hz.copy(), o.doppler_sigma_hz.copy()
    doppler_hz[cells] = -np.sum(weight * (phase_cyc - phase_cyc[:, :1]), axis=1)
    sigma_hz[cells] = np.sqrt(np.sum((weight * sigma_cyc) ** 2, axis=1))
    return replace(o, doppler_hz=doppler_hz, doppler_sigma_hz=sigma_hz), cells


def _mark_continuous(o: Observations, usual_s: float) -> Booleans:
    """Mark the cells (n_epochs, n_channels) where a phase continues that of the epoch before."""
    present = np.isfinite(o.carrier_cyc)
    step_s = np.diff(o.elapsed_s)
    goes_on = np.zeros_like(present)
    goes_on[1:] = present[1:] & present[:-1] & (o.status[1:] != CellStatus.SLIP)
    goes_on[1:] &= (step_s <= _GAP * usual_s)[:, None]
    return goes_on


def _find_triples(goes_on: Booleans) -> Indices:
    """Find the first of three epochs of one arc around each cell (n_epochs, n_channels); -1 for none."""
    n = len(goes_on)
    whole = np.zeros_like(goes_on)  # by the middle epoch
    whole[1:-1] = goes_on[1:-1] & goes_on[2:]
    row = np.broadcast_to(np.arange(n)[:, None], whole.shape)
    first = np.full(whole.shape, -1)
    first[2:] = np.where(whole[1:-1], row[:-2], first[2:])
    first[:-2] = np.where(whole[1:-1], row[:-2], first[:-2])
    first[1:-1] = np.where(whole[1:-1], row[:-2], first[1:-1])
    return first


def _weigh_slope(times_s: Reals, at_s: Reals) -> Reals:
    """Compute the weights (n, 3) by which values at `times_s` (n, 3) give their parabola's slope at `at_s` (n,)."""
    weights = np.empty_like(times_s)
    for k in range(3):
        time_s, *other_times_s = times_s[:, k], *(times_s[:, j] for j in range(3) if j != k)
        weights[:, k] = (2.0 * at_s - other_times_s[0] - other_times_s[1]) / (
            (time_s - other_times_s[0]) * (time_s - other_times_s[1])
        )
    return weights
