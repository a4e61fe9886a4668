"""The folder that a run writes into: its own while it lasts, and nothing in it is lost unasked."""

import fcntl
import os
import tempfile
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from skyproof.errors import OutputError
from skyproof.formats.bounds import list_names

__all__ = ["ClaimedFolder", "Stamps", "claim", "list_new_files", "list_stamps", "require_free"]

Stamps = dict[str, tuple[int, int]]
"""What shows that a file is another one now: by name, its number on the disk and its time."""


@dataclass(frozen=True)
class ClaimedFolder:
    """A folder that no other run writes into while its `claim` lasts."""

    path: Path


@contextmanager
def claim(out: str | Path | ClaimedFolder) -> Iterator[ClaimedFolder]:
    """Make a folder, try to write in it, and keep other runs out of it during the block.

    At the end a folder that was made and holds nothing is removed. The system forgets the lock of a process that ends,
    however it ends. A folder that the caller has claimed is used unchanged.

    Raises
    ------
    OutputError : it cannot be written, or another run writes into it.
    """
    if isinstance(out, ClaimedFolder):
        yield out
        return
    if not str(out):
        raise OutputError("the folder for the outputs has an empty name; name one with --out")
    folder = Path(out)
    with ExitStack() as stack:
        try:
            for path in (*reversed(folder.parents), folder):
                if not path.exists():
                    stack.callback(_remove_if_empty, path)
            folder.mkdir(parents=True, exist_ok=True)
            stack.callback(os.close, _lock(folder))
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            raise OutputError(
                f"{folder}: cannot be written: {error.strerror}; name a folder that can with --out"
            ) from error
        yield ClaimedFolder(folder)


def _remove_if_empty(folder: Path) -> None:
    with suppress(OSError):  # it holds something
        folder.rmdir()


def _lock(folder: Path) -> int:
    """Lock the folder itself, which leaves no file and ends with the process. Raises OutputError if another has."""
    while True:
        lock = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            raise OutputError(
                f"{folder}: another run is writing into it; wait until it ends, or name another folder with --out"
            ) from None
        except OSError:  # a file system without locks
            return lock
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(lock), os.stat(folder)):
                return lock
        os.close(lock)  # who had it was refused, and removed the folder that it had made
        folder.mkdir(parents=True, exist_ok=True)


def require_free(folder: Path, taken: Collection[str], earlier: Collection[str], what: str, *, overwrite: bool) -> None:
    """Refuse to overwrite: what an earlier run wrote without `overwrite`, what somebody else wrote with it as well.

    Parameters
    ----------
    taken : names of files in `folder` that would be overwritten. earlier : those that an earlier run wrote.
    what : the earlier run in words: "the results of an earlier run (spoofed)".

    Raises
    ------
    OutputError : there are such files.
    """
    if foreign := sorted(set(taken) - set(earlier)):
        raise OutputError(
            f"{folder}: {list_names(foreign)} would be overwritten, and no earlier run of this command wrote it there; "
            "move it away, or name another folder with --out"
        )
    if earlier and not overwrite:
        raise OutputError(
            f"{folder} holds {what}: {list_names(sorted(earlier))}; name another folder with --out, or give "
            "--overwrite to replace them"
        )


def list_stamps(folder: Path) -> Stamps:
    """List the files of a folder with their inodes and times, to compare later."""
    found = [(path.name, path.stat()) for path in folder.iterdir() if path.is_file()]
    return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in found}


def list_new_files(folder: Path, before: Stamps) -> str:
    """Name the files of a folder that are new or were replaced since."""
    names = sorted(name for name, stamp in list_stamps(folder).items() if before.get(name) != stamp)
    return ", ".join(names) or "none"
