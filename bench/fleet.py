"""Many items at once: what a second worker gains, and what an item costs beyond its own work.

`python bench/fleet.py FOLDER` makes the catalogue of 200 pairs and 20 recordings there, for other uses.
"""

import hashlib
import os
import resource
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from skyproof.app.fleet import fleet
from skyproof.app.scenes.simulate import simulate
from skyproof.batch import Item, Processes, Runner, Store, run

PAIRS, RECORDINGS, EMPTY = 200, 20, 500
PAIR_S, RECORDING_S = 30.0, 0.2


def make(folder: Path, pairs: int = PAIRS, recordings: int = RECORDINGS) -> Path:
    """A catalogue of pairs as RINEX, on which a spoofer begins after 20 s, and of short recordings of a clean sky."""
    lines = ["name,inputs,nav"]
    for number in range(pairs):
        name = f"pair-{number:03d}"
        made = simulate("two-antennas", out=folder / name, seed=number, duration_s=PAIR_S, depth="measurements")
        # the file rx1-2 holds the second signals of the satellites in rx1
        inputs = ";".join(f"{name}/{path.name}" for path in made.observations if not path.stem.endswith("-2"))
        lines.append(f"{name},{inputs},{name}/broadcast.rnx")
    for number in range(recordings):
        name = f"recording-{number:02d}"
        made = simulate("clean", out=folder / name, seed=number, duration_s=RECORDING_S, depth="samples")
        lines.append(f"{name},{name}/{made.recordings[0].name},{name}/broadcast.rnx")
    path = folder / "catalogue.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def sum_of(folder: Path) -> str:
    """Of every byte that counts: all but the state of the run."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and ".skyproof-batch" not in path.parts:
            digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return digest.hexdigest()


def nothing(given: Any, folder: Path) -> None:
    """An item that is all overhead."""
    (folder / "nothing.txt").write_text(f"{given}\n")


def cpu_s() -> float:
    """Processor time of this process and of those that it started and that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() + used.ru_utime + used.ru_stime


def timed(work: Callable[[], Any]) -> tuple[float, float]:
    """Wall and processor time."""
    wall, cpu = perf_counter(), cpu_s()
    work()
    return perf_counter() - wall, cpu_s() - cpu


def overhead(name: str, runner: AbstractContextManager[Runner], count: int = EMPTY) -> str:
    """Set-up (until the first item is done), and what an empty item costs."""
    items = [Item(key=f"{number:04d}", given=number, same_as="") for number in range(count)]
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder)) as store:
        begin, cpu = perf_counter(), cpu_s()
        with runner as doing:
            run(items[:1], nothing, store, doing)
            first = perf_counter()
            run(items, nothing, store, doing)
            last = perf_counter()
        used = cpu_s() - cpu
    return (
        f"  {name}: first item after {first - begin:.2f} s, {(last - first) / (count - 1) * 1e3:.2f} ms each of "
        f"{count - 1} more, {used:.2f} s of processor time in all (of processes of its own)"
    )


def report() -> Iterator[str]:
    """Lines of the bench."""
    yield "fleet: empty items"
    for count in (1, 2):
        yield overhead(f"{count} process{'es' * (count > 1)}", Processes(count))
    yield f"fleet: {PAIRS} pairs and {RECORDINGS} recordings, one worker and two; load {os.getloadavg()[0]:.1f}"
    with tempfile.TemporaryDirectory() as name:
        yield from compared(make(Path(name)), Path(name))


def compared(catalogue: Path, folder: Path) -> Iterator[str]:
    """One worker against two."""
    walls, cpus = [], []
    for workers in (1, 2):
        out = folder / f"out-{workers}"
        wall, cpu = timed(lambda workers=workers, out=out: fleet(catalogue, out=out, workers=workers))
        walls.append(wall)
        cpus.append(cpu)
        yield f"  {workers} worker{'s' * (workers > 1)}: {wall:.1f} s, {cpu:.1f} s of processor time"
    same = sum_of(folder / "out-1") == sum_of(folder / "out-2")
    yield (
        f"  {walls[0] / walls[1]:.2f} times as fast by two, with {cpus[1] / cpus[0]:.3f} times the processor time; "
        f"{'the same bytes' if same else 'OTHER BYTES'}"
    )


if __name__ == "__main__":
    print(make(Path(sys.argv[1]), *map(int, sys.argv[2:])))
