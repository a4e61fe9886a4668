"""Work that other processes find by its name: writes a file, fails, or kills whoever does it."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from skyproof.batch import Item
from skyproof.errors import InputError


@dataclass(frozen=True)
class Fake:
    """kills : a folder that counts how often its process was killed; how_often : after which it works."""

    number: int
    error: bool = False
    kills: str = ""
    how_often: int = 0
    sleep_s: float = 0.0


def fake_work(given: Fake, folder: Path) -> None:
    (folder / "half.txt").write_text("half\n")
    if given.error:
        raise InputError(f"item {given.number}: line 7 is no number; fix that line")
    if given.kills and len(list(Path(given.kills).iterdir())) < given.how_often:
        (Path(given.kills) / str(time.monotonic_ns())).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(given.sleep_s)
    inner = folder / "inner"
    inner.mkdir()
    (inner / "sum.txt").write_text(f"{given.number**2}\n")
    (folder / "half.txt").write_text("whole\n")


def fail_work(given: Fake, folder: Path) -> None:
    raise ZeroDivisionError(f"of {given.number}")


def make_item(fake: Fake, version: str = "1") -> Item:
    return Item(key=f"item-{fake.number}", given=fake, same_as=f"{fake.number} {version}")


def read_results(folder: Path) -> dict[str, bytes]:
    """Read every result by its path."""
    items = folder / "items"
    return {path.relative_to(items).as_posix(): path.read_bytes() for path in items.rglob("*") if path.is_file()}
