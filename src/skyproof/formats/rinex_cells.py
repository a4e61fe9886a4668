"""Read the body of a RINEX observation file as columns: which lines are which satellite's, and their numbers.

Lines are found and numbers parsed for the whole body at once; only the line that begins an epoch is looked at alone.
RINEX 2.11, tables A2 and 5.1; 3.05, table A3.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.errors import shorten
from skyproof.formats.bounds import Remarks
from skyproof.gnss.time import require_year
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "Cells",
    "Layout",
    "Lines",
    "Restate",
    "SatelliteRows",
    "find_heads",
    "find_rows_2",
    "find_rows_3",
    "parse_cells",
    "read_layout_change",
    "split_lines",
]

Layout = dict[str, tuple[str, ...]]
"""Observation types by system; of version 2 the same for all, under ""."""
Restate = Callable[[Sequence[str], Layout], tuple[Layout, list[str]]]
"""From header lines inside the data and the layout before them to the layout that holds from there on, and remarks.

An empty layout means that what follows cannot be read and is left out.
"""

_FIELD: Final = 16
_AT_ONCE: Final = 1 << 23  # characters of text that are parsed at once
_EVENTS: Final = {2: "antenna starts to move", 3: "new site", 4: "header lines", 5: "external event", 6: "cycle slips"}
_TIMES: Final = 3  # of events that are named
_TYPE: Final = re.compile(r"[CLPDSIX][0-9][A-Z]?", re.ASCII)
_HEADER: Final = ("RINEX VERSION / TYPE", "SYS / # / OBS TYPES", "# / TYPES OF OBSERV", "END OF HEADER")
"""Labels that a header has; lines with others alone are comments, which change nothing."""
_LABELS: Final = frozenset(
    (
        *_HEADER,
        *("PGM / RUN BY / DATE", "COMMENT", "MARKER NAME", "MARKER NUMBER", "MARKER TYPE", "OBSERVER / AGENCY"),
        *("REC # / TYPE / VERS", "ANT # / TYPE", "APPROX POSITION XYZ", "ANTENNA: DELTA H/E/N"),
        *("ANTENNA: DELTA X/Y/Z", "ANTENNA: PHASECENTER", "ANTENNA: B.SIGHT XYZ", "ANTENNA: ZERODIR AZI"),
        *("ANTENNA: ZERODIR XYZ", "CENTER OF MASS: XYZ", "SIGNAL STRENGTH UNIT", "INTERVAL", "TIME OF FIRST OBS"),
        *("TIME OF LAST OBS", "RCV CLOCK OFFS APPL", "SYS / DCBS APPLIED", "SYS / PCVS APPLIED"),
        *("SYS / SCALE FACTOR", "SYS / PHASE SHIFT", "SYS / PHASE SHIFTS", "GLONASS SLOT / FRQ #"),
        *("GLONASS COD/PHS/BIS", "LEAP SECONDS", "# OF SATELLITES", "PRN / # OF OBS", "WAVELENGTH FACT L1/2"),
        *("DOI", "LICENSE OF USE", "STATION INFORMATION"),
    )
)
"""Of header lines (RINEX 2.11, table A1; 3.05, A2; 4.02, A2)."""
_SCALE: Final = 10.0 ** np.arange(12, -1, -1)


@dataclass(frozen=True, eq=False)
class Lines:
    """Text and where its lines begin and end (without their line ends)."""

    text: NDArray[np.uint8]
    start: Integers
    end: Integers
    first_number: int  # of the first line, for messages

    def __getitem__(self, k: int) -> str:
        return self.text[self.start[k] : self.end[k]].tobytes().decode("latin-1")

    def __len__(self) -> int:
        return self.start.size

    def column(self, k: int) -> NDArray[np.uint8]:
        """Return character `k` of every line, a space beyond its end."""
        at = self.start + k
        inside = at < self.end
        return np.where(inside, self.text[np.where(inside, at, 0)], np.uint8(32)) if len(self) else self.text[:0]


@dataclass(frozen=True, eq=False)
class SatelliteRows:
    """Satellites' records in the order of the file, and the epochs they belong to.

    instant_ns : (n_epochs,) since 1970 as written, flag : (n_epochs,). sat : (n_rows,) letter times 100 plus number.
    epoch, line, layout : (n_rows,) index of the epoch, first line of the record, and number of its layout.
    """

    instant_ns: Integers
    flag: Integers
    sat: Integers
    epoch: Integers
    line: Integers
    layout: Integers
    layouts: tuple[Layout, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Cells:
    """Numbers of some records: value (NaN without one), lli and strength 0 to 9, all (n_rows, n_types).

    bad : lines with a field that is not a number.
    """

    value: Reals
    lli: NDArray[np.uint8]
    strength: NDArray[np.uint8]
    bad: Integers


def split_lines(text: NDArray[np.uint8], first_number: int = 1) -> Lines:
    """Split text into lines that end by LF or CR LF; the last may have no end."""
    pieces = [np.flatnonzero(text[k : k + _AT_ONCE] == 10) + k for k in range(0, text.size, _AT_ONCE)]
    end = np.concatenate(pieces) if pieces else np.empty(0, np.int64)
    if text.size and (end.size == 0 or end[-1] != text.size - 1):
        end = np.append(end, text.size)
    start = np.append(0, end[:-1] + 1)[: end.size]
    returned = (end > start) & (text[np.maximum(end - 1, 0)] == 13) if text.size else np.zeros(0, np.bool_)
    return Lines(text, start, end - returned, first_number)


# --- which lines are whose


@dataclass
class _Walk:
    """What has been found so far on the way through the body."""

    lines: Lines
    layouts: list[Layout]
    restate: Restate
    instant_ns: list[int] = field(default_factory=list)
    flag: list[int] = field(default_factory=list)
    layout: list[int] = field(default_factory=list)
    events: list[tuple[int, int]] = field(default_factory=list)  # flag, and the epoch that comes next
    damaged: list[int] = field(default_factory=list)
    cut: int | None = None  # the line at which the file ends within an epoch
    remarks: list[str] = field(default_factory=list)
    days: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        letter = self.lines.column(60)
        likely = np.flatnonzero(((letter >= 65) & (letter <= 90)) | (letter == ord("#")))
        found = [k for k in likely.tolist() if self.lines[k][60:80].rstrip() in _LABELS]
        self._labelled = np.array(found, np.int64)

    @property
    def is_readable(self) -> bool:
        """Return whether the current observation types are known."""
        return bool(self.layouts[-1])

    def _find_labelled(self, begin: int, end: int) -> list[int]:
        """List those of these lines that carry the label of a header line."""
        first, last = np.searchsorted(self._labelled, (begin, end))
        return self._labelled[first:last].tolist() if last > first else []

    def take_header(self, labelled: Sequence[int]) -> bool:
        """Take the lines of a header that stands in the data without an event record; False if they change nothing."""
        texts = [self.lines[k] for k in labelled]
        if not any(text[60:80].rstrip() in _HEADER for text in texts):
            return False
        layout, remarks = self.restate(texts, self.layouts[-1])
        self.layouts.append(layout)
        line = self.lines.first_number + labelled[0]
        self.remarks += [Remark.reword(remark, f"line {line}: {remark}") for remark in remarks]
        return True

    def begin(self, instant_ns: int, flag: int) -> None:
        self.instant_ns.append(instant_ns)
        self.flag.append(flag)
        self.layout.append(len(self.layouts) - 1)

    def event(self, flag: int, stated: Sequence[str]) -> None:
        self.events.append((flag, len(self.flag)))
        if not self.is_readable:
            return
        changed, remarks = read_layout_change(stated, self.layouts[-1])
        self.remarks += remarks
        if changed != self.layouts[-1]:
            self.layouts.append(changed)

    def parse_instant(self, date: str, clock: str) -> int:
        """Convert "2022 06 08" and "10 00 00.0000000" to nanoseconds since 1970; ValueError for anything else."""
        day = self.days.get(date)
        if day is None:
            year, month, number = (int(part) for part in (date[:-6], date[-5:-3], date[-2:]))
            if len(date) < 10:
                year += 1900 if year >= 80 else 2000
            require_year(year)
            day = int(np.datetime64(f"{year:04d}-{month:02d}-{number:02d}", "D").astype(np.int64)) * 86_400
            self.days[date] = day
        hour, minute, second = int(clock[:2]), int(clock[3:5]), float(clock[6:])
        if not (0 <= hour < 24 and 0 <= minute < 60 and 0.0 <= second < 61.0):
            raise ValueError(clock)
        return (day + hour * 3600 + minute * 60) * 1_000_000_000 + round(second * 1e9)

    def _report_events(self) -> list[str]:
        """Report what events state, and before which epochs."""
        stated = []
        for flag in sorted({flag for flag, _ in self.events}):
            nexts = [epoch for event_flag, epoch in self.events if event_flag == flag]
            times = [str(np.datetime64(self.instant_ns[k], "ns"))[11:19] for k in nexts if k < len(self.instant_ns)]
            more = f" and {len(times) - _TIMES} more" if len(times) > _TIMES else ""
            when = f", before {', '.join(times[:_TIMES])}{more}" if times else ""
            stated.append(f"{len(nexts)} events inside the data: {_EVENTS[flag]}{when}")
        return stated

    def rows(self, sat: Integers, epoch: Integers, line: Integers) -> SatelliteRows:
        damaged = Remarks()
        for k in sorted(set(self.damaged)):
            damaged.add(f"line {self.lines.first_number + k}: what belongs to no whole epoch is left out")
        cut: list[str] = []
        if self.cut is not None:
            number = self.lines.first_number + self.cut
            ends = f"it ends within the epoch that begins in line {number}, which is left out"
            cut.append(Remark(f"the file is cut: {ends}", RemarkKind.CUT))
        further = damaged.words("further places with damaged epochs left out")
        remarks = (*cut, *self.remarks, *self._report_events(), *further)
        layout = np.array(self.layout, np.int64)
        return SatelliteRows(
            np.array(self.instant_ns, np.int64),
            np.array(self.flag, np.int64),
            sat,
            epoch,
            line,
            layout[epoch],
            tuple(self.layouts),
            remarks,
        )


def read_layout_change(lines: Sequence[str], layout: Layout) -> tuple[Layout, list[str]]:
    """Return the layout after these header lines, which state observation types or not, and what is wrong in them.

    The names count, for data stand in their order; where another number of them is stated, that is reported.
    """
    stated: dict[str, tuple[str, list[str]]] = {}
    remarks: list[str] = []
    system: str | None = None
    for line in lines:
        label, text = line[60:80].rstrip(), line[:60]
        if label not in ("SYS / # / OBS TYPES", "# / TYPES OF OBSERV"):
            continue
        if label == "# / TYPES OF OBSERV" and text[:6].strip():
            system = ""
            stated[system] = (text[:6], [])
        elif label == "SYS / # / OBS TYPES" and text[0] != " ":
            system = text[0]
            stated[system] = (text[3:6], [])
        elif text[:6].strip():
            system = None
            remarks.append(Remark(f"{label}: a line that names no system is left out", RemarkKind.BEARS))
        if system is not None:
            stated[system][1].extend(text[6:].split())
    changed = dict(layout)
    for name, (count, found) in stated.items():
        wanted = int(count.strip()) if count.strip().isdecimal() else None
        if wanted is not None and wanted < len(found) and not all(map(_TYPE.fullmatch, found[wanted:])):
            found = found[:wanted]
        if wanted != len(found):
            of = f" of {name}" if name else ""
            wrong = f"the header states {shorten(count.strip(), 10) or 'no number of'} observation types{of}"
            remarks.append(Remark(f"{wrong} and names {len(found)}; those that it names are taken", RemarkKind.BEARS))
        changed[name] = tuple(found)
    return changed, remarks


def _parse_count(text: str) -> int:
    """Parse a number of lines or types, 0 if blank; ValueError for anything but digits."""
    if text.strip() and not text.strip().isdecimal():
        raise ValueError(text)
    return int(text.strip() or 0)


def find_rows_3(lines: Lines, layout: Layout, restate: Restate, *, to_end: bool = True) -> SatelliteRows:
    """Find the rows of versions 3 and 4: ">" begins an epoch, and a satellite's name each of its lines.

    to_end : whether the file ends with these lines.
    """
    walk = _Walk(lines, [layout], restate)
    heads = np.flatnonzero(lines.column(0) == ord(">"))
    filled = np.append(0, np.cumsum(lines.end > lines.start))
    nexts = np.append(heads, len(lines))[1:]
    owner = np.full(len(lines), -1, np.int64)
    if labelled := walk._find_labelled(0, int(heads[0]) if heads.size else len(lines)):
        walk.take_header(labelled)
    for k, following in zip(heads.tolist(), nexts.tolist(), strict=True):
        text, first, begun = lines[k], k + 1, False
        at_end = to_end and following == len(lines)
        follow = int(filled[following] - filled[k + 1])
        try:
            flag, count = int(text[31:32]), _parse_count(text[32:35])
            if at_end and follow < count:
                walk.cut = k
            if 2 <= flag <= 5:
                first = min(k + 1 + count, following)
                walk.event(flag, [lines[j] for j in range(k + 1, first)])
            elif flag > 6:
                raise ValueError(text)
            elif walk.is_readable and walk.cut != k:  # of half an epoch the other signals would seem lost
                walk.begin(walk.parse_instant(text[2:12], text[13:29]), flag)
                begun = True
        except (ValueError, KeyError):
            if at_end and not follow:
                walk.cut = k
            else:
                walk.damaged.append(k)
        labelled = walk._find_labelled(first, following)
        end = labelled[0] if labelled and walk.take_header(labelled) else following
        if begun:
            owner[k + 1 : end] = len(walk.flag) - 1
            owner[[j for j in labelled if j < end]] = -1
            present = np.count_nonzero((owner >= 0)[k + 1 : end] & (lines.end > lines.start)[k + 1 : end])
            if present != count and walk.cut != k:
                walk.damaged.append(k)
                owner[k + 1 : end] = -1  # lines are missing: perhaps also the head of an epoch, whose rows stand here
    line = np.flatnonzero(owner >= 0)
    sat = _parse_sat(lines.column(0)[line], lines.column(1)[line], lines.column(2)[line])
    known = sat > 0
    if walk.flag and not known.all():
        walk.damaged.extend(k for k in line[~known].tolist() if lines.end[k] > lines.start[k])
    return walk.rows(sat[known], owner[line[known]], line[known])


def _parse_sat(letter: NDArray[np.uint8], tens: NDArray[np.uint8], ones: NDArray[np.uint8]) -> Integers:
    """Convert a satellite's name to letter times 100 plus number; 0 where it is no name. "G 3" is G03."""
    tens = np.where(tens == 32, np.uint8(48), tens)
    number = (tens.astype(np.int64) - 48) * 10 + ones.astype(np.int64) - 48
    digits = (tens >= 48) & (tens <= 57) & (ones >= 48) & (ones <= 57)
    is_letter = np.isin(letter, np.frombuffer(b"GRECJSI", np.uint8))
    return np.where(digits & is_letter & (number > 0), letter.astype(np.int64) * 100 + number, 0)


def find_rows_2(lines: Lines, layout: Layout, system: str, restate: Restate, *, to_end: bool = True) -> SatelliteRows:
    """Find the rows of version 2: a head names the satellites, whose records are lines of five fields.

    The head has one line or more; the records are unnamed.

    to_end : whether the file ends with these lines.
    """
    walk = _Walk(lines, [layout], restate)
    heads = np.flatnonzero(_looks_like_a_head(lines))
    sat, epoch, first = list[int](), list[int](), list[int]()
    k, total = 0, len(lines)
    while k < total:
        at = int(np.searchsorted(heads, k))
        head = int(heads[at]) if at < heads.size else total
        if head > k:
            labelled = walk._find_labelled(k, head)
            end = labelled[0] if labelled and walk.take_header(labelled) else head
            if walk.is_readable and any(lines[j].strip() for j in range(k, min(end, k + 3))):
                walk.damaged.append(k)
            k = head
            continue
        following = int(heads[at + 1]) if at + 1 < heads.size else total
        text = lines[k]
        try:
            flag, count = int(text[28:29] or 0), _parse_count(text[29:32])
            if 2 <= flag <= 5:
                walk.event(flag, [lines[j] for j in range(k + 1, min(k + 1 + count, total))])
                walk.cut = k if to_end and k + 1 + count > total else walk.cut
                k += 1 + count
                continue
            date, clock = f"{text[1:3]} {text[4:6]} {text[7:9]}", f"{text[10:12]} {text[13:15]} {text[15:26]}"
            instant_ns = walk.parse_instant(date, clock)
        except ValueError:
            if to_end and k + 1 == total:
                walk.cut = k
            else:
                walk.damaged.append(k)
            k += 1
            continue
        labelled = walk._find_labelled(k + 1, following)
        following = labelled[0] if labelled else following
        if not walk.is_readable:
            k += 1
            continue
        n_heads = max(-(-count // 12), 1)
        each = max(-(-len(walk.layouts[-1].get("", ())) // 5), 1)
        data = k + n_heads
        names = "".join(lines[j].ljust(68)[32:68] for j in range(k, min(data, total)))
        codes = [_parse_code(names[3 * j : 3 * j + 3], system) for j in range(count)]
        end = data + count * each
        if end > following and not (following == total and end > total):
            walk.damaged.append(k)  # a line is missing: nothing says whose
            k = following
            continue
        if to_end and end > total:
            walk.cut = k  # of half an epoch the other signals would seem lost
            break
        walk.begin(instant_ns, flag)
        whole = min(count, max(following - data, 0) // each)
        kept = [j for j in range(whole) if codes[j]]
        sat += [codes[j] for j in kept]
        epoch += [len(walk.flag) - 1] * len(kept)
        first += [data + j * each for j in kept]
        if whole < count or len(kept) < whole:
            walk.damaged.append(k)
        k = end
    return walk.rows(np.array(sat, np.int64), np.array(epoch, np.int64), np.array(first, np.int64))


def _parse_code(name: str, system: str) -> int:
    letter, number = name[:1].strip() or system, name[1:].strip()
    return ord(letter) * 100 + int(number) if letter in "GRECJSI" and number.isdecimal() and int(number) > 0 else 0


def find_heads(lines: Lines, version: float) -> tuple[Integers, Booleans]:
    """Find the lines that begin an epoch or an event, in order.

    Returns them, and which have measurements (flag 0 or 1).
    """
    old = version < 3.0
    heads = np.flatnonzero(_looks_like_a_head(lines) if old else lines.column(0) == ord(">"))
    flag = lines.column(28 if old else 31)[heads]
    return heads, (flag == ord("0")) | (flag == ord("1")) | (flag == ord(" "))


def _looks_like_a_head(lines: Lines) -> Booleans:
    """Mark lines with the seconds' point and the flag as in no line of data, or an event without a time."""
    digit = lines.column(28)
    blank = lines.column(26) == 32
    blank &= lines.column(27) == 32
    timed = (lines.column(18) == ord(".")) & (lines.column(0) == 32) & (lines.column(3) == 32)
    timed &= (digit >= 48) & (digit <= 54)
    untimed = (digit >= 50) & (digit <= 53) & blank
    for k in (1, 2, 4, 5, 7, 8, 10, 11, 13, 14, 16, 17, 18, 20, 22, 24):
        untimed &= lines.column(k) == 32
    return np.asarray((blank & timed) | untimed)


# --- the numbers


def parse_cells(lines: Lines, first: Integers, kept: Sequence[int], *, five_a_line: bool, name_columns: int) -> Cells:
    """Parse fields number `kept` of the records with these first lines.

    Each field is a number in 14 columns (F14.3), the loss-of-lock indicator and the strength. Zero and blank are no
    measurement.
    """
    n, m = first.size, len(kept)
    value = np.full((n, m), np.nan)
    lli, strength = np.zeros((n, m), np.uint8), np.zeros((n, m), np.uint8)
    bad = np.zeros(n, np.bool_)
    which = np.array(kept, np.int64)
    line_of = which // 5 if five_a_line else np.zeros_like(which)
    column_of = name_columns + _FIELD * (which % 5 if five_a_line else which)
    step = max(_AT_ONCE // (_FIELD * max(m, 1)), 1)
    for begin in range(0, n, step):
        rows = slice(begin, min(begin + step, n))
        line = first[rows, None] + line_of
        at = lines.start[line] + column_of
        room = lines.end[line] - at
        offset = np.arange(_FIELD)
        where = at[..., None] + offset
        text = np.where(offset < room[..., None], lines.text[np.minimum(where, lines.text.size - 1)], np.uint8(32))
        value[rows], wrong = _parse_numbers(text, room)
        bad[rows] = wrong.any(axis=1)
        for marks, k in ((lli, 14), (strength, 15)):
            digit = text[..., k] - np.uint8(48)
            marks[rows] = np.where(digit < 10, digit, 0)
    return Cells(value, lli, strength, first[bad])


def _parse_numbers(text: NDArray[np.uint8], room: Integers) -> tuple[Reals, Booleans]:
    """Parse F14.3 of characters (..., 16) as float64, NaN for blank or zero.

    Returns the values, and where a field is no number, or cut.
    """
    value = np.full(text.shape[:-1], np.nan)
    wrong = np.zeros(text.shape[:-1], np.bool_)
    filled = np.flatnonzero((text[..., :14] != 32).any(axis=-1))
    if filled.size == 0:
        return value, wrong
    field_ = text.reshape(-1, _FIELD)[filled, :14]
    body = np.delete(field_, 10, axis=1)
    digit = body - np.uint8(48)
    is_digit = digit < 10
    leading = np.where(is_digit.any(axis=1), is_digit.argmax(axis=1), 13)
    minus = body == ord("-")
    spaces = (body == 32).sum(axis=1)
    plain = (field_[:, 10] == ord(".")) & is_digit[:, 10:].all(axis=1) & (is_digit.sum(axis=1) == 13 - leading)
    n_minus = minus.sum(axis=1)
    before = minus[np.arange(len(body)), np.maximum(leading - 1, 0)]
    plain &= ((n_minus == 0) & (spaces == leading)) | ((n_minus == 1) & before & (spaces == leading - 1))
    number = np.where(is_digit, digit, 0).astype(np.float64) @ _SCALE / 1000.0  # whole numbers below 2^53: exact
    number = np.where(n_minus == 1, -number, number)
    odd = np.flatnonzero(~plain)
    number[odd] = [_parse_number(field_[k].tobytes()) for k in odd]
    number[room.reshape(-1)[filled] < 14] = np.nan  # cut before its last digit
    wrong.reshape(-1)[filled] = np.isnan(number)
    value.reshape(-1)[filled] = np.where(number == 0.0, np.nan, number)
    return value, wrong


def _parse_number(text: bytes) -> float:
    """Parse a number that is not written as F14.3; NaN if it is none."""
    plain = text.strip()
    if not plain or plain.strip(b"+-.0123456789"):
        return float("nan")
    try:
        return float(plain)
    except ValueError:
        return float("nan")
