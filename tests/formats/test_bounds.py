"""Broken and hostile files: each costs what is damaged, or is refused in a sentence; none takes all memory or hours."""

import gzip
import json
import os
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from tests.formats.test_rinex_nav import GLONASS_RECORD, GPS_RECORD, VERSION_2, VERSION_3_HEADER
from tests.formats.test_rinex_obs_read import (
    HEADER_2,
    HEADER_3,
    make_line,
    parse_lines,
    write_cell,
    write_epoch_2,
    write_epoch_3,
    write_record_2,
    write_sat_3,
)
from tests.fuzz.readers import READERS

from skyproof.app.common.platform import read_platform
from skyproof.errors import InputError, ScenarioError, SettingsError, SkyproofError
from skyproof.formats import byte_io, crinex, rinex_obs_read, track
from skyproof.formats.bounds import CAPTURES, DEPTH, describe_first, require_toml_depth
from skyproof.formats.raw import read_sidecar
from skyproof.formats.rinex_nav import parse_nav, read_nav
from skyproof.formats.rinex_obs_read import parse_obs, read_obs
from skyproof.formats.sigmf_keys import parse_meta as parsed_meta
from skyproof.formats.track import parse_csv, parse_kml, parse_nmea
from skyproof.gnss.time import parse_iso
from skyproof.remarks import Remark
from skyproof.simulator.scenario import parse_scenario, read_scenario

TOML_READERS = (read_platform, read_scenario, read_sidecar)
FILES = [name for name in READERS if name not in ("bytes", "any", "archive")]
SCENE = {
    "start_gpst": "2024-05-14T10:00:00",
    "duration_s": 60.0,
    "receivers": [{"name": "a", "lat_deg": 1.0, "lon_deg": 2.0, "height_m": 3.0}],
}


DATE = date(2024, 5, 14)

# --- what a file is


@pytest.mark.parametrize("name", FILES)
def test_pipes_and_devices_are_refused(tmp_path: Path, name: str) -> None:
    reader = READERS[name]
    for beside, content in reader.beside:
        (tmp_path / beside).write_bytes(content)
    path = tmp_path / reader.name
    os.mkfifo(path)
    with pytest.raises(SkyproofError, match=r"\bpipe\b|regular file"):
        reader.read(path)
    path.unlink()
    path.symlink_to("/dev/zero")
    with pytest.raises(SkyproofError, match=r"\bpipe\b|regular file"):
        reader.read(path)


def test_a_name_with_a_zero_byte_is_refused() -> None:
    with pytest.raises(InputError, match=r"'a\\x00b': .*null byte"):
        read_nav("a\0b")


@pytest.mark.parametrize(("read", "mebibytes"), [(read_nav, 64), (read_obs, 256)])
def test_a_small_file_that_unpacks_to_a_large_one_is_refused(tmp_path: Path, read, mebibytes: int) -> None:
    path = tmp_path / "a.rnx.gz"
    path.write_bytes(gzip.compress(bytes(1 << 26), 1) * 5)  # 1.4 MB
    with pytest.raises(InputError, match=rf"unpacked.* {mebibytes} MiB"):
        read(path)


def test_a_file_that_is_larger_than_its_kind_ever_is_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # a hole: no byte is written
    for read in TOML_READERS:
        with pytest.raises(SkyproofError, match=r"\b1 MiB"):
            read(path)


# --- depth, numbers and counts in TOML and JSON


@pytest.mark.parametrize("read", TOML_READERS)
@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 20_000 + "]" * 20_000,
        "a = " + "{b = " * 20_000,
        "a." * 20_000 + "b = 1",
        f"[{'a.' * 20_000}b]",
        "[" * 20_000,
        '"x" . ' * 20_000 + "y = 1",
    ],
    ids=["lists", "tables", "dotted key", "dotted table", "open brackets", "quoted parts"],
)
def test_what_is_nested_too_deep_is_refused_at_once(tmp_path: Path, read, text: str) -> None:
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SkyproofError, match=rf"TOML: .*\d+ levels.* {DEPTH};"):
        read(tmp_path / "a.toml")


def test_brackets_in_strings_and_comments_do_not_count() -> None:
    many = "[{." * 100
    for text in (
        f'a = "{many}"',
        f"a = '{many}'",
        f'a = """\n{many}\\""" {many}"""',
        f"a = '''{many}'''",
        f"# {many}",
        "a = [" + "1.5, " * 1000 + "]",
        "\n".join("a.b = [[1]]" for _ in range(100)),
    ):
        require_toml_depth(text)


@pytest.mark.parametrize("read", TOML_READERS)
@pytest.mark.parametrize("number", ["9" * 5000, "0x" + "f" * 5000], ids=["decimal", "hexadecimal"])
def test_whole_numbers_of_thousands_of_digits_are_refused(tmp_path: Path, read, number: str) -> None:
    key = {read_platform: "[protect]\nwindow_s", read_scenario: "seed", read_sidecar: "[samples]\nheader_bytes"}
    (tmp_path / "a.toml").write_text(f"{key[read]} = {number}\n", encoding="utf-8")
    with pytest.raises(SkyproofError):
        read(tmp_path / "a.toml")


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, '{"global": ' + "9" * 5000 + "}"])
def test_deep_metadata_and_endless_numbers_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^a: .*JSON"):
        parsed_meta(text.encode(), "a")


def test_more_captures_than_any_recording_has_are_refused() -> None:
    text = json.dumps({"global": {}, "captures": [{}] * (CAPTURES + 1)})
    with pytest.raises(InputError, match=r"100001 captures.* 100000\b"):
        parsed_meta(text.encode(), "a")


def test_of_a_hundred_thousand_unknown_keys_a_few_are_named(tmp_path: Path) -> None:
    keys = "".join(f"key{number} = 1\n" for number in range(60_000))
    (tmp_path / "a.toml").write_text(f"[protect]\n{keys}", encoding="utf-8")
    with pytest.raises(SettingsError, match=r"\bkey0: .*\bkey9: .*\b59990 more$"):
        read_platform(tmp_path / "a.toml")
    with pytest.raises(ScenarioError, match=r"\bkey9: .*\b59990 more$"):
        parse_scenario(SCENE | {f"key{number}": 1 for number in range(60_000)})
    (tmp_path / "a.toml").write_text(f"[samples]\n{keys}", encoding="utf-8")
    with pytest.raises(InputError, match=r"; and \d+ more$") as raised:
        read_sidecar(tmp_path / "a.toml")
    assert len(str(raised.value)) < 4000


def test_long_keys_and_values_are_shortened_in_a_message(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f"[protect]\n{'k' * 100_000} = 1\nplace_deg = '{'v' * 100_000}'\n", "utf-8")
    with pytest.raises(SettingsError, match=r"protect\.k{49}\.\.\.: ") as raised:
        read_platform(tmp_path / "a.toml")
    assert 'place_deg = "vvv' in str(raised.value)
    assert len(str(raised.value)) < 1000


def test_the_middle_of_an_endless_message_is_left_out() -> None:
    assert str(InputError("a" + "b" * 10**6 + "c")) == f"a{'b' * 1499} ... {'b' * 1499}c"
    assert describe_first(range(12), str) == [*map(str, range(10)), "and 2 more"]


# --- instants


@pytest.mark.parametrize("text", ["2600-01-01", "9999-12-31T23:59:59.5", "1979-12-31", "2200-01-01T00:00:00.123456789"])
def test_years_that_would_wrap_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=rf"\b{text[:4]}\b.*\b1980\b.*\b2199\b"):
        parse_iso(text)


@pytest.mark.parametrize("value", ["1.5", "07:32:00", "[2024]", "2600-01-01T00:00:00", "true"])
def test_a_start_that_is_no_instant_is_refused(tmp_path: Path, value: str) -> None:
    (tmp_path / "a.toml").write_text(f"start_gpst = {value}\nduration_s = 1.0\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"start_gpst: "):
        read_scenario(tmp_path / "a.toml")


def test_a_date_is_an_instant_too(tmp_path: Path) -> None:
    assert parse_scenario(SCENE | {"start_gpst": DATE}).start_gpst == parse_iso("2024-05-14")


def test_a_date_where_a_text_is_expected_is_named() -> None:
    with pytest.raises(ScenarioError, match="name = 2024-05-14"):
        parse_scenario(SCENE | {"name": DATE})


# --- navigation


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("-9.821875000000E+01", "-9.82187500000E+999", "'-9.82187500000E+999'"),
        ("2024 06 24 10", "2600 06 24 10", "'2600 06 24 10 00 00'"),
        ("10 00 00-1.77", "10 00 99-1.77", "'2024 06 24 10 00 99'"),
    ],
)
def test_a_cell_that_cannot_be_costs_its_record(old: str, new: str, words: str) -> None:
    damaged = [text.replace(old, new) for text in GPS_RECORD]
    assert damaged != GPS_RECORD
    navigation = parse_nav([*VERSION_3_HEADER, *damaged, *GLONASS_RECORD])
    assert [e.sat for e in navigation.ephemerides] == ["R10"]
    assert any(words in remark for remark in navigation.remarks)


def test_a_header_line_with_an_absurd_number_is_left_out() -> None:
    header = [text.replace(" 1.8626E-08", " 1.86E+9999") for text in VERSION_3_HEADER]
    navigation = parse_nav([*header, *GPS_RECORD])
    assert navigation.ionosphere is None
    assert any(remark.startswith("line 3: IONOSPHERIC CORR") for remark in navigation.remarks)


def test_signs_that_only_look_like_digits_are_damage() -> None:
    navigation = parse_nav([*VERSION_2, "²² 22  1  1  0  0  0.0", *VERSION_2[7:15]])
    assert len(navigation.ephemerides) == 3


# --- observations


def test_an_epoch_in_2999_costs_itself() -> None:
    whole = [*write_epoch_3(37.0, [write_sat_3("G05")]), *write_epoch_3(38.0, [write_sat_3("G05", 1.0)])]
    late = [text.replace("> 2024", "> 2999") for text in write_epoch_3(37.5, [write_sat_3("G05", 2.0)])]
    file = parse_lines([*HEADER_3, *whole, *late])
    assert file.observations.gpst.size == 2
    assert any(remark.startswith("line 13: ") for remark in file.remarks)


@pytest.mark.parametrize("count", [" -9", "  ²", "1e9"])
@pytest.mark.parametrize("flag", [0, 4])
def test_a_count_that_is_none_costs_its_epoch(count: str, flag: int) -> None:
    good = [*write_epoch_2(0.0, ["G 3"]), *write_record_2(1.0)]
    bad = [text[:29] + count + text[32:] for text in write_epoch_2(1.0, ["G 3"], flag=flag)]
    file = parse_lines(
        [*HEADER_2, *good, *bad, *write_record_2(2.0), *write_epoch_2(2.0, ["G 3"]), *write_record_2(3.0)]
    )
    assert file.observations.gpst.size == 2
    assert any("whole epoch" in remark for remark in file.remarks)


def test_a_damaged_number_of_types_keeps_all_that_are_named() -> None:
    header = [text.replace("G    4 ", "G    x ") for text in HEADER_3]
    assert parse_lines([*header, *write_epoch_3(37.0, [write_sat_3("G05")])]).observations.cn0_dbhz[0, 0] == 44.0


@pytest.mark.parametrize(
    ("text", "label"),
    [("       nan", "INTERVAL"), (" 1 R01 99", "GLONASS SLOT / FRQ #"), (f"{'1e308':>14}" * 3, "APPROX POSITION XYZ")],
)
def test_a_header_line_that_makes_no_sense_is_left_out(text: str, label: str) -> None:
    file = parse_lines([HEADER_3[0], make_line(text, label), *HEADER_3[1:], *write_epoch_3(37.0, [write_sat_3("G05")])])
    assert any(remark.startswith(f"line 2: {label} ") for remark in file.remarks)


def test_many_damaged_header_lines_are_counted_not_listed() -> None:
    file = parse_lines(
        [HEADER_3[0], *[make_line("x", "LEAP SECONDS")] * 40, *HEADER_3[1:], *write_epoch_3(37.0, [write_sat_3("G05")])]
    )
    assert any(remark.startswith("30 further ") for remark in file.remarks)


def test_hardly_more_than_empty_lines_are_refused() -> None:
    with pytest.raises(InputError, match="empty lines"):
        parse_obs("\n".join(HEADER_3).encode() + b"\n" * (1 << 21))


def test_few_cells_in_many_epochs_of_many_signals_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rinex_obs_read, "EMPTY_CELLS", 100)
    sats = [f"G{number:02d}" for number in range(1, 33)]
    lines = [text for k, sat in enumerate(sats) for text in write_epoch_3(float(k), [sat + write_cell(2e7)])]
    with pytest.raises(InputError, match=r"32 epochs.*32 signals.*32 cells"):
        parse_lines([*HEADER_3, *lines])


def test_records_that_are_mostly_absent_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rinex_obs_read, "EMPTY_CELLS", -10_000)
    with pytest.raises(InputError, match=r"\b1 records.*\b4 types.*\d+ bytes"):
        parse_lines([*HEADER_3, *write_epoch_3(37.0, [write_sat_3("G05")])])


# --- compact observations

COMPACT = READERS["compact"].seeds[1].decode().splitlines()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("G    4 C1C L1C", "G999999 C1C L1"),
        ("3&20000000000", "-1&20000000000"),
        ("3&20000000000", "3&" + "9" * 5000),
        ("3&-100000 ", "3&-1x0000 "),
        ("5000 5000", "²000 5000"),
    ],
)
def test_an_absurd_number_in_a_compact_file_costs_its_arc(old: str, new: str) -> None:
    assert any(old in text for text in COMPACT)
    seen = parse_obs("\n".join([text.replace(old, new) for text in COMPACT]).encode("latin-1")).observations
    assert np.isfinite(seen.pseudorange_m).sum() + np.isfinite(seen.carrier_cyc).sum() >= 6
    assert set(seen.pseudorange_m[np.isfinite(seen.pseudorange_m)]) <= {2e7, 2e7 + 5, 2e7 + 6, 2e7 + 7, 2.1e7}


def test_a_control_character_before_a_count_is_no_fault() -> None:
    old = READERS["compact"].seeds[0].decode().splitlines()
    types = next(k for k, text in enumerate(old) if text[60:].startswith("# / TYPES OF OBS"))
    damaged = [*old[:types], f"  \x1d{old[types][3:]}", *old[types + 1 :]]
    found = parse_obs("\n".join(damaged).encode())
    assert found.observations.signals == parse_obs("\n".join(old).encode()).observations.signals


@pytest.mark.parametrize("count", ["999", " -1", "1e9", "  4", "  2"])
def test_an_absurd_compact_count_costs_what_continues_from_it(count: str) -> None:
    head = next(k for k, text in enumerate(COMPACT) if text.startswith("> 2024"))
    damaged = [*COMPACT[:head], COMPACT[head].replace("  3      G05", f"{count}      G05"), *COMPACT[head + 1 :]]
    file = parse_obs("\n".join([*damaged, ""]).encode())
    assert str(file.observations.gpst[0])[:19] == "2024-10-27T15:47:39"
    assert any(f"line {head + 1}" in remark for remark in file.remarks if Remark.kind_of(remark))


@pytest.mark.parametrize("line_number", range(11, 19))
def test_text_after_a_missing_compact_line_is_left_out(line_number: int) -> None:
    head = "> 2024 10 27 15 47 37.0000000  0  2      G05G06"
    lines = [*COMPACT[:10], head, "", "1&20000000000   ", "1&21000000000   "]
    for second in range(8, 10):
        lines += [f"{'':20}{second}", "", "1000   ", "2000   "]
    whole = parse_obs("\n".join([*lines, ""]).encode())
    assert not any(map(Remark.kind_of, whole.remarks))
    seen_m = whole.observations.pseudorange_m
    np.testing.assert_array_equal(seen_m, [[2e7, 2.1e7], [2e7 + 1, 2.1e7 + 2], [2e7 + 2, 2.1e7 + 4]])
    del lines[line_number]
    _, remarks = crinex.expand("\n".join([*lines, ""]).encode())
    assert any(map(Remark.kind_of, remarks))


def test_a_compact_file_that_expands_too_far_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crinex, "OBSERVATION_BYTES", 100)
    with pytest.raises(InputError, match=r"a\.crx: .*\bMiB\b"):
        crinex.expand("\n".join(COMPACT).encode(), source="a.crx")


# --- tracks

CSV = "t_s,lat_deg,lon_deg,height_m\n0,57.0,11.0,10\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CSV + "1,57.0,11.0," + "1" * 140_000, r"line 3: .*\b131072\b"),
        ("t_s," + "a" * 140_000, r"line 1: .*\b131072\b"),
        (CSV + "1e300,57.0,11.0,10\n", r"line 3, t_s: 1e\+300 s.* 1e\+09"),
        (CSV + "1,57.0,11.0,1e300\n", r"line 3: .*\b57, .*\b11, .*\b1e\+300 m"),
        (CSV + "1,57.0,11.0," + "x" * 1000 + "\n", r'line 3, height_m: "x{57}\.\.\."'),
        ("t_s,x_ecef_m,y_ecef_m,z_ecef_m\n0,1e300,0,0\n", r"line 2: .*\b1e\+300 m.*ECEF"),
        (CSV.replace("t_s", "gpst").replace("\n0", "\n2600-01-01"), r"line 2, gpst: .*\b2600\b.*\b1980\b"),
    ],
)
def test_a_row_that_cannot_be_is_refused_by_its_line(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse_csv(text, source="a.csv")


def test_sentences_that_cannot_be_cost_themselves() -> None:
    good = "$GPGGA,214540.50,5924.600000,N,01652.800000,W,1,09,0.9,10.50,M,60.2,M,,"
    bad = [
        good.replace("5924.6", "9" * 5000),
        good.replace("5924.6", "9" * 500),
        good.replace("10.50", "1e999"),
        good.replace("214540", "996099"),
        good.replace("5924.6", "5999.6"),
        "$GPRMC,214541,A,5924.6,N,01652.8,W,,,010170,,",
    ]
    read = parse_nmea([good, *bad, good.replace("214540", "214542")])
    assert read.t_s is not None
    np.testing.assert_array_equal(read.t_s, [0.0, 2.0])
    assert any(remark.startswith("6 damaged ") for remark in read.remarks)


@pytest.mark.parametrize("when", ["2600-01-01T00:00:00Z", "0001-01-01T00:00:00+01:00", "9999-12-31T23:59:59-01:00"])
def test_years_that_would_wrap_are_refused_in_kml(when: str) -> None:
    text = READERS["kml"].seeds[0].decode().replace("2022-01-01T21:45:40.5Z", when)
    with pytest.raises(InputError, match=r"point 1: .*\btime\b"):
        parse_kml(text)


def test_more_tags_than_are_read_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(track, "XML_TAGS", 10)
    with pytest.raises(InputError, match=r"\b10 tags\b"):
        parse_kml("<a>" * 11)


def test_the_bound_of_a_file_holds_to_the_byte(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    assert byte_io.read_content(tmp_path / "a", 5, "it", "fix it") == b"12345"
    with pytest.raises(InputError, match=r"\bit .*MiB.*; fix it$"):
        byte_io.read_content(tmp_path / "a", 4, "it", "fix it")
