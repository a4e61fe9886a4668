"""`skyproof init`."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from skyproof import app
from skyproof.cli.options import Debug
from skyproof.cli.screen import print_path, words

__all__ = ["init"]


def init(
    files: Annotated[
        list[Path],
        Parameter(
            name="FILE",
            help="One per receiver: recordings, each with its sidecar, and observation files; besides, inertial "
            "readings or an attitude (CSV, Parquet).",
        ),
    ],
    /,
    *,
    out: Annotated[Path, Parameter(help="The file to write.", show_default=True)] = Path("platform.toml"),
    overwrite: Annotated[bool, Parameter(help="Replace the file if it already exists.")] = False,
    debug: Debug = False,
) -> int:
    """Write a platform file from what the inputs state, with lines to complete for the rest."""
    result = app.init.init(files, out=out, overwrite=overwrite)
    names = [receiver.name for receiver in result.platform.receivers]
    Console().print(words(f"{len(names)} receiver{'s' * (len(names) > 1)}: {', '.join(map(str, names))}"))
    print_path("complete what you know in", result.path)
    print_path("then: skyproof protect --nav NAVIGATION_FILE --out FOLDER --platform", result.path)
    return 0
