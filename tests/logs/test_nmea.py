"""NMEA against pynmeagps, value by value, on real logs and on sentences made here."""

import io

import numpy as np
import pytest
from pynmeagps import NMEAReader
from tests.logs.frames import make_nmea_sentence
from tests.logs.test_ubx import make_gps, make_pvt, make_rawx

from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.time import gpst_from_utc
from skyproof.logs.content import Beside
from skyproof.logs.stream import first_instant, is_log, read_log
from skyproof.records import CellStatus, SignalId

LOGS = ("nmea-pulled/spoof_init_-0.5chips.DAT", "nmea-pulled/spoof_init_-4.0chips_0.5v_prn8.DAT")
NEAR = np.datetime64("2024-02-05T12:00:00", "ns")


def read(*frames: bytes, near: np.datetime64 | None = NEAR):
    (piece,) = read_log([b"".join(frames)], "rx", Beside(near))
    return piece


def make_gga(
    time: str, *, lat: str = "4730.0000000", quality: int = 1, altitude: str = "350.0", more: str = "50.0"
) -> bytes:
    return make_nmea_sentence(f"GPGGA,{time},{lat},N,00830.0000000,E,{quality},09,0.8,{altitude},M,{more},M,,")


def make_rmc(time: str, date: str, status: str = "A") -> bytes:
    return make_nmea_sentence(f"GPRMC,{time},{status},4730.0000000,N,00830.0000000,E,0.0,0.0,{date},,,A")


@pytest.mark.shared_data
@pytest.mark.parametrize("name", LOGS)
def test_real_sentences_are_those_of_pynmeagps(shared_data, name) -> None:
    octets = (shared_data / "real" / name).read_bytes()
    piece = read(octets)
    places, strengths, epoch = [], [], -1
    for _, message in NMEAReader(io.BytesIO(octets), quitonerror=0):
        if message.msgID == "GGA":
            epoch += 1
            places.append((message.time, message.lat, message.lon, message.alt + message.sep, message.numSV))
        elif message.msgID == "GSV" and message.talker == "BD":
            for k in range(1, 5):
                number, level = getattr(message, f"svid_{k:02d}", ""), getattr(message, f"cno_{k:02d}", "")
                if number and level:
                    strengths.append((epoch, f"C{int(number) - 140:02d}", float(level)))
    lat, lon, height_m = geodetic_from_ecef(piece.fixes.position_ecef_m)
    assert piece.fixes.gpst.size == len(places) > 200
    assert np.degrees(lat) == pytest.approx([place[1] for place in places], abs=1e-10)
    assert np.degrees(lon) == pytest.approx([place[2] for place in places], abs=1e-10)
    assert height_m == pytest.approx([place[3] for place in places], abs=1e-6)
    assert piece.fixes.satellites.tolist() == [place[4] for place in places]
    o = piece.observations
    assert o.gpst.size == len(places)
    for epoch, sat, level in strengths:
        assert o.cn0_dbhz[epoch, o.signals.index(SignalId(sat, "B1", "2I"))] == level
    assert np.isfinite(o.cn0_dbhz).sum() == len(strengths) > 3000
    assert set(np.unique(o.status)) == {CellStatus.NO_RANGE, CellStatus.NOT_TRACKED}


@pytest.mark.shared_data
@pytest.mark.parametrize("name", LOGS)
def test_blocks_of_any_size_give_the_same_fixes(shared_data, name, monkeypatch) -> None:
    octets = (shared_data / "real" / name).read_bytes()
    whole = read(octets)
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 5000)
    pieces = list(read_log([octets[k : k + 333] for k in range(0, len(octets), 333)], "rx", Beside(NEAR)))
    assert len(pieces) > 20
    fixes = np.concatenate([piece.fixes.gpst for piece in pieces if piece.fixes is not None])
    np.testing.assert_array_equal(fixes, whole.fixes.gpst)
    cells = sum(int(np.isfinite(p.observations.cn0_dbhz).sum()) for p in pieces if p.observations is not None)
    assert cells == np.isfinite(whole.observations.cn0_dbhz).sum()


# --- made here


def test_an_epoch_is_what_has_one_time_of_day() -> None:
    gst = make_nmea_sentence("GPGST,120000.00,5,,,,3.0,4.0,7.0")
    piece = read(make_rmc("120000.00", "050224"), make_gga("120000.00"), gst, make_gga("120001.00"), near=None)
    utc = np.datetime64("2024-02-05T12:00:00", "ns")
    assert piece.fixes.gpst.tolist() == [gpst_from_utc(utc + np.timedelta64(k, "s")).astype(np.int64) for k in (0, 1)]
    lat, lon, height_m = geodetic_from_ecef(piece.fixes.position_ecef_m)
    assert np.degrees([lat[0], lon[0]]) == pytest.approx([47.5, 8.5])
    assert height_m == pytest.approx([400.0, 400.0])
    assert piece.fixes.horizontal_sigma_m[0] == 5.0
    assert piece.fixes.vertical_sigma_m[0] == 7.0
    assert piece.fixes.satellites.tolist() == [9, 9]


def test_gns_gll_and_rmc_give_places_too() -> None:
    gns = make_nmea_sentence("GNGNS,120000.00,4730.00,N,00830.00,E,AN,07,0.9,350.0,50.0,,")
    gll = make_nmea_sentence("GPGLL,4731.00,N,00830.00,E,120001.00,A,A")
    fixes = read(gns, gll, make_rmc("120002.00", "050224")).fixes
    lat, _, height_m = geodetic_from_ecef(fixes.position_ecef_m)
    assert np.degrees(lat) == pytest.approx([47.5, 47.5 + 1 / 60, 47.5])
    assert height_m == pytest.approx([400.0] * 3)  # that of the last one with a height
    assert fixes.satellites.tolist() == [7, -1, -1]


def test_the_day_goes_on_over_midnight() -> None:
    fixes = read(make_rmc("235959.00", "280224"), make_gga("000000.00"), make_gga("000001.00"), near=None).fixes
    assert np.diff(fixes.gpst).astype(np.int64).tolist() == [10**9] * 2
    assert str(fixes.gpst[-1])[:10] == "2024-02-29"


def test_a_date_that_comes_late_dates_what_was_before() -> None:
    zda = make_nmea_sentence("GPZDA,000001.00,06,02,2024,00,00")
    fixes = read(make_gga("235959.00"), make_gga("000000.00"), make_gga("000001.00"), zda, near=None).fixes
    assert [str(t)[:10] for t in fixes.gpst] == ["2024-02-06", "2024-02-06", "2024-02-06"]
    assert np.diff(fixes.gpst).astype(np.int64).tolist() == [10**9] * 2


def test_a_date_without_a_place_is_not_believed() -> None:
    fixes = read(make_rmc("120000.00", "060180", "V"), make_rmc("120001.00", "050224"), near=None).fixes
    assert [str(t)[:10] for t in fixes.gpst] == ["2024-02-05"]


def test_without_any_date_epochs_are_counted_and_left_out() -> None:
    octets = make_gga("120000.00") + make_gga("120001.00")
    piece = read(octets, near=None)
    assert (piece.fixes, piece.undated_epochs) == (None, 2)
    assert first_instant([octets]) is None
    assert read(octets).fixes.gpst.size == 2


def test_signals_have_the_numbers_of_their_talkers() -> None:
    sentences = [
        ("GPGSV,1,1,03,05,40,083,46,46,10,100,33,193,17,308,41,1", {"G05 L1 CA", "S33 L1 CA", "J01 L1 CA"}),
        ("GPGSV,1,1,01,05,40,083,46,6", {"G05 L2 L"}),
        ("GLGSV,1,1,01,70,40,083,46,1", {"R06 G1 CA"}),
        ("GAGSV,1,1,02,05,40,083,46,09,,,30,7", {"E05 E1 C", "E09 E1 C"}),
        ("GBGSV,1,1,01,19,40,083,46,3", {"C19 B1C 1P"}),
        ("BDGSV,1,1,02,147,36,197,41,19,00,000,", {"C07 B1 2I"}),
        ("GQGSV,1,1,01,02,40,083,46,8", {"J02 L5 Q"}),
    ]
    for text, names in sentences:
        o = read(make_gga("120000.00"), make_nmea_sentence(text)).observations
        assert {f"{s.sat} {s.band} {s.code}" for s in o.signals} == names, text
    assert read(make_gga("120000.00"), make_nmea_sentence("GPGSV,1,1,00,,,,,,,,,,,,,,,,")).observations.signals == ()


@pytest.mark.parametrize(
    "text",
    [
        "GPGGA,256000.00,4730.0,N,00830.0,E,1,09,0.8,350.0,M,50.0,M,,",
        "GPGGA,120000.00,4799.0,N,00830.0,E,1,09,0.8,350.0,M,50.0,M,,",
        "GPGGA,120000.00,4730.0,N,00830.0,E,1,09,0.8,1e99,M,50.0,M,,",
        "GPGGA,120000.00",
        "GPGSV,1,1,01,x,40,083,46",
        "GPRMC,120000.00,A,4730.0,N,00830.0,E,0.0,0.0,320224,,,A",
    ],
)
def test_damaged_sentences_cost_themselves(text) -> None:
    piece = read(make_gga("115959.00"), make_nmea_sentence(text), make_gga("120001.00"))
    assert piece.damaged_frames == 1
    assert piece.fixes.gpst.size == 2


def test_sentences_without_checksums_make_no_log() -> None:
    assert is_log(make_gga("120000.00") * 3)
    assert not is_log(b"$PRICE, 1, 2\r\n$PRICE, 3, 4\r\n$PRICE, 5, 6\r\n$PRICE, 7, 8\r\n")


def test_measurements_with_ranges_come_before_strengths(monkeypatch) -> None:
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 1)
    gsv = make_nmea_sentence("GPGSV,1,1,01,05,40,083,46,1")
    frames = [
        make_gga("120000.00") + gsv,
        make_gga("120001.00") + gsv,
        make_rawx(130_000.0, 2300, [make_gps(9)]),
        make_gga("120002.00") + gsv,
    ]
    pieces = [piece.observations for piece in read_log(frames, "rx", Beside(NEAR)) if piece.observations is not None]
    assert [bool(np.isfinite(o.pseudorange_m).any()) for o in pieces] == [False, True]


def test_sentences_beside_ranges_and_fixes_are_counted_only(monkeypatch) -> None:
    monkeypatch.setattr("skyproof.logs.frames._BLOCK_BYTES", 1)
    frames = [
        make_rawx(100.0, 2300, [make_gps(9)]) + make_pvt(100_000, (2024, 2, 4)),
        make_gga("000101.00"),
        make_gga("000102.00"),
    ]
    pieces = list(read_log(frames, "rx", Beside(NEAR)))
    assert [piece.fixes is None for piece in pieces] == [False, True, True, True]
    assert sum(piece.messages.get("NMEA", 0) for piece in pieces) == 2


@pytest.mark.parametrize(
    "text",
    [
        "GPGGA,120000.00,4730.0,N,00830.0,E,6,00,9.9,350.0,M,50.0,M,,",
        "GNGNS,120000.00,4730.00,N,00830.00,E,EE,00,9.9,350.0,50.0,,",
        "GPGLL,4731.00,N,00830.00,E,120000.00,A,E",
        "GPRMC,120000.00,A,4730.0,N,00830.0,E,0.0,0.0,050224,,,E",
    ],
)
def test_places_of_dead_reckoning_are_no_fixes(text) -> None:
    fixes = read(make_nmea_sentence(text), make_gga("120001.00")).fixes
    assert fixes.gpst.size == 1
