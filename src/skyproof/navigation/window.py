"""One value per channel for a whole window: pseudoranges brought to the middle epoch by their own carrier."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.gnss.constants import FASTEST_M_S, SPEED_OF_LIGHT_M_S
from skyproof.records import CellStatus, Observations, SignalId

__all__ = ["WindowMean", "fill_gaps", "interval_s", "window_mean"]

_RATE_PACE_M_S2: Final = 0.18
"""At which a range rate changes at most where the receiver stands: R r n^2 / (r - R) of a satellite at the zenith, with
r = 26 560 km and n = 1.459e-4 rad/s of GPS. So much a Doppler is off that is taken from another epoch."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WindowMean:
    """gpst : label of the middle epoch. signals, pseudorange_m, sigma_m, carrier_hz (n,) : one for each channel that is
    kept."""

    gpst: np.datetime64
    signals: tuple[SignalId, ...]
    pseudorange_m: Reals
    sigma_m: Reals
    carrier_hz: Reals


def interval_s(elapsed_s: Reals) -> float:
    """The usual time from one epoch to the next, seconds, of epochs at `elapsed_s` (n,); 0 of fewer than two."""
    step_s = np.diff(elapsed_s)
    return float(np.median(step_s)) if step_s.size else 0.0


@lru_cache(16)  # several tests look at the same windows
def window_mean(observations: Observations, *, min_share: float = 0.5) -> WindowMean:
    """Pseudoranges at the window's middle epoch: carrier there plus the mean of (code - carrier) over the window.

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
    there = np.isfinite(observations.pseudorange_m) & np.isfinite(observations.pseudorange_sigma_m)
    kept = np.flatnonzero(there.mean(axis=0) >= max(min_share, 0.5 / n))
    there = there[:, kept]
    motion_m, bridge_m2 = _motion(observations, kept, middle)
    code_m = np.where(there, observations.pseudorange_m[:, kept], 0.0)
    weight = np.where(there, 1.0 / np.where(there, observations.pseudorange_sigma_m[:, kept], 1.0) ** 2, 0.0)
    weight = np.where(np.isfinite(motion_m), weight, 0.0)  # cut off by a gap in both carrier and Doppler
    total = weight.sum(axis=0)
    usable = total > 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_m = np.sum(weight * (code_m - np.nan_to_num(motion_m)), axis=0) / total
        sigma_m = np.sqrt(1.0 / total + bridge_m2)
    return WindowMean(
        gpst=observations.gpst[middle],
        signals=tuple(observations.signals[k] for k in kept[usable]),
        pseudorange_m=mean_m[usable],
        sigma_m=sigma_m[usable],
        carrier_hz=observations.carrier_hz[kept[usable]],
    )


def _motion(observations: Observations, kept: Indices, middle: int) -> tuple[Reals, Reals]:
    """Range at each epoch minus range at the middle, (n, kept), and the variance that bridges by Doppler add."""
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
    there = np.isfinite(observations.pseudorange_m[:, kept])
    there[middle] = True
    needed = np.maximum.accumulate(there, axis=0)[:-1] & np.maximum.accumulate(there[::-1], axis=0)[::-1][1:]
    bridges = ~whole & needed & np.isfinite(by_doppler)
    noise_m2 = np.sum(np.where(bridges, np.nan_to_num(doppler_m2), 0.0), axis=0)
    held_s = _held_s(elapsed_s, observations.doppler_hz[:, kept])
    changed_m = _RATE_PACE_M_S2 * np.maximum(held_s[1:], held_s[:-1]) * dt_s
    return motion_m, noise_m2 + np.sum(np.where(bridges, changed_m, 0.0), axis=0) ** 2


def _held_s(elapsed_s: Reals, values: Reals) -> Reals:
    """How far before the first value of a column, or after its last, each epoch lies; 0 where there is none."""
    there = np.isfinite(values)
    first_s = elapsed_s[there.argmax(axis=0)]
    last_s = elapsed_s[there.shape[0] - 1 - there[::-1].argmax(axis=0)]
    held_s = np.maximum(np.maximum(first_s - elapsed_s[:, None], elapsed_s[:, None] - last_s), 0.0)
    return np.where(there.any(axis=0), held_s, 0.0)


def fill_gaps(elapsed_s: Reals, values: Reals) -> Reals:
    """Columns with their gaps filled by straight lines, the ends held; NaN where a column has nothing."""
    there = np.isfinite(values)
    filled = np.where(there, values, np.nan)
    for column in np.flatnonzero(there.any(axis=0) & ~there.all(axis=0)):
        known = there[:, column]
        filled[:, column] = np.interp(elapsed_s, elapsed_s[known], values[known, column])
    return filled
