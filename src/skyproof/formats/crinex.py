"""Expand Compact RINEX ("Hatanaka compression"), versions 1.0 and 3.0, to plain RINEX.

Y. Hatanaka, "A Compression Format and Tools for GNSS Observation Data", Bulletin of the GSI 55 (2008), and the format
notes of RNXCMP. Numbers are differences of whole thousandths in time, of an order that each arc states; texts are the
characters that changed. A damaged number costs its arc until a new one starts. Where lines do not follow each other as
they must, all is lost until the next epoch that is written in full. Data that cannot be continued are left out, never
guessed.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from skyproof.errors import InputError
from skyproof.formats.bounds import EPOCH_BYTES, LINES_WITHOUT_EPOCH, OBSERVATION_BYTES, Remarks
from skyproof.formats.byte_io import require_size
from skyproof.remarks import Remark, RemarkKind

__all__ = ["Expander", "expand", "is_compact"]

_MOST_TYPES: Final = 100
_MOST_LINES: Final = 1002  # of an epoch: its head, its clock, and what three digits count
_NUMBER: Final = re.compile(r"(?:([0-9])&)?(-?[0-9]{1,16})", re.ASCII)
_SAT: Final = re.compile(r"[GRECJSI ][ 0-9][0-9]", re.ASCII)


def is_compact(content: bytes) -> bool:
    """Test whether a file that begins with this content is compact RINEX."""
    return _is_first_line(content[:100].split(b"\n", 1)[0].decode("latin-1"))


def _is_first_line(line: str) -> bool:
    """Test whether a line is the first of a compact file."""
    return line[60:80].rstrip() == "CRINEX VERS   / TYPE"


def expand(content: bytes, *, source: str = "observations") -> tuple[bytes, tuple[str, ...]]:
    """Expand a file to plain RINEX, and report what was damaged.

    Raises
    ------
    InputError : a version that is not known, an end before the header's, or more than is read.
    """
    expander, plain, size = Expander(source=source), list[bytes](), 0
    for part in (expander.take(content), expander.rest()):
        plain.append(part)
        size += len(part)
        require_size(size, OBSERVATION_BYTES, f"{source}: the expanded file", "cut it into shorter ones")
    return b"".join(plain), expander.remarks


class Expander:
    """Compact RINEX to plain RINEX as it comes: bytes of any length in, whole plain lines out.

    What is kept is one epoch's numbers and the lines that are not decided yet, at most those of the longest event.
    """

    def __init__(self, *, source: str = "observations") -> None:
        self._source = source
        self._decoder: _Decoder | None = None
        self._waiting = b""  # the beginning of a line
        self._lines: list[str] = []
        self._done = 0  # lines of the file before the first of these
        self._idle = 0  # lines since the last epoch
        self._remarks = Remarks()
        self._cut: tuple[str, ...] = ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """Report the damage so far, and how the file ends once `rest` was taken."""
        words = "further places where the compact RINEX is damaged"
        return (*self._cut, *self._remarks.words(words))

    def take(self, content: bytes) -> bytes:
        """Return the plain lines that these bytes complete. Raises InputError as `expand` does."""
        *whole, self._waiting = (self._waiting + content).split(b"\n")
        require_size(len(self._waiting), EPOCH_BYTES, f"{self._source}: a line", "fetch the file again")
        self._lines += [line.decode("latin-1").rstrip("\r") for line in whole]
        return self._expand(ahead=_MOST_LINES)

    def rest(self) -> bytes:
        """Return the plain lines of the remaining bytes at the end. Raises InputError as `expand` does.

        A last line without an end is left out: where it is cut, its last number is another one.
        """
        unended, self._waiting = bool(self._waiting), b""
        plain = self._expand(ahead=0)
        if self._decoder is None and not self._done:
            raise InputError(
                f"{self._source}, line {len(self._lines)}: the file ends before END OF HEADER; fetch it again"
            )
        if self._decoder is None:
            self._cut = (_cut(f"within the header that begins in line {self._done + 1}"),)
        elif unended:
            self._cut = (_cut(f"within line {self._done + len(self._lines) + 1}"),)
        elif self._decoder.unfinished is not None:
            self._cut = (_cut(f"within the epoch that begins in line {self._decoder.unfinished}"),)
        return plain

    def _expand(self, *, ahead: int) -> bytes:
        """Expand all epochs that lie whole within the lines so far: `ahead` lines are enough for any."""
        plain: list[str] = []
        if self._decoder is None:
            plain = self._read_header()
        position = 0
        while self._decoder is not None and position < len(self._lines) - ahead:
            if _is_first_line(self._lines[position]):  # files that were put together
                self._forget(position)
                self._decoder, position = None, 0
                plain += self._read_header()
                continue
            before = position
            position, epoch = self._decoder.epoch(self._lines, position, self._done)
            self._idle = 0 if epoch else self._idle + position - before
            plain += epoch
        self._forget(position)
        if self._idle + len(self._lines) > LINES_WITHOUT_EPOCH:
            raise InputError(
                f"{self._source}, line {self._done}: no epoch in {LINES_WITHOUT_EPOCH} lines of the compact RINEX; "
                "fetch the file again"
            )
        return "".join(f"{line}\n" for line in plain).encode("latin-1")

    def _forget(self, count: int) -> None:
        """Drop the first lines, which are done."""
        del self._lines[:count]
        self._done += count

    def _read_header(self) -> list[str]:
        """Read the header's lines once they are complete."""
        version = self._lines[0][:20].strip() if self._lines else ""
        if self._lines and version not in ("1.0", "3.0"):
            raise InputError(
                f"{self._source}, line 1: compact RINEX version {version!r}, expected 1.0 or 3.0; expand it first"
            )
        end = next((k for k, line in enumerate(self._lines) if line[60:].rstrip() == "END OF HEADER"), None)
        if end is None:
            return []
        plain = self._lines[2 : end + 1]
        self._decoder = (_Version3 if version == "3.0" else _Version1)(plain, self._remarks)
        self._forget(end + 1)
        return plain


def _cut(where: str) -> Remark:
    return Remark(f"the compact RINEX is cut: it ends {where}", RemarkKind.CUT)


def _patch(old: str, change: str) -> str:
    """Apply changes to a text: a space keeps the character, "&" makes it a space."""
    merged = [(o if c == " " else " " if c == "&" else c) for o, c in zip(old.ljust(len(change)), change, strict=False)]
    return "".join(merged) + old[len(change) :]


@dataclass
class _Arc:
    """The value and its differences so far, each of the order that stands at its place."""

    order: int
    values: list[int] = field(default_factory=list)

    def take(self, number: int) -> int:
        if len(self.values) <= self.order:
            self.values.append(0)
            filled = len(self.values) - 1
        else:
            filled = self.order
        # `number` is the highest difference; each lower one is its last value plus the one above.
        self.values[filled] = number
        for k in range(filled - 1, -1, -1):
            self.values[k] += self.values[k + 1]
        return self.values[0]


_BROKEN: Final = _Arc(-1)
"""An arc whose numbers cannot be continued."""


@dataclass
class _Satellite:
    arcs: dict[int, _Arc] = field(default_factory=dict)
    marks: str = ""


class _Lost(Exception):
    """The lines do not follow each other as they must."""


class _Unfinished(_Lost):
    """The lines end before the epoch does."""


class _Decoder(ABC):
    """What both versions share: satellites with their arcs. Subclasses know how an epoch line looks."""

    sats_at: int
    count_at: slice
    flag_at: int
    begins: str

    def __init__(self, header: Sequence[str], remarks: Remarks) -> None:
        self.head = ""
        self.clock: dict[int, _Arc] = {}
        self.satellites: dict[str, _Satellite] = {}
        self.types: dict[str, int] = {}
        self.remarks = remarks
        self.unfinished: int | None = None  # the line in which the last epoch begins, if the lines end within it
        self.learn(header)

    @abstractmethod
    def learn(self, header: Sequence[str]) -> None:
        """Take what the header says of types."""

    @abstractmethod
    def plain(self, head: str, clock: int | None, sats: Sequence[str], data: Sequence[str]) -> list[str]:
        """Write the plain lines of an epoch: its head, the receiver's clock, its satellites and their data."""

    def epoch(self, lines: Sequence[str], position: int, before: int) -> tuple[int, list[str]]:
        """Decode one epoch: return where the next begins, and its plain lines (none if it is lost).

        `before` lines of the file lie before these.
        """
        if not self.head and not lines[position].startswith(self.begins):
            return position + 1, []  # after damage: until an epoch that is written in full
        number = before + position + 1
        try:
            end, plain = self.whole_epoch(lines, position)
            self._tell_unfinished()
            return end, plain
        except _Unfinished:
            self._tell_unfinished()
            self.unfinished = number
        except _Lost as lost:
            self._tell_lost(number, str(lost))
        self.head, self.satellites, self.clock = "", {}, {}
        return position + 1, []

    def _tell_unfinished(self) -> None:
        """Report that an apparent end of the file was damage."""
        if self.unfinished is not None:
            self._tell_lost(self.unfinished, "an epoch of more lines than follow")
            self.unfinished = None

    def _tell_lost(self, number: int, why: str) -> None:
        self.remarks.add(f"line {number} of the compact RINEX: {why}; left out until the next complete epoch")

    def whole_epoch(self, lines: Sequence[str], position: int) -> tuple[int, list[str]]:
        line = lines[position]
        if line.startswith(self.begins):
            self.head, self.satellites, self.clock = line[1:], {}, {}  # written in full: everything starts anew
        else:
            self.head = _patch(self.head, line[1:])
        head = self.begins_plain + self.head
        try:
            flag, count = int(head[self.flag_at]), int(head[self.count_at])
        except (ValueError, IndexError):
            raise _Lost("no head of an epoch") from None
        end = position + (1 if 2 <= flag <= 5 else 2) + count
        if count < 0:
            raise _Lost(f"an epoch of {count} lines")
        if end > len(lines):
            raise _Unfinished
        if 2 <= flag <= 5:
            stated = list(lines[position + 1 : end])
            self.learn(stated)
            self.head = ""
            return end, [head.rstrip(), *stated]
        listed = head[self.sats_at :].rstrip()
        sats = [listed[3 * k : 3 * k + 3] for k in range(count)]
        texts = lines[position + 2 : end]
        if len(listed) != 3 * count or not all(map(_SAT.fullmatch, sats)) or len(set(sats)) < count:
            raise _Lost("satellites that cannot be read as names")
        follows = lines[end][:1] if end < len(lines) and not _is_first_line(lines[end]) else ""
        if follows not in ("", " ", self.begins) or any(text.startswith(self.begins) for text in texts):
            raise _Lost("a line too many or too few")
        clock = _read_value(self.clock, 0, lines[position + 1].strip())
        # who is absent once starts anew
        self.satellites = {sat: self.satellites.get(sat, _Satellite()) for sat in sats}
        data = [
            _write_cells(self.satellites[sat], text, self.types.get(sat[0], self.types.get("", 0)))
            for sat, text in zip(sats, texts, strict=True)
        ]
        return end, self.plain(head, clock, sats, data)

    @property
    def begins_plain(self) -> str:
        return ">" if self.begins == ">" else " "


def _read_value(arcs: dict[int, _Arc], key: int, text: str) -> int | None:
    """Return the next value of an arc, None if absent or unknowable. Raises _Lost if the arc never began."""
    if not text:
        arcs.pop(key, None)
        return None
    match = _NUMBER.fullmatch(text)
    if match is None:
        arcs[key] = _BROKEN
        return None
    if match[1]:
        arcs[key] = _Arc(int(match[1]))
    elif key not in arcs:
        raise _Lost("a difference with no value before it to count from")
    if arcs[key] is _BROKEN:
        return None
    value = arcs[key].take(int(match[2]))
    if not -(10**12) < value < 10**13:
        arcs[key] = _BROKEN
        return None
    return value


def _write_cells(satellite: _Satellite, text: str, n_types: int) -> str:
    """Write one satellite's observations in 16 columns each: value, loss of lock, strength."""
    parts = text.split(" ", n_types)
    parts += [""] * (n_types - len(parts))
    satellite.marks = _patch(satellite.marks.ljust(2 * n_types), parts[n_types] if len(parts) > n_types else "")
    cells = []
    for k in range(n_types):
        value = _read_value(satellite.arcs, k, parts[k])
        if value is None:
            cells.append(" " * 16)
        else:
            whole, thousandths = divmod(abs(value), 1000)
            number = f"{'-' if value < 0 else ''}{whole if whole else '0'}.{thousandths:03d}"
            cells.append(f"{number:>14}{satellite.marks[2 * k : 2 * k + 2]}")
    return "".join(cells)


def _count_of_types(text: str) -> int:
    count = int(text.strip()) if text.strip().isdecimal() else 0
    return count if count <= _MOST_TYPES else 0


class _Version3(_Decoder):
    sats_at, count_at, flag_at, begins = 41, slice(32, 35), 31, ">"

    def learn(self, header: Sequence[str]) -> None:
        for line in header:
            if line[60:].rstrip() == "SYS / # / OBS TYPES" and line[:1].strip():
                self.types[line[0]] = _count_of_types(line[3:6])

    def plain(self, head: str, clock: int | None, sats: Sequence[str], data: Sequence[str]) -> list[str]:
        clock_text = "" if clock is None else f"      {clock / 1e12:15.12f}"
        return [head[:35] + clock_text, *(sat + cells.rstrip() for sat, cells in zip(sats, data, strict=True))]


class _Version1(_Decoder):
    sats_at, count_at, flag_at, begins = 32, slice(29, 32), 28, "&"

    def learn(self, header: Sequence[str]) -> None:
        for line in header:
            if line[60:].rstrip() == "# / TYPES OF OBSERV" and line[:6].strip():
                self.types[""] = _count_of_types(line[:6])

    def plain(self, head: str, clock: int | None, sats: Sequence[str], data: Sequence[str]) -> list[str]:
        clock_text = "" if clock is None else f"{clock / 1e9:12.9f}"
        rows = ["".join(sats[k : k + 12]) for k in range(0, max(len(sats), 1), 12)]
        lines = [(f"{head[:32]}{rows[0]:36}{clock_text}").rstrip(), *(" " * 32 + row for row in rows[1:])]
        for cells in data:
            lines += [cells[k : k + 80].rstrip() for k in range(0, max(len(cells), 1), 80)]
        return lines
