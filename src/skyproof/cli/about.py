"""`skyproof --version`: what a bug report needs to say."""

import hashlib
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ["about"]

LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pyarrow", "pydantic", "jinja2", "rich", "cyclopts")
PACKAGE = Path(__file__).resolve().parent.parent


def about() -> int:
    """Print the versions of skyproof and of what it runs on: include them in a bug report."""
    for line in (
        f"skyproof {_version('skyproof')}",
        f"Python {platform.python_version()} ({platform.python_implementation()})",
        f"{platform.platform()}, {platform.machine()}",
        f"{_processor()}, {_count_cores()}",
        ", ".join(f"{name} {_version(name)}" for name in LIBRARIES),
        _count_kernels(),
    ):
        sys.stdout.write(f"{line}\n")
    return 0


def _version(name: str) -> str:
    """Read, not imported: that would take a second."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
            names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
            return next(names, "") or platform.processor() or "processor unknown"
    except OSError:
        return platform.processor() or "processor unknown"


def _count_cores() -> str:
    """Count the cores that this process may use, and all that there are."""
    n_cores = os.cpu_count() or 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else n_cores
    words = f"{n_cores} core{'s' * (n_cores > 1)}"
    return words if usable == n_cores else f"{usable} of {words}"


def _count_kernels() -> str:
    """Count the compiled kernels in every place of `skyproof.compiled`."""
    asked = os.environ.get("NUMBA_CACHE_DIR")
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "numba"
    places = {PACKAGE: [PACKAGE], user: _list_user_folders(user)}
    if asked:
        places = {Path(asked): [Path(asked)]} | places
    counts = {
        place: sum(1 for folder_of_index in folders for _ in folder_of_index.rglob("*.nbi"))
        for place, folders in places.items()
    }
    found = [f"{count} in {folder}" for folder, count in counts.items() if count]
    if not found:
        return "compiled kernels: none; the first run compiles them, once, in about a minute"
    return f"compiled kernels: {', '.join(found)}"


def _list_user_folders(user: Path) -> list[Path]:
    """List where Numba keeps this package's kernels in a user's cache: folders named by a sum."""
    folders = [PACKAGE, *(path for path in PACKAGE.rglob("*") if path.is_dir())]
    return [user / f"{path.name}_{hashlib.sha1(str(path).encode()).hexdigest()}" for path in folders]
