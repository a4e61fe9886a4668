"""RINEX 3.05 observations: what is written reads back, by a small reader of its own."""

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from skyproof.errors import OutputError
from skyproof.formats.rinex_obs import write_obs
from skyproof.formats.rinex_obs_read import read_obs
from skyproof.gnss.signals import carrier_hz_of, rinex_attribute, rinex_signal
from skyproof.records import Observations, SignalId

CREATED_UTC = np.datetime64("2026-01-02T03:04:05", "ns")
GIVEN = {"holds": "authentic", "marker": "rx1", "version": "0.1.0", "created_utc": CREATED_UTC}
FIELDS = {"C1C": "pseudorange_m", "L1C": "carrier_cyc", "D1C": "doppler_hz", "S1C": "cn0_dbhz"}


# --- a small independent reader of RINEX 3, GPS L1 C/A


@dataclass
class Parsed:
    header: dict[str, list[str]] = field(default_factory=dict)
    epochs: list[np.datetime64] = field(default_factory=list)
    cells: dict[tuple[int, str, str], tuple[float, str, str]] = field(default_factory=dict)  # epoch, sat, code


def parse_obs(lines):
    parsed, lines = Parsed(), iter(lines)
    for line in lines:
        assert len(line) == 80
        parsed.header.setdefault(line[60:].strip(), []).append(line[:60])
        if line[60:].strip() == "END OF HEADER":
            break
    codes = parsed.header["SYS / # / OBS TYPES"][0][6:].split()
    for line in lines:
        assert (line[0], line[1]) == (">", " ")
        second, flag, n_sats = float(line[18:29]), int(line[29:32]), int(line[32:35])
        assert flag == 0
        minute = np.datetime64(f"{line[2:6]}-{line[7:9]}-{line[10:12]}T{line[13:15]}:{line[16:18]}", "ns")
        parsed.epochs.append(minute + np.timedelta64(round(second * 1e7) * 100, "ns"))
        for _ in range(n_sats):
            row = next(lines)
            for k, code in enumerate(codes):
                cell = row[3 + 16 * k : 19 + 16 * k].ljust(16)
                if cell[:14].strip():
                    assert cell[10] == "."
                    parsed.cells[len(parsed.epochs) - 1, row[:3], code] = (float(cell[:14]), cell[14], cell[15])
    return parsed


# --- observations to write


def draw_observations(names=("G05a", "G07a", "G07b", "G30a"), n_epochs=6, seed=1):
    rng = np.random.default_rng(seed)
    shape = (n_epochs, len(names))
    elapsed_s = np.arange(n_epochs) * 0.5
    return Observations(
        receiver="rx1",
        signals=tuple(SignalId(name[:3], copy=name[3]) for name in names),
        gpst=np.datetime64("2022-01-01T21:46:59", "ns") + (elapsed_s * 1e9).astype("timedelta64[ns]"),
        elapsed_s=elapsed_s,
        pseudorange_m=rng.uniform(2e7, 2.6e7, shape),
        carrier_cyc=rng.uniform(-1e6, 1.4e8, shape),
        doppler_hz=rng.uniform(-5e3, 5e3, shape),
        cn0_dbhz=rng.uniform(20.0, 55.0, shape),
        pseudorange_sigma_m=np.ones(shape),
        carrier_sigma_cyc=np.ones(shape),
        doppler_sigma_hz=np.ones(shape),
        status=np.zeros(shape, np.uint8),
        found_elapsed_s=np.zeros(len(names)),
        missed_elapsed_s=np.zeros(len(names)),
    )


def change_cells(observations, cells, **values):
    """Change some cells of the named fields."""
    changed = {}
    for name, value in values.items():
        array = np.array(getattr(observations, name))
        array[cells] = value
        changed[name] = array
    return replace(observations, **changed)


def drop_cells(observations, cells):
    nothing = dict.fromkeys(("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz"), np.nan)
    return change_cells(observations, cells, status=1, **nothing)


def list_signals(*names):
    return [SignalId(name[:3], copy=name[3]) for name in names]


def write_lines(observations, **given):
    with TemporaryDirectory() as folder:
        write_obs(path := Path(folder) / "one.obs", observations, **given)
        return path.read_text("ascii").splitlines()


def parse_back(observations, *names, **more):
    return parse_obs(write_lines(observations, signals=list_signals(*names), **(GIVEN | more)))


# --- what holds


def test_what_is_written_reads_back(tmp_path):
    observations = draw_observations()
    path = tmp_path / "rx1-authentic.obs"
    write_obs(path, observations, signals=list_signals("G30a", "G05a", "G07b"), **GIVEN)
    parsed = parse_obs(path.read_text("ascii").splitlines())
    np.testing.assert_array_equal(np.array(parsed.epochs), observations.gpst)
    assert len(parsed.cells) == 6 * 3 * 4
    for channel, sat in ((0, "G05"), (2, "G07"), (3, "G30")):
        for epoch in range(6):
            for code, name in FIELDS.items():
                value = parsed.cells[epoch, sat, code][0]
                assert value == pytest.approx(getattr(observations, name)[epoch, channel], abs=5.1e-4)


def test_the_header_has_what_the_format_demands():
    position_m = (3098123.4567, 939876.5432, -5467890.1234)
    header = parse_back(draw_observations(), "G05a", "G07b", position_ecef_m=position_m, comments=("by hand",)).header
    assert header["RINEX VERSION / TYPE"] == [f"{'     3.05           OBSERVATION DATA    G: GPS':60}"]
    assert header["PGM / RUN BY / DATE"][0][40:] == "20260102 030405 UTC "
    assert header["MARKER NAME"][0].strip() == "rx1"
    assert [float(header["APPROX POSITION XYZ"][0][k : k + 14]) for k in (0, 14, 28)] == list(position_m)
    assert header["SYS / # / OBS TYPES"][0].rstrip() == "G    4 C1C L1C D1C S1C"
    assert float(header["INTERVAL"][0][:10]) == 0.5
    assert header["TIME OF FIRST OBS"][0].rstrip() == "  2022     1     1    21    46   59.0000000     GPS"
    assert header["TIME OF LAST OBS"][0].rstrip() == "  2022     1     1    21    47    1.5000000     GPS"
    assert header["LEAP SECONDS"][0][:6] == "    18"
    assert header["SYS / PHASE SHIFT"][0].rstrip() == "G L1C  0.00000"
    assert header["RCV CLOCK OFFS APPL"][0][:6] == "     0"
    assert [comment.strip().split(": ")[-1] for comment in header["COMMENT"]] == ["G05a, G07b", "by hand"]
    for label in (
        "MARKER TYPE",
        "OBSERVER / AGENCY",
        "REC # / TYPE / VERS",
        "ANT # / TYPE",
        "ANTENNA: DELTA H/E/N",
        "SIGNAL STRENGTH UNIT",
    ):
        assert len(header[label]) == 1
    assert "APPROX POSITION XYZ" not in parse_back(draw_observations(), "G05a").header


def test_long_and_foreign_words_keep_to_their_columns(tmp_path):
    path = tmp_path / "a.obs"
    words = {"marker": "Höjd\n" * 30, "comments": ("word " * 40,), "version": "1.2.3.dev456+gabcdef0"}
    write_obs(path, draw_observations(), signals=list_signals("G05a"), **(GIVEN | words))
    header = parse_obs(path.read_text("ascii").splitlines()).header
    assert header["MARKER NAME"][0].startswith("H?jd H?jd")
    assert len(header["COMMENT"]) == 1 + 4


def test_the_line_of_a_satellite_stands_in_its_columns():
    observations = change_cells(
        draw_observations(["G05a"], 1),
        (0, 0),
        pseudorange_m=23629347.9151,
        carrier_cyc=-353.3004,
        doppler_hz=-1234.5678,
        cn0_dbhz=47.25,
    )
    *_, epoch, row = write_lines(observations, signals=observations.signals, **GIVEN)
    assert epoch == "> 2022 01 01 21 46 59.0000000  0  1"
    assert row == "G05  23629347.915 7      -353.300 7     -1234.568          47.250"


def test_signal_strength_is_the_digit_of_the_format():
    cn0_dbhz = [5.0, 11.9, 12.0, 36.0, 53.9, 54.0, 60.0]
    observations = change_cells(draw_observations(["G05a"], 7), (slice(None), 0), cn0_dbhz=cn0_dbhz)
    parsed = parse_back(observations, "G05a")
    assert [parsed.cells[epoch, "G05", "L1C"][2] for epoch in range(7)] == list("1126899")
    assert [parsed.cells[epoch, "G05", "C1C"][2] for epoch in range(7)] == list("1126899")


def test_a_file_is_dated_by_its_first_epoch_for_equal_bytes():
    observations = drop_cells(draw_observations(), (slice(0, 4), slice(None)))  # the first two seconds
    (reported,) = parse_back(observations, "G05a", created_utc=None).header["PGM / RUN BY / DATE"]
    assert reported[40:] == "20220101 214643 UTC "  # 18 leap seconds after 21:46:59 and 2 s later


def find_lost_locks(observations, *names, sat="G07"):
    cells = parse_back(observations, *names).cells
    return [epoch for epoch in range(len(observations.gpst)) if cells.get((epoch, sat, "L1C"), (0, " "))[1] == "1"]


def test_a_cycle_slip_is_reported():
    assert find_lost_locks(draw_observations(), "G07a") == []
    assert find_lost_locks(change_cells(draw_observations(), (3, 1), status=3), "G07a") == [3]


def test_a_gap_is_lost_lock_but_the_first_measurement_is_not():
    observations = drop_cells(draw_observations(), (slice(0, 2), 1))
    assert find_lost_locks(observations, "G07a", "G30a") == []
    assert find_lost_locks(drop_cells(observations, (4, 1)), "G07a", "G30a") == [5]


def test_an_open_half_cycle_is_bit_1_of_the_indicator():
    observations = change_cells(draw_observations(), ([1, 2, 3], 1), half_cycle_open=True)
    observations = change_cells(observations, ([1, 4], 1), status=3)
    observations = change_cells(observations, (3, 1), carrier_cyc=np.nan)
    cells = parse_back(observations, "G07a").cells
    indicators = [cells[epoch, "G07", "L1C"][1] for epoch in (0, 1, 2, 4, 5)]
    assert indicators == [" ", "3", "2", "1", " "]
    assert {cells[epoch, "G07", "C1C"][1] for epoch in range(6)} == {" "}


def test_another_channel_of_a_satellite_is_lost_lock():
    observations = drop_cells(drop_cells(draw_observations(), (slice(0, 3), 2)), (slice(3, None), 1))
    assert find_lost_locks(observations, "G07a", "G07b") == [3]
    cells = parse_back(observations, "G07a", "G07b").cells
    assert cells[2, "G07", "C1C"][0] == pytest.approx(observations.pseudorange_m[2, 1], abs=1e-3)
    assert cells[3, "G07", "C1C"][0] == pytest.approx(observations.pseudorange_m[3, 2], abs=1e-3)


def test_two_copies_of_one_satellite_at_one_epoch_are_refused(tmp_path):
    path = tmp_path / "a.obs"
    with pytest.raises(ValueError, match=r"\bG07\b"):
        write_obs(path, draw_observations(), signals=list_signals("G05a", "G07a", "G07b"), **GIVEN)
    assert not path.exists()


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        (SignalId("G99"), "not among"),
        (SignalId("G05", "E1"), r"\bE1\b"),
        (SignalId("G05", "L5", "CA"), r"\bL5 CA\b"),
    ],
)
def test_a_signal_that_cannot_be_written_is_refused(signal, words):
    observations = draw_observations()
    if words != "not among":
        observations = replace(observations, signals=(signal, *observations.signals[1:]))
    with pytest.raises(ValueError, match=words):
        write_lines(observations, signals=[signal], **GIVEN)


def test_epochs_and_numbers_that_are_missing_are_left_out():
    observations = drop_cells(drop_cells(draw_observations(), (2, slice(None))), (3, 0))
    observations = change_cells(observations, (4, 0), carrier_cyc=np.nan)
    observations = change_cells(observations, (5, 0), pseudorange_m=-1e12)
    parsed = parse_back(observations, "G05a", "G30a")
    assert parsed.epochs == [observations.gpst[k] for k in (0, 1, 3, 4, 5)]
    assert (2, "G05", "C1C") not in parsed.cells
    assert (2, "G30", "C1C") in parsed.cells
    assert (3, "G05", "C1C") in parsed.cells
    assert (3, "G05", "L1C") not in parsed.cells
    assert (4, "G05", "C1C") not in parsed.cells  # no field is as wide
    assert (4, "G05", "L1C") in parsed.cells


def test_nothing_to_write_is_refused():
    with pytest.raises(ValueError, match="nothing"):
        write_lines(drop_cells(draw_observations(), (slice(None), 0)), signals=list_signals("G05a"), **GIVEN)


def test_an_epoch_just_below_the_minute_is_rounded_as_a_whole():
    observations = draw_observations(["G05a"], 1)
    observations = replace(observations, gpst=np.array(["2021-12-31T23:59:59.999999970"], "datetime64[ns]"))
    parsed = parse_back(observations, "G05a")
    assert parsed.epochs == [np.datetime64("2022-01-01T00:00:00")]
    assert parsed.header["TIME OF FIRST OBS"][0].split() == ["2022", "1", "1", "0", "0", "0.0000000", "GPS"]


def test_a_folder_that_is_not_there_is_reported(tmp_path):
    with pytest.raises(OutputError, match="folder"):
        write_obs(tmp_path / "gone" / "a.obs", draw_observations(), signals=list_signals("G05a"), **GIVEN)


EVERY = (
    SignalId("C19", "B1", "2I"),
    SignalId("C19", "B1C", "1P"),
    SignalId("C19", "B2b", "7D"),
    SignalId("C19", "B3", "6I"),
    SignalId("E05", "E1", "C"),
    SignalId("E05", "E5a", "Q"),
    SignalId("G05", "L1", "CA"),
    SignalId("G05", "L1", "W"),
    SignalId("G05", "L2", "L"),
    SignalId("G05", "L5", "Q"),
    SignalId("G07", "L1", "CA"),
    SignalId("J02", "L1", "CA"),
    SignalId("R03", "G1", "CA"),
    SignalId("R03", "G2", "P"),
    SignalId("R04", "G1", "CA"),
)
NUMBERS = {"R03": 5, "R04": -7}


def test_signals_of_all_systems_and_bands_read_back(tmp_path):
    o = draw_observations([f"G{k + 1:02d}a" for k in range(len(EVERY))])
    carrier_hz = np.array([carrier_hz_of(s.band, NUMBERS.get(s.sat)) for s in EVERY])
    higher_m = np.array([1.6e7 if s.sat[0] == "J" else 0.0 for s in EVERY])  # in orbits of 24 hours
    o = replace(o, signals=EVERY, carrier_hz=carrier_hz, pseudorange_m=o.pseudorange_m + higher_m)
    o = drop_cells(o, (2, slice(3, 8)))
    write_obs(tmp_path / "all.obs", o, signals=EVERY, **GIVEN)
    found = read_obs(tmp_path / "all.obs")
    assert found.observations.signals == EVERY
    assert found.glonass_channels == NUMBERS
    assert found.remarks == ()
    np.testing.assert_array_equal(found.observations.carrier_hz, carrier_hz)
    for name in ("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz"):
        np.testing.assert_allclose(getattr(found.observations, name), getattr(o, name), atol=5.1e-4)


@pytest.mark.parametrize("system", "GREJCSI")
def test_a_signal_has_the_name_that_it_was_read_by(system):
    for digit, letter in itertools.product("123456789", "ABCDILMNPQSWXYZ"):
        signal = rinex_signal(system, digit + letter)
        if signal is not None:
            named = rinex_attribute(f"{system}01", *signal)
            assert rinex_signal(system, named) == signal
