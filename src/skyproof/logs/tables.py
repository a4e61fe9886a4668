"""Logs that describe themselves: records of layouts that the log states, gathered into a table for each message."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Integers, Octets, Reals
from skyproof.compiled import compiled

__all__ = ["LogTable", "TableStretch", "records_at", "split_stretches"]

T = TypeVar("T")
_STRETCH_BYTES: Final = 1 << 22
_LARGEST: Final = 2.0**62


@dataclass(frozen=True, eq=False)
class LogTable:
    """Records of one message in order.

    rows : (n,) structured, as they stand in the log. at : (n,) octet of the stretch at which each begins. scale : what
    fields are to be multiplied by, 1 for those that are not named.
    """

    rows: NDArray[Any]
    at: Integers
    scale: dict[str, float]

    def has(self, *names: str, length: int = 0) -> bool:
        """Tell whether the message has all of these fields, as numbers, or as arrays of so many numbers."""
        fields: Mapping[str, Any] = self.rows.dtype.fields or {}
        shape = (length,) if length else ()
        kinds = [(fields[name][0].base.kind, fields[name][0].shape) for name in names if name in fields]
        return len(kinds) == len(names) and all(kind in "biuf" and of == shape for kind, of in kinds)

    def real(self, *names: str, length: int = 0) -> Reals:
        """Return the first of these fields that the message has, as real numbers (n,) or (n, length); NaN without."""
        for name in names:
            if self.has(name, length=length):
                values: Reals = self.rows[name].astype(np.float64) * self.scale.get(name, 1.0)
                return values
        return np.full((self.rows.size, length) if length else self.rows.size, np.nan)

    def whole(self, name: str, missing: int = 0) -> Integers:
        """Return a field as whole numbers (n,); what is no number is `missing`, as a field that is not there."""
        if not self.has(name):
            return np.full(self.rows.size, missing, np.int64)
        values = self.rows[name]
        sound = np.isfinite(values) & (np.abs(values.astype(np.float64)) < _LARGEST)
        return np.where(sound, values, missing).astype(np.int64)

    def take(self, rows: NDArray[Any]) -> "LogTable":
        """Return some of the records."""
        return LogTable(self.rows[rows], self.at[rows], self.scale)


@dataclass(frozen=True, eq=False)
class TableStretch:
    """The tables of a stretch, by message and instance. damaged : records that were none. cut : it ends inside one."""

    tables: dict[tuple[str, int], LogTable]
    damaged: int
    cut: bool = False

    def first(self, *names: str) -> LogTable | None:
        """Return the table of the lowest instance of the first of these messages that is there."""
        for name in names:
            instances = sorted(instance for message, instance in self.tables if message == name)
            if instances:
                return self.tables[name, instances[0]]
        return None


def split_stretches(blocks: Iterable[bytes], read: Callable[[Octets, bool], tuple[T, int]]) -> Iterator[T]:
    """Give what `read` makes of stretches of a log; it returns how many octets it used, and the next continues there.

    read : of the octets, and whether they are the log's last ones.
    """
    rest = b""
    gathered: list[bytes] = []
    n_gathered = 0
    for block in blocks:
        gathered.append(block)
        n_gathered += len(block)
        if n_gathered >= _STRETCH_BYTES:
            octets = np.frombuffer(b"".join([rest, *gathered]), np.uint8)
            found, used = read(octets, False)
            yield found
            rest, gathered, n_gathered = octets[used:].tobytes(), [], 0
    yield read(np.frombuffer(b"".join([rest, *gathered]), np.uint8), True)[0]


def records_at(octets: Octets, begin: Integers, dtype: np.dtype[Any], size: Integers) -> NDArray[Any]:
    """Return the records (n,) that begin at these octets; what is beyond their sizes (n,) is zero."""
    gathered = np.zeros((begin.size, dtype.itemsize), np.uint8)
    _gather(octets, begin, np.minimum(size, dtype.itemsize), gathered)
    return gathered.reshape(-1).view(dtype)


@compiled
def _gather(octets: Octets, begin: Integers, size: Integers, gathered: Octets) -> None:
    for k in range(begin.size):
        for i in range(size[k]):
            gathered[k, i] = octets[begin[k] + i]
