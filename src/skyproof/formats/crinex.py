"""Compact RINEX ("Hatanaka compression"), versions 1.0 and 3.0: back to plain RINEX lines.

Y. Hatanaka, "A Compression Format and Tools for GNSS Observation Data", Bulletin of the GSI 55 (2008), and the format
notes of RNXCMP. Numbers are told as differences of whole thousandths in time, of an order that each arc states, texts
as the characters that changed. What is damaged costs the rest of its epoch, and the arcs that run through it until
they start anew: a number that cannot be continued is left blank, never guessed.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from skyproof.errors import InputError

__all__ = ["expanded", "is_compact"]


def is_compact(first_line: str) -> bool:
    """Whether a file that begins with this line is compact RINEX."""
    return first_line[60:80].rstrip() == "CRINEX VERS   / TYPE"


def expanded(lines: Sequence[str], *, source: str = "observations") -> Iterator[str]:
    """The lines of the plain RINEX file.

    Raises
    ------
    InputError : a version that is not known, or an end before the header's.
    """
    version = lines[0][:20].strip() if lines else ""
    if version not in ("1.0", "3.0"):
        raise InputError(f"{source}, line 1: compact RINEX version {version!r}, expected 1.0 or 3.0; expand it first")
    end = next((k for k, line in enumerate(lines) if line[60:].rstrip() == "END OF HEADER"), None)
    if end is None:
        raise InputError(f"{source}, line {len(lines)}: the file ends before END OF HEADER; fetch it again")
    yield from lines[2 : end + 1]
    decoder = _Version3(lines[2 : end + 1]) if version == "3.0" else _Version1(lines[2 : end + 1])
    position = end + 1
    while position < len(lines):
        position, plain = decoder.epoch(lines, position)
        yield from plain


def _patched(old: str, change: str) -> str:
    """The text with its changes: a space keeps what stands there, "&" makes it a space."""
    merged = [(o if c == " " else " " if c == "&" else c)
              for o, c in zip(old.ljust(len(change)), change, strict=False)]  # fmt: skip
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


@dataclass
class _Satellite:
    arcs: dict[int, _Arc] = field(default_factory=dict)
    marks: str = ""


class _Decoder(ABC):
    """What both versions share: satellites with their arcs. Subclasses know how an epoch line looks."""

    sats_at: int
    count_at: slice
    flag_at: int
    begins: str

    def __init__(self, header: Sequence[str]) -> None:
        self.head = ""
        self.clock: _Arc | None = None
        self.satellites: dict[str, _Satellite] = {}
        self.types: dict[str, int] = {}
        self.learn(header)

    @abstractmethod
    def learn(self, header: Sequence[str]) -> None:
        """Take what the header says of types."""

    @abstractmethod
    def plain(self, head: str, clock: int | None, sats: Sequence[str], data: Sequence[str]) -> list[str]:
        """The plain lines of an epoch: its head, the receiver's clock, its satellites and their data."""

    def epoch(self, lines: Sequence[str], position: int) -> tuple[int, list[str]]:
        """Where the next epoch begins, and the plain lines of this one (none if it is lost)."""
        line = lines[position]
        if line.startswith(self.begins):
            self.head, self.satellites, self.clock = line[1:], {}, None  # told in full: everything starts anew
        elif not self.head:
            return position + 1, []
        else:
            self.head = _patched(self.head, line[1:] if line[:1] in " >&" else line)
        head = self.begins_plain + self.head
        try:
            flag, count = int(head[self.flag_at]), int(head[self.count_at])
        except (ValueError, IndexError):
            return self.lost(position + 1)
        if 2 <= flag <= 5:
            told = list(lines[position + 1 : position + 1 + count])
            self.learn(told)
            self.head = ""
            return position + 1 + count, [head.rstrip(), *told]
        listed = head[self.sats_at :]
        sats = [listed[3 * k : 3 * k + 3] for k in range(count)]
        if position + 2 + count > len(lines) or not all(len(s) == 3 and s[1:].strip().isdigit() for s in sats):
            return self.lost(position + 1)
        clock = self.number(lines[position + 1].strip())
        kept, data = list[str](), list[str]()
        satellites: dict[str, _Satellite] = {}
        for sat, text in zip(sats, lines[position + 2 : position + 2 + count], strict=True):
            if text.startswith(self.begins) and self.begins != "&":
                return self.lost(position + 1)
            satellite = self.satellites.get(sat, _Satellite())
            n_types = self.types.get(sat[0], self.types.get("", 0))
            satellites[sat] = satellite
            kept.append(sat)
            data.append(_cells(satellite, text, n_types))
        self.satellites = satellites  # who is absent once starts anew
        return position + 2 + count, self.plain(head, clock, kept, data)

    @property
    def begins_plain(self) -> str:
        return ">" if self.begins == ">" else " "

    def lost(self, position: int) -> tuple[int, list[str]]:
        self.head, self.satellites, self.clock = "", {}, None
        return position, []

    def number(self, text: str) -> int | None:
        """The receiver's clock offset, in its own arc."""
        if not text:
            self.clock = None
            return None
        self.clock, value = _continued(self.clock, text)
        return value


def _continued(arc: _Arc | None, text: str) -> tuple[_Arc | None, int | None]:
    try:
        if "&" in text:
            order, _, number = text.partition("&")
            arc = _Arc(int(order))
            return arc, arc.take(int(number))
        return (None, None) if arc is None else (arc, arc.take(int(text)))
    except ValueError:
        return None, None


def _cells(satellite: _Satellite, text: str, n_types: int) -> str:
    """One satellite's observations in 16 columns each: value, loss of lock, strength."""
    parts = text.split(" ", n_types)
    parts += [""] * (n_types - len(parts))
    satellite.marks = _patched(satellite.marks.ljust(2 * n_types), parts[n_types] if len(parts) > n_types else "")
    cells = []
    for k in range(n_types):
        value = None
        if parts[k]:
            arc, value = _continued(satellite.arcs.get(k), parts[k])
            if arc is not None:
                satellite.arcs[k] = arc
            else:
                satellite.arcs.pop(k, None)
        else:
            satellite.arcs.pop(k, None)
        if value is None or not -(10**12) < value < 10**13:
            cells.append(" " * 16)
        else:
            whole, thousandths = divmod(abs(value), 1000)
            number = f"{'-' if value < 0 else ''}{whole if whole else '0'}.{thousandths:03d}"
            cells.append(f"{number:>14}{satellite.marks[2 * k : 2 * k + 2]}")
    return "".join(cells)


class _Version3(_Decoder):
    sats_at, count_at, flag_at, begins = 41, slice(32, 35), 31, ">"

    def learn(self, header: Sequence[str]) -> None:
        for line in header:
            if line[60:].rstrip() == "SYS / # / OBS TYPES" and line[:1].strip() and line[3:6].strip().isdigit():
                self.types[line[0]] = int(line[3:6])

    def plain(self, head: str, clock: int | None, sats: Sequence[str], data: Sequence[str]) -> list[str]:
        shown = "" if clock is None else f"      {clock / 1e12:15.12f}"
        return [head[:35] + shown, *(sat + cells.rstrip() for sat, cells in zip(sats, data, strict=True))]


class _Version1(_Decoder):
    sats_at, count_at, flag_at, begins = 32, slice(29, 32), 28, "&"

    def learn(self, header: Sequence[str]) -> None:
        for line in header:
            if line[60:].rstrip() == "# / TYPES OF OBSERV" and line[:6].strip().isdigit():
                self.types[""] = int(line[:6])

    def plain(self, head: str, clock: int | None, sats: Sequence[str], data: Sequence[str]) -> list[str]:
        shown = "" if clock is None else f"{clock / 1e9:12.9f}"
        rows = ["".join(sats[k : k + 12]) for k in range(0, max(len(sats), 1), 12)]
        lines = [(f"{head[:32]}{rows[0]:36}{shown}").rstrip(), *(" " * 32 + row for row in rows[1:])]
        for cells in data:
            lines += [cells[k : k + 80].rstrip() for k in range(0, max(len(cells), 1), 80)]
        return lines
