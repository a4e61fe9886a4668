"""The kinds of files that receivers log into, known by their first bytes, each with what reads it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from skyproof.logs.autopilots import is_ardupilot, is_px4, read_ardupilot, read_px4
from skyproof.logs.content import Beside, LogPiece
from skyproof.logs.gnsslogger import is_gnsslogger, read_gnsslogger
from skyproof.logs.stream import first_instant, is_log, read_log

__all__ = ["HEAD_BYTES", "LOG_KINDS", "LogKind", "kind_of_log"]

HEAD_BYTES: Final = 1 << 16
"""In which frames are looked for: those of one epoch take 10 kB at most."""


@dataclass(frozen=True)
class LogKind:
    """A kind of log.

    is_kind : tells by its first bytes. read : in blocks of bytes. first_instant : of one whose epochs may lack the
        week; the first instant that it says in full, None where there is none. to_do : how measurements get into it.
    multipath_sigma_m : error of a pseudorange by reflections that its antennas have, one sigma; None where they may be
        of any kind.
    """

    is_kind: Callable[[bytes], bool]
    read: Callable[[Iterable[bytes], str, Beside], Iterator[LogPiece]]
    first_instant: Callable[[Iterable[bytes]], np.datetime64 | None]
    to_do: str
    multipath_sigma_m: float | None = None


PHONE_MULTIPATH_M: Final = 15.0
"""A phone's linear antenna receives reflections some 6 dB below the direct signal. By detours of 40 m, which streets
have, such a one moves a C/A code by 0.5 x 40 m x cos(phase), 14 m one sigma (Kaplan and Hegarty, 3rd edition, 9.5)."""

LOG_KINDS: Final = (
    LogKind(
        is_gnsslogger,
        lambda blocks, source, _: read_gnsslogger(blocks, source),
        lambda _: None,
        "have GnssLogger log Raw measurements, in the open for half a minute or more",
        PHONE_MULTIPATH_M,
    ),
    LogKind(
        is_px4,
        read_px4,
        lambda _: None,
        "have PX4 log what its receiver sends (parameter GPS_DUMP_COMM = 1, and RXM-RAWX of the receiver turned on)",
    ),
    LogKind(
        is_ardupilot,
        read_ardupilot,
        lambda _: None,
        "have ArduPilot log raw measurements (parameter GPS_RAW_DATA = 1)",
    ),
    LogKind(
        is_log,
        read_log,
        first_instant,
        "have the receiver log them (UBX-RXM-RAWX, SBF MeasEpoch, RTCM MSM7), or convert what is not read to RINEX",
    ),
)
"""In the order in which they are tried."""


def kind_of_log(head: bytes) -> LogKind | None:
    """Return the kind of a file that begins so; None if it is no receiver's log."""
    return next((kind for kind in LOG_KINDS if kind.is_kind(head)), None)
