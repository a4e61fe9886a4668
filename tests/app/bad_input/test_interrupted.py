"""Ctrl-C, SIGTERM, SIGHUP: what is decided so far is written, and no file is half written."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.app import kit
from tests.app.bad_input.common import Watched

from skyproof import cli
from skyproof.cli import protect as protect_command
from skyproof.cli import receive as receive_command
from skyproof.formats.verdict import read_verdict


class Interrupting(Watched):
    """A user watches who sends a signal in stage `name`, when `after` of it is done; a second one counts at once."""

    def __init__(self, *presses: tuple[str, float], number: signal.Signals = signal.SIGTERM) -> None:
        self.presses = list(presses)
        self.number = number

    def advance(self, to: float) -> None:
        for press in self.presses:
            if self.name.startswith(press[0]) and to >= press[1]:
                self.presses.remove(press)
                signal.raise_signal(self.number)


@pytest.fixture(autouse=True)
def no_pairs(monkeypatch):
    monkeypatch.setattr("skyproof.interruption.PAIR_S", 0.0)


def assert_whole(folder: Path) -> None:
    """Check that the folder holds no half-written file."""
    assert [p.name for p in folder.iterdir() if p.name.startswith(".") or p.name.endswith(".part")] == []
    if (folder / "verdict.json").exists():
        read_verdict(folder / "verdict.json")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_writes_what_is_decided_so_far(run, pair, monkeypatch, number, code):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("tracking", 13.0), number=number))
    ended = run(*pair.paths, nav=pair.nav, options=["--json", "--antenna-distance-m", f"{kit.DISTANCE_M}"])
    assert ended.code == code
    assert [line.partition(": ")[2].partition(":")[0] for line in ended.stderr] == ["interrupted"]
    assert json.loads(ended.stdout) == json.loads((ended.folder / "verdict.json").read_text())
    assert re.match(r"Interrupted .*\b6\.5 of 8\.0 s\b", ended.verdict.summary)
    assert ended.verdict.verdict == "no_attack_seen"  # an attack can begin after what was read
    assert ended.verdict.reason is not None
    assert ended.verdict.reason.endswith(" 6.5 of 8.0 s")
    (after,) = ended.verdict.not_excluded
    assert after.endswith(" 6.5 of 8.0 s")
    assert ended.verdict.remedy
    assert [r.duration_s for r in ended.verdict.receivers] == [6.5, 6.5]
    assert "6.5 of 8.0 s" in ended.remarks(1)
    assert (ended.folder / "report.html").exists()
    assert_whole(ended.folder)


def test_a_signal_before_any_test_writes_nothing_and_says_so(run, pair, monkeypatch):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("tracking", 2.0)))
    ended = run(*pair.paths, nav=pair.nav, options=["--json", "--antenna-distance-m", f"{kit.DISTANCE_M}"])
    assert ended.code == 143
    assert ended.stdout == ""
    assert re.search(r"\bbefore\b.*\bnothing was\b.*: .*\btime of\b", ended.stderr[0])
    assert not ended.folder.exists()


def test_a_signal_during_examination_keeps_the_windows_so_far(run, pair, monkeypatch, tmp_path):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("examining", 1)))
    (tmp_path / "short.toml").write_text("[protect]\nwindow_s = 2.0\n")
    ended = run(pair.paths[0], nav=pair.nav, options=["--platform", str(tmp_path / "short.toml")])
    assert ended.code == 143
    assert ended.verdict.summary.startswith("Interrupted")
    assert [m.ran for m in ended.verdict.methods if m.detector == "second_signals"] == [True]
    assert_whole(ended.folder)


@pytest.mark.long
@pytest.mark.parametrize("press", [("computing checksums", 1.0), ("writing", 2)], ids=["sums", "writing"])
def test_a_signal_after_the_decision_does_not_lose_it(run, pair, monkeypatch, press):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(press))
    ended = run(pair.paths[0], nav=pair.nav)
    assert ended.code == 143
    assert not ended.verdict.summary.startswith("Interrupted")
    assert (ended.folder / "report.html").exists()
    assert_whole(ended.folder)


@pytest.mark.parametrize(
    ("second", "words", "written"),
    [
        (("examining", 1), "nothing", None),
        (
            ("writing", 2),
            r"'no_attack_seen'.*\bnot all\b.*out",
            ["report.html", "verdict.json"],
        ),
    ],
    ids=["deciding", "writing"],
)
def test_a_second_signal_ends_it_and_leaves_no_half_file(run, pair, monkeypatch, second, words, written):
    monkeypatch.setattr(protect_command, "progress", lambda: Interrupting(("tracking", 6.5), second))
    ended = run(pair.paths[0], nav=pair.nav, options=["--json"])
    assert ended.code == 143
    assert ended.stdout == ""
    assert len(ended.stderr) == 1
    assert re.match(f"skyproof: interrupted .*second.*{words}", ended.stderr[0])
    if written is None:
        assert not ended.folder.exists()
    else:
        assert sorted(path.name for path in ended.folder.iterdir()) == written
        assert_whole(ended.folder)


@pytest.mark.parametrize(
    ("presses", "err"),
    [
        ([("tracking", 1.0)], r"interrupted: .*\breceived"),
        ([("tracking", 6.0), ("writing", 1)], r"interrupted a second.*nothing"),
    ],
    ids=["once", "twice"],
)
def test_a_signal_while_receiving_keeps_what_was_received(pair, tmp_path, capsys, monkeypatch, presses, err):
    watched = Interrupting(*presses)
    monkeypatch.setattr(receive_command, "progress", lambda: watched)

    def write_channels(*_):
        with watched.stage("writing", 1.0) as stage:
            stage.advance(1.0)

    monkeypatch.setattr("skyproof.app.receive.run.write_channels", write_channels)
    assert cli.main(["receive", str(pair.paths[0]), "--out", str(tmp_path)]) == 143
    assert re.search(err, capsys.readouterr().err.splitlines()[-1])
    assert_whole(tmp_path)


def start_run(*arguments: str | Path) -> subprocess.Popen:
    """Start the command line in a process of its own and wait until it examines what it tracked."""
    process = subprocess.Popen(
        [sys.executable, "-c", "import sys; from skyproof.cli import main; sys.exit(main())", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"NUMBA_NUM_THREADS": "1"},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # ignored where these tests run in background
    )
    while "examining" not in (line := process.stderr.readline()):
        assert line
    return process


@pytest.mark.long
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_real_signal_ends_the_program_in_order(pair, tmp_path, number, code):
    process = start_run("protect", *pair.paths, "--nav", pair.nav, "--out", tmp_path, "--json")
    for _ in range(1 if number == signal.SIGINT else 2):  # a pair that no person sent is one wish
        process.send_signal(number)
    out, err = process.communicate(timeout=300)
    assert process.returncode == code
    assert "Traceback" not in err
    assert json.loads(out) == json.loads((tmp_path / "verdict.json").read_text())
    assert_whole(tmp_path)


@pytest.mark.long
def test_a_closed_terminal_does_not_lose_the_answer(pair, tmp_path):
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", "import sys; from skyproof.cli import main; sys.exit(main())"]
        + ["protect", *map(str, pair.paths), "--nav", str(pair.nav), "--out", str(tmp_path / "out")],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
    )
    os.close(theirs)
    output = b""
    while b"examining" not in output:
        output += os.read(ours, 1000)
    os.close(ours)
    process.send_signal(signal.SIGHUP)  # the terminal is nobody's here, so that the kernel sends none
    assert process.wait(300) == 129
    assert read_verdict(tmp_path / "out" / "verdict.json")
    assert_whole(tmp_path / "out")
