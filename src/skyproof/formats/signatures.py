"""Tell what a file is by its first bytes: name files without samples, and read WAV headers."""

import string
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from skyproof.formats.byte_io import report_reading
from skyproof.formats.layout import Encoding

__all__ = ["HEAD", "WavHeader", "identify_other", "read_head", "read_wav_header"]

HEAD: Final = 4096
"""Bytes that are looked at."""

_UNPACK: Final = "unpack it and give the recording in it"
_NAV: Final = "it holds no samples: `skyproof protect` takes it as --nav"
_SAMPLES: Final = "it holds no samples: give the recording itself"
_OBSERVED: Final = "it holds measurements, not samples: `skyproof protect` takes it as an input"
_SIGNATURES: Final[tuple[tuple[int, bytes, str, str], ...]] = (
    (0, b"PK\x03\x04", "a ZIP archive", _UNPACK),
    (0, b"\x1f\x8b", "a gzip file", _UNPACK),
    (0, b"\x1f\x9d", "a file packed by `compress` (.Z)", _UNPACK),
    (0, b"BZh", "a bzip2 file", _UNPACK),
    (0, b"\xfd7zXZ\x00", "an xz file", _UNPACK),
    (0, b"\x28\xb5\x2f\xfd", "a zstd file", _UNPACK),
    (0, b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", _UNPACK),
    (0, b"Rar!\x1a\x07", "a RAR archive", _UNPACK),
    (257, b"ustar", "a tar archive", _UNPACK),
    (0, b"\x89PNG\r\n\x1a\n", "a picture (PNG)", _SAMPLES),
    (0, b"\xff\xd8\xff", "a picture (JPEG)", _SAMPLES),
    (0, b"GIF8", "a picture (GIF)", _SAMPLES),
    (0, b"%PDF-", "a PDF document", _SAMPLES),
    (0, b"\x7fELF", "a program", _SAMPLES),
    (0, b"MZ\x90\x00", "a program", _SAMPLES),
    (0, b"SQLite format 3\x00", "an SQLite database", _SAMPLES),
    (0, b"PAR1", "a Parquet table", _SAMPLES),
    (0, b"\x89HDF\r\n\x1a\n", "an HDF5 file", "write its samples as a plain file (numpy's `tofile`) and give that"),
    (0, b"MATLAB 5.0", "a MATLAB file", "write its samples as a plain file (`fwrite`) and give that"),
    (0, b"\x93NUMPY", "a NumPy array", "write its samples as a plain file (numpy's `tofile`) and give that"),
    (0, b"fLaC", "FLAC audio", "convert it to WAV and give that"),
    (0, b"ID3", "MP3 audio", _SAMPLES),
    (4, b"ftyp", "a video", _SAMPLES),
)
_PRINTABLE: Final = frozenset(string.printable.encode()) - {0x0B, 0x0C}
_UBX: Final = b"\xb5\x62"


@dataclass(frozen=True, kw_only=True)
class WavHeader:
    """Of a RIFF file of sound: its samples begin after `header_bytes` and take `data_bytes`."""

    rate_hz: float
    channels: int
    encoding: Encoding
    bits: int
    header_bytes: int
    data_bytes: int


def read_head(path: Path) -> bytes:
    """Read the first bytes of a file. Raises InputError if it cannot be read."""
    with report_reading(path), open(path, "rb") as file:
        return file.read(HEAD)


def identify_other(head: bytes) -> tuple[str, str] | None:
    """Name a file that is known to hold no bare samples, by its first bytes, and say what to do with it."""
    for at, signature, name, to_do in _SIGNATURES:
        if head[at:].startswith(signature):
            return name, to_do
    if head.startswith(_UBX):
        return "a UBX stream of a receiver", _SAMPLES
    if head.startswith(b"$G"):
        return "NMEA sentences of a receiver", _SAMPLES
    if _is_rtcm(head):
        return "an RTCM 3 stream", _SAMPLES
    if _is_utf_16(head):
        return "text in UTF-16", "save it in UTF-8"
    return _identify_text(head) if _is_text(head) else None


def _is_rtcm(head: bytes) -> bool:
    """Test for two frames of 0xD3, six zero bits and ten bits of length, one after the other."""
    at = 0
    for _ in range(3):
        if len(head) < at + 3 or head[at] != 0xD3 or head[at + 1] & 0xFC:
            return False
        at += 6 + ((head[at + 1] & 3) << 8 | head[at + 2])
    return True


def _is_utf_16(head: bytes) -> bool:
    """Test for a byte order mark of UTF-16 before text with nearly every other byte zero."""
    if head[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        return False
    high = head[3::2] if head[0] == 0xFF else head[2::2]
    return len(high) > 4 and high.count(0) > 0.9 * len(high)


def _is_text(head: bytes) -> bool:
    if len(head) < 16:
        return bool(head) and all(octet in _PRINTABLE for octet in head)
    try:
        head[:-3].decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 8:
            return False
    return sum(octet in _PRINTABLE or octet > 0x7F for octet in head) >= 0.99 * len(head)


def _identify_text(head: bytes) -> tuple[str, str]:
    first = head.split(b"\n", 1)[0]
    if b"RINEX VERSION" in first:
        return ("a RINEX navigation file", _NAV) if b"NAV" in first.upper() else ("a RINEX observation file", _OBSERVED)
    if b"CRINEX VERS" in first:
        return "a compressed RINEX observation file", _OBSERVED
    if b"[samples]" in head:
        return "a sidecar", "it states how to read samples: give the recording that it stands beside"
    if b"core:datatype" in head:
        return "SigMF metadata", "name it NAME.sigmf-meta beside NAME.sigmf-data and give that"
    return "text", _SAMPLES


def read_wav_header(head: bytes) -> WavHeader | None:
    """Read the header of a WAV file (RIFF, "Multimedia Programming Interface", 1991; RF64, EBU Tech 3306).

    None if it is none, or one whose samples are compressed.
    """
    if head[:4] not in (b"RIFF", b"RF64") or head[8:12] != b"WAVE":
        return None
    at, stated = 12, None
    while at + 8 <= len(head):
        name, size = head[at : at + 4], struct.unpack_from("<I", head, at + 4)[0]
        if name == b"fmt " and at + 24 <= len(head):
            code, channels, rate_hz, _, _, bits = struct.unpack_from("<HHIIHH", head, at + 8)
            if code == 0xFFFE and at + 34 <= len(head):  # extensible: the code stands in the first bytes of a GUID
                code = struct.unpack_from("<H", head, at + 32)[0]
            # whole numbers of 8 bits are stored from 0 to 255, wider ones in two's complement
            kind: Encoding | None = {1: "offset-binary" if bits == 8 else "int", 3: "float"}.get(code)
            if kind is None or channels not in (1, 2) or bits not in (8, 16, 32, 64):
                return None
            stated = (float(rate_hz), int(channels), kind, int(bits))
        elif name == b"data" and stated is not None:
            return WavHeader(
                rate_hz=stated[0],
                channels=stated[1],
                encoding=stated[2],
                bits=stated[3],
                header_bytes=at + 8,
                data_bytes=size,
            )
        at += 8 + size + size % 2
    return None
