"""Motion of bodies: trajectories that give place, attitude and all derivatives at any time.

Whatever a trajectory gives belongs to one smooth curve: velocity is the derivative of the place, the angular rate that
of the attitude, exactly. So receivers, antennas and inertial sensors of one body agree with each other.

Body axes and angles are those of `skyproof.gnss.frames`: forward, right, down; heading, pitch, roll. An array drawn
with its x axis forward and azimuths clockwise from it keeps its picture: y is right. Rates are those of the body with
respect to the Earth, which an inertial sensor sees on top of the Earth's own.

Times are seconds of float64 since the scene's start. Velocities and accelerations are those of the Earth-fixed frame.
"""

from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.errors import ScenarioError
from skyproof.gnss.constants import WGS84_A_M, WGS84_F
from skyproof.gnss.frames import geodetic_from_ecef, rot_ned_body
from skyproof.records import freeze
from skyproof.simulator.taylor import differentiate, multiply, multiply_cross, multiply_dot, normalise

__all__ = [
    "AlongMotion",
    "Held",
    "Lever",
    "Motion",
    "SpinningArm",
    "Trajectory",
    "assemble_motion",
    "check_times",
    "compute_antenna_motion",
    "compute_axes",
]

_GRAVITY_M_S2: Final = 9.80665  # to bank with; the true one differs by less than 0.4 % on the ground


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """A body at n moments.

    position_ecef_m, velocity_ecef_m_s, acceleration_ecef_m_s2 : (n, 3).
    attitude : (n, 3, 3), `vector_ecef = attitude @ vector_body`; its columns are forward, right and down.
    angular_rate_body_rad_s, angular_acceleration_body_rad_s2 : (n, 3), of the body with respect to ECEF, in body axes.
    """

    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    acceleration_ecef_m_s2: Reals
    attitude: Reals
    angular_rate_body_rad_s: Reals
    angular_acceleration_body_rad_s2: Reals

    def __post_init__(self) -> None:
        vector = ("epoch", "3")
        freeze(
            self,
            {
                "position_ecef_m": vector,
                "velocity_ecef_m_s": vector,
                "acceleration_ecef_m_s2": vector,
                "attitude": ("epoch", "3", "3"),
                "angular_rate_body_rad_s": vector,
                "angular_acceleration_body_rad_s2": vector,
            },
        )


class Trajectory(Protocol):
    """A motion over time."""

    @property
    def span_s(self) -> tuple[float, float]:
        """Return from when to when it is given; beyond, it continues as its class describes."""
        ...

    def at(self, t_s: ArrayLike) -> Motion:
        """Return the motion at times (n,)."""
        ...


# --- attitude


@dataclass(frozen=True)
class Held:
    """An attitude that stays the same with respect to north, east and down."""

    heading_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0


@dataclass(frozen=True)
class AlongMotion:
    """Forward is where the way leads, at a standstill too.

    bank : roll so that a plumb hangs straight down in the body, as an aircraft does in a coordinated turn; otherwise
        the right side stays level. The Coriolis acceleration is left out: 0.06 degrees at 70 m/s.
    pitch : the nose points along the way up and down too; otherwise it stays level.
    """

    bank: bool = True
    pitch: bool = True


# --- points of the body


@dataclass(frozen=True, eq=False)
class Lever:
    """A point in body axes, (3,) or (n, 3), that may move within the body."""

    offset_body_m: Reals
    velocity_body_m_s: Reals
    acceleration_body_m_s2: Reals


@dataclass(frozen=True, kw_only=True)
class SpinningArm:
    """An antenna that circles within the body.

    rate_rad_s : right-handed about `axis_body`, which by default is down, so that it is clockwise from above.
    start_rad : at time 0, from forward (from down, if the axis is forward or backward) in the sense of the rate.
    centre_body_m : of the circle.
    """

    radius_m: float
    rate_rad_s: float
    start_rad: float = 0.0
    axis_body: tuple[float, float, float] = (0.0, 0.0, 1.0)
    centre_body_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.axis_body))
        if not (np.isfinite(length) and length > 0.0):
            raise ScenarioError(f"axis_body {self.axis_body}: expected a direction; give (0, 0, 1) for down")
        if not (np.isfinite(self.radius_m) and self.radius_m > 0.0):
            raise ScenarioError(f"radius_m {self.radius_m:g}: expected a number above zero; give the arm's length")
        if not np.isfinite(self.rate_rad_s):
            raise ScenarioError(f"rate_rad_s {self.rate_rad_s:g}: expected a number; give the rate of the spin")

    def at(self, t_s: ArrayLike) -> Lever:
        """Return the antenna at times (n,)."""
        axis = np.asarray(self.axis_body) / np.linalg.norm(self.axis_body)
        start = np.array([1.0, 0.0, 0.0] if abs(axis[0]) < 0.99 else [0.0, 0.0, 1.0])
        first = start - (start @ axis) * axis
        first /= np.linalg.norm(first)
        angle_rad = (self.start_rad + self.rate_rad_s * check_times(t_s))[:, np.newaxis]
        out = self.radius_m * (np.cos(angle_rad) * first + np.sin(angle_rad) * np.cross(axis, first))
        return Lever(
            np.asarray(self.centre_body_m) + out, self.rate_rad_s * np.cross(axis, out), -(self.rate_rad_s**2) * out
        )


def compute_antenna_motion(motion: Motion, lever_body_m: ArrayLike | Lever) -> Motion:
    """Compute the motion of a point of the body, given in body axes from the body's place.

    The point is (3,), (n, 3) fixed, or moving.

    Attitude and rates are the body's: an antenna on a spinning arm turns with the body only.
    """
    if not isinstance(lever_body_m, Lever):
        offset = np.asarray(lever_body_m, np.float64)
        lever_body_m = Lever(offset, np.zeros_like(offset), np.zeros_like(offset))
    out, rate, change = (
        lever_body_m.offset_body_m,
        lever_body_m.velocity_body_m_s,
        lever_body_m.acceleration_body_m_s2,
    )
    spin, spin_change = motion.angular_rate_body_rad_s, motion.angular_acceleration_body_rad_s2
    velocity = rate + np.cross(spin, out)
    acceleration = change + np.cross(spin_change, out) + np.cross(spin, np.cross(spin, out) + 2.0 * rate)

    def ecef(vector_body: Reals) -> Reals:
        return np.asarray((motion.attitude @ vector_body[..., np.newaxis])[..., 0])

    return replace(
        motion,
        position_ecef_m=motion.position_ecef_m + ecef(out),
        velocity_ecef_m_s=motion.velocity_ecef_m_s + ecef(velocity),
        acceleration_ecef_m_s2=motion.acceleration_ecef_m_s2 + ecef(acceleration),
    )


# --- series


def assemble_motion(place_ecef_m: Reals, axes: tuple[Reals, Reals, Reals]) -> Motion:
    """Assemble the motion that series of a place (5, 3, n) and of the body's axes (3, 3, n each) describe."""
    rate = _compute_angular_rate(*axes)
    return Motion(
        position_ecef_m=place_ecef_m[0].T,
        velocity_ecef_m_s=place_ecef_m[1].T,
        acceleration_ecef_m_s2=2.0 * place_ecef_m[2].T,
        attitude=np.stack([axis[0].T for axis in axes], axis=-1),
        angular_rate_body_rad_s=rate[0].T,
        angular_acceleration_body_rad_s2=rate[1].T,
    )


def compute_axes(
    place: Reals, direction: Reals, attitude: Held | AlongMotion, middle_ecef_m: Reals
) -> tuple[Reals, Reals, Reals]:
    """Compute forward, right, down: series of unit vectors, of the order of `direction`.

    place, direction : series (order + 3, 3, n) and (order + 1, 3, n); the direction is that of the way.
    middle_ecef_m : (3,) a place in whose surroundings up is wanted.
    """
    up = normalise(place[: len(direction)] * _compute_level_stretch(middle_ecef_m))
    if isinstance(attitude, Held):
        north_east_down = _compute_north_east_down(up)
        mix = rot_ned_body(attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad)
        forward, right, down = (
            sum(part * axis for part, axis in zip(column, north_east_down, strict=True)) for column in mix.T
        )
        return forward, right, down
    forward = direction
    if not attitude.pitch:
        forward = forward - multiply(multiply_dot(forward, up)[:, np.newaxis], up)
    forward = normalise(forward)
    lean = up
    if attitude.bank:
        lean = _GRAVITY_M_S2 * up + differentiate(differentiate(place))
    right = normalise(multiply_cross(forward, lean))
    return forward, right, multiply_cross(forward, right)


def _compute_north_east_down(up: Reals) -> tuple[Reals, Reals, Reals]:
    east = normalise(np.stack([-up[:, 1], up[:, 0], np.zeros_like(up[:, 0])], axis=1))
    return multiply_cross(up, east), east, -up


def _compute_level_stretch(place_ecef_m: Reals) -> Reals:
    """Compute the factors (3, 1) by which ECEF coordinates point up, square to the ellipsoid.

    tan(lat) = z / axis (N + h) / (N (1 - e^2) + h), with the ratio of one place: a kilometre higher, up is off by 5e-7
    rad.
    """
    lat_rad, _, height_m = geodetic_from_ecef(place_ecef_m)
    e2 = WGS84_F * (2.0 - WGS84_F)
    normal_m = WGS84_A_M / np.sqrt(1.0 - e2 * np.sin(lat_rad) ** 2)
    return np.array([[1.0], [1.0], [(normal_m + height_m) / (normal_m * (1.0 - e2) + height_m)]])


def _compute_angular_rate(forward: Reals, right: Reals, down: Reals) -> Reals:
    """Compute the series (2, 3, n) of the rate that turns the axes, in these axes."""
    return np.stack(
        [
            multiply_dot(down, differentiate(right)),
            multiply_dot(forward, differentiate(down)),
            multiply_dot(right, differentiate(forward)),
        ],
        axis=1,
    )


def check_times(t_s: ArrayLike) -> Reals:
    t_s = np.asarray(t_s, np.float64)
    if t_s.ndim != 1:
        raise ValueError(f"t_s has shape {t_s.shape}, expected (n,)")
    return t_s
