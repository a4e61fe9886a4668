"""`skyproof inspect`."""

import json as json_text
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from rich.console import Console

from skyproof import app
from skyproof.cli.log import show_log
from skyproof.cli.options import Debug, OneDocument
from skyproof.cli.screen import print_document, print_path
from skyproof.cli.signal import show_guess, show_inspection

if TYPE_CHECKING:
    from skyproof.app.inspect import Inspection, LogInspection

__all__ = ["inspect"]


def inspect(
    file: Annotated[
        Path, Parameter(help="A recording, log or observation file. If nothing describes it, its format is guessed.")
    ],
    /,
    *,
    sidecar: Annotated[Path | None, Parameter(help="How to read raw samples; else NAME.toml beside NAME.bin.")] = None,
    rate_hz: Annotated[
        float | None, Parameter(help="Samples a second. This and the next options are as in a sidecar.")
    ] = None,
    kind: Annotated[Literal["real", "complex"] | None, Parameter(help="Real or complex samples.")] = None,
    encoding: Annotated[
        Literal["int", "float", "sign", "sign-magnitude", "offset-binary"] | None,
        Parameter(help="How numbers are stored."),
    ] = None,
    bits: Annotated[int | None, Parameter(help="Bits of one number.")] = None,
    centre_hz: Annotated[float | None, Parameter(help="Radio frequency that if_hz corresponds to. In hertz.")] = None,
    if_hz: Annotated[float | None, Parameter(help="Frequency of centre_hz in the samples. In hertz.")] = None,
    bit_order: Annotated[
        Literal["msb-first", "lsb-first"] | None, Parameter(help="Position of the first number in its byte.")
    ] = None,
    byte_order: Annotated[Literal["little", "big"] | None, Parameter(help="Byte order of multi-byte numbers.")] = None,
    channels: Annotated[int | None, Parameter(help="Interleaved channels.")] = None,
    header_bytes: Annotated[int | None, Parameter(help="Bytes to skip at the start.")] = None,
    swap_iq: Annotated[bool | None, Parameter(help="Q comes before I.")] = None,
    conjugate: Annotated[bool | None, Parameter(help="The spectrum is inverted.")] = None,
    start_gpst: Annotated[str | None, Parameter(help="GPS time of the first sample: 2022-01-01T21:45:58.")] = None,
    write: Annotated[
        int | None,
        Parameter(
            help="For a file that nothing describes: write the sidecar of this proposal, from 1 on. Default: none is "
            "written. A sidecar that is there is never overwritten."
        ),
    ] = None,
    plot: Annotated[bool, Parameter(help="Write pictures (SVG) of levels, spectrum and correlation.")] = False,
    out: Annotated[Path | None, Parameter(help="Folder for the pictures. Default: that of the recording.")] = None,
    overwrite: Annotated[bool, Parameter(help="Replace pictures that are there, which is refused otherwise.")] = False,
    json: OneDocument = False,
    debug: Debug = False,
) -> int:
    """Inspect a recording, log or observation file: what it holds, whether it is usable, what would improve it."""
    layout = {
        "rate_hz": rate_hz,
        "kind": kind,
        "encoding": encoding,
        "bits": bits,
        "centre_hz": centre_hz,
        "if_hz": if_hz,
        "bit_order": bit_order,
        "byte_order": byte_order,
        "channels": channels,
        "header_bytes": header_bytes,
        "swap_iq": swap_iq,
        "conjugate": conjugate,
        "start_gpst": start_gpst,
    }
    try:
        inspections = run_inspect(file, sidecar=sidecar, layout=layout, write=write or False)
    except app.inspect.NotUnderstood as unknown:
        if json:
            print_document(json_text.dumps(unknown.document(), indent=1) + "\n")
        else:
            show_guess(Console(), unknown.guess)
        if plot or out is not None:
            likeliest = unknown.inspect_first_proposal()
            _write_pictures((likeliest,), file, out, overwrite=overwrite, quiet=json)
            if not json:
                print(f"They show proposal 1; its rate of {likeliest.samples.rate_hz / 1e6:.10g} MHz is not certain.")
        return 0
    if json:
        print_document(app.inspect.write_document_json(inspections))
    else:
        for inspection in inspections:
            if isinstance(inspection, app.inspect.LogInspection):
                show_log(Console(), inspection)
            else:
                show_inspection(Console(), inspection)
    recordings = tuple(found for found in inspections if not isinstance(found, app.inspect.LogInspection))
    if recordings and (plot or out is not None):
        _write_pictures(recordings, file, out, overwrite=overwrite, quiet=json)
    return 0


def _write_pictures(
    inspections: "tuple[Inspection, ...]", file: Path, out: Path | None, *, overwrite: bool, quiet: bool
) -> None:
    for path in app.inspect.write_pictures(inspections, out if out is not None else file.parent, overwrite=overwrite):
        if not quiet:
            print_path("picture", path)


def run_inspect(file: Path, **options: Any) -> "tuple[Inspection | LogInspection, ...]":
    """Load and run the use case."""
    return app.inspect.inspect(file, **options)
