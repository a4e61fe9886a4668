"""Bad recordings, how a command line ended that was given one, and who watches it."""

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skyproof.formats.verdict import read_verdict

START = np.datetime64("2024-05-14T09:59:56.5", "ns")  # a time of week is complete 4.7 s later
SIDECAR = '[samples]\nrate_hz = 2600000.0\nkind = "complex"\nencoding = "sign"\nbits = 1\n'


@dataclass(frozen=True)
class Ended:
    """How a command line ended."""

    code: int
    stdout: str
    stderr: list[str]
    folder: Path

    @property
    def verdict(self):
        return read_verdict(self.folder / "verdict.json")

    def remarks(self, number: int) -> str:
        return "; ".join(self.verdict.inputs[number].all_remarks)


def assert_refused(ended: Ended, *words: object) -> None:
    """Check that the command ended with code 2 and one line on standard error that holds all these words."""
    assert ended.code == 2
    assert ended.stdout == ""
    assert len(ended.stderr) == 1
    assert ended.stderr[0].startswith("skyproof: ")
    for word in words:
        assert str(word) in ended.stderr[0]


def copy_recording(
    path: Path, folder: Path, *, name: str | None = None, n_bytes: int | None = None, **keys: str
) -> Path:
    """Copy a recording and its sidecar to another folder, cut short or with other keys in the sidecar."""
    folder.mkdir(exist_ok=True)
    copy = folder / (name or path.name)
    data = path.read_bytes()
    copy.write_bytes(data[:n_bytes])
    lines = path.with_suffix(".toml").read_text().splitlines()
    kept = [line for line in lines if line.split(" = ")[0] not in keys]
    text = "\n".join(kept + [f"{key} = {value}" for key, value in keys.items() if value])
    copy.with_suffix(".toml").write_text(text + "\n")
    return copy


def write_noise(path: Path, duration_s: float = 6.0, *, seed: int = 5) -> Path:
    """Write a recording of an antenna that is not connected."""
    path.write_bytes(np.random.default_rng(seed).bytes(int(duration_s * 2_600_000) // 4))
    path.with_suffix(".toml").write_text(SIDECAR)
    return path


class Watched:
    """Progress of a run, stage by stage, that shows nothing."""

    name = ""

    def say(self, text: str) -> None:
        pass

    @contextmanager
    def stage(self, name, total):
        self.name = name
        yield self
