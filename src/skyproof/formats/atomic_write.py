"""Files written whole or not at all, with words for the ways in which that fails."""

import contextlib
import errno
import fcntl
import hashlib
import os
import shutil
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from skyproof.errors import OutputError

__all__ = [
    "UNFINISHED",
    "OutputStep",
    "Unwritten",
    "describe_missing",
    "describe_output_error",
    "name_replaced",
    "write_in_turn",
    "write_lines",
    "write_whole",
]

UNFINISHED: Final = ".skyproof-unfinished"
"""The folder within another one that holds what `write_in_turn` has not finished."""

_CANNOT: Final = " cannot be written "
_REMEDIES = {
    errno.ENOENT: "its folder does not exist; make it first",
    errno.ENOTDIR: "a part of its path is a file, not a folder; choose another place",
    errno.EISDIR: "it is a folder; give the name of a file",
    errno.EACCES: "the folder may not be written; choose another one or change its permissions",
    errno.EPERM: "the folder may not be written; choose another one or change its permissions",
    errno.EROFS: "the file system is read-only; choose another place",
    errno.ENOSPC: "the disk is full; free space or choose another place",
    errno.EFBIG: "files may not be so large here (ulimit -f); raise the limit or choose another place",
    errno.EDQUOT: "the disk quota is used up; free space or choose another place",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}


@contextlib.contextmanager
def write_whole(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file that appears at `path` when the block ends well; otherwise the old file stays.

    The bytes go to a hidden file in the same folder, which then takes the name in one step, so a reader never sees half
    a file. A symbolic link keeps pointing where it did. Remains of a killed writer are removed.

    Raises
    ------
    OutputError : the file cannot be written; the message names it and what to do. Any OSError of the block counts.
    """
    target = Path(os.path.realpath(path))
    # of a length of its own, so that every name a file may have can be written
    hidden = f".{hashlib.blake2b(os.fsencode(target.name), digest_size=8).hexdigest()}"
    part = target.with_name(f"{hidden}.{uuid.uuid4().hex[:8]}.part")
    try:
        if target.exists() and not target.is_file():
            raise OSError(errno.EISDIR if target.is_dir() else errno.EINVAL, "not a regular file")
        for old_part in target.parent.glob(f"{hidden}.*.part"):
            _remove_remains(old_part)
        with open(part, "xb") as file:
            fcntl.flock(file, fcntl.LOCK_EX)  # while it is held, the file has a writer
            yield file
            file.flush()
            os.fsync(file.fileno())
            os.replace(part, target)
    except OSError as error:
        raise describe_output_error(path, error) from error
    finally:
        with contextlib.suppress(OSError):  # after success it has its name already
            part.unlink(missing_ok=True)


@dataclass(frozen=True)
class OutputStep:
    """Files that are written together.

    names : of them. write : writes them into a folder, each whole or not at all. after_all : only if all before were.
    """

    names: tuple[str, ...]
    write: Callable[[Path], object]
    after_all: bool = False


@dataclass(frozen=True)
class Unwritten:
    """Names of files that are missing, and why."""

    names: tuple[str, ...]
    error: Exception


def write_in_turn(
    folder: Path,
    steps: Sequence[OutputStep],
    *,
    ahead: int = 1,
    instead_of: Iterable[str] = (),
    done: Callable[[int], object] = lambda count: None,
) -> tuple[Unwritten, ...]:
    """Write the files of a run into `folder`, step by step, and return what could not be written.

    A step that fails costs its own files. No file of an earlier run stands beside one of this run, whoever kills the
    process, and whenever. If the first file cannot be written, nothing is, and what an earlier run wrote stays.

    Parameters
    ----------
    ahead : so many steps appear together, in place of what an earlier run wrote; the first file of the first step last.
    instead_of : names of files in `folder` that an earlier run wrote: they go before the first file appears. Until that
        is there, the one of its name is kept as `name_replaced(name)` in the unfinished folder, for whoever comes
        after a kill.
    done : called with the number of steps that are behind.
    """
    if not steps:
        return ()
    part, first, behind = folder / UNFINISHED, steps[0].names[0], 0
    unwritten: list[Unwritten] = []
    failure: Exception | None = None
    try:
        _empty_folder(part, first)
        for number, step in enumerate(steps, 1):
            if step.after_all and unwritten:
                unwritten.append(Unwritten(step.names, unwritten[0].error))
            elif (failed := _attempt(step, part)) is not None:
                unwritten.append(failed)
            if number == ahead:
                if not (part / first).exists():
                    break
                _replace(folder, part, first, instead_of)
            elif number > ahead:
                for path in list(part.iterdir()):
                    os.replace(path, folder / path.name)
            behind = number if number >= ahead else 0
            done(number)
    except OSError as error:
        failure = describe_output_error(folder, error)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    failed_names = {name for each in unwritten for name in each.names}
    rest = tuple(name for step in steps[behind:] for name in step.names if name not in failed_names)
    if rest:
        unwritten.append(Unwritten(rest, failure or unwritten[0].error))
    return tuple(unwritten)


def _empty_folder(part: Path, first: str) -> None:
    """Make the unfinished folder, and remove what a run that was killed left there."""
    part.mkdir(exist_ok=True)
    for old_part in part.iterdir():
        if old_part.name != name_replaced(first):
            old_part.unlink()


def _attempt(step: OutputStep, part: Path) -> Unwritten | None:
    """Write the files of a step, and return those that could not be written."""
    try:
        step.write(part)
    except Exception as error:  # of whatever kind: the files of other steps are not lost for it
        names = tuple(name for name in step.names if not (part / name).exists())
        if isinstance(error, OutputError):
            error = OutputError(str(error).replace(f"{UNFINISHED}{os.sep}", ""))
        return Unwritten(names, error)
    return None


def _replace(folder: Path, part: Path, first: str, instead_of: Iterable[str]) -> None:
    """Move the files of `part` into `folder`, the file `first` last, in place of those of an earlier run."""
    new = {path.name for path in part.iterdir()} - {name_replaced(first)}
    if (folder / first).exists():
        os.replace(folder / first, part / name_replaced(first))
    for name in {*instead_of, *new}:
        (folder / name).unlink(missing_ok=True)
    for name in sorted(new, key=lambda name: (name == first, name)):
        os.replace(part / name, folder / name)
    (part / name_replaced(first)).unlink(missing_ok=True)


def describe_missing(folder: Path, unwritten: Sequence[Unwritten]) -> str:
    """Describe which files are missing in a folder, why, and what to do."""
    names = [name for each in unwritten for name in each.names]
    causes = "; ".join(dict.fromkeys(_describe_cause(each.error) for each in unwritten))
    return (
        f"{folder} lacks {', '.join(names)}: {causes}. What is there is whole; the same command with --overwrite "
        "writes all again"
    )


def _describe_cause(error: Exception) -> str:
    """Describe why a file could not be written, without its name."""
    if isinstance(error, OutputError):
        _, cannot, why = str(error).partition(_CANNOT)
        return f"{cannot.strip()} {why}" if cannot else str(error)
    return f"unexpected {type(error).__name__}: {error}. This is a fault of skyproof, not of the input"


def name_replaced(name: str) -> str:
    """Name a file that is about to be replaced."""
    return f"replaced-{name}"


def _remove_remains(part: Path) -> None:
    """Remove a hidden file whose writer is gone."""
    with contextlib.suppress(OSError), open(part, "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        part.unlink()


def describe_output_error(path: str | os.PathLike[str], error: OSError) -> OutputError:
    """Describe an output that could not be written: why, and what to do."""
    remedy = _REMEDIES.get(error.errno or 0, "choose another place")
    return OutputError(f"{os.fspath(path)}{_CANNOT}({error.strerror or error}): {remedy}")


def write_lines(
    path: str | os.PathLike[str], lines: Iterable[str], *, end: str = "\n", encoding: str = "ascii"
) -> None:
    """Write `lines`, each followed by `end`, as `write_whole` does. A character that `encoding` lacks becomes "?".

    Raises OutputError as `write_whole` does.
    """
    with write_whole(path) as file:
        file.writelines((line + end).encode(encoding, "replace") for line in lines)
