"""Read the broadcast messages that a phone writes: bits of whole frames of each kind."""

from typing import Any, Final

import numpy as np

from skyproof.arrays import Booleans, Instants, Integers, Octets
from skyproof.gnss.lnav import check_words
from skyproof.logs.content import FRAME_BITS, BroadcastFrames, MessageKind
from skyproof.records import SignalId

__all__ = ["FRAMES", "frame_bits", "record_frames"]

FRAMES: Final[dict[int, tuple[MessageKind, str, str, int]]] = {
    0x0101: ("LNAV", "G", "1C", 40),
    0x0102: ("CNAV", "G", "2L", 38),
    0x0103: ("CNAV", "G", "5I", 38),
    0x0301: ("GLONASS", "R", "1C", 11),
    0x0401: ("LNAV", "J", "1C", 40),
    0x0501: ("D1", "C", "2I", 40),
    0x0502: ("D2", "C", "2I", 40),
    0x0601: ("INAV", "E", "1B", 29),
    0x0602: ("FNAV", "E", "5I", 30),
}
"""Kind, system, RINEX signal and bytes of each Type of a Nav row."""


def frame_bits(kind: MessageKind, bits: Octets) -> tuple[Octets, Booleans]:
    """Return the bits (n, FRAME_BITS) of a kind of frame from those of a row's bytes, and which frames hold."""
    n = len(bits)
    if kind == "LNAV":
        return _lnav_bits(bits.reshape(n, 10, 32)[:, :, 2:].astype(np.int8))
    holds = np.ones(n, np.bool_)
    if kind in ("D1", "D2"):
        return bits.reshape(n, 10, 32)[:, :, 2:].reshape(n, 300), holds
    if kind == "INAV":  # the halves of a page without their tails of six zeros
        return np.pad(bits[:, :228].reshape(n, 2, 114), ((0, 0), (0, 0), (0, 6))).reshape(n, 240), holds
    whole = np.zeros((n, FRAME_BITS[kind]), np.uint8)
    used = min(bits.shape[1], 238 if kind == "FNAV" else FRAME_BITS[kind])
    whole[:, :used] = bits[:, :used]
    return whole, holds


def _lnav_bits(words: Any) -> tuple[Octets, Booleans]:
    """Return source bits (n, 240) of ten words (n, 10, 30), and whether all parities hold.

    Phones give the words as they were sent, upright or not, or with the data as before encoding.
    """
    upright = words ^ (1 - words[:, :1, :1])  # the preamble begins with a one
    encoded = words.copy()
    encoded[:, 1:, :24] ^= words[:, :-1, 29:]
    bits, holds = np.zeros((len(words), 240), np.uint8), np.zeros(len(words), np.bool_)
    for candidate in (upright, encoded):
        data, right = check_words(candidate.reshape(len(words), 300))
        fits = right.all(axis=1) & ~holds
        bits[fits], holds = data[fits].reshape(-1, 240), holds | fits
    return bits, holds


def record_frames(
    kind: MessageKind, parts: list[tuple[Integers, SignalId, Octets]], before: Integers, after: Integers
) -> BroadcastFrames:
    rows = np.concatenate([rows for rows, _, _ in parts])
    order = np.argsort(rows, kind="stable")
    names = [
        np.concatenate([np.full(rows.size, getattr(signal, name)) for rows, signal, _ in parts])[order]
        for name in ("sat", "band", "code")
    ]
    bits = np.concatenate([bits for _, _, bits in parts])[order]
    gpst: Instants = before[rows[order]].astype("datetime64[ns]")
    until: Instants = after[rows[order]].astype("datetime64[ns]")
    return BroadcastFrames(
        kind=kind,
        gpst=gpst,
        until_gpst=until,
        since_gpst=gpst,
        sat=names[0],
        band=names[1],
        code=names[2],
        bits=np.packbits(bits, axis=1),
    )
