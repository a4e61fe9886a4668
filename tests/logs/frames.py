"""Frames of every protocol made from their standards, for tests of what reads them."""

from collections.abc import Iterable, Mapping

import numpy as np

__all__ = [
    "chain_bits",
    "make_msm_message",
    "make_nmea_sentence",
    "make_rtcm3_frame",
    "make_sbf_block",
    "make_ubx_frame",
    "reseal",
]

MSM_CELL_BITS = {4: (15, 22, 4, 1, 6), 5: (15, 22, 4, 1, 6, 15), 6: (20, 24, 10, 1, 10), 7: (20, 24, 10, 1, 10, 15)}
"""Fine code, fine phase, lock time, half cycle, C/N0, fine rate."""


def make_ubx_frame(message_class: int, message_id: int, payload: bytes) -> bytes:
    """Return a UBX frame with its Fletcher checksum."""
    body = bytes([message_class, message_id]) + len(payload).to_bytes(2, "little") + payload
    a = b = 0
    for octet in body:
        a = (a + octet) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + body + bytes([a, b])


def make_sbf_block(number: int, payload: bytes, revision: int = 0) -> bytes:
    """Return an SBF block, padded to whole words, with its CRC-CCITT."""
    payload += bytes(-len(payload) % 4)
    length = 8 + len(payload)
    body = (number | revision << 13).to_bytes(2, "little") + length.to_bytes(2, "little") + payload
    return b"$@" + _compute_crc(body, 0x1021, 16).to_bytes(2, "little") + body


def make_rtcm3_frame(content: bytes) -> bytes:
    """Return an RTCM 3 frame with its CRC-24Q."""
    body = b"\xd3" + len(content).to_bytes(2, "big") + content
    return body + _compute_crc(body, 0x864CFB, 24).to_bytes(3, "big")


def chain_bits(fields: Iterable[tuple[int, int]]) -> bytes:
    """Return numbers, each with its length in bits, one after the other, filled up to whole octets."""
    value = length = 0
    for number, bits in fields:
        value = value << bits | number % (1 << bits)
        length += bits
    return (value << -length % 8).to_bytes((length + 7) // 8, "big")


def make_msm_message(
    number: int,
    time: int,
    sats: Mapping[int, tuple[int, int, int, int]],
    cells: Mapping[tuple[int, int], tuple[int, ...]],
    *,
    station: int = 9,
    more: bool = False,
) -> bytes:
    """Return a frame of MSM4 to MSM7 of raw field values.

    time : the 30 bits of the epoch, of which `more` messages follow. sats : whole ms, extended information, ms / 1024,
    rate in m/s by bit of the mask. cells : the numbers of `MSM_CELL_BITS` by satellite and signal.
    """
    kind = number % 10
    signals = sorted({signal for _, signal in cells})
    fields = [(number, 12), (station, 12), (time, 30), (int(more), 1), (0, 3), (0, 7), (0, 2), (0, 2), (0, 1), (0, 3)]
    fields += [(int(k + 1 in sats), 1) for k in range(64)] + [(int(k + 1 in signals), 1) for k in range(32)]
    fields += [(int((sat, signal) in cells), 1) for sat in sorted(sats) for signal in signals]
    for column, bits in ((0, 8), (1, 4), (2, 10), (3, 14)):
        if kind in (5, 7) or column in (0, 2):
            fields += [(sats[sat][column], bits) for sat in sorted(sats)]
    for column, bits in enumerate(MSM_CELL_BITS[kind]):
        fields += [(cells[cell][column], bits) for cell in sorted(cells)]
    return make_rtcm3_frame(chain_bits(fields))


def make_nmea_sentence(text: str) -> bytes:
    """Return an NMEA sentence with its checksum and line end."""
    total = int(np.bitwise_xor.reduce(np.frombuffer(text.encode(), np.uint8)))
    return f"${text}*{total:02X}\r\n".encode()


def reseal(octets: bytes) -> bytes:
    """Return a stream in which the checksum of every whole binary frame holds, whatever stands in the frame."""
    sealed, k = bytearray(octets), 0
    while k + 8 <= len(sealed):
        if sealed[k : k + 2] == b"\xb5b":
            end = k + 8 + int.from_bytes(sealed[k + 4 : k + 6], "little")
            whole = make_ubx_frame(sealed[k + 2], sealed[k + 3], bytes(sealed[k + 6 : end - 2]))
        elif sealed[k : k + 2] == b"$@":
            end = k + int.from_bytes(sealed[k + 6 : k + 8], "little")
            body = bytes(sealed[k + 4 : end])
            whole = b"$@" + _compute_crc(body, 0x1021, 16).to_bytes(2, "little") + body
        elif sealed[k] == 0xD3 and sealed[k + 1] < 4:
            end = k + 6 + int.from_bytes(sealed[k + 1 : k + 3], "big")
            whole = make_rtcm3_frame(bytes(sealed[k + 3 : end - 3]))
        else:
            k += 1
            continue
        if not k + 8 <= end <= len(sealed) or len(whole) != end - k:
            k += 1
            continue
        sealed[k:end] = whole
        k = end
    return bytes(sealed)


def _compute_crc(body: bytes, polynomial: int, bits: int) -> int:
    """Return a cyclic checksum, a bit at a time."""
    value = 0
    for octet in body:
        value ^= octet << (bits - 8)
        for _ in range(8):
            value = value << 1 ^ (polynomial if value >> (bits - 1) & 1 else 0)
            value &= (1 << bits) - 1
    return value
