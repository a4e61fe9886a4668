"""RINEX navigation files, GPS LNAV: versions 2.10 and 2.11, 3.0x (mixed too) and 4.0x in; version 3.05 out.

A damaged record costs that record, never the file; what was left out is told in `NavigationData.remarks`.
"""

import bisect
import gzip
import math
import os
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from skyproof.errors import InputError
from skyproof.formats.place import write_lines
from skyproof.gnss.constants import SECONDS_PER_WEEK
from skyproof.gnss.ephemeris import Ephemeris, Klobuchar, NavigationData, UtcParameters
from skyproof.gnss.lnav import URA_M, is_plausible
from skyproof.gnss.signals import sat_name
from skyproof.gnss.time import gpst, iso, leap_seconds, nearest_week, week_and_tow

__all__ = ["parse_nav", "read_nav", "write_nav"]

_TO_DO: Final = "give a RINEX navigation file of GPS (2.11, 3 or 4), such as brdc0010.22n or ..._MN.rnx, plain or .gz"
_FIELD_WIDTH: Final = 19
_MOST_REMARKS: Final = 20  # of damaged records, one a line; the rest is counted
_UNKNOWN_TIME_S: Final = 0.9999e9  # RINEX 3.05, table A6: transmission time not known
_NOMINAL_URA_M: Final = (2.0, 2.8, 4.0, 5.7, 8.0, 11.3, *(2.0 ** (k - 2) for k in range(6, 16)))
"""What files give for accuracy index 0 to 15 (IS-GPS-200N, 20.3.3.3.1.3)."""


def read_nav(path: str | os.PathLike[str]) -> NavigationData:
    """The GPS navigation data in a RINEX file, plain or gzip.

    Raises
    ------
    InputError : the file cannot be read, is not a RINEX navigation file, or holds no GPS ephemeris.
    """
    return parse_nav(_text(Path(path)).splitlines(), source=str(path))


def parse_nav(lines: Iterable[str], *, source: str = "navigation data") -> NavigationData:
    """The GPS navigation data in the lines of a RINEX navigation file; `source` names it in messages.

    Only LNAV records of GPS are taken. Weeks are full ones: the epoch of each record resolves them, whatever modulus
    the writer had. A file that tells the leap seconds but not the polynomial of UTC gives one of zeros.

    Raises
    ------
    InputError : not a RINEX navigation file, or no GPS ephemeris in it.
    """
    body = iter(enumerate(lines, start=1))
    header = _header(body, source)
    found = _Found()
    for record in _records(body, header.version):
        found.take(record, header.version)
    if not found.ephemerides:
        others = f"; {found.others_told()}" if found.others else ""
        broken = f"; {found.damaged[0]}" if found.damaged else ""
        raise InputError(f"{source}: no GPS ephemeris after line {header.last_line}{others}{broken}; {_TO_DO}")
    week = max(e.week for e in found.ephemerides)
    return NavigationData(
        ephemerides=tuple(found.ephemerides),
        ionosphere=found.ionosphere or header.ionosphere,
        utc=header.utc(week, gpst(found.ephemerides[0].toc_week, found.ephemerides[0].toc)),
        source=source,
        remarks=tuple(header.remarks + found.remarks()),
    )


def write_nav(
    path: str | os.PathLike[str], navigation: NavigationData, *, created: np.datetime64 | None = None
) -> None:
    """Write GPS ephemerides, ionosphere and leap seconds as a RINEX 3.05 navigation file.

    Orbits and clocks keep 13 digits, the ionosphere 5, as the format has them. `created` (UTC) goes into the header,
    which leaves the date blank without it: equal data make equal bytes.

    Raises
    ------
    OutputError : the place cannot be written.
    """
    write_lines(path, [*_header_lines(navigation, created), *_record_lines(navigation.ephemerides)])


# ---------------------------------------------------------------- the file as text


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
        if content[:2] == b"\x1f\x8b":
            content = gzip.decompress(content)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(f"{path}: damaged gzip file ({error}); fetch or compress it again") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {_TO_DO}") from None
    if content[:2] == b"\x1f\x9d":
        raise InputError(f"{path}: compressed by `compress` (.Z), expected plain text or gzip; uncompress it first")
    return content.decode("latin-1")  # never fails: comments hold anything


# ---------------------------------------------------------------- header


@dataclass
class _Header:
    version: float
    last_line: int
    alpha: tuple[float, ...] = ()
    beta: tuple[float, ...] = ()
    utc_terms: tuple[float, ...] = ()  # A0, A1, reference time, reference week of any modulus
    leaps: int | None = None
    remarks: list[str] = field(default_factory=list)

    @property
    def ionosphere(self) -> Klobuchar | None:
        if len(self.alpha) != 4 or len(self.beta) != 4:
            return None
        return Klobuchar(alpha=self.alpha, beta=self.beta)

    def utc(self, week: int, at: np.datetime64) -> UtcParameters | None:
        if self.leaps is None and not self.utc_terms:
            return None
        a0, a1, tot, wnt = self.utc_terms or (0.0, 0.0, 0.0, week)
        leaps = leap_seconds(at) if self.leaps is None else self.leaps
        # The message tells the week modulo 256, and writers differ in what they make of it.
        return UtcParameters(a0=a0, a1=a1, tot=tot, wnt=nearest_week(int(wnt), week, 256), leap_seconds=leaps)


def _header(body: Iterator[tuple[int, str]], source: str) -> _Header:
    _, first = next(body, (1, ""))
    label, kind = first[60:80].strip(), first[20:21].upper()
    if label != "RINEX VERSION / TYPE":
        what = "a compressed RINEX observation file" if label == "CRINEX VERS   / TYPE" else repr(first[:40])
        raise InputError(f"{source}, line 1: {what}, expected RINEX VERSION / TYPE in column 61; {_TO_DO}")
    version = float(first[:9]) if re.fullmatch(r" *\d+(\.\d*)? *", first[:9]) else math.nan
    if not 2.0 <= version < 5.0:
        raise InputError(f"{source}, line 1: RINEX version {first[:9].strip()!r}, expected 2, 3 or 4; {_TO_DO}")
    if kind != "N":
        kinds = {"O": "observations", "G": "GLONASS navigation data", "M": "weather", "H": "SBAS navigation data"}
        raise InputError(f"{source}, line 1: the file holds {kinds.get(kind, repr(kind))}, expected type N; {_TO_DO}")
    header = _Header(version=version, last_line=1)
    for number, line in body:
        header.last_line = number
        label = line[60:80].strip()
        if label == "END OF HEADER":
            return header
        try:
            _take_header_line(header, line, label)
        except ValueError:
            header.remarks.append(f"line {number}: {label} cannot be read and is left out")
    raise InputError(f"{source}, line {header.last_line}: the file ends before END OF HEADER; fetch it again")


def _take_header_line(header: _Header, line: str, label: str) -> None:
    if label == "ION ALPHA":
        header.alpha = _numbers(line, 2, 12, 4)
    elif label == "ION BETA":
        header.beta = _numbers(line, 2, 12, 4)
    elif label == "IONOSPHERIC CORR" and line[:4] == "GPSA":
        header.alpha = _numbers(line, 5, 12, 4)
    elif label == "IONOSPHERIC CORR" and line[:4] == "GPSB":
        header.beta = _numbers(line, 5, 12, 4)
    elif label == "DELTA-UTC: A0,A1,T,W":
        header.utc_terms = (*_numbers(line, 3, 19, 2), *_numbers(line, 41, 9, 2))
    elif label == "TIME SYSTEM CORR" and line[:4] == "GPUT":
        header.utc_terms = (*_numbers(line, 5, 17, 1), *_numbers(line, 22, 16, 1), *_numbers(line, 38, 7, 1),
                            *_numbers(line, 45, 5, 1))  # fmt: skip
    elif label == "LEAP SECONDS" and line[24:27] != "BDS":
        header.leaps = int(line[:6])


# ---------------------------------------------------------------- records


@dataclass(frozen=True)
class _Record:
    """The lines of one record and the number of the first; `kind` is as in RINEX 4, e.g. "EPH LNAV"."""

    line_number: int
    sat: str
    kind: str
    lines: Sequence[str]


def _records(body: Iterator[tuple[int, str]], version: float) -> Iterator[_Record]:
    """Records in the order of the file: a new one begins wherever a line begins like one, so a gap costs one record."""
    kind, sat, start, lines = "", "", 0, list[str]()
    for number, line in body:
        begins = _beginning(line, version)
        if begins is None:
            lines.append(line)
            continue
        if lines:
            yield _Record(start, sat, kind, lines)
        sat, kind = begins
        start, lines = number, [] if line.startswith(">") else [line]
        if line.startswith(">"):
            start += 1
    if lines:
        yield _Record(start, sat, kind, lines)


def _beginning(line: str, version: float) -> tuple[str, str] | None:
    """Satellite and kind if a record begins with this line, else None."""
    if version >= 4.0:
        match = re.match(r"> *(EPH|STO|EOP|ION) +([A-Z][ \d]\d) *(\w*)", line)
        return (match[2].replace(" ", "0"), f"{match[1]} {match[3]}") if match else None
    if version >= 3.0:
        match = re.match(r"[A-Z][ \d]\d(?= )", line)
        return (match[0].replace(" ", "0"), "EPH LNAV") if match else None
    prn = line[:2].strip()
    return (f"G{int(prn):02d}", "EPH LNAV") if prn.isdigit() else None


@dataclass
class _Found:
    """What the records give, and what was wrong with those that give nothing."""

    ephemerides: list[Ephemeris] = field(default_factory=list)
    ionosphere: Klobuchar | None = None
    others: Counter[str] = field(default_factory=Counter)
    damaged: list[str] = field(default_factory=list)
    weeks_off: int = 0

    def take(self, record: _Record, version: float) -> None:
        try:
            if record.sat[:1] == "G" and record.kind == "EPH LNAV":
                ephemeris, week_as_written = _ephemeris(record, version)
                self.ephemerides.append(ephemeris)
                self.weeks_off += week_as_written != ephemeris.week
            elif record.sat[:1] == "G" and record.kind == "ION LNAV":
                self.ionosphere = _ionosphere(record)
            else:
                self.others[f"{record.sat[:1]} {record.kind}".removesuffix(" EPH LNAV")] += 1
        except ValueError as error:
            self.damaged.append(f"line {record.line_number}: {record.sat} left out, {error}")

    def others_told(self) -> str:
        counts = ", ".join(f"{kind}: {count}" for kind, count in sorted(self.others.items()))
        return f"{self.others.total()} records of other kinds left out ({counts})"

    def remarks(self) -> list[str]:
        told = self.damaged[:_MOST_REMARKS]
        if len(self.damaged) > _MOST_REMARKS:
            told.append(f"{len(self.damaged) - _MOST_REMARKS} further damaged records left out")
        if self.weeks_off:
            told.append(f"GPS week resolved by the date in {self.weeks_off} records that tell another one")
        if self.others:
            told.append(self.others_told())
        return told


def _ephemeris(record: _Record, version: float) -> tuple[Ephemeris, int]:
    """The ephemeris of a record, and the week as it is written there. ValueError says what is wrong with the record."""
    first_column = 4 if version >= 3.0 else 3
    if len(record.lines) < 7:
        raise ValueError(f"{len(record.lines)} lines of 8")
    if version >= 4.0 and record.lines[0][:3].replace(" ", "0") != record.sat:
        raise ValueError(f"its data are of {record.lines[0][:3]!r}")
    toc_week, toc = week_and_tow(_epoch(record.lines[0], version))
    af0, af1, af2 = _row(record.lines[0], first_column + _FIELD_WIDTH, 3)
    orbit = [value for line in record.lines[1:8] for value in _row(line, first_column, 4)]
    orbit += [math.nan] * (28 - len(orbit))
    iode, crs, delta_n, m0, cuc, e, cus, sqrt_a, toe, cic, omega0, cis, i0, crc, omega, omega_dot, idot = orbit[:17]
    if any(math.isnan(value) for value in (af0, af1, af2, *orbit[:17])):
        raise ValueError("a number of its orbit or clock is missing")
    week = toc_week + round((toc - toe) / SECONDS_PER_WEEK)
    week_as_written = _whole(orbit[18], week)
    if abs(nearest_week(week_as_written, week, 1024) - week) > 1:
        raise ValueError(f"its date is in GPS week {week}, but it tells week {week_as_written}")
    sent_s, fit_h = orbit[24], orbit[25]
    ephemeris = Ephemeris(
        sat=sat_name(int(record.sat[1:])), week=week, toe=toe, toc_week=toc_week, toc=toc, af0=af0, af1=af1, af2=af2,
        tgd=0.0 if math.isnan(orbit[22]) else orbit[22], iode=int(iode), iodc=_whole(orbit[23], int(iode)),
        sqrt_a=sqrt_a, e=e, i0=i0, omega0=omega0, omega=omega, m0=m0, delta_n=delta_n, idot=idot, omega_dot=omega_dot,
        crs=crs, crc=crc, cus=cus, cuc=cuc, cis=cis, cic=cic, health=_whole(orbit[21], 0),
        ura_index=_ura_index(orbit[20]), fit_interval_h=fit_h if fit_h >= 4.0 else 4.0,  # 0 or blank: not known
        code_on_l2=_whole(orbit[17], 0), l2_p_flag=_whole(orbit[19], 0),
        transmission_tow=sent_s if sent_s < _UNKNOWN_TIME_S else math.nan,
    )  # fmt: skip
    if not is_plausible(ephemeris):
        raise ValueError("no GPS satellite can have its orbit")
    return ephemeris, week_as_written


def _ionosphere(record: _Record) -> Klobuchar:
    """RINEX 4.00, table A32: eight values from the third field of the first line on."""
    if len(record.lines) < 3:
        raise ValueError(f"{len(record.lines)} lines of 3")
    values = (*_row(record.lines[0], 4 + _FIELD_WIDTH, 3), *_row(record.lines[1], 4, 4), *_row(record.lines[2], 4, 1))
    if any(math.isnan(value) for value in values):
        raise ValueError("a number of its ionosphere is missing")
    a0, a1, a2, a3, b0, b1, b2, b3 = values
    return Klobuchar(alpha=(a0, a1, a2, a3), beta=(b0, b1, b2, b3))


def _epoch(line: str, version: float) -> np.datetime64:
    """Time of clock at the head of a record, GPS time."""
    starts = (4, 9, 12, 15, 18, 21) if version >= 3.0 else (3, 6, 9, 12, 15, 17)
    ends = (8, 11, 14, 17, 20, 23) if version >= 3.0 else (5, 8, 11, 14, 17, 22)
    texts = [line[start:end].strip() for start, end in zip(starts, ends, strict=True)]
    try:
        year, month, day, hour, minute = (int(text) for text in texts[:5])
        if version < 3.0:
            year += 1900 if year >= 80 else 2000
        start = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:00", "ns")
        return start + np.timedelta64(round(float(texts[5]) * 1e9), "ns")
    except ValueError:
        raise ValueError(f"{' '.join(texts)!r} is no date and time") from None


def _row(line: str, first_column: int, count: int) -> tuple[float, ...]:
    """`count` numbers of 19 columns; NaN for blank ones, which may also be cut off."""
    columns = range(first_column, first_column + count * _FIELD_WIDTH, _FIELD_WIDTH)
    return tuple(_number(line[column : column + _FIELD_WIDTH]) for column in columns)


def _numbers(line: str, first_column: int, width: int, count: int) -> tuple[float, ...]:
    """`count` numbers of a header line; ValueError if one is missing."""
    texts = (line[first_column + k * width : first_column + (k + 1) * width] for k in range(count))
    values = tuple(_number(text) for text in texts)
    if any(math.isnan(value) for value in values):
        raise ValueError("a number is missing")
    return values


def _number(text: str) -> float:
    """The number in a field, NaN for a blank one.

    FORTRAN's ways are known: D exponents, and no letter before three digits ("0.499063314480-269", which stands for
    zero as anything that small does: no field of the message has steps below 1e-17).
    """
    match = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+))(?:[DdEe] ?([-+]?\d+)|([-+]\d{3}))?", text.strip())
    if match:
        value = float(f"{match[1]}e{match[2] or match[3] or 0}")
        return value if abs(value) >= 1e-99 else 0.0
    if text.strip():
        raise ValueError(f"{text.strip()!r} is no number")
    return math.nan


def _whole(value: float, default: int) -> int:
    return default if math.isnan(value) else round(value)


def _ura_index(ura_m: float) -> int:
    """Index of the accuracy in metres: writers give the nominal value of a step or its upper limit."""
    return 0 if math.isnan(ura_m) else bisect.bisect_left(URA_M, ura_m)


# ---------------------------------------------------------------- writing


def _header_lines(navigation: NavigationData, created: np.datetime64 | None) -> Iterator[str]:
    date = "" if created is None else re.sub("[-:]", "", iso(created, 0)).replace("T", " ") + " UTC"
    yield _header_line(f"{3.05:9.2f}{'':11}{'N: GNSS NAV DATA':20}{'G: GPS':20}", "RINEX VERSION / TYPE")
    yield _header_line(f"{'skyproof':20}{'':20}{date:20}", "PGM / RUN BY / DATE")
    if navigation.ionosphere is not None:
        for name, values in (("GPSA", navigation.ionosphere.alpha), ("GPSB", navigation.ionosphere.beta)):
            yield _header_line(f"{name} " + "".join(f"{value:12.4E}" for value in values), "IONOSPHERIC CORR")
    if navigation.utc is not None:
        utc = navigation.utc
        terms = f"GPUT {utc.a0:17.10E}{utc.a1:16.9E}{round(utc.tot):7d}{utc.wnt:5d}"
        yield _header_line(terms, "TIME SYSTEM CORR")
        yield _header_line(f"{utc.leap_seconds:6d}", "LEAP SECONDS")
    yield _header_line("", "END OF HEADER")


def _header_line(content: str, label: str) -> str:
    return f"{content:60}{label:20}"


def _record_lines(ephemerides: Iterable[Ephemeris]) -> Iterator[str]:
    for e in ephemerides:
        toc = iso(gpst(e.toc_week, e.toc), 0)
        yield f"{e.sat} {re.sub('[-T:]', ' ', toc)}" + _columns(e.af0, e.af1, e.af2)
        sent_s = _UNKNOWN_TIME_S if math.isnan(e.transmission_tow) else e.transmission_tow
        for row in (
            (e.iode, e.crs, e.delta_n, e.m0),
            (e.cuc, e.e, e.cus, e.sqrt_a),
            (e.toe, e.cic, e.omega0, e.cis),
            (e.i0, e.crc, e.omega, e.omega_dot),
            (e.idot, e.code_on_l2, e.week, e.l2_p_flag),
            (_NOMINAL_URA_M[e.ura_index], e.health, e.tgd, e.iodc),
            (sent_s, e.fit_interval_h),
        ):
            yield "    " + _columns(*row)


def _columns(*values: float) -> str:
    return "".join(f"{value:19.12E}" for value in values)
