"""Progress: bars at a terminal, a line a stage in a pipe, nothing on standard output."""

import contextlib
import os
import pty
import re
import subprocess
import sys

import pytest
from tests.cli.use_cases import PROTECT, VERDICT, App

from skyproof import cli
from skyproof.cli import progress as progress_of
from skyproof.formats.verdict import write_verdict_json


def test_terminal_bars_go_to_standard_error_and_vanish(
    app: App, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    cli.main([*PROTECT, "--json"])
    out, err = capsys.readouterr()
    assert out == write_verdict_json(VERDICT)
    assert "doing protect" in err
    assert "[red]" in err
    assert "skyproof: doing" not in err


def test_a_bar_shows_what_is_done_of_the_total(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    progress = progress_of.progress()
    assert isinstance(progress, progress_of._Bars)
    with progress.stage("outer", 8.0) as outer, progress.stage("inner", 1.0):
        outer.advance(2.0)
        outer.advance(6.0)
        assert [task.percentage for task in progress._bars.tasks] == [75.0, 0.0]
    assert not progress._bars.tasks


def test_an_error_in_a_stage_gives_the_terminal_back(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    progress = progress_of.progress()
    with pytest.raises(KeyboardInterrupt), progress.stage("outer", 1.0), progress.stage("inner", 1.0):
        raise KeyboardInterrupt
    assert capsys.readouterr().err.count("\x1b[?25h") == 1  # the cursor is shown again, once


WORKING = """
import sys, time
from skyproof.cli.progress import progress
stages = progress()
with stages.stage("a-name-longer-than-there-is-room-for-beside-a-bar-on-eighty-columns", 20.0) as stage:
    for done in range(1, 16):
        stage.advance(float(done))
        time.sleep(0.1)
with stages.stage("rows", None) as stage:
    stage.advance(7)
    time.sleep(0.3)
print("the result")
"""


def test_a_terminal_bar_shows_the_remaining_time_and_vanishes() -> None:
    screen, terminal = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "80"}
    process = subprocess.Popen(
        [sys.executable, "-c", WORKING], stdout=subprocess.PIPE, stderr=terminal, text=True, env=environment
    )
    os.close(terminal)
    output = b""
    with contextlib.suppress(OSError):  # raised at its end
        while piece := os.read(screen, 4096):
            output += piece
    os.close(screen)
    out, _ = process.communicate(timeout=60)
    assert out == "the result\n"
    assert process.returncode == 0
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", output.decode())
    assert re.search(r"a-name-longer-than.*… ━.*\d+% 0:00:0\d left", text)
    assert "7 so far, 0:00:00" in text
    assert max(len(line) for line in re.split(r"[\r\n]+", text)) <= 80
    assert output.rstrip().endswith((b"\x1b[2K", b"\x1b[?25h"))


@pytest.mark.parametrize("colours", [{}, {"FORCE_COLOR": "1"}], ids=["plain", "colours-forced"])
def test_in_a_pipe_a_stage_is_one_line_without_control_codes(colours: dict[str, str]) -> None:
    run = subprocess.run(
        [sys.executable, "-c", WORKING], capture_output=True, text=True, env=os.environ | colours, check=True
    )
    assert run.stdout == "the result\n"
    assert run.stderr == (
        "skyproof: a-name-longer-than-there-is-room-for-beside-a-bar-on-eighty-columns\nskyproof: rows\n"
    )
