"""The evidence of a run of any length in little memory: packed, and unpacked a stretch at a time as it is read."""

import pickle
import zlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, overload

from skyproof.records import Evidence

__all__ = ["EvidenceLog"]

PACKED: Final = 512
"""Pieces of evidence in a stretch. A window has some ten, of 100 bytes each once packed: most of its words, signals and
times are those of the window before."""


class EvidenceLog(Sequence[Evidence]):
    """Pieces of evidence in the order of their windows. Each read gives them anew: equal, not the same objects."""

    def __init__(self, evidence: Iterable[Evidence] = ()) -> None:
        self._packs: list[bytes] = []
        self._last: list[Evidence] = []
        self._read: tuple[int, list[Evidence]] = (-1, [])
        self.extend(evidence)

    def extend(self, evidence: Iterable[Evidence]) -> None:
        """Add pieces at the end."""
        for one in evidence:
            self._last.append(one)
            if len(self._last) == PACKED:
                self._packs.append(zlib.compress(pickle.dumps(self._last, pickle.HIGHEST_PROTOCOL)))
                self._last = []

    def __len__(self) -> int:
        return PACKED * len(self._packs) + len(self._last)

    def __iter__(self) -> Iterator[Evidence]:
        for number in range(len(self._packs)):
            yield from self._stretch(number)
        yield from self._last

    @overload
    def __getitem__(self, index: int) -> Evidence: ...
    @overload
    def __getitem__(self, index: slice) -> list[Evidence]: ...
    def __getitem__(self, index: int | slice) -> Evidence | list[Evidence]:
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"evidence {index} of {len(self)}")
        number, place = divmod(index % len(self), PACKED)
        return self._stretch(number)[place] if number < len(self._packs) else self._last[place]

    def _stretch(self, number: int) -> list[Evidence]:
        """Unpacked; the one that was read last is kept."""
        if self._read[0] != number:
            self._read = number, pickle.loads(zlib.decompress(self._packs[number]))
        return self._read[1]
