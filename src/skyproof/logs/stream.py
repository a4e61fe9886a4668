"""A receiver's byte stream, whatever protocols are in it, as one log."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import numpy as np

from skyproof.logs.content import Beside, LogPiece, LogReader
from skyproof.logs.frames import Protocol, split_frames
from skyproof.logs.nmea import NmeaReader
from skyproof.logs.rtcm3 import Rtcm3Reader
from skyproof.logs.sbf import SbfReader
from skyproof.logs.ubx import UbxReader

__all__ = ["LEAST_FRAMES", "first_instant", "is_log", "read_log"]

LEAST_FRAMES: Final = 3
"""Frames with a checksum that holds, by which a stream is known: other bytes hold one of UBX in 2^32."""
_READERS: Final[dict[Protocol, Callable[[str, Beside], LogReader]]] = {
    Protocol.UBX: lambda source, _: UbxReader(source),
    Protocol.SBF: lambda source, _: SbfReader(source),
    Protocol.RTCM3: Rtcm3Reader,
    Protocol.NMEA: NmeaReader,
}
"""What reads each protocol, in the order of preference where several give the same."""


def is_log(head: bytes) -> bool:
    """Tell whether a file that begins so is a receiver's byte stream."""
    (frames, *_) = split_frames([head])
    end = frames.begin + frames.length
    bare = (frames.protocol == Protocol.NMEA) & (frames.octets[np.maximum(end - 3, 0)] != ord("*"))
    counts = np.bincount(frames.protocol[~bare], minlength=max(Protocol) + 1)
    return any(counts[protocol] >= LEAST_FRAMES for protocol in _READERS)


def first_instant(blocks: Iterable[bytes]) -> np.datetime64 | None:
    """Return the first instant that a stream says in full, with its date; None where it says none."""
    for piece in read_log(blocks, ""):
        for timed in (piece.observations, piece.fixes, piece.states, piece.levels, *piece.frames):
            if timed is not None and timed.gpst.size:
                first: np.datetime64 = timed.gpst[0]
                return first
    return None


def read_log(blocks: Iterable[bytes], source: str, beside: Beside | None = None) -> Iterator[LogPiece]:
    """Read a stream in blocks of bytes, cut anywhere, stretch by stretch.

    Where several protocols give measurements, or fixes, or levels, those of the first of them in the order above are
    taken from where it begins; broadcast frames and states are taken from all.

    source : names the receiver. beside : what is known of the log.
    """
    readers = {protocol: make(source, beside or Beside()) for protocol, make in _READERS.items()}
    preferred: dict[str, Protocol] = {}
    order = list(readers)
    for frames in split_frames(blocks):
        # Sentences take long to read, and give nothing that another protocol does not give better.
        better = all(preferred.get(name, Protocol.NMEA) is not Protocol.NMEA for name in ("observations", "fixes"))
        needed = [protocol for protocol in order if protocol is not Protocol.NMEA or not better]
        pieces = {protocol: readers[protocol].read(frames) for protocol in needed}
        chosen = {}
        for name in ("observations", "fixes", "levels"):
            having = [protocol for protocol, piece in pieces.items() if getattr(piece, name) is not None]
            if having:
                preferred[name] = min(having[0], preferred.get(name, having[0]), key=order.index)
                chosen[name] = getattr(pieces[preferred[name]], name)
        messages: Counter[str] = Counter()
        for piece in pieces.values():
            messages.update(piece.messages)
        if better:
            messages["NMEA"] += int((frames.protocol == Protocol.NMEA).sum())
        states = [piece.states for piece in pieces.values() if piece.states is not None]
        yield LogPiece(
            **chosen,
            states=states[0] if states else None,
            frames=tuple(frame for piece in pieces.values() for frame in piece.frames),
            ephemerides=tuple(orbit for piece in pieces.values() for orbit in piece.ephemerides),
            messages=dict(messages),
            damaged_frames=frames.damaged + sum(piece.damaged_frames for piece in pieces.values()),
            undated_epochs=sum(piece.undated_epochs for piece in pieces.values()),
            cut=frames.cut,
            remarks=tuple(remark for piece in pieces.values() for remark in piece.remarks),
        )
