"""The whole receiver, each run a process of its own: CPU a sample and channel, share of real time, peak memory.

Start of the interpreter, search, output files: all is in. Beside it gnss-sdr on the same samples, in turn; its CPU
grows with what else the machine does (12 ns idle, 60 under a load of 12), so only an idle machine is fair.
SKYPROOF_DATA may name a folder with the recording rf/meaconing-pair/rx1.bin, which is then received too.
"""

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from types import ModuleType

import numpy as np
from timing import Spread, line

from skyproof.formats.raw import open_raw
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import FrontEnd, ScenePlace, make_clean, scenes, write

START_GPST = np.datetime64("2024-05-14T09:59:58", "ns")
PLACE = ScenePlace(lat_deg=47.38, lon_deg=8.54, height_m=450.0)
RUNS = 3
# Run by a small process of its own, for the peak of a child counts what its parent held when it was forked.
_USED = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3)  # kilobytes on Linux
"""


@dataclass(frozen=True)
class Run:
    """One run of `skyproof receive`: `channel_s` is the sum over signals of how long each was measured."""

    wall_s: float
    cpu_s: float
    peak_mb: float
    channel_s: float


def report() -> Iterator[str]:
    """Rows of the table."""
    with tempfile.TemporaryDirectory(prefix="skyproof-bench-") as name:
        folder = Path(name)
        yield "the whole of skyproof receive, a process each, start and files included"
        real = Path(os.environ.get("SKYPROOF_DATA", "")) / "rf" / "meaconing-pair" / "rx1.bin"
        if "SKYPROOF_DATA" in os.environ and real.exists():
            yield from _rows("rx1.bin", real, folder)
        else:
            yield "  rx1.bin: skipped, SKYPROOF_DATA names no folder that has it"
        for text, rate_hz, bits, duration_s in (("", 2.6e6, 8, 40.0), ("", 4e6, 8, 20.0), ("16 bits ", 25e6, 16, 12.0)):
            scenario = scenes.make_meaconed(duration_s=duration_s, onset_s=1.0).model_copy(
                update={"front_end": FrontEnd(rate_hz=rate_hz, encoding="int", bits=bits)}
            )
            path = write(scenario, make_nominal_constellation(scenario.start_gpst), folder / f"{rate_hz:.0f}")[0]
            yield from _rows(f"meaconed, {text}{rate_hz / 1e6:g} Msps, {duration_s:g} s", path, folder)
            path.unlink()
        yield from _peers(folder)
        yield "memory"
        for duration_s in (10.0, 40.0):
            path = _clean(folder, 2.6e6, duration_s)
            peak = Spread.of([_received(path, folder / "grown").peak_mb])
            yield line(f"2.6 Msps, {duration_s:g} s", peak, "MB", "length costs what it measures")


def _rows(name: str, path: Path, folder: Path) -> Iterator[str]:
    samples = open_raw(path)
    runs = [_received(path, folder / f"out-{path.parent.name}") for _ in range(RUNS)]
    channels = runs[0].channel_s / samples.duration_s
    cpu = Spread.of([run.cpu_s * 1e9 / (run.channel_s * samples.rate_hz) for run in runs])
    wall = Spread.of([run.wall_s / samples.duration_s for run in runs])
    yield f"  {name}, {channels:.1f} channels on average, load {os.getloadavg()[0]:.1f}"
    yield line("  CPU a sample and channel", cpu, "ns")
    yield line("  wall time", wall, "of its duration", f"{os.cpu_count()} cores")
    yield line("  peak memory", Spread.of([run.peak_mb for run in runs]), "MB")


def _peers(folder: Path) -> Iterator[str]:
    """gnss-sdr on the same clean sky, in turn."""
    peer = _peer()
    path = _clean(folder, 4e6, 20.0)
    samples = open_raw(path)
    ours, theirs, sats = [], [], 0
    for number in range(RUNS):
        run = _received(path, folder / "ours")
        ours.append(run.cpu_s * 1e9 / (run.channel_s * samples.rate_hz))
        if peer.find():
            received = peer.receive(samples, folder / f"theirs-{number}")
            sats = max(len(received.sats), 1)
            theirs.append(received.cpu_s * 1e9 / (samples.n_samples * sats))
    yield "20 s of clean sky at 4 Msps, CPU a sample and channel"
    mine = Spread.of(ours)
    yield line(f"skyproof receive, {run.channel_s / samples.duration_s:.1f} channels", mine, "ns")
    if theirs:
        other = Spread.of(theirs)
        yield line(f"{peer.NAME}, {sats} channels", other, "ns", f"{other.median / mine.median:.1f} times ours")
    else:
        yield f"  skipped: {peer.NAME} not found; {peer.CURE}"


def _clean(folder: Path, rate_hz: float, duration_s: float) -> Path:
    scenario = make_clean(
        PLACE,
        START_GPST,
        receivers=1,
        duration_s=duration_s,
        front_end=FrontEnd(rate_hz=rate_hz, encoding="int", bits=8),
        seed=11,
    )
    return write(scenario, make_nominal_constellation(START_GPST), folder / f"clean-{rate_hz:.0f}-{duration_s:g}")[0]


def _received(path: Path, out: Path) -> Run:
    """One run of the command."""
    command = [str(Path(sys.executable).with_name("skyproof")), "receive", str(path), "--out", str(out), "--overwrite"]
    begin = perf_counter()
    ended = subprocess.run([sys.executable, "-S", "-c", _USED, *command], capture_output=True, text=True, check=False)
    wall_s = perf_counter() - begin
    if ended.returncode:
        raise SystemExit(f"{' '.join(command)} failed: {ended.stderr}")
    cpu_s, peak_mb = map(float, ended.stdout.split())
    bodies = [file.read_text(encoding="ascii").partition("END OF HEADER")[2] for file in out.glob("*.obs")]
    cells = sum(row.startswith("G") for body in bodies for row in body.splitlines())
    return Run(wall_s, cpu_s, peak_mb, cells * 0.2)


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


if __name__ == "__main__":
    for text in report():
        print(text, flush=True)
