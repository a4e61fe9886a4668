"""Starting: whole processes from call to end, beside a Python that does nothing and what is asked for.

Wall time is what a person waits for, and others' load lengthens it; processor time beside it is lengthened less.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from time import perf_counter

from timing import Spread, line

RUNS = 9
COMMAND = "import sys; from skyproof.cli import main; sys.exit(main())"
NAMES = ("inspect", "protect", "receive", "simulate")
ASKED_S = {"import skyproof": 0.5, "skyproof --help": 0.3, "skyproof --version": 0.3}


def report() -> Iterator[str]:
    """Rows of the table."""
    programs = {"python, nothing done": ("pass",)}
    programs |= {code: (code,) for code in ("import numpy, numba, scipy.fft", "import skyproof")}
    programs |= {f"import skyproof, {name} at hand": (f"import skyproof; skyproof.{name}",) for name in NAMES}
    programs |= {
        " ".join(("skyproof", *tokens)): (COMMAND, *tokens)
        for tokens in (("--help",), ("--version",), ("protect", "--help"), ("simulate", "--help"), ("protct",))
    }
    yield f"starting, whole processes, {RUNS} runs each, one core each"
    for (what, _), (wall, cpu) in zip(programs.items(), _take_turns(*programs.values()), strict=True):
        asked = f", asked for {ASKED_S[what]:g} s" if what in ASKED_S else ""
        yield line(what, wall, "s", f"processor {cpu.median:.2f} ({cpu.least:.2f} to {cpu.most:.2f}){asked}")


def _take_turns(*programs: tuple[str, ...]) -> list[tuple[Spread, Spread]]:
    """Wall and processor seconds of each program; one run of each before, unmeasured, brings its files into memory."""
    started: list[Callable[[], float]] = [lambda program=program: _processor_s(program) for program in programs]
    for start in started:
        start()
    taken: list[tuple[list[float], list[float]]] = [([], []) for _ in programs]
    for _ in range(RUNS):
        for (wall, cpu), start in zip(taken, started, strict=True):
            begin = perf_counter()
            cpu.append(start())
            wall.append(perf_counter() - begin)
    return [(Spread.of(wall), Spread.of(cpu)) for wall, cpu in taken]


def _processor_s(program: tuple[str, ...]) -> float:
    """Run it and give the seconds of processor that it took."""
    process = subprocess.Popen(
        [sys.executable, "-c", *program], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=os.sep
    )
    _, _, used = os.wait4(process.pid, 0)
    process.returncode = 0
    return used.ru_utime + used.ru_stime
