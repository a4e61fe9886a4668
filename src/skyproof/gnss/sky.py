"""Directions of satellites seen from a receiver. Positions are ECEF; `rx` and `sat` broadcast over leading axes."""

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef

__all__ = ["compute_azimuth_elevation", "compute_unit_vectors", "rotate_to_reception"]


def compute_azimuth_elevation(rx_ecef_m: ArrayLike, sat_ecef_m: ArrayLike) -> tuple[Reals, Reals]:
    """Compute azimuth (0 to 2 pi, from north over east) and elevation (-pi/2 to pi/2), rad.

    The elevation is above the ellipsoid's tangent.

    Parameters
    ----------
    rx_ecef_m, sat_ecef_m : (..., 3) in one frame: the satellite's after `rotate_to_reception`.
    """
    rx_ecef_m = np.asarray(rx_ecef_m, np.float64)
    lat_rad, lon_rad, _ = geodetic_from_ecef(rx_ecef_m)
    difference_m = np.asarray(sat_ecef_m, np.float64) - rx_ecef_m
    enu_m = np.einsum("...ij,...j->...i", rot_enu_ecef(lat_rad, lon_rad), difference_m)
    az_rad = np.mod(np.arctan2(enu_m[..., 0], enu_m[..., 1]), 2.0 * np.pi)
    el_rad = np.arctan2(enu_m[..., 2], np.hypot(enu_m[..., 0], enu_m[..., 1]))
    return az_rad, el_rad


def rotate_to_reception(sat_ecef_m: ArrayLike, travel_s: ArrayLike) -> Reals:
    """Rotate ECEF at transmission to ECEF at reception, `travel_s` later (IS-GPS-200N, 20.3.3.4.3.4).

    Parameters
    ----------
    sat_ecef_m : (..., 3); works for velocities too, to the extent that Earth's rotation is constant.
    travel_s : (...) time of transmission to time of reception.
    """
    sat_ecef_m = np.asarray(sat_ecef_m, np.float64)
    angle_rad = EARTH_ROTATION_RAD_S * np.asarray(travel_s, np.float64)
    sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
    x_m, y_m, z_m = sat_ecef_m[..., 0], sat_ecef_m[..., 1], sat_ecef_m[..., 2]
    x_m, y_m = cosine * x_m + sine * y_m, cosine * y_m - sine * x_m
    return np.stack((x_m, y_m, np.broadcast_to(z_m, x_m.shape)), axis=-1)


def compute_unit_vectors(rx_ecef_m: ArrayLike, sat_ecef_m: ArrayLike) -> Reals:
    """Compute unit vectors from receiver to satellite, shape (..., 3), in the frame of the arguments."""
    difference_m = np.asarray(sat_ecef_m, np.float64) - np.asarray(rx_ecef_m, np.float64)
    return np.asarray(difference_m / np.linalg.norm(difference_m, axis=-1, keepdims=True))
