"""RTCM 3 against pyrtcm, value by value, on real streams and on messages made from the standard."""

import io
from collections import defaultdict

import numpy as np
import pytest
from pyrtcm import RTCMReader
from pyrtcm.rtcmtables import PRNSIGMAP
from tests.logs.frames import MSM_CELL_BITS, chain_bits, make_msm_message, make_rtcm3_frame

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import carrier_hz_of, rinex_signal
from skyproof.gnss.time import gpst, week_and_tow
from skyproof.logs.content import Beside
from skyproof.logs.rtcm3_cells import LOCK_4_MS, LOCK_7_MS, LOCK_10_MS, SYSTEMS
from skyproof.logs.stream import first_instant, read_log
from skyproof.records import SignalId

STREAMS = ("GMSD7_20121014.rtcm3", "testglo.rtcm3", "pygpsdata-MIXED-RTCM3.log")
NEAR = np.datetime64("2024-02-05T12:00:00", "ns")  # week 2300, of the messages made here
MS_M = 1e-3 * SPEED_OF_LIGHT_M_S
NOTHING = (-(2.0**-10), -(2.0**-8), -1.6384)
"""What pyrtcm makes of the fields of MSM7 that say that there is no code, phase or rate."""


def read(*frames: bytes, near: np.datetime64 | None = NEAR, **given):
    (piece,) = read_log([b"".join(frames)], "rx", Beside(near=near, **given))
    return piece


def list_fields(message, name: str) -> list:
    values, k = [], 1
    while hasattr(message, f"{name}_{k:02d}"):
        values.append(getattr(message, f"{name}_{k:02d}"))
        k += 1
    return values


def read_messages(octets: bytes):
    """Return the messages of a stream as pyrtcm parses them."""
    parsed = [message for _, message in RTCMReader(io.BytesIO(octets), quitonerror=0)]
    return [message for message in parsed if message is not None]


def find_seconds(message) -> float:
    """Return the time of an observation as its system counts, GLONASS's as of UTC."""
    if hasattr(message, "DF034"):
        return message.DF034 / 1e3 - 3 * 3600
    tow_ms = next(getattr(message, name) for name in ("DF004", "DF248", "DF427", "DF428") if hasattr(message, name))
    return tow_ms / 1e3


def read_cells(octets: bytes, leap_s: int, bdt_s: int) -> dict:
    """Return what pyrtcm reads of MSM7 of a stream: ranges and rate by second of day and RINEX name."""
    found = {}
    for message in read_messages(octets):
        if not 1070 < int(message.identity) < 1138 or message.identity[-1] != "7":
            continue
        second = find_seconds(message)
        second += leap_s if hasattr(message, "DF034") else bdt_s if hasattr(message, "DF427") else 0
        system = SYSTEMS[(int(message.identity) - 1070) // 10]
        rough = dict(
            zip(
                list_fields(message, "PRN"),
                zip(*(list_fields(message, name) for name in ("DF397", "DF398", "DF399")), strict=True),
                strict=True,
            )
        )
        names = ("CELLPRN", "CELLSIG", "DF405", "DF406", "DF404", "DF408", "DF420")
        for prn, name, code, carrier, rate, level, half in zip(*(list_fields(message, n) for n in names), strict=True):
            whole, mod, rough_rate = rough[prn]
            code, carrier, rate = (np.nan if v == n else v for v, n in zip((code, carrier, rate), NOTHING, strict=True))
            found[round(second * 1e3) % 86_400_000, system, int(prn), name] = (
                (whole + mod + code) * MS_M,
                (whole + mod + carrier) * MS_M,
                rough_rate + rate,
                level,
                half,
            )
    return found


@pytest.mark.shared_data
@pytest.mark.parametrize(("name", "leap_s", "bdt_s", "least"), [(STREAMS[0], 16, 0, 15_000), (STREAMS[2], 18, 14, 50)])
def test_msm_is_that_of_pyrtcm(shared_data, name, leap_s, bdt_s, least) -> None:
    octets = (shared_data / "real/streams" / name).read_bytes()
    o, compared = read(octets, near=first_instant([octets]) or NEAR).observations, 0
    rows = {round(week_and_tow(t)[1] * 1e3) % 86_400_000: k for k, t in enumerate(o.gpst)}
    for (ms, system, prn, name_of), (code_m, phase_m, rate_m_s, level, half) in read_cells(
        octets, leap_s, bdt_s
    ).items():
        kind = rinex_signal(system, name_of) if name_of != "/" else None
        if kind is None:
            continue
        number = prn - 192 if system == "J" else prn
        column = o.signals.index(SignalId(f"{system}{number:02d}", *kind))
        cycles_a_m = o.carrier_hz[column] / SPEED_OF_LIGHT_M_S
        assert o.pseudorange_m[rows[ms], column] == pytest.approx(code_m, abs=1e-6, nan_ok=True)
        cycles = phase_m * cycles_a_m
        assert o.carrier_cyc[rows[ms], column] == pytest.approx(cycles, abs=1e-5, nan_ok=True)
        assert o.doppler_hz[rows[ms], column] == pytest.approx(-rate_m_s * cycles_a_m, abs=1e-6, nan_ok=True)
        assert o.cn0_dbhz[rows[ms], column] == pytest.approx(level)
        assert o.half_cycle_open[rows[ms], column] == half
        compared += 1
    assert compared == np.isfinite(o.pseudorange_m).sum() > least


@pytest.mark.shared_data
def test_old_observations_are_those_of_pyrtcm(shared_data) -> None:
    octets = (shared_data / "real/streams" / STREAMS[1]).read_bytes()
    piece = read(octets, near=None)
    o = piece.observations
    rows = {round(week_and_tow(t)[1] * 1e3) % 86_400_000: k for k, t in enumerate(o.gpst)}
    codes = phases = 0
    seen: dict[SignalId, list[tuple[float, float]]] = defaultdict(list)
    for message in read_messages(octets):
        if message.identity not in ("1004", "1012"):
            continue
        glonass = message.identity == "1012"
        second = find_seconds(message)
        row = rows[round((second + (15 if glonass else 0)) * 1e3) % 86_400_000]
        names = ("DF038", "DF039", "DF041", "DF042", "DF044", "DF045", "DF046", "DF047", "DF048", "DF050")
        if not glonass:
            names = ("DF009", "DF010", "DF011", "DF012", "DF014", "DF015", "DF016", "DF017", "DF018", "DF020")
        for sv, l1, code_m, apart_m, whole, cn0, l2, more_m, apart_2_m, cn0_2 in zip(
            *(list_fields(message, name) for name in names), strict=True
        ):
            sat = f"R{sv:02d}" if glonass else f"G{sv:02d}" if sv < 40 else f"S{sv - 20:02d}"
            first = ("G1", "CP"[l1]) if glonass else ("L1", "CP"[l1])
            second_kind = ("G2", "CP"[l2]) if glonass else ("L2", "XPDW"[l2])
            code_m += whole * MS_M * (2 if glonass else 1)
            for kind, more, apart, level in ((first, 0.0, apart_m, cn0), (second_kind, more_m, apart_2_m, cn0_2)):
                if more == -8192 * 0.02 or (more, apart, level) == (0, 0, 0):
                    continue
                signal = SignalId(sat, kind[0], "CA" if kind[1] == "C" else kind[1])
                column = o.signals.index(signal)
                assert o.pseudorange_m[row, column] == pytest.approx(code_m + more, abs=1e-6)
                codes += 1
                if level > 0:
                    assert o.cn0_dbhz[row, column] == level
                if apart != -524288 * 0.0005:
                    cycles_a_m = o.carrier_hz[column] / SPEED_OF_LIGHT_M_S
                    turns = (o.carrier_cyc[row, column] - (code_m + apart) * cycles_a_m) / 1500.0
                    assert turns == pytest.approx(round(turns), abs=1e-6)
                    seen[signal].append((o.elapsed_s[row], o.carrier_cyc[row, column]))
                    phases += 1
    assert codes == np.isfinite(o.pseudorange_m).sum() > 5000
    assert phases == np.isfinite(o.carrier_cyc).sum() > 5000


@pytest.mark.shared_data
@pytest.mark.parametrize("name", STREAMS[:2])
def test_carriers_go_on_and_follow_their_codes(shared_data, name) -> None:
    octets = (shared_data / "real/streams" / name).read_bytes()
    piece = read(octets, near=None)
    o = piece.observations
    cycles_a_m = o.carrier_hz / SPEED_OF_LIGHT_M_S
    apart_m = np.diff(o.pseudorange_m - o.carrier_cyc / cycles_a_m, axis=0)[~o.slipped[1:]]
    assert np.nanquantile(np.abs(apart_m), 0.99) < 3.0


@pytest.mark.shared_data
@pytest.mark.parametrize("name", STREAMS[:2])
def test_blocks_of_any_size_give_the_same_stream(shared_data, name, monkeypatch) -> None:
    octets = (shared_data / "real/streams" / name).read_bytes()
    near = first_instant([octets])
    (whole,) = read_log([octets], "rx", Beside(near))
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 7000)
    pieces = list(read_log([octets[k : k + 999] for k in range(0, len(octets), 999)], "rx", Beside(near)))
    assert len(pieces) > 5
    epochs = np.concatenate([piece.observations.gpst for piece in pieces if piece.observations is not None])
    np.testing.assert_array_equal(epochs, whole.observations.gpst)
    cells = sum(int(np.isfinite(p.observations.carrier_cyc).sum()) for p in pieces if p.observations is not None)
    assert cells == np.isfinite(whole.observations.carrier_cyc).sum()
    slips = sum(int(p.observations.slipped.sum()) for p in pieces if p.observations is not None)
    assert slips == whole.observations.slipped.sum()


# --- made from the standard


def test_signals_are_those_of_pyrtcm() -> None:
    named = {SYSTEMS[int(key) - 107]: signals for key, (_, signals) in PRNSIGMAP.items() if int(key) <= 113}
    compared = 0
    for number, system in enumerate(SYSTEMS):
        for bit in range(1, 33):
            wanted = rinex_signal(system, named[system][bit][1]) if bit in named[system] else None
            time = 42_000_000 if system == "R" else 1000
            o = read(
                make_msm_message(1077 + 10 * number, time, {1: (70, 7, 512, 0)}, {(1, bit): (1, 1, 5, 0, 640, 1)})
            ).observations
            assert (None if o is None else (o.signals[0].band, o.signals[0].code)) == wanted
            compared += wanted is not None
    assert compared > 70


@pytest.mark.parametrize("kind", [4, 5, 6, 7])
def test_made_messages_give_their_numbers_and_pyrtcms(kind) -> None:
    sats = {3: (70, 5, 100, -321), 24: (81, 9, 1023, 8191)}
    cells = {
        (3, 2): (1000, -70_000, 3, 0, 45, -9999),
        (3, 15): (-2000, 5, 2, 1, 33, 16_383),
        (24, 2): (7, 8, 1, 0, 50, 0),
    }
    code_ms, phase_ms, cn0 = (2.0**-24, 2.0**-29, 1.0) if kind < 6 else (2.0**-29, 2.0**-31, 1 / 16)
    frame = make_msm_message(1070 + kind, 345_600_000, sats, cells)
    o = read(frame).observations
    (message,) = read_messages(frame)
    assert o.gpst[0] == gpst(2300, 345_600.0)
    fine_ms = list_fields(message, "DF400") or list_fields(message, "DF405")
    for k, (sat, signal) in enumerate(sorted(cells)):
        whole, _, mod, rate = sats[sat]
        fine, phase, _, half, level, fine_rate = cells[sat, signal]
        column = o.signals.index(SignalId(f"G{sat:02d}", *{2: ("L1", "CA"), 15: ("L2", "S")}[signal]))
        hz = o.carrier_hz[column]
        code_m = (whole + mod / 1024 + fine * code_ms) * MS_M
        assert fine * code_ms == pytest.approx(fine_ms[k])
        assert o.pseudorange_m[0, column] == pytest.approx(code_m, abs=1e-6)
        phase_m = (whole + mod / 1024 + phase * phase_ms) * MS_M
        assert o.carrier_cyc[0, column] == pytest.approx(phase_m * hz / SPEED_OF_LIGHT_M_S, abs=1e-4)
        assert o.cn0_dbhz[0, column] == level * cn0
        assert o.half_cycle_open[0, column] == half
        expected_hz = -(rate + 1e-4 * fine_rate) * hz / SPEED_OF_LIGHT_M_S if kind in (5, 7) else np.nan
        assert o.doppler_hz[0, column] == pytest.approx(expected_hz, nan_ok=True)


@pytest.mark.parametrize("kind", [4, 5, 6, 7])
def test_numbers_that_mean_nothing_are_no_measurements(kind) -> None:
    bits = MSM_CELL_BITS[kind]
    none = [-(1 << (bits[0] - 1)), -(1 << (bits[1] - 1)), 3, 0, 0, -16_384][: len(bits)]
    good = [1, 1, 3, 0, 40, 1][: len(bits)]
    cells = {(1, 2): tuple(none), (2, 2): tuple(good), (3, 2): (none[0], *good[1:])}
    o = read(
        make_msm_message(1070 + kind, 1000, {1: (70, 0, 5, 1), 2: (255, 0, 5, 1), 3: (71, 0, 5, -8192)}, cells)
    ).observations
    sats = [signal.sat for signal in o.signals]
    assert "G01" not in sats
    assert np.isnan(o.pseudorange_m).all()
    assert np.isfinite(o.carrier_cyc[0, sats.index("G03")])
    assert np.isnan(o.doppler_hz[0, sats.index("G03")])
    if kind in (5, 7):
        assert np.isfinite(o.doppler_hz[0, sats.index("G02")])


def make_simple(
    time: int, *, number: int = 1077, lock: int = 600, station: int = 9, sat: int = 1, half: int = 0
) -> bytes:
    return make_msm_message(number, time, {sat: (70, 7, 5, 1)}, {(sat, 2): (1, 1, lock, half, 640, 1)}, station=station)


def test_lock_times_are_those_of_the_tables() -> None:
    assert LOCK_4_MS[[0, 1, 14, 15]].tolist() == [31, 63, 524_287, 524_288]
    assert LOCK_10_MS[[0, 63, 64, 703, 704, 1023]].tolist() == [0, 63, 65, 67_108_863, 67_108_864, 67_108_864]
    assert LOCK_7_MS[[0, 23, 24, 126, 127]].tolist() == [999, 23_999, 25_999, 936_999, 937_000]


def test_slips_show_in_the_lock_of_messages() -> None:
    # 1 s apart: 2048 ms at 224, 4096 ms at 256; 1 ms at 1.
    o = read(*(make_simple(1000 * k, lock=lock) for k, lock in enumerate((224, 256, 256, 224, 1)))).observations
    assert o.slipped[:, 0].tolist() == [False, False, False, True, True]


def test_a_lock_shorter_than_a_gap_is_a_slip() -> None:
    o = read(make_simple(0, lock=224), make_simple(60_000, lock=256), make_simple(62_000, lock=288)).observations
    assert o.slipped[:, 0].tolist() == [False, True, False]


def test_a_half_cycle_that_is_resolved_is_a_slip() -> None:
    o = read(make_simple(0, half=1), make_simple(1000)).observations
    assert o.slipped[:, 0].tolist() == [False, True]


def make_glonass_time(day: int, ms: int) -> int:
    return day << 27 | ms


def test_systems_meet_in_one_epoch() -> None:
    tow_ms = 2 * 86_400_000 + 43_200_000  # Tuesday noon
    moscow_ms = 43_200_000 - 18_000 + 3 * 3_600_000
    frames = [make_simple(tow_ms), make_simple(tow_ms, number=1097), make_simple(tow_ms - 14_000, number=1127)]
    for day in (2, 7):
        o = read(*frames, make_simple(make_glonass_time(day, moscow_ms), number=1087)).observations
        assert o.gpst.tolist() == [gpst(2300, tow_ms / 1e3).astype(np.int64)]
        assert [signal.sat for signal in o.signals] == ["C01", "E01", "G01", "R01"]


def test_glonass_goes_on_over_midnight_in_moscow() -> None:
    day_ms = 86_400_000
    frames = [make_simple(day_ms * 2 + 20 * 3_600_000)]
    frames += [
        make_simple(make_glonass_time(day, ms), number=1087) for day, ms in ((7, day_ms - 1000), (7, 0), (7, 1000))
    ]
    o = read(*frames).observations
    assert np.diff(o.elapsed_s).tolist() == [3600.0 + 17.0, 1.0, 1.0]


def test_beidou_of_the_same_epoch_may_be_in_gps_time() -> None:
    cells = {(1, 2): (1, 1, 600, 0, 640, 1)}
    gps = make_msm_message(1077, 100_000, {1: (70, 0, 5, 1)}, cells, more=True)
    o = read(gps, make_simple(100_000, number=1127)).observations
    assert [signal.sat for signal in o.signals] == ["C01", "G01"]
    assert o.gpst.size == 1


def test_the_turn_of_the_week_goes_on_in_messages() -> None:
    o = read(make_simple(604_799_000), make_simple(0), near=np.datetime64("2024-02-10T22:00", "ns")).observations
    assert o.gpst.tolist() == [gpst(2300, 604_799.0).astype(np.int64), gpst(2301, 0.0).astype(np.int64)]


def test_without_a_week_epochs_are_left_out() -> None:
    piece = read(make_simple(0), make_simple(1000), near=None)
    assert piece.observations is None
    assert piece.undated_epochs == 2


def test_channels_come_from_the_message_or_from_outside() -> None:
    time = make_glonass_time(2, 50_000_000)
    known = read(make_simple(time, number=1087)).observations  # extended information 7 is number 0
    assert known.carrier_hz.tolist() == [carrier_hz_of("G1", 0)]
    cells = {(1, 2): (1, 1, 600, 0, 640)}
    plain = make_msm_message(1086, time, {1: (70, 0, 5, 0)}, cells)
    unknown = read(plain).observations
    assert np.isnan(unknown.carrier_cyc).all()
    assert np.isfinite(unknown.pseudorange_m).all()
    assert read(plain, channels={"R01": -3}).observations.carrier_hz.tolist() == [carrier_hz_of("G1", -3)]


def test_other_stations_are_left_out_and_named() -> None:
    piece = read(make_simple(0), make_simple(0, station=10, sat=2), make_simple(1000))
    assert [signal.sat for signal in piece.observations.signals] == ["G01"]
    assert any("than 9" in remark for remark in piece.remarks)


def test_an_epoch_over_two_stretches_stays_one(monkeypatch) -> None:
    frames = [frame for k in range(4) for frame in (make_simple(1000 * k), make_simple(1000 * k, number=1097))]
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 1)
    pieces = list(read_log(frames, "rx", Beside(NEAR)))
    observed = [piece.observations for piece in pieces if piece.observations is not None]
    assert [o.gpst.size for o in observed] == [1, 1, 1, 1]
    assert all(np.isfinite(o.pseudorange_m).all() and len(o.signals) == 2 for o in observed)
    assert sum(piece.messages.get("RTCM 1077", 0) for piece in pieces) == 4


def make_old_gps(tow_ms: int, apart: int, *, lock: int = 100) -> bytes:
    """Return 1002 of satellite 5: 70 ms and 1000 m, and the phase so many half millimetres apart from it."""
    fields = [(1002, 12), (9, 12), (tow_ms, 30), (0, 1), (1, 5), (0, 1), (0, 3)]
    fields += [(5, 6), (0, 1), (50_000, 24), (apart, 20), (lock, 7), (70, 8), (180, 8)]
    return make_rtcm3_frame(chain_bits(fields))


def test_old_phases_go_on_where_their_field_begins_anew() -> None:
    wavelength_m = SPEED_OF_LIGHT_M_S / carrier_hz_of("L1")
    turn = round(1500 * wavelength_m / 0.0005)
    o = read(
        *(make_old_gps(1000 * k, apart) for k, apart in enumerate((280_000, 284_000, 288_000 - turn)))
    ).observations
    assert o.pseudorange_m[:, 0] == pytest.approx(70 * MS_M + 1000.0)
    assert np.diff(o.carrier_cyc[:, 0]) * wavelength_m == pytest.approx([2.0, 2.0], abs=1e-3)
    assert np.isnan(read(make_old_gps(0, -524_288)).observations.carrier_cyc).all()


def test_ranges_modulo_a_millisecond_are_no_measurements() -> None:
    piece = read(make_rtcm3_frame(chain_bits([(1001, 12), (9, 12), (1000, 30), (0, 80)])))
    assert piece.observations is None
    assert any("modulo" in remark for remark in piece.remarks)


def test_the_stated_antenna_is_named_once() -> None:
    x, y, z = 44_440_308_028, 30_856_712_349, 33_666_582_560
    fields = [(1005, 12), (9, 12), (0, 10), (x, 38), (0, 2), (y, 38), (0, 2), (z, 38)]
    frame = make_rtcm3_frame(chain_bits(fields))
    (remark,) = read(frame, frame).remarks
    assert "32.0658325, 34.7738190, 72.13 m" in remark


def test_messages_that_end_early_or_say_too_much_give_nothing() -> None:
    whole = make_simple(1000)[3:-3]
    for size in range(2, len(whole)):
        assert read(make_rtcm3_frame(whole[:size])).observations is None
    crowded = bytearray(whole)
    crowded[9:21] = b"\xff" * 12  # all satellites, all signals
    assert read(make_rtcm3_frame(bytes(crowded))).observations is None
    old = make_old_gps(0, 1)[3:-3]
    for size in range(2, len(old)):
        assert read(make_rtcm3_frame(old[:size])).observations is None
