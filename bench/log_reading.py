"""Reading receivers' logs: bytes a second of UBX and SBF beside pyubx2 and pysbf2, of GnssLogger beside pandas.

The logs are made here: epochs of so many signals once a second, whole frames with checksums.
"""

import io
import struct
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pandas
from pynmeagps import NMEAReader
from pyrtcm import RTCMReader
from pysbf2 import SBFReader
from pyubx2 import UBXReader
from timing import line, take_turns

from skyproof.logs.content import Beside, LogPiece
from skyproof.logs.frames import split_frames
from skyproof.logs.gnsslogger import read_gnsslogger
from skyproof.logs.stream import read_log

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.logs.frames import msm_message, nmea_sentence, sbf_block, ubx_frame
from tests.logs.phone import HEADER, Measured, raw_line

EPOCHS, SIGNALS = 3600, 40
PEER_EPOCHS = 60
BLOCK = 1 << 16
_READ_STREAM = partial(read_log, beside=Beside(np.datetime64("2024-02-04")))


def report() -> Iterator[str]:
    """Rows of the table."""
    yield f"reading logs of {EPOCHS} epochs of {SIGNALS} signals, one core, processor time"
    protocols = (
        ("UBX", _ubx_epoch, UBXReader),
        ("SBF", _sbf_epoch, SBFReader),
        ("RTCM 3, MSM7", _msm_epoch, RTCMReader),
        ("RTCM 3, MSM4", _short_msm_epoch, RTCMReader),
        ("NMEA", _nmea_epoch, NMEAReader),
    )
    for name, make, peer in protocols:
        octets = b"".join(make(k) for k in range(EPOCHS))
        part = b"".join(make(k) for k in range(PEER_EPOCHS))
        blocks = [octets[at : at + BLOCK] for at in range(0, len(octets), BLOCK)]
        whole, split = take_turns(lambda b=blocks: _read(b), lambda b=blocks: _split(b), clock=process_time)
        (parsed,) = take_turns(lambda p=part, peer=peer: _parse(p, peer), runs=3, clock=process_time)
        size_mb = len(octets) / 1e6
        beside = f"{(parsed.median / len(part)) / (whole.median / len(octets)):.0f} times as fast as the peer"
        yield line(f"{name}, frames and checksums, {size_mb:.1f} MB", split, "s", f"{size_mb / split.median:.0f} MB/s")
        yield line(f"{name}, to observations", whole, "s", f"{size_mb / whole.median:.0f} MB/s, {beside}")
    yield from _phone()


def _phone() -> Iterator[str]:
    """Rows of a phone's text, beside the bare table of it."""
    text = "".join(raw_line(row) for k in range(EPOCHS // 2) for row in _phone_epoch(float(k))).encode()
    octets = HEADER.encode() + text
    blocks = [octets[at : at + BLOCK] for at in range(0, len(octets), BLOCK)]
    whole, table = take_turns(
        lambda: _read(blocks, read_gnsslogger),
        lambda: pandas.read_csv(io.BytesIO(text), header=None),
        clock=process_time,
    )
    size_mb = len(octets) / 1e6
    beside = f"{table.median / whole.median:.2f} times as fast as pandas.read_csv"
    yield line(
        f"GnssLogger, to observations, {size_mb:.1f} MB", whole, "s", f"{size_mb / whole.median:.0f} MB/s, {beside}"
    )


def _read(blocks: list[bytes], read: Callable[..., Iterator[LogPiece]] = _READ_STREAM) -> None:
    for _ in read(blocks, "rx"):
        pass


def _split(blocks: list[bytes]) -> None:
    for _ in split_frames(blocks):
        pass


def _parse(octets: bytes, reader: Any) -> None:
    for _ in reader(io.BytesIO(octets)):
        pass


def _ubx_epoch(second: int) -> bytes:
    payload = struct.pack("<dHbBBBH", 1000.0 + second, 2300, 18, SIGNALS, 1, 1, 0)
    for sv in range(1, SIGNALS + 1):
        gnss, number = divmod(sv, 32)
        payload += struct.pack(
            "<ddfBBBBHBBBBBB", 2.1e7 + sv, 1.1e8 + sv, 500.0, 2 * gnss, number + 1, 0, 0, 60_000, 44, 3, 2, 4, 7, 0
        )
    return ubx_frame(0x02, 0x15, payload)


def _sbf_epoch(second: int) -> bytes:
    payload = struct.pack("<IH", 1000 * (1000 + second), 2300) + bytes([SIGNALS // 2, 20, 12, 0, 0, 0])
    for sv in range(1, SIGNALS // 2 + 1):
        payload += struct.pack("<BBBBIiHbBHBB", sv, 0, sv, 4, 4_000_000_000 + sv, -12_345, 77, 3, 140, 600, 0, 1)
        payload += struct.pack("<BBBBbBHHH", 3, 100, 120, 1, 2, 0, 99, 88, 77)
    return sbf_block(4027, payload, revision=1)


def _phone_epoch(second: float) -> list[Measured]:
    """Return rows with as many digits as phones write."""
    rows = [Measured(svid=sv, travel_ns=70_000_000 + 100_000 * sv, adr_state=9, cn0_dbhz=30.1) for sv in range(1, 33)]
    return [row.at(second, rate_m_s=-321.4836120605469 + second, adr_m=321.48361206055 * second) for row in rows]


def _msm_epoch(second: int) -> bytes:
    sats = {sv: (70 + sv, 0, 500 + sv, 100) for sv in range(1, SIGNALS // 4 + 1)}
    cells = {(sv, signal): (10 * sv, 20 * sv, 600, 0, 640, 5 * sv) for sv in sats for signal in (2, 16)}
    return b"".join(msm_message(number, 1000 * (1000 + second), sats, cells) for number in (1077, 1097))


def _short_msm_epoch(second: int) -> bytes:
    sats = {sv: (70 + sv, 0, 500 + sv, 100) for sv in range(1, SIGNALS // 4 + 1)}
    cells = {(sv, signal): (10 * sv, 20 * sv, 15, 0, 44) for sv in sats for signal in (2, 16)}
    return b"".join(msm_message(number, 1000 * (1000 + second), sats, cells) for number in (1074, 1094))


def _nmea_epoch(second: int) -> bytes:
    time = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}.00"
    sentences = [
        f"GNRMC,{time},A,4730.0000000,N,00830.0000000,E,0.0,0.0,040224,,,A",
        f"GNGGA,{time},4730.0000000,N,00830.0000000,E,1,24,0.8,350.0,M,50.0,M,,",
    ]
    for talker in ("GP", "GA"):
        for first in range(1, SIGNALS // 2 + 1, 4):
            sats = "".join(f",{sv:02d},40,123,44" for sv in range(first, first + 4))
            sentences.append(f"{talker}GSV,5,{first // 4 + 1},{SIGNALS // 2}{sats},1")
    return b"".join(nmea_sentence(text) for text in sentences)
