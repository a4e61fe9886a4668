"""Average each channel over a whole window: pseudoranges brought to the middle epoch by their own carrier."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import FASTEST_M_S, SPEED_OF_LIGHT_M_S
from skyproof.records import CellStatus, Observations, SignalId

__all__ = ["WindowMean", "average_window", "fill_gaps", "median_interval_s"]

_RATE_PACE_M_S2: Final = 0.18
"""At which a range rate changes at most where the receiver stands: R r n^2 / (r - R) of a satellite at the zenith, with
r = 26 560 km and n = 1.459e-4 rad/s of GPS. So much a Doppler is off that is taken from another epoch."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WindowMean:
    """gpst : label of the middle epoch. signals, pseudorange_m, sigma_m, quadrature_m, carrier_hz (n,) : one for each
    channel that is kept. quadrature_m : of the code discriminators, averaged as the codes are; NaN where unknown."""

    gpst: np.datetime64
    signals: tuple[SignalId, ...]
    pseudorange_m: Reals
    sigma_m: Reals
    quadrature_m: Reals
    carrier_hz: Reals


def median_interval_s(elapsed_s: Reals) -> float:
    """Return the median time between epochs at `elapsed_s` (n,), seconds; 0 for fewer than two."""
    step_s = np.diff(elapsed_s)
    return float(np.median(step_s)) if step_s.size else 0.0


@lru_cache(16)  # several tests look at the same windows
def average_window(observations: Observations, *, min_share: float = 0.5) -> WindowMean:
    """Average pseudoranges at the middle epoch: the carrier there plus the mean of (code - carrier).

    The mean is weighted by 1/sigma^2, and its sigma is 1 / sqrt(sum(1/sigma^2)): thermal noise that is white from epoch
    to epoch. Across slips and gaps the range is carried on by the Doppler (trapezoids), which adds its own noise to the
    sigma; so a channel that has lost its carrier is still used. Channels that move differently (each by its own
    carrier, the receiver may move) come to one instant, at which the fix is for all.

    Parameters
    ----------
    min_share : channels with a pseudorange in less than this share of the epochs are left out.
    """
    n = observations.gpst.size
    if n == 0:
        raise ValueError(f"the window of {observations.receiver} has no epoch")
    middle = n // 2
    present = np.isfinite(observations.pseudorange_m) & np.isfinite(observations.pseudorange_sigma_m)
    kept = np.flatnonzero(present.mean(axis=0) >= max(min_share, 0.5 / n))
    present = present[:, kept]
    motion_m, bridge_m2 = _integrate_motion(observations, kept, middle)
    code_m = np.where(present, observations.pseudorange_m[:, kept], 0.0)
    weight = np.where(present, 1.0 / np.where(present, observations.pseudorange_sigma_m[:, kept], 1.0) ** 2, 0.0)
    weight = np.where(np.isfinite(motion_m), weight, 0.0)  # cut off by a gap in both carrier and Doppler
    total = weight.sum(axis=0)
    usable = total > 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_m = np.sum(weight * (code_m - np.nan_to_num(motion_m)), axis=0) / total
        sigma_m = np.sqrt(1.0 / total + bridge_m2)
        quadrature_m = np.sum(np.where(weight > 0.0, weight * observations.quadrature_m[:, kept], 0.0), axis=0) / total
    return WindowMean(
        gpst=observations.gpst[middle],
        signals=tuple(observations.signals[k] for k in kept[usable]),
        pseudorange_m=mean_m[usable],
        sigma_m=sigma_m[usable],
        quadrature_m=quadrature_m[usable],
        carrier_hz=observations.carrier_hz[kept[usable]],
    )


def _integrate_motion(observations: Observations, kept: Indices, middle: int) -> tuple[Reals, Reals]:
    """Integrate range at each epoch minus range at the middle, (n, kept).

    Returns it, and the variance that bridges by Doppler add.
    """
    wavelength_m = SPEED_OF_LIGHT_M_S / observations.carrier_hz[kept]
    elapsed_s = observations.elapsed_s
    dt_s = np.diff(elapsed_s)[:, None]
    carrier_m = observations.carrier_cyc[:, kept] * wavelength_m
    rate_m_s = -wavelength_m * fill_gaps(elapsed_s, observations.doppler_hz[:, kept])
    rate_sigma_m_s = wavelength_m * fill_gaps(elapsed_s, observations.doppler_sigma_hz[:, kept])
    by_carrier = np.diff(carrier_m, axis=0)
    # Not every carrier that begins anew, or is misread, is marked as a slip.
    whole = (observations.status[1:, kept] != CellStatus.SLIP) & (np.abs(by_carrier) <= FASTEST_M_S * dt_s)
    by_doppler = 0.5 * dt_s * (rate_m_s[1:] + rate_m_s[:-1])
    doppler_m2 = 0.25 * dt_s**2 * (rate_sigma_m_s[1:] ** 2 + rate_sigma_m_s[:-1] ** 2)
    # Summed away from the middle: where neither is known only what lies beyond is lost.
    step_m = np.where(whole, by_carrier, by_doppler)
    before_m = -np.cumsum(step_m[:middle][::-1], axis=0)[::-1]
    after_m = np.cumsum(step_m[middle:], axis=0)
    motion_m = np.vstack((before_m, np.zeros((1, kept.size)), after_m))

    # Only bridges between cells with a pseudorange, or to the middle, matter.
    present = np.isfinite(observations.pseudorange_m[:, kept])
    present[middle] = True
    needed = np.maximum.accumulate(present, axis=0)[:-1] & np.maximum.accumulate(present[::-1], axis=0)[::-1][1:]
    bridges = ~whole & needed & np.isfinite(by_doppler)
    noise_m2 = np.sum(np.where(bridges, np.nan_to_num(doppler_m2), 0.0), axis=0)
    held_s = _measure_held_s(elapsed_s, observations.doppler_hz[:, kept])
    changed_m = _RATE_PACE_M_S2 * np.maximum(held_s[1:], held_s[:-1]) * dt_s
    return motion_m, noise_m2 + np.sum(np.where(bridges, changed_m, 0.0), axis=0) ** 2


def _measure_held_s(elapsed_s: Reals, values: Reals) -> Reals:
    """Measure how far before a column's first value, or after its last, each epoch lies; 0 for an empty column."""
    present = np.isfinite(values)
    first_s = elapsed_s[present.argmax(axis=0)]
    last_s = elapsed_s[present.shape[0] - 1 - present[::-1].argmax(axis=0)]
    held_s = np.maximum(np.maximum(first_s - elapsed_s[:, None], elapsed_s[:, None] - last_s), 0.0)
    return np.where(present.any(axis=0), held_s, 0.0)


def fill_gaps(elapsed_s: Reals, values: Reals) -> Reals:
    """Fill gaps of columns by straight lines, the ends held; NaN where a column is empty."""
    present = np.isfinite(values)
    filled = np.where(present, values, np.nan)
    for column in np.flatnonzero(present.any(axis=0) & ~present.all(axis=0)):
        known = present[:, column]
        filled[:, column] = np.interp(elapsed_s, elapsed_s[known], values[known, column])
    return filled
