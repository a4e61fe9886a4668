"""Arguments in, words out: one module a command.

Results go to standard output, everything else to standard error. Exit codes: 0 it ran to its end; with --exit-code
0 authentic, 1 spoofed, 3 undecided; 2 an error, told in one line; 130 interrupted, with what was decided so far.

A command's module, and with it all that computes, is loaded when the command is called: help and errors come at once.
"""

import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import version

from cyclopts import App, CycloptsError, Parameter

from skyproof.cli.screen import INTERRUPTED, complain
from skyproof.errors import SkyproofError

__all__ = ["app", "main"]

ERROR = 2
AFTER_DEMO = "Example, with the recordings that `skyproof demo --out demo` makes:\n\n"
COMMANDS = {
    "protect": (
        "Say whether signals in recordings are spoofed, since when and which, and give the position to be trusted.",
        AFTER_DEMO + "skyproof protect demo/bow.bin demo/stern.bin --nav demo/broadcast.rnx --out out",
    ),
    "inspect": (
        "Say what is in a recording, and whether it is usable: levels, lines, satellites, lost samples, oscillator.",
        AFTER_DEMO + "skyproof inspect demo/bow.bin",
    ),
    "receive": (
        "Track every signal in recordings and write RINEX observations and navigation data, without judging them.",
        AFTER_DEMO + "skyproof receive demo/bow.bin --nav demo/broadcast.rnx --out out",
    ),
    "simulate": (
        "Make recordings and measurements of a scene with attacks, and write the truth about them.",
        "Example:\n\nskyproof simulate takeover --out scene",
    ),
    "study": (
        "Make a figure of a paper again, with ours beside it.",
        "Example:\n\nskyproof study multi-receiver.false-alarm --quick",
    ),
    "demo": (
        "Simulate two receivers near a meaconer, which rebroadcasts the sky of another place, and protect them.",
        "Example:\n\nskyproof demo --out demo",
    ),
}
"""What each command does, and an example: what the list of commands needs without loading them."""

app = App(
    name="skyproof",
    help="Tells true satellite-navigation signals from false ones, and gives the true position and time back.",
    help_epilogue="Try it: `skyproof demo --out demo`",
    version=lambda: version("skyproof"),
    default_parameter=Parameter(negative=(), show_default=False),
    suppress_keyboard_interrupt=False,
)
for _name, (_help, _example) in COMMANDS.items():
    app.command(f"skyproof.cli.{_name}:{_name}", name=_name, help=_help, help_epilogue=_example)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line (without the program's name) and return its exit code; never raises."""
    tokens = list(sys.argv[1:] if argv is None else argv)
    try:
        result = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        return result if isinstance(result, int) else 0
    except KeyboardInterrupt:
        complain("interrupted before anything was decided")
        return INTERRUPTED
    except Exception as error:
        if "--debug" in tokens:
            traceback.print_exc()
        complain(_words_of(error))
        return ERROR


def _words_of(error: Exception) -> str:
    if isinstance(error, SkyproofError):
        return str(error)
    if isinstance(error, CycloptsError):
        command = " ".join(("skyproof", *(error.command_chain or ())))
        return f"{error} For help: {command} --help"
    return (
        f"unexpected {type(error).__name__}: {error}. This is a fault of skyproof, not of the input: run the command "
        "again with --debug and report what it prints"
    )
