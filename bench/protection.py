"""The main job on a simulated pair: seconds, real-time factor, peak memory, and in which room the time goes; and of
one and three that stand, at other rates.

Each run is a process of its own, so that its peak memory is its own: `python protection.py FOLDER` is one such run. Its
modules are kept as bytecode, as those of an installed program are.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from os import cpu_count
from pathlib import Path
from time import perf_counter
from types import FrameType
from typing import Any

import tomli_w
from timing import Spread, line

import skyproof
from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import scenes, write
from skyproof.simulator.scenario import FrontEnd, Scenario

RUNS = 3
DURATION_S, ONSET_S = 24.0, 8.0
SAMPLE_S = 0.005
MORE = ((1, 4e6, 30.0), (3, 4e6, 30.0), (1, 5e6, 30.0), (1, 25e6, 20.0))  # receivers, samples a second, seconds
NORTH_DEG = 3e-4  # 33 m
PACKAGE = Path(skyproof.__file__).parent
BYTECODE = tempfile.TemporaryDirectory()
"""Which the first run of three fills."""


def report() -> Iterator[str]:
    """Rows of the table."""
    scenario = scenes.make_meaconed(duration_s=DURATION_S, onset_s=ONSET_S)
    navigation = make_nominal_constellation(scenario.start_gpst)
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
    modules, rooms = _shares(runs)
    yield f"  share of the time by room: {_listed(rooms)}"
    yield f"  by module: {_listed(modules)}"

    for receivers, rate_hz, duration_s in MORE:
        yield from _standing(receivers, rate_hz, duration_s)


def _standing(receivers: int, rate_hz: float, duration_s: float) -> Iterator[str]:
    """Every satellite twice from a fifth of the time on, two bits; stated are the oscillator, and of several receivers
    the places, so that all methods run that need no further equipment.
    """
    pair = scenes.make_meaconed(duration_s=duration_s, onset_s=0.2 * duration_s)
    first = pair.receivers[0]
    more = [first.model_copy(update={"name": f"r{n}", "lat_deg": first.lat_deg + n * NORTH_DEG}) for n in (1, 2)]
    front_end = FrontEnd(rate_hz=rate_hz, bandwidth_hz=0.8 * rate_hz, encoding="sign-magnitude", bits=2)
    scenario = pair.model_copy(update={"receivers": (first, *more)[:receivers], "front_end": front_end})
    navigation = make_nominal_constellation(scenario.start_gpst)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = write(scenario, navigation, folder)
        write_nav(folder / "broadcast.rnx", navigation)
        (folder / "platform.toml").write_text(_platform(scenario, files), encoding="utf-8")
        runs = [_run_of_its_own(name) for _ in range(RUNS)]
    seconds, processor = (Spread.of([run[key] for run in runs]) for key in ("seconds", "processor_s"))
    cores = cpu_count() or 1
    yield line(
        f"protect, {receivers} receiver{'s' * (receivers > 1)}, {rate_hz / 1e6:g} Msps, {duration_s:g} s",
        seconds,
        "s",
        f"{duration_s / seconds.median:.2f} times real time, {runs[0]['signals']} signals",
    )
    yield line(
        "  processor",
        processor,
        "s",
        f"{cores * duration_s / processor.median:.2f} times real time if {cores} cores did nothing else",
    )
    yield line("  peak memory", Spread.of([run["peak_mb"] for run in runs]), "MB")
    modules, rooms = _shares(runs)
    yield f"  share of the time by room: {_listed(rooms)}"
    yield f"  by module: {_listed(modules)}"


def _platform(scenario: Scenario, files: Sequence[Path]) -> str:
    """With one receiver that it stands, with several where each of them does."""
    tables = [{"name": r.name, "inputs": [file.name]} for r, file in zip(scenario.receivers, files, strict=True)]
    if len(tables) > 1:
        for table, r in zip(tables, scenario.receivers, strict=True):
            table |= {"position": r.model_dump(include={"lat_deg", "lon_deg", "height_m"}) | {"sigma_m": 0.05}}
    return tomli_w.dumps({"motion": "static", "oscillator": "tcxo", "receivers": tables})


def _shares(runs: Sequence[Mapping[str, Any]]) -> tuple[Counter[str], Counter[str]]:
    """Of the time, by module and by room."""
    modules, rooms = Counter[str](), Counter[str]()
    for run in runs:
        modules.update(run["shares"])
    for module, count in modules.items():
        rooms[module.partition("/")[0]] += count
    return modules, rooms


def _listed(shares: Counter[str]) -> str:
    """All that have half a percent or more."""
    total = sum(shares.values())
    return ", ".join(f"{k} {100.0 * n / total:.0f} %" for k, n in shares.most_common() if n >= 0.005 * total)


def _run_of_its_own(folder: str) -> dict:  # type: ignore[type-arg]
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": BYTECODE.name}
    done = subprocess.run(
        [sys.executable, __file__, folder],
        check=True,
        capture_output=True,
        text=True,
        cwd=Path(__file__).parent,
        env=environment,
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

    watcher = threading.Thread(target=watch, daemon=True)  # a run that fails ends
    begin = perf_counter()
    watcher.start()
    inputs = sorted(folder.glob("*.bin"))
    platform = folder / "platform.toml"
    arguments = {"platform": platform} if platform.is_file() else {"inputs": inputs}
    result = protect(**arguments, nav=folder / "broadcast.rnx", out=folder / "result", overwrite=True)
    done.set()
    watcher.join()
    seconds = perf_counter() - begin
    if len(inputs) > 1:
        assert result.verdict.verdict == "spoofed", result.verdict.summary
    usage = resource.getrusage(resource.RUSAGE_SELF)
    row = {
        "seconds": seconds,
        "processor_s": usage.ru_utime + usage.ru_stime,
        "peak_mb": usage.ru_maxrss / 1e3,  # kilobytes on Linux
        "signals": len(result.verdict.signals),
        "shares": shares,
    }
    print(json.dumps(row))


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
