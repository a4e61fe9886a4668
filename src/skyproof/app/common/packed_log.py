"""What the windows of a run leave, in little memory however many: packed, on a disk where it is much."""

import pickle
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Generic, TypeVar, overload

from skyproof.formats.atomic_write import describe_output_error

__all__ = ["PACKED", "PackedLog"]

T = TypeVar("T")

PACKED: Final = 512
"""Pieces in a stretch. A window has some ten of evidence, of 100 bytes each once packed: most of its words, signals and
times are those of the window before."""
HELD_BYTES: Final = 1 << 20
"""Of packs in memory; more go to a temporary file."""


class PackedLog(Sequence[T], Generic[T]):
    """Pieces (evidence, consistent sets) in the order of their windows.

    Each read returns new copies: equal, not the same objects.
    """

    def __init__(self, pieces: Iterable[T] = ()) -> None:
        self._file = tempfile.SpooledTemporaryFile(HELD_BYTES)  # noqa: SIM115 (as long as the log)
        self._ends = [0]  # of the packs in the file
        self._last: list[T] = []
        self._read: tuple[int, list[T]] = (-1, [])
        self.extend(pieces)

    def extend(self, pieces: Iterable[T]) -> None:
        """Add pieces at the end. Raises OutputError if the temporary file cannot be written."""
        for piece in pieces:
            self._last.append(piece)
            if len(self._last) == PACKED:
                self._pack()

    def _pack(self) -> None:
        packed = zlib.compress(pickle.dumps(self._last, pickle.HIGHEST_PROTOCOL))
        try:
            self._file.seek(self._ends[-1])
            self._file.write(packed)
        except OSError as error:
            raise describe_output_error(tempfile.gettempdir(), error) from error
        self._ends.append(self._ends[-1] + len(packed))
        self._last = []

    def __len__(self) -> int:
        return PACKED * self._packs + len(self._last)

    def __iter__(self) -> Iterator[T]:
        for number in range(self._packs):
            yield from self._unpack(number)
        yield from self._last

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> list[T]: ...
    def __getitem__(self, index: int | slice) -> T | list[T]:
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"piece {index} of {len(self)}")
        number, place = divmod(index % len(self), PACKED)
        return self._unpack(number)[place] if number < self._packs else self._last[place]

    @property
    def _packs(self) -> int:
        return len(self._ends) - 1

    def _unpack(self, number: int) -> list[T]:
        """Unpack a stretch of pieces; the one read last is kept."""
        if self._read[0] != number:
            self._file.seek(self._ends[number])
            packed = self._file.read(self._ends[number + 1] - self._ends[number])
            self._read = number, pickle.loads(zlib.decompress(packed))
        return self._read[1]
