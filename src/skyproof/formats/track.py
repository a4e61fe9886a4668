"""Read points over time from CSV, NMEA 0183 or KML.

    CSV   a line of names, then rows. Time: `t_s` (seconds) or `gpst` (ISO 8601 without a zone). Place: `lat_deg`,
          `lon_deg`, `height_m` above the ellipsoid, or `x_ecef_m`, `y_ecef_m`, `z_ecef_m`. Attitude, if there is one:
          `heading_deg`, `pitch_deg`, `roll_deg`. Other columns do no harm.
    NMEA  GGA and RMC of any talker; times are UTC, their date is RMC's; heights as `skyproof.formats.nmea` writes them.
    KML   one gx:Track (with its gx:angles) or gx:MultiTrack, or the points of one LineString, which have no times.

A damaged sentence of NMEA costs itself, a point without a place too, which is reported in the remarks; a file that
leaves no point is refused.
"""

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from skyproof.arrays import Reals
from skyproof.errors import InputError, shorten
from skyproof.formats.bounds import CHARACTERS_OF_LINE, SECONDS, TRACK_BYTES, XML_TAGS
from skyproof.formats.byte_io import read_text
from skyproof.formats.documents import read_rows
from skyproof.formats.nmea_read import FARTHEST_M, read_sentence, split_fields
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.time import gpst_from_utc, parse_iso, require_year
from skyproof.records import freeze

__all__ = ["RecordedTrack", "parse_csv", "parse_kml", "parse_nmea", "read_track"]

_PLACE: Final = ("lat_deg", "lon_deg", "height_m")
_ECEF: Final = ("x_ecef_m", "y_ecef_m", "z_ecef_m")
_ANGLES: Final = ("heading_deg", "pitch_deg", "roll_deg")
_DAY_NS: Final = 86_400 * 10**9
_HEIGHT: Final = re.compile(r"HAE=(-?\d{1,9}(?:\.\d+)?)", re.ASCII)
_FROM_GEOID: Final = "heights are those above the geoid, taken as if above the ellipsoid, up to 100 m off"


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedTrack:
    """Points in order.

    position_ecef_m : (n, 3). attitude_rad : (n, 3) heading, pitch, roll, or None.
    t_s : (n,) since the first point, rising, or None if the file has no times.
    start_gpst : when the first point was, or None if the file does not state it.
    """

    source: str
    position_ecef_m: Reals
    t_s: Reals | None = None
    start_gpst: np.datetime64 | None = None
    attitude_rad: Reals | None = None
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[str, ...]] = {
            "position_ecef_m": ("point", "3"),
            "t_s": ("point",),
            "attitude_rad": ("point", "3"),
        }
        freeze(self, {name: shape for name, shape in shapes.items() if getattr(self, name) is not None})


def read_track(
    path: str | os.PathLike[str], *, name: str | None = None, geoid_separation_m: float | None = None
) -> RecordedTrack:
    """Read the points in a file that ends in .csv, .nmea, .txt (NMEA too) or .kml.

    Parameters
    ----------
    name : of the KML placemark, if the file has several with points.
    geoid_separation_m : height of the geoid above the ellipsoid, added to heights that count from the geoid.

    Raises
    ------
    InputError : the file cannot be read, or has another ending; it holds no points, or their times do not rise; or it
    holds several tracks and `name` does not choose one.
    """
    source = os.fspath(path)
    ending = Path(path).suffix.lower()
    if ending not in (".csv", ".nmea", ".txt", ".kml"):
        raise InputError(f'{source}: cannot read a track from a file that ends in "{ending}"; give .csv, .nmea or .kml')
    content = read_text(Path(path), TRACK_BYTES, "the track", "give a file of points")
    text = content.decode("utf-8", errors="replace")
    if ending == ".kml":
        return parse_kml(text, source=source, name=name, geoid_separation_m=geoid_separation_m)
    if ending == ".csv":
        return parse_csv(text, source=source)
    return parse_nmea(text.splitlines(), source=source, geoid_separation_m=geoid_separation_m)


# --- CSV


def parse_csv(text: str, *, source: str = "CSV") -> RecordedTrack:
    """Parse the points of a table, see above.

    Rows without a place are left out. Raises InputError as `read_track` does.
    """
    rows = read_rows(text, source)
    names = [name.strip() for name in next(rows, (1, list[str]()))[1]]
    time = next((name for name in ("t_s", "gpst") if name in names), None)
    place = next((group for group in (_PLACE, _ECEF) if set(group) <= set(names)), None)
    if time is None or place is None:
        raise InputError(
            f"{source}: line 1: the columns are {', '.join(names) or 'none'}, expected t_s or gpst, and "
            f"{', '.join(_PLACE)} or {', '.join(_ECEF)}; name the columns so"
        )
    angles = _ANGLES if set(_ANGLES) <= set(names) else ()
    missing = [name for name in _ANGLES if name not in names]
    if missing and len(missing) < len(_ANGLES):
        raise InputError(f"{source}: line 1: {', '.join(missing)} is missing beside the other angles; give all three")
    columns = [names.index(name) for name in (time, *place, *angles)]
    instants: list[int] = []
    numbers: list[list[float]] = []
    lines: list[int] = []
    left_out = 0
    for number, row in rows:
        if not any(field.strip() for field in row):
            continue
        where = f"{source}: line {number}"
        if len(row) < len(names):
            raise InputError(f"{where}: {len(row)} fields, expected {len(names)}; correct the line or leave it out")
        when, *fields = (row[column].strip() for column in columns)
        if not all(fields[:3]):
            left_out += 1
            continue
        instants.append(_parse_instant_ns(when, time, where))
        numbers.append(
            [_parse_number(field, name, where) for field, name in zip(fields, (*place, *angles), strict=True)]
        )
        lines.append(number)
    if not numbers:
        raise InputError(f"{source}: no row has a place; give a file with points")
    table = np.array(numbers)
    remarks = (f"{left_out} rows without a place are left out",) if left_out else ()
    return RecordedTrack(
        source=source,
        position_ecef_m=_check_near_earth(table[:, :3], source, lines)
        if place is _ECEF
        else _convert_to_ecef(table[:, :3], source, lines),
        t_s=_count_rising_s(instants, source, lines),
        start_gpst=np.datetime64(instants[0], "ns") if time == "gpst" else None,
        attitude_rad=np.radians(table[:, 3:]) if angles else None,
        remarks=remarks,
    )


def _parse_instant_ns(text: str, column: str, where: str) -> int:
    if column == "t_s":
        t_s = _parse_number(text, column, where)
        if abs(t_s) > SECONDS:
            raise InputError(f"{where}, t_s: {t_s:g} s, expected at most {SECONDS:g}; count from the first point")
        return round(t_s * 1e9)
    try:
        return int(parse_iso(text).astype(np.int64))
    except ValueError as error:
        raise InputError(f"{where}, gpst: {error}") from error


def _parse_number(text: str, column: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f'{where}, {column}: "{shorten(text)}" is not a number; fix it or leave the line out')
    return value


# --- NMEA


@dataclass(slots=True)
class _Epoch:
    """What the sentences of one moment state. Angles in degrees, heights in metres, NaN if not given."""

    line: int
    of_day_ns: int
    leap_ns: int  # a second more, in the leap second 23:59:60
    lat_deg: float = np.nan
    lon_deg: float = np.nan
    altitude_m: float = np.nan  # above the geoid
    separation_m: float = np.nan
    height_m: float = np.nan  # above the ellipsoid
    date: np.datetime64 | None = None


def parse_nmea(lines: Iterable[str], *, source: str = "NMEA", geoid_separation_m: float | None = None) -> RecordedTrack:
    """Parse the fixes of GGA and RMC sentences; those of one time of day make one point.

    Raises InputError as `read_track` does.

    The height is GGA's altitude plus its separation (or `geoid_separation_m`), or what a TXT sentence says as "HAE=".
    """
    epochs: list[_Epoch] = []
    damaged = 0
    for number, line in enumerate(lines, 1):
        start = line.find("$", 0, CHARACTERS_OF_LINE)
        if start < 0:
            continue
        try:
            fields = split_fields(line[start:])
            if fields is None or len(line) > CHARACTERS_OF_LINE:
                raise ValueError("checksum, or length")
            _take(fields, epochs, number)
        except (ValueError, IndexError):
            damaged += 1
    good = [epoch for epoch in epochs if np.isfinite(epoch.lat_deg + epoch.lon_deg)]
    if not good:
        raise InputError(
            f"{source}: no GGA or RMC sentence with a position ({damaged} damaged); give a file with fixes"
        )
    remarks = []
    if damaged:
        remarks.append(f"{damaged} damaged sentences are left out")
    if len(good) < len(epochs):
        remarks.append(f"{len(epochs) - len(good)} epochs without a position are left out")
    instants, dated = _date_epochs(epochs)
    columns = np.array([(e.lat_deg, e.lon_deg, e.altitude_m, e.separation_m, e.height_m) for e in good])
    heights_m, of_heights = _compute_heights_m(columns[:, 2], columns[:, 3], columns[:, 4], geoid_separation_m)
    kept = [instants[id(epoch)] for epoch in good]
    at_lines = [epoch.line for epoch in good]
    return RecordedTrack(
        source=source,
        position_ecef_m=_convert_to_ecef(np.column_stack([columns[:, :2], heights_m]), source, at_lines),
        t_s=_count_rising_s(kept, source, at_lines),
        start_gpst=np.datetime64(kept[0], "ns") if dated else None,
        remarks=(*remarks, *of_heights),
    )


def _take(fields: Sequence[str], epochs: list[_Epoch], line: int) -> None:
    """Take what a sentence states into its epoch. Raises ValueError or IndexError if it is damaged."""
    if fields[0][2:] == "TXT" and epochs and (found := _HEIGHT.search(fields[-1])):
        epochs[-1].height_m = float(found[1])
    sentence = read_sentence(fields) if fields[0][2:] in ("GGA", "RMC") else None
    if sentence is None or sentence.of_day_ns is None:
        return
    at = sentence.of_day_ns, sentence.leap_ns
    if not epochs or (epochs[-1].of_day_ns, epochs[-1].leap_ns) != at:
        epochs.append(_Epoch(line, *at))
    epoch = epochs[-1]
    if sentence.kind == "GGA":
        epoch.lat_deg, epoch.lon_deg = sentence.lat_deg, sentence.lon_deg
        epoch.altitude_m, epoch.separation_m = sentence.altitude_m, sentence.separation_m
    else:
        epoch.date = sentence.date
        if np.isnan(epoch.lat_deg):  # GGA may have more digits
            epoch.lat_deg, epoch.lon_deg = sentence.lat_deg, sentence.lon_deg


def _date_epochs(epochs: Sequence[_Epoch]) -> tuple[dict[int, int], bool]:
    """Compute each epoch's GPS time, by its id, and whether a date is known.

    Without one, days count from 0.

    Midnight lies where the time of day falls by more than half a day.
    """
    of_day_ns = np.array([epoch.of_day_ns for epoch in epochs])
    day = np.concatenate([[0], np.cumsum(np.diff(of_day_ns) < -_DAY_NS // 2)])
    utc_ns = day * _DAY_NS + of_day_ns
    dates = [(k, epoch.date) for k, epoch in enumerate(epochs) if epoch.date is not None]
    if dates:
        number, date = dates[0]
        utc_ns = utc_ns + int(date.astype(np.int64)) - int(day[number]) * _DAY_NS
        utc_ns = np.array([int(gpst_from_utc(np.datetime64(int(t), "ns")).astype(np.int64)) for t in utc_ns])
    return {id(epoch): int(t) + epoch.leap_ns for epoch, t in zip(epochs, utc_ns, strict=True)}, bool(dates)


def _compute_heights_m(
    altitude_m: Reals, separation_m: Reals, height_m: Reals, geoid_separation_m: float | None
) -> tuple[Reals, list[str]]:
    """Compute heights above the ellipsoid (n,), and report assumptions."""
    remarks = []
    if geoid_separation_m is not None:
        separation_m = np.where(np.isnan(separation_m), geoid_separation_m, separation_m)
    out = np.where(np.isnan(height_m), altitude_m + separation_m, height_m)
    if (bare := np.isnan(out) & np.isfinite(altitude_m)).any():
        out = np.where(bare, altitude_m, out)
        remarks.append(f"{np.count_nonzero(bare)} points: {_FROM_GEOID}; give geoid_separation_m")
    unknown = np.isnan(out)
    if unknown.all():
        return np.zeros_like(out), [*remarks, "no point has a height: all are put on the ellipsoid"]
    if unknown.any():
        index = np.arange(out.size)
        out[unknown] = np.interp(index[unknown], index[~unknown], out[~unknown])
        remarks.append(f"{np.count_nonzero(unknown)} points without a height have one between their neighbours'")
    return out, remarks


# --- KML


@dataclass(frozen=True)
class _Points:
    """What one geometry holds: texts of times (or none), of coordinates and of angles (or none)."""

    times: list[str]
    coordinates: list[list[str]]
    angles: list[list[str]]
    mode: str


def parse_kml(
    text: str, *, source: str = "KML", name: str | None = None, geoid_separation_m: float | None = None
) -> RecordedTrack:
    """Parse the points of the one placemark that has some, or of the one called `name`.

    Raises InputError as `read_track` does.

    Absolute heights count from the geoid. Others count as heights above the ellipsoid, as they stand.
    """
    if text.count("<") > XML_TAGS:
        raise InputError(f"{source}: more than {XML_TAGS} tags; give a file with fewer points")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{source}: not KML: {error}; give a .kml file (unpack a .kmz)") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
    marks = [
        (mark.findtext("name", "").strip(), points) for mark in root.iter("Placemark") for points in _find_points(mark)
    ]
    names = ", ".join(f'"{title}"' for title, _ in marks)
    chosen = [points for title, points in marks if name is None or title == name]
    if not chosen:
        wanted = "gx:Track or LineString" if name is None else f'track called "{name}"'
        raise InputError(f"{source}: no {wanted} with points, but {names or 'none at all'}; give one that is there")
    if len(chosen) > 1:
        raise InputError(f"{source}: holds {len(chosen)} tracks ({names}), expected one; say which by its name")
    return _make_kml_track(chosen[0], source, geoid_separation_m)


def _find_points(mark: ElementTree.Element) -> Iterator[_Points]:
    """Find the tracks of a placemark, those of a gx:MultiTrack as one; without any, its lines."""
    tracks = [
        _Points(
            times=[(element.text or "").strip() for element in track.findall("when")],
            coordinates=[(element.text or "").split() for element in track.findall("coord")],
            angles=[(element.text or "").split() for element in track.findall("angles")],
            mode=track.findtext("altitudeMode", "clampToGround").strip(),
        )
        for track in mark.iter("Track")
    ]
    if tracks:
        yield _Points(
            times=[text for track in tracks for text in track.times],
            coordinates=[words for track in tracks for words in track.coordinates],
            angles=[words for track in tracks for words in track.angles],
            mode=tracks[0].mode,
        )
        return  # its lines are the same points without their times
    for line in mark.iter("LineString"):
        words = [point.split(",") for point in line.findtext("coordinates", "").split()]
        if words:
            yield _Points([], words, [], line.findtext("altitudeMode", "clampToGround").strip())


def _make_kml_track(points: _Points, source: str, geoid_separation_m: float | None) -> RecordedTrack:
    timed = bool(points.times)
    if timed and len(points.times) != len(points.coordinates):
        raise InputError(
            f"{source}: {len(points.times)} times (when) but {len(points.coordinates)} points (gx:coord); give a file "
            "with one time a point"
        )
    if points.angles and len(points.angles) != len(points.coordinates):
        raise InputError(
            f"{source}: {len(points.angles)} gx:angles but {len(points.coordinates)} points; give one per point or none"
        )
    # a gx:Track may leave out the place, or all, of a moment
    kept = [k for k, words in enumerate(points.coordinates) if len(words) >= 2]
    if not kept:
        raise InputError(f"{source}: the track has no points; give a file with points")
    places = np.array(
        [
            [
                _parse_number(word, "coordinates", f"{source}: point {k + 1}")
                for word in (*points.coordinates[k], "0")[:3]
            ]
            for k in kept
        ]
    )
    remarks = []
    if len(kept) < len(points.coordinates):
        remarks.append(f"{len(points.coordinates) - len(kept)} points without a place are left out")
    if points.mode == "absolute":
        places[:, 2] += geoid_separation_m or 0.0
        if geoid_separation_m is None:
            remarks.append(f"{_FROM_GEOID}; give geoid_separation_m")
    elif points.mode.startswith("relative"):
        remarks.append("heights are those above the ground, taken as if above the ellipsoid")
    numbers = [k + 1 for k in kept]
    instants = [_parse_when_ns(points.times[k], f"{source}: point {k + 1}") for k in kept] if timed else []
    angles = [
        [_parse_number(word, "gx:angles", f"{source}: point {k + 1}") for word in points.angles[k]]
        for k in kept
        if points.angles
    ]
    if any(len(words) != 3 for words in angles):
        raise InputError(f"{source}: gx:angles with other than 3 numbers; give heading, tilt and roll")
    return RecordedTrack(
        source=source,
        position_ecef_m=_convert_to_ecef(places[:, [1, 0, 2]], source, numbers, "point"),
        t_s=_count_rising_s(instants, source, numbers, "point") if timed else None,
        start_gpst=np.datetime64(instants[0], "ns") if timed else None,
        attitude_rad=np.radians(np.array(angles)) if angles else None,
        remarks=tuple(remarks),
    )


def _parse_when_ns(text: str, where: str) -> int:
    try:
        utc = datetime.fromisoformat(text)
        utc = utc.astimezone(UTC).replace(tzinfo=None) if utc.tzinfo is not None else utc
        require_year(utc.year)
    except (ValueError, OverflowError) as error:
        raise InputError(
            f'{where}: "{shorten(text)}" is not a time, expected one as 2022-01-01T21:45:40.5Z; fix it'
        ) from error
    return int(gpst_from_utc(np.datetime64(utc, "ns")).astype(np.int64))


# --- all of them


def _convert_to_ecef(places: Reals, source: str, lines: Sequence[int], word: str = "line") -> Reals:
    """Convert (n, 3) latitude and longitude in degrees and height to ECEF."""
    beyond = np.abs(places) > (90.0, 360.0, FARTHEST_M)
    for row in np.flatnonzero(beyond.any(axis=1)).tolist():
        lat_deg, lon_deg, height_m = places[row]
        raise InputError(
            f"{source}: {word} {lines[row]}: latitude {lat_deg:g}, longitude {lon_deg:g}, height {height_m:g} m, "
            "expected degrees and metres above the ellipsoid; fix it"
        )
    return ecef_from_geodetic(np.radians(places[:, 0]), np.radians(places[:, 1]), places[:, 2])


def _check_near_earth(position_ecef_m: Reals, source: str, lines: Sequence[int]) -> Reals:
    """Check that ECEF positions (n, 3) are near the Earth. Raises InputError otherwise."""
    for row in np.flatnonzero((np.abs(position_ecef_m) > FARTHEST_M).any(axis=1)).tolist():
        raise InputError(
            f"{source}: line {lines[row]}: a coordinate of {np.abs(position_ecef_m[row]).max():g} m, expected ECEF in "
            "metres; fix it"
        )
    return position_ecef_m


def _count_rising_s(instants: Sequence[int], source: str, lines: Sequence[int], word: str = "line") -> Reals:
    """Convert whole nanoseconds to seconds since the first. Raises InputError if they do not rise."""
    ns = np.array(instants, np.int64)
    for row in np.flatnonzero(np.diff(ns) <= 0).tolist():
        raise InputError(
            f"{source}: {word} {lines[row + 1]}: its time is not after that of {word} {lines[row]}; put the points "
            "in order, one per moment, of one receiver only"
        )
    since_s: Reals = (ns - ns[0]) / 1e9
    return since_s
