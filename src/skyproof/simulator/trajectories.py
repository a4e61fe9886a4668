"""Trajectories: standing still, way points, circles, an approach, samples and files, and one drifting off another.

Each is a small object that can be asked for the motion at any times; `skyproof.simulator.motion` has the conventions.
Places come in as ECEF metres: `skyproof.gnss.frames.ecef_from_geodetic` and `ecef_from_enu` make them.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.formats.track import RecordedTrack
from skyproof.gnss.constants import FOOT_M
from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic, heading_pitch_roll_rad
from skyproof.simulator.motion import AlongMotion, Held, Motion, Trajectory, assemble_motion, check_times, compute_axes
from skyproof.simulator.paths import Pace, TimedPath, lay_circle, lay_path, make_frame, require_turnable

__all__ = [
    "Drifting",
    "Sampled",
    "Static",
    "Travel",
    "add_drift",
    "ecef_from_enu",
    "from_samples",
    "from_track",
    "make_circle",
    "make_las_vegas",
    "make_las_vegas_false",
    "make_static",
    "make_way_points",
]

_STEEPEST_LEG_RAD: Final = float(np.radians(80.0))
_KNOT_M_S: Final = 1852.0 / 3600.0
_FOREVER: Final = (-np.inf, np.inf)
_DEGREE: Final = 5  # of splines through samples: four continuous derivatives


@dataclass(frozen=True, eq=False)
class Static:
    """A body that stands still."""

    position_ecef_m: Reals
    attitude: Reals

    @property
    def span_s(self) -> tuple[float, float]:
        return _FOREVER

    def at(self, t_s: ArrayLike) -> Motion:
        n = check_times(t_s).size
        none = np.zeros((n, 3))
        return Motion(
            position_ecef_m=np.broadcast_to(self.position_ecef_m, (n, 3)),
            velocity_ecef_m_s=none,
            acceleration_ecef_m_s2=none,
            attitude=np.broadcast_to(self.attitude, (n, 3, 3)),
            angular_rate_body_rad_s=none,
            angular_acceleration_body_rad_s2=none,
        )


@dataclass(frozen=True, eq=False)
class Travel:
    """A body on a curve, with an attitude that its way or the horizon gives."""

    curve: TimedPath
    attitude: Held | AlongMotion

    @property
    def span_s(self) -> tuple[float, float]:
        return _FOREVER

    def at(self, t_s: ArrayLike) -> Motion:
        course = self.curve.at(check_times(t_s))
        place = course.place_ecef_m
        return assemble_motion(place, compute_axes(place, course.direction, self.attitude, self.curve.middle_ecef_m))


@dataclass(frozen=True, eq=False)
class Sampled:
    """A body whose places and attitudes are known at moments. Beyond them it goes straight on and turns no more."""

    span_s: tuple[float, float]
    origin_ecef_m: Reals
    place_m: "scipy.interpolate.BSpline"  # (n,) to (n, 3), from the origin
    attitudes: "scipy.spatial.transform.RotationSpline"

    def at(self, t_s: ArrayLike) -> Motion:
        t_s = check_times(t_s)
        held_s = np.clip(t_s, *self.span_s)
        inside = (t_s == held_s)[:, np.newaxis]
        velocity_m_s = self.place_m(held_s, 1)
        return Motion(
            position_ecef_m=self.origin_ecef_m + self.place_m(held_s) + (t_s - held_s)[:, np.newaxis] * velocity_m_s,
            velocity_ecef_m_s=velocity_m_s,
            acceleration_ecef_m_s2=np.where(inside, self.place_m(held_s, 2), 0.0),
            attitude=self.attitudes(held_s).as_matrix(),
            angular_rate_body_rad_s=np.where(inside, self.attitudes(held_s, 1), 0.0),
            angular_acceleration_body_rad_s2=np.where(inside, self.attitudes(held_s, 2), 0.0),
        )


@dataclass(frozen=True, eq=False)
class Drifting:
    """Another trajectory with an offset that grows: what a spoofer shows that drags its victim off.

    offset_ecef_m : (3,), all of it. share : its part over time, 0 to 1.
    """

    of: Trajectory
    offset_ecef_m: Reals
    share: Pace

    @property
    def span_s(self) -> tuple[float, float]:
        return self.of.span_s

    def at(self, t_s: ArrayLike) -> Motion:
        true = self.of.at(t_s)
        value, rate, half = self.share.at(check_times(t_s))[:3, :, np.newaxis] * self.offset_ecef_m
        return replace(
            true,
            position_ecef_m=true.position_ecef_m + value,
            velocity_ecef_m_s=true.velocity_ecef_m_s + rate,
            acceleration_ecef_m_s2=true.acceleration_ecef_m_s2 + 2.0 * half,
        )


def make_static(
    position_ecef_m: ArrayLike, *, heading_rad: float = 0.0, pitch_rad: float = 0.0, roll_rad: float = 0.0
) -> Static:
    """Make a body that stands still at a place (3,)."""
    place = _place("position_ecef_m", position_ecef_m)
    return Static(place, attitude_ecef(place, heading_rad, pitch_rad, roll_rad))


def make_way_points(
    points_ecef_m: ArrayLike,
    speed_m_s: float,
    *,
    acceleration_m_s2: float = 2.0,
    radius_m: float | None = None,
    lateral_m_s2: float = 2.0,
    turn_in_s: float = 2.0,
    start_s: float = 0.0,
    from_rest: bool = True,
    to_rest: bool = True,
    level: bool = True,
    attitude: Held | AlongMotion | None = None,
) -> Travel:
    """Make a way along points (n, 3) at one speed, on straight legs with smooth turns that cut corners.

    Parameters
    ----------
    acceleration_m_s2 : the most that is reached where the speed changes.
    radius_m : of the turns, or what `lateral_m_s2` gives at the speed.
    turn_in_s : in which a turn gets to its radius. Turns by a small angle stay wider.
    start_s : when it is at the first point; it stands there before, or has come in on the first leg.
    from_rest, to_rest : whether it stands at the ends; otherwise it has its speed there and goes straight on.
    level : legs keep their height, or climb evenly, over the ellipsoid, by `paths`' approximation; otherwise they are
        straight lines in space.
    attitude : `AlongMotion()` if None.

    Raises
    ------
    ScenarioError : speed or acceleration zero, radius too small for the speed, turns that do not fit, a leg too steep
        for an attitude along the motion, and what `lay_path` raises.
    """
    attitude = attitude if attitude is not None else AlongMotion()
    for name, value in (
        ("speed_m_s", speed_m_s),
        ("lateral_m_s2", lateral_m_s2),
        ("turn_in_s", turn_in_s),
        ("radius_m", 1.0 if radius_m is None else radius_m),
    ):
        if not (np.isfinite(value) and value > 0.0):
            raise ScenarioError(f"{name} {value:g}: expected a number above zero; give one")
    radius_m = radius_m if radius_m is not None else speed_m_s**2 / lateral_m_s2
    require_turnable(radius_m, speed_m_s)
    points = np.asarray(points_ecef_m, np.float64)
    way = lay_path(
        points,
        speed_m_s,
        radius_m=radius_m,
        turn_in_m=speed_m_s * turn_in_s,
        level=level,
        acceleration_m_s2=acceleration_m_s2,
        from_rest=from_rest,
        to_rest=to_rest,
        start_s=start_s,
    )
    if isinstance(attitude, AlongMotion):
        climb_rad = np.arcsin(np.abs(way.ahead[:, 2]).clip(max=1.0))
        if climb_rad.max() > _STEEPEST_LEG_RAD:
            raise ScenarioError(
                f"way points: a leg climbs or falls by {np.degrees(climb_rad.max()):.0f} degrees, which leaves no "
                f"heading, expected at most {np.degrees(_STEEPEST_LEG_RAD):.0f}; give a fixed heading, pitch and roll"
            )
    return Travel(way, attitude)


def make_circle(
    centre_ecef_m: ArrayLike,
    radius_m: float,
    speed_m_s: float,
    *,
    clockwise: bool = True,
    start_rad: float = 0.0,
    attitude: Held | AlongMotion | None = None,
) -> Travel:
    """Make a horizontal circle; `start_rad` is the azimuth from its centre at time 0.

    For all times, never at rest.

    Raises ScenarioError if radius or speed is not above zero, or the radius too small for the speed.
    """
    curve = lay_circle(
        _place("centre_ecef_m", centre_ecef_m), radius_m, speed_m_s, clockwise=clockwise, start_rad=start_rad
    )
    return Travel(curve, attitude if attitude is not None else AlongMotion())


def make_las_vegas(*, attitude: Held | AlongMotion | None = None) -> Travel:
    """Make the approach to runway 1R of Las Vegas, over 233 s from KIBSE.

    The paper on decomposing the correlation function gives the fix (35.939 N, 115.2447 W, 5100 ft), the threshold
    (36.075463 N, 115.166788 W, 2230 ft), a straight line between them at a constant 140 knots, and 233 s. Our choices:
    heights count from the ellipsoid; straight means straight in space, 5.5 m lower half-way than an even descent;
    140 knots are kept, so the threshold is crossed after 232.1 s and the rest is flown straight on; the nose points
    along the way, 3 degrees down.
    """
    ends = np.array([[35.939, -115.2447], [36.075463, -115.166788]])
    lat_rad, lon_rad = np.radians(ends.T)
    points = ecef_from_geodetic(lat_rad, lon_rad, np.array([5100.0, 2230.0]) * FOOT_M)
    return make_way_points(points, 140.0 * _KNOT_M_S, from_rest=False, to_rest=False, level=False, attitude=attitude)


def make_las_vegas_false(*, attitude: Held | AlongMotion | None = None) -> Drifting:
    """Make what the paper's spoofer shows: from 90 s on 1 m/s away up-east, constant from 190 s on.

    The offset is then 70.7 m east and 70.7 m up.

    The offset begins and ends over 2 s around these moments, not at once; its axes are those of the fix.
    """
    true = make_las_vegas(attitude=attitude)
    return add_drift(true, 100.0 * np.sqrt(0.5) * np.array([1.0, 0.0, 1.0]), 90.0, 190.0)


def add_drift(
    of: Trajectory, offset_enu_m: ArrayLike, begin_s: float, end_s: float, *, blend_s: float = 2.0
) -> Drifting:
    """Add an offset (3,) to a trajectory that grows evenly between two times.

    Its axes are those of the place at `begin_s`.

    blend_s : over which the rate of growth comes and goes, around both times. Raises ScenarioError if it is not above
        zero or does not fit between them.
    """
    if not 0.0 < blend_s <= end_s - begin_s:
        raise ScenarioError(
            f"drift: from {begin_s:g} s to {end_s:g} s with a blend of {blend_s:g} s, expected an end later than the "
            "begin by at least the blend, and a blend above zero; change one of them"
        )
    rate_1_s = 1.0 / (end_s - begin_s)
    steps = np.array([[begin_s - 0.5 * blend_s, blend_s, rate_1_s], [end_s - 0.5 * blend_s, blend_s, -rate_1_s]])
    place = of.at([begin_s]).position_ecef_m[0]
    offset_ecef_m = ecef_from_enu(offset_enu_m, place) - place
    return Drifting(of, offset_ecef_m, Pace(0.0, steps))


def from_samples(
    t_s: ArrayLike,
    position_ecef_m: ArrayLike,
    *,
    attitude: Reals | Held | AlongMotion | None = None,
    knot_s: float | None = None,
    slow_m_s: float = 0.5,
) -> Sampled:
    """Make a smooth curve through places (n, 3) at rising times (n,).

    Places are joined by a spline of degree 5 (of degree n - 1 if there are fewer than six), attitudes by one of degree
    3 whose angular acceleration is continuous.

    Parameters
    ----------
    attitude : (n, 3, 3) from body to ECEF, `Held`, or `AlongMotion()` if None: then the attitude is along the motion
        at the samples and between them smooth. Where the body is slower than `slow_m_s` it turns evenly from where it
        last headed to where it heads next; if it never is faster, it heads north.
    knot_s : for places with errors: the spline that comes nearest to them with a knot every so many seconds, instead
        of through all of them. An error of 1 m at 1 Hz makes 10 m/s^2 otherwise.

    Raises
    ------
    ScenarioError : fewer than two samples, times that do not rise, numbers that are none, shapes that do not fit, or
        knots closer than the samples.
    """
    t_s, places = _check_samples(t_s, position_ecef_m)
    origin_ecef_m = places[len(places) // 2]
    place_m = _fit_spline(t_s, places - origin_ecef_m, knot_s)
    if isinstance(attitude, np.ndarray):
        rotations = np.asarray(attitude, np.float64)
        if rotations.shape != (t_s.size, 3, 3):
            raise ScenarioError(f"attitude: shape {rotations.shape}, expected ({t_s.size}, 3, 3); give one per sample")
    elif isinstance(attitude, Held):
        rotations = attitude_ecef(places, attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad)
    else:
        rotations = _compute_attitude_along(
            t_s, origin_ecef_m + place_m(t_s), place_m(t_s, 1), place_m(t_s, 2), attitude or AlongMotion(), slow_m_s
        )
    transform = scipy.spatial.transform
    spline = transform.RotationSpline(t_s, transform.Rotation.from_matrix(rotations))
    return Sampled((float(t_s[0]), float(t_s[-1])), origin_ecef_m, place_m, spline)


def from_track(
    track: RecordedTrack,
    *,
    start_s: float = 0.0,
    speed_m_s: float | None = None,
    attitude: Held | AlongMotion | None = None,
    knot_s: float | None = None,
    slow_m_s: float = 0.5,
) -> Sampled:
    """Make the motion of a file's points; the first is reached at `start_s`.

    speed_m_s : needed if the file has no times, refused if it has; kept on the straight lines between the points.
    attitude : in place of the file's, or of `AlongMotion()` if it has none. `knot_s`, `slow_m_s`: see `from_samples`.

    Raises ScenarioError that names the file, as `from_samples` does.
    """
    try:
        t_s = _track_times(track, speed_m_s)
        stated: Reals | Held | AlongMotion | None = attitude
        if stated is None and track.attitude_rad is not None:
            stated = attitude_ecef(track.position_ecef_m, *track.attitude_rad.T)
        return from_samples(start_s + t_s, track.position_ecef_m, attitude=stated, knot_s=knot_s, slow_m_s=slow_m_s)
    except ScenarioError as error:
        raise ScenarioError(f"{track.source}: {error}") from error


def ecef_from_enu(enu_m: ArrayLike, origin_ecef_m: ArrayLike) -> Reals:
    """Convert places (..., 3) given as east, north, up from an origin (3,) to ECEF."""
    frame = make_frame(_place("origin_ecef_m", origin_ecef_m))
    return np.asarray(frame.origin_ecef_m + np.asarray(enu_m, np.float64) @ frame.rot_enu_ecef)


def _place(name: str, value: ArrayLike) -> Reals:
    place = np.asarray(value, np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ScenarioError(f"{name}: {place.tolist()}, expected three numbers, ECEF in metres; give a place")
    return place


def _check_samples(t_s: ArrayLike, position_ecef_m: ArrayLike) -> tuple[Reals, Reals]:
    t_s, places = np.asarray(t_s, np.float64), np.asarray(position_ecef_m, np.float64)
    if t_s.ndim != 1 or places.shape != (t_s.size, 3):
        raise ScenarioError(f"samples: times {t_s.shape} and places {places.shape}, expected (n,) and (n, 3)")
    if t_s.size < 2:
        raise ScenarioError(f"samples: {t_s.size} given, expected at least 2; give more, or a static place")
    for row in np.flatnonzero(~(np.isfinite(t_s) & np.isfinite(places).all(axis=1))):
        raise ScenarioError(f"samples[{row}]: not a number, expected a time and a place; leave the sample out")
    for row in np.flatnonzero(np.diff(t_s) <= 0.0):
        raise ScenarioError(
            f"samples[{row + 1}]: time {t_s[row + 1]:.9g} s is not after {t_s[row]:.9g} s; put the samples in order, "
            "one per moment"
        )
    return t_s, places


def _fit_spline(t_s: Reals, places_m: Reals, knot_s: float | None) -> "scipy.interpolate.BSpline":
    if knot_s is None:
        return scipy.interpolate.make_interp_spline(t_s, places_m, k=min(_DEGREE, t_s.size - 1))
    pieces = int((t_s[-1] - t_s[0]) / knot_s) if knot_s > 0.0 else 0
    inner_s = np.linspace(t_s[0], t_s[-1], pieces + 1)[1:-1] if pieces else np.empty(0)
    ends_s = np.repeat(t_s[[0, -1]], _DEGREE + 1)
    knots_s = np.concatenate([ends_s[: _DEGREE + 1], inner_s, ends_s[_DEGREE + 1 :]])
    try:
        if pieces < 1:
            raise ValueError("no knot fits")
        return scipy.interpolate.make_lsq_spline(t_s, places_m, knots_s, k=_DEGREE)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ScenarioError(
            f"knot_s {knot_s:g}: expected a time that many samples fill, everywhere, and that is shorter than all of "
            f"them ({t_s[-1] - t_s[0]:g} s); change it, or leave it out"
        ) from error


def _compute_attitude_along(
    t_s: Reals, places: Reals, velocity_m_s: Reals, acceleration_m_s2: Reals, options: AlongMotion, slow_m_s: float
) -> Reals:
    """Compute rotations (n, 3, 3) along the motion; where it is slow, angles change evenly."""
    fast = np.linalg.norm(velocity_m_s, axis=-1) >= slow_m_s
    if not fast.any():
        return attitude_ecef(places, 0.0, 0.0, 0.0)
    places_fast = places[fast]
    direction = velocity_m_s[fast] / np.linalg.norm(velocity_m_s[fast], axis=-1, keepdims=True)
    series = np.stack([places_fast.T, velocity_m_s[fast].T, 0.5 * acceleration_m_s2[fast].T])
    up = compute_axes(series, direction.T[np.newaxis], Held(), places[len(places) // 2])[2][0].T
    if np.abs(np.einsum("ni,ni->n", direction, up)).max() > np.sin(_STEEPEST_LEG_RAD):
        raise ScenarioError(
            "samples: the motion is too steep to have a heading; give a fixed heading, pitch and roll, or an attitude"
        )
    axes = compute_axes(series, direction.T[np.newaxis], options, places[len(places) // 2])
    angles = heading_pitch_roll_rad(places_fast, np.stack([axis[0].T for axis in axes], axis=-1))
    joined = (np.interp(t_s, t_s[fast], np.unwrap(angle)) for angle in angles)
    return attitude_ecef(places, *joined)


def _track_times(track: RecordedTrack, speed_m_s: float | None) -> Reals:
    if track.t_s is not None:
        if speed_m_s is not None:
            raise ScenarioError(f"speed_m_s {speed_m_s:g}: the file has times of its own; leave the speed out")
        return track.t_s
    if speed_m_s is None or not (np.isfinite(speed_m_s) and speed_m_s > 0.0):
        raise ScenarioError("speed_m_s: the file has no times, expected a speed above zero; give one")
    legs_m = np.linalg.norm(np.diff(track.position_ecef_m, axis=0), axis=1)
    for leg in np.flatnonzero(legs_m == 0.0):
        raise ScenarioError(f"points[{leg + 1}]: the same place as the one before; leave one of them out")
    return np.concatenate([[0.0], np.cumsum(legs_m) / speed_m_s])
