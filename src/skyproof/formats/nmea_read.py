"""Parse one NMEA 0183 sentence (version 4.11), whatever it is read for."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import reduce
from operator import xor
from typing import Final

import numpy as np

from skyproof.gnss.time import require_year

__all__ = ["FARTHEST_M", "Sentence", "read_sentence", "split_fields"]

_TIME: Final = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d|60)(\.\d+)?", re.ASCII)
_ANGLE: Final = re.compile(r"\d{1,3}([0-5]\d)(\.\d*)?", re.ASCII)
FARTHEST_M: Final = 1e9
_SATS_A_SENTENCE: Final = 4


@dataclass(slots=True)
class Sentence:
    """The numbers of a sentence; NaN, None or -1 where it has none. Angles in degrees, heights in metres.

    estimated : the place is not of satellites, but of dead reckoning, typed in or simulated. of_day_ns : UTC; of the
    leap second 23:59:60 that of the second before it, and `leap_ns` a second more. date : of the day. strengths :
    satellite's number, signal (NMEA 4.11, table 20; 0 where it is not said), C/N0 in dB-Hz.
    """

    talker: str
    kind: str
    of_day_ns: int | None = None
    leap_ns: int = 0
    date: np.datetime64 | None = None
    estimated: bool = False
    lat_deg: float = np.nan
    lon_deg: float = np.nan
    altitude_m: float = np.nan  # above the geoid
    separation_m: float = np.nan
    satellites: int = -1
    sigma_enu_m: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    strengths: tuple[tuple[int, int, float], ...] = ()


def split_fields(sentence: str) -> list[str] | None:
    """Return the fields of a sentence without its checksum, which may be absent; None if it is wrong."""
    body, star, checksum = sentence[1:].strip().partition("*")
    if star and checksum.upper() != f"{reduce(xor, body.encode('utf-8'), 0):02X}":
        return None
    return body.split(",")


def read_sentence(fields: Sequence[str]) -> Sentence | None:
    """Read GGA, GNS, GLL, RMC, ZDA, GST or GSV; None for another one.

    Raises ValueError or IndexError if it is damaged.
    """
    read = _KINDS.get(fields[0][2:])
    if read is None:
        return None
    sentence = Sentence(talker=fields[0][:2], kind=fields[0][2:])
    read(fields, sentence)
    return sentence


def _take_time(text: str, sentence: Sentence) -> None:
    if not _TIME.fullmatch(text):
        raise ValueError(f"time {text!r}")
    sentence.leap_ns = 10**9 if text[4:6] == "60" else 0
    of_day_ns = (int(text[:2]) * 60 + int(text[2:4])) * 60 * 10**9 + round(float(text[4:]) * 1e9)
    sentence.of_day_ns = of_day_ns - sentence.leap_ns


def _take_place(fields: Sequence[str], sentence: Sentence) -> None:
    sentence.lat_deg, sentence.lon_deg = _parse_angle_deg(*fields[:2]), _parse_angle_deg(*fields[2:4])


_ESTIMATED: Final = frozenset("EMS")
"""Of the modes of a fix: estimated, manual input, simulator."""


def _take_gga(fields: Sequence[str], sentence: Sentence) -> None:
    fixed = fields[6] not in ("", "0")
    sentence.estimated = fields[6] in ("6", "7", "8")
    if fixed:
        _take_place(fields[2:6], sentence)
        sentence.altitude_m, sentence.separation_m = _parse_metres(fields[9]), _parse_metres(fields[11])
        sentence.satellites = int(fields[7] or -1)
    _take_time(fields[1], sentence)


def _take_gns(fields: Sequence[str], sentence: Sentence) -> None:
    modes = fields[6].strip("N")
    sentence.estimated = set(modes) <= _ESTIMATED
    if modes:
        _take_place(fields[2:6], sentence)
        sentence.altitude_m, sentence.separation_m = _parse_metres(fields[9]), _parse_metres(fields[10])
        sentence.satellites = int(fields[7] or -1)
    _take_time(fields[1], sentence)


def _take_gll(fields: Sequence[str], sentence: Sentence) -> None:
    sentence.estimated = bool(_ESTIMATED & set(fields[7:8]))
    if fields[6] == "A":
        _take_place(fields[1:5], sentence)
    _take_time(fields[5], sentence)


def _take_rmc(fields: Sequence[str], sentence: Sentence) -> None:
    sentence.date = _date(fields[9], "%d%m%y") if fields[9] else None
    sentence.estimated = bool(_ESTIMATED & set(fields[12:13]))
    if fields[2] == "A":
        _take_place(fields[3:7], sentence)
    _take_time(fields[1], sentence)


def _take_zda(fields: Sequence[str], sentence: Sentence) -> None:
    if fields[2] and fields[3] and fields[4]:
        sentence.date = _date(f"{fields[2]:0>2}{fields[3]:0>2}{fields[4]}", "%d%m%Y")
    _take_time(fields[1], sentence)


def _take_gst(fields: Sequence[str], sentence: Sentence) -> None:
    north_m, east_m, up_m = (_parse_metres(text) for text in fields[6:9])
    sentence.sigma_enu_m = east_m, north_m, up_m
    _take_time(fields[1], sentence)


def _take_gsv(fields: Sequence[str], sentence: Sentence) -> None:
    """Read up to four satellites; one field more than theirs names the signal."""
    rest = fields[4:]
    signal = int(rest[-1], 16) if len(rest) % _SATS_A_SENTENCE == 1 and rest[-1] else 0
    levels = [
        (number, float(level)) for number, level in zip(rest[:-3:4], rest[3::4], strict=False) if number and level
    ]
    sentence.strengths = tuple((int(number), signal, level) for number, level in levels if 0.0 < level < 100.0)


_KINDS: Final = {
    "GGA": _take_gga,
    "GNS": _take_gns,
    "GLL": _take_gll,
    "RMC": _take_rmc,
    "ZDA": _take_zda,
    "GST": _take_gst,
    "GSV": _take_gsv,
}


def _parse_angle_deg(text: str, side: str) -> float:
    if not _ANGLE.fullmatch(text):
        raise ValueError(f"angle {text!r}")
    point = text.index(".") if "." in text else len(text)
    value = int(text[: point - 2]) + float(text[point - 2 :]) / 60.0
    if side not in ("N", "S", "E", "W"):
        raise ValueError(f"side {side!r}")
    return -value if side in "SW" else value


def _parse_metres(text: str) -> float:
    """Parse metres; NaN for an empty field."""
    if not text:
        return np.nan
    if not abs(metres := float(text)) < FARTHEST_M:
        raise ValueError(f"height {text!r}")
    return metres


def _date(text: str, layout: str) -> np.datetime64:
    date = datetime.strptime(text, layout)
    require_year(date.year)
    return np.datetime64(date, "ns")
