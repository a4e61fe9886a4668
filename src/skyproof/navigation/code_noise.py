"""Measure the noise of codes against what is stated of it, by how code minus carrier changes from epoch to epoch.

Ionosphere, clock and motion cancel or hardly change, and a median passes over slips, jumps and attacks. Where a file
states no sigma that of thermal noise is assumed from C/N0, and a receiver may be noisier than that.
"""

from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import CellStatus, Kind, Observations

__all__ = ["compare_code_noise", "estimate_noise_factors", "raise_code_sigmas"]

_TO_SIGMA: Final = 1.4826
"""From the median of |x| to the standard deviation of a normal x."""
_MEDIAN_ERROR: Final = 1.167
"""Standard deviation of that estimate times the root of the number, over the sigma (Kay, Estimation Theory, 3)."""
_SURE_SIGMAS: Final = 5.0


def compare_code_noise(o: Observations) -> dict[Kind, tuple[float, int]]:
    """Compare changes of code minus carrier with their stated sigma.

    Returns for each kind of signal the standard deviation over the stated one, and the number of changes.
    """
    apart_m = o.pseudorange_m - o.carrier_cyc * (SPEED_OF_LIGHT_M_S / o.carrier_hz)
    sigma_m = np.hypot(o.pseudorange_sigma_m[1:], o.pseudorange_sigma_m[:-1])
    ratio = np.where(o.status[1:] != CellStatus.SLIP, np.abs(np.diff(apart_m, axis=0)) / sigma_m, np.nan)
    columns: dict[Kind, list[int]] = {}
    for column, signal in enumerate(o.signals):
        columns.setdefault(signal.kind, []).append(column)
    found = {}
    for kind, of_kind in columns.items():
        known = ratio[:, of_kind][np.isfinite(ratio[:, of_kind])]
        if known.size:
            found[kind] = _TO_SIGMA * float(np.median(known)), int(known.size)
    return found


def estimate_noise_factors(parts: Iterable[Mapping[Kind, tuple[float, int]]]) -> dict[Kind, float]:
    """Estimate by which factor each kind's noise is larger than stated, of the kinds for which it surely is.

    parts : of the stretches of a file, as `compare_code_noise` gives them.
    """
    ratios: dict[Kind, list[tuple[float, int]]] = {}
    for part in parts:
        for kind, found in part.items():
            ratios.setdefault(kind, []).append(found)
    factors = {}
    for kind, found_of in ratios.items():
        ratio, number = np.array(found_of).T
        factor = float(np.average(ratio, weights=number))
        if factor > 1.0 + _SURE_SIGMAS * _MEDIAN_ERROR / np.sqrt(number.sum()):
            factors[kind] = factor
    return factors


def raise_code_sigmas(o: Observations, factors: Mapping[Kind, float]) -> Reals:
    """Raise the sigmas of the codes (n_epochs, n_signals) by each kind's factor."""
    return np.asarray(o.pseudorange_sigma_m * np.array([factors.get(signal.kind, 1.0) for signal in o.signals]))
