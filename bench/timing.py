"""How speed is measured here: the peers take turns, so that what else the machine does hits all alike."""

import platform
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from os import cpu_count, getloadavg
from pathlib import Path
from time import perf_counter

__all__ = ["Spread", "line", "machine", "take_turns"]


@dataclass(frozen=True)
class Spread:
    """Median, least and most of several runs, all in one unit."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, values: list[float]) -> "Spread":
        return cls(statistics.median(values), min(values), max(values))

    def __mul__(self, factor: float) -> "Spread":
        return Spread(self.median * factor, self.least * factor, self.most * factor)


def take_turns(
    *functions: Callable[[], object], runs: int = 7, clock: Callable[[], float] = perf_counter
) -> list[Spread]:
    """Seconds that each function takes; one call of each before, unmeasured, warms caches and compiles.

    clock : `process_time` for work on one core, which others' use of the core does not lengthen.
    """
    for function in functions:
        function()
    seconds: list[list[float]] = [[] for _ in functions]
    for _ in range(runs):
        for taken, function in zip(seconds, functions, strict=True):
            begin = clock()
            function()
            taken.append(clock() - begin)
    return [Spread.of(taken) for taken in seconds]


def line(what: str, figure: Spread, unit: str, beside: str = "") -> str:
    """One row: what, its median, the range of all runs, and what it is compared with."""
    return f"  {what:<42} {figure.median:9.3g} {unit:<15} ({figure.least:.3g} to {figure.most:.3g})  {beside}".rstrip()


def machine() -> str:
    """Processor, cores, load and versions: a figure means nothing without them."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("skyproof", "numpy", "scipy", "numba"))
    cores = f"{cpu_count()} cores, load {getloadavg()[0]:.1f} before the start"
    return f"{_processor()}, {cores}; Python {platform.python_version()}, {versions}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((text.partition(":")[2].strip() for text in lines if text.startswith("model name")), platform.machine())
