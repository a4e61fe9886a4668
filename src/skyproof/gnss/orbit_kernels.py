"""Kernels of satellite orbits: the state of one satellite, and of all signals of a record at once.

An orbit is a row of `N_ORBIT` numbers (`gnss.ephemeris.orbit_row`). The kernels stand in one module, as a kernel's
machine code is kept by the date of its own module only.
"""

from typing import Final

import numpy as np

from skyproof.compiled import compiled
from skyproof.gnss.constants import (
    GLONASS_EARTH_RADIUS_M,
    GLONASS_EARTH_ROTATION_RAD_S,
    GLONASS_J2,
    GLONASS_MU_M3_S2,
    SECONDS_PER_WEEK,
    SPEED_OF_LIGHT_M_S,
)
from skyproof.gnss.orbit_rows import (
    A_DOT,
    ACCELERATION,
    AF0,
    AF1,
    AF2,
    AHEAD,
    CIC,
    CIS,
    CRC,
    CRS,
    CUC,
    CUS,
    DELTA_N,
    DELTA_N_DOT,
    GEOSTATIONARY,
    GLONASS,
    I0,
    IDOT,
    KIND,
    M0,
    MU,
    N_STATE,
    OMEGA,
    OMEGA0,
    OMEGA_DOT,
    POSITION,
    RELATIVITY,
    ROTATION,
    SQRT_A,
    TOC,
    TOC_WEEK,
    TOE,
    WEEK,
    E,
)

__all__ = ["fill_ranges", "fill_states", "fill_states_at"]

_WEEK_S: Final = float(SECONDS_PER_WEEK)
_GEO_TILT_RAD: Final = float(np.radians(-5.0))  # BDS-SIS-ICD-B1I-3.0, 5.2.4.12
_SIN_TILT, _COS_TILT = float(np.sin(_GEO_TILT_RAD)), float(np.cos(_GEO_TILT_RAD))
_GLONASS_STEP_S: Final = 60.0
_GLONASS_MOST_STEPS: Final = 1440  # a day; the force model is no good beyond an hour anyway


@compiled(error_model="numpy")
def _compute_since(orbit, week_at, second_at, week, tow_s):  # type: ignore[no-untyped-def]
    """Return the seconds since a second of a week of the system's time; both stand in `orbit`."""
    return (week - orbit[week_at]) * _WEEK_S + (tow_s - orbit[second_at] - orbit[AHEAD])


@compiled(error_model="numpy")
def _fill_kepler(orbit, tk, dt, out):  # type: ignore[no-untyped-def]
    """Compute position, velocity and clock by Kepler's form (symbols of IS-GPS-200N, table 20-IV).

    Kepler's equation by Newton's steps: six reach rounding for e below 0.2; GPS stays below 0.03, Galileo's two
    satellites that missed their orbit have 0.17.
    """
    e = orbit[E]
    a = orbit[SQRT_A] ** 2
    n = np.sqrt(orbit[MU] / a**3) + orbit[DELTA_N] + 0.5 * orbit[DELTA_N_DOT] * tk  # table 30-II; 0 but of CNAV
    mean_rad = orbit[M0] + n * tk
    n += 0.5 * orbit[DELTA_N_DOT] * tk
    a += orbit[A_DOT] * tk
    ek = mean_rad + e * np.sin(mean_rad)
    for _ in range(6):
        ek = ek - (ek - e * np.sin(ek) - mean_rad) / (1.0 - e * np.cos(ek))
    sin_ek, cos_ek = np.sin(ek), np.cos(ek)
    ek_dot = n / (1.0 - e * cos_ek)
    root = np.sqrt(1.0 - e**2)
    phi = np.arctan2(root * sin_ek, cos_ek - e) + orbit[OMEGA]
    phi_dot = ek_dot * root / (1.0 - e * cos_ek)

    s2, c2 = np.sin(2.0 * phi), np.cos(2.0 * phi)
    u = phi + orbit[CUS] * s2 + orbit[CUC] * c2
    r = a * (1.0 - e * cos_ek) + orbit[CRS] * s2 + orbit[CRC] * c2
    i = orbit[I0] + orbit[CIS] * s2 + orbit[CIC] * c2 + orbit[IDOT] * tk
    u_dot = phi_dot * (1.0 + 2.0 * (orbit[CUS] * c2 - orbit[CUC] * s2))
    r_dot = orbit[A_DOT] * (1.0 - e * cos_ek) + a * e * sin_ek * ek_dot
    r_dot += 2.0 * phi_dot * (orbit[CRS] * c2 - orbit[CRC] * s2)
    i_dot = orbit[IDOT] + 2.0 * phi_dot * (orbit[CIS] * c2 - orbit[CIC] * s2)
    omega_k_dot = orbit[OMEGA_DOT] - (0.0 if orbit[KIND] == GEOSTATIONARY else orbit[ROTATION])
    omega_k = orbit[OMEGA0] + omega_k_dot * tk - orbit[ROTATION] * orbit[TOE]

    su, cu, si, ci, so, co = np.sin(u), np.cos(u), np.sin(i), np.cos(i), np.sin(omega_k), np.cos(omega_k)
    x, y = r * cu, r * su  # in the orbital plane
    x_dot, y_dot = r_dot * cu - y * u_dot, r_dot * su + x * u_dot
    out[0], out[1], out[2] = x * co - y * ci * so, x * so + y * ci * co, y * si
    in_plane_dot = y_dot * ci - y * si * i_dot
    out[3] = x_dot * co - in_plane_dot * so - out[1] * omega_k_dot
    out[4] = x_dot * so + in_plane_dot * co + out[0] * omega_k_dot
    out[5] = y_dot * si + y * ci * i_dot
    if orbit[KIND] == GEOSTATIONARY:
        _turn_with_the_earth(tk, orbit[ROTATION], out)
    relativity = orbit[RELATIVITY] * e * orbit[SQRT_A]
    out[6] = orbit[AF0] + orbit[AF1] * dt + orbit[AF2] * dt**2 + relativity * sin_ek
    out[7] = orbit[AF1] + 2.0 * orbit[AF2] * dt + relativity * cos_ek * ek_dot


@compiled(error_model="numpy")
def _turn_with_the_earth(tk, rotation_rad_s, out):  # type: ignore[no-untyped-def]
    """Rotate a geostationary orbit to the Earth's frame (BDS-SIS-ICD-B1I-3.0, 5.2.4.12).

    It is given in a tilted frame that stands still from toe on.
    """
    sine, cosine = np.sin(rotation_rad_s * tk), np.cos(rotation_rad_s * tk)
    for first in (0, 3):
        x, y, z = out[first], out[first + 1], out[first + 2]
        y, z = _COS_TILT * y + _SIN_TILT * z, _COS_TILT * z - _SIN_TILT * y
        out[first], out[first + 1], out[first + 2] = x * cosine + y * sine, y * cosine - x * sine, z
    out[3] += rotation_rad_s * out[1]
    out[4] -= rotation_rad_s * out[0]


@compiled(error_model="numpy")
def _fill_glonass_rates(orbit, state, rates):  # type: ignore[no-untyped-def]
    """Compute velocity and acceleration in the rotating frame: gravity with J2, Coriolis, sun and moon.

    GLONASS ICD 5.1, A.3.1.2.
    """
    x, y, z = state[0], state[1], state[2]
    r2 = x * x + y * y + z * z
    gravity = GLONASS_MU_M3_S2 / (r2 * np.sqrt(r2))
    flattened = 1.5 * GLONASS_J2 * gravity * GLONASS_EARTH_RADIUS_M**2 / r2
    polar = 5.0 * z**2 / r2
    spin = GLONASS_EARTH_ROTATION_RAD_S
    level = spin**2 - gravity - flattened * (1.0 - polar)
    rates[0], rates[1], rates[2] = state[3], state[4], state[5]
    rates[3] = level * x + 2.0 * spin * state[4] + orbit[ACCELERATION]
    rates[4] = level * y - 2.0 * spin * state[3] + orbit[ACCELERATION + 1]
    rates[5] = (-gravity - flattened * (3.0 - polar)) * z + orbit[ACCELERATION + 2]


@compiled(error_model="numpy")
def _step_runge_kutta(orbit, state, step_s, rates, middle, out):  # type: ignore[no-untyped-def]
    """Fill out with the state after a step; rates (4, 6) and middle (6,) are for the work."""
    for stage in range(4):
        for k in range(6):
            if stage == 0:
                middle[k] = state[k]
            else:
                middle[k] = state[k] + (1.0 if stage == 3 else 0.5) * step_s * rates[stage - 1, k]
        _fill_glonass_rates(orbit, middle, rates[stage])
    for k in range(6):
        out[k] = state[k] + step_s / 6.0 * (rates[0, k] + 2.0 * rates[1, k] + 2.0 * rates[2, k] + rates[3, k])


@compiled(error_model="numpy")
def _integrate(orbit, since_s, node, steps, rates, middle, out):  # type: ignore[no-untyped-def]
    """Fill out with the state by Runge-Kutta from t_b: whole minutes, then one shorter step.

    Returns the steps.

    So the answer of an instant does not depend on which others are asked for. node (6,) : the state after `steps` whole
    minutes of another instant, where it continues if it can; none for `steps` 0. NaN more than a day from t_b.
    """
    if not abs(since_s) <= _GLONASS_STEP_S * _GLONASS_MOST_STEPS:
        out[:] = np.nan
        return steps
    wanted = int(since_s / _GLONASS_STEP_S)
    if steps == 0 or wanted * steps < 0 or abs(wanted) < abs(steps):
        node[:] = orbit[POSITION : POSITION + 6]
        steps = 0
    step_s = np.copysign(_GLONASS_STEP_S, since_s)
    while steps != wanted:
        _step_runge_kutta(orbit, node, step_s, rates, middle, out)
        node[:] = out[:6]
        steps += 1 if wanted > steps else -1
    _step_runge_kutta(orbit, node, since_s - steps * _GLONASS_STEP_S, rates, middle, out)
    out[6] = orbit[AF0] + orbit[AF1] * since_s
    out[7] = orbit[AF1]
    return steps


@compiled(error_model="numpy")
def fill_states(orbit, week, tow_s, out):  # type: ignore[no-untyped-def]
    """Fill out (n, N_STATE) with states at seconds `tow_s` (n,) of `week` (n,) by the row `orbit`."""
    node, rates, middle, steps = np.empty(6), np.empty((4, 6)), np.empty(6), 0
    for k in range(tow_s.size):
        tk = _compute_since(orbit, WEEK, TOE, week[k], tow_s[k])
        if orbit[KIND] == GLONASS:
            steps = _integrate(orbit, tk, node, steps, rates, middle, out[k])
        else:
            _fill_kepler(orbit, tk, _compute_since(orbit, TOC_WEEK, TOC, week[k], tow_s[k]), out[k])


@compiled(error_model="numpy")
def fill_states_at(orbits, week, tow_s, out):  # type: ignore[no-untyped-def]
    """Fill out (k, N_STATE) with states of the rows `orbits` at one instant."""
    node, rates, middle = np.empty(6), np.empty((4, 6)), np.empty(6)
    for k in range(len(orbits)):
        orbit = orbits[k]
        tk = _compute_since(orbit, WEEK, TOE, week, tow_s)
        if orbit[KIND] == GLONASS:
            _integrate(orbit, tk, node, 0, rates, middle, out[k])
        else:
            _fill_kepler(orbit, tk, _compute_since(orbit, TOC_WEEK, TOC, week, tow_s), out[k])


@compiled(error_model="numpy")
def fill_ranges(  # type: ignore[no-untyped-def]
    pseudorange_m,
    week,
    tow_s,
    gpst_ns,
    first,
    serving,
    delay_s,
    most_ns,
    orbits,
    toe_ns,
    sent_tow_s,
    position,
    velocity,
    drift,
    range_m,
    delay_unknown,
):
    """Fill the satellites' side of all cells (epoch, channel) that a fresh orbit serves.

    The other cells stay unchanged.

    Parameters
    ----------
    pseudorange_m (n, c); week, tow_s, gpst_ns (n,) of each epoch.
    first (c + 1,) : where each channel's orbits begin in `find_serving`, rows of `orbits` (k, N_ORBIT) and `toe_ns`
        (k,), and in `delay_s`, the signal's group delay by each, NaN if it gives none. most_ns (c,) : age at most.
    sent_tow_s, drift, range_m, delay_unknown (n, c), position, velocity (n, c, 3) : filled, see `navigation.Ranges`.
    """
    state = np.empty(N_STATE)
    node, rates, middle = np.empty(6), np.empty((4, 6)), np.empty(6)
    for channel in range(pseudorange_m.shape[1]):
        last, steps = -1, 0
        for epoch in range(pseudorange_m.shape[0]):
            best, youngest_ns = -1, most_ns[channel] + 1
            for k in range(first[channel], first[channel + 1]):
                age_ns = abs(gpst_ns[epoch] - toe_ns[serving[k]])
                if age_ns < youngest_ns:
                    best, youngest_ns = k, age_ns
            if best < 0:
                continue
            orbit = orbits[serving[best]]
            if best != last:
                last, steps = best, 0
            delay_unknown[epoch, channel] = np.isnan(delay_s[best])
            if np.isnan(pseudorange_m[epoch, channel]):
                continue
            at_s = tow_s[epoch] - pseudorange_m[epoch, channel] / SPEED_OF_LIGHT_M_S  # by the satellite's clock
            dt = _compute_since(orbit, TOC_WEEK, TOC, week[epoch], at_s)
            # Without relativity: the 50 ns that it makes at most do not move a satellite by a millimetre.
            at_s -= orbit[AF0] + orbit[AF1] * dt + orbit[AF2] * dt**2
            tk = _compute_since(orbit, WEEK, TOE, week[epoch], at_s)
            if orbit[KIND] == GLONASS:
                steps = _integrate(orbit, tk, node, steps, rates, middle, state)
            else:
                _fill_kepler(orbit, tk, _compute_since(orbit, TOC_WEEK, TOC, week[epoch], at_s), state)
            sent_tow_s[epoch, channel] = at_s
            position[epoch, channel] = state[:3]
            velocity[epoch, channel] = state[3:6]
            drift[epoch, channel] = state[7]
            known_s = 0.0 if np.isnan(delay_s[best]) else delay_s[best]
            range_m[epoch, channel] = pseudorange_m[epoch, channel] + SPEED_OF_LIGHT_M_S * (state[6] - known_s)
