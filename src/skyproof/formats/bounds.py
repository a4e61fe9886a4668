"""Bounds on how much is read of a file, so that a broken or hostile one does not take all memory, or hours.

Input beyond a bound is refused by an InputError that names it, or costs the line or record it stands in, and is
reported. Years are bounded where instants are made, in `skyproof.gnss.time`; the length of a message in
`skyproof.errors`.
"""

import itertools
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, TypeVar

from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "CAPTURES",
    "CHARACTERS_OF_LINE",
    "DEPTH",
    "EMPTY_CELLS",
    "EPOCH_BYTES",
    "LINES_WITHOUT_EPOCH",
    "METADATA_BYTES",
    "NAVIGATION_BYTES",
    "OBSERVATION_BYTES",
    "REMARKS",
    "SECONDS",
    "SERIES_BYTES",
    "SERIES_ROWS",
    "SETTINGS_BYTES",
    "STREAM_BYTES",
    "TRACK_BYTES",
    "XML_TAGS",
    "Remarks",
    "describe_first",
    "limit_remarks",
    "list_names",
    "require_toml_depth",
]

SETTINGS_BYTES: Final = 1 << 20
"""Of a platform file, a sidecar, a scenario: TOML."""
METADATA_BYTES: Final = 1 << 24
"""Of JSON: the metadata of SigMF, a verdict."""
TRACK_BYTES: Final = 1 << 26
NAVIGATION_BYTES: Final = 1 << 26
"""Unpacked. All satellites of all systems give 10 MB in a day."""
OBSERVATION_BYTES: Final = 1 << 28
"""Unpacked and expanded, at once or without an epoch. A day at one epoch a second of 20 satellites fits."""
EPOCH_BYTES: Final = 1 << 22
"""Of an observation file's header, and of an epoch, whose 999 satellites of 100 types each take 1.6 MB."""
STREAM_BYTES: Final = 1 << 32
"""Unpacked, of an observation file that is read in pieces. A day at five epochs a second of 50 satellites fits."""
LINES_WITHOUT_EPOCH: Final = 1 << 17
"""In a row, of a compact observation file."""
SERIES_BYTES: Final = 1 << 30
"""Of readings over time: ten hours at 200 a second fit, as CSV."""
SERIES_ROWS: Final = 1 << 24
DEPTH: Final = 32
"""Of tables in tables, and of the parts of a dotted key."""
CHARACTERS_OF_LINE: Final = 1000
"""Of a header line of RINEX and of a sentence of NMEA, which have 80."""
CAPTURES: Final = 100_000
"""Of a SigMF recording."""
XML_TAGS: Final = 1 << 21
"""Opening and closing ones."""
EMPTY_CELLS: Final = 1 << 22
"""Of observations, beyond those that the file fills."""
SECONDS: Final = 1e9
"""Of a time that counts from some beginning: 31 years."""
REMARKS: Final = 10
"""Faults or remarks of one kind that are named; the others are counted."""

_Fault = TypeVar("_Fault")
_NO_STRUCTURE: Final = re.compile(
    r"'''.*?'''|\"\"\"(?:\\.|[^\\])*?\"\"\"|'[^'\n]*'|\"(?:\\.|[^\"\\\n])*\"|#[^\n]*", re.DOTALL
)
_BRACKETS: Final = re.compile(r"[^][{}]+")
_KEYS: Final = re.compile(r"[\w\-. \t]+")


def require_toml_depth(text: str) -> None:
    """Raise ValueError if tables stand deeper in each other, or a key has more parts, than `DEPTH`.

    It is looked at before the text is parsed: the parser of the standard library calls itself for each bracket, and
    takes time and memory by the square of the parts of a key.
    """
    structure = _NO_STRUCTURE.sub("_", text)
    steps = (1 if bracket in "[{" else -1 for bracket in _BRACKETS.sub("", structure))
    deepest = max(itertools.accumulate(steps), default=0)
    parts = max((keys.count(".") for keys in _KEYS.findall(structure)), default=0) + 1
    if max(deepest, parts) > DEPTH:
        raise ValueError(f"tables or keys of {max(deepest, parts)} levels, expected at most {DEPTH}")


@dataclass
class Remarks:
    """The first few remarks of one kind, and how many came after them.

    kind : of all of them: what damage costs an input bears on the answer.
    """

    kind: RemarkKind = RemarkKind.BEARS
    named: list[str] = field(default_factory=list)
    others: int = 0

    def add(self, text: str) -> None:
        """Add a remark."""
        if len(self.named) < REMARKS:
            self.named.append(Remark(text, self.kind))
        else:
            self.others += 1

    def words(self, others: str) -> list[str]:
        """Return the remarks, and "3 ..." of the others."""
        return [*self.named, *([Remark(f"{self.others} {others}", self.kind)] if self.others else [])]


def limit_remarks(remarks: Iterable[str], others: str) -> tuple[str, ...]:
    """Return each remark once, the gravest kinds first.

    Beyond `REMARKS` of one kind, a last one counts the rest, as "3 ..." with the words of `others`.
    """
    by_kind: dict[RemarkKind, list[str]] = {kind: [] for kind in sorted(RemarkKind, reverse=True)}
    for remark in dict.fromkeys(remarks):
        by_kind[Remark.kind_of(remark)].append(remark)
    kept: list[str] = []
    for of_kind in by_kind.values():
        kept += of_kind[:REMARKS]
        if len(of_kind) > REMARKS:
            kept.append(Remark.reword(of_kind[REMARKS], f"{len(of_kind) - REMARKS} {others}"))
    return tuple(kept)


def list_names(names: Sequence[str]) -> str:
    """Return names with commas; the first few, "and 3 more", where there are more than `REMARKS`."""
    more = f" and {len(names) - REMARKS} more" if len(names) > REMARKS else ""
    return ", ".join(names[:REMARKS]) + more


def describe_first(faults: Sequence[_Fault], words: Callable[[_Fault], str]) -> list[str]:
    """Describe the first faults, and count the others."""
    more = [f"and {len(faults) - REMARKS} more"] if len(faults) > REMARKS else []
    return [*map(words, faults[:REMARKS]), *more]
