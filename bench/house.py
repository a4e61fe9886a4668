"""The house in figures: rooms, arrows, floors, lengths of functions, and how many modules a decision passes through.

All but the last are read from the source. `python bench/house.py SRC` does it for any checkout's `src`, so that two
commits can be held side by side. Modules are counted while `protect` takes two receivers from samples to what is
written: those of which a function runs, imports apart. Compiled kernels are not seen, but what calls them is.
"""

import ast
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import scenes, write

SRC = Path(__file__).resolve().parent.parent / "src"
PRAGMA = re.compile(r"#\s*fmt:\s*(?:skip|off)")
DURATION_S, ONSET_S = 24.0, 8.0
VISIT = """
import importlib, json, pkgutil, sys, threading
import skyproof
for module in pkgutil.walk_packages(skyproof.__path__, "skyproof."):
    if module.name != "skyproof.batch.ray_nodes":  # of an extra
        importlib.import_module(module.name)
from skyproof.app.protect import protect
OPTIMIZED = 1  # the body of a function, not of a module or a class
seen = set()
def call(frame, event, _):
    if frame.f_code.co_flags & OPTIMIZED:
        seen.add(frame.f_code.co_filename)
folder = sys.argv[1]
threading.settrace(call)
sys.settrace(call)
result = protect([f"{folder}/bow.bin", f"{folder}/stern.bin"], nav=f"{folder}/broadcast.rnx", out=sys.argv[2])
sys.settrace(None)
print(json.dumps({"verdict": result.verdict.verdict, "files": sorted(seen)}))
"""


def report(src: Path = SRC) -> Iterator[str]:
    """Rows of the table."""
    package = src / "skyproof"
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(package.rglob("*.py"))}
    arrows = _arrows(package, trees)
    sizes = _lines_by_room(package)
    biggest = max(trees, key=_lines)
    lengths = [length for tree in trees.values() for length in _function_lines(tree)]
    yield "the house: src/skyproof"
    yield f"  modules {len(trees)}, of {sum(map(_lines, trees))} lines; the longest {_named(biggest, package)}"
    yield f"  rooms {len(sizes)}, arrows between rooms {sum(map(len, arrows.values()))}, floors {_floors(arrows)}"
    room, lines = sizes.most_common(1)[0]
    yield f"  biggest room {room}, {lines} lines in {len(_modules(package, room))} modules"
    ninth = float(np.percentile(lengths, 90))
    yield (
        f"  functions {len(lengths)}: {statistics.median(lengths):g} lines at the median, {ninth:g} at the 90th "
        f"percentile, {max(lengths)} at most; over 80 lines: {sum(length > 80 for length in lengths)}"
    )
    yield f"  fmt pragmas in all Python files of the repository {_pragmas(src.parent)}"
    yield f"  modules that `protect` can reach by imports: {len(_reached(package, trees))} of {len(trees)}"
    visited = _visited(src)
    rooms = Counter(_room(Path(file), package) for file in visited)
    yield f"  modules visited by `protect`, samples to verdict: {len(visited)} of {len(trees)}"
    yield "  " + ", ".join(f"{room} {count}" for room, count in rooms.most_common())


def _lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def _named(path: Path, package: Path) -> str:
    return f"{path.relative_to(package)}, {_lines(path)} lines"


def _room(path: Path, package: Path) -> str:
    """First level below the package; a module stands for itself."""
    return path.relative_to(package).parts[0].removesuffix(".py")


def _modules(package: Path, room: str) -> list[Path]:
    return [path for path in package.rglob("*.py") if _room(path, package) == room]


def _lines_by_room(package: Path) -> Counter[str]:
    sizes: Counter[str] = Counter()
    for path in package.rglob("*.py"):
        sizes[_room(path, package)] += _lines(path)
    return sizes


def _arrows(package: Path, trees: dict[Path, ast.Module]) -> dict[str, set[str]]:
    """The other rooms that each room imports, also inside functions; of the package itself, what is loaded by name."""
    rooms = {_room(path, package) for path in trees}
    arrows: dict[str, set[str]] = defaultdict(set)
    for path, tree in trees.items():
        imported = {name.split(".")[1] for node in ast.walk(tree) for name in _imported(node)}
        arrows[_room(path, package)] |= (imported & rooms) - {_room(path, package)}
    return arrows


def _imported(node: ast.AST) -> Iterator[str]:
    """What a statement imports from the package, by its full name: a module, or a name in one."""
    names: list[str] = []
    if isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
        names = [f"{node.module}.{alias.name}" for alias in node.names]
    elif isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    yield from (name for name in names if name.startswith("skyproof."))


def _reached(package: Path, trees: dict[Path, ast.Module]) -> set[Path]:
    """Modules that `app/protect` imports, those that they import, and so on; detectors count, which come by name."""
    of_name = {".".join(path.relative_to(package.parent).with_suffix("").parts): path for path in trees}
    of_name |= {name.removesuffix(".__init__"): path for name, path in of_name.items()}
    asked = [path for path in trees if path.relative_to(package).as_posix().startswith(("app/protect", "detectors/"))]
    reached: set[Path] = set()
    while asked:
        path = asked.pop()
        if path in reached:
            continue
        reached.add(path)
        for node in ast.walk(trees[path]):
            for name in _imported(node):
                asked += [of_name[item] for item in (name, name.rpartition(".")[0]) if item in of_name]
    return reached


def _floors(arrows: dict[str, set[str]]) -> int:
    """Rooms on the longest way down."""

    def height(room: str) -> int:
        return 1 + max((height(other) for other in arrows.get(room, ())), default=0)

    return max(map(height, arrows))


def _function_lines(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.end_lineno is not None
            yield node.end_lineno - node.lineno + 1


def _pragmas(root: Path) -> int:
    listed = subprocess.run(["git", "ls-files", "-z", "*.py"], cwd=root, check=True, capture_output=True, text=True)
    files = [root / name for name in listed.stdout.split("\0") if name]
    return sum(len(PRAGMA.findall(path.read_text(encoding="utf-8"))) for path in files)


def _visited(src: Path) -> list[str]:
    """Files of which a function ran; the scene is made by this checkout, whichever `src` is asked."""
    scenario = scenes.make_meaconed(duration_s=DURATION_S, onset_s=ONSET_S)
    navigation = make_nominal_constellation(scenario.start_gpst)
    with tempfile.TemporaryDirectory() as folder:
        write(scenario, navigation, Path(folder))
        write_nav(Path(folder) / "broadcast.rnx", navigation)
        done = subprocess.run(
            [sys.executable, "-c", VISIT, folder, f"{folder}/result"],
            check=True,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(src)},
        )
    outcome = json.loads(done.stdout.splitlines()[-1])
    assert outcome["verdict"] == "spoofed", outcome["verdict"]
    return [file for file in outcome["files"] if Path(file).is_relative_to(src / "skyproof")]


if __name__ == "__main__":
    for row in report(*(Path(given).resolve() for given in sys.argv[1:2])):
        print(row, flush=True)
