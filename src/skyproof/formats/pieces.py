"""Arrays on a disk in pieces as they come, so that a run of any length takes the memory of one piece.

A piece is a file of NumPy arrays (`numpy.savez`) that appears whole or not at all, so that what was written before a
run was killed can be read.
"""

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.formats.atomic_write import output_error, writing

__all__ = ["UNFINISHED_RUN", "ArrayPieces", "Workspace"]

UNFINISHED_RUN: Final = "unfinished-run"
"""The folder, within that of the outputs, of what a run has measured and found so far."""
_README: Final = """\
What a run of skyproof has received and found so far. A run that comes to its end, or is ended by Ctrl-C, removes this
folder and leaves its outputs beside it. Where you read this after that, the run was killed; the next one with the same
--out removes it.

NAME/measured/*.npz (numpy.load): a row a signal and epoch of receiver time. `elapsed_s`; `arc`, a number of its own for
    each stretch of tracking; `sat` and `copy`, empty while it is not known which signal it is; `table`, whose columns
    are PERIODS to TURNED of skyproof.receiver.measurement.
NAME/observations/*.npz: pseudoranges, carrier phases, Dopplers and C/N0 (epochs, signals), as
    skyproof.records.Observations describes them.
evidence.jsonl: what the detectors said, a line each.
"""
_CACHED: Final = 2


class Workspace:
    """A folder for what a run keeps on a disk: in that of its outputs, or where temporary files go.

    In the folder of the outputs it lasts as long as the `with` block. A temporary one lasts as long as anyone holds it.
    """

    def __init__(self, out: Path | None = None) -> None:
        """Of a run whose outputs go to the folder `out`; None if it writes none.

        What a run that was killed left in `out` is removed.
        """
        self._out = out
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._made = False
        self._names: set[str] = set()
        if out is not None:
            shutil.rmtree(out / UNFINISHED_RUN, ignore_errors=True)

    def __enter__(self) -> "Workspace":
        return self

    def __exit__(self, *_: object) -> None:
        if self._out is not None:
            shutil.rmtree(self._out / UNFINISHED_RUN, ignore_errors=True)

    def add_lines(self, name: str, lines: Sequence[str]) -> None:
        """Append lines to a file: all or none, whenever the run is killed. Raises OutputError if they cannot be."""
        path = self.path / name
        try:
            with path.open("ab", buffering=0) as file:
                file.write("".join(f"{line}\n" for line in lines).encode())
        except OSError as error:
            raise output_error(path, error) from error

    def own(self, name: str) -> str:
        """A name that nothing else in the folder has."""
        own = next(one for k in count(1) if (one := name if k == 1 else f"{name}-{k}") not in self._names)
        self._names.add(own)
        return own

    @property
    def path(self) -> Path:
        """The folder, made when it is first asked for. Raises OutputError if it cannot be."""
        if self._out is None:
            self._temporary = self._temporary or tempfile.TemporaryDirectory(prefix="skyproof-")
            return Path(self._temporary.name)
        path = self._out / UNFINISHED_RUN
        if not self._made:
            path.mkdir(parents=True, exist_ok=True)
            with writing(path / "README.txt") as file:
                file.write(_README.encode())
            self._made = True
        return path


class ArrayPieces:
    """Pieces in the order in which they were appended, each some named arrays."""

    def __init__(self, workspace: Workspace, name: str) -> None:
        """None yet; their folder is `name` in the workspace, or if that is taken NAME-2 and so on."""
        self._workspace = workspace  # held, so that a temporary folder lasts as long as its pieces
        self._name = workspace.own(name)
        self._count = 0
        self._cached: dict[int, Mapping[str, NDArray[Any]]] = {}

    def __len__(self) -> int:
        return self._count

    @property
    def folder(self) -> Path:
        """Where the pieces are."""
        return self._workspace.path / self._name

    def append(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write a piece. Raises OutputError if it cannot be written."""
        path = self.folder / f"{self._count:06d}.npz"
        part = path.with_suffix(".part")
        try:
            if not self._count:
                path.parent.mkdir(parents=True, exist_ok=True)
            with part.open("wb") as file:
                np.savez(file, **arrays)  # type: ignore[arg-type]
            part.replace(path)
        except OSError as error:
            raise output_error(path, error) from error
        self._count += 1

    def read(self, number: int) -> Mapping[str, NDArray[Any]]:
        """The arrays of one piece; those read last are kept, since stretches that follow each other share them."""
        if number not in self._cached:
            with np.load(self.folder / f"{number:06d}.npz") as stored:
                arrays = {name: stored[name] for name in stored.files}
            self._cached = dict([*self._cached.items()][1 - _CACHED :]) | {number: arrays}
        return self._cached[number]

    def read_one(self, number: int, name: str) -> NDArray[Any]:
        """One array of one piece."""
        if number in self._cached:
            return self._cached[number][name]
        with np.load(self.folder / f"{number:06d}.npz") as stored:
            array: NDArray[Any] = stored[name]
        return array

    def clear(self) -> None:
        """Forget and remove all pieces."""
        if self._count:
            shutil.rmtree(self.folder, ignore_errors=True)
        self._count, self._cached = 0, {}
