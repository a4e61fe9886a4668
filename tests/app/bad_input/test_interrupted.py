"""Ctrl-C: what is decided so far is written, and no file is half written."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.app import kit
from tests.app.bad_input.common import Watched

from skyproof import cli
from skyproof.cli import protect as protect_command
from skyproof.cli import receive as receive_command
from skyproof.formats.verdict import read_verdict


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
    assert ended.verdict.summary.startswith("Interrupted after 6.5 of 8.0 s; up to then: The signals of ")
    assert ended.verdict.verdict == "undecided"  # an attack can begin after what was read
    assert "it was not read; would decide it: the same command, run to its end" in ended.verdict.undecided_because
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
@pytest.mark.parametrize("press", [("computing checksums", 1.0), ("writing", 2)], ids=["sums", "writing"])
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
