"""The main job on a simulated pair: seconds, real-time factor, peak memory, and in which room the time goes.

Each run is a process of its own, so that its peak memory is its own: `python protection.py FOLDER` is one such run.
"""

import json
import resource
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from types import FrameType

from timing import Spread, line

import skyproof
from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.nominal import nominal_constellation
from skyproof.simulator import scenes, write

RUNS = 3
DURATION_S, ONSET_S = 24.0, 8.0
SAMPLE_S = 0.005
PACKAGE = Path(skyproof.__file__).parent


def report() -> Iterator[str]:
    """Rows of the table."""
    scenario = scenes.meaconed(duration_s=DURATION_S, onset_s=ONSET_S)
    navigation = nominal_constellation(scenario.start_gpst)
    with tempfile.TemporaryDirectory() as folder:
        write(scenario, navigation, Path(folder))
        write_nav(Path(folder) / "broadcast.rnx", navigation)
        runs = [_run_of_its_own(folder) for _ in range(RUNS)]
    seconds = Spread.of([run["seconds"] for run in runs])
    rate = scenario.front_end.rate_hz / 1e6
    yield f"protect, two receivers, {DURATION_S:g} s each at {rate:g} Msps, {runs[0]['signals']} signals, all cores"
    yield line("whole run", seconds, "s", f"{DURATION_S / seconds.median:.2f} times real time (of both at once)")
    yield line(
        "peak memory",
        Spread.of([run["peak_mb"] for run in runs]),
        "MB",
        f"the samples as float32 would be {2 * 2 * 4 * DURATION_S * rate:.0f} MB",
    )
    modules, rooms = Counter[str](), Counter[str]()
    for run in runs:
        modules.update(run["shares"])
    for module, count in modules.items():
        rooms[module.partition("/")[0]] += count
    yield f"  share of the time by room: {_listed(rooms)}"
    yield f"  by module: {_listed(modules)}"


def _listed(shares: Counter[str]) -> str:
    """All that have half a percent or more."""
    total = sum(shares.values())
    return ", ".join(f"{k} {100.0 * n / total:.0f} %" for k, n in shares.most_common() if n >= 0.005 * total)


def _run_of_its_own(folder: str) -> dict:  # type: ignore[type-arg]
    done = subprocess.run(
        [sys.executable, __file__, folder], check=True, capture_output=True, text=True, cwd=Path(__file__).parent
    )
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def _one_run(folder: Path) -> None:
    """Protect the recordings in `folder` once and print what it took as JSON."""
    shares: Counter[str] = Counter()
    done = threading.Event()
    watched = threading.main_thread().ident
    assert watched is not None

    def watch() -> None:
        while not done.wait(SAMPLE_S):
            shares[_module(sys._current_frames().get(watched))] += 1

    watcher = threading.Thread(target=watch)
    begin = perf_counter()
    watcher.start()
    inputs = [folder / "bow.bin", folder / "stern.bin"]
    result = protect(inputs, nav=folder / "broadcast.rnx", out=folder / "result")
    done.set()
    watcher.join()
    seconds = perf_counter() - begin
    assert result.verdict.verdict == "spoofed", result.verdict.summary
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3  # kilobytes on Linux
    print(
        json.dumps({"seconds": seconds, "peak_mb": peak_mb, "signals": len(result.verdict.signals), "shares": shares})
    )


def _module(frame: FrameType | None) -> str:
    """The module (room/name) whose code runs, or has called what runs."""
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if path.is_relative_to(PACKAGE):
            return path.relative_to(PACKAGE).with_suffix("").as_posix()
        frame = frame.f_back
    return "imports"


if __name__ == "__main__":
    _one_run(Path(sys.argv[1]))
