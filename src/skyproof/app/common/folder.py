"""The folder that a run writes into."""

import tempfile
from pathlib import Path

from skyproof.errors import OutputError

__all__ = ["Stamps", "check_folder", "stamps", "written_since"]

Stamps = dict[str, tuple[int, int]]
"""What shows that a file is another one now: by name, its number on the disk and its time."""


def check_folder(out: str | Path) -> Path:
    """Make the folder and try to write in it, before the long work and not after it. Raises OutputError."""
    if not str(out):
        raise OutputError("the folder for the outputs has an empty name; name one with --out")
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written: {error.strerror}; name a folder that can with --out"
        ) from error
    return folder


def stamps(folder: Path) -> Stamps:
    """What is in the folder now, to be compared later."""
    found = [(path.name, path.stat()) for path in folder.iterdir() if path.is_file()]
    return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in found}


def written_since(folder: Path, before: Stamps) -> str:
    """In words, the files that are new or another one since."""
    names = sorted(name for name, stamp in stamps(folder).items() if before.get(name) != stamp)
    return ", ".join(names) or "none"
