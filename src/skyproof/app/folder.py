"""The folder that a run writes into."""

from pathlib import Path

from skyproof.errors import OutputError

__all__ = ["check_folder"]


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
