"""Earth-fixed and local frames: ECEF WGS-84, geodetic latitude, longitude and height, east-north-up."""

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.constants import WGS84_A_M, WGS84_F

__all__ = ["ecef_from_geodetic", "geodetic_from_ecef", "rot_enu_ecef"]

_E2 = WGS84_F * (2.0 - WGS84_F)  # first eccentricity squared
_EP2 = _E2 / (1.0 - _E2)  # second eccentricity squared
_B_M = WGS84_A_M * (1.0 - WGS84_F)  # semi-minor axis


def ecef_from_geodetic(lat_rad: ArrayLike, lon_rad: ArrayLike, height_m: ArrayLike) -> Reals:
    """ECEF position of geodetic coordinates.

    Parameters
    ----------
    lat_rad, lon_rad, height_m : any shapes (...) that broadcast; height above the ellipsoid.

    Returns
    -------
    ndarray, shape (..., 3).
    """
    lat_rad, lon_rad, height_m = np.broadcast_arrays(
        np.asarray(lat_rad, np.float64), np.asarray(lon_rad, np.float64), np.asarray(height_m, np.float64)
    )
    sin_lat, cos_lat = np.sin(lat_rad), np.cos(lat_rad)
    normal_m = WGS84_A_M / np.sqrt(1.0 - _E2 * sin_lat**2)
    axis_m = (normal_m + height_m) * cos_lat
    return np.stack(
        (axis_m * np.cos(lon_rad), axis_m * np.sin(lon_rad), (normal_m * (1.0 - _E2) + height_m) * sin_lat), axis=-1
    )


def geodetic_from_ecef(ecef_m: ArrayLike) -> tuple[Reals, Reals, Reals]:
    """Geodetic latitude (rad), longitude (rad, -pi to pi) and height (m) of ECEF positions of shape (..., 3).

    Bowring's formula (Survey Review 23, 1976, 323-327) applied three times: below a nanometre from the depths of the
    sea to the satellites.
    """
    ecef_m = np.asarray(ecef_m, np.float64)
    x_m, y_m, z_m = ecef_m[..., 0], ecef_m[..., 1], ecef_m[..., 2]
    axis_m = np.hypot(x_m, y_m)
    sin_u, cos_u = _unit(z_m * WGS84_A_M, axis_m * _B_M)
    sin_lat, cos_lat = sin_u, cos_u
    for _ in range(3):
        sin_lat, cos_lat = _unit(z_m + _EP2 * _B_M * sin_u**3, axis_m - _E2 * WGS84_A_M * cos_u**3)
        sin_u, cos_u = _unit((1.0 - WGS84_F) * sin_lat, cos_lat)
    height_m = axis_m * cos_lat + z_m * sin_lat - WGS84_A_M * np.sqrt(1.0 - _E2 * sin_lat**2)
    return np.arctan2(sin_lat, cos_lat), np.arctan2(y_m, x_m), height_m


def rot_enu_ecef(lat_rad: ArrayLike, lon_rad: ArrayLike) -> Reals:
    """Rotation from ECEF to local east, north, up: `enu = rot @ ecef_difference`. Shape (..., 3, 3)."""
    lat_rad, lon_rad = np.broadcast_arrays(np.asarray(lat_rad, np.float64), np.asarray(lon_rad, np.float64))
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat_rad), np.cos(lat_rad), np.sin(lon_rad), np.cos(lon_rad)
    east = np.stack((-sin_lon, cos_lon, np.zeros_like(sin_lon)), axis=-1)
    north = np.stack((-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat), axis=-1)
    up = np.stack((cos_lat * cos_lon, cos_lat * sin_lon, sin_lat), axis=-1)
    return np.stack((east, north, up), axis=-2)


def _unit(y: Reals, x: Reals) -> tuple[Reals, Reals]:
    length = np.hypot(y, x)
    return y / length, x / length
