"""Models of places and ways as a person writes them."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, PlainValidator, model_validator

from skyproof.arrays import Reals
from skyproof.formats.models import Model
from skyproof.gnss.signals import GPS_SATS

__all__ = [
    "Circle",
    "FromFile",
    "LasVegas",
    "SatName",
    "ScenePlace",
    "Site",
    "WayPoints",
    "interpolate_points",
    "require_rising",
]

CORNER_S = 2.0
LOWEST_M, HIGHEST_M = -500.0, 20_000.0
"""Places outside are taken for mistakes: no receiver is under the ground, and the standard atmosphere ends."""


def _check_sat(value: Any) -> str:
    if value not in GPS_SATS:
        raise ValueError(f"{value!r} is not a GPS satellite; write G01 to G32")
    return str(value)


SatName = Annotated[str, PlainValidator(_check_sat)]


def require_rising(times_s: Sequence[float], what: str) -> None:
    """Raise ValueError unless the times rise."""
    for number, (time_s, next_s) in enumerate(pairwise(times_s)):
        if next_s <= time_s:
            raise ValueError(f"{what}[{number + 1}] is at {next_s:g} s, not after {time_s:g} s; give times that rise")


def interpolate_points(
    points: Sequence[Sequence[float]], at_s: ArrayLike, columns: int, corner_s: float = CORNER_S
) -> Reals:
    """Interpolate rows of (time, values...) at other times (n,): (n, columns); held beyond the ends.

    Straight lines whose corners are rounded over `corner_s`, the mean over which is taken: rates are continuous, as
    those of any body and oscillator are, and a push of so many metres a second is one. Without `corner_s` they are
    sharp, as a generator of signals can make them.
    """
    at_s = np.asarray(at_s, np.float64)
    if not points:
        return np.zeros((*at_s.shape, columns))
    rows = np.array(points, np.float64)
    if corner_s == 0.0:
        return np.stack([np.interp(at_s, rows[:, 0], values) for values in rows[:, 1:].T], axis=-1)
    early, late = (_integrate_lines(rows, at_s + side * 0.5 * corner_s) for side in (-1.0, 1.0))
    return np.asarray((late - early) / corner_s)


def _integrate_lines(rows: Reals, at_s: Reals) -> Reals:
    """Integrate over time, from the first row on, straight lines between rows, held beyond the ends."""
    times_s, values = rows[:, 0], rows[:, 1:]
    sums = np.zeros(values.shape)
    sums[1:] = np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(times_s)[:, np.newaxis], axis=0)
    row = np.clip(np.searchsorted(times_s, at_s, side="right") - 1, 0, None)
    after_s = (at_s - times_s[row])[..., np.newaxis]
    slopes = np.zeros(values.shape)
    slopes[:-1] = np.diff(values, axis=0) / np.diff(times_s)[:, np.newaxis]
    slope = np.where(after_s < 0.0, 0.0, slopes[row])
    return np.asarray(sums[row] + after_s * (values[row] + 0.5 * slope * after_s))


class WayPoints(Model):
    """Route of straight legs through points, with smooth turns and a constant speed in between.

    points_enu_m : east, north, up from the site's position.
    acceleration_m_s2 : limit along the route.
    turn_m_s2 : limit across the route.
    from_rest, to_rest : true if it stands still at that end, false if it keeps moving.
    start_s : time at which it leaves the first point.
    """

    kind: Literal["way-points"] = "way-points"
    points_enu_m: tuple[tuple[float, float, float], ...] = Field(min_length=2)
    speed_m_s: float = Field(gt=0, le=1000)
    acceleration_m_s2: float = Field(default=1.0, gt=0, le=100)
    turn_m_s2: float = Field(default=2.0, gt=0, le=100)
    from_rest: bool = True
    to_rest: bool = True
    start_s: float = 0.0


class Circle(Model):
    """Level circle about the site's position, at constant speed. start_deg : azimuth from the centre at time 0."""

    kind: Literal["circle"] = "circle"
    radius_m: float = Field(gt=0, le=1e5)
    speed_m_s: float = Field(gt=0, le=1000)
    clockwise: bool = True
    start_deg: float = 0.0


class LasVegas(Model):
    """The approach of the paper on inertial exclusion, 233 s long: the true one, or what its spoofer shows."""

    kind: Literal["las-vegas"] = "las-vegas"
    shown: Literal["true", "false"] = "true"


class FromFile(Model):
    """Recorded route: CSV, NMEA or KML; smooth between its points.

    speed_m_s : speed, if the file has positions without times.
    start_s : time of the file's first point.
    """

    kind: Literal["file"] = "file"
    path: Path
    speed_m_s: float | None = Field(default=None, gt=0, le=1000)
    start_s: float = 0.0


Motion = Annotated[WayPoints | Circle | LasVegas | FromFile, Field(discriminator="kind")]


class ScenePlace(Model):
    """A point that stands still on the Earth."""

    lat_deg: float = Field(ge=-90, le=90)
    lon_deg: float = Field(ge=-180, le=180)
    height_m: float = Field(ge=LOWEST_M, le=HIGHEST_M)  # above the ellipsoid

    @property
    def geodetic_rad(self) -> tuple[float, float, float]:
        return float(np.radians(self.lat_deg)), float(np.radians(self.lon_deg)), self.height_m


class Site(ScenePlace):
    """A place, or a way that refers to it; a way that knows its own places needs none.

    heading_deg, pitch_deg, roll_deg : attitude of a site that stands still.
    """

    path: Motion | None = None
    heading_deg: float = Field(default=0.0, ge=-360, le=360)
    pitch_deg: float = Field(default=0.0, ge=-90, le=90)
    roll_deg: float = Field(default=0.0, ge=-180, le=180)

    @model_validator(mode="before")
    @classmethod
    def _place(cls, value: Any) -> Any:
        if type(value) is ScenePlace:
            return value.model_dump()
        path = value.get("path") if isinstance(value, dict) else None
        kind = path.get("kind") if isinstance(path, dict) else getattr(path, "kind", None)
        if kind in ("file", "las-vegas"):
            return {"lat_deg": 0.0, "lon_deg": 0.0, "height_m": 0.0} | value
        return value

    @model_validator(mode="after")
    def _check_attitude(self) -> Self:
        stated = [name for name in ("heading_deg", "pitch_deg", "roll_deg") if getattr(self, name) != 0.0]
        if self.path is not None and stated:
            raise ValueError(f"{stated[0]} is for what stands still: on a path the attitude follows from the motion")
        return self
