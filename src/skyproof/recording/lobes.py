"""Correlate signals over a whole code period, for pictures: plain sums of powers, without a search."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy import fft

from skyproof.arrays import Floats, Reals
from skyproof.gnss.signals import GPS_L1_CA, SignalPlan, prn_of

__all__ = ["CELLS_PER_CHIP", "compute_correlation_power"]

CELLS_PER_CHIP: Final = 2


def compute_correlation_power(
    samples: Floats,
    rate_hz: float,
    carriers_hz: Mapping[str, float],
    *,
    signal: SignalPlan = GPS_L1_CA,
) -> dict[str, Reals]:
    """Compute each satellite's code power at all delays over the median, which noise has.

    Powers of the periods are added.

    Parameters
    ----------
    samples : (2, n), whole code periods are used. carriers_hz : where each signal's carrier lies in them.

    Returns
    -------
    for each satellite (code_length * CELLS_PER_CHIP,): delay of the code's start after the first sample, ascending.
    """
    per_period = rate_hz * signal.period_s
    n_periods, size = int(samples.shape[1] / per_period + 1e-9), round(per_period)
    starts = np.minimum(np.round(np.arange(n_periods) * per_period), samples.shape[1] - size).astype(np.int64)
    blocks = np.stack([samples[0, at : at + size] + 1j * samples[1, at : at + size] for at in starts])
    n_cells = signal.code_length * CELLS_PER_CHIP
    reach = min(n_cells // 2 - 1, (size - 1) // 2)
    bins = np.arange(-reach, reach + 1)
    powers = {}
    for sat, carrier_hz in carriers_hz.items():
        turns = np.mod(carrier_hz / rate_hz * np.arange(size), 1.0)
        spectra = fft.fft(blocks * np.exp(-2j * np.pi * turns), axis=1)[:, bins]
        chips = np.repeat(signal.code(prn_of(sat)).astype(np.float64), CELLS_PER_CHIP)
        products = np.zeros((n_periods, n_cells), np.complex128)
        products[:, bins] = spectra * np.conj(fft.fft(chips)[bins])
        power = np.sum(np.abs(fft.ifft(products, axis=1)) ** 2, axis=0)
        powers[sat] = power / np.median(power)
    return powers
