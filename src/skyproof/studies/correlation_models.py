"""Models of a correlation as the paper prints them and corrected, beside the one that is fitted."""

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Complexes
from skyproof.decomposition.correlation import correlation
from skyproof.gnss.signals import GPS_L1_CA

__all__ = ["model", "model_as_printed"]


def model(
    amplitude: ArrayLike,
    delay_chips: ArrayLike,
    doppler_hz: ArrayLike,
    *,
    taps_chips: ArrayLike,
    bins_hz: ArrayLike = 0.0,
    coherent_s: float,
    band_hz: float,
) -> Complexes:
    """Model signals (..., n) of complex amplitude (phase at mid-interval) on a grid (..., bins, taps)."""
    lag = np.atleast_1d(taps_chips) - np.asarray(delay_chips, np.float64)[..., None]
    off = np.asarray(doppler_hz, np.float64)[..., None] - np.atleast_1d(bins_hz)
    each = np.sinc(off * coherent_s)[..., :, None] * correlation(lag, band_hz, GPS_L1_CA)[..., None, :]
    return np.asarray(np.sum(np.asarray(amplitude, np.complex128)[..., None, None] * each, axis=-3))


def model_as_printed(
    amplitude: ArrayLike, doppler_off_hz: ArrayLike, phase_rad: ArrayLike, coherent_s: float, *, form: str = "corrected"
) -> Complexes:
    """Compute the factor beside R of the paper's equation 4, phase at the start of the interval.

    In print the phase stands inside the factor pi.
    """
    turn, phase = np.asarray(doppler_off_hz, np.float64) * coherent_s, np.asarray(phase_rad, np.float64)
    angle = np.pi * (turn + phase) if form == "paper" else np.pi * turn + phase
    return np.asarray(np.asarray(amplitude) * np.sinc(turn) * np.exp(1j * angle))
