"""GnssLogger against pandas, value by value, on real logs; and what those lack, made from the columns' description."""

import io
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from tests.logs.phone import COLUMNS, FULL_BIAS_NS, HEADER, WEEK_NS, Measured, make_raw_line, sign_bytes

from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.lnav import check_words, encode_subframes
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import GPS_EPOCH
from skyproof.logs.content import LogPiece
from skyproof.logs.gnsslogger import is_gnsslogger, read_gnsslogger
from skyproof.logs.kinds import kind_of_log
from skyproof.logs.stream import read_log
from skyproof.records import Observations, SignalId

LOGS = ("gnss_log_2019_12_12_11_07_38.txt", "gnss_log_2019_12_12_11_25_30.txt")
M_NS = SPEED_OF_LIGHT_M_S * 1e-9
DAY_NS = 86_400 * 10**9
FULL = 1 << 0 | 1 << 3


def read(*lines: str, header: str = HEADER) -> LogPiece:
    (piece,) = read_gnsslogger([(header + "".join(lines)).encode()], "phone")
    return piece


def make_observations(*rows: Measured) -> Observations:
    return read(*map(make_raw_line, rows)).observations


def find_since_epoch_ns(o: Observations) -> np.ndarray:
    return (o.gpst - GPS_EPOCH).astype(np.int64)


def read_with_pandas(text: bytes) -> pd.DataFrame:
    """Return the Raw rows as pandas reads them, whole numbers exact."""
    lines = [line for line in text.decode().splitlines() if line.startswith("Raw,")]
    names = next(line for line in text.decode().splitlines() if line.startswith("# Raw,")).split(",")
    whole = ("TimeNanos", "FullBiasNanos", "ReceivedSvTimeNanos", "Svid", "State", "HardwareClockDiscontinuityCount")
    names = [name if name not in names[:k] else f"{name}.{k}" for k, name in enumerate(names)]
    return pd.read_csv(io.StringIO("\n".join(lines)), header=None, names=names, dtype=dict.fromkeys(whole, "Int64"))


@pytest.mark.shared_data
@pytest.mark.parametrize("name", LOGS)
def test_real_logs_are_what_pandas_reads(shared_data, name) -> None:
    text = (shared_data / "real" / "phone-orientation" / name).read_bytes()
    (piece,) = read_gnsslogger([text], "phone")
    o, rows = piece.observations, read_with_pandas(text)
    assert np.isfinite(o.pseudorange_m).sum() == len(rows) == piece.messages["GnssLogger Raw"]
    epochs = rows.TimeNanos.drop_duplicates().to_numpy(np.int64)
    assert o.gpst.size == epochs.size
    first_bias_ns = int(rows.FullBiasNanos.iloc[0])
    first_part = rows.HardwareClockDiscontinuityCount.iloc[0]
    for row in rows.itertuples():
        k, column = int(np.searchsorted(epochs, row.TimeNanos)), o.signals.index(SignalId(f"G{row.Svid:02d}"))
        # Whatever the clock shows, code and label together say when the signal was sent.
        sent_ns = find_since_epoch_ns(o)[k] % WEEK_NS - o.pseudorange_m[k, column] / M_NS
        assert sent_ns == pytest.approx(float(row.ReceivedSvTimeNanos), abs=0.15)  # of a float of 4e14
        assert o.cn0_dbhz[k, column] == row.Cn0DbHz
        assert o.pseudorange_sigma_m[k, column] == pytest.approx(row.ReceivedSvTimeUncertaintyNanos * M_NS)
        sigma_hz = row.PseudorangeRateUncertaintyMetersPerSecond * L1_HZ / SPEED_OF_LIGHT_M_S
        assert o.doppler_sigma_hz[k, column] == pytest.approx(sigma_hz)
        if row.HardwareClockDiscontinuityCount == first_part:
            travel_ns = (row.TimeNanos - first_bias_ns) % WEEK_NS - row.ReceivedSvTimeNanos
            assert o.pseudorange_m[k, column] == pytest.approx(travel_ns * M_NS, abs=1e-6)
            hertz = -row.PseudorangeRateMetersPerSecond * L1_HZ / SPEED_OF_LIGHT_M_S
            assert o.doppler_hz[k, column] == pytest.approx(hertz)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", LOGS)
def test_real_ranges_go_on_where_the_clock_stops(shared_data, name) -> None:
    text = (shared_data / "real" / "phone-orientation" / name).read_bytes()
    (piece,) = read_gnsslogger([text], "phone")
    o = piece.observations
    rate_m_s = -SPEED_OF_LIGHT_M_S / L1_HZ * o.doppler_hz
    step_m = np.diff(o.pseudorange_m, axis=0) - 0.5 * np.diff(o.elapsed_s)[:, None] * (rate_m_s[1:] + rate_m_s[:-1])
    assert np.nanmax(np.abs(np.nanmedian(step_m, axis=1))) < 40.0  # the phone's own biases step by 300 m
    assert np.abs(np.diff(np.nanmedian(rate_m_s - np.nanmedian(rate_m_s, axis=0), axis=1))).max() < 60.0


def test_a_log_is_known_by_its_header() -> None:
    assert is_gnsslogger(HEADER.encode())
    assert is_gnsslogger(b"#   Raw,ElapsedRealtimeMillis,TimeNanos,LeapSecond,TimeUncertaintyNanos,FullBiasNanos\r\n")
    assert not is_gnsslogger(b"Raw,1,2,3\n# Fix,Provider,Latitude\n")
    assert kind_of_log(HEADER.encode()).multipath_sigma_m == 15.0
    assert kind_of_log(b"\x00" * 1000) is None


SYSTEMS = [
    (1, 5, 1575.42e6, "C", "G05", "L1", "CA", 0, WEEK_NS, FULL),
    (1, 5, 1176.45e6, "Q", "G05", "L5", "Q", 0, WEEK_NS, FULL),
    (1, 5, 1176.45e6, "", "G05", "L5", "Q", 0, WEEK_NS, FULL),
    (1, 5, None, "C", "G05", "L1", "CA", 0, WEEK_NS, FULL),
    (3, 7, 1605.375e6, "C", "R07", "G1", "CA", (3 * 3600 - 18) * 10**9, DAY_NS, 1 << 0 | 1 << 7),
    (4, 194, 1575.42e6, "C", "J02", "L1", "CA", 0, WEEK_NS, FULL),
    (5, 30, 1561.098e6, "I", "C30", "B1", "2I", -14 * 10**9, WEEK_NS, FULL),
    (5, 30, 1176.45e6, "P", "C30", "B2a", "5P", -14 * 10**9, WEEK_NS, FULL),
    (5, 30, None, "", "C30", "B1", "2I", -14 * 10**9, WEEK_NS, FULL),
    (6, 11, 1575.42e6, "C", "E11", "E1", "C", 0, WEEK_NS, 1 << 10 | 1 << 14),
    (6, 11, 1176.45e6, "Q", "E11", "E5a", "Q", 0, WEEK_NS, FULL),
    (6, 11, 1575.42e6, "C", "E11", "E1", "C", 0, 10**8, 1 << 10 | 1 << 11),
    (2, 131, 1575.42e6, "C", "S31", "L1", "CA", 0, WEEK_NS, FULL),
]


@pytest.mark.parametrize("case", SYSTEMS, ids=lambda case: f"{case[4]}-{case[2]}-{case[3]}")
@pytest.mark.parametrize("second", [0.0, 200_123.4, 604_799.99])
def test_every_system_gives_the_time_of_travel(case, second) -> None:
    constellation, svid, carrier_hz, code, sat, band, name, ahead_ns, modulus_ns, state = case
    row = Measured(
        svid=svid, constellation=constellation, carrier_hz=carrier_hz, code=code, ahead_ns=ahead_ns,
        modulus_ns=modulus_ns, state=state, travel_ns=71_234_567,
    )  # fmt: skip
    o = make_observations(row.at(second))
    assert o.signals == (SignalId(sat, band, name),)
    assert o.pseudorange_m[0, 0] == pytest.approx(71_234_567 * M_NS, abs=1e-6)
    assert find_since_epoch_ns(o)[0] == row.at(second).shown_ns
    if sat == "R07":
        assert o.carrier_hz[0] == carrier_hz


@pytest.mark.parametrize("second", [10_790.0, 10_810.0, 86_389.0, 604_790.0])
def test_days_and_weeks_turn_between_sending_and_receiving(second) -> None:
    start = Measured(full_bias_ns=-2300 * WEEK_NS, time_ns=0)
    rows = [
        replace(
            start, constellation=3, svid=7, ahead_ns=(3 * 3600 - 18) * 10**9, modulus_ns=DAY_NS, state=1 | 1 << 15,
            carrier_hz=1602e6,
        ),
        replace(start, constellation=5, svid=30, ahead_ns=-14 * 10**9, carrier_hz=1561.098e6, code="I"),
        start,
    ]  # fmt: skip
    moments = np.arange(0.01, 20.0, 0.05)
    o = make_observations(*(row.at(second + t) for t in moments for row in rows))
    assert o.pseudorange_m.shape == (moments.size, 3)
    assert np.ptp(o.pseudorange_m) < 1e-6


@pytest.mark.parametrize(
    ("state", "ranged"),
    [
        (0, False),
        (1 << 3, False),  # no lock
        (1 << 0 | 1 << 1 | 1 << 2, False),  # no time of week
        (1 << 0 | 1 << 3 | 1 << 4, False),  # milliseconds ambiguous
        (1 << 0 | 1 << 14, True),
        (1 << 0 | 1 << 3, True),
        (1 << 0 | 1 << 7, False),  # GLONASS's time of day is no time of week
    ],
)
def test_only_full_ranges_are_ranges(state, ranged) -> None:
    o = make_observations(Measured(state=state), Measured(svid=7))
    columns = {signal.sat: k for k, signal in enumerate(o.signals)}
    assert ("G05" in columns and np.isfinite(o.pseudorange_m[0, columns["G05"]])) == ranged
    if "G05" in columns and state & 1:
        assert o.doppler_hz[0, columns["G05"]] == pytest.approx(321.5 * L1_HZ / SPEED_OF_LIGHT_M_S)


def test_columns_are_found_by_name() -> None:
    names = [*reversed(COLUMNS), "AngleZ", "CarrierFrequencyHz"]
    names.remove("BiasNanos")
    names.remove("HardwareClockDiscontinuityCount")
    row = Measured(adr_state=1 | 8, adr_m=-1234.5)
    header = f"# Raw,{','.join(names)}\r\n"
    swapped = read(make_raw_line(row, names).replace("\n", "\r\n"), header=header).observations
    usual = make_observations(row)
    for name in ("gpst", "pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz", "pseudorange_sigma_m"):
        np.testing.assert_array_equal(getattr(swapped, name), getattr(usual, name))


def test_a_bias_estimated_anew_does_not_move_ranges() -> None:
    rng = np.random.default_rng(3)
    row, rows = Measured(rate_m_s=0.0), []
    for k in range(30):
        # What the clock truly shows goes on; only the phone's estimate of its bias wanders, by 300 ns.
        bias_ns = int(rng.normal(0.0, 300.0)) if k else 0
        rows.append(row.at(k, full_bias_ns=FULL_BIAS_NS + bias_ns, travel_ns=75_000_000 - bias_ns))
    o = make_observations(*rows)
    assert np.ptp(o.pseudorange_m) < 1e-6
    assert np.diff(find_since_epoch_ns(o)).tolist() == [10**9] * 29


def test_a_clock_that_runs_away_is_set_by_whole_milliseconds() -> None:
    row = Measured(rate_m_s=0.0)
    drift_ns = 400_000  # a second
    rows = [row.at(k, full_bias_ns=FULL_BIAS_NS + k * drift_ns, travel_ns=75_000_000) for k in range(10)]
    o = make_observations(*rows)
    steps_m = np.diff(o.pseudorange_m[:, 0])
    whole = np.rint((steps_m / M_NS - drift_ns) / 1e6)
    assert np.abs(steps_m / M_NS - drift_ns - 1e6 * whole).max() < 1e-3
    assert set(whole.tolist()) == {0.0, -1.0}
    assert np.abs(find_since_epoch_ns(o) - [r.shown_ns for r in rows]).max() <= 1_000_000


def make_sky(second: float, sats: int = 6, **given: object) -> list[Measured]:
    """Return rows of satellites whose ranges change steadily, by a clock that is right."""
    rows = []
    for k in range(sats):
        rate_m_s = -600.0 + 220.0 * k
        travel_ns = round(70_000_000 + 2_000_000 * k + rate_m_s * second / M_NS)
        rows.append(Measured(svid=k + 1, travel_ns=travel_ns, rate_m_s=rate_m_s).at(second, **given))
    return rows


def stop_clock(second: float, number: int, error_ns: int, drift_m_s: float) -> list[Measured]:
    """Return the sky after a stop of the clock, whose bias and rate the phone knows only roughly."""
    rows = make_sky(second, breaks=number, full_bias_ns=FULL_BIAS_NS + error_ns)
    return [replace(r, travel_ns=r.travel_ns - error_ns, rate_m_s=r.rate_m_s + drift_m_s) for r in rows]


def test_ranges_are_joined_where_the_clock_stops() -> None:
    rng = np.random.default_rng(11)
    rows = make_sky(0.0) + make_sky(1.0)
    for k in range(2, 40):
        rows += stop_clock(k + 0.3 * (k % 3), k, int(rng.normal(0.0, 4000.0)), float(rng.normal(0.0, 20.0)))
    piece = read(*map(make_raw_line, rows))
    o = piece.observations
    expected_m_s = -600.0 + 220.0 * np.arange(6)
    fitted = np.polynomial.polynomial.polyfit(o.elapsed_s, o.pseudorange_m, 1)
    assert fitted[1] == pytest.approx(expected_m_s, abs=0.05)
    off_m = o.pseudorange_m - fitted[0] - o.elapsed_s[:, None] * fitted[1]
    assert np.abs(off_m).max() < 1.0  # 4 us are 1200 m
    assert -o.doppler_hz / L1_HZ * SPEED_OF_LIGHT_M_S == pytest.approx(np.tile(expected_m_s, (40, 1)), abs=0.2)
    assert any("developer options" in remark for remark in piece.remarks)


def test_one_satellite_that_jumps_stays_so_where_the_clock_stops() -> None:
    rows = make_sky(0.0) + make_sky(1.0)
    late = stop_clock(2.0, 1, 2500, 0.0)
    late[3] = replace(late[3], travel_ns=late[3].travel_ns + 1000)
    o = make_observations(*rows, *late)
    beyond_m = o.pseudorange_m[2] - 2.0 * o.pseudorange_m[1] + o.pseudorange_m[0]
    assert beyond_m == pytest.approx([0.0, 0.0, 0.0, 1000 * M_NS, 0.0, 0.0], abs=0.7)


def test_a_stop_of_minutes_takes_the_phones_own_bias() -> None:
    o = make_observations(*make_sky(0.0), *stop_clock(700.0, 1, 2500, 0.0))
    assert find_since_epoch_ns(o)[1] == stop_clock(700.0, 1, 2500, 0.0)[0].shown_ns


def test_carriers_are_those_whose_state_is_valid() -> None:
    states = [0, 1 | 8, 1 | 8, 1 | 2 | 8, 1 | 4 | 8, 1, 1 | 16, 1 | 8 | 16]
    rows = [Measured(adr_state=state, adr_m=100.0 * k).at(k) for k, state in enumerate(states)]
    o = make_observations(*rows)
    cycles = 100.0 * np.arange(8) * L1_HZ / SPEED_OF_LIGHT_M_S
    assert np.isnan(o.carrier_cyc[0, 0])
    assert o.carrier_cyc[1:, 0] == pytest.approx(cycles[1:])
    assert o.slipped[:, 0].tolist() == [False, False, False, True, True, True, False, True]
    assert o.half_cycle_open[:, 0].tolist() == [False, False, False, False, False, True, True, False]


def test_no_carrier_goes_on_over_a_stop_of_the_clock() -> None:
    arguments = {"adr_state": 9, "adr_m": 5.0}
    o = make_observations(
        *make_sky(0.0, **arguments),
        *make_sky(1.0, **arguments),
        *make_sky(2.0, breaks=1, **arguments),
        *make_sky(3.0, breaks=1, **arguments),
    )
    assert o.slipped.all(axis=1).tolist() == [False, False, True, False]
    assert not o.slipped[[0, 1, 3]].any()


def test_measurements_beside_the_epoch_are_moved_to_it() -> None:
    at_epoch = make_observations(Measured(rate_m_s=500.0))
    later = Measured(rate_m_s=500.0, offset_ns=2e6)
    later = replace(later, travel_ns=later.travel_ns + round(500.0 * 2e-3 / M_NS) - 2_000_000)
    # The row's own time of transmission belongs to a moment 2 ms later: sent_ns grows by 2 ms less the range's growth.
    assert make_observations(later).pseudorange_m[0, 0] == pytest.approx(at_epoch.pseudorange_m[0, 0], abs=0.3)


def test_epochs_before_the_time_is_known_are_left_out() -> None:
    unknown = make_raw_line(Measured()).replace(str(FULL_BIAS_NS), "")
    piece = read(unknown, unknown, make_raw_line(Measured().at(1.0)))
    assert piece.observations.gpst.size == 1
    assert any(remark.startswith("1 epochs before") for remark in piece.remarks)


def test_damaged_lines_cost_themselves() -> None:
    good = make_raw_line(Measured())
    damaged = good.replace("Raw", "Rxw"), good[:40] + "\n", "\x00\xff,,,\n"
    later = make_raw_line(Measured().at(1.0))
    piece = read(good, *damaged, later)
    assert piece.damaged_frames == 3
    assert piece.observations.gpst.size == 2
    assert read(good, later[:-30]).cut


NAMES = ("Provider", "Latitude", "Longitude", "Altitude", "Speed", "Accuracy", "(UTC)TimeInMs")


def test_fixes_are_those_of_the_receiver() -> None:
    new = "Fix,{},47.5,8.5,412.25,0.5,3.5,90.0,1700000000500,,,1,5.5,0\n"
    fixes = read(new.format("GPS"), new.format("NLP"), new.format("FLP")).fixes
    old = f"# Fix,{','.join(NAMES)}\n" + HEADER.partition("# \n# Fix")[0]
    older = read("Fix,gps,47.5,8.5,412.25,0.5,3.5,1700000000500\n", header=old).fixes
    for found in (fixes, older):
        assert found.gpst.astype(str).tolist() == ["2023-11-14T22:13:38.500000000"]
        lat, lon, height = geodetic_from_ecef(found.position_ecef_m[0])
        assert np.degrees([lat, lon]) == pytest.approx([47.5, 8.5])
        assert height == pytest.approx(412.25, abs=1e-6)
        assert found.horizontal_sigma_m.tolist() == [3.5]
    assert fixes.vertical_sigma_m.tolist() == [5.5]


def test_levels_stand_once_a_band() -> None:
    l1, l5 = Measured(agc_db=12.5), Measured(agc_db=30.25, carrier_hz=1176.45e6, code="Q")
    beside = read(
        make_raw_line(l1), make_raw_line(replace(l1, svid=7)), make_raw_line(l5), make_raw_line(l1.at(1.0))
    ).levels
    assert list(zip(beside.band.tolist(), beside.agc_db.tolist(), strict=True)) == [
        ("L1", 12.5), ("L5", 30.25), ("L1", 12.5),
    ]  # fmt: skip
    row = "Agc,1,{},,,{},0.0,1.0,,,52,{},{},{}\n"
    own = [(10**12, 19.5, 1_176_450_000, 1), (10**12, -49.75, 1_602_000_000, 3)]
    rows = [row.format(time_ns, FULL_BIAS_NS, gain, hertz, system) for time_ns, gain, hertz, system in own]
    levels = read(make_raw_line(replace(l1, agc_db=None)), *rows).levels
    assert list(zip(levels.band.tolist(), levels.agc_db.tolist(), strict=True)) == [("L5", 19.5), ("G1", -49.75)]
    assert (levels.gpst - GPS_EPOCH).astype(np.int64).tolist() == [10**12 - FULL_BIAS_NS] * 2


@pytest.mark.parametrize("form", ["sent", "inverted", "source"])
def test_lnav_rows_give_the_frames_that_were_encoded(form) -> None:
    sent = make_nominal_constellation(np.datetime64("2022-01-01T20:00:00", "ns")).ephemerides[4]
    words = encode_subframes(sent, None, None, 30_000, sent.week, 5).reshape(5, 10, 30).astype(np.uint8)
    source = check_words(words.reshape(5, 300).astype(np.int8))[0].astype(np.uint8)
    given = words ^ 1 if form == "inverted" else words.copy()
    if form == "source":
        given[:, :, :24] = source
    octets = np.packbits(np.pad(given, ((0, 0), (0, 0), (2, 0))), axis=-1).reshape(5, 40)
    rows = [f"Nav,5,257,1,0,{k + 1},{sign_bytes(octets[k])}\n" for k in range(5)]
    wrong = octets[0].copy()
    wrong[7] ^= 4
    (frames,) = read(
        make_raw_line(Measured()), *rows, f"Nav,5,257,1,0,1,{sign_bytes(wrong)}\n", "Nav,5,257,1,0,1,3,4\n"
    ).frames
    assert (frames.kind, set(frames.sat.tolist()), set(frames.band.tolist())) == ("LNAV", {"G05"}, {"L1"})
    np.testing.assert_array_equal(np.unpackbits(frames.bits, axis=1), source.reshape(5, 240))
    assert (frames.gpst == make_observations(Measured()).gpst[0]).all()


def test_galileo_and_glonass_rows_are_put_into_their_frames() -> None:
    rng = np.random.default_rng(2)
    pages = {1537: 228, 1538: 238, 769: 85}
    bits = {kind: rng.integers(0, 2, n, np.uint8) for kind, n in pages.items()}
    rows = [f"Nav,7,{kind},1,-1,1,{sign_bytes(np.packbits(b))}\n" for kind, b in bits.items()]
    unchecked = rows[0].replace(",1,-1", ",0,-1")
    found = {f.kind: np.unpackbits(f.bits, axis=1) for f in read(make_raw_line(Measured()), *rows, unchecked).frames}
    even, odd = bits[1537][:114], bits[1537][114:]
    assert found["INAV"].tolist() == [[*even, *[0] * 6, *odd, *[0] * 6]]
    assert found["FNAV"][0, :244].tolist() == [*bits[1538], *[0] * 6]
    assert found["GLONASS"][0, :85].tolist() == bits[769].tolist()


def test_frames_before_any_time_are_left_out() -> None:
    assert read("Nav,7,769,1,-1,14,116,5,-126,11,42,-69,104,85,-17,63,-96\n", make_raw_line(Measured())).frames == ()


def test_blocks_of_any_size_give_the_same(monkeypatch) -> None:
    rng = np.random.default_rng(1)
    rows = [m for k in range(60) for m in stop_clock(float(k), k // 3, int(rng.normal(0, 4e3)), 2.0)]
    nav = "Nav,7,769,1,-1,14,116,5,-126,11,42,-69,104,85,-17,63,-96\n"
    text = (HEADER + "".join(make_raw_line(m) + (nav if m.svid == 6 else "") for m in rows)).encode()
    (whole,) = read_gnsslogger([text], "phone")
    monkeypatch.setattr("skyproof.logs.text._STRETCH_BYTES", 5000)
    pieces = list(read_gnsslogger([text[k : k + 777] for k in range(0, len(text), 777)], "phone"))
    assert len(pieces) > 5
    joined = Observations.join([p.observations for p in pieces if p.observations is not None])
    for name in ("gpst", "pseudorange_m", "doppler_hz", "status"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole.observations, name))
    frames = [f for p in pieces for f in p.frames]
    np.testing.assert_array_equal(np.concatenate([f.gpst for f in frames]), whole.frames[0].gpst)
    assert sum(p.messages.get("GnssLogger Raw", 0) for p in pieces) == 360


def test_a_stream_of_frames_is_none_of_them() -> None:
    (piece,) = read_log([(HEADER + make_raw_line(Measured())).encode()], "rx")
    assert piece.observations is None
