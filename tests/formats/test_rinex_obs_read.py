"""Observation files of many writers, small ones with every oddity, and damage of every kind."""

import gzip
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.errors import InputError
from skyproof.formats.crinex import expand
from skyproof.formats.rinex_obs import write_obs
from skyproof.formats.rinex_obs_read import parse_obs, read_obs
from skyproof.records import Observations, SignalId
from skyproof.remarks import Remark, RemarkKind


def make_line(text, label):
    return f"{text:60}{label}"


HEADER_2 = [
    make_line("     2.11           OBSERVATION DATA    M (MIXED)", "RINEX VERSION / TYPE"),
    make_line("KOSG", "MARKER NAME"),
    make_line("R117                ROGUE SNR-8         Meenix 7.8", "REC # / TYPE / VERS"),
    make_line("119                 AOAD/M_B", "ANT # / TYPE"),
    make_line("  3899242.6490   396728.6934  5015081.6508", "APPROX POSITION XYZ"),
    make_line("        0.1050        0.0000        0.0010", "ANTENNA: DELTA H/E/N"),
    make_line("     6    C1    P1    L1    L2    S1    D1", "# / TYPES OF OBSERV"),
    make_line("    30.0000", "INTERVAL"),
    make_line("  2005     4     2     0     0    0.0000000     GPS", "TIME OF FIRST OBS"),
    make_line("    13", "LEAP SECONDS"),
    make_line("", "END OF HEADER"),
]
HEADER_3 = [
    make_line("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
    make_line("SEPT", "MARKER NAME"),
    make_line("G    4 C1C L1C D1C S1C", "SYS / # / OBS TYPES"),
    make_line("C    2 C2I L2I", "SYS / # / OBS TYPES"),
    make_line("R    2 C1C L1C", "SYS / # / OBS TYPES"),
    make_line("  2024    10    27    15    47   37.0000000     GPS", "TIME OF FIRST OBS"),
    make_line(" 2 R01  1 R02 -4", "GLONASS SLOT / FRQ #"),
    make_line("", "END OF HEADER"),
]


def write_cell(value=None, lli=" ", strength=" "):
    return " " * 16 if value is None else f"{value:14.3f}{lli}{strength}"


def write_record_2(k, lli=" "):
    """Write C1 P1 L1 L2 S1, and D1 on the second line."""
    return [
        write_cell(2e7 + k) + write_cell() + write_cell(1e8 + k, lli, "7") + write_cell(8e7 + k) + write_cell(45.25),
        write_cell(-1234.5).rstrip(),
    ]


def write_epoch_2(second, names, flag=0):
    rows = [names[k : k + 12] for k in range(0, len(names), 12)]
    head = f" 05  4  2  0  0{second:11.7f}  {flag}{len(names):3d}"
    return [head + "".join(rows[0]), *(" " * 32 + "".join(row) for row in rows[1:])]


def write_epoch_3(second, lines, flag=0):
    return [f"> 2024 10 27 15 47{second:11.7f}  {flag}{len(lines):3d}", *lines]


def write_sat_3(name, k=0.0, lli=" "):
    if name[0] == "G":
        return name + write_cell(2e7 + k) + write_cell(1e8 + k, lli) + write_cell(-100.0) + write_cell(44.0).rstrip()
    return name + write_cell(2e7 + k) + write_cell(1e8 + k, lli).rstrip()


def parse_lines(lines, **options):
    return parse_obs("\n".join(lines).encode() + b"\n", **options)


def find_column(observations, sat, band="L1", code="CA"):
    return observations.signals.index(SignalId(sat, band, code))


# --- small files with every oddity


def test_version_2_is_read_with_blanks_events_and_odd_clocks():
    body = [
        *write_epoch_2(0.0, ["G 3", "G12", "R 5"]),
        *write_record_2(1.0),
        *write_record_2(2.0),
        *write_record_2(3.0),
        "                            4  2",
        make_line("RINEX FILE SPLICE", "COMMENT"),
        make_line("x", "COMMENT"),
        *write_epoch_2(29.996, ["G 3", "G12"]),
        *write_record_2(4.0, "1"),
        *write_record_2(5.0),
        *write_epoch_2(59.999, ["G 3"], flag=1),
        *write_record_2(6.0),
    ]
    file = parse_lines([*HEADER_2, *body])
    seen = file.observations
    assert (file.marker, file.receiver, file.antenna) == ("KOSG", "ROGUE SNR-8", "AOAD/M_B")
    assert (file.interval_s, file.time_system, file.leap_seconds) == (30.0, "GPS", 13)
    np.testing.assert_array_equal(file.position_ecef_m, [3899242.649, 396728.6934, 5015081.6508])
    np.testing.assert_array_equal(file.antenna_delta_hen_m, [0.105, 0.0, 0.001])
    assert [str(t) for t in seen.gpst] == [
        "2005-04-02T00:00:00.000000000",
        "2005-04-02T00:00:29.996000000",
        "2005-04-02T00:00:59.999000000",
    ]
    g3 = find_column(seen, "G03")
    np.testing.assert_array_equal(seen.pseudorange_m[:, g3], [2e7 + 1, 2e7 + 4, 2e7 + 6])
    np.testing.assert_array_equal(seen.status[:, g3], [0, 3, 3])  # loss of lock, power failure
    np.testing.assert_array_equal(seen.status[:, find_column(seen, "G12")], [0, 0, 1])
    np.testing.assert_array_equal(seen.doppler_hz[0, g3], -1234.5)
    np.testing.assert_array_equal(seen.cn0_dbhz[0, g3], 45.25)
    assert find_column(seen, "R05", "G1") >= 0
    assert any("events" in remark for remark in file.remarks)
    assert np.isnan(seen.carrier_hz[find_column(seen, "R05", "G1")])


def test_an_open_half_cycle_is_marked_and_its_change_slips():
    marks = "0", "2", "3", "2", "0"
    body = [row for k, mark in enumerate(marks) for row in write_epoch_3(37.0 + k, [write_sat_3("G05", lli=mark)])]
    seen = parse_lines([*HEADER_3, *body]).observations
    at = find_column(seen, "G05")
    np.testing.assert_array_equal(seen.half_cycle_open[:, at], [False, True, True, True, False])
    np.testing.assert_array_equal(seen.status[:, at], [0, 3, 3, 0, 3])


def test_more_than_twelve_satellites_continue_on_the_next_line():
    names = [f"G{n:02d}" for n in range(1, 28)]
    body = [*write_epoch_2(0.0, names), *(text for k in range(27) for text in write_record_2(float(k)))]
    seen = parse_lines([*HEADER_2, *body]).observations
    l1 = [find_column(seen, name) for name in names]
    np.testing.assert_array_equal(seen.pseudorange_m[0, l1], 2e7 + np.arange(27))


def test_slips_in_an_event_record_are_reported():
    slips = [*write_epoch_2(30.0, ["G 3"], flag=6), *write_record_2(1.0)]
    body = [
        *write_epoch_2(0.0, ["G 3"]),
        *write_record_2(0.0),
        *slips,
        *write_epoch_2(30.0, ["G 3"]),
        *write_record_2(1.0),
    ]
    seen = parse_lines([*HEADER_2, *body]).observations
    np.testing.assert_array_equal(seen.status[:, find_column(seen, "G03")], [0, 3])


def test_new_types_inside_the_data_hold_from_there_on():
    new = make_line("G    2 L1C C1C", "SYS / # / OBS TYPES")
    swapped = "G05" + write_cell(1e8) + write_cell(2.1e7)
    body = [
        *write_epoch_3(37.0, [write_sat_3("G05")]),
        ">                              4  1",
        new,
        *write_epoch_3(38.0, [swapped]),
    ]
    seen = parse_lines([*HEADER_3, *body]).observations
    np.testing.assert_array_equal(seen.pseudorange_m[:, find_column(seen, "G05")], [2e7, 2.1e7])
    np.testing.assert_array_equal(seen.carrier_cyc[:, find_column(seen, "G05")], [1e8, 1e8])


def test_a_file_that_begins_with_an_event_is_read():
    body = [
        "> 2024 10 27 15 47 36.4427602  2  0",
        *write_epoch_3(37.9774381, [write_sat_3("G10"), write_sat_3("C 6"), write_sat_3("R02")]),
    ]
    file = parse_lines([*HEADER_3, *body])
    assert file.position_ecef_m is None
    assert str(file.observations.gpst[0]) == "2024-10-27T15:47:37.977438100"
    carriers = dict(zip((s.sat for s in file.observations.signals), file.observations.carrier_hz, strict=True))
    assert carriers == {"G10": 1575.42e6, "C06": 1561.098e6, "R02": 1602e6 - 4 * 0.5625e6}


@pytest.mark.parametrize(("system", "shift_s"), [("GPS", 0), ("GAL", 0), ("BDT", 14), ("GLO", 18)])
def test_every_time_system_becomes_gps_time(system, shift_s):
    header = [text.replace("     GPS", f"     {system}") for text in HEADER_3]
    seen = parse_lines([*header, *write_epoch_3(37.0, [write_sat_3("G05")])]).observations
    assert seen.gpst[0] == np.datetime64("2024-10-27T15:47:37", "ns") + np.timedelta64(shift_s, "s")


def test_only_what_is_kept_is_there():
    body = write_epoch_3(37.0, [write_sat_3("G05"), write_sat_3("C06")])
    seen = parse_lines([*HEADER_3, *body], keep=lambda signal: signal.sat[0] == "C").observations
    assert seen.signals == (SignalId("C06", "B1", "2I"),)


def test_a_zero_is_no_measurement_and_odd_spellings_are_numbers():
    odd = "G05" + f"{'0.000':>14}  " + f"{'12345.67':>14}  " + f"{'-.500':>14}  " + f"{'44':>14}"
    seen = parse_lines([*HEADER_3, *write_epoch_3(37.0, [odd])]).observations
    assert np.isnan(seen.pseudorange_m[0, 0])
    assert (seen.carrier_cyc[0, 0], seen.doppler_hz[0, 0], seen.cn0_dbhz[0, 0]) == (12345.67, -0.5, 44.0)


# --- headers that do not say what stands below them


def make_second_header(changes, header=HEADER_3):
    """Make a header with lines changed: label to text."""
    return [make_line(changes.get(text[60:], text[:60]), text[60:]) for text in header]


SWAPPED = "G05" + write_cell(1e8) + write_cell(2.1e7)


def test_a_header_inside_the_data_holds_from_there_on():
    other = [text for text in HEADER_3 if "OBS TYPES" not in text]
    other.insert(2, make_line("G    2 L1C C1C", "SYS / # / OBS TYPES"))
    seen = parse_lines(
        [
            *HEADER_3,
            *write_epoch_3(37.0, [write_sat_3("G05"), write_sat_3("C06")]),
            *other,
            *write_epoch_3(38.0, [SWAPPED, write_sat_3("C06")]),
        ]
    )
    o = seen.observations
    np.testing.assert_array_equal(o.pseudorange_m[:, find_column(o, "G05")], [2e7, 2.1e7])
    np.testing.assert_array_equal(o.carrier_cyc[:, find_column(o, "G05")], [1e8, 1e8])
    np.testing.assert_array_equal(np.isfinite(o.pseudorange_m[:, find_column(o, "C06", "B1", "2I")]), [True, False])
    assert sum(remark.startswith("line 12: a header") for remark in seen.remarks) == 1


def test_a_header_of_version_2_inside_the_data_holds_too():
    other = make_second_header({"# / TYPES OF OBSERV": "     2    P1    C1"}, HEADER_2)
    cut = [*write_epoch_2(1.0, ["G 3", "G12"]), *write_record_2(1.0)]  # where the first file ends early
    body = [
        *write_epoch_2(0.0, ["G 3"]),
        *write_record_2(0.0),
        *cut,
        *other,
        *write_epoch_2(2.0, ["G 3"]),
        write_cell(2.3e7) + write_cell(2.2e7),
    ]
    o = parse_lines([*HEADER_2, *body]).observations
    np.testing.assert_array_equal(o.pseudorange_m[:, find_column(o, "G03")], [2e7, 2.2e7])
    assert o.pseudorange_m[1, find_column(o, "G03", "L1", "W")] == 2.3e7


@pytest.mark.parametrize(
    "changes",
    [
        {"RINEX VERSION / TYPE": "     2.11           OBSERVATION DATA    M"},
        {"MARKER NAME": "OTHER"},
        {"TIME OF FIRST OBS": "  2024    10    27    15    47   37.0000000     BDT"},
        {"SYS / # / OBS TYPES": " "},
    ],
)
def test_what_follows_a_header_of_another_file_is_left_out(changes):
    other = make_second_header(changes)
    body = [
        *write_epoch_3(37.0, [write_sat_3("G05")]),
        *other,
        *write_epoch_3(38.0, [SWAPPED]),
        *HEADER_3,
        *write_epoch_3(39.0, [write_sat_3("G05")]),
    ]
    file = parse_lines([*HEADER_3, *body])
    np.testing.assert_array_equal(file.observations.elapsed_s, [0.0, 2.0])
    np.testing.assert_array_equal(file.observations.pseudorange_m, [[2e7], [2e7]])
    assert any("follows" in remark for remark in file.remarks)


def test_comments_between_satellites_change_nothing():
    body = write_epoch_3(37.0, [write_sat_3("G05"), write_sat_3("G06")])
    body.insert(2, make_line("a remark", "COMMENT"))
    file = parse_lines([*HEADER_3, *body])
    assert np.isfinite(file.observations.pseudorange_m).sum() == 2
    assert file.remarks == ()


@pytest.mark.parametrize("count", [3, 5])
def test_a_count_of_types_that_is_off_costs_nothing_and_is_said(count):
    header = [text.replace("G    4", f"G    {count}") for text in HEADER_3]
    file = parse_lines([*header, *write_epoch_3(37.0, [write_sat_3("G05")])])
    assert file.observations.cn0_dbhz[0, 0] == 44.0
    assert any(re.search(rf"\b{count} \w+ types of G .*\b4\b", remark) for remark in file.remarks)


@pytest.mark.parametrize("count", [5, 7])
def test_a_count_of_version_2_that_is_off_costs_nothing(count):
    header = [text.replace("     6    C1", f"     {count}    C1") for text in HEADER_2]
    file = parse_lines([*header, *write_epoch_2(0.0, ["G 3", "G12"]), *write_record_2(1.0), *write_record_2(2.0)])
    at = [find_column(file.observations, sat) for sat in ("G03", "G12")]
    np.testing.assert_array_equal(file.observations.doppler_hz[0, at], [-1234.5, -1234.5])
    assert any(re.search(r"\btypes\b.* 6\b", remark) for remark in file.remarks)


def test_names_of_version_2_in_version_3_are_read_and_said():
    header = [text.replace("G    4 C1C L1C D1C S1C", "G    4 C1  L1  D1  S1 ") for text in HEADER_3]
    file = parse_lines([*header, *write_epoch_3(37.0, [write_sat_3("G05")])])
    o = file.observations
    at = find_column(o, "G05")
    assert (o.pseudorange_m[0, at], o.carrier_cyc[0, at], o.doppler_hz[0, at]) == (2e7, 1e8, -100.0)
    assert any("G C1 as C1C" in remark for remark in file.remarks)


@pytest.mark.parametrize("name", ["L2", "C9C", "Q1C", "CC"])
def test_names_without_one_meaning_are_left_out_and_said(name):
    header = [text.replace("G    4 C1C L1C", f"G    4 C1C {name:3}") for text in HEADER_3]
    file = parse_lines([*header, *write_epoch_3(37.0, [write_sat_3("G05")])])
    assert np.isnan(file.observations.carrier_cyc).all()
    assert any(remark.endswith(f": G {name}") for remark in file.remarks)


def test_types_that_are_no_signals_are_no_fault():
    header = [text.replace("G    4 C1C L1C", "G    4 X1  C1C") for text in HEADER_3]
    assert not parse_lines([*header, *write_epoch_3(37.0, ["G05" + write_cell(3.0) + write_cell(2e7)])]).remarks[:-1]


def test_impossible_cells_are_left_out_and_counted():
    body = [
        row for k in range(3) for row in write_epoch_3(37.0 + k, [write_sat_3("G05"), "G07" + write_cell(1.05e8 + k)])
    ]
    file = parse_lines([*HEADER_3, *body])
    assert [s.sat for s in file.observations.signals] == ["G05"]
    assert file.impossible == {"G C1C": 3}
    assert any(remark.startswith("3 cells ") for remark in file.remarks)


def test_compact_files_put_together_are_read_as_one(tmp_path):
    compact = "\n".join(
        [
            make_line("3.0                 COMPACT RINEX FORMAT", "CRINEX VERS   / TYPE"),
            make_line("RNX2CRX", "CRINEX PROG / DATE"),
            *HEADER_3,
            "> 2024 10 27 15 47 37.0000000  0  1      G05",
            "",
            "3&20000000000 3&1000000 3&-100000 3&44000",
            "",
        ]
    )
    other = compact.replace("C1C L1C", "L1C C1C").replace("47 37.", "47 38.").replace("3&200", "3&210")
    file = parse_obs((compact + other).encode())
    np.testing.assert_array_equal(file.observations.carrier_cyc[:, 0], [1000.0, 2.1e7])
    assert file.impossible == {"G C1C": 1}


# --- damage


def test_a_damaged_epoch_costs_that_epoch_and_is_reported():
    bodies = [[*write_epoch_2(float(t), ["G 3", "G12"]), *write_record_2(t), *write_record_2(t)] for t in range(5)]
    del bodies[2][3]
    file = parse_lines([*HEADER_2, *(text for body in bodies for text in body)])
    np.testing.assert_array_equal(file.observations.elapsed_s, [0.0, 1.0, 3.0, 4.0])
    assert any(remark.startswith("line 22: ") for remark in file.remarks)


def test_a_number_cut_by_the_end_of_the_file_is_not_taken():
    text = "\n".join(
        [*HEADER_3, *write_epoch_3(37.0, [write_sat_3("G05")]), *write_epoch_3(38.0, [write_sat_3("G05")])]
    )
    end = text.rindex("20000000.000") + 5
    seen = parse_obs(text[:end].encode()).observations
    assert seen.gpst.size == 2
    assert np.isnan(seen.pseudorange_m[1]).all()
    assert seen.pseudorange_m[0, 0] == 2e7


FILES = (
    [
        *HEADER_2,
        *(
            t
            for k in range(4)
            for t in (*write_epoch_2(float(k), ["G 3", "G12"]), *write_record_2(k), *write_record_2(k))
        ),
    ],
    [
        *HEADER_3,
        *(
            t
            for k in range(4)
            for t in write_epoch_3(40.0 + k, [write_sat_3("G05", k), write_sat_3("C06"), write_sat_3("R02")])
        ),
    ],
)


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_no_damage_ends_in_anything_but_data_or_a_message(data):
    text = bytearray("\n".join(data.draw(st.sampled_from(FILES))), "latin-1")
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, max(len(text) - 1, 0)))
        text[at : at + data.draw(st.integers(0, 90))] = data.draw(st.binary(max_size=4))
    try:
        file = parse_obs(bytes(text))
    except InputError:
        return
    assert (np.diff(file.observations.elapsed_s) > 0).all()


@pytest.mark.parametrize("which", [0, 1])
def test_an_epoch_that_the_file_ends_within_is_left_out(which):
    # Its other satellites were not lost.
    file = parse_obs("\n".join(FILES[which][:-1]).encode() + b"\n")
    assert file.observations.gpst.size == 3
    assert [Remark.kind_of(remark) for remark in file.remarks].count(RemarkKind.CUT) == 1


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 1), st.floats(0.0, 1.0))
def test_a_cut_costs_only_what_is_cut(which, share):
    whole = "\n".join(FILES[which]).encode() + b"\n"
    header = whole.index(b"END OF HEADER") + 20
    try:
        seen = parse_obs(whole[: header + round(share * (len(whole) - header))]).observations
    except InputError:
        return
    full = parse_obs(whole).observations
    at = [full.signals.index(signal) for signal in seen.signals]
    present = np.isfinite(seen.pseudorange_m)
    expected = full.pseudorange_m[: len(seen.gpst), at]
    np.testing.assert_array_equal(seen.pseudorange_m[present], expected[present])
    np.testing.assert_array_equal(present[:-1], np.isfinite(expected)[:-1])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "expected RINEX VERSION / TYPE"),
        ("\n".join(FILES[1]).replace("     3.04", "     5.04").encode(), "RINEX version '5.04'"),
        ("\n".join(FILES[1]).replace("OBSERVATION", "NAVIGATION ").encode(), "not observations"),
        ("\n".join(HEADER_3[:-1]).encode(), "before END OF HEADER"),
        ("\n".join(HEADER_3).encode(), r"no observation.*line 8\b"),
        ("\n".join([HEADER_3[0], HEADER_3[-1]]).encode(), "observation types"),
    ],
)
def test_what_is_no_observation_file_is_reported(content, words):
    with pytest.raises(InputError, match=words):
        parse_obs(content)


# --- there and back


def test_what_our_writer_writes_is_read_back(tmp_path):
    rng = np.random.default_rng(3)
    shape, ones = (20, 9), np.ones((20, 9))
    signals = tuple(SignalId(f"G{n:02d}") for n in range(1, 10))
    status = np.zeros(shape, np.uint8)
    half_open = np.zeros(shape, np.bool_)
    half_open[2:7, 5] = half_open[:4, 6] = True
    status[[7, 2, 7, 4], [3, 5, 5, 6]] = 3
    written = Observations(
        receiver="rx",
        signals=signals,
        elapsed_s=np.arange(20) * 0.5,
        gpst=np.datetime64("2022-01-01T21:46:00.25", "ns") + np.arange(20) * np.timedelta64(500, "ms"),
        pseudorange_m=rng.uniform(2e7, 2.6e7, shape),
        carrier_cyc=rng.uniform(-1e8, 1.4e8, shape),
        doppler_hz=rng.uniform(-5e3, 5e3, shape),
        cn0_dbhz=rng.uniform(20.0, 55.0, shape),
        status=status,
        pseudorange_sigma_m=ones,
        carrier_sigma_cyc=ones,
        doppler_sigma_hz=ones,
        found_elapsed_s=np.zeros(9),
        missed_elapsed_s=np.full(9, np.nan),
        half_cycle_open=half_open,
    )
    write_obs(tmp_path / "a.obs", written, signals=signals, holds="authentic", marker="rx", version="1")
    back = read_obs(tmp_path / "a.obs").observations
    assert back.signals == signals
    np.testing.assert_array_equal(back.gpst, written.gpst)
    np.testing.assert_array_equal(back.status, status)
    np.testing.assert_array_equal(back.half_cycle_open, half_open)
    for name in ("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz"):
        np.testing.assert_allclose(getattr(back, name), getattr(written, name), rtol=0, atol=5.01e-4, err_msg=name)
    (tmp_path / "a.obs.gz").write_bytes(gzip.compress((tmp_path / "a.obs").read_bytes()))
    np.testing.assert_array_equal(read_obs(tmp_path / "a.obs.gz").observations.pseudorange_m, back.pseudorange_m)


# --- real files

# Epochs, satellites in all, most at one epoch, by a plain count over the heads of the epochs (compact files expanded by
# RNXCMP); the same as the README of the recordings, but for KMS3, which holds 19 of the 120 epochs its header states.
REAL = {
    "rinex-variety/KOSG0010.95O": (3, 18, 8),
    "rinex-variety/aopr0010.17o": (3, 19, 11),
    "rinex-variety/barq071q.19o": (1, 15, 15),
    "rinex-variety/rovn0010.21o": (5, 34, 25),  # of six epochs the last is cut
    "rinex-variety/zegv0010.21o": (19, 24, 24),
    "rinex-variety/AJAC3550.21O": (2, 26, 26),
    "rinex-variety/DUTH0630.22O": (3, 20, 18),
    "rinex-variety/ACOR00ESP_R_20213550000_01D_30S_MO.rnx": (25, 38, 38),
    "rinex-variety/KMS300DNK_R_20221591000_01H_30S_MO.crx": (19, 51, 49),
    "rinex-variety/GEOP092I.24o.gz": (599, 36, 34),
    "rinex-variety/gps.23O.gz": (216, 6, 5),
    "rinex-variety/gnss_log_2024_10_27_11_47_14.24o": (113, 25, 22),
    "rinex-variety/gnss_log_2024_10_27_10_51_38.24o": (120, 25, 22),
    "rinex-mosaic-1m/base.obs": (301, 57, 57),
    "rinex-mosaic-1m/rover.obs": (301, 58, 57),
    "rinex-mosaic-5km/3034265G.21O": (360, 18, 18),
    "rinex-mosaic-5km/SEPT265G.21O": (360, 20, 20),
    "rinex-gsi-3km/07590920.05o": (120, 11, 9),
    "rinex-gsi-3km/30400920.05o": (120, 12, 10),
}


@pytest.mark.shared_data
@pytest.mark.parametrize("name", REAL)
def test_every_real_file_has_its_epochs_and_satellites(shared_data, name):
    seen = read_obs(shared_data / "real" / name).observations
    sats = sorted({signal.sat for signal in seen.signals})
    present = np.array([(seen.status[:, [s.sat == sat for s in seen.signals]] != 1).any(axis=1) for sat in sats])
    assert (seen.gpst.size, len(sats), int(present.sum(axis=0).max())) == REAL[name]
    assert (np.isfinite(seen.pseudorange_m) <= np.isfinite(seen.pseudorange_sigma_m)).all()


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("compact", "plain"),
    [
        ("AJAC3550.21D", "AJAC3550.21O"),
        ("DUTH0630.22D", "DUTH0630.22O"),
        ("zegv0010.21d", "zegv0010.21o"),
        ("ACOR00ESP_R_20213550000_01D_30S_MO.crx", "ACOR00ESP_R_20213550000_01D_30S_MO.rnx"),
    ],
)
def test_compact_files_hold_what_the_plain_ones_hold(shared_data, compact, plain):
    a, b = (read_obs(shared_data / "real" / "rinex-variety" / name).observations for name in (compact, plain))
    assert a.signals == b.signals
    for name in ("gpst", "pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz", "status"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.shared_data
@settings(max_examples=40, deadline=None)
@given(st.data())
def test_a_damaged_compact_file_ends_in_data_or_a_message(shared_data, data):
    text = bytearray((shared_data / "real" / "rinex-variety" / "AJAC3550.21D").read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(text) - 1))
        text[at : at + data.draw(st.integers(0, 60))] = data.draw(st.binary(max_size=3))
    try:
        parse_obs(bytes(text))
    except InputError:
        return


def test_compact_differences_of_every_order_are_summed():
    header = [
        make_line("3.0                 COMPACT RINEX FORMAT", "CRINEX VERS   / TYPE"),
        make_line("x", "CRINEX PROG / DATE"),
        *HEADER_3[:2],
        make_line("G    1 C1C", "SYS / # / OBS TYPES"),
        HEADER_3[5],
        HEADER_3[7],
    ]
    values = [20000000000, 20000000100, 20000000250, 20000000470, 20000000800]
    reported = ["3&20000000000", "100", "50", "20", "40", "3&20000000800"]
    body = ["> 2024 10 27 15 47 40.0000000  0  1      G05", "", reported[0]]
    for k, number in enumerate(reported[1:], start=1):
        body += [" " * 20 + f"{k}", "", number]
    plain, remarks = expand("\n".join([*header, *body, ""]).encode())
    assert remarks == ()
    lines = plain.decode().splitlines()
    numbers = [round(1e3 * float(text[3:17])) for text in lines if text.startswith("G05")]
    assert numbers == [*values, 20000000800]
