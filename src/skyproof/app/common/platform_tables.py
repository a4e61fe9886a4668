"""The tables of a platform file: receivers, attitude and inertial unit, as a person writes them.

Body axes are forward, right, down. Positions are geodetic, WGS-84. Standard deviations hold on each axis.
"""

from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import Field, PlainValidator, ValidationInfo, WithJsonSchema, field_validator, model_validator

from skyproof.arrays import Reals
from skyproof.errors import write_value
from skyproof.formats.models import FilePath, Instant, Model, Name, Number, find_repeated
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.imu_grades import GRADES, ImuGrade, imu_grade

__all__ = ["InitialAttitude", "PlatformImu", "PlatformReceiver", "PlatformSpin", "StatedAttitude", "Surveyed"]

ROTATION_ERROR: Final = 1e-3
"""Of each number of a matrix that is written with few digits."""
AXES: Final = {
    "frd": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "flu": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
    "rfu": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
}
"""Rotations from the unit's axes, named by where they point, to forward, right, down."""
ERRORS: Final = ("gyro_bias_deg_h", "gyro_noise_deg_sqrt_h", "accel_bias_ug", "accel_noise_m_s_sqrt_h")
GAIN_ERRORS: Final = ("scale_ppm", "misalignment_mrad")

Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
Metres = Annotated[Number, Field(ge=-1e3, le=1e3)]
Vector = tuple[Metres, Metres, Metres]
SigmaDeg = Annotated[Number, Field(gt=0.0, le=180.0)]


def _axes(value: Any) -> str | Matrix:
    if isinstance(value, str) and value in AXES:
        return value
    expected = f"expected {', '.join(map(repr, AXES))} or a rotation as three rows of three numbers"
    if not isinstance(value, list | tuple):
        raise ValueError(f"is {write_value(value)}, {expected}")
    rows = [list(row) for row in value if isinstance(row, list | tuple)]
    numbers = [x for row in rows for x in row if isinstance(x, float | int) and not isinstance(x, bool) and abs(x) <= 2]
    if len(value) != 3 or [len(row) for row in rows] != [3, 3, 3] or len(numbers) != 9:
        raise ValueError(f"is {write_value(value)}, {expected}")
    matrix = np.array(rows, np.float64)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 2.0 * ROTATION_ERROR or np.linalg.det(matrix) < 0.0:
        raise ValueError(
            f"is {write_value(value)}, expected a rotation: rows of length one at right angles, determinant +1; its "
            "rows are forward, right and down in the unit's axes"
        )
    first, second, third = ((float(a), float(b), float(c)) for a, b, c in rows)
    return first, second, third


class Surveyed(Model):
    """Where an antenna was surveyed to stand."""

    lat_deg: Number = Field(ge=-90.0, le=90.0, description="Geodetic latitude, WGS-84, degrees.", examples=[57.7])
    lon_deg: Number = Field(ge=-180.0, le=360.0, description="Longitude, east positive, degrees.", examples=[11.94])
    height_m: Number = Field(ge=-1e3, le=1e5, description="Height above the ellipsoid, metres.", examples=[50.0])
    sigma_m: Number = Field(gt=0.0, le=1e5, description="One sigma of each axis, metres.", examples=[0.05])

    @property
    def ecef_m(self) -> Reals:
        """Return the position, (3,) ECEF, WGS-84."""
        return ecef_from_geodetic(np.radians(self.lat_deg), np.radians(self.lon_deg), self.height_m)


class PlatformSpin(Model):
    """An arm that carries the antenna round in a level circle."""

    radius_m: Number = Field(
        gt=0.0, le=100.0, description="Distance from the axis to the antenna, metres.", examples=[0.0951]
    )
    rate_hz: Number = Field(
        ge=-50.0,
        le=50.0,
        description="Turns per second; positive is clockwise, seen from above. Not zero.",
        examples=[0.25],
    )
    rate_sigma_hz: Number = Field(
        default=0.0,
        ge=0.0,
        le=50.0,
        description="One sigma of rate_hz, hertz; 0 if it is known exactly.",
        examples=[0.001],
    )

    @field_validator("rate_hz")
    @classmethod
    def _turns(cls, rate_hz: float) -> float:
        if rate_hz == 0.0:
            raise ValueError("is 0, expected turns per second; leave spin out of an antenna that does not turn")
        return rate_hz


class PlatformReceiver(Model):
    """One receiver: its inputs, and where its antennas are."""

    name: Name | None = Field(
        default=None,
        description="Name in outputs and settings; that of its first input if absent.",
        examples=["rx1"],
    )
    inputs: tuple[FilePath, ...] = Field(
        default=(),
        max_length=64,
        description="Recordings, one file per antenna or one whose channels are the antennas, or an observation file; "
        "relative to the platform file.",
        examples=[["rx1.bin"]],
    )
    position: Surveyed | None = Field(
        default=None,
        description="Surveyed position of its first antenna.",
        examples=[{"lat_deg": 57.7, "lon_deg": 11.94, "height_m": 50.0, "sigma_m": 0.05}],
    )
    body_m: Vector | None = Field(
        default=None,
        description="Its first antenna in the body frame: forward, right, down, metres.",
        examples=[[0.0, 0.0, 0.0]],
    )
    antennas_m: tuple[Vector, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=64,
        description="Its antennas in the order of the inputs or channels, relative to body_m: forward, right, down, "
        "metres.",
        examples=[[[0.0, 0.0, 0.0], [0.19, 0.0, 0.0], [0.095, -0.165, 0.0]]],
    )
    antenna_sigma_m: Number | None = Field(
        default=None,
        gt=0.0,
        le=1e3,
        description="One sigma of body_m and antennas_m on each axis, metres; if absent 0.003 among the antennas of "
        "one receiver and 0.1 between receivers.",
        examples=[0.003],
    )
    antenna_pattern_sigma_m: Number | None = Field(
        default=None,
        ge=0.0,
        le=0.1,
        description="One sigma of each antenna's phase from direction to direction, by its own pattern and its "
        "neighbours, metres; if absent 0.004 in an array and 0.001 on an arm.",
        examples=[0.004],
    )
    line_bias_cyc: tuple[Number, ...] | None = Field(
        default=None,
        max_length=64,
        description="By how much each antenna's line delays the carrier, cycles; if absent, it is estimated from the "
        "signals.",
        examples=[[0.0, 0.12, -0.3]],
    )
    spin: PlatformSpin | None = Field(
        default=None,
        description="An arm that turns its antenna.",
        examples=[{"radius_m": 0.0951, "rate_hz": 0.25, "rate_sigma_hz": 0.001}],
    )

    @field_validator("inputs")
    @classmethod
    def _once_each(cls, inputs: tuple[Path, ...]) -> tuple[Path, ...]:
        for number in find_repeated(list(inputs)):
            raise ValueError(f"[{number}] repeats {inputs[number].name}; give each antenna's own recording")
        return inputs

    @field_validator("antennas_m", "line_bias_cyc")
    @classmethod
    def _one_an_antenna(cls, values: tuple[Any, ...] | None, info: ValidationInfo) -> tuple[Any, ...] | None:
        files, places = info.data.get("inputs") or (), info.data.get("antennas_m")
        count = len(places) if places is not None else len(files) if len(files) > 1 else None
        if values is not None and count is not None and len(values) != count:
            raise ValueError(
                f"has {len(values)} antennas, but {'antennas_m' if places is not None else 'inputs'} has {count}; "
                "give one of each for every antenna"
            )
        return values

    @field_validator("spin")
    @classmethod
    def _of_one_antenna(cls, spin: PlatformSpin | None, info: ValidationInfo) -> PlatformSpin | None:
        count = max(len(info.data.get(key) or ()) for key in ("inputs", "antennas_m", "line_bias_cyc"))
        if spin is not None and count > 1:
            raise ValueError(
                f"turns one antenna, but the receiver has {count}; "
                "describe the turning antenna as a receiver of its own"
            )
        return spin

    @property
    def antennas_body_m(self) -> Reals:
        """Return its antennas (n, 3) in the body frame; one at the origin if nothing is given."""
        origin = (0.0, 0.0, 0.0)
        return np.asarray(np.array(self.body_m or origin) + np.array(self.antennas_m or [origin]))

    @property
    def body_sigma_m(self) -> float:
        """Return the standard deviation of `body_m` on each axis, between antennas of two receivers."""
        return 0.1 if self.antenna_sigma_m is None else self.antenna_sigma_m


class InitialAttitude(Model):
    """How the body is turned at the start of the inertial readings."""

    heading_deg: Number = Field(
        ge=-360.0, le=360.0, description="From north to the right, degrees: where forward points.", examples=[40.0]
    )
    pitch_deg: Number = Field(default=0.0, ge=-90.0, le=90.0, description="Forward up, degrees.", examples=[0.6])
    roll_deg: Number = Field(default=0.0, ge=-180.0, le=180.0, description="Right side down, degrees.", examples=[0.0])
    sigma_deg: SigmaDeg = Field(description="One sigma about each axis, degrees.", examples=[0.5])


class StatedAttitude(Model):
    """How the body is turned: angles that stay, or a file of them."""

    heading_deg: Number | None = Field(
        default=None,
        ge=-360.0,
        le=360.0,
        description="From north to the right, degrees: where forward points.",
        examples=[35.0],
    )
    pitch_deg: Number = Field(default=0.0, ge=-90.0, le=90.0, description="Forward up, degrees.", examples=[2.0])
    roll_deg: Number = Field(default=0.0, ge=-180.0, le=180.0, description="Right side down, degrees.", examples=[-1.0])
    sigma_deg: SigmaDeg = Field(
        description="One sigma about each axis, degrees; of a file's angles as well.", examples=[0.2]
    )
    file: FilePath | None = Field(
        default=None,
        description="CSV or Parquet with gpst or time_s, heading_deg, pitch_deg, roll_deg, in place of the angles; "
        "relative to the platform file.",
        examples=["attitude.csv"],
    )

    @model_validator(mode="after")
    def _angles_or_file(self) -> Self:
        angles = [key for key in ("heading_deg", "pitch_deg", "roll_deg") if key in self.model_fields_set]
        if self.file is not None and angles:
            raise ValueError(f"{angles[0]} and file both state the attitude; leave one out")
        if self.file is None and self.heading_deg is None:
            raise ValueError("heading_deg is missing, or file: give one of the two")
        return self


class PlatformImu(Model):
    """An inertial unit and its readings."""

    file: FilePath | None = Field(
        default=None,
        description="CSV or Parquet with gpst or time_s, accel_x_m_s2 to accel_z_m_s2, gyro_x_rad_s to gyro_z_rad_s: "
        "means over the intervals that end at the time; relative to the platform file. The readings in the first "
        "input's flight log if absent.",
        examples=["imu.csv"],
    )
    start_gpst: Instant | None = Field(
        default=None,
        description="GPS time of time_s = 0; the start of the recording if absent.",
        examples=[datetime(2022, 1, 1, 10, 29, 58)],
    )
    grade: (
        Literal["consumer", "industrial", "tactical", "navigation", "tactical-calibrated", "navigation-calibrated"]
        | None
    ) = Field(
        default=None,
        description="Grade of its errors: consumer, industrial, tactical, navigation, and the last two with "
        "-calibrated; or give the four numbers. Consumer if neither is there.",
        examples=["tactical"],
    )
    gyro_bias_deg_h: Number | None = Field(
        default=None, ge=0.0, le=1e5, description="One sigma of the gyros' bias, degrees an hour.", examples=[0.5]
    )
    gyro_noise_deg_sqrt_h: Number | None = Field(
        default=None, ge=0.0, le=1e3, description="Angular random walk, degrees per root hour.", examples=[0.15]
    )
    accel_bias_ug: Number | None = Field(
        default=None,
        ge=0.0,
        le=1e6,
        description="One sigma of the accelerometers' bias, millionths of g (9.80665 m/s2).",
        examples=[50.0],
    )
    accel_noise_m_s_sqrt_h: Number | None = Field(
        default=None,
        ge=0.0,
        le=1e3,
        description="Velocity random walk, metres a second per root hour.",
        examples=[0.07],
    )
    scale_ppm: Number | None = Field(
        default=None,
        ge=0.0,
        le=1e5,
        description="One sigma of gyros' and accelerometers' scale factors, millionths; beside the four numbers. None "
        "if absent: then it drifts more than stated where it turns or speeds up.",
        examples=[500.0],
    )
    misalignment_mrad: Number | None = Field(
        default=None,
        ge=0.0,
        le=100.0,
        description="One sigma of each sensor's axis towards each other axis, thousandths of a radian; beside the four "
        "numbers. None if absent.",
        examples=[1.0],
    )
    axes: Annotated[
        str | Matrix,
        PlainValidator(_axes),
        WithJsonSchema(
            {
                "anyOf": [
                    {"enum": list(AXES)},
                    {
                        "type": "array",
                        "minItems": 3,
                        "maxItems": 3,
                        "items": {"type": "array", "minItems": 3, "maxItems": 3, "items": {"type": "number"}},
                    },
                ]
            }
        ),
    ] = Field(
        default="frd",
        description='Where its axes point: "frd" forward, right, down; "flu" forward, left, up; "rfu" right, forward, '
        "up; or the rotation from its axes to forward, right, down, as three rows.",
        examples=["flu"],
    )
    lever_arm_m: Vector = Field(
        default=(0.0, 0.0, 0.0),
        description="From the unit to the first receiver's first antenna: forward, right, down, metres. To other "
        "receivers it follows from body_m of both.",
        examples=[[0.4, 0.0, -1.2]],
    )
    initial: InitialAttitude | None = Field(
        default=None,
        description="The attitude at the first reading; without it, it is found from the motion.",
        examples=[{"heading_deg": 40.0, "pitch_deg": 0.6, "roll_deg": 0.0, "sigma_deg": 0.5}],
    )

    @model_validator(mode="after")
    def _grade_or_numbers(self) -> Self:
        stated = [key for key in (*ERRORS, *GAIN_ERRORS) if getattr(self, key) is not None]
        if self.grade is not None and stated:
            raise ValueError(f"grade and {stated[0]} both state its errors; leave one out")
        lacking = ", ".join(key for key in ERRORS if key not in stated)
        if stated and lacking:
            raise ValueError(f"{stated[0]} is given, but not {lacking}; give all four, or a grade")
        return self

    @property
    def errors(self) -> ImuGrade:
        """Return the size of its errors, by the grade or the numbers given, else the poorest units'."""
        if self.gyro_bias_deg_h is None:
            return GRADES[self.grade or "consumer"]
        numbers: dict[str, Any] = {name: getattr(self, name) or 0.0 for name in (*ERRORS, *GAIN_ERRORS)}
        return imu_grade(**numbers)

    @property
    def rotation(self) -> Reals:
        """Return the rotation (3, 3) from the unit's axes to forward, right, down."""
        rows = AXES[self.axes] if isinstance(self.axes, str) else self.axes
        left_vectors, _, right_vectors = np.linalg.svd(np.array(rows))
        return np.asarray(left_vectors @ right_vectors)
