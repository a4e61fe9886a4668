"""Measure how far code minus carrier of each signal moved over an unbroken stretch, and the chance of that.

Code minus carrier is constant but for noise, twice the ionosphere's change, and reflections of the code. A receiver
with separate clocks for codes and carriers changes all signals alike: the median over the signals of each step is
removed. Without a carrier, the integral of the Doppler replaces it, whose noise adds up.

Model. The mean over the last quarter of a stretch less that over the first is normal. Its variance is that of the two
means, of the antenna's multipath, and of the ionosphere; its mean lies between -M and M. A reflection of half the
direct signal's amplitude, with correlators half a chip apart, moves a code by an eighth of a chip at most, to either
side (Kaplan & Hegarty, 9.5): M is a quarter of a chip. A code whose direct signal is blocked may be late by more; that
is a separate cause.
"""

from dataclasses import dataclass

import numpy as np

from skyproof.arrays import Booleans, Indices, Reals
from skyproof.detectors.code_carrier.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Observations
from skyproof.statistics.distributions import normal_two_sided
from skyproof.statistics.medians import medians
from skyproof.statistics.same_rows import group_by_rows

__all__ = ["Divergence", "code_minus_carrier", "estimate_divergences"]


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """change_m : of code minus carrier over time_s, later codes positive. p_value : of "one range"."""

    change_m: float
    time_s: float
    p_value: float


def code_minus_carrier(o: Observations) -> tuple[Reals, Reals]:
    """Compute code minus carrier (n_epochs, n_signals), less the common change, and its accumulated variance.

    By Doppler for signals without any carrier. NaN where there is none, at a slip, or where fewer than four signals had
    a step since the epoch before; the start is arbitrary.
    """
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    gap_s = np.diff(o.elapsed_s)[:, None]
    by_carrier = wavelength_m * np.diff(o.carrier_cyc, axis=0)
    by_doppler = -0.5 * wavelength_m * (o.doppler_hz[1:] + o.doppler_hz[:-1]) * gap_s
    carried = np.isfinite(o.carrier_cyc).any(axis=0)
    steps_m = np.diff(o.pseudorange_m, axis=0) - np.where(carried, by_carrier, by_doppler)
    # Carriers that begin anew are off by any number of cycles, and so would be the median of all.
    steps_m = np.where(carried & o.slipped[1:], np.nan, steps_m)
    variance_m2 = np.where(carried, 0.0, (wavelength_m * o.doppler_sigma_hz[1:] * gap_s) ** 2)
    known = np.isfinite(steps_m)
    enough = known.sum(axis=1) >= POLICY.least_signals
    common_m = np.nan_to_num(medians(steps_m, axis=1))
    own_m = np.where(known & enough[:, None], steps_m - common_m[:, None], np.nan)
    none = np.zeros((1, own_m.shape[1]))
    apart_m = np.vstack([none, np.cumsum(np.nan_to_num(own_m), axis=0)])
    apart_m[1:][np.isnan(own_m)] = np.nan
    gathered_m2 = np.vstack([none, np.cumsum(np.where(known, np.nan_to_num(variance_m2), 0.0), axis=0)])
    return apart_m, gathered_m2


def estimate_divergences(
    elapsed_s: Reals,
    apart_m: Reals,
    code_m2: Reals,
    gathered_m2: Reals,
    chip_m: Reals,
    starts: Indices,
    multipath_sigma_m: float = 0.0,
) -> list[Divergence | None]:
    """Estimate the divergence of each signal (k,) over the unbroken epochs from its start; None if they are few.

    elapsed_s : (n,). apart_m, gathered_m2 : (n, k), as `code_minus_carrier` returns them. code_m2 : (n, k) variance of
    each code.
    chip_m, starts : (k,) of each signal. multipath_sigma_m : of each quarter's mean, one sigma.
    """
    known: Booleans = np.isfinite(apart_m) & (code_m2 > 0.0) & (np.arange(elapsed_s.size)[:, None] >= starts)
    found: list[Divergence | None] = [None] * starts.size
    for rows, columns in group_by_rows(known):
        if rows.size < POLICY.least_epochs:
            continue
        quarter = rows.size // 4
        first, last = rows[:quarter], rows[-quarter:]
        drift_m2 = gathered_m2[rows[-1], columns] - gathered_m2[rows[0], columns]
        change_m = apart_m[np.ix_(last, columns)].mean(axis=0) - apart_m[np.ix_(first, columns)].mean(axis=0)
        time_s = float(elapsed_s[last].mean() - elapsed_s[first].mean())
        noise_m2 = code_m2[np.ix_(first, columns)].mean(axis=0) + code_m2[np.ix_(last, columns)].mean(axis=0)
        lasting_m2 = 2.0 * multipath_sigma_m**2 + (POLICY.ionosphere_sigma_m_s * time_s) ** 2
        sigma_m = np.sqrt(noise_m2 / quarter + drift_m2 + lasting_m2)
        beyond = np.maximum(np.abs(change_m) - POLICY.reflected_chips * chip_m[columns], 0.0) / sigma_m
        for column, change, p_value in zip(columns, change_m.tolist(), normal_two_sided(beyond).tolist(), strict=True):
            found[column] = Divergence(change_m=change, time_s=time_s, p_value=p_value)
    return found
