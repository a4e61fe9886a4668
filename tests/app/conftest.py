"""Scenes and the truth about them, which the tests of this room share."""

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.app import kit


@pytest.fixture(scope="session")
def made_once(tmp_path_factory) -> Callable[[str, Callable[[Path], None]], Path]:
    """Return a function that fills a folder once per run, however many workers pytest-xdist starts."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def made_once(name: str, fill: Callable[[Path], None]) -> Path:
        folder, done = base / name, base / f"{name}.done"
        try:
            folder.mkdir()
        except FileExistsError:
            deadline_s = time.monotonic() + 1200.0
            while not done.exists() and time.monotonic() < deadline_s:
                time.sleep(0.5)
            assert done.read_text() == "", f"{name} could not be made"
            return folder
        error = "interrupted"
        try:
            fill(folder)
            error = ""
        finally:
            (base / f"{name}.part").write_text(error)
            os.replace(base / f"{name}.part", done)
        return folder

    return made_once


@dataclass(frozen=True)
class ArrayFiles:
    """One array in three ways: a raw file for each antenna, one with all channels, and SigMF; and the day's orbits."""

    raw: tuple[Path, ...]
    woven: Path
    sigmf: Path
    nav: Path


@pytest.fixture(scope="session")
def array_files(made_once) -> ArrayFiles:
    """Record 8 s of clean sky on four antennas, just enough for a time of week."""

    def fill(folder: Path) -> None:
        recorded = kit.record(
            kit.make_array_scenario(duration_s=8.0, start_gpst=kit.START - np.timedelta64(1500, "ms")), folder
        )
        octets = np.stack([np.fromfile(path, "<i2") for path in recorded.paths], axis=1)  # I and Q of a byte each
        octets.tofile(folder / "woven.bin")
        layout = recorded.paths[0].with_suffix(".toml").read_text().splitlines()
        layout = [line for line in layout if not line.startswith("antenna")]
        (folder / "woven.toml").write_text("\n".join([*layout, "channels = 4", ""]))
        octets.tofile(folder / "four.sigmf-data")
        front_end = recorded.scene.scenario.front_end
        about = {"core:datatype": "ci8", "core:sample_rate": front_end.rate_hz, "core:version": "1.2.0"}
        capture = {"core:sample_start": 0, "core:frequency": 1575.42e6, "core:datetime": "2024-05-14T09:59:40Z"}
        meta = {"global": about | {"core:num_channels": 4}, "captures": [capture], "annotations": []}
        (folder / "four.sigmf-meta").write_text(json.dumps(meta))

    folder = made_once("array", fill)
    raw = tuple(folder / f"array.{name}.bin" for name in "1234")
    return ArrayFiles(raw, folder / "woven.bin", folder / "four.sigmf-meta", folder / "broadcast.rnx")
