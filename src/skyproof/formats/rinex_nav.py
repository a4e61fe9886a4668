"""RINEX navigation files of GPS, QZSS, Galileo, BeiDou, GLONASS: read versions 2.1x to 4.0x, write 3.05.

A damaged record costs that record, never the file; `NavigationData.remarks` reports records left out.
"""

import bisect
import io
import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from skyproof.errors import InputError
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.bounds import NAVIGATION_BYTES, Remarks
from skyproof.formats.byte_io import unpack_text
from skyproof.gnss.constants import BDT_WEEK_0, SECONDS_PER_DAY, SECONDS_PER_WEEK
from skyproof.gnss.ephemeris import (
    GEOSTATIONARY,
    SYSTEM_NAMES,
    BroadcastEphemeris,
    Ephemeris,
    GlonassEphemeris,
    Klobuchar,
    NavigationData,
    UtcParameters,
)
from skyproof.gnss.lnav import URA_M
from skyproof.gnss.orbit_agreement import find_contradicted
from skyproof.gnss.orbit_faults import find_ionosphere_fault, find_orbit_fault
from skyproof.gnss.time import (
    find_nearest_week,
    format_iso,
    format_rinex_date,
    gpst,
    gpst_from_utc,
    leap_seconds,
    require_year,
    timedelta_from_s,
    utc_from_gpst,
    week_and_tow,
)

__all__ = ["get_glonass_channels", "parse_nav", "read_nav", "write_nav"]

_TO_DO: Final = "give a RINEX navigation file (2.11, 3 or 4), such as brdc0010.22n or ..._MN.rnx, plain or .gz"
_FIELD_WIDTH: Final = 19
_MOST_LINES: Final = 16  # that are kept of a record; none has more than eight
_UNKNOWN_TIME_S: Final = 0.9999e9  # RINEX 3.05, table A6: transmission time not known
_READ: Final = {
    "G": ("EPH", "EPH LNAV", "ION LNAV"),
    "J": ("EPH", "EPH LNAV"),
    "E": ("EPH", "EPH INAV", "EPH FNAV"),
    "C": ("EPH", "EPH D1", "EPH D2"),
    "R": ("EPH", "EPH FDMA"),
}
_MOST_SATS: Final = {"G": 32, "J": 10, "E": 36, "C": 63, "R": 28}
_MOST_LEAPS_OFF: Final = 2
"""Leap seconds that a file may have and the table built in has not: since 1999 there was one in two years at most."""
_NOMINAL_URA_M: Final = (2.0, 2.8, 4.0, 5.7, 8.0, 11.3, *(2.0 ** (k - 2) for k in range(6, 16)))
"""What files give for accuracy index 0 to 15 (IS-GPS-200N, 20.3.3.3.1.3)."""


def read_nav(path: str | os.PathLike[str]) -> NavigationData:
    """Read the navigation data in a RINEX file, plain or gzip.

    Raises
    ------
    InputError : the file cannot be read, is not a RINEX navigation file, or holds no ephemeris.
    """
    content = unpack_text(Path(path), NAVIGATION_BYTES, "the navigation file", _TO_DO)
    # latin-1 never fails: comments hold anything
    return parse_nav(io.TextIOWrapper(io.BytesIO(content), encoding="latin-1"), source=str(path))


def parse_nav(lines: Iterable[str], *, source: str = "navigation data") -> NavigationData:
    """Parse the lines of a RINEX navigation file; `source` names it in messages.

    Taken are LNAV of GPS and QZSS, I/NAV and F/NAV of Galileo, D1 and D2 of BeiDou, FDMA of GLONASS, and GPS's
    ionosphere. Weeks are full ones: the epoch of each record resolves them, whatever modulus the writer had. A file
    that gives the leap seconds but not the polynomial of UTC gives one of zeros.

    Raises
    ------
    InputError : not a RINEX navigation file, or no ephemeris in it.
    """
    body = ((number, line.rstrip("\r\n")) for number, line in enumerate(lines, start=1))
    header = _read_header(body, source)
    found = _Found()
    for record in _iterate_records(body, header.version, header.default_system):
        found.take(record, header.version)
    found.leave_out_contradicted()
    if not found.ephemerides:
        other_kinds = f"; {found.describe_others()}" if found.others else ""
        broken = f"; {found.damaged.named[0]}" if found.damaged.named else ""
        raise InputError(f"{source}: no ephemeris after line {header.last_line}{other_kinds}{broken}; {_TO_DO}")
    week = max(e.week for e in found.ephemerides)
    utc = header.utc(week, found.ephemerides[0].reference_gpst)
    return NavigationData(
        ephemerides=tuple(found.ephemerides),
        ionosphere=found.ionosphere or header.check_ionosphere(),
        utc=utc,
        source=source,
        remarks=(*header.remarks.words("further header lines left out"), *found.remarks()),
    )


def get_glonass_channels(navigation: NavigationData) -> dict[str, int]:
    """Return the frequency number of every GLONASS satellite in the navigation data."""
    return {e.sat: e.frequency_number for e in navigation.ephemerides if isinstance(e, GlonassEphemeris)}


def write_nav(
    path: str | os.PathLike[str], navigation: NavigationData, *, created: np.datetime64 | None = None
) -> None:
    """Write ephemerides, GPS's ionosphere and leap seconds as a RINEX 3.05 navigation file.

    Orbits and clocks keep 13 digits, the ionosphere 5, as the format has them. `created` (UTC) goes into the header,
    which leaves the date blank without it: equal data make equal bytes.

    Raises
    ------
    OutputError : the place cannot be written.
    """
    write_lines(path, [*_write_header_lines(navigation, created), *_record_lines(navigation.ephemerides)])


# ---------------------------------------------------------------- header


@dataclass
class _Header:
    version: float
    last_line: int
    default_system: str = "G"  # of version 2, whose records do not state it
    alpha: tuple[float, ...] = ()
    beta: tuple[float, ...] = ()
    utc_terms: tuple[float, ...] = ()  # A0, A1, reference time, reference week of any modulus
    leaps: int | None = None
    remarks: Remarks = field(default_factory=Remarks)

    @property
    def ionosphere(self) -> Klobuchar | None:
        if len(self.alpha) != 4 or len(self.beta) != 4:
            return None
        return Klobuchar(alpha=self.alpha, beta=self.beta)

    def check_ionosphere(self) -> Klobuchar | None:
        """Return the ionosphere; report one that is impossible, and leave it out."""
        fault = None if self.ionosphere is None else find_ionosphere_fault(self.ionosphere)
        if fault is not None:
            self.remarks.add(f"the ionosphere of the header is left out: {fault}")
        return self.ionosphere if fault is None else None

    def utc(self, week: int, at: np.datetime64) -> UtcParameters | None:
        if self.leaps is not None and abs(self.leaps - leap_seconds(at)) > _MOST_LEAPS_OFF:
            self.remarks.add(
                f"the leap seconds, {self.leaps}, are left out: at {format_iso(at, 0)} there were {leap_seconds(at)}"
            )
            self.leaps = None
        if self.leaps is None and not self.utc_terms:
            return None
        a0, a1, tot, wnt = self.utc_terms or (0.0, 0.0, 0.0, week)
        leaps = leap_seconds(at) if self.leaps is None else self.leaps
        # The message gives the week modulo 256, and writers differ in what they make of it.
        return UtcParameters(a0=a0, a1=a1, tot=tot, wnt=find_nearest_week(int(wnt), week, 256), leap_seconds=leaps)


def _read_header(body: Iterator[tuple[int, str]], source: str) -> _Header:
    _, first = next(body, (1, ""))
    label, kind = first[60:80].strip(), first[20:21].upper()
    if label != "RINEX VERSION / TYPE":
        legible = first.isascii() and first[:40].isprintable()
        beginning = repr(first[:40]) if legible else "a binary file, such as samples"
        if label == "CRINEX VERS   / TYPE":
            beginning = "a compressed RINEX observation file"
        raise InputError(f"{source}, line 1: {beginning}, expected RINEX VERSION / TYPE in column 61; {_TO_DO}")
    version = float(first[:9]) if re.fullmatch(r" *\d+(\.\d*)? *", first[:9]) else math.nan
    if not 2.0 <= version < 5.0:
        raise InputError(f"{source}, line 1: RINEX version {first[:9].strip()!r}, expected 2, 3 or 4; {_TO_DO}")
    if kind != "N" and not (kind == "G" and version < 3.0):
        kinds = {"O": "observations", "G": "GLONASS navigation data", "M": "weather", "H": "SBAS navigation data"}
        raise InputError(f"{source}, line 1: the file holds {kinds.get(kind, repr(kind))}, expected type N; {_TO_DO}")
    header = _Header(version=version, last_line=1, default_system="R" if kind == "G" else "G")
    for number, line in body:
        header.last_line = number
        label = line[60:80].strip()
        if label == "END OF HEADER":
            return header
        try:
            _take_header_line(header, line, label)
        except ValueError:
            header.remarks.add(f"line {number}: {label} cannot be read and is left out")
    raise InputError(f"{source}, line {header.last_line}: the file ends before END OF HEADER; fetch it again")


def _take_header_line(header: _Header, line: str, label: str) -> None:
    if label == "ION ALPHA":
        header.alpha = _parse_numbers(line, 2, 12, 4)
    elif label == "ION BETA":
        header.beta = _parse_numbers(line, 2, 12, 4)
    elif label == "IONOSPHERIC CORR" and line[:4] == "GPSA":
        header.alpha = _parse_numbers(line, 5, 12, 4)
    elif label == "IONOSPHERIC CORR" and line[:4] == "GPSB":
        header.beta = _parse_numbers(line, 5, 12, 4)
    elif label == "DELTA-UTC: A0,A1,T,W":
        header.utc_terms = (*_parse_numbers(line, 3, 19, 2), *_parse_numbers(line, 41, 9, 2))
    elif label == "TIME SYSTEM CORR" and line[:4] == "GPUT":
        header.utc_terms = (
            *_parse_numbers(line, 5, 17, 1),
            *_parse_numbers(line, 22, 16, 1),
            *_parse_numbers(line, 38, 7, 1),
            *_parse_numbers(line, 45, 5, 1),
        )
    elif label == "LEAP SECONDS" and line[24:27] != "BDS":
        header.leaps = int(line[:6])


# ---------------------------------------------------------------- records


@dataclass(frozen=True)
class _Record:
    """The lines of one record and the number of the first; `kind` is as in RINEX 4, e.g. "EPH LNAV".

    ends_file : nothing follows, so that it may be cut.
    """

    line_number: int
    sat: str
    kind: str
    lines: Sequence[str]
    ends_file: bool = False


def _iterate_records(body: Iterator[tuple[int, str]], version: float, default_system: str) -> Iterator[_Record]:
    """Yield the records of a file; each begins where a line begins like one, so a gap costs one record."""
    kind, sat, start, lines = "", "", 0, list[str]()
    for number, line in body:
        begins = _parse_beginning(line, version, default_system)
        if begins is None:
            if len(lines) < _MOST_LINES:
                lines.append(line)
            continue
        if lines:
            yield _Record(start, sat, kind, lines)
        sat, kind = begins
        start, lines = number, [] if line.startswith(">") else [line]
        if line.startswith(">"):
            start += 1
    if lines:
        yield _Record(start, sat, kind, lines, ends_file=True)


def _parse_beginning(line: str, version: float, default_system: str) -> tuple[str, str] | None:
    """Return satellite and kind if a record begins with this line, else None.

    Versions 2 and 3 do not name the message.
    """
    if version >= 4.0:
        match = re.match(r"> *(EPH|STO|EOP|ION) +([A-Z][ \d]\d) *(\w*)", line)
        return (match[2].replace(" ", "0"), f"{match[1]} {match[3]}") if match else None
    if version >= 3.0:
        match = re.match(r"[A-Z][ \d]\d(?= )", line)
        return (match[0].replace(" ", "0"), "EPH") if match else None
    prn = line[:2].strip()
    return (f"{default_system}{int(prn):02d}", "EPH") if prn.isdecimal() else None


@dataclass
class _Found:
    """What the records give, and what was wrong with those that give nothing."""

    ephemerides: list[BroadcastEphemeris] = field(default_factory=list)
    ionosphere: Klobuchar | None = None
    others: Counter[str] = field(default_factory=Counter)
    damaged: Remarks = field(default_factory=Remarks)
    weeks_off: int = 0

    def take(self, record: _Record, version: float) -> None:
        system = record.sat[:1]
        try:
            if record.kind not in _READ.get(system, ()):
                self.others[f"{system} {record.kind}".removesuffix(" EPH")] += 1
            elif record.kind == "ION LNAV":
                self.ionosphere = _parse_ionosphere(record)
            elif system == "R":
                self.ephemerides.append(_parse_glonass(record, version))
            else:
                ephemeris, week_as_written = _parse_ephemeris(record, version)
                self.ephemerides.append(ephemeris)
                self.weeks_off += week_as_written != ephemeris.week
        except ValueError as error:
            self.damaged.add(f"line {record.line_number}: {record.sat} left out, {error}")

    def leave_out_contradicted(self) -> None:
        """Leave out what contradicts the other data sets of its satellite."""
        wrong = find_contradicted(self.ephemerides)
        for place, words in wrong.items():
            self.damaged.add(f"{self.ephemerides[place].sat} left out, {words}")
        self.ephemerides = [ephemeris for place, ephemeris in enumerate(self.ephemerides) if place not in wrong]

    def describe_others(self) -> str:
        counts = ", ".join(f"{kind}: {count}" for kind, count in sorted(self.others.items()))
        return f"{self.others.total()} records of other kinds left out ({counts})"

    def remarks(self) -> list[str]:
        remarks = self.damaged.words("further damaged records left out")
        if self.weeks_off:
            remarks.append(f"GPS week resolved by the date in {self.weeks_off} records that state another one")
        if self.others:
            remarks.append(self.describe_others())
        return remarks


def _parse_ephemeris(record: _Record, version: float) -> tuple[Ephemeris, int]:
    """Parse the ephemeris of a record, with the week as written. ValueError says what is wrong with the record."""
    toc_instant, (af0, af1, af2), orbit = _parse_values(record, version, rows=7)
    toc_week, toc = week_and_tow(toc_instant)
    iode, crs, delta_n, m0, cuc, e, cus, sqrt_a, toe, cic, omega0, cis, i0, crc, omega, omega_dot, idot = orbit[:17]
    if any(math.isnan(value) for value in (af0, af1, af2, *orbit[:17])):
        raise ValueError("a number of its orbit or clock is missing")
    week = toc_week + round((toc - toe) / SECONDS_PER_WEEK)
    system = record.sat[0]
    week_as_written = _round_or(orbit[18], week)
    if system == "C" and week_as_written < week - BDT_WEEK_0 // 2:
        week_as_written += BDT_WEEK_0
    if abs(find_nearest_week(week_as_written, week, 1024) - week) > 1:
        raise ValueError(f"its date is in GPS week {week}, but it states week {week_as_written}")
    sent_s, fit_h = orbit[24], orbit[25]
    gps = system in "GJ"
    group_delays = (orbit[22], 0.0) if gps else (orbit[22], orbit[23])
    issue_of_clock = {"E": iode, "C": fit_h}.get(system, orbit[23])
    ephemeris = Ephemeris(
        sat=record.sat,
        week=week,
        toe=toe,
        toc_week=toc_week,
        toc=toc,
        af0=af0,
        af1=af1,
        af2=af2,
        tgd=_value_or(group_delays[0], 0.0),
        tgd2=_value_or(group_delays[1], 0.0),
        iode=int(iode),
        iodc=_round_or(issue_of_clock, int(iode)),
        sqrt_a=sqrt_a,
        e=e,
        i0=i0,
        omega0=omega0,
        omega=omega,
        m0=m0,
        delta_n=delta_n,
        idot=idot,
        omega_dot=omega_dot,
        crs=crs,
        crc=crc,
        cus=cus,
        cuc=cuc,
        cis=cis,
        cic=cic,
        health=_round_or(orbit[21], 0),
        ura_index=_find_ura_index(orbit[20]),
        fit_interval_h=fit_h if gps and fit_h >= 4.0 else 4.0,  # 0 or blank: not known
        code_on_l2=_round_or(orbit[17], 0) if gps else 0,
        l2_p_flag=_round_or(orbit[19], 0) if gps else 0,
        transmission_tow=sent_s if sent_s < _UNKNOWN_TIME_S else math.nan,
        message=_name_message(record, orbit[17]),
    )
    _require_possible(ephemeris)
    return ephemeris, week_as_written


def _require_possible(ephemeris: BroadcastEphemeris) -> None:
    """Raise ValueError for what no satellite sends: an edited or damaged file has any number in it."""
    if (fault := find_orbit_fault(ephemeris)) is not None:
        raise ValueError(fault)


def _name_message(record: _Record, sources: float) -> str:
    """Name the message as version 4 states it.

    For Galileo in version 3 the pair of signals that its clock is for decides (RINEX 3.05, table A8).
    """
    if record.kind != "EPH":
        return record.kind.removeprefix("EPH ")
    if record.sat[0] == "E":
        bits = _round_or(sources, 0)
        return "FNAV" if bits & 1 << 8 or (bits & 0b010 and not bits & 0b101) else "INAV"
    if record.sat[0] == "C":
        return "D2" if record.sat in GEOSTATIONARY else "D1"
    return "LNAV"


def _parse_glonass(record: _Record, version: float) -> GlonassEphemeris:
    """Parse a GLONASS record (RINEX 2.11, tables A10, A11; 3.05, A10; 4.00, A23). The epoch is UTC."""
    utc, (bias_s, gamma_n, frame_s), state = _parse_values(record, version, rows=3)
    if any(math.isnan(value) for value in (bias_s, gamma_n, *state[:3], *state[4:7], *state[7:11])):
        raise ValueError("a number of its orbit or clock is missing")
    x, y, z = state[0:4], state[4:8], state[8:12]
    position, velocity, acceleration = ((1e3 * x[k], 1e3 * y[k], 1e3 * _value_or(z[k], 0.0)) for k in range(3))
    if abs(_value_or(y[3], 0.0)) > 13:
        raise ValueError(f"its frequency number is {y[3]:g}, expected -7 to 13")
    _, utc_s = week_and_tow(utc)
    week, toe = week_and_tow(gpst_from_utc(utc))
    day_s = utc_s // SECONDS_PER_DAY * SECONDS_PER_DAY if version < 3.0 else 0.0  # version 2 counts from midnight
    ephemeris = GlonassEphemeris(
        sat=record.sat,
        week=week,
        toe=toe,
        tau_n=-bias_s,
        gamma_n=gamma_n,
        frequency_number=_round_or(y[3], 0),
        position_m=position,
        velocity_m_s=velocity,
        acceleration_m_s2=acceleration,
        health=_round_or(x[3], 0),
        age_days=_value_or(z[3], 0.0),
        message_tow=frame_s + day_s,
        delta_tau_n=state[13] if abs(state[13]) < 1e-6 else math.nan,  # 0.999999999999E+09 is not known
    )
    _require_possible(ephemeris)
    return ephemeris


def _parse_values(
    record: _Record, version: float, *, rows: int
) -> tuple[np.datetime64, tuple[float, ...], tuple[float, ...]]:
    """Parse the epoch, the three numbers beside it, and those of the lines below, filled with NaN to 28.

    `rows` lines below have to be present; of eight lines the last may be missing.
    """
    first_column = 4 if version >= 3.0 else 3
    if len(record.lines) < min(rows + 1, 7):
        raise ValueError(f"{len(record.lines)} of its {rows + 1} lines are there")
    if version >= 4.0 and record.lines[0][:3].replace(" ", "0") != record.sat:
        raise ValueError(f"its data belong to {record.lines[0][:3]!r}")
    if not 1 <= int(record.sat[1:]) <= _MOST_SATS[record.sat[0]]:
        raise ValueError("no satellite has this number")
    columns = len(record.lines[-1][: first_column + 4 * _FIELD_WIDTH].rstrip())
    if record.ends_file and columns > first_column and (columns - first_column) % _FIELD_WIDTH:
        raise ValueError(f"the file ends within a number of its line {len(record.lines)}: fetch it again")
    clock = _parse_row(record.lines[0], first_column + _FIELD_WIDTH, 3)
    below = [value for line in record.lines[1:8] for value in _parse_row(line, first_column, 4)]
    return _parse_epoch(record.lines[0], version), clock, (*below, *[math.nan] * (28 - len(below)))


def _parse_ionosphere(record: _Record) -> Klobuchar:
    """Parse an ionosphere (RINEX 4.00, table A32): eight values from the third field of the first line on."""
    if len(record.lines) < 3:
        raise ValueError(f"{len(record.lines)} of its 3 lines are there")
    values = (
        *_parse_row(record.lines[0], 4 + _FIELD_WIDTH, 3),
        *_parse_row(record.lines[1], 4, 4),
        *_parse_row(record.lines[2], 4, 1),
    )
    if any(math.isnan(value) for value in values):
        raise ValueError("a number of its ionosphere is missing")
    a0, a1, a2, a3, b0, b1, b2, b3 = values
    ionosphere = Klobuchar(alpha=(a0, a1, a2, a3), beta=(b0, b1, b2, b3))
    if (fault := find_ionosphere_fault(ionosphere)) is not None:
        raise ValueError(fault)
    return ionosphere


def _parse_epoch(line: str, version: float) -> np.datetime64:
    """Parse the time of clock at the head of a record, GPS time."""
    starts = (4, 9, 12, 15, 18, 21) if version >= 3.0 else (3, 6, 9, 12, 15, 17)
    ends = (8, 11, 14, 17, 20, 23) if version >= 3.0 else (5, 8, 11, 14, 17, 22)
    texts = [line[start:end].strip() for start, end in zip(starts, ends, strict=True)]
    try:
        year, month, day, hour, minute = (int(text) for text in texts[:5])
        if version < 3.0:
            year += 1900 if year >= 80 else 2000
        require_year(year)
        start = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:00", "ns")
        if not 0.0 <= (second := float(texts[5])) < 61.0:
            raise ValueError(second)
        return start + timedelta_from_s(second)
    except ValueError:
        raise ValueError(f"{' '.join(texts)!r} is not a date and time") from None


def _parse_row(line: str, first_column: int, count: int) -> tuple[float, ...]:
    """Parse `count` numbers of 19 columns; NaN for blank ones, which may also be cut off."""
    columns = range(first_column, first_column + count * _FIELD_WIDTH, _FIELD_WIDTH)
    return tuple(_parse_number(line[column : column + _FIELD_WIDTH]) for column in columns)


def _parse_numbers(line: str, first_column: int, width: int, count: int) -> tuple[float, ...]:
    """Parse `count` numbers of a header line; ValueError if one is missing."""
    texts = (line[first_column + k * width : first_column + (k + 1) * width] for k in range(count))
    values = tuple(_parse_number(text) for text in texts)
    if any(math.isnan(value) for value in values):
        raise ValueError("a number is missing")
    return values


def _parse_number(text: str) -> float:
    """Parse the number in a field, NaN for a blank one.

    FORTRAN's ways are known: D exponents, and no letter before three digits ("0.499063314480-269", which stands for
    zero as anything that small does: no field of the message has steps below 1e-17).
    """
    match = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+))(?:[DdEe] ?([-+]?\d+)|([-+]\d{3}))?", text.strip())
    if match:
        value = float(f"{match[1]}e{match[2] or match[3] or 0}")
        if math.isinf(value):
            raise ValueError(f"{text.strip()!r} is too large for a number")
        return value if abs(value) >= 1e-99 else 0.0
    if text.strip():
        raise ValueError(f"{text.strip()!r} is not a number")
    return math.nan


def _round_or(value: float, default: int) -> int:
    return default if math.isnan(value) else round(value)


def _value_or(value: float, default: float) -> float:
    return default if math.isnan(value) else value


def _find_ura_index(ura_m: float) -> int:
    """Find the index of the accuracy in metres: writers give the nominal value of a step or its upper limit."""
    return 0 if math.isnan(ura_m) else bisect.bisect_left(URA_M, ura_m)


# ---------------------------------------------------------------- writing


def _write_header_lines(navigation: NavigationData, created: np.datetime64 | None) -> Iterator[str]:
    date = "" if created is None else format_rinex_date(created)
    yield _format_header_line(
        f"{3.05:9.2f}{'':11}{'N: GNSS NAV DATA':20}{_name_systems(navigation):20}", "RINEX VERSION / TYPE"
    )
    yield _format_header_line(f"{'skyproof':20}{'':20}{date:20}", "PGM / RUN BY / DATE")
    if navigation.ionosphere is not None:
        for name, values in (("GPSA", navigation.ionosphere.alpha), ("GPSB", navigation.ionosphere.beta)):
            yield _format_header_line(f"{name} " + "".join(f"{value:12.4E}" for value in values), "IONOSPHERIC CORR")
    if navigation.utc is not None:
        utc = navigation.utc
        terms = f"GPUT {utc.a0:17.10E}{utc.a1:16.9E}{round(utc.tot):7d}{utc.wnt:5d}"
        yield _format_header_line(terms, "TIME SYSTEM CORR")
        yield _format_header_line(f"{utc.leap_seconds:6d}", "LEAP SECONDS")
    yield _format_header_line("", "END OF HEADER")


def _format_header_line(content: str, label: str) -> str:
    return f"{content:60}{label:20}"


def _name_systems(navigation: NavigationData) -> str:
    letters = {e.sat[0] for e in navigation.ephemerides} or {"G"}
    return "M: MIXED" if len(letters) > 1 else f"{min(letters)}: {SYSTEM_NAMES[min(letters)]}"


def _record_lines(ephemerides: Iterable[BroadcastEphemeris]) -> Iterator[str]:
    """Give the records of all but CNAV and B-CNAV, which version 3 has none for."""
    for e in ephemerides:
        if isinstance(e, Ephemeris) and e.message in ("CNAV", "BCNAV1", "BCNAV2"):
            continue
        epoch, clock, rows = _list_glonass_rows(e) if isinstance(e, GlonassEphemeris) else _list_kepler_rows(e)
        yield f"{e.sat} {re.sub('[-T:]', ' ', format_iso(epoch, 0))}" + _format_columns(*clock)
        for row in rows:
            yield ("    " + _format_columns(*row)).rstrip()


_Numbers = tuple[float, ...]


def _list_glonass_rows(e: GlonassEphemeris) -> tuple[np.datetime64, _Numbers, tuple[_Numbers, ...]]:
    x, y, z = (
        tuple(1e-3 * vector[k] for vector in (e.position_m, e.velocity_m_s, e.acceleration_m_s2)) for k in range(3)
    )
    delay_s = 0.999999999999e9 if math.isnan(e.delta_tau_n) else e.delta_tau_n
    rows = ((*x, e.health), (*y, e.frequency_number), (*z, e.age_days), (math.nan, delay_s))
    return utc_from_gpst(e.reference_gpst), (-e.tau_n, e.gamma_n, e.message_tow), rows


def _list_kepler_rows(e: Ephemeris) -> tuple[np.datetime64, _Numbers, tuple[_Numbers, ...]]:
    sent_s = _UNKNOWN_TIME_S if math.isnan(e.transmission_tow) else e.transmission_tow
    system = e.sat[0]
    sources = {"INAV": 1 << 9 | 0b101, "FNAV": 1 << 8 | 0b010}.get(e.message, 0)
    fifth, after_tgd, last = {
        "E": ((e.idot, sources, e.week), e.tgd2, (sent_s,)),
        "C": ((e.idot, math.nan, e.week - BDT_WEEK_0), e.tgd2, (sent_s, e.iodc)),
    }.get(system, ((e.idot, e.code_on_l2, e.week, e.l2_p_flag), e.iodc, (sent_s, e.fit_interval_h)))
    rows = (
        (e.iode, e.crs, e.delta_n, e.m0),
        (e.cuc, e.e, e.cus, e.sqrt_a),
        (e.toe, e.cic, e.omega0, e.cis),
        (e.i0, e.crc, e.omega, e.omega_dot),
        fifth,
        (_NOMINAL_URA_M[e.ura_index], e.health, e.tgd, after_tgd),
        last,
    )
    return gpst(e.toc_week, e.toc), (e.af0, e.af1, e.af2), rows


def _format_columns(*values: float) -> str:
    return "".join(" " * _FIELD_WIDTH if math.isnan(value) else f"{value:19.12E}" for value in values)
