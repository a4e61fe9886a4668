"""Flight logs against pyulog and pymavlink, value by value, on logs made from the formats' descriptions."""

import io
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary
from pyulog.core import ULog as PyULog
from tests.logs.drone import BOOT_US, GPS_FIELDS, DataFlash, ULog, convert_utc_us, dump_rows, make_px4_flight
from tests.logs.test_ubx import RAWX, make_gps, make_pvt, make_radio, make_rawx

from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.time import gpst
from skyproof.logs.autopilots import is_ardupilot, is_px4, read_ardupilot, read_px4
from skyproof.logs.content import LogPiece, join_rows
from skyproof.logs.kinds import kind_of_log
from skyproof.logs.stream import read_log
from skyproof.records import Observations

START = gpst(2300, 100.0)
RNG = np.random.default_rng(6)


def find_boot_us(second: float, late_s: float = 0.12) -> int:
    return BOOT_US + round(1e6 * (second + late_s))


def make_gps_row(second: float, **given: object) -> dict[str, object]:
    row = {
        "time_utc_usec": convert_utc_us(START) + round(1e6 * second), "latitude_deg": 47.5 + 1e-5 * second,
        "longitude_deg": -8.25, "altitude_msl_m": 360.0, "altitude_ellipsoid_m": 412.5, "eph": 1.5, "epv": 2.5,
        "noise_per_ms": 90, "jamming_indicator": 51, "automatic_gain_control": 4000, "vel_n_m_s": 3.0,
        "vel_e_m_s": -4.0, "vel_d_m_s": 0.5, "vel_ned_valid": 1, "fix_type": 3, "satellites_used": 11,
        "jamming_state": 1, "spoofing_state": 1,
    }  # fmt: skip
    return row | given


def make_readings(seconds: float, rate_hz: float = 200.0) -> list[tuple[int, list, list]]:
    drawn = RNG.normal(size=(round(seconds * rate_hz), 6)).astype(np.float32)
    drawn[:, 5] -= 9.8
    times = [find_boot_us(k / rate_hz, 0.0) for k in range(len(drawn))]
    return [(t, row[:3].tolist(), row[3:].tolist()) for t, row in zip(times, drawn, strict=True)]


def make_flight(seconds: int = 8, **given: object) -> tuple[bytes, bytes]:
    """Return a log, and the bytes that the receiver sent in it."""
    sent = [make_rawx(100.0 + k, 2300, [make_gps(min(9000 + 1000 * k, 64_000))]) for k in range(seconds)]
    epochs = [(find_boot_us(k), octets, make_gps_row(k, **given)) for k, octets in enumerate(sent)]
    return make_px4_flight(epochs, make_readings(seconds)), b"".join(sent)


def read_px4_log(octets: bytes) -> LogPiece:
    (piece,) = read_px4([octets], "drone")
    return piece


def read_pyulog(octets: bytes, name: str) -> dict[str, np.ndarray]:
    return PyULog(io.BytesIO(octets)).get_dataset(name).data


def test_what_px4_logs_is_what_pyulog_reads() -> None:
    octets, sent = make_flight()
    piece = read_px4_log(octets)
    fixes, theirs = piece.fixes, read_pyulog(octets, "sensor_gps")
    lat, lon, height = geodetic_from_ecef(fixes.position_ecef_m)
    assert np.degrees(lat) == pytest.approx(theirs["latitude_deg"], abs=1e-10)
    assert np.degrees(lon) == pytest.approx(theirs["longitude_deg"], abs=1e-10)
    assert height == pytest.approx(theirs["altitude_ellipsoid_m"], abs=1e-6)
    assert fixes.horizontal_sigma_m.tolist() == theirs["eph"].tolist()
    assert np.linalg.norm(fixes.velocity_ecef_m_s, axis=1) == pytest.approx(np.full(8, np.sqrt(25.25)))
    assert fixes.gpst.tolist() == [(START + np.timedelta64(k, "s")).item() for k in range(8)]
    assert fixes.satellites.tolist() == theirs["satellites_used"].tolist()
    imu = read_pyulog(octets, "sensor_combined")
    for axis in range(3):
        assert piece.inertial.angular_rate_rad_s[:, axis].tolist() == imu[f"gyro_rad[{axis}]"].tolist()
        assert piece.inertial.specific_force_m_s2[:, axis].tolist() == imu[f"accelerometer_m_s2[{axis}]"].tolist()
    since_us = (piece.inertial.gpst - START).astype("m8[us]").astype(np.int64)
    # The receiver's word comes 0.12 s late: by so much the log's own clock is taken to be.
    np.testing.assert_array_equal(since_us, imu["timestamp"].astype(np.int64) - BOOT_US - 120_000)
    dump = read_pyulog(octets, "gps_dump")
    data = np.stack([dump[f"data[{k}]"] for k in range(79)], axis=1)
    theirs = b"".join(row[:n].tobytes() for row, n in zip(data, dump["len"], strict=True) if n < 128)
    assert theirs == sent
    assert piece.damaged_frames == 0
    assert not piece.cut


def test_the_receivers_bytes_give_what_they_give_alone() -> None:
    octets, sent = make_flight()
    (alone,) = read_log([sent], "drone")
    o = read_px4_log(octets).observations
    assert o.signals == alone.observations.signals
    np.testing.assert_array_equal(o.pseudorange_m, alone.observations.pseudorange_m)
    assert o.gpst.tolist() == alone.observations.gpst.tolist()


def test_levels_and_states_have_times() -> None:
    octets, _ = make_flight(jamming_state=3, spoofing_state=2)
    piece = read_px4_log(octets)
    assert piece.levels.agc_share == pytest.approx(np.full(8, 4000 / 8191))
    assert piece.levels.jamming_share == pytest.approx(np.full(8, 0.2))
    assert piece.levels.noise_db == pytest.approx(np.full(8, 20.0 * np.log10(90.0)))
    states = piece.states
    told = set(zip(states.subject.tolist(), states.state.tolist(), states.alarm.tolist(), strict=True))
    assert told == {("jamming", "critical", True), ("spoofing", "indicated", True)}
    assert np.abs((piece.levels.gpst - START).astype(np.int64) - np.arange(8) * 10**9).max() < 10**6


def test_the_receivers_own_words_come_before_the_autopilots() -> None:
    sent = [
        make_rawx(100.0 + k, 2300, [make_gps(9000)])
        + make_pvt(100_000 + 1000 * k, (2024, 2, 4))
        + make_radio((1, 80, 8191, 0))
        for k in range(4)
    ]
    octets = make_px4_flight([(find_boot_us(k), part, make_gps_row(k)) for k, part in enumerate(sent)], [])
    piece = read_px4_log(octets)
    assert np.degrees(geodetic_from_ecef(piece.fixes.position_ecef_m)[1]) == pytest.approx(np.full(4, 8.5))
    assert piece.levels.agc_share.tolist() == [1.0] * 4
    assert {"jamming", "spoofing"} == set(piece.states.subject.tolist())


def test_old_messages_of_px4_are_read() -> None:
    log = ULog()
    log.state("vehicle_gps_position", GPS_FIELDS)
    fields = "uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity;"
    log.state("vehicle_imu", fields + "uint16_t delta_angle_dt;uint16_t delta_velocity_dt;")
    row = make_gps_row(0) | {
        "lat": 475_000_000,
        "lon": 85_000_000,
        "alt_ellipsoid": 412_500,
        "timestamp": find_boot_us(0),
    }
    log.log("vehicle_gps_position", row)
    log.log("vehicle_gps_position", row | {"time_utc_usec": 0})
    sums = {"delta_angle": [0.001, 0.0, -0.002], "delta_velocity": [0.0, 0.0, -0.049]}
    log.log("vehicle_imu", {"timestamp": find_boot_us(1), "delta_angle_dt": 5000, "delta_velocity_dt": 5000, **sums})
    piece = read_px4_log(log.octets)
    lat, lon, height = geodetic_from_ecef(piece.fixes.position_ecef_m[0])
    assert [*np.degrees([lat, lon]), height] == pytest.approx([47.5, 8.5, 412.5])
    assert piece.inertial.angular_rate_rad_s[0] == pytest.approx([0.2, 0.0, -0.4])
    assert piece.inertial.specific_force_m_s2[0] == pytest.approx([0.0, 0.0, -9.8])


def join_pieces(pieces: list[LogPiece]) -> tuple[Observations, object, object]:
    o = Observations.join([p.observations for p in pieces if p.observations is not None])
    return o, *(join_rows([v for p in pieces if (v := getattr(p, name)) is not None]) for name in ("fixes", "inertial"))


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_blocks_of_any_size_give_the_same(kind, monkeypatch) -> None:
    octets = make_flight(20)[0] if kind == "px4" else make_ardupilot_flight(20)
    read = read_px4 if kind == "px4" else read_ardupilot
    (whole,) = read([octets], "drone")
    monkeypatch.setattr("skyproof.logs.tables._STRETCH_BYTES", 20_000)
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 300)
    pieces = list(read([octets[k : k + 777] for k in range(0, len(octets), 777)], "drone"))
    assert len(pieces) > 3
    o, fixes, inertial = join_pieces(pieces)
    np.testing.assert_array_equal(o.pseudorange_m, whole.observations.pseudorange_m)
    np.testing.assert_array_equal(fixes.position_ecef_m, whole.fixes.position_ecef_m)
    np.testing.assert_array_equal(inertial.specific_force_m_s2, whole.inertial.specific_force_m_s2)
    np.testing.assert_array_equal(inertial.gpst, whole.inertial.gpst)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_damage_costs_what_it_hits_and_a_cut_is_said(kind) -> None:
    octets = bytearray(make_flight(20)[0] if kind == "px4" else make_ardupilot_flight(20))
    read = read_px4 if kind == "px4" else read_ardupilot
    (whole,) = read([bytes(octets)], "drone")
    middle = len(octets) // 2
    octets[middle : middle + 40] = RNG.integers(0, 256, 40, np.uint8).tobytes()
    (piece,) = read([bytes(octets[:-5])], "drone")
    assert 1 <= piece.damaged_frames <= 3
    assert piece.cut
    assert piece.inertial.gpst.size >= whole.inertial.gpst.size - 10
    assert piece.observations.gpst.size >= whole.observations.gpst.size - 2


def test_layouts_that_make_no_sense_are_left_out() -> None:
    log = ULog()
    for fields in (
        "uint64_t timestamp;nonsense x;",
        "uint64_t timestamp;uint8_t a;uint8_t a;",
        "uint8_t[70000] a;",
        "",
    ):
        log.data += struct.pack("<HB", 11 + len(fields), ord("F")) + b"sensor_gps:" + fields.encode()
        log.data += struct.pack("<HB", 13, ord("A")) + b"\0\x07\0sensor_gps"
        log.data += struct.pack("<HB", 12, ord("D")) + b"\x07\0" + bytes(10)
        assert read_px4_log(log.octets).fixes is None


# --- ArduPilot


def make_ardupilot_flight(seconds: int = 8, *, undulation: bool = True) -> bytes:
    log = DataFlash()
    log.state("GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    names = "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta" + (",Und" if undulation else "")
    log.state("GPA", "QBCCCCfBIH" + ("f" if undulation else ""), names)
    log.state("UBX1", "QBHBBHI", "TimeUS,Instance,noisePerMS,jamInd,aPower,agcCnt,config")
    log.state("GRXH", "QdHbBB", "TimeUS,rcvTime,week,leapS,numMeas,recStat")
    log.state("GRXS", "QddfBBBHBBBBB", "TimeUS,prMes,cpMes,doMes,gnss,sv,freq,lock,cno,prD,cpD,doD,trk")
    log.state("IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz")
    log.state("MSG", "QZ", "TimeUS,Message")
    for k in range(seconds):
        t = find_boot_us(k)
        log.log("MSG", t, b"flying")
        log.log("GRXH", t, 100.0 + k, 2300, 18, 3, 1)
        for sv in (5, 7, 9):
            cell = (
                2e7 + sv + k,
                1e8 + sv + 10.0 * k,
                -250.0,
                0,
                sv,
                0,
                min(9000 + 1000 * k, 64_000),
                40 + sv,
                3,
                2,
                4,
                7,
            )
            log.log("GRXS", t, *cell)
        log.log(
            "GPS",
            t,
            0,
            3,
            100_000 + 1000 * k,
            2300,
            11,
            80,
            475_000_000 + k,
            -82_500_000,
            36_000,
            5.0,
            90.0,
            0.5,
            0.0,
            1,
        )
        log.log("GPS", t, 1, 3, 100_000 + 1000 * k, 2300, 11, 80, 0, 0, 0, 5.0, 90.0, 0.5, 0.0, 1)
        log.log("GPA", t, 0, 120, 150, 250, 30, 0.0, 1, 9, 200, *((51.5,) if undulation else ()))
        log.log("UBX1", t, 0, 90, 51, 1, 4000, 0)
        for j in range(25):
            moment = find_boot_us(k + j / 25, 0.0)
            log.log("IMU", moment, 0, 0.01 * j, 0.02, -0.03, 0.1 * k, 0.2, -9.8, 0, 0, 30.0, 1, 1, 1000, 1000)
            log.log("IMU", moment, 1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 0, 0, 30.0, 1, 1, 1000, 1000)
    return log.bytes()


def read_pymavlink(octets: bytes, name: str, tmp_path: Path) -> list:
    path = tmp_path / "flight.bin"
    path.write_bytes(octets)
    log, rows = DFReader_binary(str(path), zero_time_base=True), []
    while (message := log.recv_match(type=name)) is not None:
        rows.append(message)
    log.filehandle.close()
    return rows


def test_what_ardupilot_logs_is_what_pymavlink_reads(tmp_path) -> None:
    octets = make_ardupilot_flight()
    (piece,) = read_ardupilot([octets], "drone")
    theirs = [m for m in read_pymavlink(octets, "GPS", tmp_path) if m.I == 0]
    lat, lon, height = geodetic_from_ecef(piece.fixes.position_ecef_m)
    assert np.degrees(lat) == pytest.approx([m.Lat for m in theirs], abs=1e-9)
    assert np.degrees(lon) == pytest.approx([m.Lng for m in theirs], abs=1e-9)
    assert height == pytest.approx([m.Alt + 51.5 for m in theirs], abs=1e-6)
    accuracy = read_pymavlink(octets, "GPA", tmp_path)
    assert piece.fixes.horizontal_sigma_m == pytest.approx([m.HAcc for m in accuracy])
    assert piece.fixes.gpst.tolist() == [(START + np.timedelta64(k, "s")).item() for k in range(8)]
    imu = [m for m in read_pymavlink(octets, "IMU", tmp_path) if m.I == 0]
    assert piece.inertial.angular_rate_rad_s[:, 0] == pytest.approx([m.GyrX for m in imu])
    assert piece.inertial.specific_force_m_s2[:, 0] == pytest.approx([m.AccX for m in imu])
    assert piece.levels.agc_share == pytest.approx(np.full(8, 4000 / 8191))
    raw = read_pymavlink(octets, "GRXS", tmp_path)
    o = piece.observations
    assert o.pseudorange_m.ravel().tolist() == [m.prMes for m in raw]
    assert o.carrier_cyc.ravel().tolist() == [m.cpMes for m in raw]
    assert o.cn0_dbhz.ravel().tolist() == [m.cno for m in raw]
    assert o.gpst.tolist() == piece.fixes.gpst.tolist()
    assert len(RAWX) == 15


def test_heights_without_a_geoid_are_said_to_be_of_the_sea() -> None:
    (piece,) = read_ardupilot([make_ardupilot_flight(undulation=False)], "drone")
    assert any("sea level" in remark for remark in piece.remarks)
    assert not any("sea level" in remark for remark in next(read_ardupilot([make_ardupilot_flight()], "d")).remarks)


def test_flight_logs_are_known_by_their_first_bytes() -> None:
    octets, _ = make_flight(2)
    assert is_px4(octets)
    assert is_ardupilot(make_ardupilot_flight(1))
    assert kind_of_log(octets).read is read_px4
    assert kind_of_log(make_ardupilot_flight(1)).read is read_ardupilot


def test_a_second_receiver_is_left_out() -> None:
    log = ULog()
    log.state("gps_dump", "uint64_t timestamp;uint8_t instance;uint8_t len;uint8_t[79] data;")
    log.state("gps_dump", "", 1)
    for instance in (0, 1):
        for part in dump_rows(make_rawx(100.0, 2300, [make_gps(9000 + instance)])):
            log.log("gps_dump", {"timestamp": BOOT_US, **part}, instance)
    assert read_px4_log(log.octets).observations.gpst.size == 1
    assert replace(read_px4_log(log.octets), messages={}).damaged_frames == 0
