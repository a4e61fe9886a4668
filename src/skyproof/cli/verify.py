"""`skyproof verify`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from skyproof import app
from skyproof.cli.options import Debug
from skyproof.cli.progress import progress
from skyproof.cli.screen import print_table, table, words

__all__ = ["verify"]

CHANGED, NOT_ALL = 1, 3


def verify(
    folder: Annotated[Path, Parameter(help="The --out folder of `skyproof protect`.")],
    /,
    *,
    inputs_in: Annotated[
        Path | None, Parameter(help="Folder that holds the inputs now. Default: where they were when they were read.")
    ] = None,
    debug: Debug = False,
) -> int:
    """Check that the results and inputs of a run are unchanged since it ended."""
    found = app.verify.verify(folder, inputs_in=inputs_in, progress=progress())
    console = Console()
    rows = table("file", "of the run", "bytes")
    for file in found.files:
        rows.add_row(words(file.name), file.kind, words(file.state, style="" if file.state == "same" else "bold"))
    print_table(console, rows)
    console.print()
    if not found.unchanged or found.verdict is None:
        console.print(words("CHANGED: these are not the bytes that the run wrote and read"))
        return CHANGED
    verdict = f"verdict {found.verdict.verdict!r} by skyproof {found.verdict.versions['skyproof']}"
    if not found.complete:
        console.print(words(f"unchanged as far as there is something to compare, but not all inputs were; {verdict}"))
        return NOT_ALL
    console.print(words(f"unchanged: all that the run wrote and read; {verdict}"))
    return 0
