"""UBX against pyubx2, value by value, on real logs; and what real logs lack, made from the interface description."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from pyubx2 import UBXReader
from tests.logs.frames import make_ubx_frame

from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.time import week_and_tow
from skyproof.logs.content import LogPiece
from skyproof.logs.stream import read_log
from skyproof.records import CellStatus, Observations, SignalId

LOGS = ("imu-gnss-walk/gnss_1730.ubx", "streams/pygpsdata-RXMRAWX.log", "streams/ubx_20080526.ubx")
LETTERS = {0: "G", 1: "S", 2: "E", 3: "C", 5: "J", 6: "R"}
SIGNALS = {
    ("G", 0): ("L1", "CA"),
    ("G", 3): ("L2", "L"),
    ("G", 4): ("L2", "S"),
    ("G", 6): ("L5", "I"),
    ("G", 7): ("L5", "Q"),
    ("E", 0): ("E1", "C"),
    ("E", 1): ("E1", "B"),
    ("E", 3): ("E5a", "I"),
    ("E", 4): ("E5a", "Q"),
    ("E", 8): ("E6", "B"),
    ("E", 5): ("E5b", "I"),
    ("E", 6): ("E5b", "Q"),
    ("E", 9): ("E6", "C"),
    ("C", 6): ("B1C", "1D"),
    ("C", 8): ("B2a", "5D"),
    ("C", 0): ("B1", "2I"),
    ("C", 4): ("B3", "6I"),
    ("C", 5): ("B1C", "1P"),
    ("C", 7): ("B2a", "5P"),
    ("S", 0): ("L1", "CA"),
    ("J", 0): ("L1", "CA"),
    ("R", 0): ("G1", "CA"),
}
RAWX = "<ddfBBBBHBBBBBB"


def read_oracle(path: Path):
    """Return the UBX messages of a log as pyubx2 parses them."""
    return [message for _, message in UBXReader(io.BytesIO(path.read_bytes()), protfilter=2, quitonerror=0)]


def list_fields(message, name: str) -> list:
    """Return a repeated field of all blocks of a message."""
    values, k = [], 1
    while hasattr(message, f"{name}_{k:02d}"):
        values.append(getattr(message, f"{name}_{k:02d}"))
        k += 1
    return values


def find_epochs(observations: Observations) -> dict[tuple[int, int], int]:
    """Return the row of each epoch by week and millisecond of week."""
    weeks, tows_s = week_and_tow(observations.gpst)
    return {(int(week), round(tow_s * 1e3)): k for k, (week, tow_s) in enumerate(zip(weeks, tows_s, strict=True))}


@pytest.mark.shared_data
@pytest.mark.parametrize("name", LOGS[:2])
def test_measurements_are_those_of_pyubx2(shared_data, name) -> None:
    path = shared_data / "real" / name
    (piece,) = read_log([path.read_bytes()], "rx")
    o = piece.observations
    rows, cells = find_epochs(o), 0
    for message in read_oracle(path):
        if message.identity != "RXM-RAWX":
            continue
        row = rows[message.week, round(message.rcvTow * 1e3)]
        names = ("gnssId", "svId", "sigId", "prMes", "cpMes", "doMes", "cno", "prValid", "cpValid", "halfCyc", "prStd")
        for gnss, sv, sig, code_m, cycles, hertz, cn0, code, carrier, half, std in zip(
            *(list_fields(message, n) for n in names), strict=True
        ):
            letter = LETTERS[gnss]
            number = sv - 100 if letter == "S" else sv
            column = o.signals.index(SignalId(f"{letter}{number:02d}", *SIGNALS[letter, sig]))
            cells += 1
            if code:
                assert o.pseudorange_m[row, column] == code_m
                assert o.pseudorange_sigma_m[row, column] == pytest.approx(0.01 * 2.0**std)
            else:
                assert np.isnan(o.pseudorange_m[row, column])
            assert not carrier or o.carrier_cyc[row, column] == cycles
            assert not (code or carrier) or o.doppler_hz[row, column] == pytest.approx(hertz, rel=1e-7)
            assert not (code or carrier) or o.cn0_dbhz[row, column] == cn0
            assert o.half_cycle_open[row, column] == (carrier and not half)
    assert cells > 300
    assert (o.status != CellStatus.NOT_TRACKED).sum() <= cells


@pytest.mark.shared_data
def test_old_measurements_are_those_of_pyubx2(shared_data) -> None:
    path = shared_data / "real" / LOGS[2]
    (piece,) = read_log([path.read_bytes()], "rx")
    o, cells = piece.observations, 0
    rows = find_epochs(o)
    for message in read_oracle(path):
        if message.identity == "RXM-RAW":
            row = rows[message.week, message.iTOW]
            for sv, code_m, quality in zip(*(list_fields(message, n) for n in ("sv", "prMes", "mesQI")), strict=True):
                name = f"G{sv:02d}" if sv < 120 else f"S{sv - 100:02d}"
                if quality >= 4:
                    assert o.pseudorange_m[row, o.signals.index(SignalId(name))] == code_m
                    cells += 1
    assert cells == np.isfinite(o.pseudorange_m).sum() > 2000
    assert piece.cut


@pytest.mark.shared_data
def test_fixes_are_those_of_pyubx2(shared_data) -> None:
    path = shared_data / "real" / LOGS[0]
    (piece,) = read_log([path.read_bytes()], "rx")
    solved = [m for m in read_oracle(path) if m.identity == "NAV-PVT" and m.gnssFixOk]
    assert piece.fixes.gpst.size == len(solved) == 536
    lat, lon, height = geodetic_from_ecef(piece.fixes.position_ecef_m)
    assert np.degrees(lat) == pytest.approx([m.lat for m in solved], abs=1e-10)
    assert np.degrees(lon) == pytest.approx([m.lon for m in solved], abs=1e-10)
    assert height == pytest.approx([m.height / 1e3 for m in solved], abs=1e-6)
    assert piece.fixes.satellites.tolist() == [m.numSV for m in solved]
    speed = np.linalg.norm(piece.fixes.velocity_ecef_m_s, axis=1)
    assert speed == pytest.approx([np.hypot(np.hypot(m.velN, m.velE), m.velD) / 1e3 for m in solved], abs=1e-9)


@pytest.mark.shared_data
def test_carriers_follow_their_dopplers(shared_data) -> None:
    (piece,) = read_log([(shared_data / "real" / LOGS[0]).read_bytes()], "rx")
    o = piece.observations
    steps = np.diff(o.carrier_cyc, axis=0) / np.diff(o.elapsed_s)[:, None]
    mean_hz = 0.5 * (o.doppler_hz[1:] + o.doppler_hz[:-1])
    apart_hz = (steps + mean_hz)[~o.slipped[1:]]
    assert np.nanmedian(np.abs(apart_hz)) < 0.5  # the Dopplers themselves are hundreds
    assert np.nanquantile(np.abs(apart_hz), 0.99) < 5.0


@pytest.mark.shared_data
@pytest.mark.parametrize("name", LOGS)
def test_blocks_of_any_size_give_the_same(shared_data, name, monkeypatch) -> None:
    octets = (shared_data / "real" / name).read_bytes()[: 1 << 18]
    (whole,) = read_log([octets], "rx")
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 30_000)
    pieces = list(read_log([octets[k : k + 999] for k in range(0, len(octets), 999)], "rx"))
    assert len(pieces) >= len(octets) // 31_000
    observed = [piece.observations for piece in pieces if piece.observations is not None]
    joined = Observations.join(observed)
    assert joined.signals == whole.observations.signals
    for field in ("gpst", "pseudorange_m", "carrier_cyc", "status", "half_cycle_open"):
        np.testing.assert_array_equal(getattr(joined, field), getattr(whole.observations, field))
    assert sum(f.gpst.size for p in pieces for f in p.frames) == sum(f.gpst.size for f in whole.frames)


# --- made from the interface description


def make_rawx(tow_s: float, week: int, cells: list[tuple], leap_s: int = 18) -> bytes:
    """Return a RXM-RAWX frame; a cell is (gnss, sv, signal, slot, code, carrier, doppler, lock, cn0, tracking)."""
    payload = struct.pack("<dHbBBBH", tow_s, week, leap_s, len(cells), 1, 1, 0)
    for gnss, sv, signal, slot, code_m, cycles, hertz, lock_ms, cn0, tracking in cells:
        payload += struct.pack(RAWX, code_m, cycles, hertz, gnss, sv, signal, slot, lock_ms, cn0, 3, 2, 4, tracking, 0)
    return make_ubx_frame(0x02, 0x15, payload)


def read(*frames: bytes) -> LogPiece:
    (piece,) = read_log([b"".join(frames)], "rx")
    return piece


def make_gps(lock_ms: int, tracking: int = 7) -> tuple:
    return (0, 5, 0, 0, 2.1e7, 1.1e8, -500.0, lock_ms, 44, tracking)


def test_slips_show_in_the_lock_time() -> None:
    locks = [2000, 3000, 500, 1500, 0, 900]
    o = read(*(make_rawx(100.0 + k, 2300, [make_gps(lock)]) for k, lock in enumerate(locks))).observations
    assert o.slipped[:, 0].tolist() == [False, False, True, False, True, True]


def test_a_long_lock_over_a_gap_is_no_slip() -> None:
    o = read(make_rawx(100.0, 2300, [make_gps(64_500)]), make_rawx(400.0, 2300, [make_gps(64_500)])).observations
    assert not o.slipped.any()


def test_a_resolved_half_cycle_is_a_slip() -> None:
    o = read(make_rawx(100.0, 2300, [make_gps(9000, 3)]), make_rawx(101.0, 2300, [make_gps(10_000, 7)])).observations
    assert o.half_cycle_open[:, 0].tolist() == [True, False]
    assert o.slipped[:, 0].tolist() == [False, True]


def test_glonass_has_its_slot_and_unknown_ones_are_left_out() -> None:
    cells = [
        (6, 7, 0, 12, 2e7, 1e8, 10.0, 9, 40, 7),
        (6, 255, 0, 3, 2e7, 1e8, 10.0, 9, 40, 7),
        (4, 1, 0, 0, *make_gps(1)[4:]),
    ]
    o = read(make_rawx(100.0, 2300, cells)).observations
    assert [signal.sat for signal in o.signals] == ["R07"]
    assert o.carrier_hz.tolist() == [1602e6 + 5 * 562.5e3]


@pytest.mark.parametrize("week", [0, 20, 60_000])
def test_epochs_without_a_time_are_left_out_and_counted(week) -> None:
    piece = read(make_rawx(3.0, week, [make_gps(9)]), make_rawx(100.0, 2300, [make_gps(9)]))
    assert piece.observations.gpst.size == 1
    assert any("1 epochs before" in remark for remark in piece.remarks)


def test_the_turn_of_the_week_goes_on() -> None:
    o = read(make_rawx(604_799.0, 2300, [make_gps(9000)]), make_rawx(0.0, 2301, [make_gps(10_000)])).observations
    assert o.elapsed_s.tolist() == [0.0, 1.0]


def make_pvt(tow_ms: int, date: tuple[int, int, int], *, valid: int = 0x37, fix: int = 3) -> bytes:
    """Return a NAV-PVT frame at 47.5 north, 8.5 east, 400 m."""
    payload = bytearray(92)
    struct.pack_into("<IHBB", payload, 0, tow_ms, *date)
    payload[11], payload[20], payload[21], payload[23] = valid, fix, 1, 9
    struct.pack_into("<iii", payload, 24, 85_000_000, 475_000_000, 400_000)
    return make_ubx_frame(0x01, 0x07, bytes(payload))


def test_fixes_are_dated_around_midnight_of_utc() -> None:
    # 18 s before the week of GPS turns, UTC has the day before; and on the first of a month.
    fixes = read(
        make_pvt(10_000, (2024, 6, 29)), make_pvt(20_000, (2024, 6, 30)), make_pvt(86_410_000, (2024, 6, 30))
    ).fixes
    assert fixes.gpst.astype(str).tolist() == [
        "2024-06-30T00:00:10.000000000",
        "2024-06-30T00:00:20.000000000",
        "2024-07-01T00:00:10.000000000",
    ]


def test_fixes_without_a_date_or_a_position_are_none() -> None:
    assert read(make_pvt(10_000, (2024, 6, 29), valid=0)).fixes is None
    assert read(make_pvt(10_000, (2024, 6, 29), fix=0)).fixes is None
    assert read(make_pvt(10_000, (2024, 6, 29), fix=5)).fixes is None


def test_a_clock_stands_beside_its_fix() -> None:
    clock = make_ubx_frame(0x01, 0x22, struct.pack("<IiiII", 20_000, 250_000, -90, 10, 10))
    fixes = read(make_pvt(10_000, (2024, 6, 29)), make_pvt(20_000, (2024, 6, 30)), clock).fixes
    assert np.isnan(fixes.clock_bias_s[0])
    assert fixes.clock_bias_s[1] == pytest.approx(2.5e-4)
    assert fixes.clock_drift[1] == pytest.approx(-9e-8)


def make_hardware(noise: int, gain: int, jamming: int, state: int) -> bytes:
    payload = bytearray(60)
    struct.pack_into("<HH", payload, 16, noise, gain)
    payload[22], payload[45] = state << 2, jamming
    return make_ubx_frame(0x0A, 0x09, bytes(payload))


def make_radio(*blocks: tuple[int, int, int, int]) -> bytes:
    payload = bytes([0, len(blocks), 0, 0])
    for number, (state, noise, gain, jamming) in enumerate(blocks):
        payload += bytes([number, state, 2, 1]) + bytes(8) + struct.pack("<HHB", noise, gain, jamming) + bytes(7)
    return make_ubx_frame(0x0A, 0x38, payload)


def test_levels_take_the_time_of_the_epoch_before() -> None:
    piece = read(
        make_rawx(100.0, 2300, [make_gps(9)]),
        make_hardware(90, 4095, 51, 1),
        make_radio((1, 80, 8191, 0), (3, 120, 0, 255)),
    )
    levels, states = piece.levels, piece.states
    assert levels.band.tolist() == ["L1", "L1", "L2L5"]
    assert levels.agc_share == pytest.approx([4095 / 8191, 1.0, 0.0])
    assert levels.jamming_share == pytest.approx([0.2, 0.0, 1.0])
    assert np.diff(levels.noise_db) == pytest.approx(20.0 * np.log10([80 / 90, 1.5]))
    assert (levels.gpst == piece.observations.gpst[0]).all()
    assert list(zip(states.subject, states.state, states.alarm, strict=True)) == [
        ("jamming", "none", False),
        ("jamming", "none", False),
        ("jamming", "critical", True),
    ]


def test_states_of_spoofing_in_both_versions_and_the_status() -> None:
    first = make_ubx_frame(0x27, 0x09, bytes([1, 0, 0, 0, 0b101, 0, 0, 0, 0b101, 0, 0, 0]))
    second = make_ubx_frame(0x27, 0x09, bytes([2, 0b0011_1011, 0, 0]))
    status = make_ubx_frame(0x01, 0x03, bytes([0] * 7 + [2 << 3] + [0] * 8))
    states = read(make_rawx(100.0, 2300, [make_gps(9)]), first, second, status).states
    assert list(zip(states.subject, states.state, states.alarm, strict=True)) == [
        ("jamming", "warning", True),
        ("spoofing", "indicated", True),
        ("jamming", "none", False),
        ("spoofing", "several indications", True),
        ("spoofing", "indicated", True),
    ]


def test_nothing_timed_gives_no_levels() -> None:
    assert read(make_hardware(90, 4095, 51, 1)).levels is None
    assert read().observations is None
