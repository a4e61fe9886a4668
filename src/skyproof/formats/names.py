"""Read hints from a recording's name: rate, frequencies, the numbers' type, the date. Names may be wrong."""

import re
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.formats.layout import Encoding, Kind

__all__ = ["NameHints", "read_hints"]

_NUMBER: Final = r"(\d+(?:[.p]\d+)?)"
_SCALES: Final = {"k": 1e3, "m": 1e6, "g": 1e9, "": 1.0}
_CARRIERS_HZ: Final = (1.1e9, 1.7e9)
_TYPES: Final[dict[str, tuple[Encoding, int]]] = {
    "s8": ("int", 8),
    "sc8": ("int", 8),
    "cs8": ("int", 8),
    "ci8": ("int", 8),
    "int8": ("int", 8),
    "i8": ("int", 8),
    "u8": ("offset-binary", 8),
    "cu8": ("offset-binary", 8),
    "uint8": ("offset-binary", 8),
    "8u": ("offset-binary", 8),
    "s16": ("int", 16),
    "sc16": ("int", 16),
    "cs16": ("int", 16),
    "ci16": ("int", 16),
    "int16": ("int", 16),
    "i16": ("int", 16),
    "c16": ("int", 16),
    "f32": ("float", 32),
    "fc32": ("float", 32),
    "cf32": ("float", 32),
    "float32": ("float", 32),
    "cfile": ("float", 32),
    "1bit": ("sign", 1),
    "2bit": ("sign-magnitude", 2),
    "4bit": ("int", 4),
}
_COMPLEX: Final = {"iq", "complex", "cplx", "cs8", "cu8", "cs16", "sc8", "sc16", "ci8", "ci16", "cf32", "fc32", "cfile"}
_REAL: Final = {"i", "real"}


@dataclass(frozen=True, kw_only=True)
class NameHints:
    """What a name says; None where it is silent. start_utc : if the date in it is UTC."""

    rate_hz: float | None = None
    if_hz: float | None = None
    centre_hz: float | None = None
    kind: Kind | None = None
    encoding: Encoding | None = None
    bits: int | None = None
    start_utc: np.datetime64 | None = None


def read_hints(name: str) -> NameHints:
    """Read the hints in a file's name, ending included."""
    text = name.lower()
    rate_hz = if_hz = centre_hz = None
    if found := re.search(rf"(?:^|[^a-z])if[_=-]?(-?){_NUMBER}\s*([kmg]?)(?:hz)?", text):
        if_hz = round(float(f"{found[1]}{_parse_value(found[2])}") * _find_scale(found[3], _parse_value(found[2])), 3)
        text = text.replace(found[0], "_")
    for found in re.finditer(rf"(?<![\d.]){_NUMBER}\s*([kmg]?)hz", text):
        value_hz = round(_parse_value(found[1]) * _SCALES[found[2]], 3)
        if _CARRIERS_HZ[0] < value_hz < _CARRIERS_HZ[1]:
            centre_hz = value_hz
            text = text.replace(found[0], "_")
    for pattern in (
        rf"(?:fs|rate|sr)[_=-]?{_NUMBER}\s*([kmg]?)(?:hz|sps|s)?",
        rf"(?<![\d.]){_NUMBER}\s*([kmg])(?:sps|s/s|samp|hz|s(?![a-z]))",
    ):
        if found := re.search(pattern, text):
            value = _parse_value(found[1])
            value_hz = round(value * _find_scale(found[2], value), 3)
            if 1e6 <= value_hz <= 1e9:
                rate_hz = value_hz
                break
    words = re.split(r"[^a-z0-9]+", text)
    kind: Kind | None = "complex" if _COMPLEX & {*words} else "real" if _REAL & {*words} else None
    encoding, bits = next((_TYPES[word] for word in words if word in _TYPES), (None, None))
    return NameHints(
        rate_hz=rate_hz,
        if_hz=if_hz,
        centre_hz=centre_hz,
        kind=kind,
        encoding=encoding,
        bits=bits,
        start_utc=_start(text),
    )


def _parse_value(text: str) -> float:
    return float(text.replace("p", "."))


def _find_scale(letter: str, value: float) -> float:
    """Scale a number by its letter; a bare one below a thousand is in megahertz."""
    return _SCALES[letter] if letter else 1e6 if value < 1000.0 else 1.0


def _start(text: str) -> np.datetime64 | None:
    found = re.search(r"(?<!\d)(20\d\d)-?(\d\d)-?(\d\d)[t_ -]?(\d\d)[:_-]?(\d\d)[:_-]?(\d\d)(?!\d)", text)
    if not found:
        return None
    year, month, day, hour, minute, second = found.groups()
    try:
        return np.datetime64(f"{year}-{month}-{day}T{hour}:{minute}:{second}", "ns")
    except ValueError:
        return None
