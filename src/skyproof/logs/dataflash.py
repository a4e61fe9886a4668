"""DataFlash, the format in which ArduPilot logs (.bin): messages whose layouts the log states.

ArduPilot, libraries/AP_Logger/LogStructure.h: log_Format, and the characters of its formats.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Integers, Octets
from skyproof.compiled import compiled
from skyproof.logs.tables import LogTable, TableStretch, records_at

__all__ = ["MAGIC", "DataFlashTables"]

MAGIC: Final = b"\xa3\x95\x80"  # a record of the message that states layouts
_FORMAT, _FORMAT_BYTES = 0x80, 89
_TYPES: Final = {
    "a": ("<i2", 32, 1.0), "b": ("i1", 0, 1.0), "B": ("u1", 0, 1.0), "h": ("<i2", 0, 1.0), "H": ("<u2", 0, 1.0),
    "i": ("<i4", 0, 1.0), "I": ("<u4", 0, 1.0), "f": ("<f4", 0, 1.0), "d": ("<f8", 0, 1.0), "n": ("S4", 0, 1.0),
    "N": ("S16", 0, 1.0), "Z": ("S64", 0, 1.0), "c": ("<i2", 0, 0.01), "C": ("<u2", 0, 0.01), "e": ("<i4", 0, 0.01),
    "E": ("<u4", 0, 0.01), "L": ("<i4", 0, 1e-7), "M": ("u1", 0, 1.0), "q": ("<i8", 0, 1.0), "Q": ("<u8", 0, 1.0),
    "g": ("<f2", 0, 1.0),
}  # fmt: skip
"""NumPy's kind, the length of an array, and the scale of each character of a format."""


class DataFlashTables:
    """Reads stretches of a log into tables of the messages that are wanted, and remembers their layouts.

    Messages of several sensors have the number of each in a field "I" or "Instance"; they are parted by it.
    """

    def __init__(self, wanted: frozenset[str]) -> None:
        """Begin a log; `wanted` are names of messages."""
        self._wanted = wanted
        self._lengths = np.zeros(256, np.int64)
        self._lengths[_FORMAT] = _FORMAT_BYTES
        self._layouts: dict[int, tuple[str, np.dtype[Any], dict[str, float]]] = {}

    def read(self, octets: Octets, last: bool) -> tuple[TableStretch, int]:
        """Return the tables of a stretch, and how many octets are done with."""
        found = np.empty((2, octets.size // 3 + 1), np.int64)
        count, used, damaged, cut = _scan(octets, last, self._lengths, found)
        kind, begin = found[:, :count].copy()
        for at in begin[kind == _FORMAT].tolist():
            self._note(octets[at + 3 : at + _FORMAT_BYTES].tobytes())
        tables: dict[tuple[str, int], LogTable] = {}
        for value in np.flatnonzero(np.bincount(kind, minlength=1)).tolist():
            name, dtype, scale = self._layouts.get(value, ("", np.dtype([]), {}))
            if name not in self._wanted:
                continue
            at = begin[kind == value]
            rows = records_at(octets, at + 3, dtype, np.full(at.size, dtype.itemsize))
            whole = LogTable(rows, at, scale)
            instance = whole.whole("I" if whole.has("I") else "Instance")
            for number in np.unique(instance).tolist():
                tables[name, number] = whole.take(instance == number)
        return TableStretch(tables, damaged, cut), used

    def _note(self, body: bytes) -> None:
        """Remember the layout that a record states, where it makes sense."""
        kind, length = body[0], body[1]
        name, characters, labels = (
            part.split(b"\0")[0].decode("ascii", "replace") for part in (body[2:6], body[6:22], body[22:86])
        )
        names = labels.split(",")
        known = [_TYPES[c] for c in characters if c in _TYPES]
        if kind == _FORMAT or len(known) != len(characters) or not len(known) == len(names) == len(set(names)):
            return
        if not all(names):
            return
        dtype = np.dtype(
            [(label, kind, (size,) if size else ()) for label, (kind, size, _) in zip(names, known, strict=True)]
        )
        if dtype.itemsize == length - 3:
            scale = {label: scale for label, (_, _, scale) in zip(names, known, strict=True) if scale != 1.0}
            self._layouts[kind] = (name, dtype, scale)


@compiled
def _scan(octets: Octets, last: bool, lengths: Integers, found: NDArray[np.int64]) -> tuple[int, int, int, bool]:
    """Fill `found` with the number of each message and its first octet; note the lengths that the log states.

    Returns how many there are, how many octets are done with, how many times the messages broke off, and whether the
    last one is cut.
    """
    count, damaged, cut, sound, k = 0, 0, False, True, 0
    while k + 3 <= octets.size:
        kind = octets[k + 2]
        good = octets[k] == 0xA3 and octets[k + 1] == 0x95 and lengths[kind] >= 3
        if good and k + lengths[kind] > octets.size:
            if not last:
                break
            cut, good = True, False
        if good:
            found[0, count], found[1, count] = kind, k
            count += 1
            if kind == 0x80:
                lengths[octets[k + 3]] = octets[k + 4] if octets[k + 3] != 0x80 else 89
            k += lengths[kind]
            sound, cut = True, False
        else:
            damaged += sound
            sound = False
            k += 1
    if last and k < octets.size and sound:
        cut = True
    return count, k, damaged - (cut and damaged > 0 and not sound), cut
