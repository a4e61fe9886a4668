"""Compare phases of carriers before and after a moment at which nearly all of them broke: arrays only.

What breaks all carriers of one antenna at once (a shock to the oscillator, a short loss) changes their phases alike.
An exchange of the sky for another one, as by a switch in the antenna's cable, changes each by another part of a cycle.

Model. A carrier's change over the break, less what its Dopplers add up to, is common to all but for noise, for the
error of the Dopplers, and for what the antenna moved beside its mean velocity. Data bits leave half a cycle open. The
squared distance from the common phase is chi-square with one degree less than there are signals. Missing or repeated
samples change each phase by its Doppler times their length, which codes show but for whole periods.
"""

from typing import NamedTuple

import numpy as np

from skyproof.arrays import Indices
from skyproof.detectors.carrier_break.policy import POLICY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import CellStatus, Observations
from skyproof.statistics.distributions import chi_square_survival
from skyproof.statistics.medians import medians

__all__ = ["Break", "compare_phases", "find_breaks"]


class Break(NamedTuple):
    """A break of nearly all carriers: rows of the last epoch before and the first after, columns (n,) that broke."""

    before: int
    after: int
    columns: Indices


def find_breaks(o: Observations) -> list[Break]:
    """Find the epochs at which nearly all carriers that were measured shortly before slipped."""
    measured = np.isfinite(o.carrier_cyc) & np.isfinite(o.doppler_hz)
    slipped = measured & (o.status == CellStatus.SLIP)
    found = []
    for after in np.flatnonzero(slipped.sum(axis=1) >= POLICY.least_signals).tolist():
        near = np.flatnonzero(o.elapsed_s[:after] >= o.elapsed_s[after] - POLICY.longest_s)
        rows = [row for row in near.tolist() if (measured[row] & slipped[after]).sum() >= POLICY.least_signals]
        if not rows:
            continue
        before = rows[-1]
        columns = np.flatnonzero(measured[before] & slipped[after])
        if columns.size >= POLICY.together_share * (measured[before] & measured[after]).sum():
            found.append(Break(before, after, columns))
    return found


def compare_phases(o: Observations, broken: Break, velocity_sigma_m_s: float) -> tuple[float, float]:
    """Return the p-value of phases that changed alike, and by how much they differ, root mean square, cycles.

    1 and NaN where they tell nothing. velocity_sigma_m_s : by which the antenna's velocity may differ from its mean.
    """
    ends, columns = np.array([broken.before, broken.after]), broken.columns
    time_s = float(np.diff(o.elapsed_s[ends])[0])
    beside = [slice(max(broken.before - POLICY.beside_epochs, 0), broken.before), slice(broken.after + 1, None)]
    doppler_hz = np.array([medians(o.doppler_hz[rows][: POLICY.beside_epochs, columns], axis=0) for rows in beside])
    sigma_hz = o.doppler_sigma_hz[np.ix_(ends, columns)]
    code_m, carrier_cyc = o.pseudorange_m[np.ix_(ends, columns)], o.carrier_cyc[np.ix_(ends, columns)]
    mean_hz, wavelength_m = doppler_hz.mean(axis=0), SPEED_OF_LIGHT_M_S / o.carrier_hz[columns]
    change_cyc = np.diff(carrier_cyc, axis=0)[0] + time_s * mean_hz
    variance = (
        (o.carrier_sigma_cyc[np.ix_(ends, columns)] ** 2).sum(axis=0)
        + 0.25 * time_s**2 * (sigma_hz**2).sum(axis=0)
        + (velocity_sigma_m_s * time_s / wavelength_m) ** 2
        + 2.0 * POLICY.carrier_error_cyc**2
    )
    if not np.sqrt(variance.max()) < POLICY.most_sigma_cyc:  # NaN where a Doppler is missing
        return 1.0, np.nan
    jump_s = float(medians(np.diff(code_m, axis=0)[0] + wavelength_m * time_s * mean_hz)) / SPEED_OF_LIGHT_M_S
    turns = np.exp(4j * np.pi * (change_cyc + np.array([[0.0], [jump_s]]) * mean_hz))
    off_cyc = np.angle(turns / np.sum(turns / variance, axis=1, keepdims=True)) / (4.0 * np.pi)
    statistic = np.sum(off_cyc**2 / variance, axis=1)
    p_value = float(chi_square_survival(statistic.min(), columns.size - 1))
    return p_value, float(np.sqrt(np.mean(off_cyc[0] ** 2)))
