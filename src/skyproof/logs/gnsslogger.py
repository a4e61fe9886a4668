"""GnssLogger, the text that Android phones write: measurements, broadcast messages, fixes and levels of the front end.

Google, gps-measurement-tools, LOGGING.md (the rows); Android reference, GnssClock, GnssMeasurement,
GnssNavigationMessage (the fields); GSA, Using GNSS raw measurements on Android devices (2017), 2.4 (pseudoranges).
Columns are found by their names in the header, whatever the version.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np

from skyproof.arrays import Integers, Octets, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import carrier_hz_of, frequency_number_of, rinex_signal
from skyproof.gnss.time import GPS_EPOCH_NS, gpst_from_utc, leap_seconds
from skyproof.logs.content import BroadcastFrames, LogPiece, MessageKind
from skyproof.logs.locks import CarrierLocks
from skyproof.logs.phone_clock import FIRST_NS, LAST_NS, MS_NS, PhoneClock, or_zero
from skyproof.logs.phone_frames import FRAMES, frame_bits, record_frames
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
_BDT_NS: Final = 14 * _S
_LONGEST_LOCK_MS: Final = 1 << 40

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
    bias of each epoch. The phone estimates that bias again each second: codes would step by its errors, carriers and
    Dopplers would not. When the bias has moved by more than a millisecond the clock is set by whole ones, as other
    receivers do, for which whatever reads observations is prepared. Where the hardware clock stops, as between the
    measurements of a phone that saves power, nothing tells how long: there the ranges are joined (`PhoneClock.join`).
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._columns: dict[str, dict[str, int]] = {}
        self._keys = np.zeros(1, np.int64)  # what the log calls signals, in order; 0 is none
        self._numbers = np.full(1, -1, np.int64)  # of the signals of the keys
        self._signals: dict[SignalId, int] = {}
        self._names: list[SignalId] = []
        self._slots: dict[str, int] = {}
        self._clock = PhoneClock()
        self._locks = CarrierLocks()
        self._last_ns: int | None = None  # the last epoch of the stretch before, for rows without a time

    # ------------------------------------------------------------------ stretches and columns

    def complete(self, stretch: TextStretch) -> int:
        """Return how many lines come before the last epoch: the next stretch may continue it."""
        raw = self._find_columns(stretch).get("Raw")
        if raw is None or "Raw" not in self._columns:
            return stretch.begin.size
        time_ns = read_fields(stretch, raw, self._columns["Raw"], wholes=("TimeNanos",)).wholes["TimeNanos"]
        rest = np.flatnonzero(time_ns != time_ns[-1])
        return int(raw[rest[-1] + 1]) if rest.size else stretch.begin.size

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
        later_s = or_zero(raw.reals["TimeOffsetNanos"]) * 1e-9
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
        hertz = or_zero(raw.reals["CarrierFrequencyHz"])
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
        good = (utc_ms > FIRST_NS // MS_NS) & (utc_ms < LAST_NS // MS_NS)
        good &= (np.abs(fix.reals["LatitudeDegrees"]) <= 90.0) & (np.abs(fix.reals["LongitudeDegrees"]) <= 360.0)
        if "Provider" in columns:
            good &= (at >= 0) & (stretch.octets[np.maximum(at, 0)] | 0x20 == ord("g"))  # GPS, gps
        fix = fix.select(good)
        if not good.any():
            return None
        utc = (utc_ms[good] * MS_NS).astype("datetime64[ns]")
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
        instant_ns = GPS_EPOCH_NS + agc.wholes["TimeNanos"] - agc.wholes["FullBiasNanos"]
        if not instant_ns.size:
            agc, instant_ns = raw, label_ns
        gain_db, system = agc.reals["AgcDb"], agc.wholes["ConstellationType"]
        system = np.where(system == MISSING, 1, system)
        hertz = or_zero(agc.reals["CarrierFrequencyHz"])
        good = np.isfinite(gain_db) & (system > 0) & (system < len(_SYSTEMS))
        good &= (instant_ns > FIRST_NS) & (instant_ns < LAST_NS)
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
            if number not in FRAMES:
                continue
            name, system, attribute, n_bytes = FRAMES[number]
            octets = data[:, :n_bytes]
            good = (kind == number) & (before != MISSING) & (np.abs(octets) <= 255).all(axis=1)
            good &= np.isin(status, _CHECKED) | (name == "LNAV")
            for sv in np.unique(svid[good]).tolist():
                prn = sv - _FIRST_SVID.get(system, 0)
                signal = rinex_signal(system, attribute)
                if signal is None or not 1 <= prn <= (24 if system == "R" else 63):
                    continue
                rows = np.flatnonzero(good & (svid == sv))
                bits, holds = frame_bits(name, np.unpackbits((octets[rows] & 0xFF).astype(np.uint8), axis=1))
                found.setdefault(name, []).append((rows[holds], SignalId(f"{system}{prn:02d}", *signal), bits[holds]))
        return tuple(record_frames(name, parts, before, after) for name, parts in sorted(found.items()))


class _Ranges(NamedTuple):
    """Codes, their rates and carriers of rows, by the clock of their labels."""

    code_m: Reals
    rate_m_s: Reals
    carrier_m: Reals


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
    travel_ns = (label_ns - GPS_EPOCH_NS + ahead_ns - np.where(good, sent_ns, 0) - least_ns) % modulus_ns + least_ns
    return np.where(good, travel_ns * 1e-9 * SPEED_OF_LIGHT_M_S, np.nan)


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
