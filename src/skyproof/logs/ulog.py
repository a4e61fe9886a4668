"""ULog, the format in which PX4 logs: messages whose layouts the log states.

PX4 user guide, "ULog File Format", version 1.
"""

import re
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Octets
from skyproof.compiled import compiled
from skyproof.logs.tables import LogTable, TableStretch, records_at

__all__ = ["MAGIC", "UlogTables"]

MAGIC: Final = b"ULog\x01\x12\x35"
_HEADER: Final = 16
_KINDS: Final = b"BFIMPQARDLCSO"
_FIELD: Final = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)(?:\[(\d{1,5})\])?\s+([A-Za-z_][A-Za-z0-9_]*)")
_TYPES: Final = {
    "int8_t": "i1", "uint8_t": "u1", "bool": "u1", "char": "S1", "int16_t": "<i2", "uint16_t": "<u2",
    "int32_t": "<i4", "uint32_t": "<u4", "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8",
}  # fmt: skip
_MOST_MESSAGES: Final = 4096  # that a log may state; PX4 has some 200
_DEEPEST: Final = 4  # layouts within layouts


class UlogTables:
    """Reads stretches of a log into tables of the messages that are wanted, and remembers their layouts."""

    def __init__(self, wanted: frozenset[str]) -> None:
        """Begin a log; `wanted` are names of messages."""
        self._wanted = wanted
        self._begun = False
        self._layouts: dict[str, str] = {}
        self._subscribed: dict[int, tuple[str, int]] = {}

    def read(self, octets: Octets, last: bool) -> tuple[TableStretch, int]:
        """Return the tables of a stretch, and how many octets are done with."""
        first = 0 if self._begun else min(_HEADER, octets.size)
        self._begun = True
        found = np.empty((3, octets.size // 3 + 1), np.int64)
        count, used, damaged, cut = _scan(octets, first, last, np.frombuffer(_KINDS, np.uint8), found)
        kind, begin, size = found[:, :count].copy()
        for k in np.flatnonzero((kind == ord("F")) | (kind == ord("A"))).tolist():
            body = octets[begin[k] : begin[k] + size[k]].tobytes()
            if kind[k] == ord("F"):
                name, _, layout = body.decode("ascii", "replace").partition(":")
                if len(self._layouts) < _MOST_MESSAGES:
                    self._layouts[name] = layout
            elif size[k] > 3 and len(self._subscribed) < _MOST_MESSAGES:
                name = body[3:].decode("ascii", "replace")
                self._subscribed[int.from_bytes(body[1:3], "little")] = (name, body[0])
        data = (kind == ord("D")) & (size >= 2)
        begin, size = begin[data], size[data]
        number = octets[begin].astype(np.int64) | octets[begin + 1].astype(np.int64) << 8
        tables = {}
        for value in np.flatnonzero(np.bincount(number, minlength=1)).tolist():
            message = self._subscribed.get(value)
            if message is None or message[0] not in self._wanted:
                continue
            dtype = self._dtype(message[0])
            if dtype is not None:
                rows = number == value
                tables[message] = LogTable(records_at(octets, begin[rows] + 2, dtype, size[rows] - 2), begin[rows], {})
        return TableStretch(tables, damaged, cut), used

    def _dtype(self, name: str, depth: int = 0) -> np.dtype[Any] | None:
        """Return the layout of a message; None where it is not stated, or makes no sense."""
        fields: list[tuple[str, Any, tuple[int, ...]]] = []
        for text in self._layouts.get(name, "").split(";"):
            match = _FIELD.fullmatch(text.strip())
            if match is None:
                if text.strip():
                    return None
                continue
            kind, length, field = match.groups()
            plain: Any = _TYPES.get(kind)
            if plain is None and depth < _DEEPEST:
                plain = self._dtype(kind, depth + 1)
            if plain is None or any(field == other for other, _, _ in fields):
                return None
            fields.append((field, plain, (int(length),) if length else ()))
        return np.dtype(fields) if fields and np.dtype(fields).itemsize < 1 << 16 else None


@compiled
def _scan(
    octets: Octets, first: int, last: bool, kinds: Octets, found: NDArray[np.int64]
) -> tuple[int, int, int, bool]:
    """Fill `found` with kind, first octet and size of each message's body.

    Returns how many there are, how many octets are done with, how many times the messages broke off, and whether the
    last one is cut. After damage the search continues where one message and the head of the next make sense.
    """
    allowed = np.zeros(256, np.bool_)
    for kind in kinds:
        allowed[kind] = True
    count, damaged, cut, sound, k = 0, 0, False, True, first
    while k + 3 <= octets.size:
        size, kind = octets[k] + 256 * octets[k + 1], octets[k + 2]
        end = k + 3 + size
        good = allowed[kind] and size > 0
        if good and end > octets.size:
            if not last:
                break
            cut, good = True, False
        if good and not sound:
            good = end + 3 <= octets.size and allowed[octets[end + 2]]
        if good:
            found[0, count], found[1, count], found[2, count] = kind, k + 3, size
            count += 1
            k, sound, cut = end, True, False
        else:
            damaged += sound
            sound = False
            k += 1
    if last and k < octets.size and sound:
        cut = True
    return count, k, damaged - (cut and damaged > 0 and not sound), cut
