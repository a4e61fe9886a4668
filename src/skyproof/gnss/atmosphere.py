"""Delays of the ionosphere and the troposphere, as models that need no measurement. Shapes broadcast."""

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.constants import SECONDS_PER_DAY
from skyproof.gnss.ephemeris import Klobuchar

__all__ = ["compute_klobuchar_s", "compute_saastamoinen_m", "compute_troposphere_m"]


def compute_klobuchar_s(
    klobuchar: Klobuchar, lat_rad: ArrayLike, lon_rad: ArrayLike, az_rad: ArrayLike, el_rad: ArrayLike, tow_s: ArrayLike
) -> Reals:
    """Compute the delay of the L1 code by the ionosphere in seconds (IS-GPS-200N, 20.3.3.5.2.5).

    The carrier is early by as much.

    Parameters
    ----------
    lat_rad, lon_rad : geodetic place of the receiver.
    az_rad, el_rad : of the satellite.
    tow_s : GPS seconds of week (only the time of day counts).
    """
    lat, lon, el, az = (np.asarray(angle, np.float64) for angle in (lat_rad, lon_rad, el_rad, az_rad))
    lat, lon, el = lat / np.pi, lon / np.pi, el / np.pi  # semicircles, as the standard counts
    psi = 0.0137 / (el + 0.11) - 0.022  # Earth angle between receiver and piercing point
    lat_i = np.clip(lat + psi * np.cos(az), -0.416, 0.416)
    lon_i = lon + psi * np.sin(az) / np.cos(lat_i * np.pi)
    lat_m = lat_i + 0.064 * np.cos((lon_i - 1.617) * np.pi)  # geomagnetic
    local_s = np.mod(43200.0 * lon_i + np.asarray(tow_s, np.float64), SECONDS_PER_DAY)
    obliquity = 1.0 + 16.0 * (0.53 - el) ** 3
    amplitude_s = np.maximum(np.polynomial.polynomial.polyval(lat_m, klobuchar.alpha), 0.0)
    period_s = np.maximum(np.polynomial.polynomial.polyval(lat_m, klobuchar.beta), 72000.0)
    x = 2.0 * np.pi * (local_s - 50400.0) / period_s
    day = np.where(np.abs(x) < 1.57, amplitude_s * (1.0 - x**2 / 2.0 + x**4 / 24.0), 0.0)
    return np.asarray(obliquity * (5e-9 + day))


def compute_saastamoinen_m(lat_rad: ArrayLike, height_m: ArrayLike, humidity: float = 0.6) -> Reals:
    """Compute the zenith delay of the troposphere, hydrostatic and wet, in the standard atmosphere, metres.

    Saastamoinen, "Atmospheric correction for the troposphere and stratosphere in radio ranging of satellites", Geophys.
    Monogr. 15, 1972; ICAO standard atmosphere with 1013.25 hPa and 15 C at sea level. Heights are held to
    0..11000 m, the layer that the model knows; `humidity` is relative, 0 to 1, at any height.
    """
    height_m = np.clip(np.asarray(height_m, np.float64), 0.0, 11000.0)
    pressure_hpa = 1013.25 * (1.0 - 2.2557e-5 * height_m) ** 5.2568
    temperature_k = 15.0 - 6.5e-3 * height_m + 273.15
    vapour_hpa = 6.108 * humidity * np.exp((17.15 * temperature_k - 4684.0) / (temperature_k - 38.45))
    gravity = 1.0 - 0.00266 * np.cos(2.0 * np.asarray(lat_rad, np.float64)) - 0.00028e-3 * height_m
    return np.asarray(0.0022768 * pressure_hpa / gravity + 0.002277 * (1255.0 / temperature_k + 0.05) * vapour_hpa)


def compute_troposphere_m(lat_rad: ArrayLike, height_m: ArrayLike, el_rad: ArrayLike, humidity: float = 0.6) -> Reals:
    """Compute the delay towards elevation `el_rad` in metres.

    The zenith delay is mapped by RTCA DO-229, A.4.2.4, good above 4 degrees.
    """
    mapping = 1.001 / np.sqrt(0.002001 + np.sin(np.asarray(el_rad, np.float64)) ** 2)
    return np.asarray(compute_saastamoinen_m(lat_rad, height_m, humidity) * mapping)
