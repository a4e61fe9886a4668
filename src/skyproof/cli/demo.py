"""`skyproof demo`."""

import webbrowser
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from skyproof import app
from skyproof.cli.options import Debug, Json
from skyproof.cli.progress import progress
from skyproof.cli.screen import whatever_is_missing
from skyproof.cli.summary import print_result
from skyproof.interruption import get_exit_code

__all__ = ["demo"]


def demo(
    *,
    out: Annotated[Path, Parameter(help="Folder for the recordings and the results.", show_default=True)] = Path(
        "skyproof-demo"
    ),
    overwrite: Annotated[bool, Parameter(help="Replace an earlier demonstration in the folder.")] = False,
    json: Json = False,
    open_report: Annotated[bool, Parameter(name="--open", help="Open the report in the browser.")] = False,
    debug: Debug = False,
) -> int:
    """Simulate two receivers that are jammed and then meaconed, and protect them."""
    with whatever_is_missing(partial(print_result, as_json=json, incomplete=True)):
        result = app.demo.demo(out, overwrite=overwrite, progress=progress())
    print_result(result, as_json=json)
    if open_report and result.folder is not None:
        webbrowser.open((result.folder / "report.html").resolve().as_uri())
    return get_exit_code() if result.interrupted else 0
