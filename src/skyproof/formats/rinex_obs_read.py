"""RINEX observation files to observations: versions 2.10 and 2.11, 3.0x and 4.0x, compact and gzip too, all systems.

Damage costs the cell, the satellite or the epoch that is damaged and is reported in the remarks, never the file; of a
compact file it costs all that continues from it.
"""

import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Instants, Integers, Reals
from skyproof.errors import InputError, readable
from skyproof.formats.bounds import CHARACTERS_OF_LINE, EMPTY_CELLS, OBSERVATION_BYTES, Remarks, listed
from skyproof.formats.byte_io import beginning, unpacked
from skyproof.formats.crinex import expanded, is_compact
from skyproof.formats.plausible import LETTERS, Implausible, impossible_remarks, leave_out_impossible
from skyproof.formats.rinex_cells import Layout, Lines, SatelliteRows, cells, layout_change, lines_of, rows_2, rows_3
from skyproof.formats.signatures import head_of
from skyproof.gnss.constants import BDT_BEHIND_GPST_S
from skyproof.gnss.signals import carrier_hz_of, rinex_signal
from skyproof.gnss.thermal_noise import carrier_sigma_cyc, code_sigma_m, doppler_sigma_hz
from skyproof.gnss.time import gpst_from_utc, iso, require_year
from skyproof.records import CellStatus, Observations, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "Header",
    "ObservationFile",
    "file_of",
    "header_of",
    "holds_observations",
    "parse_obs",
    "read_obs",
    "require_text",
]

_TO_DO: Final = "give a RINEX observation file (2.1x, 3.0x, 4.0x), plain, compact (.crx, .21d) or gzip"
_TIME_SYSTEMS: Final = {"R": "GLO", "E": "GAL", "C": "BDT", "J": "QZS"}  # of a file of one system that states none
_BY_TYPE_2: Final = {
    "C1": "1C",
    "P1": "1P",
    "C2": "2C",
    "P2": "2P",
    "C5": "5X",
    "C6": "6X",
    "C7": "7X",
    "C8": "8X",
}
"""The RINEX 3 signal of a code of version 2 (RINEX 3.05, section 10): the channel of a modern code is not given: X."""
_BY_SYSTEM_2: Final = {
    "G": {"P1": "1W", "P2": "2W", "C2": "2X"},
    "E": {"C1": "1X"},
    "C": {"C1": "2I", "C2": "2I", "C7": "7I", "C6": "6I"},
}
_UNKNOWN_CN0_DBHZ: Final = 40.0
_KINDS: Final = ("C", "L", "D", "S")
_SYSTEMS: Final = "GRECJSI"
_NO_SIGNALS: Final = ("I", "X", "T")
"""Types that are known and not read: the ionosphere's delay, the receiver's channel, and Transit (table A23; 2.11)."""
_TYPES: Final = ("SYS / # / OBS TYPES", "# / TYPES OF OBSERV")
_EMPTY_LINES: Final = 1 << 20  # beyond one in 16 bytes
_FILLED: Final = 16  # epochs and signals are so many times the cells that are filled, at most
_GLONASS_CHANNELS: Final = range(-7, 14)
_LATE_NS: Final = 500_000_000  # receivers that round the instants of a header differ by less


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservationFile:
    """One receiver's observations and what the header states beside them; None or "" where it does not.

    observations : epochs in GPS time, in order, one channel a signal, every copy "a".
    position_ecef_m : (3,) approximate. antenna_delta_hen_m : (3,) height, east, north of the antenna over the marker.
    time_system : of the file, "GPS" for instance. glonass_channels : frequency numbers by satellite.
    impossible : cells that were left out since no receiver measures such values, by type ("G C1C"). misread : types
        that were left out as a whole, and why.
    """

    observations: Observations
    version: float
    marker: str = ""
    receiver: str = ""
    antenna: str = ""
    position_ecef_m: Reals | None = None
    antenna_delta_hen_m: Reals | None = None
    interval_s: float | None = None
    time_system: str = "GPS"
    leap_seconds: int | None = None
    glonass_channels: Mapping[str, int] = field(default_factory=dict)
    impossible: Mapping[str, int] = field(default_factory=dict)
    misread: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def read_obs(
    path: str | os.PathLike[str],
    *,
    keep: Callable[[SignalId], bool] | None = None,
    glonass_channels: Mapping[str, int] | None = None,
) -> ObservationFile:
    """The observations in a RINEX file, plain, compact or gzip.

    Parameters
    ----------
    keep : which signals; all without it. What is left out is not even parsed.
    glonass_channels : frequency numbers where the header has none, as `rinex_nav.glonass_channels` gives them.

    Raises
    ------
    InputError : the file cannot be read, is no RINEX observation file, or holds no observation.
    """
    content = unpacked(Path(path), OBSERVATION_BYTES, "the observation file", _TO_DO)
    return parse_obs(content, source=str(path), keep=keep, glonass_channels=glonass_channels)


def holds_observations(path: Path) -> bool:
    """Whether a file begins as a RINEX observation file does, plain, compact or gzip."""
    if not path.is_file():
        return False
    first = beginning(head_of(path)).split(b"\n", 1)[0]
    compact = first[60:80].rstrip() == b"CRINEX VERS   / TYPE"
    return compact or (first[60:80].rstrip() == b"RINEX VERSION / TYPE" and first[20:21].upper() == b"O")


def parse_obs(
    content: bytes,
    *,
    source: str = "observations",
    keep: Callable[[SignalId], bool] | None = None,
    glonass_channels: Mapping[str, int] | None = None,
) -> ObservationFile:
    """The observations in the bytes of a RINEX file; `source` names it in messages.

    Loss of lock, slips stated by event records and a power failure become status 3 (cycle slip), and so does a phase
    that may be half a cycle off and then may not, or the other way round. Sigmas are those of thermal noise in textbook
    loops: code by an early-minus-late loop of 1 Hz and 0.5 chip, phase and frequency by loops of 15 Hz, 20 ms
    of integration (Kaplan and Hegarty, Understanding GPS/GNSS, 3rd ed., 8.9); without C/N0 by that of the strength
    indicator, and 40 dB-Hz where there is none either, which the remarks report.

    Raises
    ------
    InputError : as `read_obs` does.
    """
    compact_remarks: tuple[str, ...] = ()
    if is_compact(content):
        content, compact_remarks = expanded(content, source=source)
    require_text(content, source)
    header, body_at = header_of(content, source)
    lines = lines_of(np.frombuffer(content, np.uint8)[body_at:], header.n_lines + 1)
    found = file_of(lines, header, keep=keep, glonass_channels=glonass_channels)
    impossible = impossible_remarks(found.impossible, found.misread)
    remarks = [*compact_remarks, *header.remark_words(), *impossible, *found.remarks]
    if not found.observations.signals:
        first = f"; {found.remarks[0]}" if found.remarks else ""
        raise InputError(f"{source}: no observation after line {header.n_lines}{first}; {_TO_DO}")
    return replace(found, remarks=tuple(remarks))


def require_text(content: bytes, source: str) -> None:
    """Raise InputError for hardly more than empty lines, of which the tables would take all memory."""
    if content.count(b"\n") > _EMPTY_LINES + len(content) // 16:
        raise InputError(f"{source}: hardly more than empty lines; {_TO_DO}")


def file_of(
    lines: Lines,
    header: "Header",
    *,
    keep: Callable[[SignalId], bool] | None = None,
    glonass_channels: Mapping[str, int] | None = None,
    to_end: bool = True,
) -> ObservationFile:
    """The observations in lines of the body, which may have none; and changes of the observation types into `header`,
    so that it is that of the lines that follow.

    to_end : whether the file ends with these lines.
    """
    rows = (
        rows_3(lines, header.layout, header.restated, to_end=to_end)
        if header.version >= 3.0
        else rows_2(lines, header.layout, header.system, header.restated, to_end=to_end)
    )
    header.layout = rows.layouts[-1]
    numbers = dict(glonass_channels or {}) | header.glonass_channels
    table, implausible = _plausible(_Table.of(lines, rows, header, keep), header, numbers)
    remarks = [
        *(_end_remarks(lines, rows, header) if to_end else ()),
        *_names_remarks(rows.layouts, header.version),
        *implausible.remarks,
        *rows.remarks,
        *table.remarks,
    ]
    unnumbered = sorted({s.sat for s in table.signals if s.band in ("G1", "G2") and s.sat not in numbers})
    if unnumbered:
        unknown = f"no frequency number of {listed(unnumbered)}: their carriers are not known"
        remarks.append(Remark(unknown, RemarkKind.BEARS))
    return ObservationFile(
        observations=_observations(table, header, numbers, remarks),
        version=header.version,
        marker=header.marker,
        receiver=header.receiver,
        antenna=header.antenna,
        position_ecef_m=header.position_ecef_m,
        antenna_delta_hen_m=header.antenna_delta_hen_m,
        interval_s=header.interval_s,
        time_system=header.time_system,
        leap_seconds=header.leap_seconds,
        glonass_channels=header.glonass_channels,
        impossible=implausible.counts,
        misread=implausible.misread,
        remarks=tuple(remarks),
    )


def _end_remarks(lines: Lines, rows: SatelliteRows, header: "Header") -> Iterable[str]:
    """Say what shows that more was to come after the last of the lines."""
    said = any(Remark.kind_of(remark) is RemarkKind.CUT for remark in rows.remarks)
    if said:
        return
    if lines.text.size and lines.text[-1] != ord("\n"):
        number = lines.first_number + len(lines) - 1
        yield Remark(
            f"the file is cut, within line {number}, which has no end; add the end of the line if the line is whole",
            RemarkKind.CUT,
        )
        return
    last_ns = int(rows.instant_ns.max()) if rows.instant_ns.size else None
    if last_ns is not None and header.last_ns is not None and header.last_ns - last_ns > _LATE_NS:
        stated, found = (iso(np.datetime64(ns, "ns"), 0).replace("T", " ") for ns in (header.last_ns, last_ns))
        yield Remark(
            f"the header states observations until {stated}, but the last are of {found}: the file is cut, or its "
            "header is that of a longer one",
            RemarkKind.BEARS,
        )


# --- the header


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
        """What the line states. ValueError if it cannot be read."""
        text = line[:60]
        if label == "MARKER NAME":
            self.marker = text.strip()
        elif label == "REC # / TYPE / VERS":
            self.receiver_number, self.receiver = text[:20].strip(), text[20:40].strip()
        elif label == "ANT # / TYPE":
            self.antenna = text[20:40].strip()
        elif label == "APPROX POSITION XYZ":
            position_m = _vector(text)
            self.position_ecef_m = position_m if np.linalg.norm(position_m) > 1e6 else None
        elif label == "ANTENNA: DELTA H/E/N":
            self.antenna_delta_hen_m = _vector(text)
        elif label == "INTERVAL":
            interval_s = _finite(text[:10])
            self.interval_s = interval_s if interval_s > 0.0 else None
        elif label == "TIME OF FIRST OBS":
            self.time_system = text[48:51].strip()
        elif label == "TIME OF LAST OBS":
            self.last_ns = _instant_ns(text)
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

    def restated(self, lines: Sequence[str], layout: Layout) -> tuple[Layout, list[str]]:
        """Return the observation types from a header inside the data on, and remarks.

        There are none, so that what follows is left out, where the lines name none, or are of another version, time
        system or receiver than this header.
        """
        begins = any(line[60:80].rstrip() == "RINEX VERSION / TYPE" for line in lines)
        ends = any(line[60:80].rstrip() == "END OF HEADER" for line in lines)
        changed, remarks = layout_change(lines, {} if begins else layout)
        named = any(changed.values()) and any(line[60:80].rstrip() in _TYPES for line in lines)
        faults = self._other(lines) + ([] if named or not (begins or ends) else ["that names no observation types"])
        if faults:
            return {}, [Remark(f"a header inside the data {faults[0]}: what follows is left out", RemarkKind.BEARS)]
        for line in lines:
            if line[60:80].rstrip() == "GLONASS SLOT / FRQ #":
                with suppress(ValueError):
                    self.take(line, "GLONASS SLOT / FRQ #")
        self.misread = {}
        return changed, ["a header inside the data: the observation types that it names hold from there", *remarks]

    def _other(self, lines: Sequence[str]) -> list[str]:
        """In what these lines of a header are of another file than this one."""
        of = Header(version=self.version, system=self.system, source=self.source)
        for line in lines:
            label = line[60:80].rstrip()
            if label == "RINEX VERSION / TYPE":
                of.version = _version(line[:9])
            elif label in ("MARKER NAME", "REC # / TYPE / VERS", "TIME OF FIRST OBS"):
                of.take(line, label)
        faults = []
        if _rules(of.version) != _rules(self.version):
            faults.append(f"of RINEX {of.version:g}, expected {self.version:g} as before")
        if of.time_system and of.time_system != self.time_system:
            faults.append(f"of the time system {of.time_system}, expected {self.time_system} as before")
        names = (of.receiver_number, self.receiver_number)
        if not all(names):
            names = (of.marker, self.marker)
        if all(names) and names[0] != names[1]:
            faults.append(f"of another receiver ({readable(names[0])}, before {readable(names[1])})")
        return faults


def _instant_ns(text: str) -> int:
    """Return nanoseconds since 1970 of an instant in a header: 5I6, F13.7 (RINEX 3.05, table A2)."""
    year, month, day, hour, minute = (int(text[6 * k : 6 * k + 6]) for k in range(5))
    require_year(year)
    minutes = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}", "ns")
    return int(minutes.astype(np.int64)) + round(_finite(text[30:43]) * 1e9)


def _version(text: str) -> float:
    """Return the version that the first columns of a header state; 0 if they state none."""
    number = text.strip()
    return float(number) if number.replace(".", "", 1).isdecimal() else 0.0


def _rules(version: float) -> tuple[bool, bool]:
    """Return what decides how lines are laid out and types are named."""
    return version < 3.0, 3.015 < version < 3.025


def _vector(text: str) -> Reals:
    return np.array([_finite(text[k : k + 14]) for k in (0, 14, 28)])


def _finite(text: str) -> float:
    number = float(text)
    if not abs(number) < 1e12:
        raise ValueError(text)
    return number


def header_of(content: bytes, source: str) -> tuple[Header, int]:
    """The header and where the body begins. Raises InputError if there is none, or it names no observation types."""
    first = content[: max(content.find(b"\n", 0, 200), 0) or 80].decode("latin-1")
    if first[60:80].rstrip() != "RINEX VERSION / TYPE":
        raise InputError(f"{source}, line 1: {first[:40]!r}, expected RINEX VERSION / TYPE in column 61; {_TO_DO}")
    version = _version(first[:9])
    if not 2.0 <= version < 5.0:
        raise InputError(f"{source}, line 1: RINEX version {first[:9].strip()!r}, expected 2, 3 or 4; {_TO_DO}")
    if first[20:21].upper() != "O":
        raise InputError(f"{source}, line 1: the file is of type {first[20:40].strip()!r}, not observations; {_TO_DO}")
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
    header.layout, faults = layout_change(lines, {})
    for fault in faults:
        header.remarks.add(fault)
    if not any(header.layout.values()):
        raise InputError(f"{source}: the header names no observation types; fetch the file again")
    header.time_system = header.time_system or _TIME_SYSTEMS.get(system, "GPS")
    return header, at


# --- signals


def _signals_of(types: Sequence[str], system: str, version: float) -> dict[tuple[str, str], dict[str, int]]:
    """Band and code to the field of its code, phase, Doppler and strength."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    for column, name in sorted(enumerate(types), key=lambda typed: len(typed[1]) != 3):  # whole names first
        type_3 = _whole_name(name, types, system, version)
        signal = rinex_signal(system, type_3[1:], version) if type_3[:1] in _KINDS else None
        if signal is not None:
            found.setdefault(signal, {}).setdefault(type_3[0], column)
    return found


def _whole_name(name: str, types: Sequence[str], system: str, version: float) -> str:
    """Return the name in version 3 of a type; "" for one that has no meaning, or not one alone.

    Names of version 2 stand in headers of version 3 as well, and the other way round.
    """
    if len(name) == 3:
        return name if name[0] in _KINDS else ""
    if len(name) != 2 or name[0] not in "CLPDS":
        return ""
    if version >= 3.0 and (system == "C" or (name[1] != "1" and not {f"C{name[1]}", f"P{name[1]}"} & set(types))):
        return ""  # BeiDou's bands were numbered otherwise; and which of two codes a phase is of, is not known
    type_3 = _as_version_3(name, types, system)
    return type_3 if len(type_3) == 3 else ""


def _names_remarks(layouts: Iterable[Layout], version: float) -> list[str]:
    """Report names of types that the version does not have: what they are read as, or that they are left out."""
    read, unknown = list[str](), list[str]()
    for layout in layouts:
        for system, types in layout.items():
            for name in types:
                wholes = {s: _whole_name(name, types, s, version) for s in (system or _SYSTEMS)}
                whole = next((n for s, n in wholes.items() if n and rinex_signal(s, n[1:], version)), "")
                if whole and (len(name) == 3) == (version >= 3.0):
                    continue
                if whole:
                    read.append(f"{system} {name} as {whole}".strip())
                elif name[:1] not in _NO_SIGNALS:
                    unknown.append(f"{system} {readable(name[:12])}".strip())
    open_ = listed([*dict.fromkeys(unknown)])
    has_not = f"observation types that RINEX {version:g} does not have"
    return [
        *([f"{has_not} are read as what they mean: {listed([*dict.fromkeys(read)])}"] if read else []),
        *([Remark(f"{has_not}, or whose meaning is open, are left out: {open_}", RemarkKind.BEARS)] if unknown else []),
    ]


def _as_version_3(name: str, types: Sequence[str], system: str) -> str:
    """Version 2 does not say of which code a phase is: of C/A on the first band if there is one, else of the other."""
    kind, band = name[:1], name[1:]
    codes = (f"C{band}", f"P{band}") if band == "1" or system != "G" else (f"P{band}", f"C{band}")
    code = name if kind in "CP" else next((c for c in codes if c in types), codes[0])
    attribute = _BY_SYSTEM_2.get(system, {}).get(code, _BY_TYPE_2.get(code, ""))
    return ("C" if kind == "P" else kind) + attribute


_Block = tuple[SignalId, Integers, dict[str, Reals], NDArray[np.uint8], Booleans, Booleans]
"""One signal's epochs, numbers by kind, strength, loss of lock, and where its phase may be half a cycle off."""


@dataclass(frozen=True, eq=False)
class _Table:
    """Every signal's numbers by epoch, (n_epochs, n_signals) each."""

    signals: tuple[SignalId, ...]
    instant_ns: Integers
    numbers: Mapping[str, Reals]  # by kind
    strength: NDArray[np.uint8]
    lost: Booleans
    half_open: Booleans
    remarks: tuple[str, ...]
    impossible: Booleans | None = None  # ranges that were left out

    @classmethod
    def of(cls, lines: Lines, rows: SatelliteRows, header: Header, keep: Callable[[SignalId], bool] | None) -> "_Table":
        place, instant_ns, remarks = _epochs_in_order(rows)
        observed = rows.flag[rows.epoch] < 6
        bad: list[int] = []
        blocks: list[_Block] = []
        for layout, types_by_system in enumerate(rows.layouts):
            for letter in sorted({chr(k) for k in np.unique(rows.sat // 100)}):
                types = types_by_system.get(letter, types_by_system.get("", ()))
                its = np.flatnonzero(observed & (rows.layout == layout) & (rows.sat // 100 == ord(letter)))
                its = its[place[rows.epoch[its]] >= 0]
                fields = _signals_of(types, letter, header.version)
                blocks += _blocks(lines, rows, its, fields, header, keep, place, bad)
        signals = tuple(sorted({block[0] for block in blocks}))
        column = {signal: k for k, signal in enumerate(signals)}
        shape = (instant_ns.size, len(signals))
        filled = sum(block[1].size for block in blocks)
        if shape[0] * shape[1] > EMPTY_CELLS + _FILLED * filled:
            raise InputError(
                f"{header.source}: {shape[0]} epochs of {shape[1]} signals, of which {filled} cells are filled: the "
                "file is damaged, or many files in one; give the file of one receiver and one day"
            )
        numbers = {kind: np.full(shape, np.nan) for kind in _KINDS}
        strength, lost, half_open = np.zeros(shape, np.uint8), np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
        for signal, epochs, values, marks, slips, halves in blocks:
            for kind, value in values.items():
                numbers[kind][epochs, column[signal]] = value
            strength[epochs, column[signal]] = marks
            lost[epochs, column[signal]] = slips
            half_open[epochs, column[signal]] = halves
        lost |= _stated_slips(rows, place, instant_ns, signals) | _changes(half_open, np.isfinite(numbers["L"]))
        faults = Remarks()
        for k in sorted(set(bad)):
            faults.add(f"line {lines.first_number + k}: a field that is not a number is left out")
        words = faults.words("further lines with fields that are not numbers")
        return cls(signals, instant_ns, numbers, strength, lost, half_open, (*remarks, *words))


def _epochs_in_order(rows: SatelliteRows) -> tuple[Integers, Integers, list[str]]:
    """Where each epoch of the file stands in time (-1 for what is none), those times, and what was put right."""
    epochs = np.flatnonzero(rows.flag < 6)
    order = epochs[np.argsort(rows.instant_ns[epochs], kind="stable")]
    instant_ns = rows.instant_ns[order]
    new = np.append(True, np.diff(instant_ns) > 0)[: order.size]
    place = np.full(rows.flag.size, -1, np.int64)
    place[order[new]] = np.arange(int(new.sum()))
    remarks: list[str] = []
    if not new.all():
        twice = f"{int((~new).sum())} epochs appear twice; the first of each is taken"
        remarks.append(Remark(twice, RemarkKind.BEARS))
    if (np.diff(epochs[np.argsort(order, kind="stable")]) < 0).any() or (np.diff(rows.instant_ns[epochs]) < 0).any():
        remarks.append("epochs are not in order of time; they were sorted")
    return place, instant_ns[new], remarks


def _blocks(
    lines: Lines,
    rows: SatelliteRows,
    its: Integers,
    fields: Mapping[tuple[str, str], Mapping[str, int]],
    header: Header,
    keep: Callable[[SignalId], bool] | None,
    place: Integers,
    bad: list[int],
) -> Iterable[_Block]:
    """What the rows `its` of one system hold of each signal."""
    sats = np.unique(rows.sat[its]).tolist()
    names = {sat: f"{chr(sat // 100)}{sat % 100:02d}" for sat in sats}
    wanted = {
        signal: columns
        for signal, columns in fields.items()
        if keep is None or any(keep(SignalId(name, *signal)) for name in names.values())
    }
    kept = sorted({column for columns in wanted.values() for column in columns.values()})
    if not kept or its.size == 0:
        return []
    if its.size * len(kept) > EMPTY_CELLS + lines.text.size:
        raise InputError(
            f"{header.source}: {its.size} records for {len(kept)} types of observation in {lines.text.size} bytes: the "
            "header is damaged; fetch the file again"
        )
    old = header.version < 3.0
    parsed = cells(lines, rows.line[its], kept, five_a_line=old, name_columns=0 if old else 3)
    bad.extend(parsed.bad.tolist())
    at = {column: k for k, column in enumerate(kept)}
    blocks = []
    failed = rows.flag[rows.epoch[its]] == 1
    for sat in sats:
        own = np.flatnonzero(rows.sat[its] == sat)
        for signal, columns in wanted.items():
            if keep is not None and not keep(SignalId(names[sat], *signal)):
                continue
            values = {kind: parsed.value[own, at[column]] for kind, column in columns.items()}
            there = np.any([np.isfinite(values[kind]) for kind in "CLD" if kind in values] or [[False]], axis=0)
            if not there.any():
                continue
            first = at[columns.get("C", columns.get("L", next(iter(columns.values()))))]
            phase = at.get(columns.get("L", -1))
            slip, half_open = np.zeros(own.size, np.bool_), np.zeros(own.size, np.bool_)
            if phase is not None:
                slip = np.isfinite(values["L"]) & ((parsed.lli[own, phase] & 1 > 0) | failed[own])
                half_open = np.isfinite(values["L"]) & (parsed.lli[own, phase] & 2 > 0)
            strength = parsed.strength[own, first]
            if phase is not None:
                strength = np.maximum(strength, parsed.strength[own, phase])
            epochs = place[rows.epoch[its[own[there]]]]
            chosen = {kind: value[there] for kind, value in values.items()}
            blocks.append(
                (SignalId(names[sat], *signal), epochs, chosen, strength[there], slip[there], half_open[there])
            )
    return blocks


def _stated_slips(
    rows: SatelliteRows, place: Integers, instant_ns: Integers, signals: tuple[SignalId, ...]
) -> Booleans:
    """Where event records (flag 6) report a slip: at their satellites' first epoch from then on."""
    lost = np.zeros((instant_ns.size, len(signals)), np.bool_)
    for row in np.flatnonzero(rows.flag[rows.epoch] == 6):
        epoch = int(np.searchsorted(instant_ns, rows.instant_ns[rows.epoch[row]]))
        sat = f"{chr(rows.sat[row] // 100)}{rows.sat[row] % 100:02d}"
        if epoch < instant_ns.size:
            lost[epoch, [k for k, signal in enumerate(signals) if signal.sat == sat]] = True
    return lost


def _changes(marks: Booleans, there: Booleans) -> Booleans:
    """Where a mark differs from that of the same signal's last measurement before; all (n_epochs, n_signals)."""
    changed = np.zeros_like(marks)
    for column in np.flatnonzero(marks.any(axis=0)):
        epochs = np.flatnonzero(there[:, column])
        changed[epochs[1:], column] = np.diff(marks[epochs, column])
    return changed


# --- the record


def _plausible(table: _Table, header: Header, channels: Mapping[str, int]) -> tuple[_Table, Implausible]:
    """Return the table without cells that are impossible, and without signals of which nothing stays.

    Types that are misread as a whole go into `header`, for the lines that follow.
    """
    cells, implausible = leave_out_impossible(
        {name: table.numbers[kind] for name, kind in LETTERS.items()},
        signals=table.signals,
        elapsed_s=np.asarray((table.instant_ns - table.instant_ns[:1]) * 1e-9, np.float64),
        carrier_hz=_carriers_hz(table.signals, channels),
        misread=header.misread,
    )
    header.misread = implausible.misread
    if not implausible.counts:
        return table, implausible
    numbers = {kind: cells[name] for name, kind in LETTERS.items()}
    stays = np.flatnonzero(np.any([np.isfinite(numbers[kind]).any(axis=0) for kind in "CLD"], axis=0))
    return (
        replace(
            table,
            signals=tuple(table.signals[k] for k in stays),
            numbers={kind: values[:, stays] for kind, values in numbers.items()},
            strength=table.strength[:, stays],
            lost=table.lost[:, stays],
            half_open=table.half_open[:, stays],
            impossible=implausible.ranges[:, stays],
        ),
        implausible,
    )


def _carriers_hz(signals: Sequence[SignalId], channels: Mapping[str, int]) -> Reals:
    return np.array([carrier_hz_of(s.band, channels.get(s.sat)) for s in signals], np.float64)


def _observations(table: _Table, header: Header, channels: Mapping[str, int], remarks: list[str]) -> Observations:
    code_m, phase_cyc, doppler_hz, cn0_dbhz = (table.numbers[kind] for kind in _KINDS)
    there = np.isfinite(code_m) | np.isfinite(phase_cyc) | np.isfinite(doppler_hz)
    by_strength = np.where(table.strength > 0, 6.0 * table.strength + 3.0, _UNKNOWN_CN0_DBHZ)
    unknown = there & ~np.isfinite(cn0_dbhz)
    if unknown.any():
        where = "all" if unknown.sum() == there.sum() else "some"
        instead = f"the strength indicator or of {_UNKNOWN_CN0_DBHZ:g} dB-Hz"
        remarks.append(f"C/N0 is missing in {where} cells: sigmas there are those of {instead}")
    assumed_dbhz = np.where(np.isfinite(cn0_dbhz), cn0_dbhz, by_strength)
    chip_m = np.array([s.plan.chip_m for s in table.signals])
    status = np.where(there, np.where(table.lost, CellStatus.SLIP, CellStatus.OK), CellStatus.NOT_TRACKED)
    if table.impossible is not None:
        status[table.impossible] = CellStatus.IMPOSSIBLE
    elapsed_s = np.asarray((table.instant_ns - table.instant_ns[:1]) * 1e-9, np.float64)
    first = there.argmax(axis=0) if len(there) else np.zeros(len(table.signals), np.intp)
    return Observations(
        receiver=header.marker or "rx1",
        signals=table.signals,
        gpst=_gpst(table.instant_ns.astype("datetime64[ns]"), header),
        elapsed_s=elapsed_s,
        pseudorange_m=code_m,
        carrier_cyc=phase_cyc,
        doppler_hz=doppler_hz,
        cn0_dbhz=np.where(there, cn0_dbhz, np.nan),
        pseudorange_sigma_m=np.where(np.isfinite(code_m), code_sigma_m(assumed_dbhz, chip_m), np.nan),
        carrier_sigma_cyc=np.where(np.isfinite(phase_cyc), carrier_sigma_cyc(assumed_dbhz), np.nan),
        doppler_sigma_hz=np.where(np.isfinite(doppler_hz), doppler_sigma_hz(assumed_dbhz), np.nan),
        status=status.astype(np.uint8),
        half_cycle_open=table.half_open,
        found_elapsed_s=elapsed_s[first],
        missed_elapsed_s=np.where(first > 0, elapsed_s[np.maximum(first - 1, 0)], np.nan),
        carrier_hz=_carriers_hz(table.signals, channels),
    )


def _gpst(instants: Instants, header: Header) -> Instants:
    """Instants of the file's time system as GPS time (RINEX 3.05, 4.1): GLONASS's is UTC."""
    if header.time_system in ("GLO", "UTC") and instants.size:
        return np.asarray(instants + (gpst_from_utc(instants[0]) - instants[0]))
    if header.time_system in ("BDT", "BDS"):
        return np.asarray(instants + np.timedelta64(round(BDT_BEHIND_GPST_S), "s"))
    return instants
