"""The likely slips of who states where an antenna stands: each gives the place, distance or baseline that was meant.

A statement that the signals contradict may be untrue for one of these reasons; they are tried before signals are called
false. Each slip says by its code what went wrong. A new one is one more row in one of the three functions here.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.constants import FOOT_M
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.geoid import GEOID_SIGMA_M, interpolate_geoid_m

__all__ = [
    "HEIGHT",
    "UNLISTED",
    "DistanceSlip",
    "PositionSlip",
    "VectorSlip",
    "list_distance_slips",
    "list_position_slips",
    "list_vector_slips",
]

UNLISTED: Final = "wrong_statement"
"""Code of a statement that is untrue by an amount that no slip gives."""
HEIGHT: Final = "height"
"""Code of a height that is wrong by any amount, as of a mark on the ground below an antenna."""
_YARD_M: Final = 0.9144
_ANY_HEIGHT_M: Final = 1e4
"""One sigma of a height that is left open."""
_MODEL_SIGMA_M: Final = float(np.hypot(GEOID_SIGMA_M, 1.0))
"""Of a height above the geoid made one above the ellipsoid, one sigma: the grid, the model, and levelling to it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PositionSlip:
    """Where an antenna stands if its position was stated with this slip.

    position_ecef_m : (3,). covariance_m2 : (3, 3) of what the slip leaves open, ECEF. value : what would be right.
    """

    code: str
    words: str
    position_ecef_m: Reals
    covariance_m2: Reals
    value: str


@dataclass(frozen=True, kw_only=True)
class DistanceSlip:
    """How far apart two antennas are if their distance was stated with this slip."""

    code: str
    words: str
    distance_m: float


@dataclass(frozen=True, eq=False, kw_only=True)
class VectorSlip:
    """What turns places that were stated with this slip, east, north, up, into those that were meant: (3, 3)."""

    code: str
    words: str
    turn: Reals


def list_position_slips(position_ecef_m: Reals) -> tuple[PositionSlip, ...]:
    """List where an antenna may stand that was stated to be at `position_ecef_m` (3,).

    The last one leaves the height open: it holds if the level position is right.
    """
    lat_rad, lon_rad, height = geodetic_from_ecef(position_ecef_m)
    lat, lon, height_m = float(np.degrees(lat_rad)), float(np.degrees(lon_rad)), float(height)
    feet_m = height_m * FOOT_M
    heights = (
        ("height_above_sea_level", "its height is above sea level", height_m, 1.0),
        ("height_in_feet", "its height is in feet", feet_m, 0.0),
        ("height_in_feet_above_sea_level", "its height is in feet above sea level", feet_m, 1.0),
        ("height_separation_sign", "the geoid's height was added with the wrong sign", height_m, 2.0),
    )
    found = []
    for code, words, base_m, geoids in heights:
        up_m = base_m + geoids * float(interpolate_geoid_m(lat, lon))
        sigma_m = geoids * _MODEL_SIGMA_M + abs(base_m - height_m) * 1e-4
        found.append(_make_position(code, words, lat, lon, up_m, sigma_m, value=f"height_m = {up_m:.1f}"))
    for code, words, other_lat, other_lon in _iterate_level_slips(lat, lon):
        value = f"lat_deg = {other_lat:.7f}, lon_deg = {other_lon:.7f}"
        found.append(_make_position(code, words, other_lat, other_lon, height_m, 0.0, value=value))
    found.append(
        _make_position(HEIGHT, "its height is wrong", lat, lon, height_m, _ANY_HEIGHT_M, value="another height_m")
    )
    return tuple(found)


def _iterate_level_slips(lat: float, lon: float) -> Iterator[tuple[str, str, float, float]]:
    """Iterate over code, words, latitude and longitude in degrees."""
    if abs(lon) <= 90.0:
        yield "latitude_and_longitude_swapped", "latitude and longitude are exchanged", lon, lat
    yield "longitude_sign", "the longitude has the wrong sign", lat, -lon
    yield "latitude_sign", "the latitude has the wrong sign", -lat, lon
    yield "signs", "latitude and longitude have the wrong sign", -lat, -lon
    for code, words, read in (
        ("degrees_and_minutes", "degrees and minutes are written as a decimal number", _read_minutes),
        ("degrees_minutes_seconds", "degrees, minutes and seconds are written as a decimal number", _read_seconds),
    ):
        other_lat, other_lon = read(lat), read(lon)
        if other_lat is not None and other_lon is not None:
            yield code, words, other_lat, other_lon
        if other_lat is not None:
            yield f"latitude_{code}", f"of the latitude {words}", other_lat, lon
        if other_lon is not None:
            yield f"longitude_{code}", f"of the longitude {words}", lat, other_lon


def _read_minutes(value: float) -> float | None:
    """Read 35.0808 as 35 degrees and 08.08 minutes; None where that is no number of minutes."""
    degrees = np.floor(abs(value) + 1e-12)
    minutes = 100.0 * (abs(value) - degrees)
    return float(np.copysign(degrees + minutes / 60.0, value)) if minutes < 60.0 else None


def _read_seconds(value: float) -> float | None:
    """Read 35.080503 as 35 degrees, 08 minutes and 05.03 seconds; None where those are no minutes or seconds."""
    degrees = np.floor(abs(value) + 1e-12)
    hundredths = 100.0 * (abs(value) - degrees)
    minutes = np.floor(hundredths + 1e-9)
    seconds = 100.0 * (hundredths - minutes)
    if minutes >= 60.0 or seconds >= 60.0:
        return None
    return float(np.copysign(degrees + minutes / 60.0 + seconds / 3600.0, value))


def _make_position(
    code: str, words: str, lat: float, lon: float, height_m: float, sigma_up_m: float, *, value: str
) -> PositionSlip:
    lat_rad, lon_rad = np.radians(lat), np.radians(lon)
    up = rot_enu_ecef(lat_rad, lon_rad)[2]
    return PositionSlip(
        code=code,
        words=words,
        position_ecef_m=ecef_from_geodetic(lat_rad, lon_rad, height_m),
        covariance_m2=sigma_up_m**2 * np.outer(up, up),
        value=value,
    )


_SCALES: Final = (
    ("feet", "it is in feet", FOOT_M),
    ("made_feet", "it was turned into feet", 1.0 / FOOT_M),
    ("yards", "it is in yards", _YARD_M),
    ("centimetres", "it is in centimetres", 0.01),
    ("millimetres", "it is in millimetres", 0.001),
    ("kilometres", "it is in kilometres", 1000.0),
    ("twice", "it is twice what it should be", 0.5),
    ("half", "it is half of what it should be", 2.0),
    ("decimal_point", "its decimal point is one place off", 10.0),
    ("decimal_point", "its decimal point is one place off", 0.1),
)
"""Code, words, and what a length that is stated so has to be multiplied by."""


def list_distance_slips(distance_m: float) -> tuple[DistanceSlip, ...]:
    """List how far apart two antennas may be that were stated to be `distance_m` apart."""
    return tuple(DistanceSlip(code=code, words=words, distance_m=distance_m * by) for code, words, by in _SCALES)


def list_vector_slips() -> tuple[VectorSlip, ...]:
    """List what may have been done to places that are stated as east, north, up.

    Turns of any angle, as by a wrong attitude, are not among them: they do not change distances.
    """
    east, north, up = np.eye(3)
    axes = (
        ("north_east_down", "it is north, east, down", (north, east, -up)),
        ("east_and_north_swapped", "east and north are exchanged", (north, east, up)),
        ("east_sign", "east has the wrong sign, as of right and left", (-east, north, up)),
        ("north_sign", "north has the wrong sign, as of fore and aft", (east, -north, up)),
        ("up_sign", "up has the wrong sign, as of down", (east, north, -up)),
        ("receivers_swapped", "the receivers are exchanged, or all signs", (-east, -north, -up)),
    )
    turned = [VectorSlip(code=code, words=words, turn=np.array(rows)) for code, words, rows in axes]
    return (*turned, *(VectorSlip(code=code, words=words, turn=by * np.eye(3)) for code, words, by in _SCALES))
