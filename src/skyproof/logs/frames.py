"""Frames in a receiver's byte stream: UBX, SBF, RTCM 3 and NMEA, mixed as they come, each with its checksum.

UBX: u-blox interface descriptions, "UBX frame structure" and "UBX checksum". SBF: Septentrio reference guides, "SBF
block header" (CRC-CCITT). RTCM 3: RTCM 10403.3, section 4 (CRC-24Q). NMEA: NMEA 0183, 5.3 (exclusive or).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Integers, Octets
from skyproof.compiled import compiled
from skyproof.records import freeze

__all__ = ["Frames", "Protocol", "read_blocks", "read_field", "split_frames"]

_BLOCK_BYTES: Final = 1 << 22
_LONGEST_UBX: Final = 1 << 13
"""Payload bytes. The longest message that is read, RXM-RAWX of 255 signals, has 8176."""
_LONGEST_NMEA: Final = 1000


class Protocol(IntEnum):
    """Which protocol a frame belongs to."""

    UBX = 1
    SBF = 2
    RTCM3 = 3
    NMEA = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames:
    """Whole frames of a stretch of a stream, in order, whose checksums hold.

    octets : (n_octets,) of the stretch. protocol, begin, length : (n_frames,) kind, first octet and size of each frame,
    header and checksum included. damaged : frames that failed, stretches of other bytes not counted.
    at : octet of the stream at which the stretch begins. last : nothing follows. cut : the stream ends inside a frame.
    """

    octets: Octets
    protocol: Integers
    begin: Integers
    length: Integers
    damaged: int
    at: int
    last: bool = False
    cut: bool = False

    def __post_init__(self) -> None:
        freeze(self, {"octets": ("octet",)} | dict.fromkeys(("protocol", "begin", "length"), ("frame",)))

    def select(self, protocol: Protocol) -> tuple[Integers, Integers]:
        """Return first octet and size of the frames of one protocol."""
        chosen = self.protocol == protocol
        return self.begin[chosen], self.length[chosen]


def split_frames(blocks: Iterable[bytes]) -> Iterator[Frames]:
    """Split a stream into frames, stretch by stretch; a frame that a block cuts goes to the next stretch.

    Bytes between frames are skipped. Where a checksum fails the search continues one byte later, so that a damaged
    length costs one frame.
    """
    rest, at = np.empty(0, np.uint8), 0
    gathered: list[bytes] = []
    n_gathered = 0
    for block in blocks:
        gathered.append(block)
        n_gathered += len(block)
        if n_gathered >= _BLOCK_BYTES:
            frames, used = _split(np.concatenate([rest, np.frombuffer(b"".join(gathered), np.uint8)]), at, last=False)
            yield frames
            rest, at = frames.octets[used:], at + used
            gathered, n_gathered = [], 0
    frames, _ = _split(np.concatenate([rest, np.frombuffer(b"".join(gathered), np.uint8)]), at, last=True)
    yield frames


def read_field(octets: Octets, first: Integers, offset: int, kind: str) -> NDArray[Any]:
    """Return one number, of a NumPy kind such as "<u2", of each payload that begins at the octets `first`."""
    return read_blocks(octets, first + offset, np.dtype(kind))


def read_blocks(octets: Octets, begin: Integers, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the records (n,) of a packed type that begin at these octets."""
    gathered = np.empty((begin.size, dtype.itemsize), np.uint8)
    _gather(octets, begin, gathered)
    return gathered.reshape(-1).view(dtype)


@compiled
def _gather(octets: Octets, begin: Integers, gathered: Octets) -> None:
    for k in range(begin.size):
        for i in range(gathered.shape[1]):
            gathered[k, i] = octets[begin[k] + i]


def _split(octets: Octets, at: int, *, last: bool) -> tuple[Frames, int]:
    """Return the frames of a stretch, and how many of its octets are done with."""
    room = octets.size // 6 + 1  # the shortest frame, of RTCM 3 without content
    found = np.empty((3, room), np.int64)
    n_frames, used, damaged, cut = _scan(octets, last, _CRC_CCITT, _CRC_24Q, found)
    protocol, begin, length = found[:, :n_frames].copy()
    frames = Frames(
        octets=octets,
        protocol=protocol,
        begin=begin,
        length=length,
        damaged=int(damaged),
        at=at,
        last=last,
        cut=bool(cut),
    )
    return frames, int(used)


def _crc_table(polynomial: int, bits: int) -> Integers:
    """Return the 256 remainders by which a cyclic checksum advances a byte at a time."""
    top, mask = 1 << (bits - 1), (1 << bits) - 1
    table = np.empty(256, np.int64)
    for octet in range(256):
        value = octet << (bits - 8)
        for _ in range(8):
            value = (value << 1) ^ (polynomial if value & top else 0)
        table[octet] = value & mask
    return table


_CRC_CCITT: Final = _crc_table(0x1021, 16)
_CRC_24Q: Final = _crc_table(0x864CFB, 24)


@compiled
def _scan(octets: Octets, last: bool, ccitt: Integers, crc24q: Integers, found: Integers) -> tuple[int, int, int, bool]:
    """Fill `found` with protocol, first octet and size of each frame.

    Returns how many there are, how many octets are done with, how many frames are damaged, and whether the last one is
    cut.
    """
    size, k = octets.size, 0
    n_frames, damaged, cut = 0, 0, False
    while k < size:
        first = octets[k]
        kind, header = 0, 0
        if first == 0xB5:
            kind, header = 1, 6
        elif first == 0xD3:
            kind, header = 3, 3
        elif first == 0x24:  # $
            kind, header = 4, 2
        if kind == 0:
            k += 1
            continue
        if k + header > size:
            if last:
                k += 1
                continue
            break
        if kind == 4 and octets[k + 1] == 0x40:  # $@
            kind, header = 2, 8
            if k + header > size:
                if last:
                    cut = True
                    k += 1
                    continue
                break
        length, good, whole = 0, False, True
        if kind == 1:
            if octets[k + 1] == 0x62:
                length = 8 + octets[k + 4] + 256 * octets[k + 5]
                if length > 8 + _LONGEST_UBX:
                    length = 0
        elif kind == 2:
            length = octets[k + 6] + 256 * octets[k + 7]
            if length % 4 or length < 8:
                length = 0
        elif kind == 3:
            if octets[k + 1] & 0xFC == 0:
                length = 6 + (octets[k + 1] & 3) * 256 + octets[k + 2]
        elif 0x41 <= octets[k + 1] <= 0x5A:
            end = k + 1
            stop = min(size, k + _LONGEST_NMEA)
            while end < stop and 0x20 <= octets[end] < 0x7F and octets[end] != 0x24:
                end += 1
            if end == size:
                whole = False
                length = end - k
            elif octets[end] == 0x0D or octets[end] == 0x0A:
                length = end - k
        if length == 0:
            k += 1
            continue
        if kind != 4:
            whole = k + length <= size
        if not whole:
            if not last:
                break
            cut = True
            k += 1
            continue
        if kind == 1:
            a, b = 0, 0
            for i in range(k + 2, k + length - 2):
                a = (a + octets[i]) & 0xFF
                b = (b + a) & 0xFF
            good = a == octets[k + length - 2] and b == octets[k + length - 1]
        elif kind == 2:
            crc = 0
            for i in range(k + 4, k + length):
                crc = ((crc << 8) & 0xFFFF) ^ ccitt[(crc >> 8) ^ octets[i]]
            good = crc == octets[k + 2] + 256 * octets[k + 3]
        elif kind == 3:
            crc = 0
            for i in range(k, k + length - 3):
                crc = ((crc << 8) & 0xFFFFFF) ^ crc24q[(crc >> 16) ^ octets[i]]
            sent = octets[k + length - 3] * 65536 + octets[k + length - 2] * 256 + octets[k + length - 1]
            good = crc == sent
        else:
            good = _nmea_holds(octets, k, k + length)
        if good:
            found[0, n_frames], found[1, n_frames], found[2, n_frames] = kind, k, length
            n_frames += 1
            k += length
            cut = False
        else:
            # A lone 0xD3 or a dollar sign in other bytes is no frame: what fails counts where its header is complete.
            damaged += kind != 3 or length > 6
            k += 1
    return n_frames, min(k, size), damaged, cut


@compiled
def _nmea_holds(octets: Octets, begin: int, end: int) -> bool:
    """Tell whether a sentence has a checksum that holds; one without is taken where it has a comma."""
    total, comma = 0, False
    for i in range(begin + 1, end):
        if octets[i] == 0x2A:  # *
            if end - i < 3:
                return False
            high, low = _digit(octets[i + 1]), _digit(octets[i + 2])
            return bool(high >= 0 and low >= 0 and total == 16 * high + low)
        total ^= octets[i]
        comma |= octets[i] == 0x2C
    return comma


@compiled
def _digit(octet: int) -> int:
    """Return the value of a hexadecimal digit, -1 for another sign."""
    if 0x30 <= octet <= 0x39:
        return octet - 0x30
    if 0x41 <= octet <= 0x46:
        return octet - 0x37
    if 0x61 <= octet <= 0x66:
        return octet - 0x57
    return -1
