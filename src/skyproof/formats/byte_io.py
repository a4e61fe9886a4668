"""Read files as bytes: length, any stretch, digest, and messages for the ways in which that fails."""

import contextlib
import gzip
import hashlib
import io
import os
import stat
import weakref
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from skyproof.errors import InputError
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "GZIP",
    "FileBytes",
    "compute_digest",
    "compute_sha256",
    "measure_size",
    "read_content",
    "read_text",
    "report_reading",
    "require_size",
    "strip_mark",
    "unpack_beginning",
    "unpack_text",
]

_HASH_BLOCK = 1 << 22
GZIP = b"\x1f\x8b"
_UTF_8_MARK = b"\xef\xbb\xbf"
_OTHER_MARKS = {b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16", b"\0\0\xfe\xff": "UTF-32"}
_LONGEST_HEADER = 1 << 16
"""What is skipped before the bytes that are worked on, and read for the sum alone at once."""


def measure_size(path: Path) -> int:
    """Return the length of a regular file in bytes. Raises InputError if it is not one or cannot be read."""
    with report_reading(path):
        size = path.stat().st_size
    if not path.is_file():
        raise InputError(f"{path} is not a regular file; give the file of a recording")
    return size


def read_content(path: Path, most: int, what: str, to_do: str) -> bytes:
    """Read a whole regular file of at most `most` bytes.

    what, to_do : begin and end the message: "the navigation file", "give one".

    Raises
    ------
    InputError : the file cannot be read, is longer, or is a pipe or a device, which may never end.
    """
    try:
        if stat.S_ISREG(mode := path.stat().st_mode) or stat.S_ISDIR(mode):  # a folder is refused by `open`
            with open(path, "rb") as file:
                size = os.fstat(file.fileno()).st_size  # `read` takes the memory that it is allowed
                content = file.read(min(size, most) + 1)
        else:
            raise InputError(f"{path}: {what} is a pipe or a device, expected a regular file; {to_do}")
    except FileNotFoundError as error:
        check = to_do if to_do.startswith("check the name") else f"check the name and the folder, or {to_do}"
        raise InputError(f"{path}: {what} does not exist; {check}") from error
    except OSError as error:
        raise InputError(f"{path}: {what} cannot be read ({error.strerror or error}); {to_do}") from error
    except ValueError as error:  # a zero byte in the name
        raise InputError(f"{str(path)!r}: {what} cannot be read ({error}); {to_do}") from error
    require_size(len(content), most, f"{path}: {what}", to_do)
    return content


def read_text(path: Path, most: int, what: str, to_do: str) -> bytes:
    """Return a whole file of text, without its byte order mark; otherwise as `read_content` and `strip_mark`."""
    return strip_mark(read_content(path, most, what, to_do), str(path))


def strip_mark(text: bytes, where: str) -> bytes:
    """Return text without the byte order mark that some editors write before UTF-8.

    where : begins a message.

    Raises
    ------
    InputError : the mark is that of UTF-16 or UTF-32, which nothing here is read as.
    """
    for mark, encoding in _OTHER_MARKS.items():
        if text.startswith(mark):
            raise InputError(f"{where}: text in {encoding}, expected UTF-8 or ASCII; save it in UTF-8")
    return text.removeprefix(_UTF_8_MARK)


def unpack_text(path: Path, most: int, what: str, to_do: str) -> bytes:
    """Read a whole text file, plain or gzip, of at most `most` bytes packed and unpacked.

    Otherwise as `read_text`.
    """
    content = read_content(path, most, what, to_do)
    if content[:2] == b"\x1f\x9d":
        raise InputError(f"{path}: compressed by `compress` (.Z), expected plain text or gzip; uncompress it first")
    if content[:2] != GZIP:
        return strip_mark(content, str(path))
    try:
        content = gzip.GzipFile(fileobj=io.BytesIO(content)).read(most + 1)
    except (EOFError, OSError, zlib.error) as error:
        raise InputError(f"{path}: damaged gzip file ({error}); fetch or compress it again") from None
    require_size(len(content), most, f"{path}: {what}, unpacked,", to_do)
    return strip_mark(content, str(path))


def unpack_beginning(head: bytes) -> bytes:
    """Unpack the first bytes of a file if they are gzip, and strip a byte order mark of UTF-8."""
    if head[:2] == GZIP:
        with contextlib.suppress(zlib.error):
            head = zlib.decompressobj(wbits=31).decompress(head, len(head))
    return head.removeprefix(_UTF_8_MARK)


def require_size(size: int, most: int, what: str, to_do: str) -> None:
    """Raise InputError if a file holds more bytes than its kind ever does."""
    if size > most:
        raise InputError(f"{what} exceeds the limit of {most / (1 << 20):g} MiB; {to_do}")


class FileBytes:
    """Bytes of a file that stays open: `octets[a:b]` reads them, from several threads if need be.

    It is the file that was opened that is read and summed, also after it was deleted or another one took its name. Read
    by calls and not through a map: a map of a file that is cut ends the process (SIGBUS).

    Parameters
    ----------
    start, size : the stretch that indices count in; to the end of the file if `size` is not given.

    Raises
    ------
    InputError : the file cannot be opened; and, on reading, where it cannot be read or has been cut.
    """

    def __init__(self, path: Path, start: int = 0, size: int | None = None) -> None:
        with report_reading(path):
            self._descriptor = os.open(path, os.O_RDONLY)
            weakref.finalize(self, os.close, self._descriptor)
            self._opened = os.fstat(self._descriptor)
        self.path = path
        self.size = self._opened.st_size - start if size is None else size
        self._start = start
        self._lock = Lock()
        self._sum: hashlib._Hash | None = None
        self._summed = 0
        self._furthest = 0  # byte read since the sum began

    def __getitem__(self, part: slice) -> NDArray[np.uint8]:
        first, end, _ = part.indices(self.size)
        octets = np.empty(max(0, end - first), np.uint8)
        self._fill(self._start + first, octets)
        if self._sum is not None:
            with self._lock:
                self._sum_on(self._start + first, octets)
        return octets

    def sum_as_read(self) -> None:
        """Add bytes to the sum from now on while they are read in order: see `compute_sha256`."""
        self._sum = hashlib.sha256()

    def sha256(self, progress: Callable[[int, int], None] | None = None) -> str | None:
        """Return the SHA-256 of the whole file, in hexadecimal; bytes read since `sum_as_read` count as read.

        The others are read now; for a file that was cut meanwhile it is the sum of the bytes that remained. None where
        the bytes as read are no longer known: they were read out of order, and the file was changed.
        `progress(bytes_done, bytes_in_all)` is called after every 4 MiB.
        """
        self._sum = self._sum or hashlib.sha256()
        if self._furthest > self._summed and self.changes():
            return None
        size = self._opened.st_size
        with contextlib.suppress(InputError):
            while self._summed < size:
                self._sum_up_to(min(self._summed + _HASH_BLOCK, size))
                if progress is not None:
                    progress(self._summed, size)
        return self._sum.hexdigest()

    def changes(self) -> tuple[str, ...]:
        """Report what became of the file since it was opened.

        A file that now ends elsewhere, or was written to, is `CUT`.
        """
        now, was = os.fstat(self._descriptor), self._opened
        if now.st_size > was.st_size:
            more = now.st_size - was.st_size
            return (
                Remark(
                    f"the file has grown by {more} bytes since it was opened: they are neither used nor in the "
                    "checksum; let the recorder or the copy finish first",
                    RemarkKind.CUT,
                ),
            )
        if now.st_size < was.st_size:
            return (
                Remark(
                    f"the file had {was.st_size} bytes when it was opened and was cut to {now.st_size} since: the "
                    f"checksum is of the first {self._summed}",
                    RemarkKind.CUT,
                ),
            )
        if now.st_mtime_ns != was.st_mtime_ns:
            return (
                Remark(
                    "the file was written to while it was processed: let the recorder or the copy finish first",
                    RemarkKind.CUT,
                ),
            )
        if now.st_nlink == 0:
            return (
                "the file was deleted or replaced while it was processed: it was read to its end, checksum included",
            )
        return ()

    def _fill(self, at: int, octets: NDArray[np.uint8]) -> None:
        done = 0
        with report_reading(self.path):
            while done < octets.size:
                count = os.preadv(self._descriptor, [octets[done:].data], at + done)
                if count == 0:
                    raise InputError(
                        f"{self.path} ends after {at + done} bytes, but had {self._opened.st_size} when it was opened: "
                        "it was cut while it was read; let the recorder or the copy finish first"
                    )
                done += count

    def _sum_on(self, at: int, octets: NDArray[np.uint8]) -> None:
        """Sum what continues the bytes that are summed, over a header as well."""
        self._furthest = max(self._furthest, at + octets.size)
        if 0 < at - self._summed <= _LONGEST_HEADER:
            self._sum_up_to(at)
        if self._sum is not None and at <= self._summed < at + octets.size:
            self._sum.update(octets[self._summed - at :].data)
            self._summed = at + octets.size

    def _sum_up_to(self, end: int) -> None:
        octets = np.empty(end - self._summed, np.uint8)
        self._fill(self._summed, octets)
        if self._sum is not None:
            self._sum.update(octets.data)
        self._summed = end


def compute_sha256(path: str | os.PathLike[str], progress: Callable[[int, int], None] | None = None) -> str:
    """Compute the SHA-256 of a file, in hexadecimal; `progress(done, total)` is called every 4 MiB.

    Raises InputError if the file cannot be read.
    """
    return compute_digest(Path(path), "sha256", 0, measure_size(Path(path)), progress)


def compute_digest(
    path: Path, algorithm: str, start: int, size: int, progress: Callable[[int, int], None] | None = None
) -> str:
    """Compute the digest, in hexadecimal, of at most `size` bytes from byte `start` on, as `compute_sha256` does."""
    state, done = hashlib.new(algorithm), 0
    with report_reading(path), open(path, "rb") as file:
        file.seek(start)
        while block := file.read(min(_HASH_BLOCK, size - done)):
            state.update(block)
            done += len(block)
            if progress is not None:
                progress(done, size)
    return state.hexdigest()


@contextlib.contextmanager
def report_reading(path: Path) -> Iterator[None]:
    """Turn the system's errors about a file that cannot be read into InputError."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist; check the name and the folder") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}); check its permissions") from error
