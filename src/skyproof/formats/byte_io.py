"""Files as bytes: how long they are, a map of them, their digest, and words for the ways in which that fails."""

import contextlib
import gzip
import hashlib
import mmap
import os
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skyproof.errors import InputError

__all__ = ["digest", "mapped", "reading", "release", "sha256", "size_of", "unpacked"]

_HASH_BLOCK = 1 << 22


def size_of(path: Path) -> int:
    """Length of a regular file in bytes. Raises InputError if it is none or cannot be looked at."""
    with reading(path):
        size = path.stat().st_size
    if not path.is_file():
        raise InputError(f"{path} is no regular file; give the file of a recording")
    return size


def unpacked(path: Path, to_do: str) -> bytes:
    """A whole file, plain or gzip. `to_do` ends the message of one that cannot be read. Raises InputError."""
    try:
        content = path.read_bytes()
        if content[:2] == b"\x1f\x8b":
            content = gzip.decompress(content)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(f"{path}: damaged gzip file ({error}); fetch or compress it again") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); {to_do}") from None
    if content[:2] == b"\x1f\x9d":
        raise InputError(f"{path}: compressed by `compress` (.Z), expected plain text or gzip; uncompress it first")
    return content


def mapped(path: Path, start: int, size: int) -> NDArray[np.uint8]:
    """`size` (more than zero) bytes of a file from byte `start` on, read only when they are touched; InputError."""
    with reading(path):
        # a plain view of the map: slices of np.memmap cost microseconds each
        return np.asarray(np.memmap(path, np.uint8, "r", offset=start, shape=(size,)))


def release(octets: NDArray[np.uint8]) -> None:
    """Let go of the pages of a file that are in memory because `mapped` bytes of it were touched; they stay readable.

    The system would take them back when it needs them, but until then they count as this process's memory.
    """
    owner: object = octets
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        owner.madvise(mmap.MADV_DONTNEED)


def sha256(path: str | os.PathLike[str], progress: Callable[[int, int], None] | None = None) -> str:
    """SHA-256 of a file, in hexadecimal; `progress(bytes_done, bytes_in_all)` is called after every 4 MiB.

    Raises InputError if the file cannot be read.
    """
    return digest(Path(path), "sha256", 0, size_of(Path(path)), progress)


def digest(
    path: Path, algorithm: str, start: int, size: int, progress: Callable[[int, int], None] | None = None
) -> str:
    """The digest, in hexadecimal, of at most `size` bytes from byte `start` on; otherwise as `sha256`."""
    state, done = hashlib.new(algorithm), 0
    with reading(path), open(path, "rb") as file:
        file.seek(start)
        while block := file.read(min(_HASH_BLOCK, size - done)):
            state.update(block)
            done += len(block)
            if progress is not None:
                progress(done, size)
    return state.hexdigest()


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """What the system says of a file that cannot be read, as InputError."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist; check the name and the folder") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}); check its permissions") from error
