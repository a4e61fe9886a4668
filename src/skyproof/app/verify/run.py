"""What a run wrote and what it read, each held against the sum that was taken then."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from skyproof.app.common.progress import Progress, Silent
from skyproof.formats.byte_io import compute_sha256
from skyproof.formats.checksums import CHECKSUMS, read_checksums
from skyproof.formats.verdict import read_verdict
from skyproof.verdict import InputFile, Verdict

__all__ = ["FileState", "Verified", "verify"]

State = Literal["same", "different", "missing", "not found", "no sum", "not of the run"]


@dataclass(frozen=True, kw_only=True)
class FileState:
    """A file and what became of it.

    kind : whether the run wrote or read it. state : of its bytes; an output that is gone is missing, an input elsewhere
        is not found, and one that was a stream, or of a run that was interrupted, has no sum. A file in the folder
        that has no sum was put there by somebody else.
    """

    name: str
    kind: Literal["output", "input"]
    state: State


@dataclass(frozen=True, kw_only=True)
class Verified:
    """Every file of the run, and its verdict; None if that is no longer what it was, and then no inputs either: what
    it says of them is worth nothing.
    """

    verdict: Verdict | None
    files: tuple[FileState, ...]

    @property
    def unchanged(self) -> bool:
        """Test that no file is different or missing."""
        return not any(file.state in ("different", "missing") for file in self.files)

    @property
    def complete(self) -> bool:
        """Test that every input could be checked."""
        return self.verdict is not None and not any(file.state in ("not found", "no sum") for file in self.files)


def verify(folder: str | Path, *, inputs_in: str | Path | None = None, progress: Progress | None = None) -> Verified:
    """Test whether the outputs and inputs of a `protect` run are byte for byte unchanged.

    Sums show damage and mistakes. Whoever changes a file can change its sum as well: keep a copy of `checksums.sha256`
    where no one else writes, or sign it.

    Parameters
    ----------
    folder : what `protect` was given as `out`.
    inputs_in : a folder with the inputs, by their names alone; else they are looked for where they were, seen from the
        present folder.

    Raises
    ------
    InputError : the folder holds no sums.
    """
    folder, progress = Path(folder), progress or Silent()
    outputs = tuple(_outputs(folder))
    if not any(output.name == "verdict.json" and output.state == "same" for output in outputs):
        return Verified(verdict=None, files=outputs)
    verdict = read_verdict(folder / "verdict.json")
    inputs: list[FileState] = []
    with progress.stage("computing checksums of the inputs", float(len(verdict.inputs))) as stage:
        for number, input_file in enumerate(verdict.inputs, 1):
            inputs.append(FileState(name=input_file.path, kind="input", state=_input(input_file, inputs_in)))
            stage.advance(float(number))
    return Verified(verdict=verdict, files=(*outputs, *inputs))


def _outputs(folder: Path) -> Iterator[FileState]:
    sums = read_checksums(folder / CHECKSUMS)
    for name, sum_then in sums.items():
        path = folder / name
        state: State = "missing" if not path.is_file() else "same" if compute_sha256(path) == sum_then else "different"
        yield FileState(name=name, kind="output", state=state)
    for path in sorted(folder.iterdir()):
        if path.name not in sums and path.name != CHECKSUMS:
            yield FileState(name=path.name, kind="output", state="not of the run")


def _input(given: InputFile, inputs_in: str | Path | None) -> State:
    if given.sha256 is None:
        return "no sum"
    path = Path(given.path) if inputs_in is None else Path(inputs_in) / Path(given.path).name
    if not path.is_file():
        return "not found"
    return "same" if compute_sha256(path) == given.sha256 else "different"
