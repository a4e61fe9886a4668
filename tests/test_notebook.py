"""The tutorial runs from its first cell to its last, and what it makes holds what the manual tells of it."""

import json
import re
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

DOCS = Path(__file__).resolve().parent.parent / "docs"


@pytest.mark.long
def test_the_tutorial_runs_and_writes_the_columns_that_the_manual_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its cells in one namespace, as a notebook runs them."""
    monkeypatch.chdir(tmp_path)
    cells = json.loads((DOCS / "tutorial.ipynb").read_text(encoding="utf-8"))["cells"]
    names: dict[str, Any] = {}
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"cell {number}", "exec"), names)
    assert names["verdict"].verdict == "spoofed"
    assert abs(names["east_m"]) < 5 * names["fix"].sigma_east_m
    assert abs(names["north_m"]) < 5 * names["fix"].sigma_north_m
    assert "meets the contract" in capsys.readouterr().out
    page = (DOCS / "formats.md").read_text(encoding="utf-8")
    assert [key for key in names["inspection"].document() if f"`{key}`" not in page] == []
    for table in ("fixes", "signals", "evidence"):
        columns = pq.read_schema(tmp_path / "result" / f"{table}.parquet").names
        heads = page.partition(f"| column of `{table}.parquet` |" if table != "fixes" else "### Fixes")[2]
        rows = re.findall(r"^\| (`.*?) \|", heads.partition("\n\n| column" if table == "signals" else "\n## ")[0], re.M)
        told = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
        assert [name for name in columns if name not in told] == []
