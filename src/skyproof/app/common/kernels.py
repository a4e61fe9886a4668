"""Machine code made before it is needed, in processes side by side, so that no user waits for it in silence."""

import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, Final

from skyproof.app.common.progress import Progress, Silent
from skyproof.batch.attempt import ONE_THREAD
from skyproof.compiled import LOG, count_threads, explain_not_kept, is_kept, kernels_in, writable_folder

__all__ = ["JOBS", "JUDGING", "RECEIVING", "kernels_of", "make_ready"]

JOBS: Final[Mapping[str, tuple[str, ...]]] = {
    "overlaps": (
        "decomposition.kernels",
        "detectors.dccaf.bursts",
        "detectors.dccaf.skies_fit",
    ),
    "receiver": (
        "formats.layout",
        "receiver.acquisition",
        "receiver.cancellation",
        "receiver.correlator",
        "receiver.crosstalk",
        "receiver.fourier",
        "receiver.grids",
        "receiver.kernels",
        "receiver.looks",
        "receiver.measurement",
        "recording.conditioning",
        "simulator.files",
        "simulator.ranges",
        "simulator.sample_kernels",
    ),
    "positions": (
        "formats.rinex_fields",
        "gnss.orbit_kernels",
        "navigation.fit_kernels",
    ),
    "methods": (
        "detectors.dccaf.inverse_raim",
        "navigation.strapdown",
    ),
}
"""Which modules' kernels each job of `skyproof.app.warm` makes, the longest job first."""
RECEIVING: Final = ("overlaps", "receiver", "positions")
"""The jobs without which no recording is received."""
JUDGING: Final = ("positions",)
"""The job without which no measurement is judged."""


def kernels_of(job: str) -> dict[str, Any]:
    """Return the kernels that a job makes, by their full names."""
    found: dict[str, Any] = {}
    for module in JOBS[job]:
        import_module(f"skyproof.{module}")
        found |= kernels_in(f"skyproof.{module}")
    return found


def make_ready(jobs: Sequence[str], progress: Progress | None = None) -> None:
    """Compile the kernels of the jobs that have most of theirs missing, in processes.

    A few missing kernels are compiled when they are used, as after a change of one module: no job is begun for a kernel
    that it may never make. Where no folder can keep kernels, or where a job fails, a message says that each kernel is
    compiled when it is used.
    """
    progress = progress or Silent()
    kernels = {job: kernels_of(job) for job in jobs}
    missing = {job: [name for name, kernel in kernels[job].items() if not is_kept(kernel)] for job in jobs}
    needed = [job for job in jobs if 2 * len(missing[job]) > len(kernels[job])]
    if not needed:
        return
    first = kernels[needed[0]][missing[needed[0]][0]]
    folder = writable_folder(first)
    if folder is None:
        return _say(
            progress,
            f"kernels are compiled when they are used, about a minute in all{explain_not_kept(first)}",
        )
    if not sys.executable:
        return
    begun_s, names = time.monotonic(), {name for job in needed for name in missing[job]}
    if isinstance(progress, Silent):
        LOG.warning("compiling %d kernels, once: about a minute", len(names))
    with progress.stage("compiling kernels, once", float(len(names))) as stage:
        done: set[str] = set()
        for name in _run_jobs(needed):
            done |= {name} & names
            stage.advance(float(len(done)))
    spent_s = time.monotonic() - begun_s
    further = "" if len(done) == len(names) else "; the others are compiled when they are used"
    _say(progress, f"{len(done)} of {len(names)} kernels compiled in {spent_s:.0f} s, and kept for all runs{further}")


def _say(progress: Progress, text: str) -> None:
    """Report a line to the progress display, or to the log without one."""
    if isinstance(progress, Silent):
        LOG.warning(text)
    else:
        progress.say(text)


def _run_jobs(jobs: Sequence[str]) -> Any:
    """Run jobs in as many processes as there are cores, and yield the names of compiled kernels."""
    waiting, lines = list(jobs), queue.SimpleQueue[str | None]()
    running: list[subprocess.Popen[str]] = []

    def begin() -> None:
        process = subprocess.Popen(
            [sys.executable, "-m", "skyproof.app.warm", waiting.pop(0)],
            # the same modules are to be found there as here, by the same names
            env=os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        running.append(process)
        threading.Thread(target=_pass_on, args=(process, lines), daemon=True).start()

    try:
        busy = 0
        while waiting or busy:
            while waiting and busy < count_threads():
                begin()
                busy += 1
            name = lines.get()
            if name is None:
                busy -= 1
            else:
                yield name
    finally:
        for process in running:
            process.kill()
            process.wait()


def _pass_on(process: "subprocess.Popen[str]", lines: "queue.SimpleQueue[str | None]") -> None:
    """Put each line of a process into a queue, and None at its end."""
    assert process.stdout is not None
    for line in process.stdout:
        lines.put(line.strip())
    process.wait()
    lines.put(None)
