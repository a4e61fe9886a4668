"""`skyproof inspect`."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.text import Text

from skyproof.app.inspect import Inspection, document_json
from skyproof.app.inspect import inspect as run_inspect
from skyproof.cli.options import Debug
from skyproof.cli.screen import table

__all__ = ["inspect"]


def inspect(
    file: Annotated[Path, Parameter(help="A recording; raw samples with a sidecar, or with the options below.")],
    /,
    *,
    sidecar: Annotated[Path | None, Parameter(help="How to read raw samples; else NAME.toml beside NAME.bin.")] = None,
    rate_hz: Annotated[float | None, Parameter(help="Samples a second; this and the next as in a sidecar.")] = None,
    kind: Annotated[Literal["real", "complex"] | None, Parameter(help="Real or complex samples.")] = None,
    encoding: Annotated[
        Literal["int", "float", "sign", "sign-magnitude", "offset-binary"] | None, Parameter(help="Of the numbers.")
    ] = None,
    bits: Annotated[int | None, Parameter(help="Of one number.")] = None,
    centre_hz: Annotated[float | None, Parameter(help="The radio frequency that lies at the next one.")] = None,
    if_hz: Annotated[float | None, Parameter(help="Where that lies in the samples.")] = None,
    bit_order: Annotated[
        Literal["msb-first", "lsb-first"] | None, Parameter(help="Where in its byte the first number lies.")
    ] = None,
    byte_order: Annotated[Literal["little", "big"] | None, Parameter(help="Of numbers of several bytes.")] = None,
    header_bytes: Annotated[int | None, Parameter(help="Bytes to skip at the start.")] = None,
    swap_iq: Annotated[bool | None, Parameter(help="Q comes before I.")] = None,
    conjugate: Annotated[bool | None, Parameter(help="The spectrum is inverted.")] = None,
    start_gpst: Annotated[str | None, Parameter(help="GPS time of the first sample: 2022-01-01T21:45:58.")] = None,
    json: Annotated[bool, Parameter(name="--json", help="Print one JSON document, and nothing else there.")] = False,
    debug: Debug = False,
) -> int:
    """Say what is in a recording, and whether it is usable: levels, lines, satellites, lost samples, oscillator."""
    layout = {
        "rate_hz": rate_hz, "kind": kind, "encoding": encoding, "bits": bits, "centre_hz": centre_hz, "if_hz": if_hz,
        "bit_order": bit_order, "byte_order": byte_order, "header_bytes": header_bytes, "swap_iq": swap_iq,
        "conjugate": conjugate, "start_gpst": start_gpst,
    }  # fmt: skip
    inspections = run_inspect(file, sidecar=sidecar, layout=layout)
    if json:
        sys.stdout.write(document_json(inspections))
        return 0
    for inspection in inspections:
        _print_inspection(inspection)
    return 0


def _print_inspection(inspection: Inspection) -> None:
    """One screen: the sentence, the front end, the satellites, what is wrong."""
    console = Console()
    samples, front = inspection.samples, inspection.front_end
    console.print(Text(samples.name, style="bold"))
    console.print(Text(inspection.summary))
    console.print(Text(
        f"{'real' if front.real else 'complex'} samples, {samples.rate_hz / 1e6:g} MHz, "
        f"{samples.centre_hz / 1e6:g} MHz at {samples.if_hz / 1e6:g} MHz; "
        f"band {front.band_hz[0] / 1e6:.2f} to {front.band_hz[1] / 1e6:.2f} MHz", style="dim",
    ))  # fmt: skip
    if inspection.satellites:
        satellites = table("satellite", "C/N0 dB-Hz", "Doppler Hz", "code phase chips", "signals", numbers=4)
        for one in inspection.satellites:
            satellites.add_row(one.sat, f"{one.cn0_dbhz:.1f}", f"{one.doppler_hz:+.0f}", f"{one.code_phase_chips:.1f}",
                               str(one.peaks))  # fmt: skip
        console.print(satellites)
    for remark in inspection.remarks:
        console.print(Text(f"- {remark}"))
