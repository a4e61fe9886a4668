"""Kernels of least squares in position and clock: lines of sight, delays on the way, normal equations, search.

They stand in one module, since a kernel's machine code is kept by the date of its own module only. The public functions
say what they compute: `least_squares`, `ranges.compute_atmosphere`, `search`. Leading axes are problems, and none fails
the others: one that cannot be solved is NaN.
"""

from math import atan2, cos, exp, hypot, isfinite, isnan, sin, sqrt
from typing import Final

import numpy as np

from skyproof.compiled import compiled
from skyproof.gnss.constants import (
    EARTH_ROTATION_RAD_S,
    L1_HZ,
    SECONDS_PER_DAY,
    SPEED_OF_LIGHT_M_S,
    WGS84_A_M,
    WGS84_F,
)

__all__ = [
    "extend_candidates",
    "fill_delays",
    "fill_sights",
    "find_fours",
    "invert",
    "order_by_geometry",
    "predict_misfits",
    "solve_choices",
    "solve_gauss_newton",
]

SMALLEST_PIVOT: Final = 1e-13
LOWEST_M, FARTHEST_M = -20e3, 50e6
"""Below the ground and from the Earth's centre, within which a place is plausible."""
_LINEAR_SLACK: Final = 2.0  # the prediction is linear; twice the threshold leaves room for what that costs
_STEPS, _TOLERANCE_M = 6, 100.0  # of a solution in the search: what a linear step neglects is 0.5 mm then
_TRAVEL_S: Final = 0.075  # of a signal from orbit to ground, within 0.01 s
_E2: Final = WGS84_F * (2.0 - WGS84_F)
_EP2: Final = _E2 / (1.0 - _E2)
_B_M: Final = WGS84_A_M * (1.0 - WGS84_F)
_DAY_S: Final = float(SECONDS_PER_DAY)
_SAGNAC: Final = EARTH_ROTATION_RAD_S / SPEED_OF_LIGHT_M_S


@compiled(error_model="numpy")
def invert(matrix, smallest_pivot, out):  # type: ignore[no-untyped-def]
    """Invert a symmetric positive definite matrix (n, n) into `out` by Cholesky.

    NaN where it is not positive definite, or only just.
    """
    n = matrix.shape[0]
    lower = np.zeros((n, n))
    for j in range(n):
        pivot = matrix[j, j]
        for p in range(j):
            pivot -= lower[j, p] ** 2
        if not pivot > smallest_pivot * matrix[j, j]:
            out[:] = np.nan
            return
        lower[j, j] = sqrt(pivot)
        for i in range(j + 1, n):
            inner = 0.0
            for p in range(j):
                inner += lower[i, p] * lower[j, p]
            lower[i, j] = (matrix[i, j] - inner) / lower[j, j]
    for j in range(n):  # the inverse of `lower`, in its own upper half turned over
        for i in range(j, n):
            if i == j:
                out[j, i] = 1.0 / lower[j, j]
                continue
            inner = 0.0
            for p in range(j, i):
                inner += lower[i, p] * out[j, p]
            out[j, i] = -inner / lower[i, i]
    for i in range(n):
        for j in range(i, n):
            inner = 0.0
            for p in range(j, n):
                inner += out[i, p] * out[j, p]
            lower[i, j] = inner
    for i in range(n):
        for j in range(i, n):
            out[i, j] = out[j, i] = lower[i, j]


@compiled(error_model="numpy")
def invert_all(matrices, smallest_pivot, out):  # type: ignore[no-untyped-def]
    for k in range(matrices.shape[0]):
        invert(matrices[k], smallest_pivot, out[k])


@compiled(error_model="numpy")
def _fill_sight(satellite, position, seen):  # type: ignore[no-untyped-def]
    """Fill seen (7,): the satellite in the frame of reception, the unit vector to it, and its distance."""
    sx, sy, sz = satellite[0], satellite[1], satellite[2]
    px, py, pz = position[0], position[1], position[2]
    straight_m = sqrt((sx - px) ** 2 + (sy - py) ** 2 + (sz - pz) ** 2)
    travel_s = (straight_m + _SAGNAC * (sx * py - sy * px)) / SPEED_OF_LIGHT_M_S
    angle_rad = EARTH_ROTATION_RAD_S * travel_s
    sine, cosine = sin(angle_rad), cos(angle_rad)
    tx, ty = cosine * sx + sine * sy, cosine * sy - sine * sx
    dx, dy, dz = tx - px, ty - py, sz - pz
    distance_m = sqrt(dx * dx + dy * dy + dz * dz)
    seen[0], seen[1], seen[2] = tx, ty, sz
    seen[3], seen[4], seen[5] = dx / distance_m, dy / distance_m, dz / distance_m
    seen[6] = distance_m


@compiled(error_model="numpy")
def fill_sights(satellite, position, turned, unit, distance_m):  # type: ignore[no-untyped-def]
    """Fill the lines of sight to `satellite` (m, k, 3) from `position` (m, 3)."""
    seen = np.empty(7)
    for m in range(satellite.shape[0]):
        for k in range(satellite.shape[1]):
            _fill_sight(satellite[m, k], position[m], seen)
            for i in range(3):
                turned[m, k, i] = seen[i]
                unit[m, k, i] = seen[3 + i]
            distance_m[m, k] = seen[6]


# --- delays on the way


@compiled(error_model="numpy")
def _convert_to_geodetic(x_m, y_m, z_m):  # type: ignore[no-untyped-def]
    """Compute latitude, longitude and height, as `gnss.frames.geodetic_from_ecef` does."""
    axis_m = hypot(x_m, y_m)
    y, x = z_m * WGS84_A_M, axis_m * _B_M
    length = hypot(y, x)
    sin_u, cos_u = y / length, x / length
    sin_lat, cos_lat = sin_u, cos_u
    for _ in range(3):
        y, x = z_m + _EP2 * _B_M * sin_u**3, axis_m - _E2 * WGS84_A_M * cos_u**3
        length = hypot(y, x)
        sin_lat, cos_lat = y / length, x / length
        y, x = (1.0 - WGS84_F) * sin_lat, cos_lat
        length = hypot(y, x)
        sin_u, cos_u = y / length, x / length
    height_m = axis_m * cos_lat + z_m * sin_lat - WGS84_A_M * sqrt(1.0 - _E2 * sin_lat**2)
    return atan2(sin_lat, cos_lat), atan2(y_m, x_m), height_m


@compiled(error_model="numpy")
def _compute_zenith_m(lat_rad, height_m):  # type: ignore[no-untyped-def]
    """Compute the tropospheric zenith delay: `gnss.atmosphere.compute_saastamoinen_m`, thinned out above 11 km."""
    low_m = min(max(height_m, 0.0), 11000.0)
    pressure_hpa = 1013.25 * (1.0 - 2.2557e-5 * low_m) ** 5.2568
    temperature_k = 15.0 - 6.5e-3 * low_m + 273.15
    vapour_hpa = 6.108 * 0.6 * exp((17.15 * temperature_k - 4684.0) / (temperature_k - 38.45))
    gravity = 1.0 - 0.00266 * cos(2.0 * lat_rad) - 0.00028e-3 * low_m
    zenith_m = 0.0022768 * pressure_hpa / gravity + 0.002277 * (1255.0 / temperature_k + 0.05) * vapour_hpa
    return zenith_m * exp(-min(max(height_m - 11000.0, 0.0), 1e6) / 6340.0)


@compiled(error_model="numpy")
def _compute_ionosphere_s(klobuchar, lat_rad, lon_rad, az_rad, el_rad, tow_s):  # type: ignore[no-untyped-def]
    """Compute the delay of `gnss.atmosphere.compute_klobuchar_s`; klobuchar (8,) : alpha, then beta."""
    lat, lon, el = lat_rad / np.pi, lon_rad / np.pi, el_rad / np.pi
    psi = 0.0137 / (el + 0.11) - 0.022
    lat_i = min(max(lat + psi * cos(az_rad), -0.416), 0.416)
    lon_i = lon + psi * sin(az_rad) / cos(lat_i * np.pi)
    lat_m = lat_i + 0.064 * cos((lon_i - 1.617) * np.pi)
    local_s = (43200.0 * lon_i + tow_s) % _DAY_S
    obliquity = 1.0 + 16.0 * (0.53 - el) ** 3
    amplitude_s, period_s = 0.0, 0.0
    for n in range(3, -1, -1):
        amplitude_s = amplitude_s * lat_m + klobuchar[n]
        period_s = period_s * lat_m + klobuchar[4 + n]
    x = 2.0 * np.pi * (local_s - 50400.0) / max(period_s, 72000.0)
    day_s = max(amplitude_s, 0.0) * (1.0 - x**2 / 2.0 + x**4 / 24.0) if abs(x) < 1.57 else 0.0
    return obliquity * (5e-9 + day_s)


@compiled(error_model="numpy")
def _fill_delays(place, position, turned, tow_s, carrier_hz, model, out):  # type: ignore[no-untyped-def]
    """Fill out (4,): one satellite's elevation, delay, sigma of the models' error, and ionospheric part.

    place (8,) : of `_fill_place`. model (10,) : Klobuchar's numbers, a factor of the delay, sigma as a share of it.
    """
    dx, dy, dz = turned[0] - position[0], turned[1] - position[1], turned[2] - position[2]
    sin_lat, cos_lat, sin_lon, cos_lon = place[3], place[4], place[5], place[6]
    east_m = -sin_lon * dx + cos_lon * dy
    north_m = -sin_lat * cos_lon * dx - sin_lat * sin_lon * dy + cos_lat * dz
    up_m = cos_lat * cos_lon * dx + cos_lat * sin_lon * dy + sin_lat * dz
    az_rad, el_rad = atan2(east_m, north_m), atan2(up_m, hypot(east_m, north_m))
    above_rad = 0.0 if el_rad < 0.0 else el_rad
    ionosphere_m = (
        model[8] * SPEED_OF_LIGHT_M_S * _compute_ionosphere_s(model, place[0], place[1], az_rad, above_rad, tow_s)
    )
    ionosphere_m *= (L1_HZ / carrier_hz) ** 2
    out[0] = el_rad
    out[1] = ionosphere_m + place[7] * 1.001 / sqrt(0.002001 + sin(above_rad) ** 2)
    out[2] = model[9] * ionosphere_m
    out[3] = ionosphere_m


@compiled(error_model="numpy")
def _fill_place(position, place):  # type: ignore[no-untyped-def]
    """place (8,) = latitude, longitude, height, their sines and cosines, and the zenith delay of the troposphere."""
    place[0], place[1], place[2] = _convert_to_geodetic(position[0], position[1], position[2])
    place[3], place[4], place[5], place[6] = sin(place[0]), cos(place[0]), sin(place[1]), cos(place[1])
    place[7] = _compute_zenith_m(place[0], place[2])


@compiled(error_model="numpy")
def fill_delays(position, turned, tow_s, carrier_hz, model, out):  # type: ignore[no-untyped-def]
    """Fill out (m, k, 4) with `_fill_delays` of satellites (m, k, 3) from positions (m, 3); carrier_hz (m, k)."""
    place = np.empty(8)
    for m in range(turned.shape[0]):
        _fill_place(position[m], place)
        for k in range(turned.shape[1]):
            _fill_delays(place, position[m], turned[m, k], tow_s[m], carrier_hz[m, k], model, out[m, k])


# --- least squares


@compiled(error_model="numpy")
def solve_gauss_newton(  # type: ignore[no-untyped-def]
    satellite, range_m, weight, clocks, max_steps, tolerance_m, state, covariance, residual_m, step_m
):
    """Step all problems until none moves by more than `tolerance_m`, from state (m, 3 + c) on.

    satellite (m, k, 3), range_m (m, k), weight (m, k), 0 where it is not used; clocks (k, c). Filled: state, covariance
    (m, 3 + c, 3 + c), residual_m (m, k), 0 where it is not used, and step_m (m,), the last one's.
    """
    n_problems, n_satellites = range_m.shape
    n = state.shape[1]
    design = np.empty((n_satellites, n))
    misfit, normal, right, step, seen = np.empty(n_satellites), np.empty((n, n)), np.empty(n), np.empty(n), np.empty(7)
    for _ in range(max_steps):
        moving = False
        for m in range(n_problems):
            normal[:] = 0.0
            right[:] = 0.0
            for k in range(n_satellites):
                if weight[m, k] == 0.0:
                    continue
                _fill_sight(satellite[m, k], state[m], seen)
                misfit[k] = range_m[m, k] - seen[6]
                for i in range(3):
                    design[k, i] = -seen[3 + i]
                clock_m = 0.0
                for i in range(3, n):
                    design[k, i] = clocks[k, i - 3]
                    clock_m += state[m, i] * clocks[k, i - 3]
                misfit[k] -= clock_m
                for i in range(n):
                    weighted = design[k, i] * weight[m, k]
                    right[i] += weighted * misfit[k]
                    for j in range(i + 1):
                        normal[i, j] += weighted * design[k, j]
            for i in range(n):
                for j in range(i):
                    normal[j, i] = normal[i, j]
                if n > 4 and i > 2 and normal[i, i] == 0.0:
                    normal[i, i] = 1.0  # a clock without any measurement touches nothing
            invert(normal, SMALLEST_PIVOT, covariance[m])
            length2 = 0.0
            for i in range(n):
                step[i] = 0.0
                for j in range(n):
                    step[i] += covariance[m, i, j] * right[j]
                state[m, i] += step[i]
                length2 += step[i] ** 2
            step_m[m] = sqrt(length2)
            moving |= step_m[m] > tolerance_m
            for k in range(n_satellites):
                residual_m[m, k] = 0.0
                if weight[m, k] != 0.0:
                    residual_m[m, k] = misfit[k]
                    for i in range(n):
                        residual_m[m, k] -= design[k, i] * step[i]
        if not moving:
            break


@compiled(error_model="numpy")
def solve_choices(  # type: ignore[no-untyped-def]
    satellite, range_m, sigma_m, carrier_hz, tow_s, model, choice, clocks, rounds, state, covariance, statistic
):
    """Solve position and clocks of each row of `choice` (m, k), from `state` (m, 3 + c) on. -1 in a row skips a
    satellite.

    satellite (n, 3), range_m, sigma_m, carrier_hz (n,) : of all signals. clocks (k, c). Filled: state, covariance and
    statistic (m,).
    """
    n_problems, n_satellites = choice.shape
    chosen, ranges = np.empty((n_problems, n_satellites, 3)), np.empty((n_problems, n_satellites))
    weight, residual_m = np.zeros((n_problems, n_satellites)), np.empty((n_problems, n_satellites))
    step_m, place, seen, delays = np.empty(n_problems), np.empty(8), np.empty(7), np.empty(4)
    for _ in range(rounds):
        for m in range(n_problems):
            _fill_place(state[m], place)
            for k in range(n_satellites):
                row = choice[m, k]
                if row < 0 or not (isfinite(range_m[row]) and isfinite(satellite[row, 0])):
                    weight[m, k] = 0.0
                    continue
                _fill_sight(satellite[row], state[m], seen)
                _fill_delays(place, state[m], seen, tow_s, carrier_hz[row], model, delays)
                variance_m2 = sigma_m[row] ** 2 + delays[2] ** 2
                weight[m, k] = 1.0 / variance_m2 if isfinite(variance_m2) else 0.0
                ranges[m, k] = range_m[row] - delays[1]
                chosen[m, k] = satellite[row]
        solve_gauss_newton(chosen, ranges, weight, clocks, _STEPS, _TOLERANCE_M, state, covariance, residual_m, step_m)
    for m in range(n_problems):
        statistic[m] = 0.0
        for k in range(n_satellites):
            statistic[m] += residual_m[m, k] ** 2 * weight[m, k]
        if isnan(state[m, 0]):
            statistic[m] = np.nan


@compiled(error_model="numpy")
def _compute_misfit(satellite, range_m, carrier_hz, tow_s, model, row, place, state, seen, delays):  # type: ignore[no-untyped-def]
    """Return a measurement less its prediction by `state`; fill seen and delays."""
    _fill_sight(satellite[row], state, seen)
    _fill_delays(place, state, seen, tow_s, carrier_hz[row], model, delays)
    return range_m[row] - seen[6] - delays[1] - state[3]


@compiled(error_model="numpy")
def _compute_prediction_m2(covariance, seen):  # type: ignore[no-untyped-def]
    """Compute the variance of a predicted range from that of position and clock (4, 4)."""
    variance_m2 = 0.0
    for i in range(4):
        for j in range(4):
            along = covariance[i, j]
            along *= -seen[3 + i] if i < 3 else 1.0
            along *= -seen[3 + j] if j < 3 else 1.0
            variance_m2 += along
    return variance_m2


@compiled(error_model="numpy")
def predict_misfits(  # type: ignore[no-untyped-def]
    satellite, range_m, sigma_m, carrier_hz, tow_s, model, rows, state, covariance, misfit_m, variance_m2, unit
):
    """Fill the misfit of each of `rows` (m,) by `state` (m, 4), its variance, and the unit vector (m, 3)."""
    place, seen, delays = np.empty(8), np.empty(7), np.empty(4)
    for m in range(rows.size):
        row = rows[m]
        if m == 0 or not np.all(state[m] == state[m - 1]):
            _fill_place(state[m], place)
        misfit_m[m] = _compute_misfit(satellite, range_m, carrier_hz, tow_s, model, row, place, state[m], seen, delays)
        variance_m2[m] = _compute_prediction_m2(covariance[m], seen) + sigma_m[row] ** 2 + delays[2] ** 2
        unit[m] = seen[3:6]


# --- search


@compiled(error_model="numpy")
def order_by_geometry(satellite):  # type: ignore[no-untyped-def]
    """Order of satellites (n, 3) in which the first few have a good geometry, seen from below their middle."""
    n = satellite.shape[0]
    middle = np.zeros(3)
    for k in range(n):
        middle += satellite[k]
    middle *= WGS84_A_M / sqrt(middle[0] ** 2 + middle[1] ** 2 + middle[2] ** 2)
    design, seen = np.ones((n, 4)), np.empty(7)
    for k in range(n):
        _fill_sight(satellite[k], middle, seen)
        design[k, :3] = -seen[3:6]
    covariance, along = np.eye(4) * 1e3, np.empty(4)
    order, taken = np.empty(n, np.int64), np.zeros(n, np.bool_)
    for place in range(n):
        best, most = -1, -1.0
        for k in range(n):
            gained = 0.0
            for i in range(4):
                for j in range(4):
                    gained += design[k, i] * covariance[i, j] * design[k, j]
            if not taken[k] and gained > most:
                best, most = k, gained
        if best < 0:  # geometry of what is not finite
            best = int(np.argmin(taken))
        order[place], taken[best] = best, True
        size = 1.0
        for i in range(4):
            along[i] = 0.0
            for j in range(4):
                along[i] += covariance[i, j] * design[best, j]
            size += design[best, i] * along[i]
        for i in range(4):
            for j in range(4):
                covariance[i, j] -= along[i] * along[j] / size
    return order


@compiled(error_model="numpy")
def _is_near_earth(state, slack_m):  # type: ignore[no-untyped-def]
    """Check the distance from the Earth's centre, as `search.is_plausible`, for its smallest radius."""
    centre_m = sqrt(state[0] ** 2 + state[1] ** 2 + state[2] ** 2)
    return centre_m >= _B_M + LOWEST_M - slack_m and centre_m <= FARTHEST_M + slack_m


@compiled(error_model="numpy")
def _is_near_within_sigma(state, covariance):  # type: ignore[no-untyped-def]
    """Check the same with ten sigma allowed: few signals in poor geometry give a rough place only."""
    return _is_near_earth(state, 10.0 * sqrt(covariance[0, 0] + covariance[1, 1] + covariance[2, 2]))


@compiled(error_model="numpy")
def _solve_four(a, b):  # type: ignore[no-untyped-def]
    """Replace b (4, 2) by a^-1 b, for a (4, 4), by elimination with pivots. Returns whether a solution exists."""
    for j in range(4):
        best = j
        for i in range(j + 1, 4):
            if abs(a[i, j]) > abs(a[best, j]):
                best = i
        if not abs(a[best, j]) > 0.0:
            return False
        for p in range(4):
            a[j, p], a[best, p] = a[best, p], a[j, p]
        for p in range(2):
            b[j, p], b[best, p] = b[best, p], b[j, p]
        for i in range(j + 1, 4):
            factor = a[i, j] / a[j, j]
            for p in range(j, 4):
                a[i, p] -= factor * a[j, p]
            for p in range(2):
                b[i, p] -= factor * b[j, p]
    for j in range(3, -1, -1):
        for p in range(2):
            for i in range(j + 1, 4):
                b[j, p] -= a[j, i] * b[i, p]
            b[j, p] /= a[j, j]
    return True


@compiled(error_model="numpy")
def solve_bancroft(satellite, range_m, out):  # type: ignore[no-untyped-def]
    """Fill out (2, 4) with both solutions for ranges (4,) to satellites (4, 3); NaN where none exists.

    S. Bancroft, "An algebraic solution of the GPS equations", IEEE Trans. AES 21(1), 1985. The Earth's turn is taken
    for 75 ms, which leaves metres; the atmosphere is left in.
    """
    out[:] = np.nan
    angle_rad = EARTH_ROTATION_RAD_S * _TRAVEL_S
    sine, cosine = sin(angle_rad), cos(angle_rad)
    common_m = range_m.mean() - SPEED_OF_LIGHT_M_S * _TRAVEL_S  # keeps the numbers of one size
    a, b = np.empty((4, 4)), np.ones((4, 2))
    for k in range(4):
        x, y = satellite[k, 0], satellite[k, 1]
        a[k, 0], a[k, 1], a[k, 2] = cosine * x + sine * y, cosine * y - sine * x, satellite[k, 2]
        a[k, 3] = range_m[k] - common_m
        a[k] /= WGS84_A_M
        b[k, 1] = 0.5 * (a[k, 0] ** 2 + a[k, 1] ** 2 + a[k, 2] ** 2 - a[k, 3] ** 2)
    if not _solve_four(a, b):
        return
    uu, uv, vv = 0.0, 0.0, 0.0
    for k in range(4):
        sign = 1.0 if k < 3 else -1.0
        uu += sign * b[k, 0] * b[k, 0]
        uv += sign * b[k, 0] * b[k, 1]
        vv += sign * b[k, 1] * b[k, 1]
    # uu x^2 + 2 (uv - 1) x + vv = 0, in the form that keeps its digits when uu is small.
    half = uv - 1.0
    # Noise can make a double root complex: then the real part is the start.
    root = -half - np.copysign(sqrt(max(half**2 - uu * vv, 0.0)), half)
    for k in range(2):
        if (uu if k == 0 else root) == 0.0:
            continue
        x = root / uu if k == 0 else vv / root
        backwards = False  # squaring lets negative distances in
        clock_m = -(b[3, 1] + x * b[3, 0]) * WGS84_A_M + common_m
        for i in range(4):
            backwards |= range_m[i] < clock_m
        if not backwards:
            for i in range(3):
                out[k, i] = (b[i, 1] + x * b[i, 0]) * WGS84_A_M
            out[k, 3] = clock_m


@compiled(error_model="numpy")
def find_fours(  # type: ignore[no-untyped-def]
    satellite, range_m, sigma_m, carrier_hz, tow_s, model, rows
):
    """Solve each four of `rows` (f, 4); both solutions, unless nowhere near the Earth.

    Returns the number of each solution's four (m,), states (m, 4) and covariances (m, 4, 4).
    """
    starts, four = np.empty((2 * len(rows), 4)), np.empty(2 * len(rows), np.int64)
    four_sats, ranges, solutions = np.empty((4, 3)), np.empty(4), np.empty((2, 4))
    count = 0
    for k in range(len(rows)):
        for i in range(4):
            four_sats[i] = satellite[rows[k, i]]
            ranges[i] = range_m[rows[k, i]]
        solve_bancroft(four_sats, ranges, solutions)
        for i in range(2):
            if _is_near_earth(solutions[i], 500e3):  # closed form and a poor geometry; NaN is nowhere
                starts[count], four[count] = solutions[i], k
                count += 1
    choice = np.empty((count, 4), np.int64)
    for k in range(count):
        choice[k] = rows[four[k]]
    state, covariance, statistic = starts[:count].copy(), np.empty((count, 4, 4)), np.empty(count)
    # Twice: the start has no atmosphere, and in a poor geometry is kilometres away from the place whose it should be.
    clocks = np.ones((4, 1))
    solve_choices(
        satellite, range_m, sigma_m, carrier_hz, tow_s, model, choice, clocks, 2, state, covariance, statistic
    )
    kept = np.zeros(count, np.bool_)
    for k in range(count):
        kept[k] = _is_near_within_sigma(state[k], covariance[k])
        if k > 0 and four[k] == four[k - 1]:  # unless both starts led to one solution
            moved_m2 = 0.0
            for i in range(4):
                moved_m2 += (state[k, i] - state[k - 1, i]) ** 2
            kept[k] &= moved_m2 > 100.0
    return four[:count][kept], state[kept], covariance[kept]


@compiled(error_model="numpy")
def extend_candidates(  # type: ignore[no-untyped-def]
    satellite,
    range_m,
    sigma_m,
    carrier_hz,
    tow_s,
    model,
    table,
    four_level,
    four_choice,
    four_state,
    four_covariance,
    skips,
    limit,
    most,
):
    """Extend candidates over satellites, breadth first from the fours, with at most `skips` skipped.

    table (n, c) : the free signals of each satellite, -1 where there are no more. four_level (f,) : the last satellite
    of each four, ascending; four_choice (f, n), four_state (f, 4), four_covariance (f, 4, 4) : the fours of free
    signals. limit : of the statistic. most : candidates that a level keeps, those with the smallest statistics.

    Returns choice (m, n), states, covariances and statistics.
    """
    n = table.shape[0]
    choice, state = np.empty((0, n), np.int64), np.empty((0, 4))
    covariance, statistic = np.empty((0, 4, 4)), np.empty(0)
    clocks, place, seen, delays = np.ones((n, 1)), np.empty(8), np.empty(7), np.empty(4)
    next_four = 0
    for level in range(3, n):
        parents = len(statistic)
        # Each candidate without a signal of this satellite, where it may be skipped.
        staying = np.zeros(parents, np.bool_)
        for m in range(parents):
            skipped = 0
            for k in range(level + 1):
                skipped += choice[m, k] < 0
            staying[m] = skipped <= skips
        # And with each free one, where that is near its prediction.
        signals = table[level][table[level] >= 0]
        parent, taken, children = (
            np.empty(parents * signals.size, np.int64),
            np.empty(parents * signals.size, np.int64),
            0,
        )
        for m in range(parents):
            _fill_place(state[m], place)
            for row in signals:
                misfit_m = _compute_misfit(
                    satellite, range_m, carrier_hz, tow_s, model, row, place, state[m], seen, delays
                )
                variance_m2 = _compute_prediction_m2(covariance[m], seen) + sigma_m[row] ** 2 + delays[2] ** 2
                if statistic[m] + misfit_m**2 / variance_m2 <= _LINEAR_SLACK * limit:
                    parent[children], taken[children] = m, row
                    children += 1
        child_choice, child_state = np.empty((children, n), np.int64), np.empty((children, 4))
        child_covariance, child_statistic = np.empty((children, 4, 4)), np.empty(children)
        for c in range(children):
            child_choice[c] = choice[parent[c]]
            child_choice[c, level] = taken[c]
            child_state[c] = state[parent[c]]
        solve_choices(
            satellite,
            range_m,
            sigma_m,
            carrier_hz,
            tow_s,
            model,
            child_choice[:, : level + 1].copy(),
            clocks,
            1,
            child_state,
            child_covariance,
            child_statistic,
        )
        kept = np.zeros(children, np.bool_)
        for c in range(children):
            kept[c] = child_statistic[c] <= limit and _is_near_within_sigma(child_state[c], child_covariance[c])
        if kept.sum() > most:
            order = np.flatnonzero(kept)[np.argsort(child_statistic[kept])]
            kept[order[most:]] = False
        fours = 0
        while next_four + fours < len(four_level) and four_level[next_four + fours] == level:
            fours += 1
        last_four = next_four + fours
        choice = np.concatenate((choice[staying], child_choice[kept], four_choice[next_four:last_four]))
        state = np.concatenate((state[staying], child_state[kept], four_state[next_four:last_four]))
        covariance = np.concatenate((covariance[staying], child_covariance[kept], four_covariance[next_four:last_four]))
        statistic = np.concatenate((statistic[staying], child_statistic[kept], np.zeros(fours)))
        next_four = last_four
    return choice, state, covariance, statistic
