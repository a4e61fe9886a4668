"""The tutorial runs from its first cell to its last, and what it makes holds what the manual says of it."""

import ast
import importlib
import inspect
import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pyarrow.parquet as pq
import pytest

DOCS = Path(__file__).resolve().parent.parent / "docs"


def read_cells() -> list[dict[str, Any]]:
    return json.loads((DOCS / "tutorial.ipynb").read_text(encoding="utf-8"))["cells"]


@pytest.fixture(scope="module")
def runs() -> ModuleType:
    """Import the module that executes a notebook."""
    sys.path.insert(0, str(DOCS / "build"))
    try:
        return importlib.import_module("runs")
    finally:
        sys.path.remove(str(DOCS / "build"))


def test_the_tutorial_shows_what_its_cells_give() -> None:
    # Where a notebook is read without running it; `make fill` executes it.
    code = [cell for cell in read_cells() if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    shows = [cell for cell in code if re.search(r"^ *print\(|^\w+(\(.*\))?\Z", "".join(cell["source"]), re.MULTILINE)]
    assert len(shows) >= 9
    assert all(cell["outputs"] for cell in shows)
    assert (DOCS / "tutorial.ipynb").stat().st_size < 200_000


def test_every_name_that_the_tutorial_imports_is_there() -> None:
    # The tutorial itself runs among the long tests only.
    source = "\n".join("".join(cell["source"]) for cell in read_cells() if cell["cell_type"] == "code")
    tree, modules = ast.parse(source), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {name.asname or name.name: importlib.import_module(name.name) for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            found = {name.name: getattr(importlib.import_module(str(node.module)), name.name) for name in node.names}
            modules |= {name: value for name, value in found.items() if inspect.ismodule(value)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            assert hasattr(modules[node.value.id], node.attr), f"{node.value.id}.{node.attr}"


@pytest.mark.long
def test_the_tutorial_runs_and_writes_the_listed_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runs: ModuleType
) -> None:
    # Its cells in one namespace, as a notebook runs them.
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for count, cell in enumerate((cell for cell in read_cells() if cell["cell_type"] == "code"), 1):
        outputs = runs.run_cell("".join(cell["source"]), names, count)
        assert [_list_printed(item) for item in outputs] == [_list_printed(item) for item in cell["outputs"]], (
            f"cell {count}"
        )
    assert names["verdict"].verdict == "spoofed"
    assert abs(names["east_m"]) < 5 * names["fix"].sigma_east_m
    assert abs(names["north_m"]) < 5 * names["fix"].sigma_north_m
    page = (DOCS / "formats.md").read_text(encoding="utf-8")
    assert [key for key in names["inspection"].document() if f"`{key}`" not in page] == []
    for table in ("fixes", "signals", "evidence"):
        columns = pq.read_schema(tmp_path / "result" / f"{table}.parquet").names
        heads = page.partition(f"| column of `{table}.parquet` |" if table != "fixes" else "### Fixes")[2]
        rows = re.findall(r"^\| (`.*?) \|", heads.partition("\n\n| column" if table == "signals" else "\n## ")[0], re.M)
        reported = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
        assert [name for name in columns if name not in reported] == []


def _list_printed(output: dict[str, Any]) -> str:
    """Return what a cell printed; of a picture or table that there is one."""
    return "".join(output["text"]) if output["output_type"] == "stream" else output["output_type"]
