"""Write tracks for a globe: KML 2.2 (OGC 07-147r2) with Google's gx:Track, which gives every point its time."""

import os
from collections.abc import Iterator, Mapping
from typing import Final
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Instants, Reals
from skyproof.formats.atomic_write import write_lines
from skyproof.gnss.time import format_iso, utc_from_gpst

__all__ = ["Shape", "Track", "write_kml", "write_kml_lines"]

Track = tuple[Instants, ArrayLike, ArrayLike, ArrayLike]
"""gpst, lat_deg, lon_deg, height_m above the ellipsoid, each of shape (n_points,); a point with a NaN is left out."""

Shape = tuple[ArrayLike, ArrayLike]
"""lat_deg, lon_deg, each of shape (n_points,): one point, a line of two or more, or an area whose last is its first."""

_STYLES: Final = {  # kind: colour as aabbggrr, width in pixels
    "trusted": ("ff4bb33c", 4),  # green
    "consistent": ("ff9ed08f", 4),  # pale green
    "inertial": ("ff4bb33c", 2),
    "held": ("ff4bb33c", 2),
    "false": ("ff2b2be0", 4),  # red
    "unprotected": ("ffa0a0a0", 2),  # grey
    "possible": ("ffc08000", 4),  # blue
    "receiver": ("ff404040", 1),  # dark
}
_SHAPE_STYLE: Final = "source"
_SHAPE_COLOUR: Final = "0080ff"  # orange, as bbggrr


def write_kml(
    path: str | os.PathLike[str],
    tracks: Mapping[str, Track],
    shapes: Mapping[str, Shape] | None = None,
    *,
    name: str = "skyproof",
) -> None:
    """Write `tracks` and `shapes` to `path`, as `write_kml_lines` says. Raises ValueError as that does, OutputError as
    `writing` does."""
    write_lines(path, write_kml_lines(tracks, shapes, name=name), encoding="utf-8")


def write_kml_lines(
    tracks: Mapping[str, Track], shapes: Mapping[str, Shape] | None = None, *, name: str = "skyproof"
) -> Iterator[str]:
    """Write the lines of a KML document with one placemark a track, times in UTC to the millisecond.

    Points are laid on the ground: KML counts heights from the geoid, ours count from the ellipsoid, and the two are up
    to 100 m apart. The heights stand in the file all the same.

    Parameters
    ----------
    tracks : each with a name whose last word is its kind, "trusted", "consistent", "inertial", "held", "false",
        "unprotected", "possible" or "receiver": "rx1 trusted". The kind gives the colour. A track without a point is
        left out.

    shapes : points, lines and areas on the ground, each with its name: where sources of signals are seen.

    Raises
    ------
    ValueError : a name that ends in no kind.
    """
    for track in tracks:
        if _kind_from_name(track) not in _STYLES:
            raise ValueError(f'the track "{track}" must end in one of {", ".join(_STYLES)}')
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">'
    yield "<Document>"
    yield f"<name>{_escape_text(name)}</name>"
    for kind, (colour, width) in _STYLES.items():
        yield (
            f"<Style id={quoteattr(kind)}><IconStyle><color>{colour}</color></IconStyle>"
            f"<LineStyle><color>{colour}</color><width>{width}</width></LineStyle></Style>"
        )
    yield (
        f"<Style id={quoteattr(_SHAPE_STYLE)}><LineStyle><color>ff{_SHAPE_COLOUR}</color><width>2</width></LineStyle>"
        f"<PolyStyle><color>40{_SHAPE_COLOUR}</color></PolyStyle></Style>"
    )
    for track, points in tracks.items():
        yield from _write_placemark(track, *points)
    for shape, corners in (shapes or {}).items():
        yield from _write_shape(shape, *corners)
    yield "</Document>"
    yield "</kml>"


def _write_placemark(
    track: str, gpst: Instants, lat_deg: ArrayLike, lon_deg: ArrayLike, height_m: ArrayLike
) -> Iterator[str]:
    places: Reals = np.stack([np.asarray(column, np.float64) for column in (lon_deg, lat_deg, height_m)], axis=-1)
    good = np.isfinite(places).all(axis=-1) & ~np.isnat(gpst)
    if not good.any():
        return
    yield "<Placemark>"
    yield f"<name>{_escape_text(track)}</name>"
    yield "<description>Heights are above the WGS-84 ellipsoid; the track is drawn on the ground.</description>"
    yield f"<styleUrl>#{_kind_from_name(track)}</styleUrl>"
    yield "<gx:Track><altitudeMode>clampToGround</altitudeMode>"
    yield from (f"<when>{format_iso(utc_from_gpst(instant), 3)}Z</when>" for instant in gpst[good])
    yield from (f"<gx:coord>{lon:.9f} {lat:.9f} {height:.3f}</gx:coord>" for lon, lat, height in places[good].tolist())
    yield "</gx:Track>"
    yield "</Placemark>"


def _write_shape(name: str, lat_deg: ArrayLike, lon_deg: ArrayLike) -> Iterator[str]:
    corners = [f"{lon:.9f},{lat:.9f}" for lat, lon in np.transpose([lat_deg, lon_deg]).tolist()]
    yield f"<Placemark><name>{_escape_text(name)}</name><styleUrl>#{_SHAPE_STYLE}</styleUrl>"
    text = f"<coordinates>{' '.join(corners)}</coordinates>"
    if len(corners) == 1:
        yield f"<Point>{text}</Point>"
    elif corners[0] == corners[-1]:
        ring = f"<outerBoundaryIs><LinearRing>{text}</LinearRing></outerBoundaryIs>"
        yield f"<Polygon><tessellate>1</tessellate>{ring}</Polygon>"
    else:
        yield f"<LineString><tessellate>1</tessellate>{text}</LineString>"
    yield "</Placemark>"


def _kind_from_name(track: str) -> str:
    return track.rpartition(" ")[2]


def _escape_text(text: str) -> str:
    """Escape text for XML, and replace control characters, which XML cannot hold."""
    return escape("".join(letter if letter.isprintable() else " " for letter in text))
