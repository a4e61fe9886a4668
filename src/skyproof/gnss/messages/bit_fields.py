"""Numbers in the bits of a message, each named by its place."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from skyproof.gnss.constants import GPS_PI

__all__ = [
    "EPHEMERIS_NAMES",
    "BitField",
    "Words",
    "angle_options",
    "chain_fields",
    "compute_crc_24q",
    "magnitude_options",
    "read_fields",
    "sign_options",
]

Words = Mapping[int, Mapping[str, float]]
"""What words, pages, subframes or strings of one satellite carry, by their number."""

EPHEMERIS_NAMES: Final = (
    *("toe", "toc", "af0", "af1", "af2", "tgd", "tgd2", "sqrt_a", "e", "i0", "omega0", "omega", "m0", "delta_n"),
    *("idot", "omega_dot", "crs", "crc", "cus", "cuc", "cis", "cic"),
)
"""Fields of `Ephemeris` that a message gives unchanged."""


@dataclass(frozen=True)
class BitField:
    """A number in a frame: runs of (first bit, length), the first bit of the frame being 0, most significant first.

    scale : of the least significant bit. signed : in two's complement. magnitude : a sign bit before a magnitude, as
    GLONASS has it. angle : semicircles in the message, radians outside.
    """

    name: str
    runs: tuple[tuple[int, int], ...]
    scale: float = 1.0
    signed: bool = False
    magnitude: bool = False
    angle: bool = False

    def value(self, frame: int, n_bits: int) -> float:
        """Return this field of a frame of `n_bits`, which is an integer whose highest bit comes first."""
        raw = length = 0
        for first, size in self.runs:
            raw = raw << size | frame >> (n_bits - first - size) & (1 << size) - 1
            length += size
        top = 1 << (length - 1)
        if self.magnitude:
            raw = -(raw - top) if raw & top else raw
        elif self.signed and raw & top:
            raw -= top << 1
        whole = self.scale == 1.0 and not self.angle
        return raw if whole else raw * self.scale * (GPS_PI if self.angle else 1.0)


def chain_fields(first: int, *fields: tuple[str, int] | tuple[str, int, dict[str, Any]]) -> tuple[BitField, ...]:
    """Return fields that follow each other from a bit on: name, length, and what else `BitField` takes."""
    chained = []
    for name, length, *more in fields:
        chained.append(BitField(name, ((first, length),), **(more[0] if more else {})))
        first += length
    return tuple(chained)


def sign_options(scale: float) -> dict[str, Any]:
    """Return what makes a field one in two's complement."""
    return {"scale": scale, "signed": True}


def angle_options(scale: float) -> dict[str, Any]:
    """Return what makes a field a signed angle in semicircles."""
    return {"scale": scale, "signed": True, "angle": True}


def magnitude_options(scale: float) -> dict[str, Any]:
    """Return what makes a field a magnitude behind a sign bit."""
    return {"scale": scale, "magnitude": True}


def read_fields(fields: tuple[BitField, ...], frame: int, n_bits: int) -> Mapping[str, float]:
    """Return the numbers of a frame by their names."""
    return {field.name: field.value(frame, n_bits) for field in fields}


_CRC_24Q: Final = 0x1864CFB


def compute_crc_24q(bits: int, n_bits: int) -> int:
    """Return the remainder of so many bits (IS-GPS-200N, 30.3.5; Galileo OS SIS ICD 2.1, 4.3.2.3)."""
    value = bits << 24
    for k in range(n_bits + 23, 23, -1):
        if value >> k & 1:
            value ^= _CRC_24Q << (k - 24)
    return value
