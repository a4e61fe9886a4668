"""Files written whole or not at all, with words for the ways in which that fails."""

import contextlib
import errno
import os
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from skyproof.errors import OutputError

__all__ = ["write_lines", "writing"]

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
    half a file. A symbolic link keeps pointing where it did.

    Raises
    ------
    OutputError : the file cannot be written; the message names it and what to do. Any OSError of the block counts.
    """
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name}.{uuid.uuid4().hex}.part")
    try:
        if target.exists() and not target.is_file():
            raise OSError(errno.EISDIR if target.is_dir() else errno.EINVAL, "not a regular file")
        with open(part, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, target)
    except OSError as error:
        remedy = _REMEDIES.get(error.errno or 0, "choose another place")
        raise OutputError(f"{os.fspath(path)} cannot be written ({error.strerror or error}): {remedy}") from error
    finally:
        with contextlib.suppress(OSError):  # after success it has its name already
            part.unlink(missing_ok=True)


def write_lines(
    path: str | os.PathLike[str], lines: Iterable[str], *, end: str = "\n", encoding: str = "ascii"
) -> None:
    """Write `lines`, each followed by `end`, as `writing` does. A character that `encoding` lacks becomes "?".

    Raises OutputError as `writing` does.
    """
    with writing(path) as file:
        file.writelines((line + end).encode(encoding, "replace") for line in lines)
