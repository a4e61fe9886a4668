"""Completion of the shell."""

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from cyclopts.completion.detect import ShellDetectionError
from tests.cli.test_help import list_examples
from tests.cli.use_cases import COMMANDS

from skyproof import cli


def complete(script: Path, *words: str) -> set[str]:
    """Return what bash offers for the last of the words when Tab is pressed."""
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
    assert complete(script, "skyproof", "pro") == {"protect"}
    assert complete(script, "skyproof", "") == set(COMMANDS)
    assert complete(script, "skyproof", "protect", "--na") == {"--nav"}
    assert complete(script, "skyproof", "simulate", "--depth", "mea") == {"measurements"}
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rx1.bin").touch()
    assert complete(script, "skyproof", "protect", "rx") == {"rx1.bin"}
    assert complete(script, "skyproof", "protect", "rx1.bin", "--nav", "rx") == {"rx1.bin"}


def test_the_installed_completion_is_loaded_by_the_shell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (line,) = list_examples("--install-completion")
    assert cli.main(shlex.split(line)[1:]) == 0
    script = Path(capsys.readouterr().out.removeprefix("completion: ").strip())
    assert script.is_relative_to(tmp_path)
    assert str(script) in (tmp_path / ".bashrc").read_text(encoding="utf-8")


def test_a_completion_that_cannot_be_installed_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "taken").touch()
    assert cli.main(["--install-completion", "--shell", "bash", "--output", str(tmp_path / "taken" / "script")]) == 2
    assert "--output" in capsys.readouterr().err

    def unknown(*_: object, **__: object) -> None:
        raise ShellDetectionError

    monkeypatch.setattr(type(cli.app), "install_completion", unknown)
    assert cli.main(["--install-completion"]) == 2
    assert "--shell bash" in capsys.readouterr().err
