"""Thermal noise of code, carrier and Doppler that a tracking loop of common design leaves (Kaplan & Hegarty, 8.9)."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals

__all__ = ["carrier_sigma_cyc", "code_sigma_m", "doppler_sigma_hz"]

_DLL_HZ: Final = 1.0
_SPACING_CHIPS: Final = 0.5
_PLL_HZ: Final = 15.0
_INTEGRATION_S: Final = 0.02
_LOWEST_DBHZ, _HIGHEST_DBHZ = 15.0, 60.0  # below, loops of this design lose lock; above, other errors prevail


def _convert_to_linear(cn0_dbhz: ArrayLike) -> Reals:
    return np.asarray(10.0 ** (np.clip(cn0_dbhz, _LOWEST_DBHZ, _HIGHEST_DBHZ) / 10.0), np.float64)


def code_sigma_m(cn0_dbhz: ArrayLike, chip_m: ArrayLike) -> Reals:
    """Compute the standard deviation of a code range, metres, for a chip of `chip_m`; shapes broadcast."""
    cn0 = _convert_to_linear(cn0_dbhz)
    squaring = 1.0 + 2.0 / (_INTEGRATION_S * cn0 * (2.0 - _SPACING_CHIPS))
    return np.asarray(chip_m) * np.sqrt(_DLL_HZ * _SPACING_CHIPS / (2.0 * cn0) * squaring)


def carrier_sigma_cyc(cn0_dbhz: ArrayLike) -> Reals:
    """Compute the standard deviation of a carrier phase, cycles."""
    cn0 = _convert_to_linear(cn0_dbhz)
    return np.asarray(np.sqrt(_PLL_HZ / cn0 * (1.0 + 0.5 / (_INTEGRATION_S * cn0))) / (2.0 * np.pi))


def doppler_sigma_hz(cn0_dbhz: ArrayLike) -> Reals:
    """Compute the standard deviation of a Doppler frequency, hertz."""
    cn0 = _convert_to_linear(cn0_dbhz)
    return np.asarray(
        np.sqrt(4.0 * _PLL_HZ / cn0 * (1.0 + 1.0 / (_INTEGRATION_S * cn0))) / (2.0 * np.pi * _INTEGRATION_S)
    )
