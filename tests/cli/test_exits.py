"""Exit codes, and one line for an error, for an interruption and for what a person typed wrong."""

import json
import re
import shlex
import signal
from pathlib import Path

import pytest
from tests.cli.use_cases import PROTECT, App, state_word

from skyproof import cli
from skyproof.errors import InputError, OutputError
from skyproof.verdict import InputFile


@pytest.mark.parametrize("word", ["authentic", "no_attack_seen", "suspect", "spoofed"])
def test_a_run_to_the_end_exits_with_0_whatever_the_verdict(app: App, word: str) -> None:
    app.verdict = state_word(word)
    assert cli.main(PROTECT) == 0


@pytest.mark.parametrize(("word", "code"), [("authentic", 0), ("spoofed", 1), ("suspect", 3), ("no_attack_seen", 4)])
def test_the_exit_code_is_the_verdict_when_asked_to(app: App, word: str, code: int) -> None:
    app.verdict = state_word(word)
    assert cli.main([*PROTECT, "--exit-code"]) == code
    assert cli.main([*PROTECT, "--exit-code", "--json"]) == code


@pytest.mark.parametrize(
    "command", [PROTECT, ["receive", "rx1.bin", "--out", "d"], ["demo"], ["simulate", "spin", "--out", "d"]]
)
def test_an_error_of_the_input_is_one_line_and_2(
    app: App, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    app.error = InputError("rx1.bin: odd,\n" + "  cut it")
    assert cli.main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1] == "skyproof: rx1.bin: odd, cut it"
    assert "Traceback" not in err


def test_our_own_mistake_is_one_line_too_and_says_whose_it_is(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.error = ZeroDivisionError("by zero")
    assert cli.main(PROTECT) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("skyproof: unexpected ZeroDivisionError: by zero. ")
    assert "--debug" in last


def test_debug_shows_the_traceback(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.error = OutputError("unwritten")
    assert cli.main([*PROTECT, "--debug"]) == 2
    err = capsys.readouterr().err
    assert "Traceback (most" in err
    assert err.splitlines()[-1] == "skyproof: unwritten"


def test_an_interrupted_run_prints_decisions_and_exits_130(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.interrupted = True
    assert cli.main([*PROTECT, "--exit-code"]) == 130
    out, err = capsys.readouterr()
    assert out.startswith("SPOOFED\n")
    assert "skyproof: interrupted: " in err
    assert cli.main([*PROTECT, "--json"]) == 130
    assert json.loads(capsys.readouterr().out)["verdict"] == "spoofed"
    assert cli.main(["demo"]) == cli.main(["receive", "rx1.bin", "--out", "d"]) == 130


def test_unused_platform_keys_are_reported_in_one_line(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    remark = "attitude: unused"
    result = InputFile(path="ship.toml", format="platform", sha256=None, cut=(), left_out=(remark,), remarks=("odd",))
    app.verdict = state_word("authentic").model_copy(update={"inputs": (result,)})
    assert cli.main(PROTECT) == 0
    out = capsys.readouterr().out
    assert f"Left out: ship.toml: {remark}\n" in out
    assert "odd" not in out
    assert cli.main([*PROTECT, "--json"]) == 0
    assert capsys.readouterr().err.splitlines()[-1] == f"skyproof: ship.toml: {remark}"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_before_any_decision_exits_as_a_shell_does(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], number: signal.Signals, code: int
) -> None:
    monkeypatch.setattr("skyproof.app.protect.protect", lambda *_, **__: signal.raise_signal(number))
    before = signal.signal(number, signal.default_int_handler)  # a shell's background jobs ignore it
    try:
        assert cli.main(PROTECT) == code
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    out, err = capsys.readouterr()
    assert (out, err.count("\n"), err[:21]) == ("", 1, "skyproof: interrupted")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("receive", r"FILE .*Recordings.*skyproof receive --help"),
        ("protect rx1.bin", r"--out .*Folder"),
        ("protect rx1.bin --out", "--out .*value"),
        ("protect rx1.bin --uot d", r"--uot.*--out"),
        ("protect rx1.bin --out d --nva f", r"--nva.*--nav"),
        ("protect rx1.bin --out d --start-s soon", r"--start-s = .soon., .*number"),
        ("protct rx1.bin", "protct.* .protect."),
        ("receive --out d", "FILE is missing"),
        ("protect rx1.bin --out d --place-deg 57.7", r"--place-deg .*missing.*\bLat"),
        ("protect rx1.bin --out d --json=3", r"--json = .3., .*switch"),
        ("protect rx1.bin --out d --start-s 1 --start-s 2", r"--start-s .*once"),
        ("demo here", r"\bhere;"),
        ("study spin.roc --trials many", r"--trials = .many., .*number"),
        ("demo --jsn", r"--jsn.*--json"),
        ("simulate", "SCENARIO is missing.*--list"),
        ("simulate spin", "--out .*missing"),
        ("simulate spin --out d --depth deep", "--depth"),
        ("study", "NAME is missing.*--list"),
        ("study multi-receiver.alarms", r"'multi-.*'; nearest: multi-receiver\.false-alarm"),
        ("study spin", "nearest: spin.roc"),
        ("study qqq", r"'qqq'.*--list"),
        ("study spin.roc --trials 0", r"--trials is 0, .*\b1\b"),
        ("study spin.roc --seed -1", "--seed is -1"),
        ("triangulate rx1.bin", "Unknown command .triangulate"),
    ],
)
def test_a_usage_error_is_one_line_that_helps(
    app: App, capsys: pytest.CaptureFixture[str], line: str, words: str
) -> None:
    assert cli.main(shlex.split(line)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("skyproof: ")
    assert re.search(words, err)
    assert not app.calls


def test_interrupted_pages_are_whole_and_their_folder_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("skyproof.app.scenes.pages.write_pages", interrupted)
    assert cli.main(["simulate", "--pages", str(tmp_path)]) == 130
    assert re.fullmatch(rf"skyproof: interrupted: .*{re.escape(str(tmp_path))}.*\n", capsys.readouterr().err)
