"""Files that change while they are worked on, or were left by a run that was killed."""

import hashlib
import os
import re
import shutil
from pathlib import Path

import pytest
from tests.app import kit
from tests.app.bad_input.common import Watched, copy_recording

from skyproof.cli import protect as protect_command


class Meddling(Watched):
    """Something happens to a file when `after` seconds of all recordings are tracked."""

    def __init__(self, after: float, meddle) -> None:
        self.after, self.meddle = after, meddle

    def advance(self, to: float) -> None:
        if self.name.startswith("tracking") and to >= self.after and self.meddle is not None:
            meddle, self.meddle = self.meddle, None
            meddle()


@pytest.fixture
def run_meddled(run, pair, tmp_path, monkeypatch):
    """Return a function that runs the command on copies of the pair while the second file changes."""

    def meddled(meddle, after=13.0):
        first, second = (copy_recording(path, tmp_path) for path in pair.paths)
        nav = shutil.copy(pair.nav, tmp_path)
        monkeypatch.setattr(protect_command, "progress", lambda: Meddling(after, lambda: meddle(second, Path(nav))))
        return run(first, second, nav=nav, options=["--antenna-distance-m", f"{kit.DISTANCE_M}"])

    return meddled


def test_a_recording_cut_while_read_counts_as_far_as_it_was_read(run_meddled, pair):
    ended = run_meddled(lambda path, _: os.truncate(path, 4_600_000))  # behind the block that is read ahead
    assert ended.code == 0
    assert {signal.receiver for signal in ended.verdict.signals} == {"bow", "stern"}
    assert [r.duration_s for r in ended.verdict.receivers] == [8.0, 7.0]
    assert ended.verdict.verdict == "no_attack_seen"
    assert [bool(item.cut) for item in ended.verdict.inputs[:2]] == [False, True]
    assert "Cut: " in ended.stdout
    words = r" 7\.0 s .*stern\.bin .*\b4600000 bytes, .*\b5200000\b"
    assert re.search(words, ended.remarks(1))
    n_summed = int(re.search(r"the checksum is of the first (\d+)", ended.remarks(1))[1])
    assert 4_550_000 <= n_summed <= 4_600_000
    assert ended.verdict.inputs[1].sha256 == hashlib.sha256(pair.paths[1].read_bytes()[:n_summed]).hexdigest()


def test_a_recording_that_is_cut_at_once_is_left_out(run_meddled):
    ended = run_meddled(lambda path, _: os.truncate(path, 0), after=1.0)
    assert ended.code == 0
    assert "stern" in ended.verdict.summary
    assert "ends after" in ended.remarks(1)


def test_inputs_deleted_while_they_are_read_cost_nothing(run_meddled, pair):
    ended = run_meddled(lambda path, nav: (path.unlink(), nav.unlink()))
    assert ended.code == 0
    assert {signal.receiver for signal in ended.verdict.signals} == {"bow", "stern"}
    read = (*pair.paths, *(path.with_suffix(".toml") for path in pair.paths), pair.nav)
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in read]
    assert [item.sha256 for item in ended.verdict.inputs] == sums
    assert "replaced" in ended.remarks(1)


def test_a_recording_that_grows_while_read_is_not_authentic(run_meddled):
    def append(path, _):
        with open(path, "ab") as file:
            file.write(b"more")

    ended = run_meddled(append)
    assert ended.verdict.verdict == "no_attack_seen"
    assert [bool(item.cut) for item in ended.verdict.inputs[:2]] == [False, True]
    assert re.search(r"\bgrown\b.*\b4 bytes", ended.remarks(1))


@pytest.mark.long
def test_files_of_a_killed_run_do_not_outlive_the_next(run, wide):
    ended = run(wide)
    names = {path.name for path in ended.folder.iterdir()}
    remaining = ended.folder / ".skyproof-unfinished"  # what is replaced is kept here until all of the new is there
    remaining.mkdir()
    (remaining / "replaced-verdict.json").write_text(
        (ended.folder / "verdict.json").read_text().replace('"bow"', '"mast"')
    )
    for name in ("mast-authentic.obs", "mast-other-2.obs", "notes.obs"):
        (ended.folder / name).write_text("old")
    again = run(wide, options=["--overwrite"])
    assert again.code == ended.code, again.stderr
    assert {path.name for path in ended.folder.iterdir()} == names | {"notes.obs"}
