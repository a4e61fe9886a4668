"""Help: an example of each command that runs, units and defaults, and nothing loaded that computes."""

import hashlib
import importlib
import io
import os
import platform
import re
import shlex
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from rich.console import Console
from tests.cli.use_cases import COMMANDS, App

from skyproof import cli


def print_help(*command: str) -> str:
    """Return what --help prints on a terminal of 80 columns."""
    page = io.StringIO()
    cli.app.help_print(list(command), console=Console(file=page, width=80))
    return page.getvalue()


def list_examples(*command: str) -> list[str]:
    """List the lines of a help text that can be run: those without a placeholder."""
    lines = re.findall(r"^skyproof .*", print_help(*command), re.MULTILINE)
    return [line for line in lines if not re.search(r"\b[A-Z_]{4,}\b", line)]


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_that_parses(app: App, command: str) -> None:
    lines = list_examples(command)
    assert lines
    for line in lines:
        assert cli.main(shlex.split(line)[1:]) == 0
    assert app.calls[0][0] == app.calls[-1][0] == command  # another one between them makes a file for the last


@pytest.mark.parametrize("command", [(), *((name,) for name in (*COMMANDS, "--install-completion"))])
def test_help_is_read_on_eighty_columns(command: tuple[str, ...]) -> None:
    text = print_help(*command)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    assert "[ARGS]" not in text


@pytest.mark.parametrize("command", COMMANDS)
def test_help_gives_the_unit_of_every_quantity(command: str) -> None:
    text = re.sub(r"[\s│]+", " ", print_help(command))
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
    assert re.search(r"Probability .*? Default: 0\.001\.", out)
    assert re.search(r"In seconds\. Default: ", out)


def test_without_a_command_commands_and_a_start_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
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


@pytest.mark.parametrize("flag", ["--version", "-V"])
def test_version_prints_what_a_report_of_a_fault_needs(flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([flag]) == 0
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
    package, home, asked = tmp_path / "package" / "receiver", tmp_path / "home", tmp_path / "asked"
    of_user = home / "numba" / f"receiver_{hashlib.sha1(str(package).encode()).hexdigest()}"
    for folder in (package, of_user, home / "numba" / "other_package", asked):
        folder.mkdir(parents=True)
    (home / "numba" / "other_package" / "other.nbi").touch()
    monkeypatch.setattr("skyproof.cli.about.PACKAGE", package.parent)
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(asked))
    cli.main(["-V"])
    assert "kernels: none;" in capsys.readouterr().out
    for folder, place in ((of_user, home / "numba"), (package, package.parent), (asked, asked)):
        (folder / "a.nbi").touch()
        cli.main(["-V"])
        assert f"1 in {place}" in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_list_says_of_a_command_what_its_function_says(command: str) -> None:
    module = importlib.import_module(f"skyproof.cli.{command}")
    assert cli.COMMANDS[command][1] == getattr(module, command).__doc__


@pytest.mark.parametrize("command", [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)])
def test_help_loads_nothing_that_computes(command: list[str]) -> None:
    # Each of these takes a quarter of a second and more.
    program = f"import sys; from skyproof.cli import main; assert main({command}) == 0; print('|', *sys.modules)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.rpartition("|")[2].split())
    assert loaded & {"numba", "scipy", "pyarrow", "jinja2", "skyproof.receiver", "skyproof.app.protect"} == set()
    if command[0].startswith("--"):
        assert loaded & {"numpy", "pydantic", "skyproof.app"} == set()


def run_here(line: str, folder: Path) -> str:
    """Run a line of the help in a folder; what it printed."""
    call = f"import sys; from skyproof.cli import main; sys.exit(main({shlex.split(line)[1:]!r}))"
    run = subprocess.run([sys.executable, "-c", call], cwd=folder, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr
    return run.stdout


@pytest.mark.parametrize("line", [line for name in COMMANDS for line in list_examples(name) if line.endswith("--list")])
def test_the_quick_examples_run(line: str, tmp_path: Path) -> None:
    assert run_here(line, tmp_path).strip()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_every_example_of_the_help_runs(tmp_path: Path) -> None:
    # In one folder, the demonstration first: others work on its recordings. Each into a folder that is free.
    lines = dict.fromkeys(line for command in ((), *((name,) for name in COMMANDS)) for line in list_examples(*command))
    lines.pop("skyproof demo --out demo")
    run_here("skyproof demo --out demo", tmp_path)
    made = set[str]()
    for number, line in enumerate(lines):
        if "--out out" in line and (tmp_path / "out").exists():
            (tmp_path / "out").rename(tmp_path / f"out-{number}")
        assert run_here(line, tmp_path).strip(), line
        made |= {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")}
    assert made >= {"demo/report.html", "out/report.html", "out/bow.obs", "scene/truth.json"}
