"""RTCM 3: observations, broadcast orbits and the antenna's stated position (RTCM 10403.3, 3.5).

Observations say the second of the week, those of GLONASS the second of the day. The week is that of an orbit in the
stream, or is given.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Integers, Octets, Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import BDT_BEHIND_GPST_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.messages.rtcm import EPHEMERIS_MESSAGES, RelayedOrbit, read_relayed_orbit
from skyproof.gnss.signals import carrier_hz_of
from skyproof.gnss.time import GPS_EPOCH, leap_seconds, week_and_tow
from skyproof.logs.content import Beside, LogPiece
from skyproof.logs.frames import Frames, Protocol
from skyproof.logs.locks import NEVER, CarrierLocks
from skyproof.logs.rows import SignalRows, observations_from_rows
from skyproof.logs.rtcm3_cells import NO_CHANNEL, ObservedCells, PhaseTurns, legacy_cells, msm_cells, signal_of
from skyproof.records import Observations, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = ["Rtcm3Reader"]

_OTHER, _MSM, _LEGACY, _MODULO, _PLACE, _ORBIT = range(6)
_KINDS: Final = np.zeros(4096, np.uint8)
_KINDS[[1070 + 10 * system + kind for system in range(7) for kind in (4, 5, 6, 7)]] = _MSM
_KINDS[[1002, 1004, 1010, 1012]] = _LEGACY
_KINDS[[1001, 1003, 1009, 1011, *(1070 + 10 * s + kind for s in range(7) for kind in (1, 2, 3))]] = _MODULO
_KINDS[[1005, 1006]] = _PLACE
_KINDS[list(EPHEMERIS_MESSAGES)] = _ORBIT
"""Of each message number. Ranges modulo a millisecond need a place near the antenna."""
_NO_DAY: Final = 7
_DAY_MS: Final = 86_400_000
_WEEK_MS: Final = 7 * _DAY_MS
_MOSCOW_MS: Final = 3 * 3_600_000
_EPOCH_MS: Final = int(GPS_EPOCH.astype("datetime64[ms]").astype(np.int64))
_HALF_ERA: Final = 511  # weeks


class Rtcm3Reader:
    """Read RTCM 3 messages, stretch by stretch (`LogReader`).

    Messages of other stations than the first are left out and counted, and so are epochs before the week is known. The
    messages of the last epoch wait for the next stretch, which may bring more of that epoch.
    """

    def __init__(self, source: str, beside: Beside) -> None:
        """Begin a log; `source` names the receiver.

        Without an instant beside it an orbit in the stream says the week, the latest that is not after this machine's
        date.
        """
        near, channels = beside.near, beside.channels
        self._source = source
        self._last_ms = NEVER if near is None else int(near.astype("datetime64[ms]").astype(np.int64))
        today, _ = week_and_tow(np.datetime64("now") if near is None else near)
        self._week = today - _HALF_ERA if near is None else today
        self._channels = np.full(64, NO_CHANNEL)
        for sat, channel in (channels or {}).items():
            self._channels[int(sat[1:])] = channel
        self._station: int | None = None
        self._waiting: list[bytes] = []
        self._relayed: dict[tuple[int, str], bytes] = {}
        self._place = b""
        self._numbers: dict[int, int] = {}
        self._names: list[SignalId] = []
        self._locks, self._turns = CarrierLocks(), PhaseTurns()

    def read(self, frames: Frames) -> LogPiece:
        """Read the messages of a stretch."""
        content = _Contents.of(frames, self._waiting)
        new = content.number[len(self._waiting) :]
        messages = {f"RTCM {value}": int((new == value).sum()) for value in np.unique(new).tolist()}
        remarks: list[str] = list(self._list_stated_places(content))
        if (_KINDS[new] == _MODULO).any():
            remarks.append(_left_out("messages with ranges modulo a millisecond are not read; MSM4 to MSM7 are"))
        orbits = list(self._new_orbits(content))
        observed = content.rows((content.kind == _MSM) | (content.kind == _LEGACY))
        foreign = self._foreign(observed)
        if foreign.any():
            remarks.append(_left_out(f"messages of other stations than {self._station} are left out"))
            observed = observed.rows(~foreign)
        found, undated = None, 0
        time_ms, period_ms = _times(observed)
        if self._last_ms == NEVER:
            self._last_ms = _date(orbits, observed.begin, time_ms, period_ms)
        if self._last_ms == NEVER:
            self._waiting = []
            undated = int(np.unique(time_ms).size)
        else:
            found = self._observations(observed, time_ms, period_ms, last=frames.last)
        received = np.datetime64(self._last_ms, "ms").astype("datetime64[ns]")
        dated = orbits if self._last_ms != NEVER else []
        made = [orbit.ephemeris(received) for _, orbit in dated]
        return LogPiece(
            observations=found,
            ephemerides=tuple(ephemeris for ephemeris in made if ephemeris is not None),
            messages=messages,
            undated_epochs=undated,
            remarks=tuple(remarks),
        )

    # ------------------------------------------------------------------ what is no measurement

    def _list_stated_places(self, content: "_Contents") -> Iterator[str]:
        """Give in words where 1005 or 1006 says that the antenna is, each place once."""
        for row in np.flatnonzero(content.kind == _PLACE).tolist():
            stated = content.octets_of(row)
            fields = stated[3:19]
            if len(fields) < 16 or fields == self._place:
                continue
            self._place = fields
            bits = int.from_bytes(stated[:19], "big")
            xyz = [1e-4 * _read_signed(bits >> 8 * 19 - first - 38, 38) for first in (34, 74, 114)]
            if np.linalg.norm(xyz) > 1e6:
                lat, lon, height_m = (float(value) for value in geodetic_from_ecef(np.array(xyz)))
                yield (
                    f"the station states its antenna at {np.degrees(lat):.7f}, {np.degrees(lon):.7f}, {height_m:.2f} m "
                    "above the ellipsoid, which is not taken for true"
                )

    def _new_orbits(self, content: "_Contents") -> Iterator[tuple[int, RelayedOrbit]]:
        """Give the orbits that differ from the satellite's last ones, and the octet where each begins."""
        for row in np.flatnonzero(content.kind == _ORBIT).tolist():
            octets = content.octets_of(row)
            orbit = read_relayed_orbit(octets, self._week)
            if orbit is None or self._relayed.get((orbit.number, orbit.sat)) == octets:
                continue
            self._relayed[orbit.number, orbit.sat] = octets
            if orbit.channel is not None:
                self._channels[int(orbit.sat[1:])] = orbit.channel
            yield int(content.begin[row]), orbit

    def _foreign(self, observed: "_Contents") -> Booleans:
        """Tell which messages (n,) are not of the first station."""
        octets, begin = observed.octets, observed.begin
        station = (octets[begin + 1].astype(np.int64) & 15) << 8 | octets[begin + 2]
        if self._station is None and station.size:
            self._station = int(station[0])
        return np.asarray(station != self._station)

    # ------------------------------------------------------------------ measurements

    def _observations(
        self, observed: "_Contents", time_ms: Integers, period_ms: Integers, *, last: bool
    ) -> Observations | None:
        """Return the measurements of the whole epochs; the messages of the last one wait."""
        leaps_ms = 1000 * leap_seconds(np.datetime64(self._last_ms, "ms"))
        of_glonass = _is_glonass(observed.number)
        instant_ms = np.empty(time_ms.size, np.int64)
        _place(np.where(of_glonass, time_ms + leaps_ms, time_ms), period_ms, self._last_ms, instant_ms)
        if instant_ms.size:
            self._last_ms = int(instant_ms[-1])
        whole = np.full(instant_ms.size, last) | (instant_ms != self._last_ms)
        self._waiting = [observed.frame(row) for row in np.flatnonzero(~whole).tolist()]
        observed, instant_ms = observed.rows(whole), instant_ms[whole]
        old = observed.kind == _LEGACY
        rows: list[tuple[ObservedCells, Integers]] = []
        if not old.all():
            part = observed.rows(~old)
            rows.append((msm_cells(part.octets, part.begin, part.size, part.number, self._channels), instant_ms[~old]))
        if old.any():
            part = observed.rows(old)
            cells = legacy_cells(part.octets, part.begin, part.size, part.number, self._channels, self._turns)
            rows.append((cells, instant_ms[old]))
        if not rows:
            return None
        return observations_from_rows(self._rows(rows), self._source)

    def _rows(self, parts: list[tuple[ObservedCells, Integers]]) -> SignalRows:
        def column(name: str) -> NDArray[Any]:
            values = [getattr(cells, name) for cells, _ in parts]
            return values[0] if len(values) == 1 else np.concatenate(values)

        instant_ns = 1_000_000 * np.concatenate([instant_ms[cells.message] for cells, instant_ms in parts])
        signal, carrier_hz = self._signals_of(column("key"))
        kept = np.flatnonzero(signal >= 0)
        if len(parts) > 1:
            kept = kept[np.argsort(instant_ns[kept], kind="stable")]

        def chosen(name: str) -> NDArray[Any]:
            values = column(name)
            return values if kept.size == values.size and len(parts) == 1 else values[kept]

        signal, instant_ns = signal[kept], instant_ns[kept]
        cycles_a_m = carrier_hz[signal] / SPEED_OF_LIGHT_M_S
        carrier_cyc = chosen("phase_m") * cycles_a_m
        carrier = np.isfinite(carrier_cyc)
        half_open = chosen("half_open") & carrier
        none = np.full(kept.size, np.nan)
        return SignalRows(
            signals=tuple(self._names),
            frequency_numbers=self._frequency_numbers(),
            instant_ns=instant_ns,
            signal=signal,
            pseudorange_m=chosen("code_m"),
            carrier_cyc=carrier_cyc,
            doppler_hz=-chosen("rate_m_s") * cycles_a_m,
            cn0_dbhz=chosen("cn0_dbhz"),
            pseudorange_sigma_m=none,
            carrier_sigma_cyc=none,
            doppler_sigma_hz=none,
            slipped=self._locks.slips(
                instant_ns,
                signal,
                chosen("lock_ms"),
                carrier,
                half_open,
                longest_ms=chosen("longest_ms"),
                step_ms=1,
            ),
            half_cycle_open=half_open,
        )

    def _number_of(self, name: SignalId | None) -> int:
        """Return the index of a name, made when it is seen first; -1 for none."""
        if name is None:
            return -1
        if name not in self._names:
            self._names.append(name)
        return self._names.index(name)

    def _frequency_numbers(self) -> dict[str, int]:
        known = np.flatnonzero(self._channels != NO_CHANNEL).tolist()
        return {f"R{slot:02d}": int(self._channels[slot]) for slot in known}

    def _signals_of(self, key: Integers) -> tuple[Integers, Reals]:
        """Return the index of each signal in `_names`, -1 for what has no name, and the carriers of the names."""
        counts = np.bincount(key, minlength=1)
        index = np.full(counts.size, -1, np.int64)
        for value in np.flatnonzero(counts).tolist():
            if value not in self._numbers:
                self._numbers[value] = self._number_of(signal_of(value))
            index[value] = self._numbers[value]
        channels = self._frequency_numbers()
        carriers = [carrier_hz_of(name.band, channels.get(name.sat)) for name in self._names]
        return index[key], np.array([*carriers, np.nan])


# ---------------------------------------------------------------------- messages


@dataclass(frozen=True, eq=False, kw_only=True)
class _Contents:
    """Messages in order: octets, first octet and size of each content, and the message's number."""

    octets: Octets
    begin: Integers
    size: Integers
    number: Integers

    @classmethod
    def of(cls, frames: Frames, waiting: list[bytes]) -> "_Contents":
        """Take the messages of a stretch that have their number and station, behind frames that waited."""
        begin, length = frames.select(Protocol.RTCM3)
        octets = frames.octets
        if waiting:
            lengths = np.array([len(frame) for frame in waiting])
            octets = np.concatenate([np.frombuffer(b"".join(waiting), np.uint8), octets])
            begin = np.concatenate([np.cumsum(lengths) - lengths, begin + lengths.sum()])
            length = np.concatenate([lengths, length])
        kept = length >= 6 + 7  # number, station and time of an observation
        begin, size = begin[kept] + 3, length[kept] - 6
        number = octets[begin].astype(np.int64) << 4 | octets[begin + 1] >> 4
        return cls(octets=octets, begin=begin, size=size, number=number)

    @property
    def kind(self) -> Octets:
        """Return the number of each message in `_KINDS`."""
        return np.asarray(_KINDS[self.number])

    def rows(self, chosen: Booleans) -> "_Contents":
        """Return some of the messages."""
        return _Contents(
            octets=self.octets, begin=self.begin[chosen], size=self.size[chosen], number=self.number[chosen]
        )

    def octets_of(self, row: int) -> bytes:
        """Return the content of a message."""
        return self.octets[self.begin[row] : self.begin[row] + self.size[row]].tobytes()

    def frame(self, row: int) -> bytes:
        """Return a message with its header and checksum."""
        return self.octets[self.begin[row] - 3 : self.begin[row] + self.size[row] + 3].tobytes()


def _left_out(words: str) -> Remark:
    return Remark(words, RemarkKind.BEARS)


def _read_signed(bits: int, count: int) -> int:
    """Return the lowest bits of a number in two's complement."""
    value = bits & (1 << count) - 1
    return value - (1 << count) if value >> (count - 1) else value


# ---------------------------------------------------------------------- times


def _is_glonass(number: Integers) -> Booleans:
    return np.asarray((number // 10 == 108) | (number // 10 == 101))


def _times(observed: _Contents) -> tuple[Integers, Integers]:
    """Return the times of observations (n,) in milliseconds of a period, and the period: a week, or GLONASS's day.

    Of GPS time, but for GLONASS without its leap seconds.
    """
    first = observed.octets[observed.begin[:, None] + np.arange(3, 7)].astype(np.int64)
    word = first @ np.array([1 << 24, 1 << 16, 1 << 8, 1])
    number = observed.number
    time_ms = word >> 2
    system = number // 10
    # The bit behind the time says that more of the epoch follows: what then follows with the very time that GPS had is
    # of a sender that states GPS time for BeiDou's, as they did before the standard.
    more = np.append(False, (word[:-1] >> 1 & 1 > 0) & (observed.number[:-1] // 10 != 108))
    in_gpst = more & (time_ms == np.append(-1, time_ms[:-1]))
    time_ms = np.where((system == 112) & ~in_gpst, time_ms + round(1e3 * BDT_BEHIND_GPST_S), time_ms)
    day, of_day_ms = word >> 29, (word >> 2) & (1 << 27) - 1
    known_day = (system == 108) & (day != _NO_DAY)
    of_day_ms = np.where(system == 108, of_day_ms, word >> 5) - _MOSCOW_MS
    of_glonass = _is_glonass(number)
    time_ms = np.where(of_glonass, of_day_ms + np.where(known_day, day * _DAY_MS, 0), time_ms)
    return time_ms, np.where(of_glonass & ~known_day, _DAY_MS, _WEEK_MS)


@compiled
def _place(time_ms: Integers, period_ms: Integers, last_ms: int, instant_ms: Integers) -> None:
    """Fill in the instants, since 1970, each the one of its period that is nearest to the one before."""
    for k in range(time_ms.size):
        period = period_ms[k]
        instant_ms[k] = _EPOCH_MS + time_ms[k]
        instant_ms[k] += (last_ms - instant_ms[k] + period // 2) // period * period
        last_ms = instant_ms[k]


def _date(orbits: list[tuple[int, RelayedOrbit]], begin: Integers, time_ms: Integers, period_ms: Integers) -> int:
    """Return an instant near the first observation, milliseconds since 1970, by the weeks of orbits; or never.

    A message states the week of its transmission. It is taken at the time of the observation before it, or the first
    one. Orbits whose time lies beyond a turn of the week from there count where others do not: some senders state the
    week of the time of ephemeris.
    """
    weekly = np.flatnonzero(period_ms == _WEEK_MS)
    sure: list[int] = []
    others: list[int] = []
    for at, orbit in orbits:
        if orbit.week is None:
            continue
        week_ms = _EPOCH_MS + orbit.week * _WEEK_MS
        if not weekly.size:
            others.append(week_ms + round(1e3 * orbit.toe_s))
            continue
        before = int(np.searchsorted(begin[weekly], at)) - 1
        sent_ms = int(time_ms[weekly[max(before, 0)]])
        beyond = abs(sent_ms - 1e3 * orbit.toe_s) > _WEEK_MS / 2
        (others if beyond else sure).append(week_ms + sent_ms)
    instants = sure or others
    if not instants:
        return NEVER
    weeks = Counter((instant - _EPOCH_MS) // _WEEK_MS for instant in instants)
    (week, _), *_ = weeks.most_common(1)
    return next(instant for instant in instants if (instant - _EPOCH_MS) // _WEEK_MS == week)
