"""A folder is one run's while it lasts, whoever is killed; nothing in it is lost unasked."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from skyproof.app.common.folder import claim, require_free
from skyproof.errors import OutputError

HOLD = """
import sys
from skyproof.app.common.folder import claim
with claim(sys.argv[1]):
    print("claimed", flush=True)
    sys.stdin.read()
"""


def hold_folder(folder: Path) -> subprocess.Popen:
    """Start another process that claims the folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "claimed\n"
    return process


def test_a_second_run_is_refused_and_leaves_the_folder_alone(tmp_path):
    first = hold_folder(tmp_path / "a" / "out")
    with (
        pytest.raises(OutputError, match="a/out: another run"),
        claim(tmp_path / "a" / "out"),
    ):
        pass
    assert (tmp_path / "a" / "out").is_dir()
    first.communicate()
    with claim(tmp_path / "a" / "out"):
        pass


def test_a_run_that_is_killed_blocks_nobody(tmp_path):
    first = hold_folder(tmp_path / "out")
    first.send_signal(signal.SIGKILL)
    first.wait()
    with claim(tmp_path / "out") as claimed:
        assert claimed.path == tmp_path / "out"


def test_a_folder_that_was_made_and_stays_empty_goes(tmp_path):
    with claim(tmp_path / "a" / "b"):
        assert (tmp_path / "a" / "b").is_dir()
    assert list(tmp_path.iterdir()) == []
    with claim(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "file").touch()
    assert (tmp_path / "a" / "b" / "file").exists()
    (tmp_path / "empty").mkdir()
    with claim(tmp_path / "empty"):
        pass
    assert (tmp_path / "empty").is_dir()  # it was there before


def test_who_has_claimed_a_folder_may_pass_it_on(tmp_path):
    with claim(tmp_path) as claimed, claim(claimed) as again:
        assert again is claimed
        with pytest.raises(OutputError, match="another run"), claim(tmp_path):
            pass


def test_a_folder_that_was_removed_meanwhile_is_made_again(tmp_path, monkeypatch):
    folder, opened = tmp_path / "out", []
    true_open = os.open

    def open_and_lose(path, *arguments, **options):
        number = true_open(path, *arguments, **options)
        if path == folder and not opened:
            opened.append(number)
            folder.rmdir()  # by a run that was refused
        return number

    monkeypatch.setattr("skyproof.app.common.folder.os.open", open_and_lose)
    with claim(folder):
        assert opened
        assert folder.is_dir()


@pytest.mark.parametrize("out", ["", "a-file", "a-file/in"])
def test_what_is_no_folder_is_refused(tmp_path, monkeypatch, out):
    monkeypatch.chdir(tmp_path)
    Path("a-file").touch()
    with pytest.raises(OutputError, match="--out"), claim(out):
        pass


def test_an_error_of_the_run_is_not_taken_for_one_of_the_folder(tmp_path):
    with pytest.raises(FileNotFoundError), claim(tmp_path):
        (tmp_path / "none").read_text()


@pytest.mark.parametrize(
    ("taken", "earlier", "overwrite", "words"),
    [
        ((), (), False, None),
        (("a",), ("a", "b"), True, None),
        (("a",), ("a", "b"), False, r"what was: a, b; .*--overwrite"),
        ((), ("b",), False, "what was: b;"),
        (("a", "mine"), ("a",), True, r"^[^:]*: mine .*\bearlier\b"),
        (("mine",), (), False, r"mine .*overwritten"),
    ],
)
def test_only_our_own_files_are_overwritten_and_only_on_request(tmp_path, taken, earlier, overwrite, words):
    if words is None:
        require_free(tmp_path, taken, earlier, "what was", overwrite=overwrite)
    else:
        with pytest.raises(OutputError, match=words):
            require_free(tmp_path, taken, earlier, "what was", overwrite=overwrite)
