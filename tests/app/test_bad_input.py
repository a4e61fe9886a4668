"""Bad input: one line that names the file, what is wrong and what to do; and what good data allow is not lost."""

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.app import kit

from skyproof import cli
from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import protect
from skyproof.app.receive.inputs import open_inputs
from skyproof.cli import protect as protect_command
from skyproof.cli import receive as receive_command
from skyproof.errors import InputError, NotEnoughData
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.verdict import read_verdict
from skyproof.gnss.nominal import nominal_constellation
from skyproof.simulator.scenario import FrontEnd

START = np.datetime64("2024-05-14T09:59:56.5", "ns")  # a time of week is complete 4.7 s later
SIDECAR = '[samples]\nrate_hz = 2600000.0\nkind = "complex"\nencoding = "sign"\nbits = 1\n'


@pytest.fixture(scope="session")
def pair(tmp_path_factory):
    """Two receivers under a clean sky for 8 s: just enough for a time of week, and for a verdict."""
    return kit.record(kit.scenario_of(duration_s=8.0, start_gpst=START), tmp_path_factory.mktemp("pair"))


@pytest.fixture(autouse=True)
def _quiet(monkeypatch):
    for command in (protect_command, receive_command):
        monkeypatch.setattr(command, "progress", Silent)


@dataclass(frozen=True)
class Ended:
    """How a command line ended."""

    code: int
    stdout: str
    stderr: list[str]
    folder: Path

    @property
    def verdict(self):
        return read_verdict(self.folder / "verdict.json")

    def remarks(self, number: int) -> str:
        return "; ".join(self.verdict.inputs[number].remarks)


@pytest.fixture
def run(capsys, tmp_path):
    def run(*inputs, nav=None, out=None, options=()):
        folder = out or tmp_path / "out"
        argv = ["protect", *map(str, inputs), "--out", str(folder), *options]
        code = cli.main(argv + (["--nav", str(nav)] if nav is not None else []))
        reported = capsys.readouterr()
        return Ended(code, reported.out, reported.err.splitlines(), folder)

    return run


def assert_refused(ended: Ended, *words: object) -> None:
    """Exit code 2, nothing on standard output, one line on standard error with all these words in it."""
    assert ended.code == 2
    assert ended.stdout == ""
    assert len(ended.stderr) == 1
    assert ended.stderr[0].startswith("skyproof: ")
    for word in words:
        assert str(word) in ended.stderr[0]


def copied(path: Path, folder: Path, *, name: str | None = None, n_bytes: int | None = None, **keys: str) -> Path:
    """A recording and its sidecar in another folder, cut or with other keys if wanted."""
    folder.mkdir(exist_ok=True)
    copy = folder / (name or path.name)
    data = path.read_bytes()
    copy.write_bytes(data[:n_bytes])
    lines = path.with_suffix(".toml").read_text().splitlines()
    kept = [line for line in lines if line.split(" = ")[0] not in keys]
    text = "\n".join(kept + [f"{key} = {value}" for key, value in keys.items() if value])
    copy.with_suffix(".toml").write_text(text + "\n")
    return copy


def noise(path: Path, duration_s: float = 6.0, *, seed: int = 5) -> Path:
    """A recording of an antenna that is not connected."""
    path.write_bytes(np.random.default_rng(seed).bytes(int(duration_s * 2_600_000) // 4))
    path.with_suffix(".toml").write_text(SIDECAR)
    return path


@pytest.fixture
def untracked(monkeypatch):
    """Fails the test if the long work begins."""
    too_early = "the long work began before the check"
    monkeypatch.setattr("skyproof.app.protect.run.track", lambda *_: pytest.fail(too_early))


# --- the file


@pytest.mark.usefixtures("untracked")
def test_an_empty_file_is_refused(run, tmp_path):
    path = tmp_path / "rx1.bin"
    path.write_bytes(b"")
    path.with_suffix(".toml").write_text(SIDECAR)
    assert_refused(run(path), path, "is empty", "check the recorder or the copy")


@pytest.mark.usefixtures("untracked")
def test_a_file_that_is_not_there_is_refused(run, tmp_path):
    assert_refused(run(tmp_path / "rx1.bin"), tmp_path / "rx1.bin", "does not exist", "check the name")
    assert_refused(run(tmp_path), tmp_path, "is not a regular file", "give the file")


@pytest.mark.usefixtures("untracked")
def test_no_file_at_all_is_refused():
    with pytest.raises(InputError, match="no input given; give one per receiver"):
        protect([])


@pytest.mark.usefixtures("untracked")
def test_zeros_are_refused(run, tmp_path):
    path = tmp_path / "rx1.bin"
    path.write_bytes(bytes(100_000))
    path.with_suffix(".toml").write_text(SIDECAR.replace('"sign"', '"int"').replace("bits = 1", "bits = 8"))
    assert_refused(run(path), path, "all samples are zero", "check the recorder")


@pytest.fixture(scope="session")
def wide(tmp_path_factory):
    """A second of one receiver in 8-bit numbers."""
    front_end = FrontEnd(encoding="int", bits=8)
    scenario = kit.scenario_of(receivers=1, duration_s=1.0, front_end=front_end)
    return kit.record(scenario, tmp_path_factory.mktemp("wide")).paths[0]


@pytest.mark.long
def test_an_odd_byte_at_the_end_is_left_out_and_reported(run, wide, tmp_path):
    cut = copied(wide, tmp_path, n_bytes=wide.stat().st_size - 1)
    ended = run(cut)
    assert ended.code == 0
    assert "the last 1 bytes are less than one sample" in ended.remarks(0)
    assert "the file is cut" in ended.remarks(0)
    assert "signals found" in ended.remarks(0)  # it was worked on


@pytest.mark.long
def test_a_saturated_recording_is_worked_on_and_reported(run, wide, tmp_path):
    path = copied(wide, tmp_path)
    numbers = np.fromfile(path, np.int8).astype(np.int64) * 12
    np.clip(numbers, -127, 127).astype(np.int8).tofile(path)
    ended = run(path)
    assert ended.code == 0
    assert "saturated: " in ended.remarks(0)
    assert "lower the gain" in ended.remarks(0)
    assert "signals found" in ended.remarks(0)


# --- the sidecar


@pytest.mark.usefixtures("untracked")
def test_a_missing_sidecar_is_asked_for(run, tmp_path):
    path = tmp_path / "rx1.bin"
    path.write_bytes(bytes(range(256)))
    assert_refused(run(path), path, f"there is no sidecar {tmp_path / 'rx1.toml'}", "write it with the keys", "rate_hz")


@pytest.mark.usefixtures("untracked")
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate_hz", "rate", ["samples.rate is not a known key", "did you mean rate_hz?"]),
        ("2600000.0", "-2600000.0", ["samples.rate_hz = -2600000.0", "expected"]),
        ('"complex"', '"imaginary"', ['samples.kind = "imaginary"', 'expected "real" or "complex"']),
        ("bits = 1", "bits = 7", ["samples.bits = 7", "expected"]),
        ("[samples]", "[samples", ["not valid TOML", "a sidecar reads like"]),
        ("[samples]", "", ["samples is missing", "put it below the line [samples]"]),
    ],
)
def test_a_wrong_sidecar_is_refused_by_the_key(run, tmp_path, old, new, words):
    path = tmp_path / "rx1.bin"
    path.write_bytes(bytes(range(256)))
    path.with_suffix(".toml").write_text(SIDECAR.replace(old, new))
    assert_refused(run(path), tmp_path / "rx1.toml", *words)


def test_a_wrong_rate_finds_nothing_and_says_what_to_check(run, pair, tmp_path):
    wrong = copied(pair.paths[0], tmp_path, n_bytes=650_000, rate_hz="2400000.0")
    ended = run(wrong, options=["--json"])
    assert_refused(ended, wrong, "no GPS L1 C/A signal found in 1.1 s", "2.4e+06 samples/s", "check rate_hz, if_hz")
    assert list(ended.folder.iterdir()) == []


@pytest.mark.long
def test_nothing_but_noise_in_all_receivers_is_refused(tmp_path):
    silent = [noise(tmp_path / f"rx{n}.bin", 0.5, seed=n) for n in (1, 2)]
    with pytest.raises(NotEnoughData, match=r"rx1\.bin, .*rx2\.bin: no GPS L1 C/A signal .*antenna was connected"):
        protect(silent)


def test_a_receiver_that_hears_nothing_costs_itself_and_not_the_run(run, pair, tmp_path):
    ended = run(noise(tmp_path / "dead.bin"), pair.paths[0], nav=pair.nav)
    assert ended.code == 0
    assert ended.verdict.verdict == "undecided"  # one receiver alone
    assert ended.verdict.summary.endswith(
        " Without dead, which gave no measurements (the remarks on the inputs say why)."
    )
    assert "left out: no GPS L1 C/A signal found in 6.0 s" in ended.remarks(0)
    assert ended.remarks(1) == ""
    dead, bow = ended.verdict.receivers
    assert (dead.unprotected_fix, dead.duration_s) == (None, 6.0)
    assert bow.unprotected_fix is not None
    assert bow.unprotected_fix.lat_deg == pytest.approx(57.7012, abs=1e-4)


# --- the navigation file


@pytest.mark.usefixtures("untracked")
def test_a_navigation_file_of_another_day_is_refused(run, pair, tmp_path):
    write_nav(tmp_path / "old.rnx", nominal_constellation(np.datetime64("2024-05-12T10:00:00", "ns")))
    ended = run(*pair.paths, nav=tmp_path / "old.rnx")
    assert_refused(
        ended,
        tmp_path / "old.rnx",
        "are for 2024-05-12T10:00:00 to 2024-05-12T10:00:00",
        f"{pair.paths[0]} was",
        "recorded at 2024-05-14T09:59:5",
        "give the navigation file of that day",
    )


@pytest.mark.shared_data
@pytest.mark.usefixtures("untracked")
def test_a_real_navigation_file_of_another_year_is_refused(run, pair, shared_data):
    nav = shared_data / "real" / "brdc" / "brdc3050.12n"
    assert_refused(run(*pair.paths, nav=nav), nav, "2012-1", "was recorded at 2024-05-14", "of that day")


@pytest.mark.usefixtures("untracked")
@pytest.mark.parametrize("content", [b"", b"hello\n", bytes(range(256)) * 40], ids=["empty", "text", "samples"])
def test_what_is_no_navigation_file_is_refused(run, pair, tmp_path, content):
    (tmp_path / "nav.22n").write_bytes(content)
    assert_refused(run(*pair.paths, nav=tmp_path / "nav.22n"), tmp_path / "nav.22n", "expected", ";")


@pytest.mark.usefixtures("untracked")
def test_a_navigation_file_that_is_not_there_is_refused(run, pair, tmp_path):
    assert_refused(run(*pair.paths, nav=tmp_path / "nav.22n"), tmp_path / "nav.22n", "cannot be read")


# --- receivers that do not belong together


@pytest.fixture(scope="session")
def later(tmp_path_factory):
    """The same scene five minutes later."""
    start = START + np.timedelta64(300, "s")
    return kit.record(kit.scenario_of(duration_s=7.0, start_gpst=start), tmp_path_factory.mktemp("later"))


@pytest.mark.parametrize(
    "date",
    [
        pytest.param(None, id="true-dates", marks=pytest.mark.long),
        pytest.param('"2024-05-14T09:59:56"', id="the-dates-agree"),
    ],
)
def test_receivers_recorded_at_different_times_are_refused(run, pair, later, tmp_path, date):
    """By the signals' own time: a recorder's date may be wrong, and may hide it."""
    other = later.paths[1] if date is None else copied(later.paths[1], tmp_path, start_gpst=date)
    ended = run(pair.paths[0], other, nav=pair.nav)
    assert_refused(
        ended,
        f"{other} was recorded from 2024-05-14T10:04:5",
        f"but {pair.paths[0]} from 2024-05-14T09:59:5",
        "no common time",
        "give recordings of the same time",
    )


def test_a_wrong_date_is_reported_and_the_signals_time_is_used(run, pair, tmp_path):
    wrong = copied(pair.paths[0], tmp_path, start_gpst='"2024-05-14T08:30:00"')
    ended = run(wrong, nav=pair.nav)
    assert ended.code == 0
    assert "start_gpst is 2024-05-14T08:30:00" in ended.remarks(0)
    assert "the signals' time is used" in ended.remarks(0)
    assert ended.verdict.receivers[0].start_gpst.startswith("2024-05-14T09:59:56")


@pytest.mark.long
def test_a_date_in_the_wrong_week_is_reported_and_the_messages_week_is_used(run, tmp_path):
    recorded = kit.record(kit.scenario_of(receivers=1, duration_s=10.0), tmp_path)  # subframe 1 is whole after 8.1 s
    wrong = copied(recorded.paths[0], tmp_path / "wrong", start_gpst='"2024-05-07T09:59:58"')
    ended = run(wrong)
    assert ended.code == 0
    assert "differs from it by +604800.0 s; the signals' time is used" in ended.remarks(0)
    assert ended.verdict.receivers[0].start_gpst.startswith("2024-05-14T09:59:58")


@pytest.mark.usefixtures("untracked")
def test_one_recording_given_twice_is_refused(run, pair, tmp_path):
    """It would look like one antenna that feeds both."""
    first = pair.paths[0]
    link = tmp_path / "linked.bin"
    link.symlink_to(first)
    shutil.copy(first.with_suffix(".toml"), tmp_path / "linked.toml")
    longer = copied(first, tmp_path, name="copied.bin", n_bytes=4_000_000)
    for again in (first, link, longer):
        assert_refused(run(first, again), again, f"the same recording as {first}", "give each receiver's own recording")


def test_receivers_in_files_of_one_name_keep_apart(pair, tmp_path):
    paths = []
    for seed, folder in enumerate(map(tmp_path.joinpath, "abc")):
        folder.mkdir()
        paths.append(noise(folder / "rx.bin", 0.01, seed=seed))
    assert [s.name for s in open_inputs(paths, Settings())] == ["rx", "rx-2", "rx-3"]


@pytest.mark.long
def test_recordings_that_overlap_in_part_are_compared_in_that_part(run, tmp_path):
    scenario = kit.scenario_of(duration_s=9.0, start_gpst=START)
    second = scenario.receivers[1].model_copy(update={"start_offset_s": 4.0})
    recorded = kit.record(scenario.model_copy(update={"receivers": (scenario.receivers[0], second)}), tmp_path)
    ended = run(*recorded.paths, nav=recorded.nav, options=["--antenna-distance-m", f"{kit.DISTANCE_M}"])
    assert ended.code == 0
    assert ended.verdict.verdict == "authentic"
    assert f"s with measurements are common with {recorded.paths[1]}" in ended.remarks(0)
    bow, stern = ended.verdict.receivers
    assert bow.trusted_fix is not None
    assert stern.trusted_fix is not None
    assert np.datetime64(bow.trusted_fix.gpst) < np.datetime64(stern.trusted_fix.gpst) - np.timedelta64(3, "s")


@pytest.mark.long
def test_a_recording_of_any_name_is_worked_on_and_named_so_that_it_can_be_read(run, wide, tmp_path):
    name = os.fsdecode(b"[x] \xff\x1b[31m%" + b"n" * 230 + b".bin")
    assert len(os.fsencode(name)) >= 245
    path = copied(wide, tmp_path, name=name)
    ended = run(path)
    assert ended.code == 0
    shown = "[x] \\xff\\x1b[31m%" + "n" * 230
    assert ended.verdict.inputs[0].path == f"{tmp_path}/{shown}.bin"
    assert ended.verdict.receivers[0].name == shown[:200]
    assert "\x1b" not in ended.stdout
    assert shown[:60] in ended.stdout.replace("\n", "")
    assert cli.main(["receive", str(path), "--out", str(tmp_path / "received"), "--json"]) == 0


# --- too little


def test_without_a_time_of_week_it_is_undecided_and_says_what_is_missing(run, pair, tmp_path):
    short = [copied(path, tmp_path, n_bytes=3 * 650_000) for path in pair.paths]
    ended = run(*short, nav=pair.nav)
    assert ended.code == 0
    assert ended.verdict.verdict == "undecided"
    because = ended.verdict.undecided_because
    assert "bow: 10 signals found, but no time of week read from them in 3.0 s: give 12 s of signal or more" in because
    assert ended.verdict.methods
    assert not any(m.ran for m in ended.verdict.methods)
    assert all(m.would_need for m in ended.verdict.methods)
    assert {"report.html", "verdict.json", "fixes.csv"} <= {p.name for p in ended.folder.iterdir()}


@pytest.mark.long
def test_a_receiver_without_a_time_of_week_costs_itself_and_not_the_run(run, pair, tmp_path):
    ended = run(copied(pair.paths[1], tmp_path, n_bytes=2 * 650_000), pair.paths[0], nav=pair.nav)
    assert ended.code == 0
    assert "left out: 10 signals found, but no time of week" in ended.remarks(0)
    assert "Without stern" in ended.verdict.summary
    assert ended.verdict.receivers[1].unprotected_fix is not None


def test_without_orbits_it_is_undecided_and_says_so(run, pair):
    ended = run(pair.paths[0])
    assert ended.code == 0
    assert ended.verdict.verdict == "undecided"
    assert "a navigation file, or 30 s of signals" in ended.verdict.undecided_because
    assert {s.label for s in ended.verdict.signals} == {"unknown"}
    assert len(ended.verdict.signals) == 10


# --- the folder


@pytest.mark.usefixtures("untracked")
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(run, pair, tmp_path):
    (tmp_path / "taken").write_text("a file")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "out"):
        assert_refused(run(*pair.paths, nav=pair.nav, out=folder), folder, "cannot be written", "--out")
    assert (tmp_path / "taken").read_text() == "a file"


@pytest.mark.long
def test_the_results_of_two_runs_never_mix(run, wide, tmp_path):
    ended = run(wide)
    mine = ["bow-authentic.obs", "bow-other-2.obs", "bow-trusted.nmea", "nav.rnx"]
    others = ["notes.obs", "bow-other-than.obs", "mast-authentic.obs"]
    for name in (*mine, *others):
        (ended.folder / name).write_text("old")
    run(wide)
    left = {path.name for path in ended.folder.iterdir()}
    assert left.isdisjoint(mine)
    assert left.issuperset(others)


# --- files that change while they are worked on


class Watched:
    """Progress of a run, stage by stage, that shows nothing."""

    name = ""

    def say(self, text: str) -> None:
        pass

    @contextmanager
    def stage(self, name, total):
        self.name = name
        yield self


class Meddling(Watched):
    """Something happens to a file when `after` seconds of all recordings are tracked."""

    def __init__(self, after: float, meddle) -> None:
        self.after, self.meddle = after, meddle

    def advance(self, to: float) -> None:
        if self.name.startswith("tracking") and to >= self.after and self.meddle is not None:
            meddle, self.meddle = self.meddle, None
            meddle()


@pytest.fixture
def meddled(run, pair, tmp_path, monkeypatch):
    """A run on copies of the pair while something happens to the second one, and the first one's sum."""

    def meddled(meddle, after=13.0):
        first, second = (copied(path, tmp_path) for path in pair.paths)
        nav = shutil.copy(pair.nav, tmp_path)
        monkeypatch.setattr(protect_command, "progress", lambda: Meddling(after, lambda: meddle(second, Path(nav))))
        return run(first, second, nav=nav, options=["--antenna-distance-m", f"{kit.DISTANCE_M}"])

    return meddled


def test_a_recording_that_is_cut_while_it_is_worked_on_counts_as_far_as_it_was_read(meddled, pair):
    ended = meddled(lambda path, _: os.truncate(path, 4_500_000))
    assert ended.code == 0
    assert {signal.receiver for signal in ended.verdict.signals} == {"bow", "stern"}
    assert [r.duration_s for r in ended.verdict.receivers] == [8.0, 6.5]
    words = "only its first 6.5 s were processed: .*stern.bin ends after 4500000 bytes, but had 5200000 when it was"
    assert re.search(words, ended.remarks(1))
    n_summed = int(re.search(r"the checksum is of the first (\d+)", ended.remarks(1))[1])
    assert 4_225_000 <= n_summed <= 4_500_000
    assert ended.verdict.inputs[1].sha256 == hashlib.sha256(pair.paths[1].read_bytes()[:n_summed]).hexdigest()


def test_a_recording_that_is_cut_at_once_is_left_out(meddled):
    ended = meddled(lambda path, _: os.truncate(path, 0), after=1.0)
    assert ended.code == 0
    assert "Without stern" in ended.verdict.summary
    assert "ends after" in ended.remarks(1)


def test_inputs_that_are_deleted_while_they_are_worked_on_cost_nothing(meddled, pair):
    ended = meddled(lambda path, nav: (path.unlink(), nav.unlink()))
    assert ended.code == 0
    assert {signal.receiver for signal in ended.verdict.signals} == {"bow", "stern"}
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (*pair.paths, pair.nav)]
    assert [one.sha256 for one in ended.verdict.inputs] == sums
    assert "deleted or replaced while it was processed" in ended.remarks(1)


@pytest.mark.long
def test_files_of_a_run_that_was_killed_while_they_appeared_do_not_outlive_the_next(run, wide):
    ended = run(wide)
    names = {path.name for path in ended.folder.iterdir()}
    left = ended.folder / ".skyproof-unfinished"  # the verdict comes last, so that it is left here
    left.mkdir()
    (left / "verdict.json").write_text((ended.folder / "verdict.json").read_text().replace('"bow"', '"mast"'))
    (ended.folder / "verdict.json").unlink()
    for name in ("mast-authentic.obs", "mast-other-2.obs", "notes.obs"):
        (ended.folder / name).write_text("old")
    run(wide)
    assert {path.name for path in ended.folder.iterdir()} == names | {"notes.obs"}


# --- Ctrl-C


class Interrupting(Watched):
    """A user watches who presses Ctrl-C in stage `name`, when `after` of it is done."""

    def __init__(self, *presses: tuple[str, float]) -> None:
        self.presses = list(presses)

    def advance(self, to: float) -> None:
        for press in self.presses:
            if self.name.startswith(press[0]) and to >= press[1]:
                self.presses.remove(press)
                raise KeyboardInterrupt


def assert_whole(folder: Path) -> None:
    """No file is half written."""
    assert [p.name for p in folder.iterdir() if p.name.startswith(".") or p.name.endswith(".part")] == []
    if (folder / "verdict.json").exists():
        read_verdict(folder / "verdict.json")


def test_ctrl_c_writes_what_is_decided_so_far(run, pair, monkeypatch):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("tracking", 13.0)))
    ended = run(*pair.paths, nav=pair.nav, options=["--json", "--antenna-distance-m", f"{kit.DISTANCE_M}"])
    assert ended.code == 130
    assert ended.stderr == ["skyproof: interrupted: this is what was decided so far"]
    assert json.loads(ended.stdout) == json.loads((ended.folder / "verdict.json").read_text())
    assert ended.verdict.summary.startswith("Interrupted; of what was read until then: ")
    assert ended.verdict.verdict == "authentic"
    assert [r.duration_s for r in ended.verdict.receivers] == [6.5, 6.5]
    assert "6.5 of 8.0 s were processed before the run was interrupted" in ended.remarks(1)
    assert (ended.folder / "report.html").exists()
    assert_whole(ended.folder)


def test_ctrl_c_at_once_decides_nothing_and_says_so(run, pair, monkeypatch):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("tracking", 2.0)))
    ended = run(*pair.paths, nav=pair.nav, options=["--json", "--antenna-distance-m", f"{kit.DISTANCE_M}"])
    assert ended.code == 130
    assert json.loads(ended.stdout)["verdict"] == "undecided"
    assert "no time of week" in ended.verdict.undecided_because
    assert_whole(ended.folder)


def test_ctrl_c_while_windows_are_examined_keeps_those_that_were(run, pair, monkeypatch):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("examining", 1)))
    ended = run(pair.paths[0], nav=pair.nav)
    assert ended.code == 130
    assert ended.verdict.summary.startswith("Interrupted")
    assert [m.ran for m in ended.verdict.methods if m.detector == "second_signals"] == [True]
    assert_whole(ended.folder)


@pytest.mark.long
@pytest.mark.parametrize("press", [("taking the sums", 1.0), ("writing", 2)], ids=["sums", "writing"])
def test_ctrl_c_after_the_decision_does_not_lose_it(run, wide, monkeypatch, press):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(press))
    ended = run(wide)
    assert ended.code == 130
    assert not ended.verdict.summary.startswith("Interrupted")
    assert (ended.folder / "report.html").exists()
    assert_whole(ended.folder)


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (("examining", 1), "nothing was decided, and nothing written"),
        (("writing", 2), "the verdict is 'undecided', but its files were not written; .*out is as it was"),
    ],
    ids=["deciding", "writing"],
)
def test_a_second_ctrl_c_ends_it_and_leaves_no_half_file(run, wide, monkeypatch, second, words):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("tracking", 0.5), second))
    ended = run(wide, options=["--json"])
    assert ended.code == 130
    assert ended.stdout == ""
    assert len(ended.stderr) == 1
    assert re.search(f"skyproof: interrupted a second time: {words}", ended.stderr[0])
    assert not (ended.folder / "report.html").exists()
    assert_whole(ended.folder)


@pytest.mark.parametrize(
    ("presses", "err"),
    [
        ([("tracking", 1.0)], "interrupted: this is what was received so far"),
        (
            [("tracking", 6.0), ("writing", 1)],
            "interrupted a second time, before what was received .*; .* is as it was",
        ),
    ],
    ids=["once", "twice"],
)
def test_ctrl_c_while_receiving_keeps_what_was_received(pair, tmp_path, capsys, monkeypatch, presses, err):
    watched = Interrupting(*presses)
    monkeypatch.setattr(receive_command, "progress", lambda: watched)

    def write_channels(*_):
        with watched.stage("writing", 1.0) as stage:
            stage.advance(1.0)

    monkeypatch.setattr("skyproof.app.receive.run.write_channels", write_channels)
    assert cli.main(["receive", str(pair.paths[0]), "--out", str(tmp_path)]) == 130
    assert re.search(err, capsys.readouterr().err.splitlines()[-1])
    assert_whole(tmp_path)


@pytest.mark.long
def test_a_real_ctrl_c_ends_the_program_in_order(pair, tmp_path):
    command = [
        sys.executable,
        "-c",
        "import sys; from skyproof.cli import main; sys.exit(main())",
        "protect",
        *map(str, pair.paths),
        "--nav",
        str(pair.nav),
        "--out",
        str(tmp_path),
        "--json",
    ]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"NUMBA_NUM_THREADS": "1"},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored where these tests run in background
    )
    while "tracking" not in (line := process.stderr.readline()):
        assert line
    time.sleep(0.5)  # 16 s of samples take some 2 s
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert json.loads(out) == json.loads((tmp_path / "verdict.json").read_text())
    assert_whole(tmp_path)
