"""Arguments in, words out: one module a command.

Results go to standard output, everything else to standard error. Exit codes: 0 it ran to its end; with --exit-code
0 authentic, 1 spoofed, 3 suspect, 4 no attack seen; 2 an error, reported in one line; 130, 143, 129 ended by Ctrl-C,
SIGTERM, SIGHUP, with what was decided so far.

A command's module is loaded when the command is called, and what computes (`skyproof.app`) when it is to work: help
and errors come at once.
"""

import errno
import io
import logging
import os
import sys
import traceback
from collections.abc import Sequence
from itertools import pairwise

from cyclopts import App, CycloptsError, Parameter

from skyproof.cli.screen import complain
from skyproof.cli.usage import describe_usage
from skyproof.errors import SettingsError, SkyproofError
from skyproof.interruption import ENDING, Stopped, get_exit_code, has_come, listen

__all__ = ["app", "main"]

ERROR = 2
BROKEN_PIPE = 141
"""As of a program that the signal SIGPIPE ends."""
_UNWRITTEN = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF, errno.EPIPE)
AFTER_DEMO = "Example, after `skyproof demo --out demo`:\n\n"
COMMANDS = {
    "protect": (
        "[INPUT...] --out FOLDER [OPTIONS]",
        "Detect spoofed signals, which and since when, and give a position that can be trusted.",
        AFTER_DEMO
        + "skyproof protect demo/bow.bin demo/stern.bin --nav demo/broadcast.rnx --out out\n\n"
        + "The same with a platform file:\n\n"
        + "skyproof init demo/bow.bin demo/stern.bin --out demo/ship.toml\n"
        + "skyproof protect --platform demo/ship.toml --nav demo/broadcast.rnx --out out",
    ),
    "inspect": (
        "FILE [OPTIONS]",
        "Inspect a recording, log or observation file: what it holds, whether it is usable, what would improve it.",
        AFTER_DEMO + "skyproof inspect demo/bow.bin",
    ),
    "receive": (
        "FILE... --out FOLDER [OPTIONS]",
        "Track every signal in recordings and write RINEX observations and navigation data, without judging them.",
        AFTER_DEMO + "skyproof receive demo/bow.bin --nav demo/broadcast.rnx --out out",
    ),
    "simulate": (
        "SCENARIO --out FOLDER [OPTIONS]",
        "Simulate recordings and measurements of a scene with attacks, and write the truth beside them.",
        "Examples:\n\nskyproof simulate --list\nskyproof simulate takeover --out scene",
    ),
    "init": (
        "FILE... [--out PLATFORM] [OPTIONS]",
        "Write a platform file from what the inputs state, with lines to complete for the rest.",
        AFTER_DEMO + "skyproof init demo/bow.bin demo/stern.bin --out demo/ship.toml",
    ),
    "verify": (
        "FOLDER [OPTIONS]",
        "Check that the results and inputs of a run are unchanged since it ended.",
        AFTER_DEMO + "skyproof verify demo",
    ),
    "fleet": (
        "CATALOGUE --out FOLDER [OPTIONS]",
        "Protect every recording, pair or station of a catalogue in parallel, with one overview page.",
        AFTER_DEMO + "skyproof fleet demo/catalogue.csv --out fleet",
    ),
    "study": (
        "NAME [OPTIONS]",
        "Reproduce a figure of a paper, with the figures of skyproof beside it.",
        "Examples:\n\nskyproof study --list\nskyproof study multi-receiver.false-alarm --quick",
    ),
    "demo": (
        "[OPTIONS]",
        "Simulate two receivers that are jammed and then meaconed, and protect them.",
        "Example:\n\nskyproof demo --out demo",
    ),
}
"""How each command is called, what it does, and examples: what the list of commands needs without loading them."""

START = """Try it:

skyproof demo --out demo

With a recording of your own:

skyproof inspect FILE
skyproof protect FILE... --nav NAVIGATION_FILE --out FOLDER

All options of a command: `skyproof COMMAND --help`"""

app = App(
    name="skyproof",
    help="Tells true satellite-navigation signals from false ones, and gives the true position and time.",
    help_epilogue=START,
    help_format="plaintext",  # Markdown takes a quarter of the time that help takes
    default_parameter=Parameter(negative=(), show_default=False),
    suppress_keyboard_interrupt=False,
    version_flags=[],
)
app["--help"].help = "Show what a command does, its options and an example."
for _number, (_name, (_usage, _help, _example)) in enumerate(COMMANDS.items()):
    app.command(
        f"skyproof.cli.{_name}:{_name}",
        name=_name,
        usage=f"Usage: skyproof {_name} {_usage}",
        help=_help,
        help_epilogue=_example,
        sort_key=_number,
    )
app.command(
    "skyproof.cli.about:about",
    name=("--version", "-V"),
    help="Print the versions of skyproof and of what it runs on: include them in a bug report.",
)
app.command(
    "skyproof.cli.completion:install_completion",
    name="--install-completion",
    help="Let the shell complete commands, options and files with Tab.",
    help_epilogue="Example:\n\nskyproof --install-completion --shell bash",
)


class _Complaints(logging.Handler):
    """What the package logs, as one line each on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        complain(record.getMessage())


logging.getLogger("skyproof").addHandler(_Complaints())


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line (without the program's name) and return its exit code; never raises."""
    tokens = list(sys.argv[1:] if argv is None else argv)
    # Read when NumPy is loaded, which is later. On a busy machine threads that share a small matrix wait for each other
    # fifty times as long as the work takes; what is worth sharing out is shared out by satellite.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_streams()
    with listen(*ENDING):
        return _run(tokens)


def _run(tokens: Sequence[str]) -> int:
    try:
        _require_no_empty(tokens)
        result = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except SystemExit:  # so Rich ends where who reads standard output is gone; 1 would say "spoofed"
        return get_exit_code() if has_come() else BROKEN_PIPE
    except KeyboardInterrupt as interruption:
        complain(str(interruption) or "interrupted before there was a result")
        return get_exit_code()
    except Stopped as stop:
        complain(f"interrupted a second time: {str(stop) or 'ended at once, nothing further was written'}")
        return get_exit_code()
    except Exception as error:
        if (code := _code_if_unwritten(error)) is not None:
            return code
        if "--debug" in tokens:
            traceback.print_exc()
        complain(_words_of(error))
        return ERROR
    finally:
        _flush_quietly()


def _require_no_empty(tokens: Sequence[str]) -> None:
    """Raise SettingsError if an argument is empty: what a shell makes of a variable that is not set."""
    for before, token in pairwise(["", *tokens]):
        if token == "" or (token.startswith("--") and token.endswith("=")):
            name = token.removesuffix("=") or (before if before.startswith("--") else "an argument")
            raise SettingsError(f"{name} is empty; give a value, or leave it out (is a variable of the shell not set?)")


class _Nowhere(io.TextIOBase):
    """Takes everything."""

    encoding = "utf-8"

    def write(self, text: str, /) -> int:
        return len(text)


class _Closed(io.TextIOBase):
    """Standard output that was closed before the start."""

    encoding = "utf-8"

    def write(self, text: str, /) -> int:
        raise OSError(errno.EBADF, "it is closed")


def _open_streams() -> None:
    """Let the streams take any sign that their encoding lacks, and no file take the number of one that is closed."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or _Closed()
    sys.stderr = sys.stderr or _Nowhere()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _code_if_unwritten(error: Exception) -> int | None:
    """The exit code if standard output could not be written; files that cannot raise an error of ours."""
    if not isinstance(error, OSError) or error.filename is not None or error.errno not in _UNWRITTEN:
        return None
    if has_come():  # the terminal is gone with the connection, or who reads has ended with us
        return get_exit_code()
    if isinstance(error, BrokenPipeError):
        return BROKEN_PIPE  # who reads has read enough
    complain(f"standard output cannot be written ({error.strerror}); files that were to be written are whole")
    return ERROR


def _flush_quietly() -> None:
    """What a stream does not take now it will not take when Python ends either, which then makes an exit code of it."""
    for name in ("stdout", "stderr"):
        try:
            getattr(sys, name).flush()
        except OSError:
            setattr(sys, name, _Nowhere())


def _words_of(error: Exception) -> str:
    if isinstance(error, SkyproofError):
        return str(error)
    if isinstance(error, CycloptsError):
        return describe_usage(error)
    return (
        f"unexpected {type(error).__name__}: {error}. This is a fault of skyproof, not of the input: run the command "
        "again with --debug and report what it prints, with what `skyproof --version` prints"
    )
