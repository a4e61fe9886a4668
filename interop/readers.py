"""Programs that read the files we write, without a line of our code."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

__all__ = [
    "BASELINE_MODES",
    "georinex_counts",
    "georinex_found",
    "rtklib_baseline",
    "rtklib_found",
    "rtklib_positions_ecef_m",
]

BASELINE_MODES = ("static", "kinematic")


# Without these RTKLIB leaves the atmosphere in.
_RTKLIB_OPTIONS = """pos1-posmode =single
pos1-frequency =l1
pos1-elmask =5
pos1-ionoopt =brdc
pos1-tropopt =saas
pos1-navsys =1
out-solformat =xyz
"""

# Whole cycles are sought at each epoch, of the ambiguities estimated so far, and taken by the ratio test.
_RTKLIB_BASELINE_OPTIONS = """pos1-posmode ={mode}
pos1-frequency =l1
pos1-elmask =10
pos1-ionoopt =brdc
pos1-tropopt =saas
pos1-navsys =1
pos2-armode =continuous
pos2-arthres =3.0
out-solformat =xyz
"""
_FIXED = 1  # the quality of a solution whose ambiguities are whole


def rtklib_found() -> bool:
    """Whether RTKLIB's post-processor is installed (on Debian: apt-get install rtklib)."""
    return shutil.which("rnx2rtkp") is not None


def rtklib_positions_ecef_m(observations: Path, navigation: Path) -> np.ndarray:
    """(n, 3) positions that RTKLIB finds epoch by epoch, from code with broadcast orbits above 5 degrees."""
    return _rtklib(_RTKLIB_OPTIONS, observations, navigation)[:, :3]


def rtklib_baseline(
    rover: Path, base: Path, navigation: Path, base_ecef_m: np.ndarray, mode: str
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) positions of the rover, epoch by epoch from the carrier of both, and (n,) whether RTKLIB fixed each."""
    options = _RTKLIB_BASELINE_OPTIONS.format(mode=mode)
    table = _rtklib(options, rover, base, navigation, "-r", *(f"{x:.4f}" for x in base_ecef_m))
    return table[:, :3], table[:, 3] == _FIXED


def _rtklib(options: str, observations: Path, *arguments: Path | str) -> np.ndarray:
    """(n, 4) position and quality of each epoch."""
    solution, settings = observations.with_suffix(".pos"), observations.with_suffix(".conf")
    settings.write_text(options, encoding="ascii")
    subprocess.run(
        ["rnx2rtkp", "-k", settings, "-o", solution, observations, *arguments], capture_output=True, check=True
    )
    rows = [line.split() for line in solution.read_text(encoding="ascii").splitlines() if re.match(r"\d", line)]
    return np.array([[float(cell) for cell in row[2:6]] for row in rows]).reshape(-1, 4)


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
