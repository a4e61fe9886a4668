"""Flight logs of PX4 (ULog) and ArduPilot (DataFlash): a receiver's raw bytes, fixes, levels and states, and inertia.

PX4, msg/SensorGps.msg, VehicleGpsPosition.msg, GpsDump.msg, SensorCombined.msg, VehicleImu.msg; ArduPilot,
libraries/AP_GPS/LogStructure.h and AP_InertialSensor/LogStructure.h. Of several receivers or units of a kind the first
is read.
"""

import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, Final, Protocol

import numpy as np

from skyproof.arrays import Booleans, Instants, Integers, Octets, Reals
from skyproof.gnss.time import GPS_EPOCH_NS, gpst_from_utc
from skyproof.logs.content import Beside, InertialRows, LogPiece, ReceiverStates, join_rows
from skyproof.logs.dataflash import MAGIC as DATAFLASH_MAGIC
from skyproof.logs.dataflash import DataFlashTables
from skyproof.logs.rows import epochs_without_signals
from skyproof.logs.stream import read_log
from skyproof.logs.tables import LogTable, TableStretch, split_stretches
from skyproof.logs.ubx import RAWX_CELL
from skyproof.logs.ubx_write import ubx_frame
from skyproof.logs.ulog import MAGIC as ULOG_MAGIC
from skyproof.logs.ulog import UlogTables
from skyproof.records import FrontEndLevels, ReceiverFixes

__all__ = ["is_ardupilot", "is_px4", "read_ardupilot", "read_px4"]

_FIRST_NS, _LAST_NS = (int(np.datetime64(f"{year}-01-01", "ns").astype(np.int64)) for year in (2000, 2200))
_WEEK_NS: Final = 604_800 * 10**9
_AGC: Final = 8191.0
_JAMMING: Final = np.array(("unknown", "none", "warning", "critical"))
_SPOOFING: Final = np.array(("unknown", "none", "indicated", "several indications"))
_DUMP_BYTES: Final = 79
_TO_DEVICE: Final = 0x80  # in the length of a piece of the dump
_HEIGHTS: Final = "heights of the receiver's own fixes are above sea level, for the log does not say the geoid's"


def is_px4(head: bytes) -> bool:
    """Tell by the first bytes of a file whether it is a ULog."""
    return head.startswith(ULOG_MAGIC)


def is_ardupilot(head: bytes) -> bool:
    """Tell by the first bytes of a file whether it is a DataFlash log."""
    return head.startswith(DATAFLASH_MAGIC)


def read_px4(blocks: Iterable[bytes], source: str, beside: Beside | None = None) -> Iterator[LogPiece]:
    """Read a ULog in blocks of bytes, cut anywhere; `source` names the receiver."""
    wanted = ("sensor_gps", "vehicle_gps_position", "gps_dump", "sensor_combined", "vehicle_imu")
    return _pieces(UlogTables(frozenset(wanted)).read, _Px4(), blocks, source, beside)


def read_ardupilot(blocks: Iterable[bytes], source: str, beside: Beside | None = None) -> Iterator[LogPiece]:
    """Read a DataFlash log in blocks of bytes, cut anywhere; `source` names the receiver."""
    wanted = ("GPS", "GPA", "UBX1", "GRXH", "GRXS", "IMU")
    return _pieces(DataFlashTables(frozenset(wanted)).read, _ArduPilot(), blocks, source, beside)


class _Autopilot(Protocol):
    """Reads the tables of a stretch of an autopilot's log."""

    def dump(self, stretch: TableStretch) -> bytes:
        """Return the receiver's own bytes that the stretch holds."""

    def piece(self, stretch: TableStretch) -> LogPiece:
        """Return what the autopilot itself logged in the stretch."""


def _pieces(
    read: Callable[[Octets, bool], tuple[TableStretch, int]],
    autopilot: _Autopilot,
    blocks: Iterable[bytes],
    source: str,
    beside: Beside | None,
) -> Iterator[LogPiece]:
    """Yield what the receiver's own bytes say, joined with what the autopilot logged while they came.

    Fixes and levels are those of the receiver's bytes, where they have any: the autopilot's are the same, but later. A
    log without measurements has the epochs of its fixes.
    """
    waiting: list[LogPiece] = []
    direct: set[str] = set()

    def dump() -> Iterator[bytes]:
        for stretch in split_stretches(blocks, read):
            waiting.append(autopilot.piece(stretch))
            yield autopilot.dump(stretch)

    for piece in read_log(dump(), source, beside):
        direct |= {name for name in ("fixes", "levels") if getattr(piece, name) is not None}
        parts = [piece, *waiting]
        messages: Counter[str] = Counter()
        for part in parts:
            messages.update(part.messages)
        rows: dict[str, Any] = {
            name: join_rows([v for part in waiting if (v := getattr(part, name)) is not None])
            for name in ("fixes", "levels", "inertial")
            if name not in direct
        }
        fixes = piece.fixes or rows.get("fixes")
        if piece.observations is None and fixes is not None:
            piece = replace(piece, observations=epochs_without_signals(fixes.gpst, source))
        yield replace(
            piece,
            **rows,
            states=join_rows([part.states for part in parts if part.states is not None]),
            messages=dict(messages),
            damaged_frames=sum(part.damaged_frames for part in parts),
            cut=piece.cut or any(part.cut for part in waiting),
            remarks=tuple(dict.fromkeys(remark for part in parts for remark in part.remarks)),
        )
        waiting.clear()


class _BootClock:
    """GPS time of the autopilot's clock, by the first stretch in which the receiver knew the time.

    What the receiver says arrives some tenths of a second late; the median of a stretch has the usual lateness.
    """

    def __init__(self) -> None:
        self._offset_ns: int | None = None

    def set(self, boot_us: Integers, instant_ns: Integers) -> None:
        """Note instants at which the receiver said that it is so late, where it is not known yet."""
        if self._offset_ns is None and boot_us.size:
            self._offset_ns = int(np.median(instant_ns - 1000 * boot_us))

    def at(self, boot_us: Integers) -> tuple[Instants, Booleans]:
        """Return the instants of these moments, and which of them are known and make sense."""
        sound = (boot_us >= 0) & (boot_us < 1 << 50)
        instant_ns = 1000 * np.where(sound, boot_us, 0) + (self._offset_ns or 0)
        known = sound & (self._offset_ns is not None) & (instant_ns > _FIRST_NS) & (instant_ns < _LAST_NS)
        return instant_ns.astype("datetime64[ns]"), known


class _Px4:
    """What PX4 logs."""

    def __init__(self) -> None:
        self._clock = _BootClock()

    def dump(self, stretch: TableStretch) -> bytes:
        """Return what the receiver sent, without what was sent to it."""
        table = stretch.first("gps_dump")
        if table is None or not table.has("data", length=_DUMP_BYTES) or table.rows.dtype["data"].base.itemsize != 1:
            return b""
        length, data = table.whole("len"), table.rows["data"]
        used = np.where(length & _TO_DEVICE, 0, length)
        octets: Octets = data[np.arange(data.shape[1]) < used[:, None]]
        return octets.tobytes()

    def piece(self, stretch: TableStretch) -> LogPiece:
        """Return fixes, levels, states and inertia."""
        gps = stretch.first("sensor_gps", "vehicle_gps_position")
        imu = stretch.first("sensor_combined", "vehicle_imu")
        messages = {f"PX4 {name}": table.rows.size for (name, _), table in stretch.tables.items()}
        piece = LogPiece(messages=messages, damaged_frames=stretch.damaged, cut=stretch.cut)
        if gps is not None:
            utc_us = gps.whole("time_utc_usec")
            dated = (utc_us > _FIRST_NS // 1000) & (utc_us < _LAST_NS // 1000)
            utc = (1000 * np.where(dated, utc_us, 0)).astype("datetime64[ns]")
            ahead = gpst_from_utc(utc[dated][0]) - utc[dated][0] if dated.any() else np.timedelta64(0, "ns")
            gpst: Instants = np.asarray(utc + ahead, "datetime64[ns]")
            boot_us = gps.whole("timestamp") + gps.whole("timestamp_time_relative")
            self._clock.set(boot_us[dated], gpst[dated].astype(np.int64))
            piece = replace(
                piece,
                fixes=_px4_fixes(gps.take(dated), gpst[dated]),
                levels=self._levels(gps),
                states=self._states(gps),
            )
        return piece if imu is None else replace(piece, inertial=self._inertial(imu))

    def _levels(self, gps: LogTable) -> FrontEndLevels | None:
        gpst, known = self._clock.at(gps.whole("timestamp"))
        noise, gain = gps.real("noise_per_ms")[known], gps.real("automatic_gain_control")[known]
        return _levels(gpst[known], noise, gain, gps.real("jamming_indicator")[known])

    def _states(self, gps: LogTable) -> ReceiverStates | None:
        gpst, known = self._clock.at(gps.whole("timestamp"))
        parts = [
            _states(gpst[known], subject, words, gps.whole(field)[known])
            for subject, words, field in (
                ("jamming", _JAMMING, "jamming_state"),
                ("spoofing", _SPOOFING, "spoofing_state"),
            )
            if gps.has(field) and known.any()
        ]
        return join_rows(parts)

    def _inertial(self, imu: LogTable) -> InertialRows | None:
        force, rate = imu.real("accelerometer_m_s2", length=3), imu.real("gyro_rad", length=3)
        if imu.has("delta_velocity", "delta_angle", length=3):
            force = imu.real("delta_velocity", length=3) / _interval_s(imu, "delta_velocity_dt")
            rate = imu.real("delta_angle", length=3) / _interval_s(imu, "delta_angle_dt")
        return _inertial(self._clock, imu.whole("timestamp"), force, rate)


class _ArduPilot:
    """What ArduPilot logs."""

    def __init__(self) -> None:
        self._clock = _BootClock()
        self._epochs = _RawEpochs()

    def dump(self, stretch: TableStretch) -> bytes:
        """Return the measurements as the receiver sent them."""
        return self._epochs.frames(stretch.first("GRXH"), stretch.first("GRXS"))

    def piece(self, stretch: TableStretch) -> LogPiece:
        """Return fixes, levels and inertia."""
        gps, imu, levels = stretch.first("GPS"), stretch.first("IMU"), stretch.first("UBX1")
        messages = {f"ArduPilot {name}": table.rows.size for (name, _), table in stretch.tables.items()}
        piece = LogPiece(messages=messages, damaged_frames=stretch.damaged, cut=stretch.cut)
        if gps is not None:
            instant_ns = GPS_EPOCH_NS + gps.whole("GWk") * _WEEK_NS + gps.whole("GMS") * 1_000_000
            dated = (instant_ns > _FIRST_NS) & (instant_ns < _LAST_NS) & (gps.whole("GWk") > 0)
            self._clock.set(gps.whole("TimeUS")[dated], instant_ns[dated])
            good = dated & (gps.whole("Status") >= 2)
            accuracy = stretch.first("GPA")
            undulation = accuracy is not None and accuracy.has("Und")
            piece = replace(
                piece,
                fixes=_ardupilot_fixes(gps.take(good), instant_ns[good].astype("datetime64[ns]"), accuracy),
                remarks=() if undulation or not good.any() else (_HEIGHTS,),
            )
        if levels is not None:
            gpst, known = self._clock.at(levels.whole("TimeUS"))
            numbers = (levels.real(name)[known] for name in ("noisePerMS", "agcCnt", "jamInd"))
            piece = replace(piece, levels=_levels(gpst[known], *numbers))
        if imu is not None:
            force = np.stack([imu.real(f"Acc{axis}") for axis in "XYZ"], axis=1)
            rate = np.stack([imu.real(f"Gyr{axis}") for axis in "XYZ"], axis=1)
            piece = replace(piece, inertial=_inertial(self._clock, imu.whole("TimeUS"), force, rate))
        return piece


class _RawEpochs:
    """Puts the parts of RXM-RAWX together: a header (GRXH), and then a record (GRXS) for each signal.

    The log does not say which signal of a satellite a record measures: all are taken for the first of the system.
    """

    def __init__(self) -> None:
        self._head: tuple[float, int, int, int] | None = None  # time of week, week, leap seconds, signals
        self._cells: list[Any] = []

    def frames(self, headers: LogTable | None, cells: LogTable | None) -> bytes:
        """Return the frames of the epochs that are whole."""
        parts: list[tuple[int, Any, Any]] = []
        if headers is not None:
            columns = headers.real("rcvTime"), *(headers.whole(name) for name in ("week", "leapS", "numMeas"))
            heads = zip(*(values.tolist() for values in columns), strict=True)
            parts += [(at, head, None) for at, head in zip(headers.at.tolist(), heads, strict=True)]
        if cells is not None:
            parts += [(at, None, cell) for at, cell in zip(cells.at.tolist(), _rawx_cells(cells), strict=True)]
        frames = []
        for _, head, cell in sorted(parts, key=lambda part: part[0]):
            if head is not None:
                self._head, self._cells = head, []
            elif self._head is not None:
                self._cells.append(cell)
                if len(self._cells) == self._head[3]:
                    frames.append(_rawx_of(*self._head, b"".join(one.tobytes() for one in self._cells)))
                    self._head = None
        return b"".join(frames)


_RAWX_FIELDS: Final = {
    "code_m": "prMes", "carrier_cyc": "cpMes", "doppler_hz": "doMes", "gnss": "gnss", "sv": "sv", "slot": "freq",
    "lock_ms": "lock", "cn0_dbhz": "cno", "code_sigma": "prD", "carrier_sigma": "cpD", "doppler_sigma": "doD",
    "tracking": "trk",
}  # fmt: skip


def _rawx_cells(table: LogTable) -> Any:
    """Return the records as blocks of RXM-RAWX."""
    cells = np.zeros(table.rows.size, RAWX_CELL)
    with np.errstate(over="ignore", invalid="ignore"):
        for name, given in _RAWX_FIELDS.items():
            kind = RAWX_CELL[name].kind
            cells[name] = table.real(given) if kind == "f" else table.whole(given) & 0xFFFF
    return cells


def _rawx_of(tow_s: float, week: int, leap_s: int, count: int, cells: bytes) -> bytes:
    """Return a frame of RXM-RAWX; none where its numbers are none of it."""
    if not (0 <= week < 1 << 16 and -128 <= leap_s < 128 and 0 < count < 256):
        return b""
    return ubx_frame(0x02, 0x15, struct.pack("<dHbBI", tow_s, week, leap_s, count, 0) + cells)


def _px4_fixes(gps: LogTable, gpst: Instants) -> ReceiverFixes | None:
    """Return fixes of two dimensions or more; NaN where one has no velocity."""
    degrees = gps.has("latitude_deg")
    unit, metre = (1.0, 1.0) if degrees else (1e-7, 1e-3)
    lat_deg, lon_deg = unit * gps.real("latitude_deg", "lat"), unit * gps.real("longitude_deg", "lon")
    good = (gps.whole("fix_type") >= 2) & (np.abs(lat_deg) <= 90.0) & (np.abs(lon_deg) <= 360.0)
    if not good.any():
        return None
    north, east, down = (gps.real(f"vel_{axis}_m_s") for axis in "ned")
    velocity = np.stack([east, north, -down], axis=1)
    velocity[gps.whole("vel_ned_valid", 1) == 0] = np.nan
    return ReceiverFixes.from_geodetic(
        gpst[good],
        np.radians(lat_deg[good]),
        np.radians(lon_deg[good]),
        metre * gps.real("altitude_ellipsoid_m", "alt_ellipsoid")[good],
        velocity_enu_m_s=velocity[good],
        horizontal_sigma_m=gps.real("eph")[good],
        vertical_sigma_m=gps.real("epv")[good],
        satellites=gps.whole("satellites_used", -1)[good],
    )


def _ardupilot_fixes(gps: LogTable, gpst: Instants, accuracy: LogTable | None) -> ReceiverFixes | None:
    """Return fixes; accuracy and the geoid's height are those logged at the same time."""
    lat_deg, lon_deg = gps.real("Lat"), gps.real("Lng")
    good = (np.abs(lat_deg) <= 90.0) & (np.abs(lon_deg) <= 360.0)
    if not good.any():
        return None
    gps, gpst = gps.take(good), gpst[good]
    beside = {name: np.full(gpst.size, np.nan) for name in ("HAcc", "VAcc", "Und")}
    if accuracy is not None and accuracy.rows.size:
        times, order = np.unique(accuracy.whole("TimeUS"), return_index=True)
        place = np.minimum(np.searchsorted(times, gps.whole("TimeUS")), times.size - 1)
        same = times[place] == gps.whole("TimeUS")
        for name, values in beside.items():
            values[same] = accuracy.real(name)[order[place[same]]]
    course_rad, speed_m_s = np.radians(gps.real("GCrs")), gps.real("Spd")
    velocity = [speed_m_s * np.sin(course_rad), speed_m_s * np.cos(course_rad), -gps.real("VZ")]
    return ReceiverFixes.from_geodetic(
        gpst,
        np.radians(lat_deg[good]),
        np.radians(lon_deg[good]),
        gps.real("Alt") + np.nan_to_num(beside["Und"]),
        velocity_enu_m_s=np.stack(velocity, axis=1),
        horizontal_sigma_m=beside["HAcc"],
        vertical_sigma_m=beside["VAcc"],
        satellites=gps.whole("NSats", -1),
    )


def _levels(gpst: Instants, noise: Reals, gain: Reals, jamming: Reals) -> FrontEndLevels | None:
    """Return levels as u-blox counts them: amplitude, 8191 of gain, 255 of the indicator; 0 is not known of the two."""
    if not gpst.size:
        return None
    return FrontEndLevels(
        gpst=gpst,
        band=np.full(gpst.size, "0"),
        agc_db=np.full(gpst.size, np.nan),
        agc_share=np.where(gain > 0.0, gain / _AGC, np.nan),
        noise_db=20.0 * np.log10(np.where(noise > 0.0, noise, np.nan)),
        jamming_share=np.where((jamming >= 0.0) & (jamming <= 255.0), jamming / 255.0, np.nan),
    )


def _states(gpst: Instants, subject: str, words: Any, value: Integers) -> ReceiverStates:
    return ReceiverStates(
        gpst=gpst,
        subject=np.full(gpst.size, subject, "U14"),
        state=words[np.clip(value, 0, words.size - 1)],
        alarm=value >= 2,
    )


def _interval_s(imu: LogTable, name: str) -> Reals:
    """Return the intervals (n, 1) of summed readings; NaN where there is none."""
    interval_us = imu.real(name)[:, None]
    return np.where(interval_us > 0.0, 1e-6 * interval_us, np.nan)


def _inertial(clock: _BootClock, boot_us: Integers, force: Reals, rate: Reals) -> InertialRows | None:
    if force.ndim != 2 or force.shape[1] != 3 or rate.shape != force.shape:
        return None
    gpst, known = clock.at(boot_us)
    known &= np.isfinite(force).all(axis=1) & np.isfinite(rate).all(axis=1)
    if not known.any():
        return None
    return InertialRows(gpst=gpst[known], specific_force_m_s2=force[known], angular_rate_rad_s=rate[known])
