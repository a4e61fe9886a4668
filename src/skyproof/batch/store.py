"""The folder of a batch: what every item left, and what says that it is whole.

    FOLDER/items/KEY/...                 what the work wrote for an item
    FOLDER/.skyproof-batch/done/KEY      written after that folder has its name: the item is done, and of what
    FOLDER/.skyproof-batch/doing/...     what is under way

A folder takes its name in one step and its mark comes after it, so that a process that is killed between any two steps
leaves an item that is done or one that is to be done again.
"""

import errno
import fcntl
import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, Self
from uuid import uuid4

from skyproof.batch.item import Item
from skyproof.errors import OutputError
from skyproof.formats.atomic_write import describe_output_error

__all__ = ["ITEMS", "Store"]

ITEMS: Final = "items"
STATE: Final = ".skyproof-batch"


class Store:
    """Where items leave their results. While a block `with store:` lasts, no other run writes into the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._done, self._doing = folder / STATE / "done", folder / STATE / "doing"

    @property
    def exists(self) -> bool:
        """Test whether a run has written into the folder."""
        return self._done.is_dir()

    def __enter__(self) -> Self:
        """Raises OutputError if the folder cannot be written or another run writes into it."""
        self._made = not self.exists
        try:
            for path in (self.folder / ITEMS, self._done, self._doing):
                path.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self._done, os.O_RDONLY)
        except OSError as error:
            raise describe_output_error(self.folder, error) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._lock)
            raise OutputError(
                f"{self.folder}: another run is writing into it; wait until it ends, or name another folder"
            ) from None
        except OSError:  # a file system without locks
            pass
        self._clear()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._clear()
        if self._made and kind is not None:
            for path in (self._doing, self._done, self._done.parent, self.folder / ITEMS):
                with suppress(OSError):  # it holds something
                    path.rmdir()
        os.close(self._lock)

    def _clear(self) -> None:
        """Remove what killed runs left under way."""
        for part in self._doing.iterdir():
            shutil.rmtree(part, ignore_errors=True)

    def of(self, key: str) -> Path:
        """Return the folder of an item's results."""
        return self.folder / ITEMS / key

    def has(self, item: Item) -> bool:
        """Test whether the item is done, from its present content."""
        try:
            return (self._done / item.key).read_text(encoding="ascii") == _mark(item) and self.of(item.key).is_dir()
        except OSError:
            return False

    def has_other(self, item: Item) -> bool:
        """Test whether the item is done from other content than its present one."""
        return (self._done / item.key).exists() and self.of(item.key).is_dir() and not self.has(item)

    def forget(self, key: str) -> None:
        """Remove what is there of an item, its mark before its results."""
        (self._done / key).unlink(missing_ok=True)
        shutil.rmtree(self.of(key), ignore_errors=True)

    @contextmanager
    def filling(self, item: Item) -> Iterator[Path]:
        """Provide an empty folder, whose files become the item's results when the block ends well."""
        part = self._doing / uuid4().hex
        part.mkdir()
        try:
            yield part
            self._take(part, item)
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _take(self, part: Path, item: Item) -> None:
        self.forget(item.key)
        try:
            os.rename(part, self.of(item.key))
        except OSError as error:
            # An attempt that was taken for lost ended after all, just now: what it left is the same.
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        mark = self._doing / uuid4().hex
        try:
            mark.write_text(_mark(item), encoding="ascii")
            os.replace(mark, self._done / item.key)
        finally:
            with suppress(OSError):
                mark.unlink(missing_ok=True)


def _mark(item: Item) -> str:
    return hashlib.sha256(item.same_as.encode()).hexdigest()
