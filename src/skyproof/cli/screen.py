"""What all commands share of what a person reads."""

import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

__all__ = ["INTERRUPTED", "complain", "print_path", "table"]

INTERRUPTED = 130
"""Exit code."""


def complain(text: str) -> None:
    """One line on standard error."""
    print(f"skyproof: {' '.join(text.split())}", file=sys.stderr)


def print_path(words: str, path: Path) -> None:
    """A path on one line however long it is, so that it can be copied."""
    Console().print(Text(f"{words} {path}"), soft_wrap=True)


def table(*headings: str, numbers: int = 0) -> Table:
    """A table without lines; its last `numbers` columns hold numbers."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for index, heading in enumerate(headings):
        number = index >= len(headings) - numbers
        table.add_column(heading, justify="right" if number else "left", no_wrap=number)
    return table
