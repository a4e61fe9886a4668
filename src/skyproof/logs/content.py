"""What a receiver's log holds, whatever its protocol: the records that every reader of logs gives.

A reader of a protocol takes the frames of one stretch of a stream after the other, and gives a `LogPiece` of each.
Memory is bounded by the stretch. Damage costs the frame that is damaged and is counted, never the log.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Instants, Octets, Reals
from skyproof.gnss.ephemeris import BroadcastEphemeris
from skyproof.logs.frames import Frames
from skyproof.records import FrontEndLevels, Observations, ReceiverFixes, freeze
from skyproof.remarks import Remark, RemarkKind

__all__ = [
    "FRAME_BITS",
    "Beside",
    "BroadcastFrames",
    "InertialRows",
    "LogPiece",
    "LogReader",
    "MessageKind",
    "ReceiverStates",
    "join_rows",
    "report_untimed",
]

MessageKind = Literal["LNAV", "CNAV", "CNAV2", "INAV", "FNAV", "D1", "D2", "BCNAV1", "BCNAV2", "BCNAV3", "GLONASS"]
FRAME_BITS: Final[dict[MessageKind, int]] = {
    "LNAV": 240,
    "CNAV": 300,
    "CNAV2": 900,
    "INAV": 240,
    "FNAV": 244,
    "D1": 300,
    "D2": 300,
    "BCNAV1": 600,
    "BCNAV2": 288,
    "BCNAV3": 486,
    "GLONASS": 85,
}
"""Bits of a frame as the decoders of `skyproof.gnss` take it: a subframe, a message, a page pair, a string.

LNAV the source bits of ten words, without parity; D1, D2 with their parity bits; INAV the even and the odd page of
120 bits each; FNAV a page without its 12 bits of synchronisation; BCNAV1
subframe 2; GLONASS a string without its time mark.
"""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiverStates:
    """What the receiver says of itself. It is shown beside our answer and is never evidence.

    gpst : (n,). subject : (n,) "jamming", "spoofing" or "authentication". state : (n,) the protocol's own word, as
    "indicated". alarm : (n,) whether the word claims jamming, spoofing or a failed authentication.
    """

    gpst: Instants
    subject: NDArray[np.str_]
    state: NDArray[np.str_]
    alarm: NDArray[np.bool_]

    def __post_init__(self) -> None:
        freeze(self, dict.fromkeys(("gpst", "subject", "state", "alarm"), ("row",)))


@dataclass(frozen=True, eq=False, kw_only=True)
class BroadcastFrames:
    """Frames of one kind of broadcast message whose parity or checksum holds, in order of arrival.

    gpst, until_gpst : (n,) the last instant that the log says before the frame, and the next one; NaT where that is not
    known. since_gpst : (n,) the instant before `gpst`, or `gpst` itself where frames are written when they come. The
    frame ended between since and until, to a second or two: some receivers write it behind their next epoch.
    sat : (n,) "G05". band, code : (n,) the signal that carried it, as `SignalId` names them. bits :
    (n, ceil(FRAME_BITS[kind] / 8)) packed, first bit first.
    """

    kind: MessageKind
    gpst: Instants
    until_gpst: Instants
    since_gpst: Instants
    sat: NDArray[np.str_]
    band: NDArray[np.str_]
    code: NDArray[np.str_]
    bits: Octets

    def __post_init__(self) -> None:
        n_bytes = str(-(-FRAME_BITS[self.kind] // 8))
        freeze(
            self,
            dict.fromkeys(("gpst", "until_gpst", "since_gpst", "sat", "band", "code"), ("frame",))
            | {"bits": ("frame", n_bytes)},
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class InertialRows:
    """Readings of an inertial unit that stands in the log: in body axes, forward, right, down.

    gpst : (n,) by the log's own clock, to some tenths of a second. specific_force_m_s2, angular_rate_rad_s : (n, 3)
        means over the intervals that end then.
    """

    gpst: Instants
    specific_force_m_s2: Reals
    angular_rate_rad_s: Reals

    def __post_init__(self) -> None:
        shapes: dict[str, tuple[str, ...]] = dict.fromkeys(("specific_force_m_s2", "angular_rate_rad_s"), ("row", "3"))
        freeze(self, {"gpst": ("row",)} | shapes)


@dataclass(frozen=True, eq=False, kw_only=True)
class LogPiece:
    """What a stretch of a log holds; None or empty where it holds none of a kind.

    observations : elapsed time counts from the first epoch of the piece. frames, ephemerides : broadcast messages, and
        orbits that the protocol itself relays. messages : how many frames of each name were
        read ("RXM-RAWX", "RTCM 1077", "NMEA GGA"). damaged_frames : how many failed their checksum or their length.
    undated_epochs : left out, for the log has not said the week. cut : the log ends inside a frame; in its last piece
        only.
    """

    observations: Observations | None = None
    fixes: ReceiverFixes | None = None
    levels: FrontEndLevels | None = None
    states: ReceiverStates | None = None
    inertial: InertialRows | None = None
    frames: tuple[BroadcastFrames, ...] = ()
    ephemerides: tuple[BroadcastEphemeris, ...] = ()
    messages: dict[str, int]
    damaged_frames: int = 0
    undated_epochs: int = 0
    cut: bool = False
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Beside:
    """What is known of a log from beside it.

    near : an instant within half a week of its beginning, for protocols that do not say the week; None where the log
    has to say it. first_day : that of a log whose sentences say no date at all; None to leave it out.
    channels : frequency numbers of GLONASS, by satellite.
    """

    near: np.datetime64 | None = None
    first_day: np.datetime64 | None = None
    channels: Mapping[str, int] | None = None


class LogReader(Protocol):
    """What reads the frames of one protocol, stretch by stretch, and remembers what later ones need."""

    def read(self, frames: Frames) -> LogPiece:
        """Read the frames of its protocol; whoever splits the stream counts `damaged_frames` and `cut`."""


def report_untimed(epochs: int) -> Remark:
    """Return the remark on epochs that the receiver gave no time."""
    return Remark(f"{epochs} epochs before the receiver knew the time are left out", RemarkKind.BEARS)


R = TypeVar("R", ReceiverFixes, FrontEndLevels, ReceiverStates, InertialRows)


def join_rows(parts: Sequence[R]) -> R | None:
    """Return records of rows, in order of time, as one; None without any."""
    if not parts:
        return None
    columns: dict[str, Any] = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(parts[0])
    }
    return replace(parts[0], **columns)
