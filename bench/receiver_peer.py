"""Whole receivers: CPU of `skyproof receive` beside that of gnss-sdr on the same samples, start and search included.

gnss-sdr's CPU grows with what else the machine does (12 ns idle, 60 under a load of 12), so only an idle one is fair.
"""

import importlib.util
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
from timing import Spread, line

from skyproof.formats.raw import open_raw
from skyproof.gnss.nominal import nominal_constellation
from skyproof.simulate import FrontEnd, Place, clean, write

START_GPST = np.datetime64("2024-05-14T09:59:58", "ns")
DURATION_S = 20.0
RATE_HZ = 4e6
RUNS = 3


def report() -> Iterator[str]:
    """Rows of the table."""
    peer = _peer()
    yield f"whole receivers, {DURATION_S:g} s of clean sky at {RATE_HZ / 1e6:g} Msps, CPU a sample and channel"
    with tempfile.TemporaryDirectory(prefix="skyproof-bench-") as name:
        folder = Path(name)
        scenario = clean(
            Place(lat_deg=47.38, lon_deg=8.54, height_m=450.0), START_GPST, receivers=1, duration_s=DURATION_S,
            front_end=FrontEnd(rate_hz=RATE_HZ, encoding="int", bits=8), seed=11,
        )  # fmt: skip
        (path,) = write(scenario, nominal_constellation(START_GPST), folder / "scene")
        samples = open_raw(path)
        ours: list[float] = []
        theirs: list[float] = []
        _skyproof(path, folder / "warm")
        for run in range(RUNS):  # they take turns
            cpu_s, channels = _skyproof(path, folder / f"ours-{run}")
            ours.append(cpu_s * 1e9 / (samples.n_samples * channels))
            if peer.find():
                received = peer.receive(samples, folder / f"theirs-{run}")
                theirs.append(received.cpu_s * 1e9 / (samples.n_samples * max(len(received.sats), 1)))
        yield line(f"skyproof receive, {channels} channels", Spread.of(ours), "ns", f"load {os.getloadavg()[0]:.1f}")
        if theirs:
            mine, other = Spread.of(ours), Spread.of(theirs)
            times = f"{other.median / mine.median:.1f} times ours"
            yield line(f"{peer.NAME}, {len(received.sats)} channels", other, "ns", times)
        else:
            yield f"  skipped: {peer.NAME} not found; {peer.CURE}"


def _skyproof(path: Path, out: Path) -> tuple[float, int]:
    """CPU seconds of the whole process, and how many signals it followed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [Path(sys.executable).with_name("skyproof"), "receive", path, "--out", out]
    subprocess.run(command, capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    files = [file.read_text(encoding="ascii").splitlines() for file in out.glob("*.obs")]
    signals = sum(len({row[:3] for row in rows if row[:1] == "G" and row[1:3].isdigit()}) for rows in files)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, max(signals, 1)


def _peer() -> ModuleType:
    """The way to gnss-sdr that `make interop` uses."""
    path = Path(__file__).resolve().parents[1] / "interop" / "gnss_sdr.py"
    spec = importlib.util.spec_from_file_location("gnss_sdr", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
