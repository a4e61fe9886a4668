"""Mark carriers that begin again, or lose cycles, where the receiver does not flag it."""

from dataclasses import replace
from typing import Final

import numpy as np

from skyproof.arrays import Booleans
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import CellStatus, Observations

__all__ = ["mark_slips"]

_STRONGEST_M_S2: Final = 50.0
"""Of any platform, by the policy of `continuity`. Between epochs a position leaves a trapezoid of velocities by a
quarter of it times their distance squared at most, and the mean of the steps before and after by four times that."""
_SURE_SIGMAS: Final = 6.0
"""Noise is mistaken for a slip once in 5e8, at both at once."""


def mark_slips(o: Observations) -> Observations:
    """Mark the cells whose carrier both its code and its Doppler contradict.

    Where a Doppler is missing the carrier's own steps before and after stand for it. A clock that steps takes code and
    carrier along, and codes that jump leave carrier and Doppler unchanged: neither is marked.
    """
    broke = _find_contradicted(o)
    if not broke.any():
        return o
    status = o.status.copy()
    status[1:][broke] = CellStatus.SLIP
    return replace(o, status=status)


def _find_contradicted(o: Observations) -> Booleans:
    """Find the steps (n_epochs - 1, n_channels) of carriers that code and Doppler contradict."""
    wavelength_m = SPEED_OF_LIGHT_M_S / o.carrier_hz
    dt_s = np.diff(o.elapsed_s)[:, None]
    by_carrier = np.diff(o.carrier_cyc, axis=0) * wavelength_m
    by_code = np.diff(o.pseudorange_m, axis=0)
    code_m = _SURE_SIGMAS * np.hypot(o.pseudorange_sigma_m[1:], o.pseudorange_sigma_m[:-1])
    by_doppler = -0.5 * dt_s * wavelength_m * (o.doppler_hz[1:] + o.doppler_hz[:-1])
    doppler_m = 0.5 * _SURE_SIGMAS * dt_s * wavelength_m * np.hypot(o.doppler_sigma_hz[1:], o.doppler_sigma_hz[:-1])
    rate_m_s = by_carrier / dt_s
    beside = np.full_like(by_carrier, np.nan)
    beside[1:-1] = 0.5 * dt_s[1:-1] * (rate_m_s[2:] + rate_m_s[:-2])
    unseen_m = 0.25 * _STRONGEST_M_S2 * dt_s**2
    # NaN contradicts nothing.
    by_rate = np.abs(by_carrier - by_doppler) > unseen_m + doppler_m
    by_rate |= ~np.isfinite(by_doppler) & (np.abs(by_carrier - beside) > 4.0 * unseen_m)
    return by_rate & (np.abs(by_carrier - by_code) > unseen_m + code_m)
