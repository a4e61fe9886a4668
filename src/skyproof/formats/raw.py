"""Raw recordings: bare samples in a file, and a sidecar NAME.toml beside it that states how to read them.

    [samples]
    rate_hz = 2600000.0
    centre_hz = 1575420000.0    # the radio frequency that lies at if_hz in the samples
    if_hz = 0.0
    kind = "complex"            # or "real", which needs if_hz
    encoding = "sign"           # "int" | "float" | "sign" | "sign-magnitude" | "offset-binary"
    bits = 1                    # of one number, I or Q
    bit_order = "msb-first"     # or "lsb-first": where in its byte the first number lies
    channels = 1                # of several, the samples of one instant follow each other, channel by channel
    start_gpst = "2022-01-01T21:45:58"

What the encodings mean stands in `skyproof.formats.layout`.
"""

import difflib
import math
import os
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, model_validator

from skyproof.errors import InputError, make_readable, shorten, write_value
from skyproof.formats.bounds import describe_first
from skyproof.formats.byte_io import FileBytes, compute_sha256, measure_size
from skyproof.formats.documents import read_toml
from skyproof.formats.layout import FITTING_BITS, BitOrder, ByteOrder, Chunk, Encoding, Kind, PackedSamples, Packing
from skyproof.formats.levels import check_levels, drop_dead, open_channels
from skyproof.formats.signatures import identify_other, read_head
from skyproof.gnss.constants import L1_HZ
from skyproof.gnss.time import GPS_EPOCH, format_iso, parse_iso
from skyproof.records import Samples
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "SampleLayout",
    "check_levels",
    "compute_sha256",
    "open_raw",
    "open_raw_channels",
    "read_sidecar",
    "samples_from_layout",
    "write_sidecar_text",
]

MOST_CHANNELS: Final = 64
_EXAMPLE: Final = 'samples = {rate_hz = 2600000.0, kind = "complex", encoding = "int", bits = 8}'


# --- the sidecar


def _parse_instant(value: object) -> np.datetime64:
    text = value.isoformat() if isinstance(value, datetime) else value
    if not isinstance(text, str):
        raise ValueError("not an instant")
    instant = parse_iso(text)
    if instant < GPS_EPOCH:
        raise ValueError("before the first day of GPS time")
    return instant


class SampleLayout(BaseModel):
    """The table [samples] of a sidecar: how the bytes of a recording become samples. See the module's text."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    rate_hz: float = Field(ge=1e5, le=1e11, description="samples a second, in hertz: 2.6 million is 2600000.0")
    kind: Kind = Field(description='"real" or "complex"')
    encoding: Encoding = Field(description='"int", "float", "sign", "sign-magnitude" or "offset-binary"')
    bits: Literal[1, 2, 4, 8, 12, 16, 32, 64] = Field(
        description="the bits of one number: 1, 2, 4, 8, 12, 16, 32 or 64; of 12, two fill three bytes"
    )
    centre_hz: float = Field(
        L1_HZ, ge=1e8, le=1e11, description="the radio frequency that lies at if_hz, in hertz: 1575420000.0 is L1"
    )
    if_hz: float = Field(0.0, description="where centre_hz lies in the samples, in hertz")
    bit_order: BitOrder = Field("msb-first", description='"msb-first" or "lsb-first"')
    byte_order: ByteOrder = Field("little", description='"little" or "big"')
    channels: int = Field(
        1,
        ge=1,
        le=MOST_CHANNELS,
        description=f"how many channels follow each other sample by sample, 1 to {MOST_CHANNELS}",
    )
    header_bytes: int = Field(0, ge=0, description="how many bytes to skip at the start, zero or more")
    swap_iq: bool = Field(False, description="true if Q comes before I, else false")
    conjugate: bool = Field(False, description="true if the spectrum is inverted (Q is negated then), else false")
    start_gpst: Annotated[np.datetime64 | None, PlainValidator(_parse_instant)] = Field(
        None, description='GPS time without a zone, as "2022-01-01T21:45:58"'
    )
    antenna: str = Field("1", min_length=1, description="the antenna's name")

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        faults = []
        if self.bits not in FITTING_BITS[self.encoding]:
            fitting = ", ".join(map(str, FITTING_BITS[self.encoding]))
            faults.append(
                f'samples.bits = {self.bits} does not go with encoding = "{self.encoding}", expected {fitting}'
            )
        if self.kind == "real" and "if_hz" not in self.model_fields_set:
            faults.append('samples.if_hz is missing, and kind = "real" needs it: give where centre_hz lies, in hertz')
        if self.kind == "real" and (self.conjugate or self.swap_iq):
            faults.append(
                'samples.conjugate and samples.swap_iq need kind = "complex"; '
                "for an inverted spectrum of real samples give a negative if_hz"
            )
        if faults:
            raise ValueError("; ".join(faults))
        return self

    @property
    def numbers(self) -> int:
        """Count the numbers of one sample: 2 if complex, else 1."""
        return self.packing.numbers

    @property
    def packing(self) -> Packing:
        """Return the packing of the bytes."""
        return Packing(
            kind=self.kind,
            encoding=self.encoding,
            bits=self.bits,
            bit_order=self.bit_order,
            byte_order=self.byte_order,
            swap_iq=self.swap_iq,
            conjugate=self.conjugate,
            n_channels=self.channels,
        )


class _Sidecar(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    samples: SampleLayout = Field(description="the table [samples]")


def read_sidecar(path: str | os.PathLike[str], **known: Any) -> SampleLayout:
    """Read the sidecar at `path`.

    Raises InputError, which names every fault: key, what came, what was expected.

    known : keys of its table that the recording itself says; stated in the sidecar that counts.
    """
    content = read_toml(
        Path(path),
        "the sidecar",
        f"a sidecar reads like {_EXAMPLE}",
        "check its name and permissions, or give another with --sidecar",
    )
    if isinstance(table := content.get("samples"), dict):
        content = {**content, "samples": {**known, **table}}
    try:
        return _Sidecar.model_validate(content).samples
    except ValidationError as error:
        raise InputError(
            f"{path}: " + "; ".join(describe_first(error.errors(include_url=False), _describe_fault))
        ) from error


def write_sidecar_text(layout: SampleLayout) -> str:
    """Write the text of a sidecar that `read_sidecar` reads back as `layout`; defaults are left out."""
    table = layout.model_dump(exclude_unset=True, exclude_none=True)
    if layout.start_gpst is not None:
        table["start_gpst"] = format_iso(layout.start_gpst, 9)  # TOML's own date-times end at the microsecond
    return f"# how to read the samples\n{tomli_w.dumps({'samples': table})}"


def _describe_fault(fault: Any) -> str:
    """Describe one fault that Pydantic found, in the words of the sidecar's writer."""
    if fault["type"] == "value_error" and len(fault["loc"]) < 2:
        return str(fault["ctx"]["error"])
    key = str(fault["loc"][-1])
    path = shorten(".".join(map(str, fault["loc"])))
    known = SampleLayout.model_fields if len(fault["loc"]) > 1 else _Sidecar.model_fields
    if fault["type"] == "extra_forbidden":
        if known is _Sidecar.model_fields and key in SampleLayout.model_fields:
            return f"{path} stands outside the table [samples]; put it below the line [samples]"
        near = difflib.get_close_matches(key[:60], known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]}?" if near else "remove it; known are " + ", ".join(known)
        return f"{path} is not a known key; {hint}"
    expected = known[key].description
    if fault["type"] == "missing":
        return f"{path} is missing; expected {expected}" + ("" if key != "samples" else f", such as {_EXAMPLE}")
    return f"{path} = {write_value(fault['input'])}, expected {expected}"


# --- the samples


def open_raw(path: str | os.PathLike[str], sidecar: str | os.PathLike[str] | None = None) -> Samples:
    """Open the first channel of a raw recording, mostly the only one: as `open_raw_channels`."""
    return open_raw_channels(path, sidecar)[0]


def open_raw_channels(
    path: str | os.PathLike[str], sidecar: str | os.PathLike[str] | None = None, *, dead: bool = False
) -> tuple[Samples, ...]:
    """Open the channels of a raw recording; nothing but a few stretches of it, for the check of levels, is read now.

    Parameters
    ----------
    path : the file of samples.
    sidecar : how to read it; NAME.toml beside NAME.bin if not given.
    dead : keep channels that never change, which say why in `dead`, so that numbers of channels stay.

    Returns
    -------
    tuple of Samples : one for each channel. `read(start, count)` gives float32, shape (2, count), planar I and Q, in
        the encoding's own numbers; it may be called from several threads. A float that is not finite is read as zero. A
        tail of less than one sample is left out and reported in `remarks`, beside what `check_levels` finds. A channel
        that never changes is left out and reported, where others do.

    Raises
    ------
    InputError : a file is missing, empty or unreadable, the sidecar is wrong, or the samples never change.
    """
    path = Path(path)
    size = measure_size(path)
    if size == 0:
        raise InputError(f"{path} is empty; check the recorder or the copy")
    sidecar = Path(sidecar) if sidecar is not None else path.with_suffix(".toml")
    if not sidecar.exists():
        if known := identify_other(read_head(path)):
            raise InputError(f"{path} looks like {known[0]}; {known[1]}")
        raise InputError(
            f"{path}: nothing says how to read it, for there is no sidecar {sidecar}; run `skyproof inspect {path}`, "
            "which finds out and can write it, or write it with the keys rate_hz, kind, encoding, bits and, where they "
            f"differ from L1 at zero frequency, centre_hz and if_hz: {_EXAMPLE}"
        )
    layout = read_sidecar(sidecar)
    packing = layout.packing
    body = size - layout.header_bytes
    n_samples = body * 8 // packing.frame_bits
    if n_samples < 1:
        raise InputError(
            f"{path}: {size} bytes hold no sample of {packing.frame_bits} bits after {layout.header_bytes} "
            f"header bytes; the file is cut, or bits, kind, channels or header_bytes of {sidecar} are wrong"
        )
    remarks = []
    if tail := body - -(-n_samples * packing.frame_bits // 8):
        remarks.append(
            Remark(
                f"the last {tail} bytes are less than one sample and left out: the file is cut, or bits, kind "
                f"or header_bytes of {sidecar.name} are wrong",
                RemarkKind.CUT,
            )
        )
    stored = FileBytes(path, layout.header_bytes, body - tail)
    packed = [PackedSamples(stored, packing, [Chunk(0, n_samples)], channel) for channel in range(layout.channels)]
    samples = samples_from_layout(
        path, layout, n_samples, packed[0], stored, format="raw", stated_in=sidecar, remarks=tuple(remarks)
    )
    stated_by = f"kind, encoding, bits, byte_order and header_bytes of {sidecar.name}"
    channels = open_channels(samples, packed, stated_by)
    return tuple(channels) if dead else drop_dead(channels)


def samples_from_layout(
    path: Path,
    layout: SampleLayout,
    n_samples: int,
    packed: PackedSamples,
    stored: FileBytes,
    *,
    format: str,
    stated_in: Path | None = None,
    remarks: tuple[str, ...] = (),
) -> Samples:
    """Describe one channel of a file as a recording, by a sidecar."""
    return Samples(
        name=make_readable(path.stem),
        rate_hz=layout.rate_hz,
        n_samples=n_samples,
        read=packed.read,
        centre_hz=layout.centre_hz,
        if_hz=math.remainder(layout.if_hz, layout.rate_hz),  # sampling folds it so
        start_gpst=layout.start_gpst,
        antenna=layout.antenna,
        path=make_readable(str(path)),
        format=format,
        remarks=remarks,
        file=stored,
        stated_in=stated_in,
    )
