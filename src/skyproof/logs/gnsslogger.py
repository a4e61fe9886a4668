"""GnssLogger, the text that Android phones write: measurements, broadcast messages, fixes and levels of the front end.

Google, gps-measurement-tools, LOGGING.md (the rows); Android reference, GnssClock, GnssMeasurement,
GnssNavigationMessage (the fields); GSA, Using GNSS raw measurements on Android devices (2017), 2.4 (pseudoranges).
Columns are found by their names in the header, whatever the version.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Booleans, Instants, Integers, Octets, Reals
from skyproof.gnss.constants import FASTEST_M_S, SPEED_OF_LIGHT_M_S
from skyproof.gnss.lnav import words_hold
from skyproof.gnss.signals import carrier_hz_of, frequency_number_of, rinex_signal
from skyproof.gnss.time import GPS_EPOCH, gpst_from_utc, leap_seconds
from skyproof.logs.content import FRAME_BITS, BroadcastFrames, LogPiece, MessageKind
from skyproof.logs.locks import CarrierLocks
from skyproof.logs.rows import SignalRows, epochs_without_signals, observations_from_rows
from skyproof.logs.text import MISSING, Fields, TextStretch, read_fields, split_lines
from skyproof.records import FrontEndLevels, Observations, ReceiverFixes, SignalId

__all__ = ["is_gnsslogger", "read_gnsslogger"]

_HEADER: Final = re.compile(rb"^#\s*Raw\s*,[^\n]*\bTimeNanos\b[^\n]*\bFullBiasNanos\b", re.MULTILINE)
_ROWS: Final = (
    "Raw", "Fix", "Status", "Nav", "Agc", "NMEA", "Accel", "UncalAccel", "Gyro", "UncalGyro", "Mag", "UncalMag",
    "OrientationDeg", "GameRotationVector", "Pressure",
)  # fmt: skip
_RAW_WHOLES: Final = (
    "TimeNanos", "FullBiasNanos", "HardwareClockDiscontinuityCount", "Svid", "ConstellationType", "State",
    "ReceivedSvTimeNanos", "AccumulatedDeltaRangeState",
)  # fmt: skip
_RAW_REALS: Final = (
    "BiasNanos", "ReceivedSvTimeUncertaintyNanos", "TimeOffsetNanos", "Cn0DbHz", "PseudorangeRateMetersPerSecond",
    "PseudorangeRateUncertaintyMetersPerSecond", "AccumulatedDeltaRangeMeters",
    "AccumulatedDeltaRangeUncertaintyMeters", "CarrierFrequencyHz", "AgcDb",
)  # fmt: skip
_FIX: Final = {
    "Latitude": "LatitudeDegrees",
    "Longitude": "LongitudeDegrees",
    "Altitude": "AltitudeMeters",
    "Accuracy": "AccuracyMeters",
    "TimeInMs": "UnixTimeMillis",
    "(UTC)TimeInMs": "UnixTimeMillis",
}
"""What columns of Fix rows are called today, by what they were called."""
_FIX_REALS: Final = (
    "LatitudeDegrees", "LongitudeDegrees", "AltitudeMeters", "AccuracyMeters", "VerticalAccuracyMeters",
)  # fmt: skip

_SYSTEMS: Final = "?GSRJCEI"  # by ConstellationType
_FIRST_SVID: Final = {"S": 100, "J": 192}  # what is taken off a number
_DIGITS: Final = {"G": "125", "S": "15", "R": "12", "J": "1256", "C": "21567", "E": "1567", "I": "59"}
"""RINEX's digits of a system's carriers, the first where the phone states no carrier."""
_NEAR_MHZ: Final = 6.0  # GLONASS reaches 7 channels of 0.5625 MHz to either side
_USUAL_CODES: Final = {
    "G": {"1": "C", "2": "L", "5": "Q"},
    "S": {"1": "C", "5": "I"},
    "R": {"1": "C", "2": "C"},
    "J": {"1": "C", "2": "L", "5": "Q", "6": "L"},
    "C": {"2": "I", "1": "P", "5": "P", "6": "I", "7": "I"},
    "E": {"1": "C", "5": "Q", "6": "C", "7": "Q"},
    "I": {"5": "A", "9": "A"},
}
"""RINEX's letter where the log states no CodeType."""

_CODE_LOCK: Final = 1 << 0 | 1 << 10 | 1 << 11  # of any signal, and of Galileo's E1 by name
_TOW: Final = 1 << 3 | 1 << 14  # decoded, or known from elsewhere
_MS_AMBIGUOUS: Final = 1 << 4
_GLONASS_TOD: Final = 1 << 7 | 1 << 15
_E1C_SECONDARY: Final = 1 << 11
_ADR_VALID, _ADR_BROKEN, _ADR_HALF_RESOLVED = 1, 2 | 4, 8
_S: Final = 1_000_000_000
_WEEK_NS, _DAY_NS, _E1C_NS = 604_800 * _S, 86_400 * _S, _S // 10
_LEAST_E1C_NS: Final = 27_000_000  # a range of 77 ms within half a secondary code, clock included
_MS_NS: Final = 1_000_000
_EPOCH_NS: Final = int(GPS_EPOCH.astype(np.int64))
_BDT_NS: Final = 14 * _S
_FIRST_NS, _LAST_NS = (int(np.datetime64(f"{year}-01-01", "ns").astype(np.int64)) for year in (2000, 2200))
_LONGEST_LOCK_MS: Final = 1 << 40
_MS_M: Final = 1e-3 * SPEED_OF_LIGHT_M_S
_JOINED_S: Final = 600.0  # after which any oscillator may be off by a millisecond

_FRAMES: Final[dict[int, tuple[MessageKind, str, str, int]]] = {
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
_FRAME_BYTES: Final = 40
_DATA: Final = "Data(Bytes)"  # the first of them, and the others in the fields after it
_CHECKED: Final = (1, 2)  # Status: the parity held, or was mended; 0 is not known


def is_gnsslogger(head: bytes) -> bool:
    """Tell by the first bytes of a file whether it is a GnssLogger text: its header names the columns of Raw rows."""
    return _HEADER.search(head) is not None


def read_gnsslogger(blocks: Iterable[bytes], source: str) -> Iterator[LogPiece]:
    """Read a GnssLogger text in blocks of bytes, cut anywhere, stretch by stretch; `source` names the receiver."""
    reader = _GnssLogger(source)
    for stretch in split_lines(blocks, reader.complete):
        yield reader.read(stretch)


class _GnssLogger:
    """The reader's state: the columns of each kind of row, the phone's clock, its carriers and its satellites.

    Ranges are formed by the phone's hardware clock, set to GPS time by the first bias that it states, and not by the
    bias of each epoch. The phone estimates that bias anew each second: codes would step by its errors, carriers and
    Dopplers would not. When the bias has moved by more than a millisecond the clock is set by whole ones, as other
    receivers do, for which whatever reads observations is prepared. Where the hardware clock stops, as between the
    measurements of a phone that saves power, nothing tells how long: there the ranges are joined (`_PhoneClock.join`).
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._columns: dict[str, dict[str, int]] = {}
        self._keys = np.zeros(1, np.int64)  # what the log calls signals, in order; 0 is none
        self._numbers = np.full(1, -1, np.int64)  # of the signals of the keys
        self._signals: dict[SignalId, int] = {}
        self._names: list[SignalId] = []
        self._slots: dict[str, int] = {}
        self._clock = _PhoneClock()
        self._locks = CarrierLocks()
        self._last_ns: int | None = None  # the last epoch of the stretch before, for rows without a time

    # ------------------------------------------------------------------ stretches and columns

    def complete(self, stretch: TextStretch) -> int:
        """Return how many lines come before the last epoch: the next stretch may go on with it."""
        raw = self._find_columns(stretch).get("Raw")
        if raw is None or "Raw" not in self._columns:
            return stretch.begin.size
        time_ns = read_fields(stretch, raw, self._columns["Raw"], wholes=("TimeNanos",)).wholes["TimeNanos"]
        others = np.flatnonzero(time_ns != time_ns[-1])
        return int(raw[others[-1] + 1]) if others.size else stretch.begin.size

    def _find_columns(self, stretch: TextStretch) -> dict[str, Integers]:
        """Return the lines of each kind; note what header lines say of their columns."""
        words = stretch.words()
        for word, lines in words.items():
            kind = word.removeprefix("#").strip()
            if word.startswith("#") and kind in _ROWS:
                names = [name.strip() for name in stretch.line(int(lines[0])).split(",")]
                names = [_FIX.get(name, name) for name in names] if kind == "Fix" else names
                self._columns[kind] = {name: k for k, name in reversed(list(enumerate(names)))}
        return words

    def read(self, stretch: TextStretch) -> LogPiece:
        """Read a stretch."""
        lines = self._find_columns(stretch)
        counts = {word: rows.size for word, rows in lines.items() if not word.startswith("#")}
        messages = Counter({f"GnssLogger {word}": count for word, count in counts.items() if word in _ROWS})
        other = sum(count for word, count in counts.items() if word not in _ROWS)
        none = np.empty(0, np.int64)
        raw = read_fields(
            stretch,
            lines.get("Raw", none),
            self._columns.get("Raw", {}),
            reals=_RAW_REALS,
            wholes=_RAW_WHOLES,
            places=("TimeNanos", "CodeType"),
        )
        sound = raw.wholes["TimeNanos"] != MISSING
        for name in ("Svid", "State", "ReceivedSvTimeNanos"):
            sound &= raw.wholes[name] != MISSING
        damaged = int((~sound).sum()) + other
        raw = raw.select(sound)
        label_ns, part = self._clock.label(raw)
        known = part >= 0
        untimed = int(np.unique(raw.wholes["TimeNanos"][~known]).size)
        raw, label_ns, part = raw.select(known), label_ns[known], part[known]
        signal = self._signal_numbers(raw, stretch.octets)
        code_m, rate_m_s = _range_m(raw, label_ns, self._systems(signal)), raw.reals["PseudorangeRateMetersPerSecond"]
        shift_ns, drift_m_s = self._clock.join(label_ns, part, signal, code_m, rate_m_s)
        cells = _Ranges(
            code_m=code_m - SPEED_OF_LIGHT_M_S * 1e-9 * shift_ns,
            rate_m_s=rate_m_s - drift_m_s,
            carrier_m=raw.reals["AccumulatedDeltaRangeMeters"] - SPEED_OF_LIGHT_M_S * 1e-9 * shift_ns,
        )
        label_ns = label_ns - shift_ns
        remarks = []
        if untimed:
            remarks.append(f"{untimed} epochs before the phone knew the time are left out")
        if self._clock.breaks:
            remarks.append(
                "the phone stopped its clock between measurements, and its ranges are joined there, so that nothing "
                "shows how its time went on: turn on 'force full GNSS measurements' in its developer options"
            )
        if any(name in counts for name in ("Accel", "UncalAccel")):
            remarks.append("inertial readings of the phone stand in the log and are not used: give them with --imu")
        observations = self._observations(raw, label_ns, part, signal, cells)
        fixes = self._fixes(stretch, lines.get("Fix", none))
        if observations is None and fixes is not None:
            observations = epochs_without_signals(fixes.gpst, self._source)
        piece = LogPiece(
            observations=observations,
            fixes=fixes,
            levels=self._levels(stretch, lines.get("Agc", none), raw, label_ns),
            frames=self._frames(stretch, lines.get("Nav", none), raw, label_ns),
            messages=dict(messages),
            damaged_frames=damaged,
            cut=stretch.cut,
            remarks=tuple(remarks),
        )
        if label_ns.size:
            self._last_ns = int(label_ns[-1])
        return piece

    # ------------------------------------------------------------------ measurements

    def _systems(self, signal: Integers) -> Any:
        """Return the letter of each row's system; "?" for what no satellite sends."""
        return np.array([*(name.sat[0] for name in self._names), "?"])[signal]

    def _observations(
        self, raw: Fields, label_ns: Integers, part: Integers, signal: Integers, cells: "_Ranges"
    ) -> Observations | None:
        kept = signal >= 0
        raw, label_ns, part, signal = raw.select(kept), label_ns[kept], part[kept], signal[kept]
        code_m, rate_m_s, carrier_m = (values[kept] for values in cells)
        if not signal.size:
            return None
        names = self._names
        usual_hz = np.array([carrier_hz_of(name.band, self._slots.get(name.sat)) for name in names])[signal]
        stated_hz = raw.reals["CarrierFrequencyHz"]
        per_m = np.where(stated_hz > 0.0, stated_hz, usual_hz) / SPEED_OF_LIGHT_M_S
        state = raw.wholes["State"]
        later_s = _or_zero(raw.reals["TimeOffsetNanos"]) * 1e-9
        moved_m = np.where(later_s == 0.0, 0.0, rate_m_s * later_s)  # from the epoch to the moment of measurement
        adr_state = raw.wholes["AccumulatedDeltaRangeState"]
        adr_state = np.where(adr_state == MISSING, 0, adr_state)
        carrier_cyc = (carrier_m - moved_m) * per_m
        carrier = (adr_state & _ADR_VALID > 0) & np.isfinite(carrier_cyc)
        half_open = carrier & (adr_state & _ADR_HALF_RESOLVED == 0)
        slipped = self._locks.slips(
            label_ns,
            signal,
            self._clock.run_ms(label_ns, part),
            carrier,
            half_open,
            longest_ms=np.full(signal.size, _LONGEST_LOCK_MS),
            step_ms=1,
        )
        with np.errstate(over="ignore"):  # a damaged number; what is not plausible is left out later
            doppler_hz = -rate_m_s * per_m
        rows = SignalRows(
            signals=tuple(names),
            frequency_numbers=self._slots,
            instant_ns=label_ns,
            signal=signal,
            pseudorange_m=code_m + SPEED_OF_LIGHT_M_S * later_s - moved_m,
            carrier_cyc=np.where(carrier, carrier_cyc, np.nan),
            doppler_hz=np.where(state & _CODE_LOCK > 0, doppler_hz, np.nan),
            cn0_dbhz=_positive(raw.reals["Cn0DbHz"]),
            pseudorange_sigma_m=_positive(raw.reals["ReceivedSvTimeUncertaintyNanos"]) * 1e-9 * SPEED_OF_LIGHT_M_S,
            carrier_sigma_cyc=_positive(raw.reals["AccumulatedDeltaRangeUncertaintyMeters"]) * per_m,
            doppler_sigma_hz=_positive(raw.reals["PseudorangeRateUncertaintyMetersPerSecond"]) * per_m,
            slipped=carrier & (slipped | (adr_state & _ADR_BROKEN > 0)),
            half_cycle_open=half_open,
        )
        return observations_from_rows(rows, self._source)

    def _signal_numbers(self, raw: Fields, octets: Octets) -> Integers:
        """Return the number of each row's signal, -1 for what no satellite sends."""
        system, svid = raw.wholes["ConstellationType"], raw.wholes["Svid"]
        system = np.where(system == MISSING, 1, system)
        hertz = _or_zero(raw.reals["CarrierFrequencyHz"])
        steps = np.clip(np.rint(hertz / 62_500.0), 0, 65_535).astype(np.int64)  # a ninth of GLONASS's steps
        code = octets[np.maximum(raw.places["CodeType"], 0)].astype(np.int64)
        named = raw.places["CodeType"] >= 0
        good = (system > 0) & (system < len(_SYSTEMS)) & (svid > 0) & (svid < 256)
        key = (system << 40 | svid << 32 | steps << 16 | np.where(named, code, 0)) * good
        place = np.minimum(np.searchsorted(self._keys, key), self._keys.size - 1)
        new = np.flatnonzero(self._keys[place] != key)
        if new.size:
            more = np.setdiff1d(key[new], self._keys)
            numbers = [self._number_of(value) for value in more.tolist()]
            self._keys, order = np.unique(np.append(self._keys, more), return_index=True)
            self._numbers = np.append(self._numbers, numbers)[order]
            place = np.searchsorted(self._keys, key)
        return self._numbers[place]

    def _number_of(self, key: int) -> int:
        """Return the number of a signal, made when it is seen first; -1 for what no satellite sends."""
        signal = self._signal_of(key >> 40, key >> 32 & 0xFF, (key >> 16 & 0xFFFF) * 0.0625, chr(key & 0xFF))
        if signal is None:
            return -1
        if signal not in self._signals:
            self._signals[signal] = len(self._names)
            self._names.append(signal)
        return self._signals[signal]

    def _signal_of(self, constellation: int, svid: int, mhz: float, code: str) -> SignalId | None:
        system = _SYSTEMS[constellation]
        digit = _digit_of(system, mhz)
        prn = svid - _FIRST_SVID.get(system, 0)
        # GLONASS's satellites whose slot is not known yet are named by their frequency, which two of them share.
        if digit is None or not 1 <= prn <= (24 if system == "R" else 99):
            return None
        kind = rinex_signal(system, digit + code) if code.isalpha() and code.isupper() else None
        kind = kind if kind is not None else rinex_signal(system, digit + _USUAL_CODES[system][digit])
        signal = None if kind is None else SignalId(f"{system}{prn:02d}", *kind)
        if signal is not None and system == "R":
            number = frequency_number_of(signal.band, 1e6 * mhz)
            if number is not None and abs(number) <= 7 and mhz > 0.0:
                self._slots[signal.sat] = number
        return signal

    # ------------------------------------------------------------------ fixes, levels

    def _fixes(self, stretch: TextStretch, lines: Integers) -> ReceiverFixes | None:
        """Return the fixes of the receiver itself: those of networks and of sensors are not of its signals."""
        columns = self._columns.get("Fix", {})
        fix = read_fields(stretch, lines, columns, reals=_FIX_REALS, wholes=("UnixTimeMillis",), places=("Provider",))
        utc_ms, at = fix.wholes["UnixTimeMillis"], fix.places["Provider"]
        good = (utc_ms > _FIRST_NS // _MS_NS) & (utc_ms < _LAST_NS // _MS_NS)
        good &= (np.abs(fix.reals["LatitudeDegrees"]) <= 90.0) & (np.abs(fix.reals["LongitudeDegrees"]) <= 360.0)
        if "Provider" in columns:
            good &= (at >= 0) & (stretch.octets[np.maximum(at, 0)] | 0x20 == ord("g"))  # GPS, gps
        fix = fix.select(good)
        if not good.any():
            return None
        utc = (utc_ms[good] * _MS_NS).astype("datetime64[ns]")
        return ReceiverFixes.from_geodetic(
            utc + (gpst_from_utc(utc[0]) - utc[0]),
            np.radians(fix.reals["LatitudeDegrees"]),
            np.radians(fix.reals["LongitudeDegrees"]),
            fix.reals["AltitudeMeters"],
            horizontal_sigma_m=_positive(fix.reals["AccuracyMeters"]),
            vertical_sigma_m=_positive(fix.reals["VerticalAccuracyMeters"]),
        )

    def _levels(self, stretch: TextStretch, lines: Integers, raw: Fields, label_ns: Integers) -> FrontEndLevels | None:
        """Return the levels of Agc rows, or where there are none those that stand beside measurements, each once."""
        agc = read_fields(
            stretch,
            lines,
            self._columns.get("Agc", {}),
            reals=("AgcDb", "CarrierFrequencyHz"),
            wholes=("TimeNanos", "FullBiasNanos", "ConstellationType"),
        )
        timed = (agc.wholes["TimeNanos"] != MISSING) & (agc.wholes["FullBiasNanos"] != MISSING)
        agc = agc.select(timed)
        instant_ns = _EPOCH_NS + agc.wholes["TimeNanos"] - agc.wholes["FullBiasNanos"]
        if not instant_ns.size:
            agc, instant_ns = raw, label_ns
        gain_db, system = agc.reals["AgcDb"], agc.wholes["ConstellationType"]
        system = np.where(system == MISSING, 1, system)
        hertz = _or_zero(agc.reals["CarrierFrequencyHz"])
        good = np.isfinite(gain_db) & (system > 0) & (system < len(_SYSTEMS))
        good &= (instant_ns > _FIRST_NS) & (instant_ns < _LAST_NS)
        key = np.rint(np.clip(hertz[good], 0.0, 4e9) / 1e6).astype(np.int64) << 8 | system[good]
        distinct, number = np.unique(key, return_inverse=True)
        bands = [_band_of(_SYSTEMS[value & 0xFF], float(value >> 8)) for value in distinct.tolist()]
        band = np.array(bands, np.str_)[number] if number.size else np.empty(0, "U3")
        _, first = np.unique(np.stack([instant_ns[good], number]), axis=1, return_index=True)
        first = np.sort(first[band[first] != ""])
        if not first.size:
            return None
        missing = np.full(first.size, np.nan)
        return FrontEndLevels(
            gpst=instant_ns[good][first].astype("datetime64[ns]"),
            band=band[first],
            agc_db=gain_db[good][first],
            agc_share=missing,
            noise_db=missing,
            jamming_share=missing,
        )

    # ------------------------------------------------------------------ broadcast messages

    def _frames(
        self, stretch: TextStretch, lines: Integers, raw: Fields, label_ns: Integers
    ) -> tuple[BroadcastFrames, ...]:
        """Return the frames of Nav rows, each at the epoch before it, a record a kind of message."""
        columns = self._columns.get("Nav", {})
        if not lines.size or _DATA not in columns:
            return ()
        numbered = {f"{k}": columns[_DATA] + k for k in range(_FRAME_BYTES)}
        names = "Svid", "Type", "Status"
        nav = read_fields(stretch, lines, columns | numbered, wholes=(*names, *numbered)).wholes
        svid, kind, status = (nav[name] for name in names)
        data = np.stack([nav[name] for name in numbered], axis=1)
        place = np.searchsorted(raw.places["TimeNanos"], stretch.begin[lines]) - 1
        before = label_ns[np.maximum(place, 0)] if label_ns.size else np.full(lines.size, MISSING)
        before = np.where(place >= 0, before, MISSING if self._last_ns is None else self._last_ns)
        after = np.append(label_ns, MISSING)[place + 1]
        found: dict[MessageKind, list[tuple[Integers, SignalId, Octets]]] = {}
        for number in np.unique(kind).tolist():
            if number not in _FRAMES:
                continue
            name, system, attribute, n_bytes = _FRAMES[number]
            octets = data[:, :n_bytes]
            good = (kind == number) & (before != MISSING) & (np.abs(octets) <= 255).all(axis=1)
            good &= np.isin(status, _CHECKED) | (name == "LNAV")
            for sv in np.unique(svid[good]).tolist():
                prn = sv - _FIRST_SVID.get(system, 0)
                signal = rinex_signal(system, attribute)
                if signal is None or not 1 <= prn <= (24 if system == "R" else 63):
                    continue
                rows = np.flatnonzero(good & (svid == sv))
                bits, holds = _frame_bits(name, np.unpackbits((octets[rows] & 0xFF).astype(np.uint8), axis=1))
                found.setdefault(name, []).append((rows[holds], SignalId(f"{system}{prn:02d}", *signal), bits[holds]))
        return tuple(_record(name, parts, before, after) for name, parts in sorted(found.items()))


class _Ranges(NamedTuple):
    """Codes, their rates and carriers of rows, by the clock of their labels."""

    code_m: Reals
    rate_m_s: Reals
    carrier_m: Reals


class _PhoneClock:
    """What the phone's hardware clock shows, set to GPS time.

    A part is what it runs without a stop; parts are counted from 0. breaks : stops that the phone counted.
    """

    def __init__(self) -> None:
        self.breaks = 0
        self._time_ns: int | None = None
        self._count = 0
        self._bias_ns: int | None = None
        self._since_ns: list[int] = []  # the first label of each part
        self._shifts = np.empty((0, 3))  # `_shift` of each part
        self._last = np.empty((0, 4))  # time (s), part, code (m) and rate (m/s) of the last row of each signal

    def label(self, raw: Fields) -> tuple[Integers, Integers]:
        """Return what the clock shows at each row (n,), and the number of the part; -1 where it has no time."""
        time_ns, full_ns, count = (raw.wholes[name] for name in _RAW_WHOLES[:3])
        first = np.flatnonzero(np.append(True, np.diff(time_ns) != 0)) if time_ns.size else np.empty(0, np.int64)
        sizes = np.diff(np.append(first, time_ns.size))
        sub_ns = _or_zero(raw.reals["BiasNanos"])
        columns = [values[first].tolist() for values in (time_ns, full_ns, sub_ns, count)]
        labels = [self._label(*epoch) for epoch in zip(*columns, strict=True)]
        label_ns, part = np.array(labels, np.int64).reshape(-1, 2).repeat(sizes, axis=0).T
        return label_ns, part

    def _label(self, time_ns: int, full_ns: int, sub_ns: float, count: int) -> tuple[int, int]:
        bias_ns = full_ns + round(sub_ns)
        if full_ns in (MISSING, 0) or not _FIRST_NS < _EPOCH_NS + time_ns - bias_ns < _LAST_NS:
            return 0, -1  # the phone does not know the time
        stopped = self._time_ns is not None and (count != self._count or time_ns < self._time_ns)
        self.breaks += stopped
        if self._bias_ns is None or stopped:
            self._bias_ns = bias_ns
            self._since_ns.append(_EPOCH_NS + time_ns - bias_ns)
        elif abs(bias_ns - self._bias_ns) > _MS_NS:
            self._bias_ns += round((bias_ns - self._bias_ns) / _MS_NS) * _MS_NS
        self._time_ns, self._count = time_ns, count
        return _EPOCH_NS + time_ns - self._bias_ns, len(self._since_ns) - 1

    def run_ms(self, label_ns: Integers, part: Integers) -> Integers:
        """Return for how long the clock has run at rows without a stop."""
        return np.asarray(label_ns - np.array(self._since_ns)[part]) // _MS_NS

    def join(
        self, label_ns: Integers, part: Integers, signal: Integers, code_m: Reals, rate_m_s: Reals
    ) -> tuple[Integers, Reals]:
        """Return what a clock that goes on over the stops shows less at rows (n,), ns, and its rate, m/s.

        A stop of unknown length, after which the oscillator has another rate, adds the same to all codes and to all
        their rates: the median of what the signals show beyond their last measurement is taken off. What satellites do
        differently stays as it is. The phone's own bias counts where no signal is left. Whole milliseconds are given
        back.
        """
        more = max(int(signal.max(initial=-1)) + 1 - len(self._last), 0)
        self._last = np.vstack([self._last, np.full((more, 4), np.nan)])
        kept = np.flatnonzero((signal >= 0) & np.isfinite(code_m) & (np.abs(rate_m_s) <= FASTEST_M_S))
        order = kept[np.argsort(signal[kept], kind="stable")]
        since_s = (label_ns - (self._since_ns[0] if self._since_ns else 0)) * 1e-9
        rows = np.stack([since_s, part, code_m, rate_m_s], axis=1)[order]
        leads = np.append(True, np.diff(signal[order]) != 0)[: order.size]
        before = np.roll(rows, 1, axis=0)
        before[leads] = self._last[signal[order[leads]]]
        ends = np.append(leads[1:], True)[: order.size]
        self._last[signal[order[ends]]] = rows[ends]
        gap_s = rows[:, 0] - before[:, 0]
        over = np.flatnonzero((gap_s > 0.0) & (gap_s < _JOINED_S) & (before[:, 1] < rows[:, 1]))
        over = over[np.argsort(rows[over, 1], kind="stable")]
        begin = np.searchsorted(rows[over, 1], np.arange(len(self._shifts), len(self._since_ns) + 1))
        for number, (first, stop) in enumerate(pairwise(begin.tolist()), len(self._shifts)):
            chosen = over[first:stop]
            self._shifts = np.vstack([self._shifts, self._shift(number, rows[chosen], before[chosen])])
        began_s, shift_m, drift_m_s = self._shifts[part].T
        moved_m = shift_m + drift_m_s * (since_s - began_s)
        return np.rint(moved_m / SPEED_OF_LIGHT_M_S * 1e9).astype(np.int64), drift_m_s

    def _shift(self, part: int, rows: Reals, before: Reals) -> list[float]:
        """Return when a part began (s), what is taken off its codes then (m) and off their rates (m/s)."""
        began_s = (self._since_ns[part] - self._since_ns[0]) * 1e-9
        if not len(rows):
            return [began_s, 0.0, 0.0]
        then_s, shift_m, drift_m_s = self._shifts[before[:, 1].astype(np.int64)].T
        rate_m_s = before[:, 3] - drift_m_s
        new_m_s = float(np.median(rows[:, 3] - rate_m_s))
        code_m = before[:, 2] - shift_m - drift_m_s * (before[:, 0] - then_s)
        gap_s = rows[:, 0] - before[:, 0]
        over_m = rows[:, 2] - code_m - 0.5 * gap_s * (rate_m_s + rows[:, 3] - new_m_s)
        new_m = float(np.median(over_m - new_m_s * (rows[:, 0] - began_s)))
        return [began_s, new_m - round(new_m / _MS_M) * _MS_M, new_m_s]


def _range_m(raw: Fields, label_ns: Integers, systems: Any) -> Reals:
    """Return pseudoranges; NaN where the time of transmission is not known in full.

    The time of week, or GLONASS's of day, counts to the one nearest to the receiver's clock. Galileo's pilot shows
    100 ms of it by its secondary code, which is enough for a clock that is right to 20 ms.
    """
    state, sent_ns = raw.wholes["State"], raw.wholes["ReceivedSvTimeNanos"]
    glonass, galileo = systems == "R", systems == "E"
    locked = (state & _CODE_LOCK > 0) & (state & _MS_AMBIGUOUS == 0)
    full = locked & (state & np.where(glonass, _GLONASS_TOD, _TOW) > 0)
    secondary = locked & ~full & galileo & (state & _E1C_SECONDARY > 0)
    ahead_ns = np.where(systems == "C", -_BDT_NS, 0)
    if glonass.any():
        leap_s = leap_seconds(label_ns[0].astype("datetime64[ns]"))
        ahead_ns = np.where(glonass, (3 * 3600 - leap_s) * _S, ahead_ns)
    modulus_ns = np.where(secondary, _E1C_NS, np.where(glonass, _DAY_NS, _WEEK_NS))
    least_ns = np.where(secondary, _LEAST_E1C_NS, -modulus_ns // 2)
    good = (full | secondary) & (sent_ns >= 0) & (sent_ns <= _WEEK_NS)
    travel_ns = (label_ns - _EPOCH_NS + ahead_ns - np.where(good, sent_ns, 0) - least_ns) % modulus_ns + least_ns
    return np.where(good, travel_ns * 1e-9 * SPEED_OF_LIGHT_M_S, np.nan)


def _or_zero(values: Reals) -> Reals:
    return np.where(np.isnan(values), 0.0, values)


def _positive(values: Reals) -> Reals:
    return np.where(values > 0.0, values, np.nan)


def _digit_of(system: str, mhz: float) -> str | None:
    """Return RINEX's digit of a carrier, the usual one where it is not stated; None for one that no satellite sends."""
    digits = _DIGITS.get(system, "")
    if mhz <= 0.0:
        return digits[:1] or None
    off_mhz = {digit: abs(_carrier_mhz(system, digit) - mhz) for digit in digits}
    nearest = min(off_mhz, key=off_mhz.__getitem__, default=None)
    return nearest if nearest is not None and off_mhz[nearest] < _NEAR_MHZ else None


@cache
def _carrier_mhz(system: str, digit: str) -> float:
    """Return the carrier of one of a system's digits; of GLONASS that of frequency number 0."""
    signal = rinex_signal(system, digit + _USUAL_CODES[system][digit])
    return np.nan if signal is None else 1e-6 * carrier_hz_of(signal[0], 0)


def _band_of(system: str, mhz: float) -> str:
    digit = _digit_of(system, mhz)
    kind = None if digit is None else rinex_signal(system, digit + _USUAL_CODES[system][digit])
    return "" if kind is None else kind[0]


def _frame_bits(kind: MessageKind, bits: Octets) -> tuple[Octets, Booleans]:
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
        data, right = words_hold(candidate.reshape(len(words), 300))
        fits = right.all(axis=1) & ~holds
        bits[fits], holds = data[fits].reshape(-1, 240), holds | fits
    return bits, holds


def _record(
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
        sat=names[0],
        band=names[1],
        code=names[2],
        bits=np.packbits(bits, axis=1),
    )
