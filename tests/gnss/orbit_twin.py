"""Orbits in plain NumPy: the slow twin of `gnss.orbit_kernels`, and of the ranges that are made of them."""

import numpy as np

from skyproof.gnss.constants import (
    BEIDOU_EARTH_ROTATION_RAD_S,
    BEIDOU_MU_M3_S2,
    EARTH_ROTATION_RAD_S,
    GALILEO_MU_M3_S2,
    GALILEO_RELATIVITY_F_S_SQRT_M,
    GLONASS_EARTH_RADIUS_M,
    GLONASS_EARTH_ROTATION_RAD_S,
    GLONASS_J2,
    GLONASS_MU_M3_S2,
    MU_M3_S2,
    RELATIVITY_F_S_SQRT_M,
    SECONDS_PER_WEEK,
)
from skyproof.gnss.ephemeris import GlonassEphemeris, system_offset_s
from skyproof.gnss.orbits import SatelliteState

_GPS = (MU_M3_S2, EARTH_ROTATION_RAD_S, RELATIVITY_F_S_SQRT_M)
_KEPLER = {
    "G": _GPS,
    "J": _GPS,  # IS-QZSS-PNT-005, 5.5 refers to GPS
    "E": (GALILEO_MU_M3_S2, EARTH_ROTATION_RAD_S, GALILEO_RELATIVITY_F_S_SQRT_M),
    "C": (BEIDOU_MU_M3_S2, BEIDOU_EARTH_ROTATION_RAD_S, GALILEO_RELATIVITY_F_S_SQRT_M),
}
"""Gravity, earth's rotation and F of each system."""
_GEOSTATIONARY = frozenset((*(f"C{n:02d}" for n in range(1, 6)), *(f"C{n:02d}" for n in range(59, 64))))
_GEO_TILT_RAD = np.radians(-5.0)  # BDS-SIS-ICD-B1I-3.0, 5.2.4.12
_GLONASS_STEP_S = 60.0
_GLONASS_MOST_STEPS = 1440  # a day; the force model is no good beyond an hour anyway


def satellite_state_s(ephemeris, week, tow_s):
    """Compute the state by full GPS weeks and seconds of week; shapes broadcast."""
    since_toe_s = _count_since(ephemeris.week, ephemeris.toe, ephemeris.sat, week, tow_s)
    if isinstance(ephemeris, GlonassEphemeris):
        return _integrate(ephemeris, since_toe_s)
    return _compute_state(
        ephemeris, since_toe_s, _count_since(ephemeris.toc_week, ephemeris.toc, ephemeris.sat, week, tow_s)
    )


def clock_polynomial_s(ephemeris, week, tow_s):
    """Compute satellite clock minus system time without relativity, enough to find when a signal left.

    The 50 ns that relativity makes at most do not move a satellite by a millimetre. IS-GPS-200N, 20.3.3.3.3.1;
    GLONASS ICD L1, L2 5.1, 3.3.3.
    """
    if isinstance(ephemeris, GlonassEphemeris):
        dt_s = _count_since(ephemeris.week, ephemeris.toe, ephemeris.sat, week, tow_s)
        return ephemeris.gamma_n * dt_s - ephemeris.tau_n
    dt_s = _count_since(ephemeris.toc_week, ephemeris.toc, ephemeris.sat, week, tow_s)
    return ephemeris.af0 + ephemeris.af1 * dt_s + ephemeris.af2 * dt_s**2


def _count_since(week0, second0, sat, week, tow_s):
    """Count seconds since second `second0` of `week0` in the time of the satellite's system."""
    week, tow_s = np.asarray(week, np.int64), np.asarray(tow_s, np.float64)
    return np.asarray((week - week0) * SECONDS_PER_WEEK + (tow_s - second0 - system_offset_s(sat)), np.float64)


# --- Kepler's form


def _compute_state(eph, tk, dt):
    """Compute the state with the symbols of IS-GPS-200N, table 20-IV (elements of coordinate systems, velocity)."""
    mu_m3_s2, rotation_rad_s, relativity_f = _KEPLER[eph.sat[0]]
    a = eph.sqrt_a**2
    n = np.sqrt(mu_m3_s2 / a**3) + eph.delta_n + 0.5 * eph.delta_n_dot * tk
    ek = _solve_kepler(eph.m0 + n * tk, eph.e)
    n = n + 0.5 * eph.delta_n_dot * tk
    a = a + eph.a_dot * tk
    sin_ek, cos_ek = np.sin(ek), np.cos(ek)
    ek_dot = n / (1.0 - eph.e * cos_ek)
    root = np.sqrt(1.0 - eph.e**2)
    phi = np.arctan2(root * sin_ek, cos_ek - eph.e) + eph.omega
    phi_dot = ek_dot * root / (1.0 - eph.e * cos_ek)

    s2, c2 = np.sin(2.0 * phi), np.cos(2.0 * phi)
    u = phi + eph.cus * s2 + eph.cuc * c2
    r = a * (1.0 - eph.e * cos_ek) + eph.crs * s2 + eph.crc * c2
    i = eph.i0 + eph.cis * s2 + eph.cic * c2 + eph.idot * tk
    u_dot = phi_dot * (1.0 + 2.0 * (eph.cus * c2 - eph.cuc * s2))
    r_dot = (
        eph.a_dot * (1.0 - eph.e * cos_ek) + a * eph.e * sin_ek * ek_dot + 2.0 * phi_dot * (eph.crs * c2 - eph.crc * s2)
    )
    i_dot = eph.idot + 2.0 * phi_dot * (eph.cis * c2 - eph.cic * s2)
    geostationary = eph.sat in _GEOSTATIONARY
    omega_k_dot = eph.omega_dot - (0.0 if geostationary else rotation_rad_s)
    omega_k = eph.omega0 + omega_k_dot * tk - rotation_rad_s * eph.toe

    su, cu, si, ci, so, co = np.sin(u), np.cos(u), np.sin(i), np.cos(i), np.sin(omega_k), np.cos(omega_k)
    x, y = r * cu, r * su  # in the orbital plane
    x_dot, y_dot = r_dot * cu - y * u_dot, r_dot * su + x * u_dot
    position = np.stack((x * co - y * ci * so, x * so + y * ci * co, y * si), axis=-1)
    in_plane_dot = y_dot * ci - y * si * i_dot
    velocity = np.stack(
        (
            x_dot * co - in_plane_dot * so - position[..., 1] * omega_k_dot,
            x_dot * so + in_plane_dot * co + position[..., 0] * omega_k_dot,
            y_dot * si + y * ci * i_dot,
        ),
        axis=-1,
    )
    if geostationary:
        position, velocity = _rotate_geostationary(position, velocity, tk, rotation_rad_s)
    relativity = relativity_f * eph.e * eph.sqrt_a
    return SatelliteState(
        position_ecef_m=position,
        velocity_ecef_m_s=velocity,
        clock_s=eph.af0 + eph.af1 * dt + eph.af2 * dt**2 + relativity * sin_ek,
        clock_drift=eph.af1 + 2.0 * eph.af2 * dt + relativity * cos_ek * ek_dot,
    )


def _rotate_geostationary(position, velocity, tk, rotation_rad_s):
    """Rotate a geostationary orbit, given in a tilted frame that is fixed from toe on.

    BDS-SIS-ICD-B1I-3.0, 5.2.4.12.
    """
    cos_tilt, sin_tilt = np.cos(_GEO_TILT_RAD), np.sin(_GEO_TILT_RAD)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, cos_tilt, sin_tilt], [0.0, -sin_tilt, cos_tilt]])
    position, velocity = position @ tilt.T, velocity @ tilt.T
    cos, sin = np.cos(rotation_rad_s * tk), np.sin(rotation_rad_s * tk)

    def rotate(vector):
        x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
        return np.stack((x * cos + y * sin, y * cos - x * sin, z), axis=-1)

    turned_m = rotate(position)
    carried = rotation_rad_s * np.stack((turned_m[..., 1], -turned_m[..., 0], np.zeros_like(turned_m[..., 2])), axis=-1)
    return turned_m, rotate(velocity) + carried


def _solve_kepler(mean_rad, e):
    """Solve Kepler's equation by Newton's steps.

    Six reach rounding for e below 0.2; GPS stays below 0.03, Galileo's two satellites that missed their orbit have
    0.17.
    """
    ek = mean_rad + e * np.sin(mean_rad)
    for _ in range(6):
        ek = ek - (ek - e * np.sin(ek) - mean_rad) / (1.0 - e * np.cos(ek))
    return ek


# --- GLONASS


def _integrate(eph, since_s):
    """Integrate by Runge-Kutta from t_b in whole minutes, and by one shorter step to each instant.

    The answer of an instant does not depend on which others are requested. NaN more than a day from t_b. ICD 5.1,
    A.3.1.2.
    """
    present = np.abs(since_s) <= _GLONASS_STEP_S * _GLONASS_MOST_STEPS
    since_s = np.where(present, since_s, 0.0)
    steps = np.trunc(since_s / _GLONASS_STEP_S).astype(np.int64)
    sun_moon = np.array(eph.acceleration_m_s2)
    start = np.array((*eph.position_m, *eph.velocity_m_s))
    low, high = (int(steps.min(initial=0)), int(steps.max(initial=0)))
    grid = np.empty((high - low + 1, 6))
    grid[-low] = start
    for k in range(1, high + 1):
        grid[k - low] = _step_runge_kutta(grid[k - 1 - low], sun_moon, np.float64(_GLONASS_STEP_S))
    for k in range(-1, low - 1, -1):
        grid[k - low] = _step_runge_kutta(grid[k + 1 - low], sun_moon, np.float64(-_GLONASS_STEP_S))
    state = _step_runge_kutta(grid[steps - low], sun_moon, np.asarray(since_s - steps * _GLONASS_STEP_S)[..., None])
    state = np.where(present[..., None], state, np.nan)
    return SatelliteState(
        position_ecef_m=state[..., :3],
        velocity_ecef_m_s=state[..., 3:],
        clock_s=np.where(present, eph.gamma_n * since_s - eph.tau_n, np.nan),
        clock_drift=np.where(present, eph.gamma_n, np.nan),
    )


def _step_runge_kutta(state, sun_moon, step_s):
    k1 = _compute_glonass_rates(state, sun_moon)
    k2 = _compute_glonass_rates(state + 0.5 * step_s * k1, sun_moon)
    k3 = _compute_glonass_rates(state + 0.5 * step_s * k2, sun_moon)
    k4 = _compute_glonass_rates(state + step_s * k3, sun_moon)
    return np.asarray(state + step_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))


def _compute_glonass_rates(state, sun_moon):
    """Compute velocity and acceleration (..., 6) in the rotating frame.

    Forces are gravity with J2, Coriolis, sun and moon (A.3.1.2).
    """
    position, velocity = state[..., :3], state[..., 3:]
    r2 = np.sum(position**2, axis=-1)
    gravity = GLONASS_MU_M3_S2 / (r2 * np.sqrt(r2))
    flattened = 1.5 * GLONASS_J2 * gravity * GLONASS_EARTH_RADIUS_M**2 / r2
    polar = 5.0 * position[..., 2] ** 2 / r2
    spin = GLONASS_EARTH_ROTATION_RAD_S
    level = spin**2 - gravity - flattened * (1.0 - polar)
    acceleration = np.stack(
        (
            level * position[..., 0] + 2.0 * spin * velocity[..., 1],
            level * position[..., 1] - 2.0 * spin * velocity[..., 0],
            (-gravity - flattened * (3.0 - polar)) * position[..., 2],
        ),
        axis=-1,
    )
    return np.concatenate((velocity, acceleration + sun_moon), axis=-1)
