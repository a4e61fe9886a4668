"""What all commands share of what a person reads."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from skyproof.errors import IncompleteOutput, make_readable

__all__ = ["complain", "print_document", "print_path", "print_table", "table", "whatever_is_missing", "words"]


def complain(text: str) -> None:
    """Print one line on standard error, if that can be written."""
    with contextlib.suppress(OSError):
        print(f"skyproof: {' '.join(make_readable(text).split())}", file=sys.stderr)


@contextlib.contextmanager
def whatever_is_missing(show: Callable[[Any], object]) -> Iterator[None]:
    """Show the result also where not all its files could be written, and then raise the error about them."""
    try:
        yield
    except IncompleteOutput as error:
        show(error.result)
        raise


def words(text: str, style: str = "") -> Text:
    """Build words for a terminal, which they do not command."""
    return Text(make_readable(text), style=style)


def print_path(what: str, path: Path) -> None:
    """Print a path on one line however long it is, so that it can be copied."""
    Console().print(words(f"{what} {path}"), soft_wrap=True)


def print_document(text: str) -> None:
    """Print a JSON document on standard output, in ASCII where that takes nothing else."""
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(json.loads(text), indent=1) + "\n"
    sys.stdout.write(text)


def print_table(console: Console, table: Table) -> None:
    """Print a table as wide as its numbers need."""
    width, measured = console.width, Measurement.get(console, console.options.update(max_width=10_000), table)
    whole = all(column.no_wrap for column in table.columns)  # what never breaks is not counted in the minimum
    console.width = max(width, measured.maximum if whole else measured.minimum)
    console.print(table)
    console.width = width


def table(*headings: str, numbers: int = 0) -> Table:
    """Make a table without lines; its last `numbers` columns hold numbers."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for index, heading in enumerate(headings):
        number = index >= len(headings) - numbers
        table.add_column(heading, justify="right" if number else "left", no_wrap=numbers > 0)
    return table
