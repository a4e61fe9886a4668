"""Reading receivers' logs: bytes a second of UBX and SBF beside pyubx2 and pysbf2, of GnssLogger beside pandas,
of flight logs beside pyulog and pymavlink; and an hour of log through `protect`, beside the same as RINEX.

The logs are made here: epochs of so many signals once a second, whole frames with checksums.
`python bench/memory.py ubx 24` is a day of two receivers.
"""

import io
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import memory
import numpy as np
import pandas
from pymavlink.DFReader import DFReader_binary
from pynmeagps import NMEAReader
from pyrtcm import RTCMReader
from pysbf2 import SBFReader
from pyubx2 import UBXReader
from pyulog.core import ULog
from timing import line, take_turns

from skyproof.logs.autopilots import read_ardupilot, read_px4
from skyproof.logs.content import Beside, LogPiece
from skyproof.logs.frames import split_frames
from skyproof.logs.gnsslogger import read_gnsslogger
from skyproof.logs.stream import read_log

sys.path.insert(0, str(Path(__file__).parent.parent))
from tests.logs.drone import BOOT_US, DataFlash, make_px4_flight
from tests.logs.frames import make_msm_message, make_nmea_sentence, make_sbf_block, make_ubx_frame
from tests.logs.phone import HEADER, Measured, make_raw_line

EPOCHS, SIGNALS = 3600, 40
PEER_EPOCHS = 60
FLIGHT_S, PEER_FLIGHT_S = 300, 20
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
    yield from _flights()
    yield from _phone()
    yield from memory.hour_by_format()


def _flights() -> Iterator[str]:
    """Rows of flight logs, beside readers of all their messages."""
    for name, make, read, parse in (
        ("PX4", _px4_log, read_px4, lambda octets: ULog(io.BytesIO(octets))),
        ("ArduPilot", _ardupilot_log, read_ardupilot, _parse_dataflash),
    ):
        octets, part = make(FLIGHT_S), make(PEER_FLIGHT_S)
        blocks = [octets[at : at + BLOCK] for at in range(0, len(octets), BLOCK)]
        (whole,) = take_turns(lambda b=blocks, read=read: _read(b, read), clock=process_time)
        (parsed,) = take_turns(lambda p=part, parse=parse: parse(p), runs=3, clock=process_time)
        size_mb = len(octets) / 1e6
        beside = f"{(parsed.median / len(part)) / (whole.median / len(octets)):.0f} times as fast as the peer"
        what = f"{name}, raw signals and inertia, {size_mb:.1f} MB"
        yield line(what, whole, "s", f"{size_mb / whole.median:.0f} MB/s, {beside}")


def _px4_log(seconds: int) -> bytes:
    force, rate = [0.1, 0.2, -9.8], [0.01, 0.02, 0.03]
    imu = [(BOOT_US + 5000 * k, rate, force) for k in range(200 * seconds)]
    utc = {"time_utc_usec": 1_700_000_000_000_000, "fix_type": 3}
    epochs = ((BOOT_US + 1_000_000 * k, _ubx_epoch(k), utc) for k in range(seconds))
    return make_px4_flight(epochs, imu)


def _ardupilot_log(seconds: int) -> bytes:
    log = DataFlash()
    log.state("GRXH", "QdHbBB", "TimeUS,rcvTime,week,leapS,numMeas,recStat")
    log.state("GRXS", "QddfBBBHBBBBB", "TimeUS,prMes,cpMes,doMes,gnss,sv,freq,lock,cno,prD,cpD,doD,trk")
    log.state("IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz")
    for k in range(seconds):
        log.log("GRXH", BOOT_US, 1000.0 + k, 2300, 18, SIGNALS, 1)
        for sv in range(1, SIGNALS + 1):
            log.log(
                "GRXS", BOOT_US, 2.1e7 + sv, 1.1e8 + sv, 500.0, 2 * (sv // 32), sv % 32 + 1, 0, 60_000, 44, 3, 2, 4, 7
            )
        for j in range(200):
            log.log("IMU", BOOT_US + 5000 * j, 0, 0.01, 0.02, 0.03, 0.1, 0.2, -9.8, 0, 0, 30.0, 1, 1, 200, 200)
    return log.bytes()


def _parse_dataflash(octets: bytes) -> None:
    with tempfile.NamedTemporaryFile(suffix=".bin") as file:
        file.write(octets)
        file.flush()
        log = DFReader_binary(file.name, zero_time_base=True)
        while log.recv_msg() is not None:
            pass
        log.filehandle.close()


def _phone() -> Iterator[str]:
    """Rows of a phone's text, beside the bare table of it."""
    text = "".join(make_raw_line(row) for k in range(EPOCHS // 2) for row in _phone_epoch(float(k))).encode()
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
    return make_ubx_frame(0x02, 0x15, payload)


def _sbf_epoch(second: int) -> bytes:
    payload = struct.pack("<IH", 1000 * (1000 + second), 2300) + bytes([SIGNALS // 2, 20, 12, 0, 0, 0])
    for sv in range(1, SIGNALS // 2 + 1):
        payload += struct.pack("<BBBBIiHbBHBB", sv, 0, sv, 4, 4_000_000_000 + sv, -12_345, 77, 3, 140, 600, 0, 1)
        payload += struct.pack("<BBBBbBHHH", 3, 100, 120, 1, 2, 0, 99, 88, 77)
    return make_sbf_block(4027, payload, revision=1)


def _phone_epoch(second: float) -> list[Measured]:
    """Return rows with as many digits as phones write."""
    rows = [Measured(svid=sv, travel_ns=70_000_000 + 100_000 * sv, adr_state=9, cn0_dbhz=30.1) for sv in range(1, 33)]
    return [row.at(second, rate_m_s=-321.4836120605469 + second, adr_m=321.48361206055 * second) for row in rows]


def _msm_epoch(second: int) -> bytes:
    sats = {sv: (70 + sv, 0, 500 + sv, 100) for sv in range(1, SIGNALS // 4 + 1)}
    cells = {(sv, signal): (10 * sv, 20 * sv, 600, 0, 640, 5 * sv) for sv in sats for signal in (2, 16)}
    return b"".join(make_msm_message(number, 1000 * (1000 + second), sats, cells) for number in (1077, 1097))


def _short_msm_epoch(second: int) -> bytes:
    sats = {sv: (70 + sv, 0, 500 + sv, 100) for sv in range(1, SIGNALS // 4 + 1)}
    cells = {(sv, signal): (10 * sv, 20 * sv, 15, 0, 44) for sv in sats for signal in (2, 16)}
    return b"".join(make_msm_message(number, 1000 * (1000 + second), sats, cells) for number in (1074, 1094))


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
    return b"".join(make_nmea_sentence(text) for text in sentences)
