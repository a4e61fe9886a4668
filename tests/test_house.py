"""The page of the house agrees with the code: rooms, floors and every arrow between them."""

import ast
import importlib
import importlib.util
import re
import tomllib
from collections import Counter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "skyproof"
PAGE = ROOT / "docs" / "design" / "house.md"


def find_name(cell: str) -> str:
    """Find the room that a cell or a file names."""
    return cell.strip().strip("`").removesuffix("/").removesuffix(".py")


def read_rooms(text: str) -> dict[str, tuple[int, set[str]]]:
    """Read floor and imports of each room from the table with the columns floor, room, ..., imports."""
    rows = [line.strip("|").split("|") for line in text.splitlines() if re.match(r"\| *\d+ *\|", line)]
    return {find_name(row[1]): (int(row[0]), set(re.findall(r"`(\w+)`", row[-1]))) for row in rows}


def find_rooms(package: str) -> dict[str, set[str]]:
    """Find imports of each room: the first level of modules below the package, and `__init__` for itself."""
    graph = grimp.build_graph(package, cache_dir=None)

    def find_room(module: str) -> str:
        return module.split(".")[1] if "." in module else "__init__"

    arrows: dict[str, set[str]] = {find_room(module): set() for module in graph.modules}
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            if find_room(imported) != find_room(module):
                arrows[find_room(module)].add(find_room(imported))
    return arrows


@pytest.fixture(scope="module")
def stated_rooms() -> dict[str, tuple[int, set[str]]]:
    return read_rooms(PAGE.read_text(encoding="utf-8"))


def test_the_page_shows_every_arrow_between_rooms_and_no_other(stated_rooms):
    assert {room: imports for room, (_, imports) in stated_rooms.items()} == find_rooms("skyproof")


def test_the_page_shows_every_room(stated_rooms):
    modules, packages = PACKAGE.glob("*.py"), (file.parent for file in PACKAGE.glob("*/__init__.py"))
    assert set(stated_rooms) == {find_name(path.name) for path in (*modules, *packages)}


def test_every_arrow_points_down(stated_rooms):
    up = [
        (room, other)
        for room, (floor, imports) in stated_rooms.items()
        for other in imports
        if stated_rooms[other][0] >= floor
    ]
    assert up == []


def test_the_floors_are_those_of_the_contract(stated_rooms):
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    (layers,) = [contract["layers"] for contract in settings["contracts"] if contract["type"] == "layers"]
    held = [{room.strip().removeprefix("skyproof.") for room in layer.split("|")} for layer in layers]
    floors = sorted({floor for floor, _ in stated_rooms.values()}, reverse=True)
    assert [{room for room, (floor, _) in stated_rooms.items() if floor == f} for f in floors] == [{"__init__"}, *held]


def test_an_arrow_in_the_code_that_the_page_lacks_is_seen(tmp_path, monkeypatch):
    house = tmp_path / "smallhouse"
    house.mkdir()
    (house / "__init__.py").write_text("from smallhouse.attic import view\n", encoding="utf-8")
    (house / "attic.py").write_text("from smallhouse.cellar import wine as view\n", encoding="utf-8")
    (house / "cellar.py").write_text("wine = 1\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    page = "| floor | room | imports |\n| 2 | `__init__.py` | `attic` |\n| 1 | `attic.py` | |\n| 0 | `cellar/` | |"
    built, stated = find_rooms("smallhouse"), {room: imports for room, (_, imports) in read_rooms(page).items()}
    assert built == {"__init__": {"attic"}, "attic": {"cellar"}, "cellar": set()}
    assert stated == {"__init__": {"attic"}, "attic": set(), "cellar": set()}


OF_A_SIGNAL = {1023, 1.023e6, 2.046e6, 1575.42, 1575.42e6}
"""Chips, chip rate, main lobe and carrier of GPS L1 C/A, which a signal's plan states."""
NOT_OF_A_SIGNAL = {
    ("gnss/constants.py", 1575.42e6): "the interface's constants, of which plans are made",
    ("gnss/constants.py", 1.023e6): "the interface's constants, of which plans are made",
    ("gnss/constants.py", 1023): "the interface's constants, of which plans are made",
    ("app/inspect/guess.py", 2.046e6): "a rate that recorders use",
    ("gnss/thermal_noise.py", 0.02): "the loop of a receiver of common design, whatever the signal",
    ("detectors/correlators/sqm_detector.py", 0.02): "how often a receiver is asked for correlators, before any signal",
    ("records/correlations.py", 0.02): "how long a grid is asked to be, before any signal",
}


def list_literals(tree):
    """List numbers that are those of GPS L1 C/A, and durations of 20 ms, its bit, by the names they are given."""
    durations = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value in OF_A_SIGNAL:
            yield node.value
        if isinstance(node, ast.Assign):
            durations += [(target, node.value) for target in node.targets]
        elif isinstance(node, ast.AnnAssign):
            durations.append((node.target, node.value))
        elif isinstance(node, ast.keyword):
            durations.append((node, node.value))
        elif isinstance(node, ast.arguments):
            durations += zip(node.args[::-1], node.defaults[::-1], strict=False)
            durations += zip(node.kwonlyargs, node.kw_defaults, strict=True)
    for named, value in durations:
        name = next((getattr(named, key) for key in ("id", "attr", "arg") if getattr(named, key, None)), "").lower()
        is_duration = name.endswith("_s") and not name.endswith(("_m_s", "_hz_s", "_chips_s"))
        if is_duration and isinstance(value, ast.Constant) and value.value == 0.02:
            yield value.value


def test_only_plans_know_the_numbers_of_a_signal():
    # A detector, decoder or decision that needs a chip, a carrier or a bit asks `SignalPlan`; the simulator sends.
    found = {
        (str(path.relative_to(PACKAGE)), number)
        for path in PACKAGE.rglob("*.py")
        if not str(path.relative_to(PACKAGE)).startswith(("simulator/", "studies/", "gnss/signals/"))
        for number in list_literals(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found == NOT_OF_A_SIGNAL.keys()


@pytest.mark.parametrize("line", ["M = C / 1.023e6", "def f(bit_s=0.02): ...", "x = 65 / 1023", "f(symbol_s=0.02)"])
def test_a_number_of_a_signal_is_found(line):
    assert [*list_literals(ast.parse(line))]


def test_no_two_public_classes_share_a_name():
    found = [
        (name, path.relative_to(PACKAGE).as_posix())
        for path in sorted(PACKAGE.rglob("*.py"))
        for name in re.findall(r"^class ([A-Za-z]\w*)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    ]
    counts = Counter(name for name, _ in found)
    assert [item for item in found if counts[item[0]] > 1] == []


@pytest.mark.parametrize("folder", ["bench", "interop"])
def test_what_is_imported_beside_the_package_exists(folder):
    imported = {
        (node.module, alias.name)
        for path in (ROOT / folder).glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.module.startswith("skyproof")
        for alias in node.names
    }
    assert [item for item in sorted(imported) if not _has_name(*item)] == []


def _has_name(module: str, name: str) -> bool:
    """Test whether a module has a name, or a package a module of that name."""
    package = importlib.import_module(module)
    inside = hasattr(package, "__path__") and importlib.util.find_spec(f"{module}.{name}") is not None
    return inside or hasattr(package, name)
