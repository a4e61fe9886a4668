"""The rendered pair of recordings under a meaconer, through the command: its files against the truth of the scene.

Which copy of a satellite's signal is authentic is decided by the truth alone: by the nearest true delay.
"""

import contextlib
import csv
import io
import json
import tomllib
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.interpolate import make_interp_spline

from skyproof import cli
from skyproof.formats.verdict import read_verdict
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.verdict import Verdict

pytestmark = pytest.mark.shared_data

LIGHT_M_S = 299_792_458.0
EPOCH, EPOCH_TOW_S = np.datetime64("2022-01-01T21:45:58", "ns"), 596_758
ONSET_S = 24.0
SECOND = np.timedelta64(10**9, "ns")
RECEIVERS = ("rx1", "rx2")


class Truth:
    """truth.json, and the columns of truth.csv."""

    def __init__(self, folder: Path) -> None:
        self.scene = json.loads((folder / "truth.json").read_text())
        with (folder / "truth.csv").open() as lines:
            rows = list(csv.DictReader(lines))
        self.table = {name: np.array([row[name] for row in rows]) for name in ("receiver", "prn", "label")}
        for name in ("tow_s", "receiver_elapsed_s", "code_delay_s"):
            self.table[name] = np.array([float(row[name]) for row in rows])
        self.sats = {f"G{prn:02d}" for prn in self.scene["authentic_prns"]}
        self.shown_ecef_m = np.array(self.scene["transmitters"][0]["captured_receiver_shows_position"]["ecef_m"])
        self.late_s = self.scene["transmitters"][0]["captured_clock_extra_s"]

    def place_ecef_m(self, receiver: str) -> np.ndarray:
        return np.array(next(r for r in self.scene["receivers"] if r["name"] == receiver)["position"]["ecef_m"])

    def label(
        self, receiver: str, sat: str, gpst: np.ndarray, elapsed_s: np.ndarray, range_m: np.ndarray
    ) -> np.ndarray:
        """Label each pseudorange: "authentic" or "spoofed" if it is within 100 m of that signal's alone, else ""."""
        near = {}
        for label in ("authentic", "spoofed"):
            selected = (self.table["receiver"] == receiver) & (self.table["prn"] == str(int(sat[1:])))
            selected &= self.table["label"] == label
            known_s, counted_s = self.table["tow_s"][selected] - EPOCH_TOW_S, self.table["receiver_elapsed_s"][selected]
            true_s = make_interp_spline(counted_s, known_s, k=1)(elapsed_s)  # goes on straight for the last second
            delay_s = make_interp_spline(known_s, self.table["code_delay_s"][selected], k=1)(true_s)
            near[label] = np.abs(range_m - LIGHT_M_S * (delay_s + ((gpst - EPOCH) / SECOND - true_s))) < 100.0
        usable = near["authentic"] & near["spoofed"]
        return np.where(usable, "", np.where(near["authentic"], "authentic", np.where(near["spoofed"], "spoofed", "")))


@dataclass(frozen=True, eq=False)
class Run:
    """What a command line left behind."""

    folder: Path
    truth: Truth

    @cached_property
    def verdict(self) -> Verdict:
        return read_verdict(self.folder / "verdict.json")

    @cached_property
    def fixes(self) -> list[dict[str, str]]:
        with (self.folder / "fixes.csv").open() as lines:
            return list(csv.DictReader(lines))

    @cached_property
    def signals(self) -> dict[str, np.ndarray]:
        """Read signals.parquet where there is a pseudorange, and add the column `true`, each cell's true label."""
        table = pq.read_table(self.folder / "signals.parquet")
        names = ("receiver", "receiver_clock", "sat", "copy", "pseudorange_m", "label")
        cells = {name: table[name].to_numpy() for name in names}
        present = np.isfinite(cells["pseudorange_m"].astype(float))
        cells = {name: column[present] for name, column in cells.items()}
        cells["true"] = np.full(present.sum(), "", "U9")
        for receiver in self.verdict.receivers:
            start = np.datetime64(receiver.start_gpst, "ns")
            begun_s = (start - EPOCH) / SECOND
            for sat in self.truth.sats:
                selected = (cells["receiver"] == receiver.name) & (cells["sat"] == sat)
                gpst = cells["receiver_clock"][selected]
                elapsed_s = (gpst - start) / SECOND + round(begun_s)  # of the whole recording
                cells["true"][selected] = self.truth.label(
                    receiver.name, sat, gpst, elapsed_s, cells["pseudorange_m"][selected]
                )
        return cells

    def read_trusted(self, receiver: str) -> tuple[np.ndarray, np.ndarray]:
        """Read seconds since the scene's epoch and the distance from the truth of each trusted fix."""
        rows = [row for row in self.fixes if row["receiver"] == receiver and row["kind"] == "trusted"]
        seconds = np.array([(np.datetime64(row["gpst"], "ns") - EPOCH) / SECOND for row in rows])
        return seconds, np.array([measure_distance_m(row, self.truth.place_ecef_m(receiver)) for row in rows])


def measure_distance_m(place, ecef_m: np.ndarray) -> float:
    """Measure the distance from a row with lat_deg, lon_deg and height_m to a point."""
    get = place.get if isinstance(place, dict) else lambda name: getattr(place, name)
    lat_deg, lon_deg, height_m = (float(get(name)) for name in ("lat_deg", "lon_deg", "height_m"))
    return float(np.linalg.norm(ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), height_m) - ecef_m))


@pytest.fixture(scope="session")
def truth(shared_data):
    return Truth(shared_data / "rf" / "meaconing-pair")


@pytest.fixture(scope="session")
def protect_once(shared_data, truth, made_once):
    """Run the command once for each set of arguments; stdout.json holds what it printed."""

    def protect(name: str, *options: str, receivers: tuple[str, ...] = RECEIVERS, nav: bool = True) -> Run:
        def fill(folder: Path) -> None:
            data = shared_data / "rf"
            argv = ["protect", *(str(data / "meaconing-pair" / f"{r}.bin") for r in receivers), *options, "--json"]
            argv += ["--nav", str(data / "brdc0010.22n")] if nav else []
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                assert cli.main([*argv, "--out", str(folder)]) == 0
            (folder / "stdout.json").write_text(printed.getvalue())

        return Run(made_once(f"meaconing-pair-{name}", fill), truth)

    return protect


@pytest.fixture(scope="session")
def whole(protect_once):
    return protect_once("whole")


# --- what every run on the pair must meet


def assert_no_false_label(run: Run) -> None:
    cells = run.signals
    known = (cells["true"] != "") & (cells["label"] != "unknown")
    wrong = known & (cells["true"] != cells["label"])
    names = zip(*(cells[name][wrong] for name in ("receiver", "sat", "copy", "label")), strict=True)
    assert sorted(set(names)) == []
    # and nothing that is neither of the two is called authentic
    assert np.mean(cells["true"][cells["label"] == "authentic"] == "authentic") > 0.98


def assert_named(run: Run, label: str, at_least: int) -> None:
    """Check that so many satellites' signals have that label nearly all of their time, in both receivers."""
    cells = run.signals
    for receiver in RECEIVERS:
        named = [
            sat
            for sat in run.truth.sats
            if (selected := (cells["receiver"] == receiver) & (cells["sat"] == sat) & (cells["true"] == label)).any()
            and np.mean(cells["label"][selected] == label) > 0.95
        ]
        assert len(named) >= at_least, (receiver, sorted(named))


def assert_trusted_fixes(run: Run, begin_s: float, end_s: float) -> None:
    """Check fixes once a second from 5 s on, 95 % of them within 5 m, before the onset and after it."""
    for receiver in RECEIVERS:
        seconds, error_m = run.read_trusted(receiver)
        for part in (seconds < ONSET_S, seconds >= ONSET_S):
            assert not part.any() or np.percentile(error_m[part], 95) < 5.0
        wanted = set(range(int(begin_s) + 5, int(end_s) - 1))
        assert wanted - set(np.floor(seconds).astype(int)) == set()


def assert_onset(run: Run) -> None:
    off_s = (np.datetime64(run.verdict.since_gpst, "ns") - EPOCH) / SECOND - ONSET_S
    assert abs(off_s) < 3.0
    assert abs(off_s) < 5.0 * run.verdict.since_sigma_s


# --- the whole pair


def test_the_pair_is_spoofed_since_the_onset(whole):
    assert whole.verdict.verdict == "spoofed"
    assert whole.verdict.reason is None
    assert_onset(whole)
    assert whole.verdict.until_gpst is None


def test_no_label_is_false_and_all_satellites_are_named(whole):
    assert_no_false_label(whole)
    assert_named(whole, "authentic", 10)
    assert_named(whole, "spoofed", 10)


def test_the_trusted_position_is_true_before_and_after_onset(whole):
    assert_trusted_fixes(whole, 0.0, 60.0)
    for receiver in whole.verdict.receivers:
        assert measure_distance_m(receiver.trusted_fix, whole.truth.place_ecef_m(receiver.name)) < 5.0


def test_the_source_shows_the_meaconers_ears_late(whole):
    (source,) = whole.verdict.sources
    assert source.kind == "one antenna"
    assert measure_distance_m(source.shows, whole.truth.shown_ecef_m) < 10.0
    assert source.time_offset_s == pytest.approx(whole.truth.late_s["rx1"], abs=3e-8)
    assert len(whole.truth.sats & set(source.sats)) >= 10
    for receiver in whole.verdict.receivers:
        assert measure_distance_m(receiver.false_fix, whole.truth.shown_ecef_m) < 10.0


def test_delays_to_the_authentic_signals_are_those_of_the_truth(whole):
    chips = whole.truth.scene["transmitters"][0]["copy_minus_authentic_chips_first_last"]
    checked = 0
    for s in whole.verdict.signals:
        if s.label == "spoofed" and s.delay_to_authentic_m is not None:
            first, last = chips[s.receiver][str(int(s.sat[1:]))]
            assert s.delay_to_authentic_m == pytest.approx(0.5 * (first + last) * LIGHT_M_S / 1.023e6, abs=30.0)
            checked += 1
    assert checked >= 20


# --- the files of the whole pair


def test_every_output_is_there(whole):
    found = {path.name for path in whole.folder.iterdir()} - {"stdout.json"}
    named = {
        "verdict.json",
        "fixes.parquet",
        "fixes.csv",
        "signals.parquet",
        "evidence.parquet",
        "report.html",
        "tracks.kml",
        "nav.rnx",
        "settings.toml",
    }
    kinds = ("authentic.obs", "other.obs", "trusted.nmea")
    assert found >= named | {f"{receiver}-{kind}" for receiver in RECEIVERS for kind in kinds}
    assert "trusted.nmea" not in found


def test_standard_output_is_the_document_and_nothing_else(whole):
    assert (whole.folder / "stdout.json").read_text() == (whole.folder / "verdict.json").read_text(encoding="utf-8")


def test_the_document_is_complete(whole):
    verdict = whole.verdict  # read against the schema
    assert [r.name for r in verdict.receivers] == list(RECEIVERS)
    assert [len(i.sha256) for i in verdict.inputs] == [64] * 5  # two recordings, their sidecars, orbits
    ran = {m.detector for m in verdict.methods if m.ran}
    assert ran >= {"multi_receiver", "second_signals", "residual"}
    assert all(m.tests > 0 for m in verdict.methods if m.ran)
    assert all(m.why_not and m.would_need for m in verdict.methods if not m.ran)
    assert all(s.because for s in verdict.signals if s.label != "unknown")
    assert tomllib.loads((whole.folder / "settings.toml").read_text())["protect"].items() <= verdict.settings.items()


def test_both_tables_of_fixes_hold_the_same(whole):
    table = pq.read_table(whole.folder / "fixes.parquet")
    assert table.column_names == list(whole.fixes[0])
    columns = {name: table[name].to_numpy() for name in table.column_names}
    assert [row["kind"] for row in whole.fixes] == columns["kind"].tolist()
    assert [np.datetime64(row["gpst"], "ns") for row in whole.fixes] == list(columns["gpst"])
    for name in ("lat_deg", "sigma_up_m", "clock_bias_m", "satellites"):
        assert [float(row[name]) for row in whole.fixes] == columns[name].tolist()
    assert {(row["receiver"], row["kind"]) for row in whole.fixes} == {
        (receiver, kind) for receiver in RECEIVERS for kind in ("trusted", "false", "unprotected")
    }


def test_times_of_fixes_are_the_receivers_clock_less_its_bias(whole):
    clocks = {
        (name, clock)
        for name, clock in zip(
            whole.signals["receiver"], whole.signals["receiver_clock"].astype("datetime64[us]"), strict=True
        )
    }
    for row in whole.fixes:
        bias = np.timedelta64(round(float(row["clock_bias_m"]) / LIGHT_M_S * 1e9), "ns")
        clock = np.datetime64(row["gpst"], "ns") + bias
        assert (row["receiver"], (clock + np.timedelta64(500, "ns")).astype("datetime64[us]")) in clocks


def test_evidence_is_a_table_of_all_detectors(whole):
    table = pq.read_table(whole.folder / "evidence.parquet").to_pydict()
    assert set(table["detector"]) >= {"multi_receiver", "second_signals", "residual"}
    assert {"authentic", "spoofed", "attack"} <= set(table["says"])
    assert all(because for because in table["because"])


def read_c1c(path: Path) -> dict[tuple[datetime, str], float]:
    """Read C1C of a RINEX 3 file by epoch and satellite, by a reader of its own."""
    lines = path.read_text(encoding="ascii").splitlines()
    assert lines[0][:9].strip() == "3.05"
    assert lines[0][20] == "O"
    end = next(i for i, line in enumerate(lines) if line[60:].startswith("END OF HEADER"))
    codes = next(line for line in lines if line[60:].startswith("SYS / # / OBS TYPES"))[6:60].split()
    ranges, epoch = {}, None
    for line in lines[end + 1 :]:
        if line.startswith(">"):
            year, month, day, hour, minute = (int(part) for part in line[1:18].split())
            second = float(line[18:29])
            epoch = datetime(year, month, day, hour, minute, int(second), round(second % 1.0 * 1e6))
        elif field := line[3 + 16 * codes.index("C1C") :][:14].strip():
            assert (epoch, line[:3]) not in ranges
            ranges[epoch, line[:3]] = float(field)
    return ranges


@pytest.mark.parametrize(("kind", "label"), [("authentic", "authentic"), ("other", "spoofed")])
def test_rinex_observations_are_those_with_the_label(whole, kind, label):
    cells = whole.signals
    for receiver in RECEIVERS:
        written = read_c1c(whole.folder / f"{receiver}-{kind}.obs")
        selected = (cells["receiver"] == receiver) & (cells["label"] == label)
        clock = cells["receiver_clock"][selected].astype("datetime64[us]")
        chosen = (clock.tolist(), cells["sat"][selected], cells["pseudorange_m"][selected])
        expected = {(gpst, sat): range_m for gpst, sat, range_m in zip(*chosen, strict=True)}
        assert written.keys() == expected.keys()
        assert max(abs(written[cell] - expected[cell]) for cell in written) < 0.001


def test_headers_have_the_recordings_date_and_place(whole):
    for receiver in RECEIVERS:
        for kind in ("authentic", "other"):
            header = (whole.folder / f"{receiver}-{kind}.obs").read_text(encoding="ascii").split("END OF HEADER")[0]
            at = {line[60:].strip(): line[:60] for line in header.splitlines()}
            place_m = np.array(at["APPROX POSITION XYZ"].split(), float)
            assert np.linalg.norm(place_m - whole.truth.place_ecef_m(receiver)) < 10.0
            assert at["PGM / RUN BY / DATE"][40:].startswith("20220101 21454")
    assert "20220101 21454" in (whole.folder / "nav.rnx").read_text(encoding="ascii").split("END OF HEADER")[0]


def test_the_navigation_file_has_the_orbits_of_all_satellites(whole):
    lines = (whole.folder / "nav.rnx").read_text(encoding="ascii").splitlines()
    body = lines[next(i for i, line in enumerate(lines) if line[60:].startswith("END OF HEADER")) + 1 :]
    assert whole.truth.sats <= {line[:3] for line in body if line.startswith("G")}
    for line in body:
        columns = (23, 42, 61) if line.startswith("G") else (4, 23, 42, 61)
        assert all(np.isfinite(float(line[c : c + 19].replace("D", "E"))) for c in columns if line[c : c + 19].strip())


def test_tracks_are_xml_and_lie_where_the_fixes_are(whole):
    root = ElementTree.parse(whole.folder / "tracks.kml").getroot()
    assert root.tag.endswith("}kml")
    names = {e.text for e in root.iter("{http://www.opengis.net/kml/2.2}name")}
    assert {f"{r} {kind}" for r in RECEIVERS for kind in ("trusted", "false", "unprotected")} <= names
    coordinates = [e.text.split() for e in root.iter("{http://www.google.com/kml/ext/2.2}coord")]
    assert len(coordinates) == len(whole.fixes)
    lon_deg, lat_deg = np.array(coordinates, float)[:, :2].T
    np.testing.assert_allclose(lat_deg, 59.41, atol=0.01)
    np.testing.assert_allclose(lon_deg, 16.89, atol=0.02)


def test_sentences_have_checksums_and_one_position_a_fix(whole):
    sentences = (whole.folder / "rx1-trusted.nmea").read_text(encoding="ascii").splitlines()
    for sentence in sentences:
        body, checksum = sentence[1:].split("*")
        assert np.bitwise_xor.reduce(np.frombuffer(body.encode(), np.uint8)) == int(checksum, 16)
    seconds, _ = whole.read_trusted("rx1")
    positions = [sentence.split(",") for sentence in sentences if sentence[3:6] == "GGA"]
    assert len(positions) == seconds.size
    hdop, altitude_m, separation_m = np.array([[fields[k] for k in (8, 9, 11)] for fields in positions], float).T
    rows = [row for row in whole.fixes if row["receiver"] == "rx1" and row["kind"] == "trusted"]
    np.testing.assert_allclose(altitude_m + separation_m, [float(row["height_m"]) for row in rows], atol=0.006)
    np.testing.assert_allclose(separation_m, 25.4, atol=1.5)  # EGM96 at 59.41 N, 16.88 E
    assert hdop.min() > 0.4
    assert hdop.max() < 5.0


def test_the_report_says_the_verdict_and_needs_no_network(whole):
    page = (whole.folder / "report.html").read_text(encoding="utf-8")
    assert "spoofed" in page.lower()
    assert whole.verdict.summary.split(",")[0] in page
    assert not any(word in page for word in ('src="http', 'href="http', "@import", "url(http"))


# --- parts and variants


@pytest.mark.long
def test_labels_and_accuracy_hold_without_a_navigation_file(protect_once):
    run = protect_once("no-nav", nav=False)
    assert run.verdict.verdict == "spoofed"
    assert_onset(run)
    assert_no_false_label(run)
    assert_named(run, "authentic", 10)
    assert_named(run, "spoofed", 10)
    assert_trusted_fixes(run, 0.0, 60.0)


def measure_antenna_distance_m(truth):
    return float(np.linalg.norm(truth.place_ecef_m("rx1") - truth.place_ecef_m("rx2")))


@pytest.mark.long
def test_the_part_before_the_onset_is_authentic(protect_once, truth):
    run = protect_once(
        "before", "--duration-s", "22", "--antenna-distance-m", f"{measure_antenna_distance_m(truth):.1f}"
    )
    assert run.verdict.verdict == "authentic"
    assert (run.verdict.since_gpst, run.verdict.sources) == (None, ())
    assert {s.label for s in run.verdict.signals} == {"authentic"}
    assert_no_false_label(run)
    assert_named(run, "authentic", 10)
    assert_trusted_fixes(run, 0.0, 22.0)


@pytest.mark.long
def test_the_part_that_begins_under_attack_is_judged_as_well(protect_once):
    run = protect_once("after", "--start-s", "27")
    assert run.verdict.verdict == "spoofed"
    assert run.verdict.from_start
    assert run.verdict.since_sigma_s is None
    assert_no_false_label(run)
    assert_named(run, "authentic", 10)
    assert_named(run, "spoofed", 10)
    assert_trusted_fixes(run, 27.0, 60.0)


@pytest.mark.long
@pytest.mark.parametrize("nav", [True, False])
def test_one_receiver_sees_two_skies_and_leaves_them_open(protect_once, nav):
    run = protect_once(f"alone-{nav}", receivers=("rx1",), nav=nav)
    assert run.verdict.verdict == "spoofed"
    assert run.verdict.reason
    assert {s.label for s in run.verdict.signals} == {"unknown"}
    seen_s = (np.datetime64(run.verdict.since_latest_gpst, "ns") - EPOCH) / SECOND - ONSET_S
    assert 0.0 <= seen_s < 3.0
    assert run.verdict.since_earliest_gpst is None  # the sky that was seen first may be the false one
    assert run.verdict.receivers[0].trusted_fix is None
    assert len(run.verdict.sources) == 2
    cells = run.signals
    for label, place_ecef_m, late_s in (
        ("authentic", run.truth.place_ecef_m("rx1"), 0.0),
        ("spoofed", run.truth.shown_ecef_m, run.truth.late_s["rx1"]),
    ):
        source = min(run.verdict.sources, key=lambda source: measure_distance_m(source.shows, place_ecef_m))
        assert measure_distance_m(source.shows, place_ecef_m) < 10.0
        assert source.time_offset_s == pytest.approx(late_s, abs=3e-8)
        matching = [s for s in run.verdict.signals if s.source == source.name]
        assert {s.sat for s in matching} == set(source.sats)
        assert len(matching) >= 10
        for s in matching:
            mine = (cells["sat"] == s.sat) & (cells["copy"] == s.copy)
            assert np.mean(cells["true"][mine] == label) > 0.95
