"""A body's state from stated angles and a position: attitude in ECEF, with what position and interpolation cost.

Heading, pitch and roll refer to north and the vertical where the body is. A position that is off turns the attitude by
as much as north and the vertical turn between the two, and directions to satellites by its share of their distance.
"""

from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from skyproof.arrays import Instants, Reals
from skyproof.gnss.frames import attitude_ecef, geodetic_from_ecef, rot_enu_ecef, rot_ned_body
from skyproof.gnss.time import seconds_between
from skyproof.records import Attitude, NavState

__all__ = ["bound_direction_error_rad", "estimate_interpolation_sigma_rad", "set_place", "state_from_angles"]

_SATELLITE_M: Final = 1.9e7  # nearer than any satellite of navigation in medium orbits
_HOLE: Final = 1.5  # median intervals between rows: farther apart, rows are missing


def bound_direction_error_rad(level_ecef_m: ArrayLike, place_ecef_m: ArrayLike, true_ecef_m: ArrayLike) -> float:
    """Bound the error of directions in body axes when the body is not where it is taken to be.

    All (3,). level_ecef_m : where stated angles were taken to refer to north and the vertical, which turn from place to
    place, north much faster towards the poles. place_ecef_m : from where directions to satellites are taken.
    """
    frames = [rot_enu_ecef(*geodetic_from_ecef(np.asarray(at, np.float64))[:2]) for at in (level_ecef_m, true_ecef_m)]
    turn_rad = float(scipy.spatial.transform.Rotation.from_matrix(frames[1].T @ frames[0]).magnitude())
    return turn_rad + float(np.linalg.norm(np.subtract(place_ecef_m, true_ecef_m))) / _SATELLITE_M


def estimate_interpolation_sigma_rad(attitude: Attitude) -> float:
    """Estimate the error of interpolated angles, one sigma about the worst axis.

    Each row is compared with the middle turn between its neighbours. Angles between two rows are nearer than that,
    since neighbours are twice as far apart; the rows' own noise is in it, too. 0 with fewer than three rows.
    """
    steps_s = seconds_between(attitude.gpst[1:], attitude.gpst[:-1])
    if steps_s.size < 2:
        return 0.0
    even = np.flatnonzero(np.maximum(steps_s[1:], steps_s[:-1]) <= _HOLE * np.median(steps_s)) + 1
    if not even.size:
        return 0.0
    rotation = scipy.spatial.transform.Rotation  # loaded by its first use
    turned = rotation.from_matrix(rot_ned_body(*attitude.angles_rad.T))
    before, after = turned[even - 1], turned[even + 1]
    middle = before * rotation.from_rotvec(0.5 * (before.inv() * after).as_rotvec())
    off = (middle.inv() * turned[even]).as_rotvec()
    return float(np.sqrt(np.mean(off**2, axis=0).max()))


def state_from_angles(
    attitude: Attitude, start_gpst: np.datetime64, end_gpst: np.datetime64, place_ecef_m: ArrayLike
) -> NavState | None:
    """Build the state over a window at a place (3,) from stated angles.

    Position and velocity have no variance yet: see `set_place`.

    One row holds over the whole window. Of several, those within and the nearest before and after; None if none is
    within or around, or rows are missing between them.
    """
    rows = _select_rows(attitude, start_gpst, end_gpst)
    if rows is None:
        return None
    gpst, angles_rad = rows
    places = np.tile(np.asarray(place_ecef_m, np.float64), (gpst.size, 1))
    return NavState(
        gpst=gpst,
        position_ecef_m=places,
        velocity_ecef_m_s=np.zeros((gpst.size, 3)),
        attitude=attitude_ecef(places, *angles_rad.T),
        covariance=np.tile(np.diag(np.repeat([0.0, 0.0, attitude.sigma_rad**2], 3)), (gpst.size, 1, 1)),
    )


def _select_rows(
    attitude: Attitude, start_gpst: np.datetime64, end_gpst: np.datetime64
) -> tuple[Instants, Reals] | None:
    if attitude.gpst.size == 1:
        return np.array([start_gpst, end_gpst]), attitude.angles_rad[[0, 0]]
    first = max(int(np.searchsorted(attitude.gpst, start_gpst, side="right")) - 1, 0)
    stop = min(int(np.searchsorted(attitude.gpst, end_gpst)) + 1, attitude.gpst.size)
    gpst = attitude.gpst[first:stop]
    usual_s = float(np.median(seconds_between(attitude.gpst[1:], attitude.gpst[:-1])))
    apart_s = seconds_between(gpst[1:], gpst[:-1])
    if gpst.size < 2 or gpst[-1] <= start_gpst or gpst[0] >= end_gpst or np.any(apart_s > _HOLE * usual_s):
        return None
    return gpst, attitude.angles_rad[first:stop]


def set_place(
    state: NavState, place_ecef_m: ArrayLike, place_covariance_m2: ArrayLike | None, more_rad: float = 0.0
) -> NavState:
    """Put a body at a place (3,) where it stands, or where only signals place it (covariance None).

    Velocity is nothing then, with no variance or an infinite one. more_rad : added to the attitude's sigma.
    """
    n = state.gpst.size
    covariance = np.zeros((n, 9, 9))
    if place_covariance_m2 is None:
        covariance[:, range(6), range(6)] = np.inf
    else:
        covariance[:, :3, :3] = place_covariance_m2
    turn = np.zeros((3, 3)) if state.covariance is None else state.covariance[:, 6:, 6:]
    covariance[:, 6:, 6:] = turn + more_rad**2 * np.eye(3)
    return NavState(
        gpst=state.gpst,
        position_ecef_m=np.tile(np.asarray(place_ecef_m, np.float64), (n, 1)),
        velocity_ecef_m_s=np.zeros((n, 3)),
        attitude=state.attitude,
        covariance=covariance,
    )
