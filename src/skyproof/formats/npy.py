"""Open recordings in one NumPy file, NAME.npy: its type says how numbers are stored, its shape the channels.

The longer axis of the array is time, the other one, if there is one, the channels; so (24, 1047552) and (1047552, 24)
are both 24 channels. Complex numbers are I and Q; of integers and floats each is a real sample. What is not in the file
stands in a sidecar NAME.toml beside it:

    [samples]
    rate_hz = 16368000.0
    if_hz = 4092000.0
    start_gpst = "2022-01-01T21:45:58"

where kind, encoding, bits and byte_order need not be stated. Stated they count, for bytes (uint8, int8) alone: so an
array of bytes may hold packed numbers (kind = "real", encoding = "sign", bits = 1), each row one channel.

Format: NEP 1, "A Simple File Format for NumPy Arrays", versions 1.0 to 3.0.
"""

import os
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.lib import format as npy_format

from skyproof.errors import InputError, make_readable
from skyproof.formats.byte_io import FileBytes, measure_size
from skyproof.formats.layout import FITTING_BITS, Chunk, Encoding, Kind, PackedSamples
from skyproof.formats.levels import drop_dead, open_channels
from skyproof.formats.raw import MOST_CHANNELS, read_sidecar, samples_from_layout
from skyproof.records import Samples

__all__ = ["open_npy"]

_LONGEST_HEADER: Final = 1 << 16
_STORED: Final[Mapping[str, tuple[Kind, Encoding]]] = {
    "i": ("real", "int"),
    "u": ("real", "offset-binary"),
    "f": ("real", "float"),
    "c": ("complex", "float"),
}
"""Kind of number to kind and encoding of samples."""


class _Stored(NamedTuple):
    """What a file's header says. by_row : each channel's samples follow each other."""

    dtype: np.dtype[Any]
    header_bytes: int
    channels: int
    length: int
    by_row: bool


def open_npy(
    path: str | os.PathLike[str], sidecar: str | os.PathLike[str] | None = None, *, dead: bool = False
) -> tuple[Samples, ...]:
    """Open the channels of a NumPy file, as `open_raw_channels` opens those of a raw one.

    Raises
    ------
    InputError : as `open_raw_channels`; the file is no array of numbers, has more axes than two, or is cut.
    """
    path = Path(path)
    size = measure_size(path)
    stored = _read_header(path, size)
    sidecar = Path(sidecar) if sidecar is not None else path.with_suffix(".toml")
    if not sidecar.exists():
        raise InputError(
            f"{path}: nothing states its rate, for there is no sidecar {sidecar}; write it: "
            "samples = {rate_hz = 16368000.0, if_hz = 4092000.0}"
        )
    layout = read_sidecar(sidecar, **_layout_from_type(stored.dtype))
    if layout.channels != 1 or layout.header_bytes:
        raise InputError(f"{sidecar}: channels and header_bytes are those of {path.name} itself; leave them out")
    packed_bits = layout.bits * layout.packing.numbers
    item_bits = 8 * stored.dtype.itemsize
    if packed_bits != item_bits and (item_bits != 8 or not (stored.by_row or stored.channels == 1)):
        raise InputError(
            f"{sidecar}: samples of {packed_bits} bits, but {path.name} holds {stored.dtype} in shape "
            f"{'(channels, samples)' if stored.by_row else '(samples, channels)'}; leave kind, encoding and bits out, "
            "or give bytes (uint8) in shape (channels, bytes)"
        )
    n_samples = stored.length * item_bits // packed_bits
    row_bytes = stored.length * stored.dtype.itemsize
    octets = FileBytes(path, stored.header_bytes, stored.channels * row_bytes)
    if stored.by_row:
        chunks = [(layout.packing, Chunk(row * row_bytes, n_samples), 0) for row in range(stored.channels)]
    else:
        woven = layout.model_copy(update={"channels": stored.channels}).packing
        chunks = [(woven, Chunk(0, n_samples), channel) for channel in range(stored.channels)]
    packed = [PackedSamples(octets, packing, [chunk], channel) for packing, chunk, channel in chunks]
    samples = samples_from_layout(path, layout, n_samples, packed[0], octets, format="NumPy", stated_in=sidecar)
    channels = open_channels(samples, packed, f"{sidecar.name} and the array in {path.name}")
    return tuple(channels) if dead else drop_dead(channels)


def _read_header(path: Path, size: int) -> _Stored:
    """Read the header before the numbers."""
    head = BytesIO(FileBytes(path, 0, size)[: min(size, _LONGEST_HEADER)].tobytes())
    try:
        version = npy_format.read_magic(head)
        read = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, fortran, dtype = read(head)
    except ValueError as error:
        raise InputError(
            f"{make_readable(str(path))}: not a NumPy file ({make_readable(str(error))}); save it again"
        ) from None
    if (
        dtype.kind not in _STORED
        or _layout_from_type(dtype)["bits"] not in FITTING_BITS[_layout_from_type(dtype)["encoding"]]
    ):
        raise InputError(
            f"{path}: an array of {dtype}, expected integers of 8 to 32 bits, floats of 32 or 64, or complex numbers"
        )
    if len(shape) not in (1, 2) or 0 in shape:
        raise InputError(f"{path}: an array of shape {shape}, expected (samples,), (channels, samples) or the reverse")
    channels, length = (1, shape[0]) if len(shape) == 1 else (min(shape), max(shape))
    if channels > MOST_CHANNELS:
        raise InputError(f"{path}: an array of shape {shape}, expected at most {MOST_CHANNELS} channels")
    first_is_time = len(shape) == 1 or shape[0] == length
    needed = head.tell() + channels * length * dtype.itemsize
    if size < needed:
        raise InputError(f"{path}: {size} bytes, but its header announces {needed}; the file is cut, copy it again")
    return _Stored(dtype, head.tell(), channels, length, by_row=first_is_time == bool(fortran) or channels == 1)


def _layout_from_type(dtype: np.dtype[Any]) -> dict[str, Any]:
    """Return the keys of a layout that a type stands for."""
    kind, encoding = _STORED[dtype.kind]
    bits = 8 * dtype.itemsize // (2 if kind == "complex" else 1)
    return {
        "kind": kind,
        "encoding": encoding,
        "bits": bits,
        "byte_order": "big" if dtype.byteorder == ">" else "little",
    }
