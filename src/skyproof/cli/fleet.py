"""`skyproof fleet`."""

import json as json_text
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.console import Console

from skyproof import app
from skyproof.cli.options import Debug, OneDocument
from skyproof.cli.progress import progress
from skyproof.cli.screen import complain, print_document, print_path, print_table, table, words
from skyproof.interruption import get_exit_code
from skyproof.verdict import write_word

if TYPE_CHECKING:
    from skyproof.app.fleet import FleetResult

__all__ = ["fleet"]

MOST_FAILED = 10
"""Of those whose error is shown at the terminal."""
FAILED = 2
"""Exit code if an item could not be done."""


def fleet(
    catalogue: Annotated[
        Path,
        Parameter(help="CSV, one line per item: inputs (; between receivers), nav, imu, platform, name, settings."),
    ],
    /,
    *,
    out: Annotated[Path, Parameter(help="Folder for the results; an unfinished one is continued.")],
    workers: Annotated[int | None, Parameter(help="Parallel processes. Default: one per core.")] = None,
    ray: Annotated[
        str | None,
        Parameter(
            name="--ray",
            help="Address of a Ray cluster whose nodes do the work: auto, HOST:PORT. They need the same files at the "
            "same paths, and the extra ray of the package.",
        ),
    ] = None,
    overwrite: Annotated[
        bool,
        Parameter(
            help="Redo items whose files, settings or version have changed, and replace their results. Without it, "
            "such a run is refused."
        ),
    ] = False,
    json: OneDocument = False,
    debug: Debug = False,
) -> int:
    """Protect every recording, pair or station of a catalogue in parallel, with one overview page."""
    result = app.fleet.fleet(catalogue, out=out, workers=workers, ray=ray, overwrite=overwrite, progress=progress())
    if json:
        document = {"format": "skyproof-fleet/1", "items": [asdict(row) for row in result.rows]}
        print_document(json_text.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    else:
        _print_counts(result)
    failed = [row for row in result.rows if row.state == "failed"]
    for row in failed[:MOST_FAILED]:
        complain(f"{row.name}: {row.error}")
    if len(failed) > MOST_FAILED:
        complain(f"and {len(failed) - MOST_FAILED} more that failed; {result.folder / 'fleet.html'} lists all")
    if result.interrupted:
        complain("interrupted: not all items were done; the same command continues from here")
        return get_exit_code()
    if failed:
        names = ", ".join([*(row.name for row in failed[:MOST_FAILED]), *("..." for _ in failed[MOST_FAILED:][:1])])
        complain(
            f"{len(failed)} of {len(result.rows)} items failed ({names}), the others are done; put right what is named "
            "above and give the same command again: it does those that failed"
        )
        return FAILED
    return 0


def _print_counts(result: "FleetResult") -> None:
    console = Console()
    counts = table("items", "", numbers=0)
    for how, count in result.counts.most_common():
        counts.add_row(str(count), words(write_word(how)))
    print_table(console, counts)
    print_path("page:", result.folder / "fleet.html")
