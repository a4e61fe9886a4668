"""Frames of every protocol made from their standards, for tests of what reads them."""

import numpy as np

__all__ = ["nmea_sentence", "rtcm3_frame", "sbf_block", "ubx_frame"]


def ubx_frame(message_class: int, message_id: int, payload: bytes) -> bytes:
    """Return a UBX frame with its Fletcher checksum."""
    body = bytes([message_class, message_id]) + len(payload).to_bytes(2, "little") + payload
    a = b = 0
    for octet in body:
        a = (a + octet) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + body + bytes([a, b])


def sbf_block(number: int, payload: bytes, revision: int = 0) -> bytes:
    """Return an SBF block, padded to whole words, with its CRC-CCITT."""
    payload += bytes(-len(payload) % 4)
    length = 8 + len(payload)
    body = (number | revision << 13).to_bytes(2, "little") + length.to_bytes(2, "little") + payload
    return b"$@" + _crc(body, 0x1021, 16).to_bytes(2, "little") + body


def rtcm3_frame(content: bytes) -> bytes:
    """Return an RTCM 3 frame with its CRC-24Q."""
    body = b"\xd3" + len(content).to_bytes(2, "big") + content
    return body + _crc(body, 0x864CFB, 24).to_bytes(3, "big")


def nmea_sentence(text: str) -> bytes:
    """Return an NMEA sentence with its checksum and line end."""
    total = int(np.bitwise_xor.reduce(np.frombuffer(text.encode(), np.uint8)))
    return f"${text}*{total:02X}\r\n".encode()


def _crc(body: bytes, polynomial: int, bits: int) -> int:
    """Return a cyclic checksum, a bit at a time."""
    value = 0
    for octet in body:
        value ^= octet << (bits - 8)
        for _ in range(8):
            value = value << 1 ^ (polynomial if value >> (bits - 1) & 1 else 0)
            value &= (1 << bits) - 1
    return value
