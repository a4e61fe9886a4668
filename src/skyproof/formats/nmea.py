"""Write fixes as NMEA 0183 sentences, for chart plotters and other readers of a receiver's serial line.

NMEA 0183 version 4.11: GGA, RMC and GST, and TXT for what these cannot say.
"""

import os
from collections.abc import Iterable, Iterator
from datetime import datetime
from functools import reduce
from operator import xor

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Instants
from skyproof.formats.atomic_write import write_lines
from skyproof.gnss.time import utc_from_gpst

__all__ = ["write_nmea", "write_nmea_sentences"]

_KNOTS_PER_M_S = 3600.0 / 1852.0
_MINUTE_DIGITS = 6  # 2 mm; with the digits below, no sentence is longer than the 82 characters that NMEA allows


def write_nmea(path: str | os.PathLike[str], sentences: Iterable[str]) -> None:
    """Write `sentences`, each ended by CR and LF. Raises OutputError as `writing` does."""
    write_lines(path, sentences, end="\r\n")


def write_nmea_sentences(
    gpst: Instants,
    lat_deg: ArrayLike,
    lon_deg: ArrayLike,
    height_m: ArrayLike,
    satellites: ArrayLike,
    *,
    hdop: ArrayLike | None = None,
    geoid_separation_m: ArrayLike | None = None,
    speed_m_s: ArrayLike | None = None,
    course_deg: ArrayLike | None = None,
    sigma_east_m: ArrayLike | None = None,
    sigma_north_m: ArrayLike | None = None,
    sigma_up_m: ArrayLike | None = None,
    talker: str = "GP",
) -> Iterator[str]:
    """Write the sentences of each epoch: GGA, RMC, GST if sigmas are known, TXT if needed.

    They have no line ends.

    NMEA counts altitude from the geoid; altitude and separation add up to the height above the ellipsoid. Without
    `geoid_separation_m` GGA leaves both empty rather than wrong by up to 100 m, and the height above the ellipsoid
    follows in a TXT sentence: "HAE=52.314". An epoch without a position has quality 0 and status V. Times are UTC, to
    10 ms.

    Parameters
    ----------
    gpst, lat_deg, lon_deg, height_m, satellites : shape (n_epochs,); longitude from -180 to 180, height above the
        ellipsoid; NaN where there is no fix.
    hdop, ... : shape (n_epochs,) or one number for all; NaN or None where not known. Course is clockwise from north.
    talker : "GP" for fixes from GPS alone.
    """
    optional = (hdop, geoid_separation_m, speed_m_s, course_deg, sigma_east_m, sigma_north_m, sigma_up_m)
    columns = np.broadcast_arrays(
        *(np.asarray(column, np.float64) for column in (lat_deg, lon_deg, height_m, satellites)),
        *(np.asarray(np.nan if column is None else column, np.float64) for column in optional),
        np.zeros(np.shape(gpst)),
    )[:-1]
    for instant, *row in zip(gpst, *(column.tolist() for column in columns), strict=True):
        if not np.isnat(instant):
            yield from (_write_sentence(talker, *fields) for fields in _write_epoch(_round_utc(instant), *row))


def _write_epoch(
    utc: datetime,
    lat_deg: float,
    lon_deg: float,
    height_m: float,
    satellites: float,
    hdop: float,
    separation_m: float,
    speed_m_s: float,
    course_deg: float,
    sigma_east_m: float,
    sigma_north_m: float,
    sigma_up_m: float,
) -> Iterator[tuple[str, ...]]:
    time = f"{utc:%H%M%S}.{utc.microsecond // 10_000:02d}"
    fixed = np.isfinite(lat_deg) and np.isfinite(lon_deg)
    separation_m = round(separation_m, 1) if np.isfinite(separation_m) else separation_m  # as it is written
    place = (
        (_format_angle(lat_deg, 2), "NS"[lat_deg < 0], _format_angle(lon_deg, 3), "EW"[lon_deg < 0])
        if fixed
        else ("",) * 4
    )
    yield (
        "GGA",
        time,
        *place,
        "1" if fixed else "0",
        _format_number(satellites if fixed else 0.0, "02.0f"),
        _format_number(min(hdop, 99.9), ".1f"),
        _format_number(height_m - separation_m, ".2f"),
        "M",
        _format_number(separation_m, ".1f"),
        "M",
        "",
        "",
    )
    yield (
        "RMC",
        time,
        "A" if fixed else "V",
        *place,
        _format_number(speed_m_s * _KNOTS_PER_M_S, ".3f"),
        _format_number(course_deg % 360.0, ".2f"),
        f"{utc:%d%m%y}",
        "",
        "",
        "A" if fixed else "N",
    )
    if np.isfinite(sigma_east_m) and np.isfinite(sigma_north_m):
        sigmas_m = (_format_number(sigma_m, ".3f") for sigma_m in (sigma_north_m, sigma_east_m, sigma_up_m))
        yield ("GST", time, "", "", "", "", *sigmas_m)
    if np.isfinite(height_m) and not np.isfinite(separation_m):
        yield ("TXT", "01", "01", "02", f"HAE={height_m:.3f}")


def _write_sentence(talker: str, *fields: str) -> str:
    text = talker + ",".join(fields)
    return f"${text}*{reduce(xor, text.encode('ascii')):02X}"


def _round_utc(instant: np.datetime64) -> datetime:
    """Round UTC to 10 ms here, not field by field, so that no field reads 60 seconds."""
    rounded = utc_from_gpst(instant) + np.timedelta64(5, "ms")
    utc: datetime = rounded.astype("datetime64[us]").item()
    return utc.replace(microsecond=utc.microsecond // 10_000 * 10_000)


def _format_angle(angle_deg: float, degree_digits: int) -> str:
    """Format dddmm.mmmmmm, rounded as a whole, so that no field reads 60 minutes."""
    unit = 10**_MINUTE_DIGITS
    degrees, units = divmod(round(abs(angle_deg) * 60 * unit), 60 * unit)
    return f"{degrees:0{degree_digits}d}{units // unit:02d}.{units % unit:0{_MINUTE_DIGITS}d}"


def _format_number(value: float, form: str) -> str:
    return f"{value:{form}}" if np.isfinite(value) else ""
