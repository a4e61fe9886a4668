"""Earth-fixed, local and body frames: ECEF WGS-84, geodetic latitude, longitude and height, east-north-up, attitude.

Body axes are forward, right, down; heading is clockwise from true north, pitch is positive with the nose up, roll with
the right side down (Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed.,
2.1.4 and 2.2.1).
"""

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S, WGS84_A_M, WGS84_F

__all__ = [
    "EARTH_RAD_S",
    "ROT_ENU_NED",
    "attitude_ecef",
    "ecef_from_geodetic",
    "geodetic_from_ecef",
    "heading_pitch_roll_rad",
    "rot_enu_ecef",
    "rot_ned_body",
]

_E2 = WGS84_F * (2.0 - WGS84_F)  # first eccentricity squared
_EP2 = _E2 / (1.0 - _E2)  # second eccentricity squared
_B_M = WGS84_A_M * (1.0 - WGS84_F)  # semi-minor axis
EARTH_RAD_S = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
"""The Earth's turn as a vector of ECEF."""
ROT_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # its own inverse


def ecef_from_geodetic(lat_rad: ArrayLike, lon_rad: ArrayLike, height_m: ArrayLike) -> Reals:
    """Convert geodetic coordinates to ECEF positions.

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
    """Convert ECEF positions (..., 3) to latitude (rad), longitude (rad, -pi to pi) and height (m).

    Bowring's formula (Survey Review 23, 1976, 323-327) applied three times: below a nanometre from the depths of the
    sea to the satellites.
    """
    ecef_m = np.asarray(ecef_m, np.float64)
    x_m, y_m, z_m = ecef_m[..., 0], ecef_m[..., 1], ecef_m[..., 2]
    axis_m = np.hypot(x_m, y_m)
    sin_u, cos_u = _normalise(z_m * WGS84_A_M, axis_m * _B_M)
    sin_lat, cos_lat = sin_u, cos_u
    for _ in range(3):
        sin_lat, cos_lat = _normalise(z_m + _EP2 * _B_M * sin_u**3, axis_m - _E2 * WGS84_A_M * cos_u**3)
        sin_u, cos_u = _normalise((1.0 - WGS84_F) * sin_lat, cos_lat)
    height_m = axis_m * cos_lat + z_m * sin_lat - WGS84_A_M * np.sqrt(1.0 - _E2 * sin_lat**2)
    return np.arctan2(sin_lat, cos_lat), np.arctan2(y_m, x_m), height_m


def rot_enu_ecef(lat_rad: ArrayLike, lon_rad: ArrayLike) -> Reals:
    """Return the rotation from ECEF to local east, north, up: `enu = rot @ ecef_difference`. Shape (..., 3, 3)."""
    lat_rad, lon_rad = np.broadcast_arrays(np.asarray(lat_rad, np.float64), np.asarray(lon_rad, np.float64))
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat_rad), np.cos(lat_rad), np.sin(lon_rad), np.cos(lon_rad)
    east = np.stack((-sin_lon, cos_lon, np.zeros_like(sin_lon)), axis=-1)
    north = np.stack((-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat), axis=-1)
    up = np.stack((cos_lat * cos_lon, cos_lat * sin_lon, sin_lat), axis=-1)
    return np.stack((east, north, up), axis=-2)


def attitude_ecef(
    position_ecef_m: ArrayLike, heading_rad: ArrayLike, pitch_rad: ArrayLike, roll_rad: ArrayLike
) -> Reals:
    """Compute rotations (..., 3, 3) from body to ECEF at positions (..., 3); angles broadcast with (...)."""
    rot_ecef_enu = np.swapaxes(rot_enu_ecef(*geodetic_from_ecef(position_ecef_m)[:2]), -1, -2)
    return np.asarray(rot_ecef_enu @ ROT_ENU_NED @ rot_ned_body(heading_rad, pitch_rad, roll_rad))


def heading_pitch_roll_rad(position_ecef_m: ArrayLike, attitude: ArrayLike) -> tuple[Reals, Reals, Reals]:
    """Convert rotations (..., 3, 3) from body to ECEF to angles (...).

    Heading is from 0 to 2 pi, roll from -pi to pi.
    """
    rot_enu = rot_enu_ecef(*geodetic_from_ecef(position_ecef_m)[:2])
    rot = ROT_ENU_NED @ rot_enu @ np.asarray(attitude, np.float64)
    heading_rad = np.arctan2(rot[..., 1, 0], rot[..., 0, 0]) % (2.0 * np.pi)
    pitch_rad = np.arcsin(np.clip(-rot[..., 2, 0], -1.0, 1.0))
    return heading_rad, pitch_rad, np.arctan2(rot[..., 2, 1], rot[..., 2, 2])


def rot_ned_body(heading_rad: ArrayLike, pitch_rad: ArrayLike, roll_rad: ArrayLike) -> Reals:
    """Compute rotations (..., 3, 3) from body to north, east, down; angles broadcast."""
    angles = np.broadcast_arrays(*(np.asarray(angle, np.float64) for angle in (heading_rad, pitch_rad, roll_rad)))
    (sh, sp, sr), (ch, cp, cr) = ([turn(angle) for angle in angles] for turn in (np.sin, np.cos))
    rows = (
        (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr),
        (sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _normalise(y: Reals, x: Reals) -> tuple[Reals, Reals]:
    length = np.hypot(y, x)
    return y / length, x / length
