"""Strapdown navigation: position, velocity and attitude from an inertial unit's readings, in ECEF axes.

The mechanisation of Ahmed, Khanafseh, Pervan, "GNSS Spoofing Detection and Exclusion by Decomposition of Complex Cross
Ambiguity Function (DCCAF) with INS Aiding", ION, equation 18, with its attitude kinematics put right: the paper turns
the body's rate into the navigation frame and takes that for the rates of Euler angles, which it is not. With C
from body to ECEF, Omega the Earth's rate, f and omega the readings,

    C' = C [omega x] - [Omega x] C
    v' = C f - 2 Omega x v + gravity(r)
    r' = v

where gravity contains the centrifugal part and turns with the place (a frame fixed over 17 km would be wrong by 0.026
m/s^2 at its ends). Readings are increments of angle and velocity; turning within an interval (coning, sculling) is
taken from the increments of two intervals (Savage, J. Guidance, Control, and Dynamics 21(1) and 21(2), 1998).
Error-free readings over 233 s lead back to an approach and to a circle to within 0.5 mm at 100 Hz, and to kilometres of
eights at 1.3 g that shake with 3 Hz to within 9 mm at 100 Hz, 1 mm at 200 Hz.
"""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import EARTH_ROTATION_RAD_S
from skyproof.gnss.gravity import compute_gravity_m_s2
from skyproof.records import ImuSeries, NavState

__all__ = ["navigate", "navigate_paths"]

_OMEGA: Final = EARTH_ROTATION_RAD_S
_GRAVITY_REACH_M: Final = 400.0  # within which gravity is taken as linear: 1e-7 m/s^2 at the ends
_CELL: Final = 0.1  # of that: places about which it is expanded


@compiled
def _rotate(matrix, angle, out):  # type: ignore[no-untyped-def]
    """Set out = matrix exp([angle x])."""
    x, y, z = angle[0], angle[1], angle[2]
    square = x * x + y * y + z * z
    if square < 1e-8:
        s, c = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        size = np.sqrt(square)
        s, c = np.sin(size) / size, (1.0 - np.cos(size)) / square
    e00, e11, e22 = 1.0 - c * (y * y + z * z), 1.0 - c * (x * x + z * z), 1.0 - c * (x * x + y * y)
    e01, e02, e12 = c * x * y - s * z, c * x * z + s * y, c * y * z - s * x
    e10, e20, e21 = c * x * y + s * z, c * x * z - s * y, c * y * z + s * x
    for i in range(3):
        a, b, d = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        out[i, 0] = a * e00 + b * e10 + d * e20
        out[i, 1] = a * e01 + b * e11 + d * e21
        out[i, 2] = a * e02 + b * e12 + d * e22


@compiled
def _cross(a, b, out):  # type: ignore[no-untyped-def]
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@compiled
def _advance(  # type: ignore[no-untyped-def]
    angle,
    speed,
    last_angle,
    last_speed,
    interval,
    position,
    velocity,
    attitude,
    centre,
    gravity,
    gradient,
    reach_m,
    places,
    speeds,
    attitudes,
):
    """Navigate over the increments (n, 3) and write the state after each; gravity linear about `centre`.

    It stops before the first interval that begins farther than `reach_m` from the centre, and returns how many it did.
    """
    w1, w2, w3, w4 = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    push, force, phi = np.empty(3), np.empty(3), np.empty(3)
    next_attitude = np.empty((3, 3))
    half = 0.5 * interval
    ca, sa = np.cos(_OMEGA * half), np.sin(_OMEGA * half)
    cf, sf = np.cos(_OMEGA * interval), np.sin(_OMEGA * interval)
    pull = np.empty(3)
    for k in range(angle.shape[0]):
        far = 0.0
        for i in range(3):
            far += (position[i] - centre[i]) ** 2
        if k > 0 and far > reach_m**2:
            return k
        _cross(last_angle, angle[k], w1)
        _cross(angle[k], speed[k], w2)
        _cross(last_angle, speed[k], w3)
        _cross(last_speed, angle[k], w4)
        for i in range(3):
            phi[i] = angle[k, i] + w1[i] / 12.0
            push[i] = speed[k, i] + 0.5 * w2[i] + (w3[i] + w4[i]) / 12.0
        # second order of the turn: 1/6 angle x (angle x speed)
        _cross(angle[k], w2, w1)
        for i in range(3):
            push[i] += w1[i] / 6.0
        for i in range(3):
            force[i] = attitude[i, 0] * push[0] + attitude[i, 1] * push[1] + attitude[i, 2] * push[2]
        # ECEF has turned by half the interval's angle in the mean
        x, y = ca * force[0] + sa * force[1], -sa * force[0] + ca * force[1]
        force[0], force[1] = x, y
        for i in range(3):
            w1[i] = position[i] - centre[i] + half * velocity[i]
        for i in range(3):
            pull[i] = gravity[i] + gradient[i, 0] * w1[0] + gradient[i, 1] * w1[1] + gradient[i, 2] * w1[2]
        for i in range(3):
            w2[i] = velocity[i] + 0.5 * (force[i] + interval * pull[i])  # half-way, without Coriolis
        vx = w2[0] + half * _OMEGA * 2.0 * velocity[1]
        vy = w2[1] - half * _OMEGA * 2.0 * velocity[0]
        w3[0] = velocity[0] + force[0] + interval * (pull[0] + 2.0 * _OMEGA * vy)
        w3[1] = velocity[1] + force[1] + interval * (pull[1] - 2.0 * _OMEGA * vx)
        w3[2] = velocity[2] + force[2] + interval * pull[2]
        # the force's centre of gravity within the interval, from its change and turning
        for i in range(3):
            w4[i] = (speed[k, i] - last_speed[i]) / 12.0
        _cross(angle[k], speed[k], w1)
        for i in range(3):
            w4[i] += w1[i] / 12.0
        for i in range(3):
            lag = attitude[i, 0] * w4[0] + attitude[i, 1] * w4[1] + attitude[i, 2] * w4[2]
            position[i] += interval * (0.5 * (velocity[i] + w3[i]) - lag)
            velocity[i] = w3[i]
        _rotate(attitude, phi, next_attitude)
        for j in range(3):
            x, y = next_attitude[0, j], next_attitude[1, j]
            attitude[0, j], attitude[1, j] = cf * x + sf * y, -sf * x + cf * y
            attitude[2, j] = next_attitude[2, j]
        for i in range(3):
            last_angle[i], last_speed[i] = angle[k, i], speed[k, i]
            places[k, i], speeds[k, i] = position[i], velocity[i]
            for j in range(3):
                attitudes[k, i, j] = attitude[i, j]
    return angle.shape[0]


def navigate(start: NavState, readings: ImuSeries) -> NavState:
    """States (n + 1) from the last of `start` on: that one, then after each of the n readings.

    The unit sits at the body's origin. The first reading's interval begins at `start`, and no reading is missing.
    """
    path = navigate_paths(
        start.position_ecef_m[-1],
        start.velocity_ecef_m_s[-1],
        start.attitude[-1],
        readings.specific_force_m_s2,
        readings.angular_rate_rad_s,
        readings.interval_s,
    )
    times = np.concatenate((start.gpst[-1:], readings.gpst))
    return NavState(gpst=times, position_ecef_m=path[0], velocity_ecef_m_s=path[1], attitude=path[2])


def navigate_paths(
    position_ecef_m: ArrayLike,
    velocity_ecef_m_s: ArrayLike,
    attitude: ArrayLike,
    specific_force_m_s2: ArrayLike,
    angular_rate_rad_s: ArrayLike,
    interval_s: float,
    *,
    before: ArrayLike | None = None,
    gravity_reach_m: float = _GRAVITY_REACH_M,
) -> tuple[Reals, Reals, Reals]:
    """Integrate position, velocity (..., n + 1, 3) and attitude (..., n + 1, 3, 3) of many units at once.

    Starts (..., 3), (..., 3) and (..., 3, 3); readings (..., n, 3); they broadcast.
    before : (..., 2, 3) specific force and angular rate of the reading before the first, by which pieces of a run are
        the whole run; without it the first is taken for it, which costs one correction for turning.
    gravity_reach_m : gravity is linear within this; its error grows with the square, and 233 s make 9 mm of 2 km.
    """
    speed = np.asarray(specific_force_m_s2, np.float64) * interval_s
    angle = np.asarray(angular_rate_rad_s, np.float64) * interval_s
    begin = (np.asarray(position_ecef_m, np.float64), np.asarray(velocity_ecef_m_s, np.float64))
    turned = np.asarray(attitude, np.float64)
    shape = np.broadcast_shapes(
        speed.shape[:-2], angle.shape[:-2], begin[0].shape[:-1], begin[1].shape[:-1], turned.shape[:-2]
    )
    n = speed.shape[-2]
    places, speeds = np.empty((*shape, n + 1, 3)), np.empty((*shape, n + 1, 3))
    attitudes = np.empty((*shape, n + 1, 3, 3))
    places[..., 0, :], speeds[..., 0, :], attitudes[..., 0, :, :] = begin[0], begin[1], turned
    speed, angle = np.broadcast_to(speed, (*shape, n, 3)), np.broadcast_to(angle, (*shape, n, 3))
    first = np.stack((speed[..., 0, :], angle[..., 0, :]), axis=-2) if n else np.zeros((*shape, 2, 3))
    last = first if before is None else np.broadcast_to(interval_s * np.asarray(before, np.float64), first.shape)
    for unit in np.ndindex(shape if n else (0,)):
        _navigate_path(
            np.ascontiguousarray(angle[unit]),
            np.ascontiguousarray(speed[unit]),
            last[unit],
            interval_s,
            gravity_reach_m,
            places[unit],
            speeds[unit],
            attitudes[unit],
        )
    return places, speeds, attitudes


def _navigate_path(
    angle: Reals,
    speed: Reals,
    last: Reals,
    interval_s: float,
    reach_m: float,
    places: Reals,
    speeds: Reals,
    attitudes: Reals,
) -> None:
    """Fill places, speeds (n + 1, 3) and attitudes (n + 1, 3, 3) from their first on.

    Gravity is computed again where needed.
    """
    position, velocity, attitude = places[0].copy(), speeds[0].copy(), attitudes[0].copy()
    last_speed, last_angle = last.copy()
    done, n = 0, len(angle)
    while done < n:
        ahead_s = min(0.9 * reach_m / (1e-9 + float(np.linalg.norm(velocity))), (n - done) * interval_s)
        cells = np.rint((position + ahead_s * velocity) / (_CELL * reach_m))
        centre, gravity, gradient = _compute_gravity(*cells.tolist(), _CELL * reach_m)
        done += _advance(
            angle[done:],
            speed[done:],
            last_angle,
            last_speed,
            interval_s,
            position,
            velocity,
            attitude,
            centre,
            gravity,
            gradient,
            reach_m,
            places[done + 1 :],
            speeds[done + 1 :],
            attitudes[done + 1 :],
        )


@lru_cache(maxsize=1024)
def _compute_gravity(x: float, y: float, z: float, cell_m: float) -> tuple[Reals, Reals, Reals]:
    """Return a place (3,) in whole cells, gravity there (3,) and its gradient (3, 3).

    Many units that fly one way share it.
    """
    place_ecef_m = cell_m * np.array([x, y, z])
    step = 1000.0 * np.eye(3)
    sides = compute_gravity_m_s2(place_ecef_m + np.concatenate((step, -step)))
    return place_ecef_m, compute_gravity_m_s2(place_ecef_m), np.asarray((sides[:3] - sides[3:]).T / 2000.0)
