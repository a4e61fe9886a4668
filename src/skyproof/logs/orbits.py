"""Orbits from the broadcast messages that a log holds."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np

from skyproof.gnss.constants import SECONDS_PER_WEEK
from skyproof.gnss.ephemeris import BroadcastEphemeris, Klobuchar, UtcParameters, UtcStatement
from skyproof.gnss.lnav import (
    SUBFRAME_S,
    Subframe,
    ephemeris_from_subframes,
    ionosphere_and_utc,
    subframe_from_source,
    utc_statement,
)
from skyproof.gnss.messages.beidou import d1_ephemeris, d1_subframe, d1_utc, d2_ephemeris, d2_page
from skyproof.gnss.messages.galileo import fnav_ephemeris, fnav_page, inav_ephemeris, inav_utc, inav_word
from skyproof.gnss.messages.glonass import glonass_ephemeris, glonass_string
from skyproof.gnss.messages.modern import (
    bcnav1_ephemeris,
    bcnav1_subframe,
    bcnav2_ephemeris,
    bcnav2_message,
    cnav_ephemeris,
    cnav_message,
)
from skyproof.gnss.time import week_and_tow
from skyproof.logs.content import FRAME_BITS, BroadcastFrames, MessageKind
from skyproof.records import NavigationData, ReceivedMessages

__all__ = ["OrbitCollector"]

_Parts = dict[int, Mapping[str, float]]
_READ: Final[dict[MessageKind, Callable[[int], tuple[int, Mapping[str, float]] | None]]] = {
    "INAV": inav_word,
    "FNAV": fnav_page,
    "D1": d1_subframe,
    "D2": d2_page,
    "GLONASS": glonass_string,
    "CNAV": cnav_message,
    "BCNAV1": bcnav1_subframe,
    "BCNAV2": bcnav2_message,
}
_MADE: Final[dict[MessageKind, Callable[[_Parts, str, int], BroadcastEphemeris | None]]] = {
    "INAV": inav_ephemeris,
    "FNAV": fnav_ephemeris,
    "D1": d1_ephemeris,
    "D2": d2_ephemeris,
    "CNAV": cnav_ephemeris,
    "BCNAV1": bcnav1_ephemeris,
    "BCNAV2": bcnav2_ephemeris,
}
_TIMED_WORD, _UTC_WORD = 5, 6  # of I/NAV
_UTC_SUBFRAME: Final = 5  # of D1
_INAV_PAGE_S: Final = 2.0  # by which a word's time of week is that of its beginning
_TIME_OFF_S: Final = 4.0
"""A frame's end is known to a second or two, and messages of LNAV are 6 s apart."""
_STRINGS_APART: Final = np.timedelta64(15, "s")
"""Strings 1 to 4 of a frame of GLONASS come within 6 s, those of the one before 24 s earlier or more (ICD 5.1, 4.3)."""
_MOST_KEPT: Final = 100_000  # a day of 100 satellites has some 10 000 data sets


class OrbitCollector:
    """Gathers frames as they come, and gives the orbits of all that were whole.

    Of each satellite and message the latest part of each number is kept; whenever they make a data set that was not
    there before it is added. Times of week count to the nearest week of when the frame came. What a satellite sends
    again, of its orbit and of UTC, is kept with when it came, and so are frames whose time of week is not that of the
    receiver.
    """

    def __init__(self) -> None:
        self._parts: dict[tuple[str, str], dict[int, Any]] = {}
        self._found: dict[tuple[Any, ...], BroadcastEphemeris] = {}
        self._ionosphere: Klobuchar | None = None
        self._utc: UtcParameters | None = None
        self._slots: dict[str, int] = {}
        self._last: dict[tuple[str, str], BroadcastEphemeris] = {}
        self._received: list[tuple[np.datetime64, BroadcastEphemeris]] = []
        self._mistimed: list[tuple[np.datetime64, str]] = []
        self._came: dict[str, dict[int, np.datetime64]] = {}
        self._last_utc: dict[tuple[str, str], UtcStatement] = {}
        self._stated: list[tuple[np.datetime64, UtcStatement]] = []

    def take(self, frames: Iterable[BroadcastFrames], frequency_numbers: Mapping[str, int]) -> None:
        """Take the frames of a stretch; `frequency_numbers` of GLONASS's satellites, by name."""
        self._slots |= frequency_numbers
        for record in frames:
            n_bytes = record.bits.shape[1]
            unused = 8 * n_bytes - FRAME_BITS[record.kind]
            open_s = (record.until_gpst - record.gpst) / np.timedelta64(1, "s")
            late_s = (record.gpst - record.since_gpst) / np.timedelta64(1, "s")
            around_s = zip(late_s.tolist(), open_s.tolist(), strict=True)
            for gpst, within_s, sat, octets in zip(
                record.gpst, around_s, record.sat.tolist(), record.bits, strict=True
            ):
                self._frame(record.kind, sat, int.from_bytes(octets.tobytes(), "big") >> unused, gpst, within_s)

    def add(self, ephemerides: Iterable[BroadcastEphemeris]) -> None:
        """Take orbits that a protocol relays unchanged."""
        for ephemeris in ephemerides:
            self._keep(getattr(ephemeris, "message", "GLONASS"), ephemeris)

    def _keep(self, kind: str, made: BroadcastEphemeris) -> None:
        self._found.setdefault((kind, made.sat, made.week, made.toe, getattr(made, "iodc", 0)), made)

    def _frame(
        self, kind: MessageKind, sat: str, frame: int, gpst: np.datetime64, around_s: tuple[float, float]
    ) -> None:
        week, tow_s = week_and_tow(gpst)
        parts = self._parts.setdefault((kind, sat), {})
        made: BroadcastEphemeris | None = None
        stated: UtcStatement | None = None
        if kind == "LNAV":
            subframe = subframe_from_source(frame)
            if subframe is None:
                return
            parts[subframe.id] = subframe
            self._time(sat, gpst, subframe.tow_s + SUBFRAME_S - float(tow_s), around_s)
            self._ionosphere_of(subframe, week)
            stated = utc_statement(subframe, sat, week) if subframe.id == 4 else None
            if subframe.id <= 3 and all(number in parts for number in (1, 2, 3)):
                made = ephemeris_from_subframes(parts[1], parts[2], parts[3], sat, week)
        elif kind in _READ:
            read = _READ[kind](frame)
            if read is None:
                return
            if kind == "GLONASS":
                self._begin_frame(sat, read[0], gpst, parts)
            parts[read[0]] = read[1]
            if kind == "INAV" and read[0] == _TIMED_WORD:
                self._time(sat, gpst, read[1]["tow_s"] + _INAV_PAGE_S - float(tow_s), around_s)
            if kind == "INAV" and read[0] == _UTC_WORD:
                stated = inav_utc(read[1], sat, week)
            if kind == "D1" and read[0] == _UTC_SUBFRAME:
                stated = d1_utc(read[1], sat, week)
            if kind == "GLONASS":
                if read[0] <= 4 and sat in self._slots:
                    made = glonass_ephemeris(parts, sat, gpst, self._slots[sat])
            else:
                made = _MADE[kind](parts, sat, week)
        if stated is not None and stated != self._last_utc.get((kind, sat)) and len(self._stated) < _MOST_KEPT:
            self._last_utc[kind, sat] = stated
            self._stated.append((gpst, stated))
        if made is not None:
            self._keep(kind, made)
            if made != self._last.get((kind, sat)) and len(self._received) < _MOST_KEPT:
                self._last[kind, sat] = made
                self._received.append((gpst, made))

    def _begin_frame(self, sat: str, number: int, gpst: np.datetime64, parts: dict[int, Any]) -> None:
        """Forget strings of GLONASS that are not of the frame of this one: no number says to which data they belong.

        Strings come in order, and those of a frame within seconds of each other.
        """
        came = self._came.setdefault(sat, {})
        for other in [k for k in parts if k >= number or gpst - came[k] > _STRINGS_APART]:
            del parts[other]
        came[number] = gpst

    def _time(self, sat: str, gpst: np.datetime64, ahead_s: float, around_s: tuple[float, float]) -> None:
        """Keep a frame whose time of week is not that of its end by the receiver.

        around_s : how long before and after `gpst` the frame may have ended; not known where that is NaN or negative,
        at the end of what was read, or where parts of a log were put out of order.
        """
        off_s = (ahead_s + 0.5 * SECONDS_PER_WEEK) % SECONDS_PER_WEEK - 0.5 * SECONDS_PER_WEEK
        late_s, open_s = around_s
        is_known = late_s >= 0.0 and open_s >= 0.0
        fits = -late_s - _TIME_OFF_S <= off_s <= open_s + _TIME_OFF_S
        if is_known and not fits and len(self._mistimed) < _MOST_KEPT:
            self._mistimed.append((gpst, sat))

    def _ionosphere_of(self, subframe: Subframe, week: int) -> None:
        found = ionosphere_and_utc(subframe, week) if subframe.id == 4 else None
        if found is not None:
            self._ionosphere, self._utc = found

    def received(self) -> ReceivedMessages | None:
        """Return what came when; None without any."""
        if not self._received and not self._mistimed and not self._stated:
            return None
        return ReceivedMessages(
            gpst=np.array([gpst for gpst, _ in self._received], "M8[ns]"),
            ephemerides=tuple(made for _, made in self._received),
            mistimed_gpst=np.array([gpst for gpst, _ in self._mistimed], "M8[ns]"),
            mistimed_sat=tuple(sat for _, sat in self._mistimed),
            utc_gpst=np.array([gpst for gpst, _ in self._stated], "M8[ns]"),
            utc=tuple(stated for _, stated in self._stated),
        )

    def navigation(self, source: str) -> NavigationData:
        """Return all that was gathered; `source` names it."""
        return NavigationData(
            ephemerides=tuple(self._found.values()), ionosphere=self._ionosphere, utc=self._utc, source=source
        )
