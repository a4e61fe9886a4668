"""Test if each signal's code moves as its own Doppler says, which no way of a signal changes: arrays only.

A satellite makes code and carrier from one clock, and both go one way. So the code moves by what the Doppler adds up
to, whatever the receiver's motion and clock, the satellite's clock and orbit, or a reflector alone does. Two ways
together draw a code off by `reflected_chips` of `code_carrier` at most (Kaplan & Hegarty, 9.5). A direct signal that is
blocked, or is there again, leaves its reflection alone: the code jumps within a second, and back or to another
reflection later.

A channel that holds the cross-correlation of a strong signal has that signal's code, and its carrier off by a multiple
of the code's repetition rate (Kaplan & Hegarty, 8.7): with that multiple, or without, they must go one way.

Model. The code's change over a stretch less that of its Doppler, without the half of its seconds that bring it nearest
to zero, is normal with a mean between -M and M. Its variance is that of four codes, of multipath, and of the Dopplers.
"""

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.code_carrier.policy import POLICY as CODE_CARRIER
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Observations
from skyproof.statistics.distributions import normal_two_sided

__all__ = ["coherence_p_values", "measure_parting_m_s"]


def measure_parting_m_s(o: Observations, columns: Indices) -> Reals:
    """Measure the rate (k,) at which each signal's code leaves its Doppler, in the middle of its epochs, m/s.

    NaN with too few epochs.
    """
    found = np.full(columns.size, np.nan)
    for row, column in enumerate(columns.tolist()):
        known, steps_m = _leave_doppler(o, column)
        if known.size >= CODE_CARRIER.least_epochs:
            found[row] = np.median(steps_m / np.diff(o.elapsed_s[known]))
    return found


def coherence_p_values(o: Observations, columns: Indices, multipath_sigma_m: float, rate_m_s: float = 0.0) -> Reals:
    """Return the p-value (k,) of each signal's code and Doppler having gone one way; 1 where that cannot be tested.

    columns : (k,) of the signals. multipath_sigma_m : of a code, one sigma, beside what two ways draw it off by.
    rate_m_s : at which two oscillators of a receiver part all codes from their Dopplers.
    """
    p_values = np.ones(columns.size)
    for row, column in enumerate(columns.tolist()):
        plan = o.signals[column].plan
        known, steps_m = _leave_doppler(o, column)
        if known.size < CODE_CARRIER.least_epochs:
            continue
        elapsed_s, wavelength_m = o.elapsed_s[known], SPEED_OF_LIGHT_M_S / o.carrier_hz[column]
        gap_s = np.diff(elapsed_s)
        steps_m = steps_m - rate_m_s * gap_s
        repeated_m_s = wavelength_m / plan.period_s
        held_m_s = repeated_m_s * np.rint(np.median(steps_m / gap_s) / repeated_m_s)
        seconds = np.floor(elapsed_s[1:] - elapsed_s[0]).astype(np.intp)
        nearest_m = min(
            _leave_out_half(np.bincount(seconds, steps_m - rate * gap_s).astype(np.float64)) for rate in (0.0, held_m_s)
        )
        variance_m2 = (
            4.0 * float(np.mean(o.pseudorange_sigma_m[known, column] ** 2) + multipath_sigma_m**2)
            + float(np.sum((wavelength_m * o.doppler_sigma_hz[known, column][1:] * gap_s) ** 2))
            + (CODE_CARRIER.ionosphere_sigma_m_s * float(gap_s.sum())) ** 2
        )
        beyond_m = max(nearest_m - CODE_CARRIER.reflected_chips * plan.chip_m, 0.0)
        p_values[row] = float(normal_two_sided(beyond_m / np.sqrt(variance_m2)))
    return p_values


def _leave_doppler(o: Observations, column: int) -> tuple[Indices, Reals]:
    """Return the epochs of a signal with code and Doppler, and by how much the code left it between them, m."""
    code_m, doppler_hz = o.pseudorange_m[:, column], o.doppler_hz[:, column]
    known = np.flatnonzero(np.isfinite(code_m) & np.isfinite(doppler_hz) & np.isfinite(o.doppler_sigma_hz[:, column]))
    moved_hz = 0.5 * (doppler_hz[known][1:] + doppler_hz[known][:-1])
    moved_m = -SPEED_OF_LIGHT_M_S / o.carrier_hz[column] * moved_hz * np.diff(o.elapsed_s[known])
    return known, np.diff(code_m[known]) - moved_m


def _leave_out_half(by_second_m: Reals) -> float:
    """Return how near to zero the sum of all seconds but up to half of them comes, m."""
    total_m = float(by_second_m.sum())
    along_m = np.sort(np.maximum(np.sign(total_m) * by_second_m, 0.0))[::-1]
    return max(abs(total_m) - float(along_m[: by_second_m.size // 2].sum()), 0.0)
