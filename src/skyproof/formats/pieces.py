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

from skyproof.errors import OutputError
from skyproof.formats.atomic_write import write_whole

__all__ = ["UNFINISHED_RUN", "ArrayPieces", "Workspace", "is_unfinished"]

UNFINISHED_RUN: Final = "unfinished-run"
"""The folder, within that of the outputs, of what a run has measured and found so far."""
_README: Final = "README.txt"
_HEAD: Final = """\
What a run of skyproof has received and found so far. A run that comes to its end, or is ended by Ctrl-C, SIGTERM or
SIGHUP, removes this folder and leaves its outputs beside it. Where you read this after that, the run was killed; the
next one with the same --out removes it.
"""
_CONTENTS: Final = {
    "measured": """\
NAME/measured/*.npz (numpy.load): a row a signal and epoch of receiver time. `elapsed_s`; `arc`, a number of its own for
    each stretch of tracking; `sat` and `copy`, empty while it is not known which signal it is; `table`, whose columns
    are PERIODS to TURNED of skyproof.receiver.measurement.
""",
    "observations": """\
NAME/observations/*.npz: pseudoranges, carrier phases, Dopplers and C/N0 (epochs, signals), as
    skyproof.records.Observations describes them.
""",
    "as-given": """\
NAME/as-given/*.npz: the same as the file gives them, before they are made ready.
""",
    "grids": """\
NAME/grids/*.npz: powers of correlators over code delay and Doppler, as skyproof.receiver.grids describes them.
""",
    "inertial": """\
inertial/*.npz: readings of the inertial unit in body axes, (n, 3), and `time_ns`, the ends of their intervals.
""",
    "evidence.jsonl": """\
evidence.jsonl: what the detectors said, a line each.
""",
}
"""What may be there, by the last part of its name, in words."""
_CACHED: Final = 2


class Workspace:
    """A folder for what a run keeps on a disk: in that of its outputs, or where temporary files go.

    In the folder of the outputs it lasts as long as the `with` block. A temporary one lasts as long as anyone holds it.
    Where the folder of the outputs takes no more, the temporary one is used, and where that takes no more, memory.
    """

    def __init__(self, out: Path | None = None) -> None:
        """Prepare for a run with outputs in the folder `out`; None if it writes none.

        Remains of a killed run in `out` are removed; `removed` says whether there were any.
        """
        self._out = out
        self._takes = out is not None
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._described: list[str] = []
        self._names: set[str] = set()
        self.removed = out is not None and is_unfinished(out)
        if self.removed:
            self._remove()

    def __enter__(self) -> "Workspace":
        return self

    def __exit__(self, *_: object) -> None:
        self._remove()

    def _remove(self) -> None:
        if self._out is not None:
            shutil.rmtree(self._out / UNFINISHED_RUN, ignore_errors=True)

    def note(self, name: str, lines: Sequence[str]) -> None:
        """Append lines to a file for whoever comes after a kill: all or none, and none once the disk takes no more."""
        if not self._takes:
            return
        octets = "".join(f"{line}\n" for line in lines).encode()
        try:
            with (self._make_described_folder(name) / name).open("ab", buffering=0) as file:
                if (taken := file.write(octets)) < len(octets):
                    file.truncate(file.tell() - taken)
                    self._takes = False
        except (OSError, OutputError):
            self._takes = False

    def drop_notes(self, name: str) -> None:
        """Remove what `note` wrote: its room is for the outputs, which hold it too."""
        if self._out is not None and name in self._described:
            (self._out / UNFINISHED_RUN / name).unlink(missing_ok=True)
            self._describe([note for note in self._described if note != name])

    def reserve_name(self, name: str) -> str:
        """Reserve a name that nothing else in the folder has."""
        reserved = next(
            candidate for k in count(1) if (candidate := name if k == 1 else f"{name}-{k}") not in self._names
        )
        self._names.add(reserved)
        return reserved

    def save(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> Path | None:
        """Write arrays into a file, whole or not at all, and return its path; None if no disk takes it."""
        if self._takes:
            try:
                return _save(self._make_described_folder(name) / name, arrays)
            except (OSError, OutputError):
                self._takes = False
        try:
            self._temporary = self._temporary or tempfile.TemporaryDirectory(prefix="skyproof-")
            return _save(Path(self._temporary.name) / name, arrays)
        except OSError:
            return None

    def _make_described_folder(self, name: str) -> Path:
        """Make the folder within the outputs' folder, with a text that describes its content, `name` too."""
        assert self._out is not None
        folder = self._out / UNFINISHED_RUN
        kind = next(
            (content for content in _CONTENTS if any(part.startswith(content) for part in Path(name).parts)), ""
        )
        if kind not in self._described:
            folder.mkdir(parents=True, exist_ok=True)
            self._describe([*self._described, kind])
        return folder

    def _describe(self, kinds: list[str]) -> None:
        assert self._out is not None
        with write_whole(self._out / UNFINISHED_RUN / _README) as file:
            file.write("\n".join([_HEAD, *(_CONTENTS[kind] for kind in kinds if kind)]).encode())
        self._described = kinds


def is_unfinished(out: Path) -> bool:
    """Test whether a killed run left its folder in `out`: another's folder may have that name."""
    folder = out / UNFINISHED_RUN
    try:
        text = (folder / _README).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return folder.is_dir() and not any(folder.iterdir())
    return text.startswith(_HEAD.partition("\n")[0][:40])


def _save(path: Path, arrays: Mapping[str, NDArray[Any]]) -> Path:
    part = path.with_suffix(".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return path


def _copy(arrays: Mapping[str, NDArray[Any]]) -> Mapping[str, NDArray[Any]]:
    return {name: np.array(values) for name, values in arrays.items()}


class ArrayPieces:
    """Pieces in the order in which they were appended, each some named arrays."""

    def __init__(self, workspace: Workspace, name: str) -> None:
        """Start without pieces; their folder is `name` in the workspace, or NAME-2 and so on if taken."""
        self._workspace = workspace  # held, so that a temporary folder lasts as long as its pieces
        self._name = workspace.reserve_name(name)
        self._pieces: list[Path | Mapping[str, NDArray[Any]]] = []
        self._cached: dict[int, Mapping[str, NDArray[Any]]] = {}

    def __len__(self) -> int:
        return len(self._pieces)

    def append(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write a piece; one that no disk takes stays in memory, so that a full disk costs no answer."""
        self._pieces.append(self._workspace.save(f"{self._name}/{len(self):06d}.npz", arrays) or _copy(arrays))

    def read(self, number: int) -> Mapping[str, NDArray[Any]]:
        """Read the arrays of one piece; the last ones stay cached, since neighbouring stretches share them."""
        piece = self._pieces[number]
        if not isinstance(piece, Path):
            return piece
        if number not in self._cached:
            with np.load(piece) as stored:
                arrays = {name: stored[name] for name in stored.files}
            self._cached = dict([*self._cached.items()][1 - _CACHED :]) | {number: arrays}
        return self._cached[number]

    def read_one(self, number: int, name: str) -> NDArray[Any]:
        """Read one array of one piece."""
        piece = self._pieces[number]
        if not isinstance(piece, Path):
            return piece[name]
        if number in self._cached:
            return self._cached[number][name]
        with np.load(piece) as stored:
            array: NDArray[Any] = stored[name]
        return array

    def clear(self) -> None:
        """Remove all pieces."""
        for folder in {piece.parent for piece in self._pieces if isinstance(piece, Path)}:
            shutil.rmtree(folder, ignore_errors=True)
        self._pieces, self._cached = [], {}
