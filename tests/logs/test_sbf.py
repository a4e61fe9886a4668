"""SBF: blocks made from the reference guide, read as pysbf2 reads them; and orbits of real pages."""

import struct
from itertools import pairwise

import numpy as np
import pytest
from pysbf2 import SBFReader
from tests.logs.frames import make_sbf_block

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.lnav import encode_subframes
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.logs.content import LogPiece
from skyproof.logs.orbits import OrbitCollector
from skyproof.logs.stream import read_log
from skyproof.records import SignalId

TIME = struct.pack("<IH", 345_600_500, 2300)
PAGES = ("change_wt5", "fgi_galrawinav-270923", "custom_metrics", "walk_atomium_inav", "park_and_eu_inav")


def read(*blocks: bytes) -> LogPiece:
    (piece,) = read_log([b"".join(blocks)], "rx")
    return piece


def make_channel(
    sv: int,
    signal: int,
    code_m: float,
    *,
    doppler_hz: float,
    cycles: float,
    cn0: int = 140,
    lock_s: int = 60,
    info: int = 0,
    antenna: int = 0,
    seconds: tuple[bytes, ...] = (),
) -> bytes:
    """Return a sub-block of type 1 and those of type 2 in it; `cycles` are what the carrier is more than the code."""
    code = round(code_m * 1e3)
    carrier = round(cycles * 1e3)
    kind = min(signal, 31) | antenna << 5
    info |= (signal - 32) << 3 if signal >= 32 else 0
    head = struct.pack(
        "<BBBBIiHbB",
        7,
        kind,
        sv,
        code >> 32,
        code & 0xFFFFFFFF,
        round(doppler_hz * 1e4),
        carrier & 0xFFFF,
        carrier >> 16,
        cn0,
    )
    return head + struct.pack("<HBB", lock_s, info, len(seconds)) + b"".join(seconds)


def make_second(
    signal: int, *, code_m: float, doppler_hz: float, cycles: float, cn0: int = 120, lock_s: int = 50
) -> bytes:
    """Return a sub-block of type 2: differences from the first signal, and what the carrier is more than the code."""
    code, doppler, carrier = round(code_m * 1e3), round(doppler_hz * 1e4), round(cycles * 1e3)
    offsets = (code >> 16 & 7) | (doppler >> 16 & 31) << 3
    return struct.pack(
        "<BBBBbBHHH", signal, lock_s, cn0, offsets, carrier >> 16, 0, code & 0xFFFF, carrier & 0xFFFF, doppler & 0xFFFF
    )


def make_epoch(*channels: bytes, time: bytes = TIME, flags: int = 0) -> bytes:
    return make_sbf_block(4027, time + bytes([len(channels), 20, 12, flags, 0, 0]) + b"".join(channels), revision=1)


GPS = make_channel(
    5,
    0,
    21_234_567.891,
    doppler_hz=-1234.5678,
    cycles=-1000.25,
    seconds=(
        make_second(3, code_m=-12.345, doppler_hz=0.5, cycles=77.125),
        make_second(4, code_m=101.5, doppler_hz=-1.25, cycles=-2.5),
    ),
)
GLONASS = make_channel(45, 8, 20_500_000.5, doppler_hz=900.0, cycles=3.5, info=(2 + 8) << 3)
BEIDOU = make_channel(230, 34, 38_000_000.25, doppler_hz=3.0, cycles=0.25)


def test_measurements_are_those_of_the_guide() -> None:
    o = read(make_epoch(GPS, GLONASS, BEIDOU)).observations
    row = {s: k for k, s in enumerate(o.signals)}
    l1, l2, l5 = (row[SignalId("G05", *kind)] for kind in (("L1", "CA"), ("L2", "L"), ("L5", "Q")))
    code_m, cycles, hertz = o.pseudorange_m[0], o.carrier_cyc[0], o.doppler_hz[0]
    assert code_m[[l1, l2, l5]] == pytest.approx([21_234_567.891, 21_234_555.546, 21_234_669.391], abs=1e-6)
    for k, more in ((l1, -1000.25), (l2, 77.125), (l5, -2.5)):
        assert cycles[k] == pytest.approx(code_m[k] * o.carrier_hz[k] / SPEED_OF_LIGHT_M_S + more, abs=1e-6)
    assert hertz[l1] == pytest.approx(-1234.5678)
    assert hertz[l2] == pytest.approx(-1234.5678 * 1227.60 / 1575.42 + 0.5, abs=1e-6)
    assert o.cn0_dbhz[0, [l1, l2]] == pytest.approx([45.0, 40.0])
    assert o.carrier_hz[row[SignalId("R08", "G1")]] == 1602e6 + 2 * 562.5e3
    assert code_m[row[SignalId("C48", "B2b", "7D")]] == pytest.approx(38_000_000.25)
    assert o.gpst[0] == np.datetime64("2024-02-08T00:00:00.500", "ns")


def test_blocks_are_what_pysbf2_takes_them_for(tmp_path) -> None:
    path = tmp_path / "a.sbf"
    path.write_bytes(make_epoch(GPS, GLONASS, BEIDOU) + make_geodetic() + make_status(2, 8))
    with open(path, "rb") as stream:
        names = [message.identity for _, message in SBFReader(stream) if message is not None]
    assert names == ["MeasEpoch", "PVTGeodetic", "RFStatus"]
    with open(path, "rb") as stream:
        first = next(message for _, message in SBFReader(stream))
    assert first.N1 == 3
    assert first.SVID_01 == 5
    assert first.CodeLSB_01 + first.CodeMSB_01 == pytest.approx(21_234_567.891, abs=1e-3)


def test_what_the_block_marks_unknown_is_missing() -> None:
    unknown = struct.pack("<BBBBIiHbBHBB", 1, 0, 9, 0, 0, -(2**31), 0, -128, 255, 65_535, 0, 0)
    good = make_channel(5, 0, 2.1e7, doppler_hz=0.0, cycles=1.0, cn0=255, lock_s=65_535)
    o = read(make_epoch(unknown, good)).observations
    assert [s.sat for s in o.signals] == ["G05"]
    assert np.isnan(o.cn0_dbhz[0, 0])
    assert np.isnan(o.carrier_cyc[0, 0])


def test_other_antennas_and_scrambled_epochs_are_left_out() -> None:
    aside = make_channel(9, 0, 2.1e7, doppler_hz=0.0, cycles=1.0, antenna=1)
    piece = read(make_epoch(GPS, aside), make_epoch(GPS, flags=0x80, time=struct.pack("<IH", 345_601_500, 2300)))
    assert {s.sat for s in piece.observations.signals} == {"G05"}
    assert piece.observations.gpst.size == 1
    assert any("scrambled" in remark for remark in piece.remarks)


def test_epochs_without_a_time_are_left_out_and_counted() -> None:
    piece = read(make_epoch(GPS, time=struct.pack("<IH", 0xFFFFFFFF, 0xFFFF)), make_epoch(GPS))
    assert piece.observations.gpst.size == 1
    assert any("1 epochs before" in remark for remark in piece.remarks)


def test_slips_show_in_the_lock_time() -> None:
    def at(second_s: int, lock_s: int) -> bytes:
        time = struct.pack("<IH", 345_600_000 + 1000 * second_s, 2300)
        return make_epoch(make_channel(5, 0, 2.1e7, doppler_hz=0.0, cycles=1.0, lock_s=lock_s), time=time)

    o = read(*(at(k, lock) for k, lock in enumerate((20, 20, 22, 1, 2, 0)))).observations
    assert o.slipped[:, 0].tolist() == [False, False, False, True, False, True]


@pytest.mark.parametrize("size", [21, 33, 40, 55])
def test_a_block_that_ends_early_gives_what_is_whole(size) -> None:
    whole = make_epoch(GPS, GLONASS)
    cut = make_sbf_block(4027, whole[8:size], revision=1)
    piece = read(cut)
    assert piece.observations is None or len(piece.observations.signals) < 4


def make_geodetic(mode: int = 1, error: int = 0) -> bytes:
    body = TIME + bytes([mode, error]) + struct.pack("<ddd", np.radians(47.5), np.radians(8.5), 400.25)
    body += struct.pack("<fffff", 48.0, 1.5, -2.5, 0.25, 90.0) + struct.pack("<df", 0.125, 0.5)
    body += (
        bytes([0, 0, 11, 0]) + struct.pack("<HHI", 0, 65_535, 1) + bytes([0, 0]) + struct.pack("<HHHH", 0, 0, 120, 300)
    )
    return make_sbf_block(4007, body + bytes(1), revision=2)


def test_a_fix_has_place_velocity_clock_and_accuracy() -> None:
    fixes = read(make_geodetic()).fixes
    lat, lon, height = geodetic_from_ecef(fixes.position_ecef_m)
    assert np.degrees([lat[0], lon[0]]) == pytest.approx([47.5, 8.5], abs=1e-12)
    assert height[0] == pytest.approx(400.25, abs=1e-6)
    assert np.linalg.norm(fixes.velocity_ecef_m_s[0]) == pytest.approx(np.sqrt(1.5**2 + 2.5**2 + 0.25**2))
    assert (fixes.clock_bias_s[0], fixes.clock_drift[0]) == pytest.approx((1.25e-4, 5e-7))
    assert (fixes.horizontal_sigma_m[0], fixes.vertical_sigma_m[0]) == pytest.approx((0.6, 1.5))
    assert fixes.satellites.tolist() == [11]


@pytest.mark.parametrize(("mode", "error"), [(0, 0), (1, 3)])
def test_a_fix_with_an_error_is_none(mode, error) -> None:
    assert read(make_geodetic(mode, error)).fixes is None


def make_status(flags: int, mode: int) -> bytes:
    band = struct.pack("<IHBB", 1_575_420_000, 20, mode, 0)
    return make_sbf_block(4092, TIME + bytes([1, 8, flags, 0, 0, 0]) + band)


def test_states_of_jamming_spoofing_and_authentication() -> None:
    authentic = make_sbf_block(4245, TIME + struct.pack("<HfQQQQ", 6, 0.0, 0b1011, 0b0011, 0, 0))
    states = read(make_status(0, 1), make_status(2, 8), authentic).states
    assert sorted(zip(states.subject, states.state, states.alarm, strict=True)) == [
        ("authentication", "failed", True),
        ("jamming", "interference", True),
        ("jamming", "none", False),
        ("spoofing", "none", False),
        ("spoofing", "not authentic", True),
    ]


def test_gains_are_levels() -> None:
    gains = bytes([1, 35, 100, 0]) + bytes([2, 256 - 128, 100, 0]) + bytes([3, 20, 50, 5])
    levels = read(make_sbf_block(4014, TIME + bytes(14) + bytes([3, 4, 0, 60]) + gains)).levels
    assert levels.band.tolist() == ["G1", "L2"]
    assert levels.agc_db.tolist() == [35.0, 20.0]
    assert levels.noise_db == pytest.approx([0.0, -3.0103], abs=1e-3)


@pytest.mark.parametrize("inverted", [False, True])
def test_lnav_blocks_give_their_orbit(inverted) -> None:
    sent = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[4]
    tow_s = int(sent.toe) // 30 * 30 - 1800
    bits = encode_subframes(sent, None, None, tow_s, sent.week, 3).reshape(3, 300) ^ int(inverted)
    blocks = []
    for k, frame in enumerate(bits):
        words = np.packbits(np.append(frame, np.zeros(20, np.int8)).astype(np.uint8)).reshape(10, 4)[:, ::-1].tobytes()
        time = struct.pack("<IH", 1000 * (tow_s + 6 * (k + 1)), sent.week)
        blocks.append(make_sbf_block(4017, time + bytes([int(sent.sat[1:]), 1, 0, 0, 0, 3]) + words))
    collector = OrbitCollector()
    collector.take(read(*blocks).frames, {})
    (orbit,) = collector.navigation("x").ephemerides
    assert (orbit.sat, orbit.toe, orbit.week) == (sent.sat, sent.toe, sent.week)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", PAGES)
def test_real_pages_give_orbits_that_go_on(shared_data, name) -> None:
    path = shared_data / "real" / "osnma-sbf" / f"{name}.sbf"
    (piece,) = read_log([path.read_bytes()], "rx")
    assert piece.messages.keys() == {"GALRawINAV"}
    collector = OrbitCollector()
    collector.take(piece.frames, {})
    orbits = collector.navigation(name).ephemerides
    assert len({e.sat for e in orbits}) >= 6
    compared = 0
    for sat in {e.sat for e in orbits}:
        matching = sorted((e for e in orbits if e.sat == sat), key=lambda e: e.reference_gpst)
        for a, b in pairwise(matching):
            middle = a.reference_gpst + (b.reference_gpst - a.reference_gpst) / 2
            if b.reference_gpst - a.reference_gpst <= np.timedelta64(3600, "s"):
                places = [compute_satellite_state(e, middle).position_ecef_m for e in (a, b)]
                assert np.linalg.norm(places[0] - places[1]) < 5.0
                compared += 1
    assert compared or name in ("change_wt5", "fgi_galrawinav-270923", "custom_metrics")
