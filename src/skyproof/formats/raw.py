"""Raw recordings: bare samples in a file, and a sidecar NAME.toml beside it that tells how to read them.

    [samples]
    rate_hz = 2600000.0
    centre_hz = 1575420000.0    # the radio frequency that lies at if_hz in the samples
    if_hz = 0.0
    kind = "complex"            # or "real", which needs if_hz
    encoding = "sign"           # "int" | "float" | "sign" | "sign-magnitude" | "offset-binary"
    bits = 1                    # of one number, I or Q
    bit_order = "msb-first"     # or "lsb-first": where in its byte the first number lies
    start_gpst = "2022-01-01T21:45:58"

Numbers follow each other as I0 Q0 I1 Q1 ... (real: I0 I1 ...). Those of fewer than 8 bits fill a byte from its highest
bits on (msb-first) or from its lowest bits on (lsb-first); within a number the highest bit is the most significant.

    sign            bit 0 is +1, bit 1 is -1
    sign-magnitude  highest bit is the sign (0 is +), the others the magnitude m, of value 2m + 1: 1, 3, ...
    offset-binary   code v has the value 2v - (2^bits - 1): ..., -3, -1, +1, +3, ...
    int             two's complement
    float           IEEE 754
"""

import contextlib
import dataclasses
import difflib
import functools
import hashlib
import json
import math
import os
import tomllib
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, model_validator

from skyproof.errors import InputError
from skyproof.gnss.time import GPS_EPOCH, iso, parse_iso
from skyproof.records import Samples

__all__ = ["SampleLayout", "check_levels", "open_raw", "read_sidecar", "sha256", "sidecar_text"]

Floats = NDArray[np.float32]

_BITS: Final = {
    "int": (2, 4, 8, 16, 32),
    "float": (32, 64),
    "sign": (1,),
    "sign-magnitude": (2, 4, 8, 16, 32),
    "offset-binary": (1, 2, 4, 8, 16, 32),
}
_EXAMPLE: Final = 'samples = {rate_hz = 2600000.0, kind = "complex", encoding = "int", bits = 8}'
_HASH_BLOCK: Final = 1 << 22

_STRETCHES, _STRETCH_SAMPLES = 16, 32768  # what the check of levels looks at: at most half a million samples
_DC_LIMIT = 0.05  # of the rms; above that the line at zero frequency costs acquisition more than 0.01 dB
_IMBALANCE_LIMIT_DB = 0.2
_FEW_LEVELS = 4
_SATURATED, _SATURATED_FEW_LEVELS = 0.10, 0.60
"""Shares at the extreme codes. With up to four levels a good gain control puts 30 to 40 % there, with more under 10 %
(Max, IRE Trans. Inf. Theory 6, 1960: 32 % with 4, 8 % with 8 equally spaced levels of least distortion)."""


# --- the sidecar


def _instant(value: object) -> np.datetime64:
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
    kind: Literal["real", "complex"] = Field(description='"real" or "complex"')
    encoding: Literal["int", "float", "sign", "sign-magnitude", "offset-binary"] = Field(
        description='"int", "float", "sign", "sign-magnitude" or "offset-binary"'
    )
    bits: Literal[1, 2, 4, 8, 16, 32, 64] = Field(description="the bits of one number: 1, 2, 4, 8, 16, 32 or 64")
    centre_hz: float = Field(
        1575.42e6, ge=1e8, le=1e11, description="the radio frequency that lies at if_hz, in hertz: 1575420000.0 is L1"
    )
    if_hz: float = Field(0.0, description="where centre_hz lies in the samples, in hertz")
    bit_order: Literal["msb-first", "lsb-first"] = Field("msb-first", description='"msb-first" or "lsb-first"')
    byte_order: Literal["little", "big"] = Field("little", description='"little" or "big"')
    header_bytes: int = Field(0, ge=0, description="how many bytes to skip at the start, zero or more")
    swap_iq: bool = Field(False, description="true if Q comes before I, else false")
    conjugate: bool = Field(False, description="true if the spectrum is inverted (Q is negated then), else false")
    start_gpst: Annotated[np.datetime64 | None, PlainValidator(_instant)] = Field(
        None, description='GPS time without a zone, as "2022-01-01T21:45:58"'
    )
    antenna: str = Field("1", min_length=1, description="the antenna's name")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        faults = []
        if self.bits not in _BITS[self.encoding]:
            fitting = ", ".join(map(str, _BITS[self.encoding]))
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
        """How many numbers one sample has: 2 if complex, else 1."""
        return 2 if self.kind == "complex" else 1


class _Sidecar(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    samples: SampleLayout = Field(description="the table [samples]")


def read_sidecar(path: str | os.PathLike[str]) -> SampleLayout:
    """The sidecar at `path`. Raises InputError, which names every fault: key, what came, what was expected."""
    try:
        with open(path, "rb") as file:
            content = tomllib.load(file)
        return _Sidecar.model_validate(content).samples
    except OSError as error:
        raise InputError(f"{path}: the sidecar cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; a sidecar is a text such as {_EXAMPLE}") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}; a sidecar reads like {_EXAMPLE}") from error
    except ValidationError as error:
        raise InputError(f"{path}: " + "; ".join(map(_fault, error.errors(include_url=False)))) from error


def sidecar_text(layout: SampleLayout) -> str:
    """The text of a sidecar that `read_sidecar` reads back as `layout`; keys left at their default are left out."""
    return "\n".join(
        ["# how to read the samples", "[samples]"]
        + [
            f"{key} = {_toml(getattr(layout, key))}"
            for key in type(layout).model_fields
            if key in layout.model_fields_set and getattr(layout, key) is not None
        ]
        + [""]
    )


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, np.datetime64):
        return f'"{iso(value, 9)}"'
    # TOML's basic strings are JSON's, but for the delete character, which TOML wants escaped
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _fault(fault: Any) -> str:
    """One fault that Pydantic found, in the words of the one who wrote the sidecar."""
    if fault["type"] == "value_error" and len(fault["loc"]) < 2:
        return str(fault["ctx"]["error"])
    key = str(fault["loc"][-1])
    path = ".".join(map(str, fault["loc"]))
    known = SampleLayout.model_fields if len(fault["loc"]) > 1 else _Sidecar.model_fields
    if fault["type"] == "extra_forbidden":
        if known is _Sidecar.model_fields and key in SampleLayout.model_fields:
            return f"{path} stands outside the table [samples]; put it below the line [samples]"
        near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]}?" if near else "remove it; known are " + ", ".join(known)
        return f"{path} is no known key; {hint}"
    expected = known[key].description
    if fault["type"] == "missing":
        return f"{path} is missing; expected {expected}" + ("" if key != "samples" else f", such as {_EXAMPLE}")
    return f"{path} = {_shown(fault['input'])}, expected {expected}"


def _shown(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)


# --- the samples


def open_raw(path: str | os.PathLike[str], sidecar: str | os.PathLike[str] | None = None) -> Samples:
    """Open a raw recording; nothing but a few stretches of it, for the check of levels, is read now.

    Parameters
    ----------
    path : the file of samples.
    sidecar : how to read it; NAME.toml beside NAME.bin if not given.

    Returns
    -------
    Samples : `read(start, count)` gives float32, shape (2, count), planar I and Q, in the encoding's own numbers; it
        may be called from several threads. A float that is not finite is read as zero. A tail of less than one sample
        is left out and told in `remarks`, beside what `check_levels` finds.

    Raises
    ------
    InputError : a file is missing, empty or unreadable, the sidecar is wrong, or the samples never change.
    """
    path = Path(path)
    size = _size(path)
    if size == 0:
        raise InputError(f"{path} is empty; check the recorder or the copy")
    sidecar = Path(sidecar) if sidecar is not None else path.with_suffix(".toml")
    if not sidecar.exists():
        raise InputError(
            f"{path}: nothing tells how to read it, for there is no sidecar {sidecar}; write it with the keys rate_hz, "
            f"kind, encoding, bits and, where they differ from L1 at zero frequency, centre_hz and if_hz: {_EXAMPLE}"
        )
    layout = read_sidecar(sidecar)
    body = size - layout.header_bytes
    n_samples = body * 8 // (layout.bits * layout.numbers)
    if n_samples < 1:
        raise InputError(
            f"{path}: {size} bytes hold no sample of {layout.bits * layout.numbers} bits after {layout.header_bytes} "
            f"header bytes; the file is cut, or bits, kind or header_bytes of {sidecar} are wrong"
        )
    remarks = []
    if tail := body - -(-n_samples * layout.bits * layout.numbers // 8):
        remarks.append(f"the last {tail} bytes are less than one sample and left out: the file is cut, or bits, kind "
                       f"or header_bytes of {sidecar.name} are wrong")  # fmt: skip
    with _reading(path):
        # a plain view of the map: slices of np.memmap cost microseconds each
        octets = np.asarray(np.memmap(path, np.uint8, "r", offset=layout.header_bytes, shape=(body - tail,)))
    reader = _Reader(octets, layout, n_samples)
    samples = Samples(
        name=path.stem,
        rate_hz=layout.rate_hz,
        n_samples=n_samples,
        read=reader.read,
        centre_hz=layout.centre_hz,
        if_hz=math.remainder(layout.if_hz, layout.rate_hz),  # sampling folds it so
        start_gpst=layout.start_gpst,
        antenna=layout.antenna,
        path=str(path),
        format="raw",
    )
    remarks += _finite_remarks(reader, path, sidecar) if layout.encoding == "float" else []
    return dataclasses.replace(samples, remarks=(*remarks, *check_levels(samples, kind=layout.kind)))


@dataclasses.dataclass(frozen=True, eq=False)
class _Reader:
    octets: NDArray[np.uint8]  # whole samples only
    layout: SampleLayout
    n_samples: int

    @functools.cached_property
    def tables(self) -> Floats:
        return _unpacking_tables(self.layout)

    def read(self, start: int, count: int) -> Floats:
        """Planar I and Q of `count` samples from `start` on, fewer only at the end. ValueError for less than zero."""
        planes = self.read_as_stored(start, count)
        if self.layout.encoding == "float":
            np.nan_to_num(planes, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        return planes

    def read_as_stored(self, start: int, count: int) -> Floats:
        """The same with the floats that are not finite."""
        if start < 0 or count < 0:
            raise ValueError(f"start {start} and count {count} must not be negative")
        count = max(0, min(count, self.n_samples - start))
        planes = np.zeros((2, count), np.float32) if self.layout.kind == "real" else np.empty((2, count), np.float32)
        if count and self.layout.bits < 8:
            self._unpack(start, planes)
        elif count:
            self._convert(start, planes)
        return planes

    def _unpack(self, start: int, planes: Floats) -> None:
        """Several samples a byte: whole bytes by one look-up each, what sticks out at the edges sample by sample."""
        tables = self.tables
        count, per_byte = planes.shape[1], tables.shape[2]
        head = min(-start % per_byte, count)
        n_bytes = (count - head) // per_byte
        first_byte = (start + head) // per_byte
        body = slice(head, head + n_bytes * per_byte)
        codes = self.octets[first_byte : first_byte + n_bytes].astype(np.intp)
        for table, plane in zip(tables, planes, strict=False):
            # "clip" because "raise" makes a copy of the result; a byte is never out of range
            np.take(table, codes, axis=0, out=plane[body].reshape(n_bytes, per_byte), mode="clip")
        for edge in (slice(0, head), slice(body.stop, count)):
            if edge.start < edge.stop:
                index = np.arange(start + edge.start, start + edge.stop)
                planes[: len(tables), edge] = tables[:, self.octets[index // per_byte], index % per_byte]

    def _convert(self, start: int, planes: Floats) -> None:
        """One or more bytes a number."""
        layout = self.layout
        step = layout.bits // 8 * layout.numbers
        octets = self.octets[start * step : (start + planes.shape[1]) * step]
        order = "<" if layout.byte_order == "little" else ">"
        letter = {"int": "i", "float": "f"}.get(layout.encoding, "u")
        stored = octets.view(f"{order}{letter}{layout.bits // 8}").reshape(-1, layout.numbers).T
        stored = stored[::-1] if layout.swap_iq else stored
        with np.errstate(over="ignore"):  # a float64 beyond float32 becomes infinite, and is told as such
            if letter != "u":
                planes[: layout.numbers] = stored
            elif layout.bits == 8:
                planes[: layout.numbers] = _values(np.arange(256), layout.encoding, 8)[stored]
            else:
                planes[: layout.numbers] = _values(stored.astype(np.int64), layout.encoding, layout.bits)
        if layout.conjugate:
            np.negative(planes[1], out=planes[1])


def _unpacking_tables(layout: SampleLayout) -> Floats:
    """For numbers of fewer than 8 bits: shape (numbers, 256, samples a byte), I and Q of each byte's samples."""
    per_byte = 8 // layout.bits
    place = np.arange(per_byte)
    shift = layout.bits * (place[::-1] if layout.bit_order == "msb-first" else place)
    codes = (np.arange(256)[:, np.newaxis] >> shift) & (2**layout.bits - 1)
    values = _values(codes, layout.encoding, layout.bits).reshape(256, -1, layout.numbers)
    tables = np.ascontiguousarray(values.transpose(2, 0, 1)[:: -1 if layout.swap_iq else 1])
    if layout.conjugate:
        tables[1] *= -1.0
    return tables


def _values(codes: NDArray[np.int64], encoding: str, bits: int) -> Floats:
    """What the codes 0 .. 2^bits - 1 mean, any shape."""
    half = 1 << (bits - 1)
    if encoding == "sign":
        values = 1 - 2 * codes
    elif encoding == "sign-magnitude":
        values = np.where(codes & half, -1, 1) * (2 * (codes & (half - 1)) + 1)
    elif encoding == "offset-binary":
        values = 2 * codes - (2 * half - 1)
    else:
        values = (codes ^ half) - half
    return values.astype(np.float32)


# --- is it plausible?


def check_levels(samples: Samples, *, kind: Literal["real", "complex"] = "complex") -> tuple[str, ...]:
    """What the levels of the samples tell, from at most 16 stretches spread over the recording.

    Remarks on stretches that do not change, saturation, DC offset and I/Q imbalance, in words.

    Raises
    ------
    InputError : no stretch changes at all.
    """
    stretches = [samples.read(start, count) for start, count in _stretches(samples.n_samples)]
    planes = np.concatenate(stretches, axis=1)[: 2 if kind == "complex" else 1].astype(np.float64)
    still = [bool((stretch == stretch[:, :1]).all()) for stretch in stretches]
    if all(still):
        what = "all samples are zero" if not planes.any() else f"all samples are {planes[0, 0]:g}"
        raise InputError(
            f"{samples.path or samples.name}: {what} in each of the {len(stretches)} stretches looked at; there is "
            "nothing to receive: check the recorder, and encoding, bits and header_bytes of the sidecar"
        )
    remarks = []
    if any(still):
        first_s = _stretches(samples.n_samples)[still.index(True)][0] / samples.rate_hz
        remarks.append(f"the samples do not change in {sum(still)} of {len(still)} stretches looked at, first at "
                       f"{first_s:.3f} s: the recorder left gaps, or the front end was off")  # fmt: skip
    return (*remarks, *_saturation(planes), *_offsets(planes))


def _stretches(n_samples: int) -> list[tuple[int, int]]:
    if n_samples <= _STRETCHES * _STRETCH_SAMPLES:
        return [(start, min(_STRETCH_SAMPLES, n_samples - start)) for start in range(0, n_samples, _STRETCH_SAMPLES)]
    starts = np.linspace(0, n_samples - _STRETCH_SAMPLES, _STRETCHES).astype(np.int64)
    return [(int(start), _STRETCH_SAMPLES) for start in starts]


def _saturation(planes: NDArray[np.float64]) -> list[str]:
    levels = np.unique(planes[:, :_STRETCH_SAMPLES]).size
    extreme = np.mean((planes == planes.max()) | (planes == planes.min()))
    if levels <= 2 or extreme <= (_SATURATED_FEW_LEVELS if levels <= _FEW_LEVELS else _SATURATED):
        return []
    return [f"saturated: {extreme:.0%} of the samples are at the extreme codes {planes.min():g} and {planes.max():g}; "
            "lower the gain"]  # fmt: skip


def _offsets(planes: NDArray[np.float64]) -> list[str]:
    mean, deviation = planes.mean(axis=1), planes.std(axis=1)
    names = "IQ"[: len(planes)]
    if not deviation.all():
        dead = names[int(np.argmin(deviation))]
        return [f"{dead} never changes: check kind, encoding and bits of the sidecar, and the front end"]
    offset = mean / deviation
    remarks = []
    if np.abs(offset).max() > _DC_LIMIT:
        remarks.append("DC offset " + " and ".join(f"{o:+.2f} in {n}" for o, n in zip(offset, names, strict=True))
                       + " (1 is the rms)")  # fmt: skip
    if len(planes) == 2 and abs(imbalance_db := 20.0 * np.log10(deviation[0] / deviation[1])) > _IMBALANCE_LIMIT_DB:
        remarks.append(f"I/Q imbalance {imbalance_db:+.1f} dB (I over Q)")
    return remarks


def _finite_remarks(reader: _Reader, path: Path, sidecar: Path) -> list[str]:
    planes = np.concatenate([reader.read_as_stored(*stretch) for stretch in _stretches(reader.n_samples)], axis=1)
    bad = 1.0 - np.isfinite(planes).all(axis=0).mean()
    if bad == 0.0:
        return []
    what = f"{bad:.2%} of the samples looked at are not finite numbers"
    if bad == 1.0:
        raise InputError(f"{path}: {what}; check encoding, bits and byte_order of {sidecar}")
    return [f"{what} and read as zero: check encoding, bits and byte_order of {sidecar.name}, and the recorder"]


# --- the file


def sha256(path: str | os.PathLike[str], progress: Callable[[int, int], None] | None = None) -> str:
    """SHA-256 of a file, in hexadecimal; `progress(bytes_done, bytes_in_all)` is called after every 4 MiB.

    Raises InputError if the file cannot be read.
    """
    digest = hashlib.sha256()
    done, size = 0, _size(Path(path))
    with _reading(Path(path)), open(path, "rb") as file:
        while block := file.read(_HASH_BLOCK):
            digest.update(block)
            done += len(block)
            if progress is not None:
                progress(done, size)
    return digest.hexdigest()


def _size(path: Path) -> int:
    with _reading(path):
        size = path.stat().st_size
    if not path.is_file():
        raise InputError(f"{path} is no regular file; give the file of a recording")
    return size


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"{path} does not exist; check the name and the folder") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}); check its permissions") from error
