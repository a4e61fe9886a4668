"""Damaged files through every reader: what is raised is our own error, in five seconds and a gibibyte at most.

    python -m tests.fuzz --inputs 20000 --seed 1 [--readers nav obs] [--again nav 17]

Each input follows from the reader's name, the seed and its number, so that `--again` makes one again. The process has a
gibibyte more than it begins with, and a clock of its own that ends a reader after five seconds of work.
"""

import argparse
import json
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.mutations import mutate_seed
from tests.fuzz.readers import READERS, Reader

from skyproof.errors import SkyproofError

__all__ = ["fuzz", "make_input"]

MOST_S, MOST_BYTES = 5.0, 1 << 30
LONGEST_MESSAGE = 3100


class TooSlow(BaseException):
    """Five seconds of work are over."""


def make_input(name: str, seed: int, number: int) -> bytes:
    """Make the input of this number."""
    rng = Random(f"{name} {seed} {number}")
    seeds = READERS[name].seeds
    return mutate_seed(rng, rng.choice(seeds), seeds)


def find_fault(reader: Reader, path: Path, content: bytes) -> tuple[str | None, float]:
    """Return the fault with which the reading of this input ends, None if there is none, and its seconds."""
    path.unlink(missing_ok=True)  # a file that is emptied and filled anew waits for the disk: 30 times as long
    path.write_bytes(content)
    begun_s = _measure_s()
    signal.setitimer(signal.ITIMER_PROF, MOST_S)
    try:
        reader.read(path)
        fault = None
    except SkyproofError as error:
        words = str(error)
        fault = f"a message of {len(words)} characters: {words[:200]}" if len(words) > LONGEST_MESSAGE else None
    except TooSlow:
        fault = f"slower than {MOST_S:g} s: {_locate(sys.exc_info()[1])}"
    except Exception as error:
        fault = f"{type(error).__name__}: {str(error)[:200]} {_locate(error)}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return fault, _measure_s() - begun_s


def _locate(error: BaseException | None) -> str:
    frames = traceback.extract_tb(error.__traceback__ if error else None)
    ours = [frame for frame in frames if "skyproof" in frame.filename] or frames
    return f"({Path(ours[-1].filename).name}:{ours[-1].lineno})" if ours else ""


def _measure_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + used.ru_utime + used.ru_stime


def fuzz(names: list[str], inputs: int, seed: int) -> dict[str, Any]:
    """Read so many inputs by the readers of these names, by their weights; return counts, slowest and faults."""
    total = sum(READERS[name].weight for name in names)
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            reader = READERS[name]
            path = Path(folder) / name / reader.name
            path.parent.mkdir()
            for beside, content in reader.beside:
                (path.parent / beside).write_bytes(content)
            count = max(inputs * reader.weight // total, 1)
            faults: dict[str, list[int]] = {}
            slowest, begun_s = (0.0, 0), time.perf_counter()
            for number in range(count):
                fault, took_s = find_fault(reader, path, make_input(name, seed, number))
                slowest = max(slowest, (took_s, number))
                if fault is not None:
                    faults.setdefault(fault, []).append(number)
            found[name] = {
                "inputs": count,
                "seconds": round(time.perf_counter() - begun_s, 1),
                "slowest_s": round(slowest[0], 3),
                "slowest_input": slowest[1],
                "faults": {fault: numbers[:5] for fault, numbers in faults.items()},
            }
    return found


def bound_memory() -> None:
    """Limit the process to a gibibyte of addresses more than it has now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = pages * resource.getpagesize() + MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))


def _raise_too_slow(*_: object) -> None:
    raise TooSlow


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--readers", nargs="*", choices=READERS, default=list(READERS))
    parser.add_argument("--again", nargs=2, metavar=("READER", "NUMBER"), help="write this input to standard output")
    options = parser.parse_args()
    if options.again:
        sys.stdout.buffer.write(make_input(options.again[0], options.seed, int(options.again[1])))
        return
    warnings.simplefilter("error")
    signal.signal(signal.SIGPROF, _raise_too_slow)
    bound_memory()
    json.dump(fuzz(options.readers, options.inputs, options.seed), sys.stdout, indent=1)


if __name__ == "__main__":
    main()
