"""Describe how antennas stand on the body that carries them, and how that body moves."""

from dataclasses import dataclass
from typing import Protocol

from skyproof.arrays import Instants, Reals
from skyproof.records.shapes import Selectable, freeze
from skyproof.short_repr import ShortRepr

__all__ = [
    "AntennaArray",
    "Attitude",
    "ImuSeries",
    "InertialReadings",
    "NavState",
    "SpinArm",
]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AntennaArray(ShortRepr):
    """Where the antennas of one receiver are, and what their lines do.

    elements_m : (n_antennas, 3) phase centres in the body frame (forward, right, down).
    sigma_m : of each phase centre along each axis; None if not known.
    pattern_sigma_m : of each phase by the antenna's pattern and its neighbours, as a length; None if not known.
    line_bias_cyc : (n_antennas,) by which each line delays the carrier; None if not known.
    """

    elements_m: Reals
    sigma_m: float | None = None
    pattern_sigma_m: float | None = None
    line_bias_cyc: Reals | None = None

    def __post_init__(self) -> None:
        lines: dict[str, tuple[str, ...]] = {} if self.line_bias_cyc is None else {"line_bias_cyc": ("antenna",)}
        freeze(self, {"elements_m": ("antenna", "3"), **lines})


@dataclass(frozen=True, eq=False, kw_only=True)
class SpinArm:
    """How the antenna of a receiver turns in a level circle: the arm's length, its rate and what is known of it.

    rate_sigma_rad_s : 0 if the rate is known exactly. Its sign, like the angle of the start, does not matter where
        signals are compared with each other.
    pattern_sigma_m : of the phase, by the antenna's pattern, as it turns; None if not known.
    """

    receiver: str
    radius_m: float
    rate_rad_s: float
    rate_sigma_rad_s: float = 0.0
    pattern_sigma_m: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ImuSeries(ShortRepr, Selectable):
    """Readings of one inertial measurement unit in body axes: means over the intervals that end at `gpst`.

    gpst : (n,) end of each interval, rising; where labels are more than one and a half intervals apart, readings are
        missing.
    interval_s : length of each interval; it times a reading is the increment of velocity or angle.
    specific_force_m_s2, angular_rate_rad_s : (n, 3); the rate is relative to inertial space.
    """

    BY_ROW = ("gpst", "specific_force_m_s2", "angular_rate_rad_s")

    gpst: Instants
    interval_s: float
    specific_force_m_s2: Reals
    angular_rate_rad_s: Reals

    def __post_init__(self) -> None:
        freeze(self, {"gpst": ("n",), "specific_force_m_s2": ("n", "3"), "angular_rate_rad_s": ("n", "3")})


class InertialReadings(Protocol):
    """Readings of one unit over a run, whose values may be on a disk: `ImuSeries` of a slice of them."""

    @property
    def gpst(self) -> Instants:
        """Return the ends of the intervals (n,), rising."""

    @property
    def interval_s(self) -> float:
        """Return the length of each interval."""

    def select(self, rows: slice, /) -> ImuSeries:
        """Return those of a slice without a step."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Attitude(ShortRepr):
    """How a body is turned over time: angles from the local level and true north, see `skyproof.gnss.frames`.

    gpst : (n,) rising. A single row holds at all times.
    angles_rad : (n, 3) heading, pitch, roll. sigma_rad : one sigma about each axis, constant over the time.
    """

    gpst: Instants
    angles_rad: Reals
    sigma_rad: float

    def __post_init__(self) -> None:
        freeze(self, {"gpst": ("n",), "angles_rad": ("n", "3")})


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class NavState(ShortRepr, Selectable):
    """Position, velocity and attitude of one body over time, relative to the Earth, in ECEF axes.

    gpst : (n,) rising. position_ecef_m, velocity_ecef_m_s : (n, 3).
    attitude : (n, 3, 3), `vector_ecef = attitude @ vector_body`; body axes are forward, right, down.
    covariance : (n, 9, 9) of the errors of position, velocity (ECEF axes) and attitude, m, m/s, rad; None if unknown.
        Attitude errors are the small rotation psi in ECEF axes with `attitude = (1 + [psi x]) true attitude`.
        Variances of position and velocity are infinite where these are only what the received signals say, which may
        be false: then they serve to express the attitude, and the attitude's part contains what that costs.
    """

    gpst: Instants
    position_ecef_m: Reals
    velocity_ecef_m_s: Reals
    attitude: Reals
    covariance: Reals | None = None

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[str, ...]] = {
            "gpst": ("n",),
            "position_ecef_m": ("n", "3"),
            "velocity_ecef_m_s": ("n", "3"),
            "attitude": ("n", "3", "3"),
        }
        freeze(self, shapes | ({} if self.covariance is None else {"covariance": ("n", "9", "9")}))
