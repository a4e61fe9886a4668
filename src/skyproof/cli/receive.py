"""`skyproof receive`."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.console import Console

from skyproof import app
from skyproof.cli.options import Debug, Duration, Nav, OneDocument, Overwrite, Place, Reach, Start, Tracking
from skyproof.cli.progress import progress
from skyproof.cli.screen import complain, print_document, print_path, whatever_is_missing, words
from skyproof.interruption import get_exit_code

if TYPE_CHECKING:
    from skyproof.app.receive import ReceiveResult

__all__ = ["receive"]


def receive(
    files: Annotated[list[Path], Parameter(name="FILE", help="Recordings, one per receiver, each with its sidecar.")],
    /,
    *,
    out: Annotated[
        Path,
        Parameter(
            help="Folder for NAME-nav.rnx, NAME.obs and, where a satellite has several signals, NAME-2.obs and so on: "
            "RINEX has room for one per satellite."
        ),
    ],
    nav: Nav = None,
    tracking: Tracking = None,
    doppler_max_hz: Reach = None,
    place_deg: Place = None,
    start_s: Start = None,
    duration_s: Duration = None,
    overwrite: Overwrite = False,
    json: OneDocument = False,
    debug: Debug = False,
) -> int:
    """Track every signal in recordings and write RINEX observations and navigation data, without judging them."""
    with whatever_is_missing(partial(_show, as_json=json)):
        result = app.receive.receive(
            files,
            out=out,
            nav=nav,
            tracking=tracking,
            doppler_max_hz=doppler_max_hz,
            place_deg=place_deg,
            start_s=start_s,
            duration_s=duration_s,
            overwrite=overwrite,
            progress=progress(),
        )
    _show(result, as_json=json)
    return get_exit_code() if result.interrupted else 0


def _show(result: "ReceiveResult", *, as_json: bool) -> None:
    if result.interrupted:
        complain("interrupted: this is what was received so far")
    if as_json:
        print_document(app.receive.write_document_json(result))
    else:
        console = Console()
        for reception in result.receptions:
            console.print(words(f"{reception.source.name}: {reception.n_signals} signals"))
            for remark in reception.noted:
                console.print(words(f"  {remark}", style="dim"))
        if result.folder is not None:
            print_path("files in", result.folder)
