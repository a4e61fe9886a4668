"""RINEX observations: two receivers protected, by room; a day at 1 Hz of all systems read, and a part beside georinex.

A day of two receivers protected is simulated, as its satellites have to rise and set: `memory.py`.

The day is made of the minutes of a real receiver (rinex-mosaic-1m/base.obs under SKYPROOF_DATA), again and again with
the time going on. Every figure is of a process of its own: seconds of one core from its first import to its end,
seconds of reading alone, and the most memory that it held. georinex brings a stack of libraries, so that it may stand
in an environment of its own: SKYPROOF_PEERS names that environment's python.
"""

import itertools
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from timing import Spread, line

DAY, PART = 86_400, 300  # epochs; georinex needs minutes for more
RUNS = 3
LEAST_S = 0.02  # of a room that has a row
SOURCE = "real/rinex-mosaic-1m/base.obs"
PAIR, NAV, APART_M = ("base.obs", "rover.obs"), "base.nav", 0.99  # beside the source
FACTOR = 20  # asked for: times as fast as georinex

IN_PIECES = """
from functools import partial
from skyproof.formats.rinex_obs_pieces import PIECE_BYTES, read_obs_pieces
begin, ranges = time.process_time(), 0
with open(path, "rb") as file:
    for piece in read_obs_pieces(iter(partial(file.read, PIECE_BYTES), b"")):
        ranges += int(np.isfinite(piece.observations.pseudorange_m).sum())
"""
AT_ONCE = """
from skyproof.formats.rinex_obs_read import read_obs
begin = time.process_time()
ranges = int(np.isfinite(read_obs(path).observations.pseudorange_m).sum())
"""
BY_GEORINEX = """
import georinex
begin = time.process_time()
found = georinex.load(path)
ranges = int(sum(np.isfinite(found[name]).sum() for name in found if name[0] == "C"))
"""
PROGRAM = "import sys, time\nimport numpy as np\npath = sys.argv[1]\n{}print(time.process_time() - begin, ranges)"


@dataclass(frozen=True)
class Read:
    """What a process took for a file, in seconds of one core, and the most memory that it held, in megabytes."""

    whole_s: float
    reading_s: float
    peak_mb: float
    ranges: int


def report() -> Iterator[str]:
    """Rows of the table."""
    source = Path(os.environ.get("SKYPROOF_DATA", "")) / SOURCE
    if "SKYPROOF_DATA" not in os.environ or not source.is_file():
        yield f"reading RINEX: skipped, SKYPROOF_DATA names no folder with {SOURCE}"
        return
    yield from _rows_of_the_pair(source.parent)
    with TemporaryDirectory() as folder:
        part, hour, day = (
            repeated(source, Path(folder) / f"{epochs}.rnx", epochs) for epochs in (PART, DAY // 24, DAY)
        )
        yield f"reading RINEX 3.04 of a real receiver, 57 satellites at 1 Hz, whole processes, {RUNS} runs each"
        yield from _rows_of_pieces(hour, day)
        yield from _rows_beside_georinex(part)


def _rows_of_the_pair(folder: Path) -> Iterator[str]:
    """Two receivers protected, whole processes: seconds of processor time, by room, and memory."""
    yield f"protecting {PART} s of two real receivers, 47 satellites and 158 signals at 1 Hz, {RUNS} runs"
    command = [sys.executable, "-W", "ignore", str(Path(__file__).with_name("rooms.py"))]
    command += [*(str(folder / name) for name in PAIR), "--nav", str(folder / NAV), "--distance-m", str(APART_M)]
    environment = os.environ | {"SKYPROOF_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    runs = [
        json.loads(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)
        for _ in range(RUNS + 1)
    ][1:]  # the first one may compile
    yield line("whole process", Spread.of([run["seconds"] for run in runs]), "s of processor")
    yield line("beyond its imports", Spread.of([run["seconds"] - run["imports_s"] for run in runs]), "s of processor")
    yield line("most memory", Spread.of([run["peak_mb"] for run in runs]), "MB")
    seconds = {room: Spread.of([run["rooms_s"].get(room, 0.0) for run in runs]) for room in runs[0]["rooms_s"]}
    for room, spread in sorted(seconds.items(), key=lambda item: -item[1].median):
        if spread.median >= LEAST_S:
            yield line(f"  {room}", spread, "s of processor")


def repeated(source: Path, path: Path, epochs: int) -> Path:
    """`source` again and again, so many epochs, a second apart."""
    head, _, body = source.read_bytes().partition(b"END OF HEADER")
    ending, _, body = body.partition(b"\n")
    records = [record[28:].rstrip() + b"\n" for record in body.lstrip(b"> ").split(b"\n> ")]
    begin = np.datetime64("2024-06-24T00:00:00")
    with path.open("wb") as file:
        file.write(head + b"END OF HEADER" + ending + b"\n")
        for second, record in zip(range(epochs), itertools.cycle(records)):
            label = str(begin + np.timedelta64(second, "s")).replace("-", " ").replace("T", " ").replace(":", " ")
            file.write(f"> {label}.0000000 ".encode() + record)
    return path


def _rows_of_pieces(hour: Path, day: Path) -> Iterator[str]:
    """An hour and a day in turns: the memory must be the same."""
    runs = [(read(sys.executable, IN_PIECES, hour), read(sys.executable, IN_PIECES, day)) for _ in range(RUNS)]
    for name, path, reads in zip(("an hour", "a day"), (hour, day), zip(*runs, strict=True), strict=True):
        size = f"{path.stat().st_size / 1e6:.0f} MB, {reads[0].ranges} ranges"
        yield line(f"{name} in pieces", Spread.of([r.whole_s for r in reads]), "s", size)
        yield line(f"{name} in pieces, most memory", Spread.of([r.peak_mb for r in reads]), "MB")


def _rows_beside_georinex(part: Path) -> Iterator[str]:
    """The same part by ours at once, by ours in pieces and by georinex, in turns."""
    peer = os.environ.get("SKYPROOF_PEERS", sys.executable)
    found = subprocess.run([peer, "-c", "import georinex"], capture_output=True, check=False).returncode == 0
    programs = {"at once": (sys.executable, AT_ONCE), "in pieces": (sys.executable, IN_PIECES)}
    programs |= {"georinex": (peer, BY_GEORINEX)} if found else {}
    runs = [[read(python, program, part) for python, program in programs.values()] for _ in range(RUNS)]
    for name, reads in zip(programs, zip(*runs, strict=True), strict=True):
        per_epoch = Spread.of([r.reading_s / PART * 1e3 for r in reads])
        whole_s, peak_mb = (Spread.of([getattr(r, key) for r in reads]) for key in ("whole_s", "peak_mb"))
        beside = f"process {whole_s.median:.2g} s, {peak_mb.median:.0f} MB ({peak_mb.least:.0f} to {peak_mb.most:.0f})"
        yield line(f"{PART} epochs, {name}", per_epoch, "ms an epoch", f"{beside}, {reads[0].ranges} ranges")
    if not found:
        yield "  georinex is not there: make an environment with it, and name its python by SKYPROOF_PEERS"
        return
    times = Spread.of([run[2].reading_s / run[0].reading_s for run in runs])
    yield line("georinex's time over ours, pair by pair", times, "times", f"asked for {FACTOR}")


def read(python: str, program: str, path: Path) -> Read:
    """One file by one program, in a process of its own."""
    command = [python, "-W", "ignore", "-c", PROGRAM.format(program), str(path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    reading_s, ranges = process.stdout.read().split()
    _, _, used = os.wait4(process.pid, 0)
    process.returncode = 0
    return Read(used.ru_utime + used.ru_stime, float(reading_s), used.ru_maxrss * 1024 / 1e6, int(ranges))


if __name__ == "__main__":
    for text in report():
        print(text)
