"""GPS time as labels: `numpy.datetime64[ns]` that counts GPS seconds, without leap seconds or zone.

UTC appears only at the edges (`utc_from_gpst`, `gpst_from_utc`). A difference of labels is no measurement.
"""

import re
from typing import Any, Final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skyproof.arrays import Instants, Integers, Reals
from skyproof.gnss.constants import SECONDS_PER_WEEK

__all__ = [
    "GPS_EPOCH",
    "GPS_EPOCH_NS",
    "LEAPS_KNOWN_UNTIL",
    "format_clock",
    "format_instant",
    "format_iso",
    "format_moment",
    "format_rinex_date",
    "format_utc",
    "gpst",
    "gpst_from_utc",
    "leap_seconds",
    "parse_iso",
    "require_year",
    "resolve_week",
    "seconds_between",
    "timedelta_from_s",
    "utc_from_gpst",
    "week_and_tow",
]

FIRST_YEAR, LAST_YEAR = 1980, 2199
"""Of every instant that is read: labels of nanoseconds wrap silently in 2262, so that 2600 would become 2015."""
GPS_EPOCH: Final = np.datetime64("1980-01-06T00:00:00", "ns")  # IS-GPS-200N, 3.3.4
GPS_EPOCH_NS: Final = int(GPS_EPOCH.astype(np.int64))  # since 1970

_NS: Final = 1_000_000_000
_NS_PER_WEEK: Final = SECONDS_PER_WEEK * _NS
_LEAPS_AT_UTC: Final = np.array(
    [
        "1981-07-01",
        "1982-07-01",
        "1983-07-01",
        "1985-07-01",
        "1988-01-01",
        "1990-01-01",
        "1991-01-01",
        "1992-07-01",
        "1993-07-01",
        "1994-07-01",
        "1996-01-01",
        "1997-07-01",
        "1999-01-01",
        "2006-01-01",
        "2009-01-01",
        "2012-07-01",
        "2015-07-01",
        "2017-01-01",
    ],
    dtype="datetime64[ns]",
)
"""When GPS minus UTC became 1, 2, ... 18 s: IERS Bulletin C (none announced from 2017 to the end of 2026)."""
LEAPS_KNOWN_UNTIL: Final = np.datetime64("2027-01-01", "ns")
"""Before which no leap second comes that is not in the table."""
_LEAPS_AT_GPST: Final = _LEAPS_AT_UTC + np.arange(1, _LEAPS_AT_UTC.size + 1) * np.timedelta64(1, "s")
_ISO: Final = re.compile(r"\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}(:\d{2}(\.\d{1,9})?)?)?", re.ASCII)


@overload
def gpst(week: int, tow_s: float) -> np.datetime64: ...
@overload
def gpst(week: NDArray[Any], tow_s: ArrayLike) -> Instants: ...
@overload
def gpst(week: ArrayLike, tow_s: NDArray[Any]) -> Instants: ...
def gpst(week: Any, tow_s: Any) -> Any:
    """Return the instant of full GPS week `week` and second `tow_s` of that week, to the nanosecond.

    Scalars or arrays that broadcast. `tow_s` may lie outside 0..604800: it is carried over.
    """
    tow_s = np.asarray(tow_s, dtype=np.float64)
    whole_s = np.floor(tow_s)
    ns = np.asarray(week, dtype=np.int64) * _NS_PER_WEEK + whole_s.astype(np.int64) * _NS
    ns = ns + np.rint((tow_s - whole_s) * _NS).astype(np.int64)
    return (GPS_EPOCH + ns.astype("timedelta64[ns]"))[()]


@overload
def week_and_tow(t: np.datetime64) -> tuple[int, float]: ...
@overload
def week_and_tow(t: Instants) -> tuple[Integers, Reals]: ...
def week_and_tow(t: Any) -> Any:
    """Return full GPS week and second of week of instants of any shape; the second is good to a nanosecond."""
    week, in_week_ns = np.divmod(_ns_since(t, GPS_EPOCH), _NS_PER_WEEK)
    tow_s = in_week_ns / _NS
    return (int(week), float(tow_s)) if np.ndim(week) == 0 else (week, tow_s)


def seconds_between(later: Any, earlier: Any) -> Any:
    """Return `later` minus `earlier` in seconds (float64; arrays broadcast).

    It is a difference of labels, never a measurement.
    """
    seconds = _ns_since(later, earlier) / _NS
    return float(seconds) if np.ndim(seconds) == 0 else seconds


@overload
def timedelta_from_s(seconds: float) -> np.timedelta64: ...
@overload
def timedelta_from_s(seconds: NDArray[Any]) -> NDArray[np.timedelta64]: ...
def timedelta_from_s(seconds: Any) -> Any:
    """Round seconds (a number or an array) to time differences of whole nanoseconds, which instants can be moved by."""
    if np.ndim(seconds) == 0:
        return np.timedelta64(round(float(seconds) * _NS), "ns")
    return np.rint(np.asarray(seconds) * _NS).astype("timedelta64[ns]")


def format_iso(t: np.datetime64, digits: int = 3) -> str:
    """Format ISO 8601 without zone: "2022-01-01T21:45:58.000".

    Seconds are rounded to `digits` (0 to 9) decimals.
    """
    if not 0 <= digits <= 9:
        raise ValueError(f"digits is {digits}, expected 0 to 9")
    step_ns = 10 ** (9 - digits)
    ns = int(_convert_to_ns(t).astype(np.int64))
    rounded = np.datetime64((ns + step_ns // 2) // step_ns * step_ns, "ns")
    whole, _, fraction = str(rounded).partition(".")
    return f"{whole}.{fraction[:digits]}" if digits else whole


def parse_iso(text: str) -> np.datetime64:
    """Parse ISO 8601 `text` without a zone, such as "2022-01-01T21:45:58.5" or "2022-01-01".

    Raises ValueError for anything else, a zone included: GPS time has none; and for a year before 1980 or after 2199.
    """
    if not _ISO.fullmatch(text.strip()):
        raise ValueError(f"{text!r} is not an instant; expected GPS time as 2022-01-01T21:45:58.5, without a zone")
    require_year(int(text.strip()[:4]))
    return np.datetime64(text.strip().replace(" ", "T"), "ns")


def require_year(year: int) -> None:
    """Raise ValueError unless signals of satellite navigation may be received in this year."""
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise ValueError(f"the year is {year}, expected {FIRST_YEAR} to {LAST_YEAR}")


def leap_seconds(t: np.datetime64) -> int:
    """Return GPS minus UTC in seconds at GPS instant `t`, from the table built in (18 from 2017 on)."""
    return int(np.searchsorted(_LEAPS_AT_GPST, _convert_to_ns(t), side="right"))


def format_rinex_date(utc: np.datetime64) -> str:
    """Format the date of a RINEX header, "20220101 214540 UTC" (RINEX 3.05, table A2)."""
    return format_iso(utc, 0).translate({ord("-"): None, ord(":"): None, ord("T"): " "}) + " UTC"


def utc_from_gpst(t: np.datetime64) -> np.datetime64:
    """Convert GPS instant `t` to its UTC label.

    A leap second itself (23:59:60) gets the label of the second after it.
    """
    return _convert_to_ns(t) - np.timedelta64(leap_seconds(t), "s")


def gpst_from_utc(t: np.datetime64) -> np.datetime64:
    """Convert UTC label `t` to its GPS instant."""
    leaps = int(np.searchsorted(_LEAPS_AT_UTC, _convert_to_ns(t), side="right"))
    return _convert_to_ns(t) + np.timedelta64(leaps, "s")


def resolve_week(week_mod_1024: int, near: np.datetime64) -> int:
    """Find the full week that is `week_mod_1024` modulo 1024 and nearest to `near`, ten years either way."""
    week_near, _ = week_and_tow(_convert_to_ns(near))
    return find_nearest_week(week_mod_1024, week_near, 1024)


def find_nearest_week(week: int, week_near: int, modulus: int) -> int:
    """Find the full week nearest to `week_near` that equals `week` modulo `modulus` (1024 or 256 in LNAV)."""
    return week_near + (week - week_near + modulus // 2) % modulus - modulus // 2


def _convert_to_ns(t: np.datetime64) -> np.datetime64:
    """Convert a label of any resolution to nanoseconds."""
    instant: np.datetime64 = t.astype("datetime64[ns]")
    return instant


def _ns_since(later: Any, earlier: Any) -> Any:
    difference = np.asarray(later, dtype="datetime64[ns]") - np.asarray(earlier, dtype="datetime64[ns]")
    return difference.astype(np.int64)


def format_instant(instant: str) -> str:
    """Format an instant for people: date, space, time, to the millisecond, without trailing zeros."""
    whole, _, fraction = instant.replace("T", " ").partition(".")
    fraction = fraction[:3].rstrip("0")
    return f"{whole}.{fraction}" if fraction else whole


def format_utc(gpst: str) -> str:
    """Format UTC of an instant in GPS time, as `format_instant` does."""
    return format_instant(format_iso(utc_from_gpst(np.datetime64(gpst, "ns")), 9))


def format_moment(gpst: str) -> str:
    """Format an instant by both clocks: 2024-05-14 10:00:06.5 GPS time (09:59:48.5 UTC)."""
    return f"{format_instant(gpst)} GPS time ({_drop_day(format_utc(gpst), gpst[:10])} UTC)"


def format_clock(gpst: str) -> str:
    """Format an instant by both clocks without its day: 10:00:06.5 GPS time (09:59:48.5 UTC)."""
    return f"{format_instant(gpst)[11:]} GPS time ({_drop_day(format_utc(gpst), gpst[:10])} UTC)"


def _drop_day(utc: str, day: str) -> str:
    """Drop the date of UTC where that is the day of GPS time."""
    return utc.removeprefix(f"{day} ")
