"""Processor time of one run of `protect` by room: `python rooms.py INPUT... --nav FILE [--distance-m D]`.

Prints one JSON document: seconds of the process, of its imports and of each room, and the most memory that it held.
Seconds of a room that calls another one are without those of the other.
"""

import argparse
import functools
import importlib
import json
import os
import resource
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from time import process_time
from typing import Any
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does: threads for small matrices only spin

ROOMS = {
    "formats: reading": ("run.open_inputs", "run.read_nav", "run.observe_file"),
    "windows: consistent sets": ("windows.consistent_sets",),
    "windows: keeping evidence": ("windows._Kept.take", "run.write_evidence_line"),
    "fusion": ("run.departures", "run.displacements", "run.fuse", "run.choices"),
    "positions": ("run.set_up_positions",),
    "document": ("run.document",),
    "outputs: tables": ("outputs._write_fixes", "outputs._write_evidence", "outputs._write_signals"),
    "outputs: RINEX": ("outputs._write_orbits", "outputs._write_signals_of"),
    "outputs: tracks": ("outputs._write_tracks", "outputs._write_sentences"),
    "report": ("outputs._write_report",),
}
MODULES = {
    "run": "skyproof.app.protect.run",
    "windows": "skyproof.app.common.windows",
    "outputs": "skyproof.app.protect.outputs",
}


class Rooms:
    """Seconds by room."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._within: list[float] = []

    def timed(self, function: Callable[..., Any], room: str | None) -> Callable[..., Any]:
        """The function, with its time counted for `room`, or for the detector that is its first argument."""

        @functools.wraps(function)
        def call(*args: Any, **more: Any) -> Any:
            begin = process_time()
            self._within.append(0.0)
            try:
                return function(*args, **more)
            finally:
                name, took_s = room or f"detector {args[0].name}", process_time() - begin
                self.seconds[name] = self.seconds.get(name, 0.0) + took_s - self._within.pop()
                if self._within:
                    self._within[-1] += took_s

        return call


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("inputs", nargs="+")
    parser.add_argument("--nav", required=True)
    parser.add_argument("--distance-m", type=float)
    asked = parser.parse_args()
    modules = {short: importlib.import_module(name) for short, name in MODULES.items()}
    imports_s, rooms = process_time(), Rooms()
    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        for room, places in (*ROOMS.items(), (None, ("windows.examined",))):
            for place in places:
                module, *path, name = place.split(".")
                owner = functools.reduce(getattr, path, modules[module])
                stack.enter_context(patch.object(owner, name, rooms.timed(getattr(owner, name), room)))
        options = {} if asked.distance_m is None else {"antenna_distance_m": asked.distance_m}
        modules["run"].protect(asked.inputs, nav=asked.nav, out=Path(folder) / "out", **options)
    found = {
        "seconds": process_time(),
        "imports_s": imports_s,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6,
        "rooms_s": rooms.seconds,
    }
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
