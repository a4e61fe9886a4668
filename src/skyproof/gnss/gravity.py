"""Normal gravity of WGS-84: the pull of an Earth whose ellipsoid is level, in closed form at any height."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.gnss.constants import WGS84_A_M, WGS84_F

__all__ = ["compute_gravity_m_s2"]

_GM_M3_S2: Final = 3.986004418e14  # with the atmosphere; NGA.STND.0036_1.0.0_WGS84, table 3.1
_OMEGA_RAD_S: Final = 7.292115e-5  # the defining constant of the gravity formula; the same table
_B_M: Final = WGS84_A_M * (1.0 - WGS84_F)
_E_M: Final = WGS84_A_M * np.sqrt(WGS84_F * (2.0 - WGS84_F))  # linear eccentricity


def compute_gravity_m_s2(ecef_m: ArrayLike) -> Reals:
    """Compute gravity in ECEF axes at positions (..., 3): attraction and centrifugal acceleration.

    Closed form in ellipsoidal coordinates u, beta: Heiskanen and Moritz, Physical Geodesy (1967), equations 2-62 to
    2-66; NGA.STND.0036_1.0.0_WGS84, 4.1. It leaves out what mountains and mass anomalies do, up to some 1e-3 m/s^2.
    Good from half the Earth's radius outwards, not at the centre.
    """
    ecef_m = np.asarray(ecef_m, np.float64)
    x_m, y_m, z_m = ecef_m[..., 0], ecef_m[..., 1], ecef_m[..., 2]
    axis2 = x_m**2 + y_m**2
    excess = axis2 + z_m**2 - _E_M**2
    u2 = 0.5 * excess * (1.0 + np.sqrt(1.0 + (2.0 * _E_M * z_m / excess) ** 2))
    u, v2 = np.sqrt(u2), u2 + _E_M**2  # the semi-axes of the confocal ellipsoid are v and u
    v = np.sqrt(v2)
    sin_b, cos_b = z_m / u, np.sqrt(axis2) / v
    w = np.sqrt((u2 + (_E_M * sin_b) ** 2) / v2)
    bulge = (_OMEGA_RAD_S * WGS84_A_M) ** 2 / _compute_q(np.array(_B_M))
    along_u = (
        _OMEGA_RAD_S**2 * u * cos_b**2
        - _GM_M3_S2 / v2
        - bulge * _E_M / v2 * _compute_dq(u) * (0.5 * sin_b**2 - 1.0 / 6.0)
    ) / w
    along_beta = sin_b * cos_b * (bulge / v * _compute_q(u) - _OMEGA_RAD_S**2 * v) / w
    outward = (along_u * u / v * cos_b - along_beta * sin_b) / w
    # per distance from the axis, so that the poles need no longitude
    per_axis = np.divide(outward, np.sqrt(axis2), out=np.zeros_like(outward), where=axis2 > 0.0)
    north = (along_u * sin_b + along_beta * u / v * cos_b) / w
    return np.stack((per_axis * x_m, per_axis * y_m, north), axis=-1)


def _compute_q(u: Reals) -> Reals:
    """Compute q of Heiskanen and Moritz 2-57. Its differences lose 1e-11 of it, which is 1e-13 m/s^2."""
    return np.asarray(0.5 * ((1.0 + 3.0 * (u / _E_M) ** 2) * np.arctan(_E_M / u) - 3.0 * u / _E_M))


def _compute_dq(u: Reals) -> Reals:
    """Compute -(u^2 + E^2) / E dq/du: Heiskanen and Moritz 2-67."""
    return np.asarray(3.0 * (1.0 + (u / _E_M) ** 2) * (1.0 - u / _E_M * np.arctan(_E_M / u)) - 1.0)
