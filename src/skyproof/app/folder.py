"""The folder that a run writes into."""

from pathlib import Path

from skyproof.errors import OutputError

__all__ = ["Stamps", "check_folder", "stamps", "written_since"]

Stamps = dict[str, tuple[int, int]]
"""What tells that a file is another one now: by name, its number on the disk and its time."""


def check_folder(folder: Path) -> None:
    """Make the folder and try to write in it, before the long work and not after it. Raises OutputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".skyproof-probe"
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written: {error.strerror}; name a folder that can with --out"
        ) from error


def stamps(folder: Path) -> Stamps:
    """What is in the folder now, to be compared later."""
    found = [(path.name, path.stat()) for path in folder.iterdir() if path.is_file()]
    return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in found}


def written_since(folder: Path, before: Stamps) -> str:
    """In words, the files that are new or another one since."""
    names = sorted(name for name, stamp in stamps(folder).items() if before.get(name) != stamp)
    return ", ".join(names) or "none"
