"""Orbits from a log's broadcast messages, against the receiver's own fix and each other."""

from itertools import combinations

import numpy as np
import pytest
from tests.logs.frames import make_ubx_frame
from tests.logs.test_ubx import make_gps, make_rawx

from skyproof.gnss.constants import GPS_PI, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData, UtcParameters, group_delay_s
from skyproof.gnss.lnav import check_words, encode_subframes
from skyproof.gnss.messages.beidou import _D1, _D2_PAGES, _DIVIDED, d1_utc, d2_ephemeris, d2_page
from skyproof.gnss.messages.bit_fields import BitField, read_fields
from skyproof.gnss.messages.galileo import _INAV, inav_utc
from skyproof.gnss.messages.glonass import _STRINGS, glonass_ephemeris, glonass_string
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.time import gpst as gpst_of
from skyproof.gnss.time import timedelta_from_s
from skyproof.logs.content import BroadcastFrames
from skyproof.logs.orbits import OrbitCollector
from skyproof.logs.stream import read_log
from skyproof.navigation.fix import fix

WALK = "real/imu-gnss-walk/gnss_1730.ubx"


@pytest.fixture(scope="module")
def walk(shared_data):
    """Read the piece and the orbits of a real log."""
    (piece,) = read_log([(shared_data / WALK).read_bytes()], "rx")
    collector = OrbitCollector()
    collector.take(piece.frames, {})
    return piece, collector.navigation("the log")


@pytest.mark.shared_data
def test_the_orbits_of_a_real_log_give_the_receivers_own_fix(walk) -> None:
    piece, navigation = walk
    kinds = (("G", "L1", "CA"), ("E", "E1", "C"), ("C", "B3", "6I"))
    signals = tuple(s for s in piece.observations.signals if s.kind in kinds and s.sat[0] != "S")
    found = fix(piece.observations, navigation, signals=signals, elevation_mask_deg=10.0)
    apart_m = np.linalg.norm(found.position_ecef_m - piece.fixes.position_ecef_m, axis=1)
    assert (found.status == 0).all()
    assert np.median(apart_m) < 12.0  # no ionosphere is in the log
    assert np.sqrt(np.nanmean(found.residual_m**2)) < 3.0


@pytest.mark.shared_data
def test_messages_of_one_satellite_say_the_same(walk) -> None:
    piece, navigation = walk
    at = piece.observations.gpst[100]
    compared = 0
    for a, b in combinations(navigation.ephemerides, 2):
        if a.sat == b.sat and a.message != b.message:
            places = [compute_satellite_state(e, at).position_ecef_m for e in (a, b)]
            same = {a.message, b.message} in ({"INAV", "FNAV"}, {"BCNAV1", "BCNAV2"}) and a.toe == b.toe
            assert np.linalg.norm(places[0] - places[1]) < (1e-3 if same else 3.0), (a.sat, a.message, b.message)
            clocks_m = [compute_satellite_state(e, at).clock_s * SPEED_OF_LIGHT_M_S for e in (a, b)]
            assert a.sat[0] == "E" or abs(clocks_m[0] - clocks_m[1]) < 0.5
            compared += 1
    assert compared >= 20
    assert {e.message for e in navigation.ephemerides} == {
        *("LNAV", "CNAV", "INAV", "FNAV", "D1", "BCNAV1", "BCNAV2"),
    }


def pack_bits(bits: np.ndarray) -> np.ndarray:
    return np.packbits(bits.astype(np.uint8), axis=-1)


def test_lnav_frames_give_what_was_encoded() -> None:
    navigation = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns"))
    sent = navigation.ephemerides[0]
    tow_s = 6 * (int(sent.toe) // 6 - 300)
    tow_s -= tow_s % 30
    bits = encode_subframes(sent, None, None, tow_s, sent.week, 5).reshape(5, 300)
    source = check_words(bits)[0].reshape(5, 240)
    frames = BroadcastFrames(
        kind="LNAV",
        gpst=np.array([sent.reference_gpst] * 5),
        until_gpst=np.array([sent.reference_gpst] * 5),
        since_gpst=np.array([sent.reference_gpst] * 5),
        sat=np.array([sent.sat] * 5),
        band=np.array(["L1"] * 5),
        code=np.array(["CA"] * 5),
        bits=pack_bits(source),
    )
    collector = OrbitCollector()
    collector.take([frames], {})
    (read,) = collector.navigation("test").ephemerides
    assert (read.sat, read.week, read.toe, read.iodc) == (sent.sat, sent.week, sent.toe, sent.iodc)
    assert read.sqrt_a == pytest.approx(sent.sqrt_a, abs=2.0**-19)


@pytest.mark.parametrize(
    ("early_s", "late_s", "open_s", "mistimed"),
    [
        (0.0, 0.0, 0.0, 0),
        (60.0, 0.0, 0.0, 1),
        (60.0, 0.0, 80.0, 0),
        (60.0, 0.0, np.nan, 0),
        (-60.0, 0.0, 0.0, 1),
        (-60.0, 0.0, 80.0, 1),
        (60.0, 0.0, -9.0, 0),
        (-5.0, 5.0, 5.0, 0),
        (-5.0, 1.0, 5.0, 0),
        (-60.0, 5.0, 5.0, 1),
        (60.0, 5.0, 5.0, 1),
        (-60.0, np.nan, 5.0, 0),
        (-60.0, -9.0, 5.0, 0),
    ],
)
def test_a_frame_is_mistimed_only_where_its_time_is_known(early_s, late_s, open_s, mistimed) -> None:
    # As where a log has lost the epochs beside a frame, or the receiver writes it behind its next epoch.
    sent = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[0]
    tow_s = int(sent.toe) // 30 * 30
    source = check_words(encode_subframes(sent, None, None, tow_s, sent.week, 5).reshape(5, 300))[0].reshape(5, 240)
    gpst = gpst_of(sent.week, tow_s + 6.0) - timedelta_from_s(early_s)
    since, until = (
        np.array([gpst + timedelta_from_s(s) if s == s else np.datetime64("NaT", "ns")]) for s in (-late_s, open_s)
    )
    frames = BroadcastFrames(
        kind="LNAV",
        gpst=np.array([gpst]),
        until_gpst=until,
        since_gpst=since,
        sat=np.array([sent.sat]),
        band=np.array(["L1"]),
        code=np.array(["CA"]),
        bits=pack_bits(source[:1]),
    )
    collector = OrbitCollector()
    collector.take([frames], {})
    received = collector.received()
    assert (0 if received is None else len(received.mistimed_sat)) == mistimed


def encode_value(field: BitField, value: float, n_bits: int) -> int:
    """Return the bits of a frame that carry a value: the inverse of `BitField.value`, written independently."""
    length = sum(size for _, size in field.runs)
    raw = round(value / GPS_PI / field.scale) if field.angle else round(value / field.scale)
    if field.magnitude and raw < 0:
        raw = -raw | 1 << (length - 1)
    raw %= 1 << length
    frame = 0
    for first, size in reversed(field.runs):
        frame |= (raw & (1 << size) - 1) << (n_bits - first - size)
        raw >>= size
    return frame


def test_d2_pages_give_the_numbers_that_were_put() -> None:
    e = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[0]
    values = {name: getattr(e, name) for name in ("m0", "i0", "omega0", "omega", "cus", "cis", "idot")}
    values |= {"af0": -2.5e-4, "af1": 3e-11, "cuc": -4e-7, "e": 0.0123, "cic": 6e-8, "omega_dot": -5e-9}
    values |= {"sqrt_a": 6493.4, "toe": 3600.0, "toc": 3600.0, "week_mod_8192": 834, "tgd": -3.1e-9, "tgd2": 2.2e-9}
    values |= {
        "health": 0,
        "iodc": 3,
        "iode": 5,
        "ura_index": 2,
        "af2": 0.0,
        "delta_n": 4e-9,
        "crc": 120.5,
        "crs": -60.25,
    }
    for name, field in _DIVIDED.items():
        n_low, n_bits = field.runs[1][1], sum(size for _, size in field.runs)
        raw = encode_value(field, values[name], n_bits)
        values |= {f"{name}_high": raw >> n_low, f"{name}_low": raw & (1 << n_low) - 1}
    pages = {}
    for number, fields in _D2_PAGES.items():
        frame = 0b11100010010 << 289 | 1 << 282 | number << 254
        frame |= encode_value(BitField("sow_s", ((18, 8), (30, 12))), 3000.0 + 3.0 * (number - 1), 300)
        for field in fields:
            frame |= encode_value(field, values[field.name], 300)
        read = d2_page(frame)
        pages[read[0]] = read[1]
    made = d2_ephemeris(pages, "C03", 2190)
    assert (made.week, made.toe, made.message) == (834 + 1356, 3600.0, "D2")
    for name in ("af0", "af1", "cuc", "e", "cic", "i0", "omega_dot", "omega", "m0", "sqrt_a", "crs", "tgd2"):
        assert getattr(made, name) == pytest.approx(values[name], rel=1e-5, abs=1e-10), name
    pages[7] = {**pages[7], "sow_s": 0.0}
    assert d2_ephemeris(pages, "C03", 2190) is None


def test_glonass_strings_give_the_state_of_the_hour() -> None:
    values = {f"{axis}_position_m": p for axis, p in zip("xyz", (1.2e7, -1.9e7, 1.1e7), strict=True)}
    values |= {f"{axis}_velocity_m_s": v for axis, v in zip("xyz", (-900.0, 1500.0, 2800.0), strict=True)}
    values |= {f"{axis}_acceleration_m_s2": a for axis, a in zip("xyz", (1e-6, -2e-6, 0.0), strict=True)}
    values |= {"reference_steps": 91, "gamma_n": -9e-13, "tau_n": 1e-5, "delta_tau_n": -2e-9, "slot": 7}
    strings = {}
    for number, fields in _STRINGS.items():
        frame = number << 80
        for field in fields:
            frame |= encode_value(field, values.get(field.name, 0), 85)
        read = glonass_string(frame)
        strings[read[0]] = read[1]
    received = np.datetime64("2022-03-01T19:50:00", "ns")  # 22:49:42 in Moscow, where the time of ephemeris is 22:45
    made = glonass_ephemeris(strings, "R07", received, -4)
    assert made.reference_gpst == np.datetime64("2022-03-01T19:45:18", "ns")
    assert made.position_m == pytest.approx((1.2e7, -1.9e7, 1.1e7), abs=1.0)
    assert made.velocity_m_s == pytest.approx((-900.0, 1500.0, 2800.0), abs=1e-3)
    assert (made.tau_n, made.delta_tau_n) == pytest.approx((1e-5, -2e-9), abs=1e-9)
    assert glonass_ephemeris(strings, "R08", received, -4) is None
    assert glonass_string(1 << 84) is None


def test_unknown_satellites_and_damage_give_no_orbit() -> None:
    frames = BroadcastFrames(
        kind="INAV",
        gpst=np.array(["2022-03-01"] * 3, "M8[ns]"),
        until_gpst=np.array(["2022-03-01"] * 3, "M8[ns]"),
        since_gpst=np.array(["2022-03-01"] * 3, "M8[ns]"),
        sat=np.array(["E01"] * 3),
        band=np.array(["E1"] * 3),
        code=np.array(["B"] * 3),
        bits=np.random.default_rng(1).integers(0, 256, (3, 30), dtype=np.uint8),
    )
    collector = OrbitCollector()
    collector.take([frames], {})
    assert collector.navigation("test").ephemerides == ()


@pytest.mark.shared_data
def test_modern_messages_state_the_delays_of_older_ones(walk) -> None:
    _, navigation = walk
    by_kind = {(e.sat, e.message): e for e in navigation.ephemerides}
    compared = 0
    for (sat, message), e in by_kind.items():
        if message == "CNAV" and (sat, "LNAV") in by_kind:
            assert e.tgd == pytest.approx(by_kind[sat, "LNAV"].tgd, abs=2.0**-31)
            assert abs(group_delay_s(e, "L1", "CA") - e.tgd) < 5e-9
            compared += 1
        if message == "BCNAV2" and (sat, "BCNAV1") in by_kind:
            assert group_delay_s(e, "B1C", "1P") == group_delay_s(by_kind[sat, "BCNAV1"], "B1C", "1P")
            compared += 1
    assert compared >= 10


@pytest.mark.shared_data
def test_the_orbits_of_modern_messages_alone_give_the_fix(walk) -> None:
    piece, navigation = walk
    modern = tuple(e for e in navigation.ephemerides if e.message in ("CNAV", "BCNAV1", "BCNAV2"))
    kinds = (("G", "L1", "CA"), ("C", "B1C", "1P"))
    signals = tuple(s for s in piece.observations.signals if s.kind in kinds)
    found = fix(piece.observations, NavigationData(ephemerides=modern), signals=signals, elevation_mask_deg=10.0)
    apart_m = np.linalg.norm(found.position_ecef_m - piece.fixes.position_ecef_m, axis=1)
    assert np.nanmedian(apart_m) < 15.0  # no ionosphere


def make_lnav_frames(sat: str, bits: np.ndarray, gpst: np.datetime64) -> BroadcastFrames:
    """Return subframes (n, 300 bits) that came at one time."""
    source = check_words(bits)[0].reshape(-1, 240)
    n = len(source)
    return BroadcastFrames(
        kind="LNAV",
        gpst=np.array([gpst] * n),
        until_gpst=np.array([gpst] * n),
        since_gpst=np.array([gpst] * n),
        sat=np.array([sat] * n),
        band=np.array(["L1"] * n),
        code=np.array(["CA"] * n),
        bits=pack_bits(source),
    )


def test_what_a_satellite_says_of_utc_is_kept_once() -> None:
    sent = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[0]
    utc = UtcParameters(a0=3.0 * 2.0**-30, a1=0.0, tot=147456.0, wnt=2190, leap_seconds=18)
    begin_s = 750 * 700 + 30 * 17 + 18  # page 18 of subframe 4
    bits = encode_subframes(sent, None, utc, begin_s, 2190, 1).reshape(1, 300)
    collector = OrbitCollector()
    for times in (0, 1):
        gpst = gpst_of(2190, begin_s + 6.0 + 750.0 * times)
        collector.take([make_lnav_frames(sent.sat, bits, gpst)], {})
    received = collector.received()
    (stated,) = received.utc
    assert (stated.sat, stated.utc) == (sent.sat, utc)
    assert received.utc_gpst[0] == gpst_of(2190, begin_s + 6.0)
    assert stated.leap_seconds_at(received.utc_gpst[0]) == 18
    assert stated.off_s(received.utc_gpst[0]) == utc.a0
    assert len(received.select_between(gpst_of(2190, begin_s + 7.0), gpst_of(2191, 0.0)).utc) == 0


def test_leap_seconds_stand_in_a_page_without_utc() -> None:
    navigation = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns"))
    sent, begin_s = navigation.ephemerides[0], 750 * 700 + 30 * 17 + 18
    bits = encode_subframes(sent, navigation.ionosphere, None, begin_s, 2190, 1).reshape(1, 300)
    collector = OrbitCollector()
    collector.take([make_lnav_frames(sent.sat, bits, gpst_of(2190, begin_s + 6.0))], {})
    assert collector.received().utc[0].utc.leap_seconds == 18


UTC_VALUES = {"a0": -2.5e-9, "a1": 3e-15, "leap_seconds": 17, "leap_seconds_future": 18}
UTC_VALUES |= {"tot": 7200.0, "dn": 3, "page": 10}


@pytest.mark.parametrize(
    ("fields", "n_bits", "read", "behind_s", "week_0", "day"),
    [(_INAV[6], 128, inav_utc, 0, 1024, 3), (_D1[5], 300, d1_utc, 14, 1356, 4)],
    ids=["I/NAV", "D1"],
)
def test_a_change_of_leap_seconds_comes_with_its_day(fields, n_bits, read, behind_s, week_0, day) -> None:
    # BeiDou's leap seconds count from 2006, and its days from 0.
    values = {name: value - behind_s * name.startswith("leap") for name, value in UTC_VALUES.items()}
    values |= {"wnt_mod_256": (2190 - week_0) % 256, "wn_lsf_mod_256": (2191 - week_0) % 256}
    frame = sum(encode_value(field, values[field.name], n_bits) for field in fields)
    stated = read(read_fields(fields, frame, n_bits), "E11", 2190)
    change = gpst_of(2191, 86_400.0 * day + 17.0)
    assert (stated.utc.leap_seconds, stated.later_leap_seconds, stated.later_from_gpst) == (17, 18, change)
    assert stated.utc.a0 == pytest.approx(UTC_VALUES["a0"], abs=2.0**-30)
    assert stated.leap_seconds_at(change - np.timedelta64(1, "s")) == 17
    assert stated.leap_seconds_at(change) == 18


def test_other_pages_of_beidou_say_nothing_of_utc() -> None:
    assert d1_utc({"page": 9.0}, "C11", 2190) is None


@pytest.mark.shared_data
def test_galileo_says_the_utc_that_is_known(walk) -> None:
    collector = OrbitCollector()
    collector.take(walk[0].frames, {})
    received = collector.received()
    assert {stated.sat[0] for stated in received.utc} == {"E"}
    assert {stated.leap_seconds_at(at) for at, stated in zip(received.utc_gpst, received.utc, strict=True)} == {18}
    assert max(abs(stated.off_s(received.gpst[0])) for stated in received.utc) < 1e-8


def write_late(interval_s: int, off_s: int) -> list[bytes]:
    """Return epochs of a log, each followed by the subframes that ended since the last one, of another time."""
    sent = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[0]
    begin_s = int(sent.toe) // 30 * 30
    bits = encode_subframes(sent, None, None, begin_s + off_s, sent.week, 50).reshape(50, 300)
    head = bytes([0, int(sent.sat[1:]), 0, 0, 10, 0, 2, 0])
    epochs = []
    for second in range(interval_s, 300, interval_s):
        epoch = make_rawx(begin_s + second + 1e-3, sent.week, [make_gps(1000)])
        for k in range((second - interval_s) // 6, second // 6):
            words = check_words(bits[k])[0].astype(np.int64) @ (1 << np.arange(23, -1, -1)) << 6
            epoch += make_ubx_frame(0x02, 0x13, head + words.astype("<u4").tobytes())
        epochs.append(epoch)
    return epochs


@pytest.mark.parametrize("at_once", [1, 7, 1000])
@pytest.mark.parametrize("interval_s", [1, 5, 30])
@pytest.mark.parametrize("off_s", [0, 90, -90])
def test_frames_behind_the_next_epoch_are_in_time_at_any_rate(interval_s, off_s, at_once) -> None:
    epochs = write_late(interval_s, off_s)
    blocks = [b"".join(epochs[k : k + at_once]) for k in range(0, len(epochs), at_once)]
    collector = OrbitCollector()
    for piece in read_log(blocks, "rx"):
        collector.take(piece.frames, {})
    received = collector.received()
    assert bool(received.mistimed_sat) == bool(off_s)
    assert len(received.ephemerides) == 1


def make_glonass_frames(came: list[tuple[float, int, int]]) -> BroadcastFrames:
    """Return strings that came so many seconds after noon of Moscow, of a number, of the data of a quarter of an hour.

    What they carry is drawn, another for each quarter.
    """
    start = np.datetime64("2022-01-01T09:00:18", "ns")  # noon in Moscow
    gpst = np.array([start + timedelta_from_s(after_s) for after_s, _, _ in came])
    octets = []
    for _, number, quarter in came:
        values = {"reference_steps": 48 + quarter, "slot": 7, "tau_n": 1e-6 * quarter}
        values |= {f"{axis}_position_m": 1e7 + 1e6 * quarter for axis in "xyz"}
        frame = number << 80
        for field in _STRINGS[number]:
            frame |= encode_value(field, values.get(field.name, 0), 85)
        octets.append(np.frombuffer((frame << 3).to_bytes(11, "big"), np.uint8))
    return BroadcastFrames(
        kind="GLONASS",
        gpst=gpst,
        until_gpst=gpst,
        since_gpst=gpst,
        sat=np.array(["R07"] * len(came)),
        band=np.array(["G1"] * len(came)),
        code=np.array(["CA"] * len(came)),
        bits=np.array(octets),
    )


def take_in_turn(numbers: tuple[int, ...], after_s: float, quarter: int) -> list[tuple[float, int, int]]:
    return [(after_s + 2.0 * number, number, quarter) for number in numbers]


@pytest.mark.parametrize(
    ("later", "expected"),
    [
        (take_in_turn((1, 2, 3, 4), 30.0, 2), [0, 2]),
        (take_in_turn((2, 3, 4), 30.0, 2), [0]),
        (take_in_turn((1, 2, 4), 30.0, 2), [0]),
        (take_in_turn((1, 2, 3), 30.0, 2), [0]),
        ([(0.0, number, 2) for number in (1, 2, 3, 4)], [0, 2]),
    ],
    ids=["whole", "without 1", "without 3", "without 4", "all at one epoch"],
)
def test_strings_of_two_frames_make_no_orbit(later, expected) -> None:
    # No number tells of which data a string is: at the half hour they change.
    collector = OrbitCollector()
    collector.take([make_glonass_frames(take_in_turn((1, 2, 3, 4), 0.0, 0) + later)], {"R07": 5})
    made = collector.navigation("test").ephemerides
    assert [(round(e.tau_n * 1e6), e.position_m) for e in made] == [(k, (1e7 + 1e6 * k,) * 3) for k in expected]
