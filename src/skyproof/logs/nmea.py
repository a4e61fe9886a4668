"""NMEA 0183: the receiver's own fixes, and the C/N0 of its satellites (version 4.11, with the numbers of 4.10).

GGA, GNS, GLL and RMC give places, RMC and ZDA the date, GST the accuracy, GSV what is received. There are no ranges.
"""

from collections import Counter
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np

from skyproof.formats.nmea_read import Sentence, read_sentence
from skyproof.gnss.signals import carrier_hz_of, rinex_signal
from skyproof.gnss.time import gpst_from_utc
from skyproof.logs.content import Beside, LogPiece
from skyproof.logs.frames import Frames, Protocol
from skyproof.records import CellStatus, Observations, ReceiverFixes, SignalId

__all__ = ["NmeaReader"]

_DAY_NS: Final = 86_400 * 10**9
_SYSTEMS: Final = {"GP": "G", "GL": "R", "GA": "E", "GB": "C", "BD": "C", "GQ": "J", "QZ": "J", "GI": "I"}
_SIGNALS: Final = {
    "G": ("1C", "1C", "1P", "1M", "2P", "2S", "2L", "5I", "5Q"),
    "R": ("1C", "1C", "1P", "2C", "2P"),
    "E": ("1C", "5Q", "7Q", "8Q", "6A", "6C", "1A", "1C"),
    "C": ("2I", "2I", "2Q", "1P", "1A", "5P", "7D", "8P", "6I"),
    "J": ("1C", "1C", "1L", "1Z", "", "2S", "2L", "5I", "5Q"),
    "S": ("1C", "1C"),
    "I": ("5A", "5A"),
}
"""RINEX name by signal number (table 20); the first one where a sentence says none."""
_NUMBERS: Final = {
    "G": ((1, 32, "G", 0), (33, 64, "S", 13), (152, 158, "S", 100), (193, 202, "J", 192)),
    "R": ((65, 96, "R", 64), (33, 64, "S", 13), (1, 24, "R", 0)),
    "E": ((1, 36, "E", 0), (301, 336, "E", 300)),
    "C": ((1, 63, "C", 0), (141, 203, "C", 140), (201, 263, "C", 200), (401, 463, "C", 400)),
    "J": ((1, 10, "J", 0), (193, 202, "J", 192)),
    "I": ((1, 14, "I", 0),),
}
"""First and last number of a talker's satellites, their system, and what is taken off: as receivers count them."""


@dataclass(slots=True)
class _Epoch:
    """What the sentences of one time of day state; angles in degrees."""

    of_day_ns: int
    leap_ns: int
    date: np.datetime64 | None = None
    lat_deg: float = np.nan
    lon_deg: float = np.nan
    altitude_m: float = np.nan
    separation_m: float = np.nan
    satellites: int = -1
    sigma_enu_m: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    cn0_dbhz: dict[SignalId, float] = field(default_factory=dict)
    utc_ns: int = 0

    @property
    def placed(self) -> bool:
        """Whether it has a place."""
        return bool(np.isfinite(self.lat_deg + self.lon_deg))

    def add(self, sentence: Sentence) -> None:
        """Take what a sentence of this epoch states; of two places that of GGA or GNS, which has the height.

        A place that is not of satellites is none.
        """
        self.date = self.date if sentence.date is None else sentence.date
        if sentence.estimated:
            return
        if sentence.kind in ("GGA", "GNS") or np.isnan(self.lat_deg):
            self.lat_deg, self.lon_deg = sentence.lat_deg, sentence.lon_deg
        if sentence.kind in ("GGA", "GNS"):
            self.altitude_m, self.separation_m = sentence.altitude_m, sentence.separation_m
            self.satellites = sentence.satellites
        if sentence.kind == "GST":
            self.sigma_enu_m = sentence.sigma_enu_m


class NmeaReader:
    """Read NMEA sentences, stretch by stretch (`LogReader`).

    The sentences of an epoch are those that follow each other with one time of day. Where nothing says the date, epochs
    are left out and counted, or counted from a day that is given. A place without a height has that of the last one
    with it, or the ellipsoid's.
    """

    def __init__(self, source: str, beside: Beside) -> None:
        """Begin a log; `source` names the receiver."""
        self._source = source
        self._near, self._first_day = beside.near, beside.first_day
        self._epoch: _Epoch | None = None
        self._last_of_day_ns = 0
        self._day_ns: int | None = None  # of UTC, of the last epoch
        self._height_m = 0.0
        self._remarks: tuple[str, ...] = ()

    def read(self, frames: Frames) -> LogPiece:
        """Read the sentences of a stretch; the last epoch waits for the next one."""
        begin, length = frames.select(Protocol.NMEA)
        octets = frames.octets.tobytes()
        messages: Counter[str] = Counter()
        damaged = 0
        epochs: list[_Epoch] = [] if self._epoch is None else [self._epoch]
        for first, size in zip(begin.tolist(), length.tolist(), strict=True):
            fields = octets[first + 1 : first + size].decode("latin-1").partition("*")[0].split(",")
            messages[f"NMEA {fields[0][2:5]}" if fields[0][:1] != "P" else "NMEA P"] += 1
            try:
                sentence = read_sentence(fields)
            except (ValueError, IndexError):
                damaged += 1
                continue
            if sentence is not None:
                _put(sentence, epochs)
        self._epoch = None if frames.last or not epochs else epochs.pop()
        dated = self._date(epochs)
        return LogPiece(
            observations=_strengths([epoch for epoch in dated if epoch.cn0_dbhz or epoch.placed], self._source),
            fixes=self._fixes([epoch for epoch in dated if epoch.placed]),
            messages=dict(messages),
            damaged_frames=damaged,
            undated_epochs=len(epochs) - len(dated),
            remarks=self._remarks,
        )

    def _date(self, epochs: list[_Epoch]) -> list[_Epoch]:
        """Give epochs their instants; the day goes on where the time of day falls by more than half a day.

        The date counts of epochs with a place: a receiver that knows none may write any.
        """
        stated_ns = {
            k: int(epoch.date.astype(np.int64))
            for k, epoch in enumerate(epochs)
            if epoch.date is not None and epoch.placed
        }
        of_day_ns = np.array([self._last_of_day_ns, *(epoch.of_day_ns for epoch in epochs)])
        day = np.cumsum(np.diff(of_day_ns) < -_DAY_NS // 2).tolist()
        if self._day_ns is None and stated_ns:
            first, date_ns = next(iter(stated_ns.items()))
            self._day_ns = date_ns - day[first] * _DAY_NS
        elif self._day_ns is None and self._near is not None and epochs:
            near_ns = int(self._near.astype("datetime64[ns]").astype(np.int64))
            self._day_ns = round((near_ns - epochs[0].of_day_ns) / _DAY_NS) * _DAY_NS - day[0] * _DAY_NS
        elif self._day_ns is None and self._first_day is not None and epochs:
            self._day_ns = int(self._first_day.astype("datetime64[ns]").astype(np.int64)) - day[0] * _DAY_NS
            self._remarks = (f"no sentence says the date: days count from {str(self._first_day)[:10]}",)
        if self._day_ns is None:
            return []
        begin_ns = self._day_ns
        for k, epoch in enumerate(epochs):
            begin_ns = stated_ns[k] - day[k] * _DAY_NS if k in stated_ns else begin_ns
            epoch.utc_ns = begin_ns + day[k] * _DAY_NS + epoch.of_day_ns
        if epochs:
            self._day_ns, self._last_of_day_ns = begin_ns + day[-1] * _DAY_NS, epochs[-1].of_day_ns
        return epochs

    def _fixes(self, epochs: list[_Epoch]) -> ReceiverFixes | None:
        if not epochs:
            return None
        heights_m = []
        for epoch in epochs:
            if np.isfinite(epoch.altitude_m):
                self._height_m = epoch.altitude_m + (0.0 if np.isnan(epoch.separation_m) else epoch.separation_m)
            heights_m.append(self._height_m)
        sigma_m = np.array([epoch.sigma_enu_m for epoch in epochs])
        return ReceiverFixes.from_geodetic(
            np.array([_instant(epoch) for epoch in epochs], "M8[ns]"),
            np.radians([epoch.lat_deg for epoch in epochs]),
            np.radians([epoch.lon_deg for epoch in epochs]),
            np.array(heights_m),
            horizontal_sigma_m=np.hypot(sigma_m[:, 0], sigma_m[:, 1]),
            vertical_sigma_m=sigma_m[:, 2].copy(),
            satellites=np.array([epoch.satellites for epoch in epochs], np.int64),
        )


def _put(sentence: Sentence, epochs: list[_Epoch]) -> None:
    """Put a sentence into the last epoch, or into a new one."""
    if sentence.kind == "GSV":
        if epochs:
            for number, signal, cn0_dbhz in sentence.strengths:
                name = _signal_of(sentence.talker, number, signal)
                if name is not None:
                    epochs[-1].cn0_dbhz[name] = cn0_dbhz
        return
    at = sentence.of_day_ns, sentence.leap_ns
    if sentence.of_day_ns is None:
        return
    if not epochs or (epochs[-1].of_day_ns, epochs[-1].leap_ns) != at:
        epochs.append(_Epoch(sentence.of_day_ns, sentence.leap_ns))
    epochs[-1].add(sentence)


@lru_cache(1 << 12)
def _signal_of(talker: str, number: int, signal: int) -> SignalId | None:
    """Return the signal of a satellite's number in GSV; None for what has no name here."""
    ranges = _NUMBERS.get(_SYSTEMS.get(talker, ""), ())
    found = next(((system, number - off) for low, high, system, off in ranges if low <= number <= high), None)
    if found is None:
        return None
    system, prn = found
    names = _SIGNALS[system]
    attribute = names[signal] if signal < len(names) else ""
    kind = rinex_signal(system, attribute) if attribute else None
    return None if kind is None else SignalId(f"{system}{prn:02d}", *kind)


def _instant(epoch: _Epoch) -> np.datetime64:
    """Return the GPS time of an epoch."""
    instant: np.datetime64 = gpst_from_utc(np.datetime64(epoch.utc_ns, "ns")) + np.timedelta64(epoch.leap_ns, "ns")
    return instant


def _strengths(epochs: list[_Epoch], receiver: str) -> Observations | None:
    """Return C/N0 as measurements without ranges, of the epochs that follow each other in time; maybe of no signal."""
    instants = np.array([_instant(epoch) for epoch in epochs], "M8[ns]")
    if not instants.size:
        return None
    later = np.append(True, instants[1:] > np.maximum.accumulate(instants)[:-1])
    epochs, instants = [epoch for epoch, kept in zip(epochs, later.tolist(), strict=True) if kept], instants[later]
    signals = tuple(sorted({signal for epoch in epochs for signal in epoch.cn0_dbhz}))
    cells = [[epoch.cn0_dbhz.get(signal, np.nan) for signal in signals] for epoch in epochs]
    cn0_dbhz = np.array(cells, np.float64).reshape(len(epochs), len(signals))
    measured = np.isfinite(cn0_dbhz)
    none = np.full(cn0_dbhz.shape, np.nan)
    elapsed_s = (instants - instants[0]).astype(np.int64) * 1e-9
    first = measured.argmax(axis=0) if signals else np.empty(0, np.int64)
    return Observations(
        receiver=receiver,
        signals=signals,
        gpst=instants,
        elapsed_s=elapsed_s,
        pseudorange_m=none,
        carrier_cyc=none,
        doppler_hz=none,
        cn0_dbhz=cn0_dbhz,
        pseudorange_sigma_m=none,
        carrier_sigma_cyc=none,
        doppler_sigma_hz=none,
        status=np.where(measured, CellStatus.NO_RANGE, CellStatus.NOT_TRACKED).astype(np.uint8),
        found_elapsed_s=elapsed_s[first],
        missed_elapsed_s=np.where(first > 0, elapsed_s[np.maximum(first - 1, 0)], np.nan),
        carrier_hz=np.array([carrier_hz_of(signal.band) for signal in signals]),
    )
