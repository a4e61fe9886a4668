"""Rows of many scenes, one a line of JSON, made by several processes: a run goes on where it was stopped."""

import json
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def run(
    names: Sequence[Any], row_of: Callable[[Any], Row], out: Path | None, processes: int, *, key: str = "name"
) -> list[Row]:
    """Rows of these scenes, each with its name under `key`; those that `out` has already are not made again."""
    done = read(out) if out is not None and out.exists() else []
    have = {row[key] for row in done}
    for row in _worked([name for name in names if name not in have], row_of, processes):
        done.append(row)
        if out is not None:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row, default=str) + "\n")
    return [row for row in done if row[key] in set(names)]


def read(path: Path) -> list[Row]:
    """The rows of a file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def _worked(names: Sequence[Any], row_of: Callable[[Any], Row], processes: int) -> Iterator[Row]:
    if processes == 1:
        yield from map(row_of, names)
        return
    with get_context("spawn").Pool(processes) as pool:
        yield from pool.imap_unordered(row_of, names)
