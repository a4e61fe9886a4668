"""Programs that read the files we write, without a line of our code."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

__all__ = ["georinex_counts", "georinex_found", "rtklib_found", "rtklib_positions_ecef_m"]


# Without these RTKLIB leaves the atmosphere in.
_RTKLIB_OPTIONS = """pos1-posmode =single
pos1-frequency =l1
pos1-elmask =5
pos1-ionoopt =brdc
pos1-tropopt =saas
pos1-navsys =1
out-solformat =xyz
"""


def rtklib_found() -> bool:
    """Whether RTKLIB's post-processor is installed (on Debian: apt-get install rtklib)."""
    return shutil.which("rnx2rtkp") is not None


def rtklib_positions_ecef_m(observations: Path, navigation: Path) -> np.ndarray:
    """(n, 3) positions that RTKLIB finds epoch by epoch, from code with broadcast orbits above 5 degrees."""
    solution, options = observations.with_suffix(".pos"), observations.with_suffix(".conf")
    options.write_text(_RTKLIB_OPTIONS, encoding="ascii")
    subprocess.run(
        ["rnx2rtkp", "-k", options, "-o", solution, observations, navigation], capture_output=True, check=True
    )
    rows = [line.split() for line in solution.read_text(encoding="ascii").splitlines() if re.match(r"\d", line)]
    return np.array([[float(cell) for cell in row[2:5]] for row in rows]).reshape(-1, 3)


def georinex_found() -> bool:
    return importlib.util.find_spec("georinex") is not None


def georinex_counts(observations: Path) -> tuple[int, int, int]:
    """Epochs, satellites, and pseudoranges that georinex reads from a file. Its own process: it is slow to import."""
    program = (
        "import sys, georinex; d = georinex.load(sys.argv[1]);"
        "print(d.sizes['time'], d.sizes['sv'], int(d['C1C'].notnull().sum()))"
    )
    done = subprocess.run([sys.executable, "-c", program, observations], capture_output=True, text=True, check=True)
    epochs, sats, ranges = map(int, done.stdout.split()[-3:])
    return epochs, sats, ranges
