"""Flight logs made from the descriptions of their formats, for tests of what reads them."""

import struct
from collections.abc import Iterable, Mapping

import numpy as np

__all__ = ["BOOT_US", "DataFlash", "ULog", "convert_utc_us", "dump_rows", "make_px4_flight"]

BOOT_US = 55_000_000
"""What the autopilot's clock shows at the first epoch."""

GPS_FIELDS = (
    "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;int32_t alt_ellipsoid;"
    "float s_variance_m_s;float c_variance_rad;float eph;float epv;float hdop;float vdop;int32_t noise_per_ms;"
    "int32_t jamming_indicator;float vel_m_s;float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;float cog_rad;"
    "int32_t timestamp_time_relative;uint16_t automatic_gain_control;uint8_t fix_type;uint8_t jamming_state;"
    "uint8_t spoofing_state;bool vel_ned_valid;uint8_t satellites_used;uint8_t[3] _padding0;"
)
NEW_GPS_FIELDS = GPS_FIELDS.replace(
    "int32_t lat;int32_t lon;int32_t alt;int32_t alt_ellipsoid;",
    "double latitude_deg;double longitude_deg;double altitude_msl_m;double altitude_ellipsoid_m;",
)
DUMP_FIELDS = "uint64_t timestamp;uint8_t instance;uint8_t len;uint8_t[79] data;uint8_t[7] _padding0;"
IMU_FIELDS = (
    "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;int32_t accelerometer_timestamp_relative;"
    "float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;uint8_t accelerometer_clipping;"
    "uint8_t[7] _padding0;"
)
_PACKED = {
    "int8_t": "b", "uint8_t": "B", "bool": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I",
    "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d",
}  # fmt: skip


def _make_message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


class ULog:
    """Writes messages as PX4's logger does, without the padding at their ends."""

    def __init__(self) -> None:
        self.definitions = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", BOOT_US))
        self.data = bytearray()
        self.definitions += _make_message("B", bytes(40))
        self._fields: dict[str, list[tuple[str, str, int]]] = {}
        self._numbers: dict[tuple[str, int], int] = {}

    @property
    def octets(self) -> bytes:
        return bytes(self.definitions + self.data)

    def state(self, name: str, fields: str, instance: int = 0) -> None:
        """State a message's layout, and subscribe to an instance of it."""
        if name not in self._fields:
            self.definitions += _make_message("F", f"{name}:{fields}".encode())
            parts = [part.split(" ") for part in fields.strip(";").split(";")]
            self._fields[name] = [
                (field, kind.partition("[")[0], int(kind.partition("[")[2].rstrip("]") or 0)) for kind, field in parts
            ]
        self._numbers[name, instance] = len(self._numbers)
        self.data += _make_message("A", struct.pack("<BH", instance, self._numbers[name, instance]) + name.encode())

    def log(self, name: str, values: Mapping[str, object], instance: int = 0) -> None:
        """Write a record; what is not given is zero."""
        body = struct.pack("<H", self._numbers[name, instance])
        for field, kind, length in self._fields[name]:
            if field.startswith("_padding"):
                break
            value = values.get(field, [0] * length if length else 0)
            body += struct.pack(f"<{length or 1}{_PACKED[kind]}", *(value if length else [value]))
        self.data += _make_message("D", body)

    def note(self, text: str) -> None:
        """Write a message of text, and a dropout."""
        self.data += _make_message("L", b"\x06" + struct.pack("<Q", BOOT_US) + text.encode())
        self.data += _make_message("O", struct.pack("<H", 20))


def dump_rows(octets: bytes, *, to_device: bool = False, instance: int = 0) -> Iterable[dict[str, object]]:
    """Return rows of gps_dump."""
    for k in range(0, len(octets), 79):
        part = octets[k : k + 79]
        length = len(part) | (0x80 if to_device else 0)
        yield {"instance": instance, "len": length, "data": list(part.ljust(79, b"\xee"))}


def make_px4_flight(
    epochs: Iterable[tuple[int, bytes, dict[str, object]]], imu: Iterable[tuple[int, list, list]]
) -> bytes:
    """Return a log of epochs (boot time in us, bytes of the receiver, row of sensor_gps) and inertial readings."""
    log = ULog()
    log.state("sensor_gps", NEW_GPS_FIELDS)
    log.state("gps_dump", DUMP_FIELDS)
    log.state("sensor_combined", IMU_FIELDS)
    log.note("armed")
    readings = iter(imu)
    reading = next(readings, None)
    for boot_us, octets, row in epochs:
        while reading is not None and reading[0] <= boot_us:
            values = {"gyro_rad": reading[1], "accelerometer_m_s2": reading[2], "gyro_integral_dt": 5000}
            log.log("sensor_combined", {"timestamp": reading[0], **values})
            reading = next(readings, None)
        for part in dump_rows(b"\x00to the receiver" * 3, to_device=True):
            log.log("gps_dump", {"timestamp": boot_us, **part})
        for part in dump_rows(octets):
            log.log("gps_dump", {"timestamp": boot_us, **part})
        log.log("sensor_gps", {"timestamp": boot_us, **row})
    return log.octets


_FORMATS = {
    "a": "32h", "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s", "N": "16s",
    "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q", "Q": "Q",
}  # fmt: skip


class DataFlash:
    """Writes records as ArduPilot's logger does."""

    def __init__(self) -> None:
        self.octets = bytearray()
        self._known: dict[str, tuple[int, str]] = {}
        self._format(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")

    def _format(self, kind: int, length: int, name: str, characters: str, labels: str) -> None:
        head = bytes([0xA3, 0x95, 128, kind, length])
        self.octets += head + struct.pack("4s16s64s", name.encode(), characters.encode(), labels.encode())

    def state(self, name: str, characters: str, labels: str) -> None:
        """State a message's layout."""
        layout = "<" + "".join(_FORMATS[c] for c in characters)
        self._known[name] = len(self._known) + 1, layout
        self._format(self._known[name][0], 3 + struct.calcsize(layout), name, characters, labels)

    def log(self, name: str, *values: object) -> None:
        """Write a record with its numbers packed."""
        kind, layout = self._known[name]
        self.octets += bytes([0xA3, 0x95, kind]) + struct.pack(layout, *values)

    def bytes(self) -> bytes:
        return bytes(self.octets)


def convert_utc_us(gpst: np.datetime64) -> int:
    """Return microseconds of UTC since 1970 of an instant after 2017."""
    return int(gpst.astype("M8[us]").astype(np.int64)) - 18_000_000
