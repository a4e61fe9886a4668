"""Checksums of a folder's files, as `sha256sum --check` reads them: 64 hexadecimal digits, two spaces, the name."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from skyproof.errors import InputError
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.bounds import METADATA_BYTES
from skyproof.formats.byte_io import compute_sha256, read_text

__all__ = ["CHECKSUMS", "read_checksums", "write_checksums"]

CHECKSUMS: Final = "checksums.sha256"
"""Name of the file."""
_LINE = re.compile(r"([0-9a-f]{64})  ([^/\\]+)")


def write_checksums(path: Path, folder: Path, names: Iterable[str]) -> None:
    """Write the sums of files of a folder.

    Raises
    ------
    InputError : one cannot be read. OutputError : the sums cannot be written.
    """
    write_lines(path, [f"{compute_sha256(folder / name)}  {name}" for name in sorted(names)], encoding="utf-8")


def read_checksums(path: Path) -> dict[str, str]:
    """Read the SHA-256 of each file, hexadecimal, by its name.

    Raises
    ------
    InputError : the file cannot be read, or a line is none of `write_checksums`.
    """
    title, remedy = "the list of sums", "give the folder that skyproof protect wrote"
    sums: dict[str, str] = {}
    for number, line in enumerate(
        read_text(path, METADATA_BYTES, title, remedy).decode("utf-8", "replace").splitlines(), 1
    ):
        if (found := _LINE.fullmatch(line)) is None:
            raise InputError(
                f"{path}: line {number}: expected 64 hexadecimal digits, two spaces and the name of a file; take the "
                "file from where the folder came from"
            )
        sums[found[2]] = found[1]
    return sums
