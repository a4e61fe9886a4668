"""Writes what is made into the pages where a reader meets it unbuilt, between each mark and its end.

python docs/build/fill.py          what the code alone tells: commands, keys, scenes, studies
python docs/build/fill.py --run    besides, what commands print, and the outputs of the notebook's cells
"""

import json
import sys
from pathlib import Path
from typing import Any

import charts
import marks
import runs
import tables

DOCS = runs.ROOT / "docs"
NOTEBOOK = DOCS / "tutorial.ipynb"


def pages() -> list[Path]:
    """Those of the manual that have marks."""
    return [page for page in sorted(DOCS.rglob("*.md")) if marks.MARK.search(page.read_text(encoding="utf-8"))]


def unbuilt(word: str, what: str, so_far: str) -> str:
    """What stands for a mark in a page that is read unbuilt; an output stays as it is."""
    if word == "policies":
        return tables.policy_files("../../src/skyproof/{}")
    table = tables.table_of(word, what, "../src/skyproof/simulator/scenes/{}.toml")
    if table is not None:
        return table
    if word == "chart":
        return charts.UNBUILT
    if word == "figure":
        name, *options = runs.figure_words(what)
        command = f"skyproof study {' '.join([name, *options])} --plot"
        return f"*`{command}`*"
    return so_far


def run_anew(word: str, what: str, so_far: str) -> str:
    """As `unbuilt`, with outputs from the commands themselves."""
    return f"```text\n{runs.output(what).rstrip()}\n```" if word == "output" else unbuilt(word, what, so_far)


def write_outputs(path: Path) -> None:
    """Execute a notebook and keep what its cells print and show in it."""
    notebook: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    notebook["cells"] = runs.executed(notebook["cells"])
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main(run: bool) -> None:
    """Fill all pages."""
    for page in pages():
        text = page.read_text(encoding="utf-8")
        page.write_text(marks.filled(text, run_anew if run else unbuilt), encoding="utf-8")
    if run:
        write_outputs(NOTEBOOK)


if __name__ == "__main__":
    main("--run" in sys.argv[1:])
