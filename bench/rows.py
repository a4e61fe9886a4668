"""Rows of many scenes, one a line of JSON, made by several processes: a run goes on where it was stopped."""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def parser_of(text: str | None) -> argparse.ArgumentParser:
    """The options of a bench of rows, whose help is `text`; the others are the bench's own."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON lines, one a scene; those in it are not made again")
    parser.add_argument("--table", type=Path, help="print the counts of such a file")
    parser.add_argument("--processes", type=int, default=1)
    return parser


def rows_of(
    chosen: argparse.Namespace, names: Sequence[Any], row_of: Callable[[Any], Row], *, key: str = "name"
) -> list[Row]:
    """The rows that the options ask for: those of a file, or of these scenes as `run` makes them."""
    return read(chosen.table) if chosen.table else run(names, row_of, chosen.out, chosen.processes, key=key)


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
