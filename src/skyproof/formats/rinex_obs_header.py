"""Read the header of a RINEX observation file: what it states, and what a header inside the data changes."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.errors import InputError, make_readable
from skyproof.formats.bounds import CHARACTERS_OF_LINE, Remarks
from skyproof.formats.rinex_cells import Layout, read_layout_change
from skyproof.gnss.time import require_year
from skyproof.remarks import Remark, RemarkKind

__all__ = ["TO_DO", "Header", "read_header"]

TO_DO: Final = "give a RINEX observation file (2.1x, 3.0x, 4.0x), plain, compact (.crx, .21d) or gzip"
_TIME_SYSTEMS: Final = {"R": "GLO", "E": "GAL", "C": "BDT", "J": "QZS"}  # of a file of one system that states none
_TYPES: Final = ("SYS / # / OBS TYPES", "# / TYPES OF OBSERV")
_GLONASS_CHANNELS: Final = range(-7, 14)


@dataclass
class Header:
    """What the header states. `layout` follows the changes that events inside the data make."""

    version: float
    system: str
    source: str
    n_lines: int = 0
    layout: Layout = field(default_factory=dict)
    marker: str = ""
    receiver: str = ""
    receiver_number: str = ""
    antenna: str = ""
    position_ecef_m: Reals | None = None
    antenna_delta_hen_m: Reals | None = None
    interval_s: float | None = None
    last_ns: int | None = None  # TIME OF LAST OBS, since 1970 as written
    time_system: str = ""
    leap_seconds: int | None = None
    glonass_channels: dict[str, int] = field(default_factory=dict)
    misread: dict[str, str] = field(default_factory=dict)
    remarks: Remarks = field(default_factory=Remarks)

    def take(self, line: str, label: str) -> None:
        """Take in what a line states. ValueError if it cannot be read."""
        text = line[:60]
        if label == "MARKER NAME":
            self.marker = text.strip()
        elif label == "REC # / TYPE / VERS":
            self.receiver_number, self.receiver = text[:20].strip(), text[20:40].strip()
        elif label == "ANT # / TYPE":
            self.antenna = text[20:40].strip()
        elif label == "APPROX POSITION XYZ":
            position_m = _parse_vector(text)
            self.position_ecef_m = position_m if np.linalg.norm(position_m) > 1e6 else None
        elif label == "ANTENNA: DELTA H/E/N":
            self.antenna_delta_hen_m = _parse_vector(text)
        elif label == "INTERVAL":
            interval_s = _parse_finite(text[:10])
            self.interval_s = interval_s if interval_s > 0.0 else None
        elif label == "TIME OF FIRST OBS":
            self.time_system = text[48:51].strip()
        elif label == "TIME OF LAST OBS":
            self.last_ns = _parse_instant_ns(text)
        elif label == "LEAP SECONDS":
            self.leap_seconds = int(text[:6])
        elif label == "GLONASS SLOT / FRQ #":
            pairs = re.findall(r"R(\d\d) +(-?\d+)", text)  # writers differ by a column
            numbers = {f"R{slot}": int(number) for slot, number in pairs}
            if not all(number in _GLONASS_CHANNELS for number in numbers.values()):
                raise ValueError(text)
            self.glonass_channels |= numbers

    def remark_words(self) -> list[str]:
        """Return the remarks on header lines."""
        return self.remarks.words("further header lines left out")

    def restate(self, lines: Sequence[str], layout: Layout) -> tuple[Layout, list[str]]:
        """Return the observation types from a header inside the data on, and remarks.

        No types remain, so that the data that follow are left out, where the lines name none. So also where they belong
        to another version, time system or receiver than this header.
        """
        begins = any(line[60:80].rstrip() == "RINEX VERSION / TYPE" for line in lines)
        ends = any(line[60:80].rstrip() == "END OF HEADER" for line in lines)
        changed, remarks = read_layout_change(lines, {} if begins else layout)
        named = any(changed.values()) and any(line[60:80].rstrip() in _TYPES for line in lines)
        faults = self._find_other(lines) + (
            [] if named or not (begins or ends) else ["that names no observation types"]
        )
        if faults:
            return {}, [Remark(f"a header inside the data {faults[0]}: what follows is left out", RemarkKind.BEARS)]
        for line in lines:
            if line[60:80].rstrip() == "GLONASS SLOT / FRQ #":
                with suppress(ValueError):
                    self.take(line, "GLONASS SLOT / FRQ #")
        self.misread = {}
        return changed, ["a header inside the data: the observation types that it names hold from there", *remarks]

    def _find_other(self, lines: Sequence[str]) -> list[str]:
        """List how these header lines belong to another file than this one."""
        of = Header(version=self.version, system=self.system, source=self.source)
        for line in lines:
            label = line[60:80].rstrip()
            if label == "RINEX VERSION / TYPE":
                of.version = _parse_version(line[:9])
            elif label in ("MARKER NAME", "REC # / TYPE / VERS", "TIME OF FIRST OBS"):
                of.take(line, label)
        faults = []
        if _find_rules(of.version) != _find_rules(self.version):
            faults.append(f"of RINEX {of.version:g}, expected {self.version:g} as before")
        if of.time_system and of.time_system != self.time_system:
            faults.append(f"of the time system {of.time_system}, expected {self.time_system} as before")
        names = (of.receiver_number, self.receiver_number)
        if not all(names):
            names = (of.marker, self.marker)
        if all(names) and names[0] != names[1]:
            faults.append(f"of another receiver ({make_readable(names[0])}, before {make_readable(names[1])})")
        return faults


def _parse_instant_ns(text: str) -> int:
    """Return nanoseconds since 1970 of an instant in a header: 5I6, F13.7 (RINEX 3.05, table A2)."""
    year, month, day, hour, minute = (int(text[6 * k : 6 * k + 6]) for k in range(5))
    require_year(year)
    minutes = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}", "ns")
    return int(minutes.astype(np.int64)) + round(_parse_finite(text[30:43]) * 1e9)


def _parse_version(text: str) -> float:
    """Return the version that the first columns of a header state; 0 if they state none."""
    number = text.strip()
    return float(number) if number.replace(".", "", 1).isdecimal() else 0.0


def _find_rules(version: float) -> tuple[bool, bool]:
    """Return what decides how lines are laid out and types are named."""
    return version < 3.0, 3.015 < version < 3.025


def _parse_vector(text: str) -> Reals:
    return np.array([_parse_finite(text[k : k + 14]) for k in (0, 14, 28)])


def _parse_finite(text: str) -> float:
    number = float(text)
    if not abs(number) < 1e12:
        raise ValueError(text)
    return number


def read_header(content: bytes, source: str) -> tuple[Header, int]:
    """Read the header, and find where the body begins.

    Raises InputError without a header, or without observation types in it.
    """
    first = content[: max(content.find(b"\n", 0, 200), 0) or 80].decode("latin-1")
    if first[60:80].rstrip() != "RINEX VERSION / TYPE":
        raise InputError(f"{source}, line 1: {first[:40]!r}, expected RINEX VERSION / TYPE in column 61; {TO_DO}")
    version = _parse_version(first[:9])
    if not 2.0 <= version < 5.0:
        raise InputError(f"{source}, line 1: RINEX version {first[:9].strip()!r}, expected 2, 3 or 4; {TO_DO}")
    if first[20:21].upper() != "O":
        raise InputError(f"{source}, line 1: the file is of type {first[20:40].strip()!r}, not observations; {TO_DO}")
    system = first[40:41].strip() or "G"
    header = Header(version=version, system="G" if system == "M" else system, source=source)
    lines = list[str]()
    at = 0
    while at < len(content):
        end = content.find(b"\n", at)
        end = len(content) if end < 0 else end
        line = content[at : min(end, at + CHARACTERS_OF_LINE)].decode("latin-1").rstrip("\r")
        at = end + 1
        header.n_lines += 1
        label = line[60:80].rstrip()
        if label == "END OF HEADER":
            break
        lines.append(line)
        try:
            header.take(line, label)
        except ValueError:
            header.remarks.add(f"line {header.n_lines}: {label} cannot be read and is left out")
    else:
        raise InputError(f"{source}, line {header.n_lines}: the file ends before END OF HEADER; fetch it again")
    header.layout, faults = read_layout_change(lines, {})
    for fault in faults:
        header.remarks.add(fault)
    if not any(header.layout.values()):
        raise InputError(f"{source}: the header names no observation types; fetch the file again")
    header.time_system = header.time_system or _TIME_SYSTEMS.get(system, "GPS")
    return header, at
