"""Curves through space over time, with all derivatives exact: ways through points with rounded corners, and circles.

Everything that changes does so by one smooth step, a polynomial of degree 7 whose first three derivatives vanish at
both ends. Along a way the curvature goes over by such steps, over time the speed does; so the place has four continuous
derivatives, and a body that banks into its turns has a continuous angular acceleration.

A way through points given on the Earth is planned in a plane and bent down to the ellipsoid with its two principal
curvatures at the middle of the way. Legs then keep their height between the points: to 2 mm if all points lie within
40 km of the middle, to 0.3 m within 150 km. The speed changes a little: with the distance from the middle over the
Earth's radius, q, it comes out too high by q^2 / 2 (2e-5 at 40 km), and on a climb of slope s by s q.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.gnss.constants import WGS84_A_M, WGS84_F
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.simulator.taylor import compute_sine_cosine, differentiate, evaluate_polynomial, integrate, multiply

__all__ = [
    "CircularPath",
    "Course",
    "Frame",
    "Pace",
    "PiecewisePath",
    "TimedPath",
    "lay_circle",
    "lay_path",
    "make_frame",
    "make_pace",
    "require_turnable",
    "smooth_step",
]

ORDER: Final = 4  # derivatives of the place: the angular acceleration of a body that banks needs the fourth
_STEP: Final = (-20.0, 70.0, -84.0, 35.0, 0.0, 0.0, 0.0, 0.0)
_STEP_SUM: Final = (-2.5, 10.0, -14.0, 7.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # its integral from 0: 1/2 at 1
STEEPEST: Final = 35.0 / 16.0
"""Slope of the smooth step in its middle, where it is steepest."""
FARTHEST_M: Final = 150e3  # of a way's points from their middle
MOST_LATERAL_M_S2: Final = 100.0
"""Ten times gravity: what nothing with a pilot and few things without one stand."""
_SHARPEST_RAD: Final = float(np.radians(170.0))
_STRAIGHT_RAD: Final = 1e-10  # a corner of less is not rounded: at 100 m/s, the velocity changes by 10 nm/s
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)  # half a turn within a piece: 1e-13 of its length


@dataclass(frozen=True, eq=False)
class Course:
    """Series of n moments: `place_ecef_m` (ORDER + 1, 3, n) and the `direction` (3, 3, n) in which it leads.

    The direction is there also where the speed is zero; its length is 1, or nearly so.
    """

    place_ecef_m: Reals
    direction: Reals


class TimedPath(Protocol):
    """A place over time, for all times."""

    @property
    def middle_ecef_m(self) -> Reals: ...

    def at(self, t_s: Reals) -> Course: ...


@dataclass(frozen=True, eq=False)
class Frame:
    """East, north, up at an origin; up is counted from a plane, or from that plane bent down like the ellipsoid.

    bend_1_m : (2,) principal curvatures to the east and to the north; zero for a plane.
    """

    origin_ecef_m: Reals
    rot_enu_ecef: Reals
    bend_1_m: Reals

    def enu_m(self, ecef_m: Reals) -> Reals:
        """Convert points (..., 3) to this frame."""
        enu_m: Reals = (ecef_m - self.origin_ecef_m) @ self.rot_enu_ecef.T
        enu_m[..., 2] += 0.5 * enu_m[..., :2] ** 2 @ self.bend_1_m
        return enu_m

    def course(self, enu_m: Reals, direction: Reals) -> Course:
        """Convert series of a place and a direction from this frame to ECEF."""
        if self.bend_1_m.any():
            bent = enu_m[:, :2] * self.bend_1_m[:, np.newaxis]
            enu_m, direction = enu_m.copy(), direction.copy()
            direction[:, 2] -= multiply(bent, direction[:, :2]).sum(axis=1)
            enu_m[:, 2] -= 0.5 * multiply(bent, enu_m[:, :2]).sum(axis=1)
        place_ecef_m = np.einsum("ji,kjn->kin", self.rot_enu_ecef, enu_m)
        place_ecef_m[0] += self.origin_ecef_m[:, np.newaxis]
        return Course(place_ecef_m, np.einsum("ji,kjn->kin", self.rot_enu_ecef, direction))


def make_frame(origin_ecef_m: Reals, *, level: bool = False) -> Frame:
    """Make the frame at a point (3,); `level` bends it down to the ellipsoid."""
    lat_rad, lon_rad, height_m = geodetic_from_ecef(origin_ecef_m)
    e2 = WGS84_F * (2.0 - WGS84_F)
    w2 = 1.0 - e2 * np.sin(lat_rad) ** 2
    east_m = WGS84_A_M / np.sqrt(w2) + height_m
    north_m = WGS84_A_M * (1.0 - e2) / w2**1.5 + height_m
    bend_1_m = np.array([1.0 / east_m, 1.0 / north_m]) if level else np.zeros(2)
    return Frame(np.asarray(origin_ecef_m, np.float64), rot_enu_ecef(lat_rad, lon_rad), bend_1_m)


def smooth_step(a: Reals) -> Reals:
    """Compute the series of the step from 0 to 1 while `a` goes from 0 to 1.

    Its third derivative is the last continuous one.
    """
    inside = (a[0] > 0.0) & (a[0] < 1.0)
    held = np.where(inside, a, 0.0)
    held[0] = np.clip(a[0], 0.0, 1.0)
    return evaluate_polynomial(_STEP, held)


def _integrate_step(a: Reals) -> Reals:
    """Integrate the step from 0 to `a`, any shape."""
    return np.asarray(np.polyval(_STEP_SUM, np.clip(a, 0.0, 1.0)) + np.maximum(a - 1.0, 0.0))


@dataclass(frozen=True, eq=False)
class Pace:
    """How far it is along the way at a time: speed goes from one value to the next by smooth steps.

    speed_m_s : before the first step. start_s : when the way is 0 m.
    steps : (n_steps, 3): begins at (s), takes (s), adds (m/s).
    """

    speed_m_s: float
    steps: Reals
    start_s: float = 0.0

    def at(self, t_s: Reals) -> Reals:
        """Compute the series (ORDER + 1, n) of the way in metres."""
        way_m = self.speed_m_s * (t_s - self.start_s)
        speed_m_s = np.zeros((ORDER, t_s.size))
        speed_m_s[0] = self.speed_m_s
        for begin_s, length_s, gain_m_s in self.steps:
            share = np.zeros((ORDER, t_s.size))
            share[0] = (t_s - begin_s) / length_s
            share[1] = 1.0 / length_s
            way_m += gain_m_s * length_s * _integrate_step(share[0])
            speed_m_s += gain_m_s * smooth_step(share)
        return integrate(speed_m_s, way_m)


def make_pace(
    length_m: float, speed_m_s: float, acceleration_m_s2: float, *, from_rest: bool, to_rest: bool, start_s: float
) -> Pace:
    """Make a constant speed, reached from rest at `start_s` and given up at the end, as asked for.

    acceleration_m_s2 : the most that is reached. Raises ScenarioError if the way is too short for it.
    """
    _require_positive("speed_m_s", speed_m_s, "give the speed between the turns, or a static receiver")
    _require_positive("acceleration_m_s2", acceleration_m_s2, "give the greatest acceleration that is reached")
    step_s = STEEPEST * speed_m_s / acceleration_m_s2
    steps_m = 0.5 * speed_m_s * step_s * (from_rest + to_rest)
    if steps_m > length_m:
        raise ScenarioError(
            f"speed_m_s {speed_m_s:g}: gathering and losing it at {acceleration_m_s2:g} m/s^2 takes {steps_m:.1f} m, "
            f"but the way is {length_m:.1f} m long; lower the speed, raise the acceleration or begin and end in motion"
        )
    steps, begin_s = [], start_s
    if from_rest:
        steps.append((begin_s, step_s, speed_m_s))
        begin_s += step_s
    if to_rest:
        steps.append((begin_s + (length_m - steps_m) / speed_m_s, step_s, -speed_m_s))
    return Pace(0.0 if from_rest else speed_m_s, np.array(steps).reshape(-1, 3), start_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class PiecewisePath:
    """Pieces, each in a plane of its own: straight, or with a curvature that changes by a smooth step.

    Before the first piece and behind the last one it continues straight. Fields are arrays with a row for each piece.
    """

    frame: Frame
    pace: Pace
    start_m: Reals  # (n,) where the piece begins along the way
    length_m: Reals
    origin_m: Reals  # (n, 3) its first point
    ahead: Reals  # (n, 3) unit vector along the way there
    aside: Reals  # (n, 3) unit vector to the side to which it bends
    from_1_m: Reals  # (n,) curvature at its start
    to_1_m: Reals
    total_m: float

    @property
    def middle_ecef_m(self) -> Reals:
        return self.frame.origin_ecef_m

    @property
    def duration_s(self) -> float:
        """Return the time from the first point to the last one."""
        gained = self.pace.steps[:, 2] > 0
        cruise_m_s = self.pace.speed_m_s + float(self.pace.steps[gained, 2].sum())
        return self.total_m / cruise_m_s + 0.5 * float(self.pace.steps[:, 1].sum())

    def at(self, t_s: Reals) -> Course:
        way_m = self.pace.at(t_s)
        piece = np.clip(np.searchsorted(self.start_m, way_m[0], side="right") - 1, 0, None)
        inside_m = way_m.copy()
        inside_m[0] -= self.start_m[piece]
        length_m, from_1_m = self.length_m[piece], self.from_1_m[piece]
        change_1_m = self.to_1_m[piece] - from_1_m
        curvature_1_m = change_1_m * smooth_step(inside_m[: ORDER - 1] / length_m)
        curvature_1_m[0] += from_1_m
        speed_m_s = differentiate(way_m)
        turned_rad = _compute_turned_rad(inside_m[0], length_m, from_1_m, change_1_m)
        sine, cosine = compute_sine_cosine(integrate(multiply(curvature_1_m, speed_m_s), turned_rad))
        ahead, aside = self.ahead[piece].T, self.aside[piece].T
        direction = cosine[:, np.newaxis] * ahead + sine[:, np.newaxis] * aside
        ahead_m, aside_m = inside_m[0].copy(), np.zeros_like(turned_rad)
        bent = np.flatnonzero((from_1_m != 0.0) | (change_1_m != 0.0))
        ahead_m[bent], aside_m[bent] = _integrate_advance_m(
            inside_m[0, bent], length_m[bent], from_1_m[bent], change_1_m[bent]
        )
        place_m = self.origin_m[piece].T + ahead_m * ahead + aside_m * aside
        return self.frame.course(integrate(multiply(speed_m_s[:, np.newaxis], direction), place_m), direction[:3])


def _compute_turned_rad(inside_m: Reals, length_m: Reals, from_1_m: Reals, change_1_m: Reals) -> Reals:
    """Compute the angle by which a piece has turned, any shapes that broadcast."""
    return np.asarray(from_1_m * inside_m + change_1_m * length_m * _integrate_step(inside_m / length_m))


def _integrate_advance_m(inside_m: Reals, length_m: Reals, from_1_m: Reals, change_1_m: Reals) -> tuple[Reals, Reals]:
    """Integrate how far a piece has led ahead and aside, any shape: Gauss-Legendre from its start."""
    ahead_m, aside_m = np.zeros_like(inside_m), np.zeros_like(inside_m)
    for node, weight in zip(0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS, strict=True):
        turned_rad = _compute_turned_rad(node * inside_m, length_m, from_1_m, change_1_m)
        ahead_m += weight * np.cos(turned_rad)
        aside_m += weight * np.sin(turned_rad)
    return ahead_m * inside_m, aside_m * inside_m


def lay_path(
    points_ecef_m: Reals,
    speed_m_s: float,
    *,
    radius_m: float,
    turn_in_m: float,
    level: bool,
    acceleration_m_s2: float,
    from_rest: bool,
    to_rest: bool,
    start_s: float,
) -> PiecewisePath:
    """Lay straight legs and, before each point but the ends, a turn that leads from one leg into the next.

    The corner itself is cut. A turn bends more and more over `turn_in_m`, then holds `radius_m`, then bends less and
    less; if it ends before the radius is reached, it stays wider.

    Raises
    ------
    ScenarioError : fewer than two points, two points in one place, a turn back, turns that do not fit between the
        points, points too far apart, or what `make_pace` raises.
    """
    points_ecef_m = np.asarray(points_ecef_m, np.float64)
    if points_ecef_m.ndim != 2 or len(points_ecef_m) < 2:
        raise ScenarioError(f"way points: {len(points_ecef_m)} given, expected 2 or more; give more, or a static place")
    if not np.isfinite(points_ecef_m).all():
        row = int(np.flatnonzero(~np.isfinite(points_ecef_m).all(axis=1))[0])
        raise ScenarioError(f"way points[{row}]: not a number, expected a place; give its coordinates")
    frame = make_frame(_find_middle(points_ecef_m), level=level)
    points_m = frame.enu_m(points_ecef_m)
    far_m = np.hypot(points_m[:, 0], points_m[:, 1])
    if level and far_m.max() > FARTHEST_M:
        raise ScenarioError(
            f"way points[{int(far_m.argmax())}]: {far_m.max() / 1e3:.0f} km from the middle of the way, expected at "
            f"most {FARTHEST_M / 1e3:.0f} km; give a shorter way"
        )
    legs_m = np.diff(points_m, axis=0)
    long_m = np.linalg.norm(legs_m, axis=1)
    for leg in np.flatnonzero(long_m < 1e-3).tolist():
        raise ScenarioError(f"way points[{leg + 1}]: the same place as the one before; leave one of them out")
    ahead = legs_m / long_m[:, np.newaxis]
    turns = [_make_turn(ahead[i], ahead[i + 1], i + 1, radius_m, turn_in_m) for i in range(len(ahead) - 1)]
    cut_m = np.array([0.0, *(turn.cut_m for turn in turns), 0.0])
    for leg in np.flatnonzero(cut_m[:-1] + cut_m[1:] > long_m).tolist():
        raise ScenarioError(
            f"way points[{leg}] to [{leg + 1}]: {long_m[leg]:.1f} m apart, but their turns need "
            f"{cut_m[leg] + cut_m[leg + 1]:.1f} m of it; turn with a smaller radius (a greater lateral acceleration), "
            "go slower, or move the points apart"
        )
    pieces: list[_Piece] = []
    for leg, unit in enumerate(ahead):
        begin_m = points_m[leg] + cut_m[leg] * unit
        pieces.append(_Piece(float(long_m[leg] - cut_m[leg] - cut_m[leg + 1]), begin_m, unit, np.zeros(3), 0.0, 0.0))
        if leg < len(turns):
            shift_m = points_m[leg + 1] - cut_m[leg + 1] * unit
            pieces += [piece._replace(origin_m=piece.origin_m + shift_m) for piece in turns[leg].pieces]
    length_m, origin_m, forward, aside, from_1_m, to_1_m = (np.array(column) for column in zip(*pieces, strict=True))
    total_m = float(length_m.sum())
    pace = make_pace(total_m, speed_m_s, acceleration_m_s2, from_rest=from_rest, to_rest=to_rest, start_s=start_s)
    return PiecewisePath(
        frame=frame,
        pace=pace,
        start_m=np.cumsum(length_m) - length_m,
        length_m=np.maximum(length_m, 1e-9),
        origin_m=origin_m,
        ahead=forward,
        aside=aside,
        from_1_m=from_1_m,
        to_1_m=to_1_m,
        total_m=total_m,
    )


class _Piece(NamedTuple):
    """A row of `PiecewisePath`."""

    length_m: float
    origin_m: Reals
    ahead: Reals
    aside: Reals
    from_1_m: float
    to_1_m: float


class _Turn(NamedTuple):
    """The pieces of a turn, whose first point is the origin, and how far from the corner it leaves both legs."""

    pieces: list[_Piece]
    cut_m: float


def _make_turn(ahead: Reals, then: Reals, number: int, radius_m: float, turn_in_m: float) -> _Turn:
    across = then - (then @ ahead) * ahead
    angle_rad = float(np.arctan2(np.linalg.norm(across), then @ ahead))
    if angle_rad > _SHARPEST_RAD:
        raise ScenarioError(
            f"way points[{number}]: the way turns back by {np.degrees(angle_rad):.1f} degrees there, expected at most "
            f"{np.degrees(_SHARPEST_RAD):.0f}; put two points where it turns"
        )
    if angle_rad < _STRAIGHT_RAD:
        return _Turn([], 0.0)
    aside = across / np.linalg.norm(across)
    bend_1_m = min(1.0 / radius_m, angle_rad / turn_in_m)  # a small angle is turned before the radius is reached
    hold_m = max(angle_rad / bend_1_m - turn_in_m, 0.0)
    rows = [(turn_in_m, 0.0, bend_1_m), (hold_m, bend_1_m, bend_1_m), (turn_in_m, bend_1_m, 0.0)]
    length_m, from_1_m, to_1_m = np.array([row for row in rows if row[0] > 0.0]).T
    ahead_m, aside_m = _integrate_advance_m(length_m, length_m, from_1_m, to_1_m - from_1_m)
    sine, cosine = (
        turn(_compute_turned_rad(length_m, length_m, from_1_m, to_1_m - from_1_m)) for turn in (np.sin, np.cos)
    )
    pieces, origin_m = [], np.zeros(3)
    for k in range(len(length_m)):
        pieces.append(_Piece(float(length_m[k]), origin_m, ahead, aside, float(from_1_m[k]), float(to_1_m[k])))
        origin_m = origin_m + ahead_m[k] * ahead + aside_m[k] * aside
        ahead, aside = cosine[k] * ahead + sine[k] * aside, cosine[k] * aside - sine[k] * ahead
    return _Turn(pieces, float(np.linalg.norm(origin_m) / (2.0 * np.cos(0.5 * angle_rad))))  # it is symmetric


@dataclass(frozen=True, eq=False)
class CircularPath:
    """A circle in a horizontal plane at a constant speed, for all times.

    start_rad : azimuth of the place from the centre at time 0, clockwise from north.
    rate_rad_s : of that azimuth, so that it is positive clockwise as seen from above.
    """

    frame: Frame
    radius_m: float
    start_rad: float
    rate_rad_s: float

    @property
    def middle_ecef_m(self) -> Reals:
        return self.frame.origin_ecef_m

    def at(self, t_s: Reals) -> Course:
        azimuth_rad = np.zeros((ORDER + 1, t_s.size))
        azimuth_rad[0] = np.remainder(self.start_rad + self.rate_rad_s * t_s, 2.0 * np.pi)
        azimuth_rad[1] = self.rate_rad_s
        sine, cosine = compute_sine_cosine(azimuth_rad)
        none = np.zeros_like(sine)
        direction = np.copysign(1.0, self.rate_rad_s) * np.stack([cosine, -sine, none], axis=1)
        return self.frame.course(self.radius_m * np.stack([sine, cosine, none], axis=1), direction[:3])


def lay_circle(
    centre_ecef_m: Reals, radius_m: float, speed_m_s: float, *, clockwise: bool, start_rad: float
) -> CircularPath:
    """Lay a level circle around a place.

    Raises ScenarioError if radius or speed is not above zero, or the one too small for the other.
    """
    _require_positive("radius_m", radius_m, "give the radius of the circle")
    _require_positive("speed_m_s", speed_m_s, "give the speed along the circle, or a static receiver")
    require_turnable(radius_m, speed_m_s)
    rate_rad_s = speed_m_s / radius_m * (1.0 if clockwise else -1.0)
    return CircularPath(make_frame(np.asarray(centre_ecef_m, np.float64)), radius_m, start_rad, rate_rad_s)


def require_turnable(radius_m: float, speed_m_s: float) -> None:
    """Raises ScenarioError if the lateral acceleration is more than vehicles stand."""
    lateral_m_s2 = speed_m_s**2 / radius_m
    if lateral_m_s2 > MOST_LATERAL_M_S2:
        raise ScenarioError(
            f"radius_m {radius_m:g}: at {speed_m_s:g} m/s it needs {lateral_m_s2:.0f} m/s^2, expected at most "
            f"{MOST_LATERAL_M_S2:g}; turn with at least {speed_m_s**2 / MOST_LATERAL_M_S2:.1f} m or go slower"
        )


def _find_middle(points_ecef_m: Reals) -> Reals:
    """Find a place amid the points: half-way between the extremes, at their mean height."""
    lat_rad, lon_rad, _ = geodetic_from_ecef(0.5 * (points_ecef_m.min(axis=0) + points_ecef_m.max(axis=0)))
    return ecef_from_geodetic(lat_rad, lon_rad, geodetic_from_ecef(points_ecef_m)[2].mean())


def _require_positive(name: str, value: float, remedy: str) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise ScenarioError(f"{name} {value:g}: expected a number above zero; {remedy}")
