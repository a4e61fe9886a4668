"""Files written whole or not at all, with words for the ways in which that fails."""

import contextlib
import errno
import fcntl
import hashlib
import os
import shutil
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, Final

from skyproof.errors import OutputError

__all__ = ["UNFINISHED", "output_error", "replaced", "write_lines", "writing", "writing_together"]

UNFINISHED: Final = ".skyproof-unfinished"
"""The folder within another one that holds what `writing_together` has not finished."""

_REMEDIES = {
    errno.ENOENT: "its folder does not exist; make it first",
    errno.ENOTDIR: "a part of its path is a file, not a folder; choose another place",
    errno.EISDIR: "it is a folder; give the name of a file",
    errno.EACCES: "the folder may not be written; choose another one or change its permissions",
    errno.EPERM: "the folder may not be written; choose another one or change its permissions",
    errno.EROFS: "the file system is read-only; choose another place",
    errno.ENOSPC: "the disk is full; free space or choose another place",
    errno.EDQUOT: "the disk quota is used up; free space or choose another place",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}


@contextlib.contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """An open file that appears at `path` when the block ends well; otherwise whatever stood there stays.

    The bytes go to a hidden file in the same folder, which then takes the name in one step, so a reader never sees
    half a file. A symbolic link keeps pointing where it did. What a writer that was killed left behind is removed.

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
        for left in target.parent.glob(f"{hidden}.*.part"):
            _remove_left(left)
        with open(part, "xb") as file:
            fcntl.flock(file, fcntl.LOCK_EX)  # while it is held, the file has a writer
            yield file
            file.flush()
            os.fsync(file.fileno())
            os.replace(part, target)
    except OSError as error:
        raise output_error(path, error) from error
    finally:
        with contextlib.suppress(OSError):  # after success it has its name already
            part.unlink(missing_ok=True)


@contextlib.contextmanager
def writing_together(folder: Path, *, instead_of: Iterable[str] = (), last: str = "") -> Iterator[Path]:
    """A folder for files that appear in `folder` together when the block ends well; otherwise what stood there stays.

    Whoever kills the process while they appear leaves no old file beside a new one.

    Parameters
    ----------
    instead_of : names of files in `folder` that go first; files of the new names go as well.
    last : of all of them the one that goes first and comes last: where it is, its fellows are. Until all are there, the
        one that went is kept as `replaced(last)` in the unfinished folder, for whoever comes after a kill.

    Raises
    ------
    OutputError : a file cannot be written, or another process is writing into the folder.
    """
    part = folder / UNFINISHED
    lock = _locked(part)
    try:
        for left in part.iterdir():
            if left.name != replaced(last):
                left.unlink()
        yield part
        names = {path.name for path in part.iterdir()} - {replaced(last)}
        if last and (folder / last).exists():
            os.replace(folder / last, part / replaced(last))
        for name in {*instead_of, *names}:
            (folder / name).unlink(missing_ok=True)
        for name in sorted(names, key=lambda name: (name == last, name)):
            os.replace(part / name, folder / name)
    except OutputError as error:
        raise OutputError(str(error).replace(f"{UNFINISHED}{os.sep}", "")) from error
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)
        os.close(lock)


def replaced(name: str) -> str:
    """What a file is called that is about to be replaced."""
    return f"replaced-{name}"


def _locked(part: Path) -> int:
    """Make the folder `part`, and keep others out of it as long as what is returned is open."""
    try:
        part.mkdir(exist_ok=True)
        lock = os.open(part, os.O_RDONLY)
    except OSError as error:
        raise output_error(part.parent, error) from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        raise OutputError(
            f"{part.parent}: another run is writing into it; wait until it ends, or name another folder"
        ) from None
    except OSError:  # a file system without locks
        pass
    return lock


def _remove_left(part: Path) -> None:
    """Remove a hidden file that nobody writes any more."""
    with contextlib.suppress(OSError), open(part, "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        part.unlink()


def output_error(path: str | os.PathLike[str], error: OSError) -> OutputError:
    """What could not be written, why, and what to do."""
    remedy = _REMEDIES.get(error.errno or 0, "choose another place")
    return OutputError(f"{os.fspath(path)} cannot be written ({error.strerror or error}): {remedy}")


def write_lines(
    path: str | os.PathLike[str], lines: Iterable[str], *, end: str = "\n", encoding: str = "ascii"
) -> None:
    """Write `lines`, each followed by `end`, as `writing` does. A character that `encoding` lacks becomes "?".

    Raises OutputError as `writing` does.
    """
    with writing(path) as file:
        file.writelines((line + end).encode(encoding, "replace") for line in lines)
