"""What a command line prints where: narrow, closed, full and ASCII streams, and names that would command a terminal."""

import errno
import io
import json
import os
import re
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from skyproof import cli
from skyproof.cli.screen import print_table, table
from skyproof.errors import make_readable


def run_shell(redirections: str, *arguments: str, encoding: str = "utf-8") -> tuple[int, bytes, str]:
    """Return exit code, standard output and standard error of a command line in a shell."""
    code = "import sys; from skyproof.cli import main; sys.exit(main())"
    run = subprocess.run(
        ["sh", "-c", f'exec "$@" {redirections}', "sh", sys.executable, "-c", code, *arguments],
        capture_output=True,
        check=False,
        env=os.environ | {"PYTHONIOENCODING": encoding},
    )
    return run.returncode, run.stdout, run.stderr.decode()


@pytest.mark.parametrize(("redirections", "words"), [(">/dev/full", os.strerror(errno.ENOSPC)), (">&-", "closed")])
def test_unwritable_standard_output_is_reported_in_one_line(redirections, words):
    code, _, reported = run_shell(redirections, "--version")
    assert code == 2
    assert re.match(rf"skyproof: .*output .*\(.*{words}\)", reported)
    assert len(reported.splitlines()) == 1


def test_standard_error_that_cannot_be_written_changes_nothing():
    for redirections in ("2>/dev/full", "2>&-"):
        code, out, _ = run_shell(redirections, "inspect", "no such file.bin")
        assert (code, out) == (2, b"")


@pytest.mark.parametrize("arguments", [["--version"], ["study", "--list"]], ids=["plain", "Rich"])
def test_who_has_read_enough_is_not_bothered_with_it(arguments):
    read, write = os.pipe()
    os.close(read)
    code = "import sys; from skyproof.cli import main; sys.exit(main())"
    run = subprocess.run([sys.executable, "-c", code, *arguments], stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (run.returncode, run.stderr) == (141, b"")


def test_an_encoding_without_needed_signs_gets_escapes():
    code, out, reported = run_shell("", "study", "--list", "--json", encoding="ascii")
    assert (code, reported) == (0, "")
    assert out.isascii()
    assert json.loads(out)["studies"]
    code, out, reported = run_shell("", "inspect", "h\u00f6.bin", encoding="ascii")
    assert code == 2
    assert reported.startswith("skyproof: h\\xf6.bin")


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (["protect", "rx1.bin", "--out", ""], "--out"),
        (["protect", "rx1.bin", "--out="], "--out"),
        (["protect", "", "--out", "here"], "an argument"),
    ],
)
def test_an_empty_argument_is_refused(capsys, arguments, name):
    assert cli.main(arguments) == 2
    assert capsys.readouterr().err.startswith(f"skyproof: {name} is empty;")


def test_a_name_does_not_command_the_terminal(capsys):
    assert cli.main(["inspect", "\x1b[31mred\x07\udcff.bin"]) == 2
    reported = capsys.readouterr().err
    assert reported.startswith("skyproof: \\x1b[31mred\\x07\\xff.bin")


@given(st.text(st.characters()))
def test_what_is_readable_has_no_sign_that_is_not(text):
    result = make_readable(text)
    assert result.replace("\n", "").isprintable()
    result.encode()
    assert make_readable(result) == result
    assert result == text or not text.replace("\n", "").isprintable()


@pytest.mark.parametrize("width", [10, 20, 40, 80])
def test_a_narrow_terminal_cuts_no_number(width):
    rows = table("receiver", "position", "latitude", "longitude", numbers=2)
    rows.add_row("bow", "trusted", "57.7012000", "-111.9321000")
    console = Console(width=width, file=io.StringIO())
    print_table(console, rows)
    result = console.file.getvalue()
    for cell in ("trusted", "57.7012000", "-111.9321000"):
        assert cell in result
    assert "\u2026" not in result
