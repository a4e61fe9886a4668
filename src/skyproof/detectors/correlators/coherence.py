"""Test if each signal's code moves as its own Doppler says, which no way of a signal changes: arrays only.

A satellite makes code and carrier from one clock, and both go one way. So the code moves by what the Doppler adds up
to, whatever the receiver's motion and clock, the satellite's clock and orbit, or a reflector alone does. Two ways
together draw a code off by `reflected_chips` of `code_carrier` at most (Kaplan & Hegarty, 9.5). A direct signal that is
blocked, or is there again, leaves its reflection alone: the code jumps once, within a second.

Model. The code's change over a stretch less that of its Doppler, without the second that brings it nearest to zero, is
normal with a mean between -M and M. Its variance is that of four codes, of multipath, and of the Dopplers.
"""

from dataclasses import replace

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.code_carrier.policy import POLICY as CODE_CARRIER
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Observations
from skyproof.statistics.distributions import normal_two_sided

__all__ = ["coherence_p_values", "common_coherence_p_value"]


def common_coherence_p_value(o: Observations, columns: Indices, multipath_sigma_m: float) -> float:
    """Return the p-value of all signals' codes leaving their Dopplers alike, as two oscillators of a receiver do.

    The common rate is that of the signal that explains most.
    """
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz[columns]
    found = []
    for row, column in enumerate(columns.tolist()):
        known = np.flatnonzero(np.isfinite(o.pseudorange_m[:, column]) & np.isfinite(o.doppler_hz[:, column]))
        if known.size < CODE_CARRIER.least_epochs:
            continue
        first, last = known[[0, -1]]
        code_m_s = (o.pseudorange_m[last, column] - o.pseudorange_m[first, column]) / np.ptp(o.elapsed_s[[first, last]])
        rate_m_s = float(code_m_s + wavelength_m[row] * np.mean(o.doppler_hz[known, column]))
        alike = replace(o, doppler_hz=o.doppler_hz - rate_m_s * o.carrier_hz / SPEED_OF_LIGHT_M_S)
        found.append(columns.size * float(coherence_p_values(alike, columns, multipath_sigma_m).min()))
    return min(1.0, max(found, default=1.0))


def coherence_p_values(o: Observations, columns: Indices, multipath_sigma_m: float) -> Reals:
    """Return the p-value (k,) of each signal's code and Doppler having gone one way; 1 where that cannot be tested.

    columns : (k,) of the signals. multipath_sigma_m : of a code, one sigma, beside what two ways draw it off by.
    """
    p_values = np.ones(columns.size)
    for row, column in enumerate(columns.tolist()):
        signal = o.signals[column]
        wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz[column]
        code_m, doppler_hz, doppler_sigma_hz = (
            values[:, column] for values in (o.pseudorange_m, o.doppler_hz, o.doppler_sigma_hz)
        )
        known = np.flatnonzero(np.isfinite(code_m) & np.isfinite(doppler_hz) & np.isfinite(doppler_sigma_hz))
        if known.size < CODE_CARRIER.least_epochs:
            continue
        gap_s = np.diff(o.elapsed_s[known])
        moved_m = -0.5 * wavelength_m * (doppler_hz[known][1:] + doppler_hz[known][:-1]) * gap_s
        steps_m = np.diff(code_m[known]) - moved_m
        seconds = np.floor(o.elapsed_s[known][1:] - o.elapsed_s[known][0]).astype(np.intp)
        total_m = float(steps_m.sum())
        nearest_m = min(abs(total_m), float(np.abs(total_m - np.bincount(seconds, steps_m)).min()))
        drift_m = CODE_CARRIER.ionosphere_sigma_m_s * float(gap_s.sum())
        variance_m2 = (
            4.0 * float(np.mean(o.pseudorange_sigma_m[known, column] ** 2) + multipath_sigma_m**2)
            + float(np.sum((wavelength_m * doppler_sigma_hz[known][1:] * gap_s) ** 2))
            + drift_m**2
        )
        beyond_m = max(nearest_m - CODE_CARRIER.reflected_chips * signal.plan.chip_m, 0.0)
        p_values[row] = float(normal_two_sided(beyond_m / np.sqrt(variance_m2)))
    return p_values
