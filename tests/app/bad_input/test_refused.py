"""Bad input: one line that names the file, what is wrong and what to do; and what good data allow is not lost."""

import os
import re
import shutil

import numpy as np
import pytest
from tests.app import kit
from tests.app.bad_input.common import SIDECAR, START, assert_refused, copy_recording, write_noise

from skyproof import cli
from skyproof.app.common.settings import Settings
from skyproof.app.protect import protect
from skyproof.app.receive.inputs import open_inputs
from skyproof.errors import InputError, NotEnoughData
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.nominal import make_nominal_constellation

# --- the file


@pytest.mark.usefixtures("no_tracking")
def test_an_empty_file_is_refused(run, tmp_path):
    path = tmp_path / "rx1.bin"
    path.write_bytes(b"")
    path.with_suffix(".toml").write_text(SIDECAR)
    assert_refused(run(path), path, "empty")


@pytest.mark.usefixtures("no_tracking")
def test_a_file_that_is_not_there_is_refused(run, tmp_path):
    assert_refused(run(tmp_path / "rx1.bin"), tmp_path / "rx1.bin", "exist")
    assert_refused(run(tmp_path), tmp_path, "regular")


@pytest.mark.usefixtures("no_tracking")
def test_no_file_at_all_is_refused():
    with pytest.raises(InputError, match="no input"):
        protect([])


@pytest.mark.usefixtures("no_tracking")
def test_zeros_are_refused(run, tmp_path):
    path = tmp_path / "rx1.bin"
    path.write_bytes(bytes(100_000))
    path.with_suffix(".toml").write_text(SIDECAR.replace('"sign"', '"int"').replace("bits = 1", "bits = 8"))
    assert_refused(run(path), path, " zero ")


@pytest.mark.long
def test_an_odd_byte_at_the_end_is_left_out_and_reported(run, wide, tmp_path):
    cut = copy_recording(wide, tmp_path, n_bytes=wide.stat().st_size - 1)
    ended = run(cut)
    assert ended.code == 0
    assert " 1 bytes " in ended.remarks(0)
    assert "s were summed" in ended.remarks(0)  # it was worked on  # it was worked on


@pytest.mark.long
def test_a_saturated_recording_is_worked_on_and_reported(run, wide, tmp_path):
    path = copy_recording(wide, tmp_path)
    numbers = np.fromfile(path, np.int8).astype(np.int64) * 12
    np.clip(numbers, -127, 127).astype(np.int8).tofile(path)
    ended = run(path)
    assert ended.code == 0
    assert "saturated: " in ended.remarks(0)
    assert "gain" in ended.remarks(0)
    assert "s were summed" in ended.remarks(0)  # it was worked on  # it was worked on


# --- the sidecar


@pytest.mark.usefixtures("no_tracking")
def test_a_missing_sidecar_is_asked_for(run, tmp_path):
    path = tmp_path / "rx1.bin"
    path.write_bytes(bytes(range(256)))
    assert_refused(run(path), path, "sidecar", tmp_path / "rx1.toml", "rate_hz")


@pytest.mark.usefixtures("no_tracking")
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate_hz", "rate", ["samples.rate ", "rate_hz?"]),
        ("2600000.0", "-2600000.0", ["samples.rate_hz = -2600000.0", "expected"]),
        ('"complex"', '"imaginary"', ['samples.kind = "imaginary"', '"real" or "complex"']),
        ("bits = 1", "bits = 7", ["samples.bits = 7", "expected"]),
        ("[samples]", "[samples", ["not valid TOML", "sidecar"]),
        ("[samples]", "", ["samples ", "[samples]"]),
    ],
)
def test_a_wrong_sidecar_is_refused_by_the_key(run, tmp_path, old, new, words):
    path = tmp_path / "rx1.bin"
    path.write_bytes(bytes(range(256)))
    path.with_suffix(".toml").write_text(SIDECAR.replace(old, new))
    assert_refused(run(path), tmp_path / "rx1.toml", *words)


def test_a_wrong_rate_finds_nothing_and_says_what_to_check(run, pair, tmp_path):
    wrong = copy_recording(pair.paths[0], tmp_path, n_bytes=650_000, rate_hz="2400000.0")
    ended = run(wrong, options=["--json"])
    assert_refused(ended, wrong, "GPS L1 C/A", "1.1 s", "2.4e+06 samples/s", "check rate_hz, if_hz")
    assert not ended.folder.exists()


@pytest.mark.long
def test_nothing_but_noise_in_all_receivers_is_refused(tmp_path):
    silent = [write_noise(tmp_path / f"rx{n}.bin", 0.5, seed=n) for n in (1, 2)]
    with pytest.raises(NotEnoughData, match=r"rx1\.bin, .*rx2\.bin: .*\bGPS L1 C/A\b.*\bantenna\b"):
        protect(silent)


def test_a_deaf_receiver_costs_itself_and_not_the_run(run, pair, tmp_path):
    ended = run(write_noise(tmp_path / "dead.bin"), pair.paths[0], nav=pair.nav)
    assert ended.code == 0
    assert ended.verdict.verdict == "no_attack_seen"  # one receiver alone
    assert "dead" in ended.verdict.summary
    assert re.match(r"left out: .*\bGPS L1 C/A\b.* 6\.0 s", ended.remarks(0))
    assert ended.remarks(1) == ""
    dead, bow = ended.verdict.receivers
    assert (dead.unprotected_fix, dead.duration_s) == (None, 6.0)
    assert bow.unprotected_fix is not None
    assert bow.unprotected_fix.lat_deg == pytest.approx(57.7012, abs=1e-4)


# --- the navigation file


@pytest.mark.usefixtures("no_tracking")
def test_a_navigation_file_of_another_day_is_refused(run, pair, tmp_path):
    write_nav(tmp_path / "old.rnx", make_nominal_constellation(np.datetime64("2024-05-12T10:00:00", "ns")))
    ended = run(*pair.paths, nav=tmp_path / "old.rnx")
    assert_refused(
        ended,
        tmp_path / "old.rnx",
        "2024-05-12T10:00:00 to 2024-05-12T10:00:00",
        f"{pair.paths[0]} was",
        "recorded at 2024-05-14T09:59:5",
        "navigation file",
    )


@pytest.mark.shared_data
@pytest.mark.usefixtures("no_tracking")
def test_a_real_navigation_file_of_another_year_is_refused(run, pair, shared_data):
    nav = shared_data / "real" / "brdc" / "brdc3050.12n"
    assert_refused(run(*pair.paths, nav=nav), nav, "2012-1", "2024-05-14", "day")


@pytest.mark.usefixtures("no_tracking")
@pytest.mark.parametrize("content", [b"", b"hello\n", bytes(range(256)) * 40], ids=["empty", "text", "samples"])
def test_what_is_no_navigation_file_is_refused(run, pair, tmp_path, content):
    (tmp_path / "nav.22n").write_bytes(content)
    assert_refused(run(*pair.paths, nav=tmp_path / "nav.22n"), tmp_path / "nav.22n", "expected", ";")


@pytest.mark.usefixtures("no_tracking")
def test_a_navigation_file_that_is_not_there_is_refused(run, pair, tmp_path):
    assert_refused(run(*pair.paths, nav=tmp_path / "nav.22n"), tmp_path / "nav.22n", "exist")


# --- receivers that do not belong together


@pytest.mark.parametrize(
    "date",
    [
        pytest.param(None, id="true-dates", marks=pytest.mark.long),
        pytest.param('"2024-05-14T09:59:56"', id="the-dates-agree"),
    ],
)
def test_receivers_recorded_at_different_times_are_refused(run, pair, later, tmp_path, date):
    # By the signals' own time: a recorder's date may be wrong, and may hide it.
    other = later.paths[1] if date is None else copy_recording(later.paths[1], tmp_path, start_gpst=date)
    ended = run(pair.paths[0], other, nav=pair.nav)
    assert_refused(
        ended,
        other,
        "2024-05-14T10:04:5",
        pair.paths[0],
        "2024-05-14T09:59:5",
        "common time",
        "same time",
    )


def test_a_wrong_date_is_reported_and_the_signals_time_is_used(run, pair, tmp_path):
    wrong = copy_recording(pair.paths[0], tmp_path, start_gpst='"2024-05-14T08:30:00"')
    ended = run(wrong, nav=pair.nav)
    assert ended.code == 0
    assert "start_gpst is 2024-05-14T08:30:00" in ended.remarks(0)
    assert "is used" in ended.remarks(0)
    assert ended.verdict.receivers[0].start_gpst.startswith("2024-05-14T09:59:56")


@pytest.mark.long
def test_a_date_in_the_wrong_week_yields_to_the_messages_week(run, tmp_path):
    recorded = kit.record(kit.make_scenario(receivers=1, duration_s=10.0), tmp_path)  # subframe 1 is whole after 8.1 s
    wrong = copy_recording(recorded.paths[0], tmp_path / "wrong", start_gpst='"2024-05-07T09:59:58"')
    ended = run(wrong)
    assert ended.code == 0
    assert "+604800.0 s" in ended.remarks(0)
    assert ended.verdict.receivers[0].start_gpst.startswith("2024-05-14T09:59:58")


@pytest.mark.long
def test_a_navigation_file_of_an_unknown_week_is_refused(run, tmp_path):
    recorded = kit.record(kit.make_scenario(receivers=1, duration_s=10.0), tmp_path)
    undated = copy_recording(recorded.paths[0], tmp_path / "undated", start_gpst="")
    write_nav(tmp_path / "old.rnx", make_nominal_constellation(np.datetime64("2005-04-02T21:46:00", "ns")))
    assert_refused(
        run(undated, nav=tmp_path / "old.rnx"),
        f"{undated}: ",
        "week 2314, from 2024-05-12",
        "week 1316, from 2005-03-27",
        "start_gpst",
    )
    assert run(undated, nav=recorded.nav).code == 0


@pytest.mark.usefixtures("no_tracking")
def test_one_recording_given_twice_is_refused(run, pair, tmp_path):
    # It would look like one antenna that feeds both.
    first = pair.paths[0]
    link = tmp_path / "linked.bin"
    link.symlink_to(first)
    shutil.copy(first.with_suffix(".toml"), tmp_path / "linked.toml")
    longer = copy_recording(first, tmp_path, name="copied.bin", n_bytes=4_000_000)
    for again in (first, link, longer):
        assert_refused(run(first, again), again, first, "same")


def test_receivers_in_files_of_one_name_keep_apart(pair, tmp_path):
    paths = []
    for seed, folder in enumerate(map(tmp_path.joinpath, "abc")):
        folder.mkdir()
        paths.append(write_noise(folder / "rx.bin", 0.01, seed=seed))
    assert [s.name for s in open_inputs(paths, Settings())] == ["rx", "rx-2", "rx-3"]


@pytest.mark.long
def test_recordings_that_overlap_in_part_are_compared_there(run, tmp_path):
    scenario = kit.make_scenario(duration_s=9.0, start_gpst=START)
    second = scenario.receivers[1].model_copy(update={"start_offset_s": 4.0})
    recorded = kit.record(scenario.model_copy(update={"receivers": (scenario.receivers[0], second)}), tmp_path)
    ended = run(*recorded.paths, nav=recorded.nav, options=["--antenna-distance-m", f"{kit.DISTANCE_M}"])
    assert ended.code == 0
    assert ended.verdict.verdict == "authentic"
    assert re.search(rf"\d s\b.*{re.escape(str(recorded.paths[1]))}", ended.remarks(0))
    bow, stern = ended.verdict.receivers
    assert bow.trusted_fix is not None
    assert stern.trusted_fix is not None
    apart = np.datetime64(bow.trusted_fix.gpst) - np.datetime64(stern.trusted_fix.gpst)
    assert abs(apart) < np.timedelta64(1, "ms")  # nobody vouches for stern where it was recorded alone


@pytest.mark.long
def test_a_recording_of_any_name_is_read_and_named_legibly(run, wide, tmp_path):
    name = os.fsdecode(b"[x] \xff\x1b[31m%" + b"n" * 230 + b".bin")
    assert len(os.fsencode(name)) >= 245
    path = copy_recording(wide, tmp_path, name=name)
    ended = run(path)
    assert ended.code == 0
    result = "[x] \\xff\\x1b[31m%" + "n" * 230
    assert ended.verdict.inputs[0].path == f"{tmp_path}/{result}.bin"
    assert ended.verdict.receivers[0].name == result[:200]
    assert "\x1b" not in ended.stdout
    assert result[:60] in ended.stdout.replace("\n", "")
    assert cli.main(["receive", str(path), "--out", str(tmp_path / "received"), "--json"]) == 0


# --- too little


def test_a_run_without_a_possible_test_is_an_error_with_advice(run, pair, tmp_path):
    # Whatever it were called, somebody would take it for a test that passed.
    short = [copy_recording(path, tmp_path, n_bytes=3 * 650_000) for path in pair.paths]
    ended = run(*short, nav=pair.nav)
    assert_refused(ended, short[0], "10 signals", "of week", "3.0 s", "12 s", str(short[1]))
    assert not ended.folder.exists()


@pytest.mark.long
def test_a_receiver_without_time_of_week_costs_itself_only(run, pair, tmp_path):
    ended = run(copy_recording(pair.paths[1], tmp_path, n_bytes=2 * 650_000), pair.paths[0], nav=pair.nav)
    assert ended.code == 0
    assert re.match(r"left out: 10 signals\b.*\btime of\b", ended.remarks(0))
    assert "stern" in ended.verdict.summary
    assert ended.verdict.receivers[1].unprotected_fix is not None


def test_without_orbits_what_ran_is_said_and_what_that_leaves(run, pair):
    ended = run(pair.paths[0])
    assert ended.code == 0
    assert ended.verdict.verdict == "no_attack_seen"
    assert "30 s" in ended.verdict.remedy
    assert "orbits" in ended.verdict.not_excluded[0]
    assert {s.label for s in ended.verdict.signals} == {"unknown"}
    assert len(ended.verdict.signals) == 10


# --- the folder


@pytest.mark.usefixtures("no_tracking")
def test_a_folder_that_cannot_be_written_is_refused_first(run, pair, tmp_path):
    (tmp_path / "taken").write_text("a file")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "out"):
        assert_refused(run(*pair.paths, nav=pair.nav, out=folder), folder, "written", "--out")
    assert (tmp_path / "taken").read_text() == "a file"


@pytest.mark.long
def test_the_results_of_two_runs_never_mix(run, wide, tmp_path):
    ended = run(wide)
    mine = ["bow-authentic.obs", "bow-other-2.obs", "bow-trusted.nmea", "nav.rnx"]
    rest = ["notes.obs", "bow-other-than.obs", "mast-authentic.obs"]
    for name in (*mine, *rest):
        (ended.folder / name).write_text("old")
    assert run(wide, options=["--overwrite"]).code == 0
    remaining = {path.name for path in ended.folder.iterdir()}
    assert remaining.isdisjoint(mine)
    assert remaining.issuperset(rest)
