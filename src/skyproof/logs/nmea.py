"""NMEA 0183: the receiver's own fixes, and the C/N0 of its satellites (version 4.11, with the numbers of 4.10).

GGA, GNS, GLL and RMC give places, RMC and ZDA the date, GST the accuracy, GSV what is received. There are no ranges.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from skyproof.arrays import Instants, Integers, Octets, Reals
from skyproof.formats.nmea_read import Sentence, read_sentence
from skyproof.gnss.signals import carrier_hz_of, rinex_signal
from skyproof.gnss.time import gpst_from_utc
from skyproof.logs.content import Beside, LogPiece
from skyproof.logs.frames import Frames, Protocol
from skyproof.logs.nmea_plain import LevelCells, pack, read_addresses, read_levels, read_plain, unpack
from skyproof.records import CellStatus, Observations, ReceiverFixes, SignalId

__all__ = ["NmeaReader"]

_DAY_NS: Final = 86_400 * 10**9
_UNREAD: Final = [pack(kind) for kind in ("GSA", "VTG", "TXT", "GBS", "GRS", "HDT", "DTM")]
"""Common kinds that are not read."""
_MOST_NAMES: Final = 1 << 12
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


class _Levels(NamedTuple):
    """C/N0 of satellites: number of the epoch, that of the signal among the reader's, dB-Hz; the last one holds."""

    epoch: Integers
    signal: Integers
    level_dbhz: Reals

    def of(self, first: int, stop: int) -> "_Levels":
        """Return what epochs from first to before stop have, these counted from 0."""
        kept = (self.epoch >= first) & (self.epoch < stop)
        return _Levels(self.epoch[kept] - first, self.signal[kept], self.level_dbhz[kept])


_NO_LEVELS: Final = _Levels(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))


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
        self._levels = _NO_LEVELS  # of that epoch
        self._signals: list[SignalId] = []
        self._number_of: dict[tuple[int, int, int], int] = {}  # -1 of what has no name
        self._last_of_day_ns = 0
        self._day_ns: int | None = None  # of UTC, of the last epoch
        self._height_m = 0.0
        self._remarks: tuple[str, ...] = ()

    def read(self, frames: Frames) -> LogPiece:
        """Read the sentences of a stretch; the last epoch waits for the next one."""
        begin, length = frames.select(Protocol.NMEA)
        octets = frames.octets
        addresses = read_addresses(octets, begin, length)
        rows = {kind: np.flatnonzero(addresses.kind == pack(kind)) for kind in ("GGA", "RMC", "GSV")}
        cells = read_levels(octets, begin[rows["GSV"]], length[rows["GSV"]])
        plain: dict[int, Sentence] = {}
        for kind in ("GGA", "RMC"):
            read = read_plain(octets, begin[rows[kind]], length[rows[kind]], kind)
            plain |= {row: found for row, found in zip(rows[kind].tolist(), read, strict=True) if found is not None}
        known = np.isin(addresses.kind, _UNREAD)
        known[rows["GSV"][cells.plain]] = True
        known[list(plain)] = True
        odd = self._odd_sentences(octets, begin, length, np.flatnonzero(~known))
        epochs: list[_Epoch] = [] if self._epoch is None else [self._epoch]
        first_rows = [-1] * len(epochs)
        for row, sentence in sorted((plain | odd.sentences).items()):
            if _put(sentence, epochs):
                first_rows.append(row)
        levels = self._join(cells, rows["GSV"], addresses.talker, odd.sentences, np.array(first_rows, np.int64))
        n = len(epochs)
        self._epoch = None if frames.last or not epochs else epochs.pop()
        self._levels = levels.of(len(epochs), n)
        dated = self._date(epochs)
        with_levels = set(levels.epoch.tolist())
        return LogPiece(
            observations=self._strengths(
                [(k, epoch) for k, epoch in enumerate(dated) if epoch.placed or k in with_levels], levels
            ),
            fixes=self._fixes([epoch for epoch in dated if epoch.placed]),
            messages=dict(_count(addresses.kind[known]) + odd.messages),
            damaged_frames=odd.damaged,
            undated_epochs=len(epochs) - len(dated),
            remarks=self._remarks,
        )

    def _odd_sentences(self, octets: Octets, begin: Integers, length: Integers, rows: Integers) -> "_Odd":
        """Read sentences one by one."""
        sentences: dict[int, Sentence] = {}
        messages: Counter[str] = Counter()
        damaged = 0
        for row in rows.tolist():
            first = int(begin[row])
            text = octets[first + 1 : first + int(length[row])].tobytes().decode("latin-1")
            fields = text.partition("*")[0].split(",")
            messages[f"NMEA {fields[0][2:5]}" if fields[0][:1] != "P" else "NMEA P"] += 1
            try:
                sentence = read_sentence(fields)
            except (ValueError, IndexError):
                damaged += 1
                continue
            if sentence is not None:
                sentences[row] = sentence
        return _Odd(sentences, messages, damaged)

    def _join(
        self,
        cells: LevelCells,
        rows: Integers,
        talker: Integers,
        odd: Mapping[int, Sentence],
        first_rows: Integers,
    ) -> _Levels:
        """Return the levels of a stretch and of the epoch that waits, by epoch."""
        row = rows[cells.sentence]
        keys = (talker[row] << 40) + (cells.number << 8) + cells.signal
        unique, index = np.unique(keys, return_inverse=True)
        number = np.array([self._number(key >> 40, key >> 8 & 0xFFFFFFFF, key & 255) for key in unique.tolist()], int)
        signal, level_dbhz = number[index] if keys.size else np.empty(0, np.int64), cells.level_dbhz
        rest = [
            (at, self._number(pack(sentence.talker), which, of), level)
            for at, sentence in odd.items()
            for which, of, level in sentence.strengths
        ]
        if rest:
            more = np.array(rest, np.float64)
            row = np.append(row, more[:, 0].astype(np.int64))
            signal = np.append(signal, more[:, 1].astype(np.int64))
            level_dbhz = np.append(level_dbhz, more[:, 2])
            order = np.argsort(row, kind="stable")
            row, signal, level_dbhz = row[order], signal[order], level_dbhz[order]
        epoch = np.searchsorted(first_rows, row, side="right") - 1
        kept = (signal >= 0) & (epoch >= 0)
        waiting = self._levels
        return _Levels(
            np.append(waiting.epoch, epoch[kept]),
            np.append(waiting.signal, signal[kept]),
            np.append(waiting.level_dbhz, level_dbhz[kept]),
        )

    def _number(self, talker: int, number: int, signal: int) -> int:
        """Return the number of a signal among the reader's."""
        key = talker, number, signal
        if key not in self._number_of:
            name = _signal_of(talker.to_bytes(2, "big").decode("latin-1"), number, signal)
            if name is not None and name not in self._signals:
                self._signals.append(name)
            if len(self._number_of) >= _MOST_NAMES:
                return -1 if name is None else self._signals.index(name)
            self._number_of[key] = -1 if name is None else self._signals.index(name)
        return self._number_of[key]

    def _date(self, epochs: list[_Epoch]) -> list[_Epoch]:
        """Give epochs their instants; the day advances where the time of day falls by more than half a day.

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

    def _strengths(self, epochs: list[tuple[int, _Epoch]], levels: _Levels) -> Observations | None:
        """Return C/N0 as measurements without ranges, of the epochs that follow each other in time; maybe of no signal.

        epochs : with their numbers in `levels`.
        """
        instants = _instants([epoch for _, epoch in epochs])
        if not instants.size:
            return None
        later = np.append(True, instants[1:] > np.maximum.accumulate(instants)[:-1])
        instants = instants[later]
        row_of = np.full(max(int(levels.epoch.max(initial=0)), epochs[-1][0]) + 1, -1)
        row_of[np.array([number for number, _ in epochs])[later]] = np.arange(instants.size)
        row = row_of[levels.epoch]
        kept = row >= 0
        present = np.unique(levels.signal[kept]).tolist()
        order = sorted(present, key=self._signals.__getitem__)
        column_of = np.full(len(self._signals) + 1, -1)
        column_of[order] = np.arange(len(order))
        cn0_dbhz = np.full((instants.size, len(order)), np.nan)
        cn0_dbhz[row[kept], column_of[levels.signal[kept]]] = levels.level_dbhz[kept]
        signals = tuple(self._signals[number] for number in order)
        measured = np.isfinite(cn0_dbhz)
        none = np.full(cn0_dbhz.shape, np.nan)
        elapsed_s = (instants - instants[0]).astype(np.int64) * 1e-9
        first = measured.argmax(axis=0) if signals else np.empty(0, np.int64)
        return Observations(
            receiver=self._source,
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
            _instants(epochs),
            np.radians([epoch.lat_deg for epoch in epochs]),
            np.radians([epoch.lon_deg for epoch in epochs]),
            np.array(heights_m),
            horizontal_sigma_m=np.hypot(sigma_m[:, 0], sigma_m[:, 1]),
            vertical_sigma_m=sigma_m[:, 2].copy(),
            satellites=np.array([epoch.satellites for epoch in epochs], np.int64),
        )


def _put(sentence: Sentence, epochs: list[_Epoch]) -> bool:
    """Put a sentence into the last epoch, or into a new one; return whether there is a new one."""
    if sentence.of_day_ns is None:
        return False
    at = sentence.of_day_ns, sentence.leap_ns
    is_new = not epochs or (epochs[-1].of_day_ns, epochs[-1].leap_ns) != at
    if is_new:
        epochs.append(_Epoch(sentence.of_day_ns, sentence.leap_ns))
    epochs[-1].add(sentence)
    return is_new


class _Odd(NamedTuple):
    """Sentences that were read one by one, by row; how many of each kind there were, and how many are damaged."""

    sentences: dict[int, Sentence]
    messages: Counter[str]
    damaged: int


def _count(kinds: Integers) -> Counter[str]:
    """Count the messages of each kind."""
    unique, counts = np.unique(kinds, return_counts=True)
    return Counter({f"NMEA {unpack(kind)}": n for kind, n in zip(unique.tolist(), counts.tolist(), strict=True)})


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


def _instants(epochs: Sequence[_Epoch]) -> Instants:
    """Return the GPS time of epochs."""
    utc_ns = np.array([epoch.utc_ns for epoch in epochs], np.int64)
    leap_ns = np.array([epoch.leap_ns for epoch in epochs], np.int64)
    ahead_ns = np.array([_count_ahead_ns(day) for day in (utc_ns // _DAY_NS).tolist()], np.int64)
    return (utc_ns + ahead_ns + leap_ns).astype("M8[ns]")


@lru_cache(64)
def _count_ahead_ns(day: int) -> int:
    """Return by how much GPS time is ahead of UTC over a day, counted from 1970."""
    utc = np.datetime64(day * _DAY_NS, "ns")
    return int((gpst_from_utc(utc) - utc).astype(np.int64))
