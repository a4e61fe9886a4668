"""Model one satellite's signals on a grid of delays and Dopplers, behind a front end's filter.

The formula is from S. Ahmed, S. Khanafseh, B. Pervan, "GNSS Spoofing Detection and Exclusion by Decomposition of
Complex Cross Ambiguity Function (DCCAF) with INS Aiding", ION, equation 4, corrected. A signal has amplitude a, delay
tau, Doppler f and phase theta. Over a coherent time T, it gives a replica of delay taub and Doppler fb

    a R(taub - tau) sinc(pi (f - fb) T) exp(i (pi (f - fb) T + theta)),    theta the phase at the start,

The term pi (f - fb) T drops out if theta is the phase at the middle, as everywhere here but in `model_as_printed`.
R is that of the band that the front end passes. With the triangle there is no bound, and the wrong answer.

Leading axes are free. Delays are in chips, larger for a longer way.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals
from skyproof.gnss.signals import SignalPlan

__all__ = ["band_share", "correlation", "correlation_slope"]


def correlation(lag_chips: ArrayLike, band_hz: float, signal: SignalPlan) -> Reals:
    """Compute R at lags (...), one at zero, of random chips through an ideal filter of two-sided width `band_hz`.

    R is the integral of sinc^2(pi f) cos(2 pi f x) over |f| <= b, b = band / 2 in cycles per chip. In closed form it is
    the second difference of G(y) = (cos(2 pi b y) - 1) / (pi^2 b) + (2/pi) y Si(2 pi b y), which is |y| without a
    limit.
    """
    lag, b = np.asarray(lag_chips, np.float64), _half_band(band_hz, signal)
    second = _g(lag + 1.0, b) + _g(lag - 1.0, b) - 2.0 * _g(lag, b)
    return np.asarray(0.5 * second / band_share(band_hz, signal))


def correlation_slope(lag_chips: ArrayLike, band_hz: float, signal: SignalPlan) -> Reals:
    """Compute the derivative of `correlation` by the lag, per chip."""
    lag, b = np.asarray(lag_chips, np.float64), _half_band(band_hz, signal)
    second = _dg(lag + 1.0, b) + _dg(lag - 1.0, b) - 2.0 * _dg(lag, b)
    return np.asarray(0.5 * second / band_share(band_hz, signal))


def band_share(band_hz: float, signal: SignalPlan) -> float:
    """Return the share of the code's power in the band: of C/A 0.957 for 5 MHz, 0.992 for 25 MHz."""
    return float(_g(np.asarray(1.0), _half_band(band_hz, signal)))


def _half_band(band_hz: float, signal: SignalPlan) -> float:
    """Return half the band, in cycles per chip."""
    return band_hz / (2.0 * signal.chip_rate_hz)


def _g(y: Reals, b: float) -> Reals:
    angle = 2.0 * np.pi * b * y
    return np.asarray((np.cos(angle) - 1.0) / (np.pi**2 * b) + 2.0 / np.pi * y * special.sici(angle)[0])


def _dg(y: Reals, b: float) -> Reals:
    return np.asarray(2.0 / np.pi * special.sici(2.0 * np.pi * b * y)[0])
