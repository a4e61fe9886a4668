"""The command line: exit codes, one line for an error, one document for --json, help with an example that parses."""

import contextlib
import importlib
import io
import json
import os
import platform
import pty
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cyclopts.completion.detect import ShellDetectionError
from rich.console import Console

from skyproof import cli
from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_tables import PlatformReceiver
from skyproof.app.fleet import FleetResult
from skyproof.app.fleet.rows import FleetRow
from skyproof.app.init import InitResult
from skyproof.app.receive import ReceiveResult
from skyproof.app.scenes.simulate import SimulateResult
from skyproof.app.verify import FileState, Verified
from skyproof.cli import demo as demo_command
from skyproof.cli import inspect as inspect_command
from skyproof.cli import progress as progress_of
from skyproof.cli import study as study_command
from skyproof.errors import InputError, OutputError
from skyproof.formats.verdict import read_verdict, verdict_json
from skyproof.report.chart import Axes
from skyproof.simulator.scenes import ready, ready_made
from skyproof.studies.base import Claim, Study
from skyproof.verdict import InputFile, Verdict

VERDICT = read_verdict(Path(__file__).parent / "formats" / "verdict-sample.json")
PROTECT = ["protect", "rx1.bin", "rx2.bin", "--out", "result"]
COMMANDS = ("protect", "inspect", "receive", "simulate", "init", "verify", "fleet", "study", "demo")

NO_FILES: dict[str, None] = dict.fromkeys(("nav", "imu", "platform"))
FLEET = (
    FleetRow(name="mast", inputs="mast.obs", state="done", verdict="spoofed", **NO_FILES),
    FleetRow(name="quay", inputs="quay.obs", state="done", verdict="spoofed", **NO_FILES),
    *(FleetRow(name=f"x{n}", inputs="x", state="failed", error="x: no such file", **NO_FILES) for n in range(12)),
)


def said(word: str) -> Verdict:
    because = {"undecided_because": "a second receiver would decide"}
    return Verdict.model_validate(VERDICT.model_dump(mode="json") | {"verdict": word} | because)


class App:
    """Stands for the use cases: notes the calls, gives a result or raises an error."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any, dict[str, Any]]] = []
        self.verdict = VERDICT
        self.interrupted = False
        self.error: BaseException | None = None

    def run(self, name: str, inputs: Any, options: dict[str, Any]) -> Any:
        progress = options.pop("progress")
        with progress.stage(f"doing {name}", 10.0) as stage:
            stage.advance(5.0)
            progress.say("a remark [red]")
        self.calls.append((name, inputs, options))
        if self.error is not None:
            raise self.error
        samples = SimpleNamespace(name="rx1", path="rx1.bin", remarks=())
        reception = SimpleNamespace(
            source=samples,
            n_signals=12,
            remarks=("a [dim] remark",),
            observations=None,
            examined_s=4.0,
            left_out="no time",
            messages_differ=(),
            decoded=SimpleNamespace(ephemerides=()),
        )
        if name == "receive":
            return ReceiveResult(
                signals=((),),
                receptions=(reception,),
                folder=options["out"],
                files=(("rx1-nav.rnx",),),
                interrupted=self.interrupted,
            )
        if name == "simulate":
            folder = options["out"]
            recordings, names = tuple(folder / f"rx{k}.bin" for k in range(1, 11)), ("rx1.bin", "truth.json")
            return SimulateResult(
                scenario=ready("takeover"),
                folder=folder,
                files=names,
                recordings=recordings,
                observations=(folder / "rx1.obs",),
                interrupted=self.interrupted,
            )
        folder = options.get("out", inputs)
        return SimpleNamespace(verdict=self.verdict, folder=folder, interrupted=self.interrupted)

    def init(self, files: list[Path], **options: Any) -> InitResult:
        self.calls.append(("init", files, options))
        return InitResult(path=options["out"], platform=Platform(receivers=(PlatformReceiver(name="bow"),)))

    def verify(self, folder: Path, **options: Any) -> Verified:
        del options["progress"]
        self.calls.append(("verify", folder, options))
        return Verified(verdict=self.verdict, files=(FileState(name="report.html", kind="output", state="same"),))

    def fleet(self, catalogue: Path, **options: Any) -> FleetResult:
        del options["progress"]
        self.calls.append(("fleet", catalogue, options))
        return FleetResult(rows=FLEET, folder=options["out"], interrupted=self.interrupted)

    def inspect(self, file: Path, **options: Any) -> list[Any]:
        self.calls.append(("inspect", file, options))
        return []

    def studies(self) -> dict[str, Study]:
        """Two studies that note the call and give two rows, the first of them before an error."""

        def run(settings: Any) -> Iterator[dict[str, Any]]:
            self.calls.append(("study", settings.trials, {"seed": settings.seed, "quick": settings.quick}))
            yield {"method": "paper", "window_s": 10, "kept": np.float64(0.5)}
            if self.error is not None:
                raise self.error
            yield {"method": "skyproof", "window_s": 30, "kept": float("nan")}

        words: dict[str, Any] = {"paper": "Someone 2022", "figure": "Figure 1", "title": "What is kept", "run": run}
        chart = Axes(title="kept", x="window_s", y="kept", x_label="window, s", y_label="kept", by=("method",))
        claim = Claim(what="kept at 10 s", paper=0.5, same=lambda rows: rows[0]["kept"], tolerance=0.1)
        drawn = Study(name="multi-receiver.false-alarm", charts=(chart,), claims=(claim,), **words)
        return {drawn.name: drawn, "spin.roc": Study(name="spin.roc", **words)}


@pytest.fixture
def app(monkeypatch: pytest.MonkeyPatch) -> Iterator[App]:
    fake = App()
    for name in ("protect", "receive", "demo", "simulate"):
        monkeypatch.setattr(
            f"skyproof.app.{name}.{name}", lambda inputs, _name=name, **options: fake.run(_name, inputs, options)
        )
    monkeypatch.setattr("skyproof.app.init.init", fake.init)
    monkeypatch.setattr("skyproof.app.verify.verify", fake.verify)
    monkeypatch.setattr("skyproof.app.fleet.fleet", fake.fleet)
    monkeypatch.setattr(inspect_command, "run_inspect", fake.inspect)
    monkeypatch.setattr(study_command, "studies", fake.studies)
    return fake


# Exit codes


@pytest.mark.parametrize("word", ["authentic", "spoofed", "undecided"])
def test_a_run_to_the_end_exits_with_0_whatever_the_verdict(app: App, word: str) -> None:
    app.verdict = said(word)
    assert cli.main(PROTECT) == 0


@pytest.mark.parametrize(("word", "code"), [("authentic", 0), ("spoofed", 1), ("undecided", 3)])
def test_the_exit_code_is_the_verdict_when_asked_to(app: App, word: str, code: int) -> None:
    app.verdict = said(word)
    assert cli.main([*PROTECT, "--exit-code"]) == code
    assert cli.main([*PROTECT, "--exit-code", "--json"]) == code


@pytest.mark.parametrize(
    "command", [PROTECT, ["receive", "rx1.bin", "--out", "d"], ["demo"], ["simulate", "spin", "--out", "d"]]
)
def test_an_error_of_the_input_is_one_line_and_2(
    app: App, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    app.error = InputError("rx1.bin: odd number of bytes,\n  expected pairs; cut the last one")
    assert cli.main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1] == "skyproof: rx1.bin: odd number of bytes, expected pairs; cut the last one"
    assert "Traceback" not in err


def test_our_own_mistake_is_one_line_too_and_says_whose_it_is(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.error = ZeroDivisionError("division by zero")
    assert cli.main(PROTECT) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("skyproof: unexpected ZeroDivisionError: division by zero. This is a fault of skyproof")
    assert "--debug" in last


def test_debug_shows_the_traceback(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.error = OutputError("cannot be written")
    assert cli.main([*PROTECT, "--debug"]) == 2
    err = capsys.readouterr().err
    assert "Traceback (most recent call last)" in err
    assert err.splitlines()[-1] == "skyproof: cannot be written"


def test_an_interrupted_run_prints_what_is_decided_and_exits_with_130(
    app: App, capsys: pytest.CaptureFixture[str]
) -> None:
    app.interrupted = True
    assert cli.main([*PROTECT, "--exit-code"]) == 130
    out, err = capsys.readouterr()
    assert out.startswith("SPOOFED\n")
    assert "skyproof: interrupted: this is what was decided so far" in err
    assert cli.main([*PROTECT, "--json"]) == 130
    assert json.loads(capsys.readouterr().out)["verdict"] == "spoofed"
    assert cli.main(["demo"]) == cli.main(["receive", "rx1.bin", "--out", "d"]) == 130


def test_what_of_a_platform_file_no_method_uses_is_said_in_one_line(
    app: App, capsys: pytest.CaptureFixture[str]
) -> None:
    remark = "attitude: read, used by no method of this run"
    given = InputFile(path="ship.toml", format="platform", sha256=None, remarks=(remark,))
    app.verdict = said("authentic").model_copy(update={"inputs": (given,)})
    for more in ([], ["--json"]):
        assert cli.main([*PROTECT, *more]) == 0
        assert capsys.readouterr().err.splitlines()[-1] == f"skyproof: ship.toml: {remark}"


def test_an_interruption_before_anything_is_decided_exits_with_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("skyproof.app.protect.protect", lambda *_, **__: signal.raise_signal(signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    try:
        assert cli.main(PROTECT) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    out, err = capsys.readouterr()
    assert (out, err) == ("", "skyproof: interrupted before there was a result\n")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("receive", "FILE is missing.*Expected: Recordings, one per receiver.*For help: skyproof receive --help"),
        ("protect rx1.bin", "--out is missing.*Expected: Folder for the verdict"),
        ("protect rx1.bin --out", "--out is missing, or lacks a value"),
        ("protect rx1.bin --uot d", "--uot. Did you mean --out?"),
        ("protect rx1.bin --out d --nva f", "--nva. Did you mean --nav?"),
        ("protect rx1.bin --out d --start-s soon", "--start-s = .soon., expected a number"),
        ("protct rx1.bin", "protct.*Did you mean .protect."),
        ("receive --out d", "FILE is missing"),
        ("protect rx1.bin --out d --place-deg 57.7", "--place-deg is missing, or lacks a value. Expected: Lat"),
        ("protect rx1.bin --out d --json=3", "--json = .3., expected nothing: it is a switch"),
        ("protect rx1.bin --out d --start-s 1 --start-s 2", "--start-s is given more than once; give it once"),
        ("demo here", "Not understood: here; leave it out"),
        ("study spin.roc --trials many", "--trials = .many., expected a whole number"),
        ("demo --jsn", "--jsn. Did you mean --json?"),
        ("simulate", "SCENARIO is missing.*--list"),
        ("simulate spin", "--out is missing"),
        ("simulate spin --out d --depth deep", "--depth"),
        ("study", "NAME is missing.*--list"),
        ("study multi-receiver.alarms", "no study is named 'multi-.*'; nearest: multi-receiver.false-alarm"),
        ("study spin", "nearest: spin.roc"),
        ("study qqq", "no study is named 'qqq'.*--list"),
        ("study spin.roc --trials 0", "--trials is 0, expected 1 or more"),
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


# What goes in


def test_options_reach_the_use_case_and_what_is_not_given_is_none(app: App) -> None:
    cli.main(
        [
            *PROTECT,
            "--nav",
            "b.22n",
            "--imu",
            "imu.csv",
            "--platform",
            "p.toml",
            "--false-alarm-probability-per-hour",
            "1e-4",
            "--antenna-distance-m",
            "60",
            "--antenna-distance-sigma-m",
            "0.5",
            "--antenna-separation-m",
            "2.5",
            "--tracking",
            "vector",
            "--doppler-max-hz",
            "9e3",
            "--place-deg",
            "57.7",
            "11.9",
            "--start-s",
            "27",
            "--duration-s",
            "33",
        ]
    )
    cli.main(PROTECT)
    cli.main(["receive", "rx1.bin", "--out", "d", "--nav", "b.22n"])
    cli.main(
        [
            "receive",
            "rx1.bin",
            "--out",
            "d",
            "--tracking",
            "vector",
            "--doppler-max-hz",
            "9e3",
            "--place-deg",
            "57.7",
            "11.9",
            "--start-s",
            "27",
            "--duration-s",
            "33",
        ]
    )
    cli.main(["init", "rx1.bin", "rx2.obs"])
    cli.main(["init", "rx1.bin", "--out", "p.toml", "--overwrite"])
    cli.main(["protect", "--platform", "p.toml", "--out", "d"])
    cli.main(["verify", "d", "--inputs-in", "e"])
    cli.main(["fleet", "c.csv", "--out", "d", "--workers", "3"])
    cli.main(["fleet", "c.csv", "--out", "d", "--ray", "auto"])
    cli.main(["demo", "--out", "there"])
    cli.main(
        ["simulate", "spin", "--out", "d", "--seed", "7", "--duration-s", "5", "--depth", "samples", "--format", "raw"]
    )
    cli.main(["simulate", "s.toml", "--out", "d"])
    stretch = ("tracking", "doppler_max_hz", "place_deg", "start_s", "duration_s")
    antennas = ("antenna_distance_m", "antenna_distance_sigma_m", "antenna_separation_m")
    settings = ("false_alarm_probability_per_hour", *antennas, *stretch)
    assert app.calls == [
        (
            "protect",
            [Path("rx1.bin"), Path("rx2.bin")],
            {
                "nav": Path("b.22n"),
                "imu": Path("imu.csv"),
                "platform": Path("p.toml"),
                "out": Path("result"),
                **dict(zip(settings, (1e-4, 60.0, 0.5, 2.5, "vector", 9e3, (57.7, 11.9), 27.0, 33.0), strict=True)),
            },
        ),
        (
            "protect",
            [Path("rx1.bin"), Path("rx2.bin")],
            {"nav": None, "imu": None, "platform": None, "out": Path("result"), **dict.fromkeys(settings)},
        ),
        ("receive", [Path("rx1.bin")], {"out": Path("d"), "nav": Path("b.22n"), **dict.fromkeys(stretch)}),
        (
            "receive",
            [Path("rx1.bin")],
            {
                "out": Path("d"),
                "nav": None,
                **dict(zip(stretch, ("vector", 9e3, (57.7, 11.9), 27.0, 33.0), strict=True)),
            },
        ),
        ("init", [Path("rx1.bin"), Path("rx2.obs")], {"out": Path("platform.toml"), "overwrite": False}),
        ("init", [Path("rx1.bin")], {"out": Path("p.toml"), "overwrite": True}),
        (
            "protect",
            [],
            {"nav": None, "imu": None, "platform": Path("p.toml"), "out": Path("d"), **dict.fromkeys(settings)},
        ),
        ("verify", Path("d"), {"inputs_in": Path("e")}),
        ("fleet", Path("c.csv"), {"out": Path("d"), "workers": 3, "ray": None}),
        ("fleet", Path("c.csv"), {"out": Path("d"), "workers": None, "ray": "auto"}),
        ("demo", Path("there"), {}),
        (
            "simulate",
            "spin",
            {"out": Path("d"), "seed": 7, "duration_s": 5.0, "depth": "samples", "container": "raw", "plot": False},
        ),
        (
            "simulate",
            "s.toml",
            {"out": Path("d"), "seed": None, "duration_s": None, "depth": "all", "container": None, "plot": False},
        ),
    ]


# What comes out


@pytest.mark.parametrize("command", [PROTECT, ["demo"]])
def test_json_is_one_document_and_nothing_else(
    app: App, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    cli.main([*command, "--json"])
    out, err = capsys.readouterr()
    assert out == verdict_json(VERDICT)
    assert f"skyproof: doing {command[0]}\nskyproof: a remark [red]\n" in err


def test_the_summary_is_understood_in_ten_seconds(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    cli.main(PROTECT)
    out = capsys.readouterr().out
    lines = [re.sub(" +", " ", line).strip() for line in out.splitlines()]
    assert lines[0] == "SPOOFED"
    assert len(lines) < 27
    for line in (
        "Since 2022-01-01 10:00:24 ± 0.5 s, GPS time",
        "rx1 trusted 59.4121000 16.8837000 31.0 0.8/1.1/2.3",
        "rx1 false 59.4064892 16.8951443 43.1 0.8/1.1/2.3",
        "rx1 1 authentic G05",
        "rx1 1 spoofed G05",
        "rx2 1 unknown G07",
        "not tested: ins_array (the report says why)",
        "report: result/report.html",
    ):
        assert line in lines, line


def test_what_is_not_decided_is_said(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.verdict = said("undecided")
    cli.main(PROTECT)
    out = capsys.readouterr().out
    assert out.startswith("UNDECIDED\n")
    assert "Not decided: a second receiver would decide" in out


def test_a_long_path_stays_on_one_line(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    folder = "/".join(["a-folder"] * 30)
    cli.main(["protect", "rx1.bin", "--out", folder])
    assert f"report: {folder}/report.html\n" in capsys.readouterr().out


def test_receive_says_what_was_received(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["receive", "rx1.bin", "--out", "d"]) == 0
    assert capsys.readouterr().out == "rx1: 12 signals\n  a [dim] remark\nfiles in d\n"


def test_receive_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["receive", "rx1.bin", "--out", "d", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["format"], document["folder"], document["interrupted"]) == ("skyproof-receive/1", "d", False)
    (receiver,) = document["receivers"]
    assert (receiver["n_signals"], receiver["remarks"], receiver["files"]) == (12, ["a [dim] remark"], ["rx1-nav.rnx"])


def test_simulate_says_what_was_made_and_how_to_make_it_again(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["simulate", "takeover", "--out", "d"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "takeover"
    assert ready("takeover").description.startswith(lines[1].strip())
    assert [line for line in lines if line.startswith("recording:")] == [f"recording: d/rx{k}.bin" for k in range(1, 9)]
    assert lines[-4:] == [
        "  and 2 more",
        "observations: d/rx1.obs",
        "truth: d/truth.json",
        "the same again: skyproof simulate d/scenario.toml",
    ]


def test_simulate_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.interrupted = True
    assert cli.main(["simulate", "takeover", "--out", "d", "--json"]) == 130
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert (document["format"], document["folder"], document["interrupted"]) == ("skyproof-simulate/1", "d", True)
    assert document["files"] == ["rx1.bin", "truth.json"]
    assert "skyproof: interrupted: 2 files in d are complete, the others are missing" in err


def test_the_ready_made_scenes_are_listed_with_a_sentence_each(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["simulate", "--list"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert all(name in out for name in ready_made())
    assert "Reflections from the ground and a wall, and no attack" in out
    assert cli.main(["simulate", "--list", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["scenes"]) == len(ready_made())
    assert not app.calls


def test_fleet_counts_its_items_and_names_the_first_that_failed(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["fleet", "c.csv", "--out", "d"]) == 0
    out, err = capsys.readouterr()
    assert [line.split() for line in out.splitlines()[1:]] == [
        ["12", "failed"],
        ["2", "spoofed"],
        ["page:", "d/fleet.html"],
    ]
    assert err.splitlines() == [
        *(f"skyproof: x{n}: x: no such file" for n in range(10)),
        "skyproof: and 2 more that failed; d/fleet.html lists all",
    ]


def test_fleet_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.interrupted = True
    assert cli.main(["fleet", "c.csv", "--out", "d", "--json"]) == 130
    out, err = capsys.readouterr()
    items = json.loads(out)["items"]
    assert (len(items), items[0]["verdict"], items[-1]["error"]) == (14, "spoofed", "x: no such file")
    assert err.splitlines()[-1] == "skyproof: interrupted: not all items were done; the same command goes on from here"


def test_study_prints_its_rows_and_claims(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "multi-receiver.false-alarm", "--trials", "9", "--seed", "4"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == "multi-receiver.false-alarm: What is kept"
    assert "paper 10 0.5" in lines
    assert "kept at 10 s 0.5 0.5 – – within 0.1" in lines
    assert app.calls == [("study", 9, {"seed": 4, "quick": False})]


def test_study_prints_the_same_as_one_document(app: App, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    command = ["study", "multi-receiver.false-alarm", "--quick", "--json", "--plot", "--out", str(tmp_path / "new")]
    assert cli.main(command) == 0
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert err == "skyproof: rows of multi-receiver.false-alarm\n"
    assert (document["format"], document["study"]) == ("skyproof-study/1", "multi-receiver.false-alarm")
    assert (document["seed"], document["trials"], document["quick"], document["interrupted"]) == (1, None, True, False)
    assert document["rows"] == [
        {"method": "paper", "window_s": 10, "kept": 0.5},
        {"method": "skyproof", "window_s": 30, "kept": None},
    ]
    assert document["claims"][0]["agrees"] is True
    written = {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "new").iterdir()}
    assert written.keys() == {"multi-receiver.false-alarm.json", "multi-receiver.false-alarm.svg"}
    assert written["multi-receiver.false-alarm.json"] == out
    assert written["multi-receiver.false-alarm.svg"].startswith("<svg ")


def test_a_chart_without_a_folder_is_written_here(
    app: App, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(["study", "multi-receiver.false-alarm", "--plot"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["multi-receiver.false-alarm.svg"]
    assert "chart: multi-receiver.false-alarm.svg\n" in capsys.readouterr().out


def test_an_interrupted_study_prints_the_rows_that_were_ready(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.error = KeyboardInterrupt()
    assert cli.main(["study", "multi-receiver.false-alarm", "--json"]) == 130
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert (document["interrupted"], len(document["rows"]), document["claims"]) == (True, 1, [])
    assert err.splitlines()[1:] == ["skyproof: interrupted with 1 row ready"]


def test_the_studies_are_listed_with_paper_and_figure(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "--list"]) == 0
    out = capsys.readouterr().out
    assert all(words in out for words in ("Someone 2022", "multi-receiver.false-alarm", "Figure 1", "What is kept"))
    assert cli.main(["study", "--list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["studies"]
    assert [one["study"] for one in listed] == ["multi-receiver.false-alarm", "spin.roc"]
    assert not app.calls


def test_the_table_of_all_figures_is_one_file(app: App, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "--validation", str(tmp_path / "validation.md"), "--quick", "--seed", "7"]) == 0
    text = (tmp_path / "validation.md").read_text(encoding="utf-8")
    assert "seed 7, quick counts" in text
    assert "| kept at 10 s | 0.5 | 0.5 | – | – | within 0.1 |" in text
    assert [call[0] for call in app.calls] == ["study"]  # the one that claims nothing need not run
    assert "multi-receiver.false-alarm" in capsys.readouterr().err


def test_a_study_without_a_chart_keeps_its_rows_when_it_is_asked_for_one(
    app: App, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert cli.main(["study", "spin.roc", "--plot", "--json", "--out", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["study"] == "spin.roc"
    assert json.loads((tmp_path / "spin.roc.json").read_text(encoding="utf-8")) == json.loads(out)
    assert "skyproof: spin.roc has no chart" in err
    assert not (tmp_path / "spin.roc.svg").exists()


def open_skies() -> Verdict:
    """One receiver that hears two skies, of which the evidence leaves open which is true."""
    sample = VERDICT.model_dump(mode="json")
    receiver = sample["receivers"][0] | {"trusted_fix": None, "false_fix": None, "unprotected_fix": None}
    [source], signal = sample["sources"], sample["signals"][0] | {"label": "unknown", "receiver": "rx1", "because": []}
    places = {
        "S1": {"lat_deg": 59.41, "lon_deg": 16.88, "height_m": 31.0},
        "S2": {"lat_deg": 58.25, "lon_deg": 15.5, "height_m": -4.0},
    }
    return Verdict.model_validate(
        sample
        | {
            "receivers": [receiver],
            "undecided_because": "which is true",
            "sources": [source | {"name": name, "shows": place} for name, place in places.items()],
            "signals": [signal | {"source": name, "copy": copy} for name, copy in zip(places, "ab", strict=True)],
        }
    )


def test_the_places_of_two_skies_are_shown_while_it_is_open_which_is_true(
    app: App, capsys: pytest.CaptureFixture[str]
) -> None:
    app.verdict = open_skies()
    cli.main(PROTECT)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["rx1", "S1", "59.4100000", "16.8800000", "31.0"] in rows
    assert ["rx1", "S2", "58.2500000", "15.5000000", "-4.0"] in rows
    shown = app.verdict._repr_html_()
    assert "59.4100000" in shown
    assert "58.2500000" in shown


def test_demo_opens_the_report_when_asked_to(app: App, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    opened: list[str] = []
    monkeypatch.setattr(demo_command.webbrowser, "open", opened.append)
    cli.main(["demo", "--out", str(tmp_path)])
    assert opened == []
    cli.main(["demo", "--out", str(tmp_path), "--open"])
    assert opened == [(tmp_path / "report.html").as_uri()]


def test_bars_at_a_terminal_go_to_standard_error_and_leave_nothing_behind(
    app: App, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    cli.main([*PROTECT, "--json"])
    out, err = capsys.readouterr()
    assert out == verdict_json(VERDICT)
    assert "doing protect" in err
    assert "a remark [red]" in err
    assert "skyproof: doing protect" not in err


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
with stages.stage("a name that is longer than there is room for beside a bar on eighty columns", 20.0) as stage:
    for done in range(1, 16):
        stage.advance(float(done))
        time.sleep(0.1)
with stages.stage("rows", None) as stage:
    stage.advance(7)
    time.sleep(0.3)
print("the result")
"""


def test_at_a_terminal_a_bar_shows_the_time_left_and_is_gone_in_the_end() -> None:
    screen, terminal = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "80"}
    process = subprocess.Popen(
        [sys.executable, "-c", WORKING], stdout=subprocess.PIPE, stderr=terminal, text=True, env=environment
    )
    os.close(terminal)
    shown = b""
    with contextlib.suppress(OSError):  # raised at its end
        while piece := os.read(screen, 4096):
            shown += piece
    os.close(screen)
    out, _ = process.communicate(timeout=60)
    assert out == "the result\n"
    assert process.returncode == 0
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode())
    assert re.search(r"a name that is longer than.*… ━.*\d+% 0:00:0\d left", text)
    assert "7 so far, 0:00:00" in text
    assert max(len(line) for line in re.split(r"[\r\n]+", text)) <= 80
    assert shown.rstrip().endswith((b"\x1b[2K", b"\x1b[?25h"))


@pytest.mark.parametrize("colours", [{}, {"FORCE_COLOR": "1"}], ids=["plain", "colours-forced"])
def test_in_a_pipe_a_stage_is_one_line_without_control_characters(colours: dict[str, str]) -> None:
    run = subprocess.run(
        [sys.executable, "-c", WORKING], capture_output=True, text=True, env=os.environ | colours, check=True
    )
    assert run.stdout == "the result\n"
    assert run.stderr == (
        "skyproof: a name that is longer than there is room for beside a bar on eighty columns\nskyproof: rows\n"
    )


# Help


def help_of(*command: str) -> str:
    """What --help prints on a terminal of 80 columns."""
    page = io.StringIO()
    cli.app.help_print(list(command), console=Console(file=page, width=80))
    return page.getvalue()


def examples(*command: str) -> list[str]:
    """The lines of a help text that can be run: those that name no placeholder."""
    lines = re.findall(r"^skyproof .*", help_of(*command), re.MULTILINE)
    return [line for line in lines if not re.search(r"\b[A-Z_]{4,}\b", line)]


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_that_parses(app: App, command: str) -> None:
    lines = examples(command)
    assert lines
    for line in lines:
        assert cli.main(shlex.split(line)[1:]) == 0
    assert app.calls[0][0] == app.calls[-1][0] == command  # another one between them makes a file for the last


@pytest.mark.parametrize("command", [(), *((name,) for name in (*COMMANDS, "--install-completion"))])
def test_help_is_read_on_eighty_columns(command: tuple[str, ...]) -> None:
    text = help_of(*command)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    assert "[ARGS]" not in text


@pytest.mark.parametrize("command", COMMANDS)
def test_help_gives_the_unit_of_every_quantity(command: str) -> None:
    text = re.sub(r"[\s│]+", " ", help_of(command))
    parts = re.split(r" (?=--[a-z])", text.partition("Parameters")[2])
    for ending, unit in (("-s", "seconds"), ("-hz", "hertz|a second"), ("-m", "metres"), ("-deg", "degrees")):
        for part in parts:
            name = part.split(" ")[0]
            if name.endswith(ending):
                assert re.search(unit, part), part


def test_help_states_the_defaults_of_the_settings() -> None:
    page = io.StringIO()
    cli.app.help_print(["protect"], console=Console(file=page, width=200))
    out = re.sub(r"[\s│]+", " ", page.getvalue())
    assert "Probability of a false label or verdict in an hour of clean sky. Default: 0.001." in out
    assert "Use no more than this of every recording. In seconds. Default: the end." in out


def test_without_a_command_the_commands_are_listed_and_where_to_begin(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 0
    out = capsys.readouterr().out
    assert all(f" {command} " in out for command in COMMANDS)
    assert out.index(" protect ") < out.index(" demo ")
    for line in (
        "skyproof demo --out demo",
        "skyproof inspect FILE",
        "skyproof protect FILE... ",
        "COMMAND --help",
        "--install-completion",
    ):
        assert line in out


def test_numpy_is_loaded_after_it_was_given_one_thread() -> None:
    program = (
        "import os, sys; from skyproof.cli import main; assert main(['--version']) == 0; "
        "assert 'numpy' not in sys.modules; print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.splitlines()[-1] == "1"


def test_version_prints_what_a_report_of_a_fault_needs(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    out = capsys.readouterr().out
    lines = out.splitlines()
    assert re.fullmatch(r"skyproof \d+\.\d+\.\d+\S*", lines[0])
    assert lines[1].startswith(f"Python {platform.python_version()} ")
    assert re.search(r", (\d+ of )?\d+ cores?$", lines[3])
    for name in ("numpy", "scipy", "numba", "pyarrow", "pydantic"):
        assert f"{name} {metadata.version(name)}" in out
    assert "compiled kernels: " in out


def test_version_prints_whether_kernels_are_compiled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    cli.main(["--version"])
    assert "compiled kernels: none in " in capsys.readouterr().out
    (tmp_path / "a.nbi").touch()
    cli.main(["--version"])
    assert f"compiled kernels: 1 in {tmp_path}\n" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_the_list_says_of_a_command_what_its_function_says(command: str) -> None:
    module = importlib.import_module(f"skyproof.cli.{command}")
    assert cli.COMMANDS[command][1] == getattr(module, command).__doc__


@pytest.mark.parametrize("command", [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)])
def test_help_loads_nothing_that_computes(command: list[str]) -> None:
    """Each of these takes a quarter of a second and more."""
    program = f"import sys; from skyproof.cli import main; assert main({command}) == 0; print('|', *sys.modules)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.rpartition("|")[2].split())
    assert loaded & {"numba", "scipy", "pyarrow", "jinja2", "skyproof.receiver", "skyproof.app.protect"} == set()
    if command[0].startswith("--"):
        assert loaded & {"numpy", "pydantic", "skyproof.app"} == set()


# Completion


def completed(script: Path, *words: str) -> set[str]:
    """What bash offers for the last of the words when Tab is pressed."""
    line = " ".join(map(shlex.quote, words))
    program = (
        f"source {shlex.quote(str(script))}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; "
        'name=$(complete -p skyproof | sed "s/.*-F \\([^ ]*\\).*/\\1/"); $name; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    run = subprocess.run(["bash", "--norc", "-c", program], capture_output=True, text=True, check=True)
    assert run.stderr == ""
    return set(run.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes_commands_options_and_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "skyproof.bash"
    assert cli.main(["--install-completion", "--shell", "bash", "--output", str(script)]) == 0
    assert capsys.readouterr().out == f"completion: {script}\n"
    assert completed(script, "skyproof", "pro") == {"protect"}
    assert completed(script, "skyproof", "") == set(COMMANDS)
    assert completed(script, "skyproof", "protect", "--na") == {"--nav"}
    assert completed(script, "skyproof", "simulate", "--depth", "mea") == {"measurements"}
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rx1.bin").touch()
    assert completed(script, "skyproof", "protect", "rx") == {"rx1.bin"}
    assert completed(script, "skyproof", "protect", "rx1.bin", "--nav", "rx") == {"rx1.bin"}


def test_the_installed_completion_is_loaded_by_the_shell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (line,) = examples("--install-completion")
    assert cli.main(shlex.split(line)[1:]) == 0
    script = Path(capsys.readouterr().out.removeprefix("completion: ").strip())
    assert script.is_relative_to(tmp_path)
    assert str(script) in (tmp_path / ".bashrc").read_text(encoding="utf-8")


def test_a_completion_that_cannot_be_installed_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "taken").touch()
    assert cli.main(["--install-completion", "--shell", "bash", "--output", str(tmp_path / "taken" / "script")]) == 2
    assert "name another file with --output" in capsys.readouterr().err

    def unknown(*_: object, **__: object) -> None:
        raise ShellDetectionError

    monkeypatch.setattr(type(cli.app), "install_completion", unknown)
    assert cli.main(["--install-completion"]) == 2
    assert "name it, as in --shell bash" in capsys.readouterr().err


# Ctrl-C


def test_an_interrupted_table_of_all_figures_is_not_written(
    app: App, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    app.error = KeyboardInterrupt()
    assert cli.main(["study", "--validation", str(tmp_path / "validation.md")]) == 130
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1] == "skyproof: interrupted: not all studies were run, no table was written"
    assert list(tmp_path.iterdir()) == []


def test_interrupted_pages_are_whole_and_their_folder_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("skyproof.app.scenes.pages.write_pages", interrupted)
    assert cli.main(["simulate", "--pages", str(tmp_path)]) == 130
    reported = f"interrupted: not all pages were drawn; those in {tmp_path} are whole"
    assert capsys.readouterr().err == f"skyproof: {reported}\n"


# The examples of the help, as they stand


def run_here(line: str, folder: Path) -> str:
    """Run a line of the help in a folder; what it printed."""
    call = f"import sys; from skyproof.cli import main; sys.exit(main({shlex.split(line)[1:]!r}))"
    run = subprocess.run([sys.executable, "-c", call], cwd=folder, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr
    return run.stdout


@pytest.mark.parametrize("line", [line for name in COMMANDS for line in examples(name) if line.endswith("--list")])
def test_the_quick_examples_run(line: str, tmp_path: Path) -> None:
    assert run_here(line, tmp_path).strip()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_every_example_of_the_help_runs(tmp_path: Path) -> None:
    """In one folder, the demonstration first: others work on its recordings."""
    lines = dict.fromkeys(line for command in ((), *((name,) for name in COMMANDS)) for line in examples(*command))
    lines.pop("skyproof demo --out demo")
    run_here("skyproof demo --out demo", tmp_path)
    for line in lines:
        assert run_here(line, tmp_path).strip(), line
    made = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")}
    assert made >= {"demo/report.html", "out/report.html", "out/bow.obs", "scene/truth.json"}
