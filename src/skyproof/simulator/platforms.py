"""Sites and antennas of a scenario as trajectories: where each point is at any time of the scene."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.formats.track import read_track
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef
from skyproof.simulator.motion import Motion, SpinningArm, Trajectory, compute_antenna_motion
from skyproof.simulator.scenario import Antenna
from skyproof.simulator.sites import HIGHEST_M, LOWEST_M, Circle, FromFile, LasVegas, Site, WayPoints
from skyproof.simulator.trajectories import (
    ecef_from_enu,
    from_track,
    make_circle,
    make_las_vegas,
    make_las_vegas_false,
    make_static,
    make_way_points,
)

__all__ = ["Point", "compute_motion", "make_antenna_point", "make_trajectory", "require_span"]

Point = Callable[[Reals], Motion]
"""The motion of a point at times (n,) since the scene's start."""


def make_trajectory(site: Site, where: str) -> Trajectory:
    """Make the trajectory that a site's table describes.

    Raises ScenarioError that begins with `where`, its key's path.
    """
    origin = ecef_from_geodetic(*site.geodetic_rad)
    path = site.path
    try:
        if path is None:
            return make_static(
                origin,
                heading_rad=np.radians(site.heading_deg),
                pitch_rad=np.radians(site.pitch_deg),
                roll_rad=np.radians(site.roll_deg),
            )
        if isinstance(path, WayPoints):
            return make_way_points(
                ecef_from_enu(path.points_enu_m, origin),
                path.speed_m_s,
                acceleration_m_s2=path.acceleration_m_s2,
                lateral_m_s2=path.turn_m_s2,
                start_s=path.start_s,
                from_rest=path.from_rest,
                to_rest=path.to_rest,
            )
        if isinstance(path, Circle):
            return make_circle(
                origin, path.radius_m, path.speed_m_s, clockwise=path.clockwise, start_rad=np.radians(path.start_deg)
            )
        if isinstance(path, LasVegas):
            return make_las_vegas() if path.shown == "true" else make_las_vegas_false()
        assert isinstance(path, FromFile)
        return from_track(read_track(path.path), start_s=path.start_s, speed_m_s=path.speed_m_s)
    except ScenarioError as error:
        raise ScenarioError(f"{where}.path: {error}") from error


def require_span(trajectory: Trajectory, first_s: float, last_s: float, where: str) -> None:
    """Raise ScenarioError unless a trajectory is known from one time to another, neither underground nor too high."""
    known_from_s, known_to_s = trajectory.span_s
    if known_from_s > first_s or known_to_s < last_s:
        raise ScenarioError(
            f"{where}.path: known from {known_from_s:.3f} s to {known_to_s:.3f} s, but the scene needs {first_s:.3f} s "
            f"to {last_s:.3f} s; set start_s, or shorten the scene"
        )
    at_s = np.linspace(first_s, last_s, 200)
    height_m = geodetic_from_ecef(trajectory.at(at_s).position_ecef_m)[2]
    ends = (int(height_m.argmin()), "under the ground"), (int(height_m.argmax()), "above the atmosphere")
    for number, side in ends:
        if not LOWEST_M <= height_m[number] <= HIGHEST_M:
            raise ScenarioError(
                f"{where}.path: {height_m[number]:.0f} m high at {at_s[number]:.1f} s, {side}; expected "
                f"{LOWEST_M:.0f} m to {HIGHEST_M:.0f} m over the ellipsoid; correct the heights of its points, or "
                "shorten the scene"
            )


def compute_motion(trajectory: Trajectory, at_s: ArrayLike) -> Motion:
    """Return the motion at times (n,); beyond the known span, that at its ends."""
    return trajectory.at(np.clip(np.atleast_1d(np.asarray(at_s, np.float64)), *trajectory.span_s))


def make_antenna_point(trajectory: Trajectory, antenna: Antenna) -> Point:
    """Make the moving point of an antenna of a body."""
    body_m = np.array(antenna.body_m)
    spin = antenna.spin
    if spin is None and not body_m.any():
        return lambda at_s: compute_motion(trajectory, at_s)
    if spin is None:
        return lambda at_s: compute_antenna_motion(compute_motion(trajectory, at_s), body_m)
    arm = SpinningArm(
        radius_m=spin.radius_m,
        rate_rad_s=2.0 * np.pi * spin.rate_hz,
        start_rad=np.radians(spin.start_deg),
        centre_body_m=antenna.body_m,
    )
    return lambda at_s: compute_antenna_motion(compute_motion(trajectory, at_s), arm.at(at_s))
