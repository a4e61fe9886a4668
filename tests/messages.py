"""Every error that the tests raise, as a table to be read aloud: does each message say what to do?

`pytest --messages FILE` writes it and fails if an error of the source was never raised. An error is known by the place
in the source that makes it and by its words, numbers and quoted words left out.
"""

import ast
import html
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from types import FrameType

from cyclopts import CycloptsError

import skyproof
from skyproof import cli, errors
from skyproof.errors import SkyproofError

__all__ = ["NEVER_RAISED", "Message", "Recorder", "Site", "list_sites", "list_unraised", "make_table"]

SOURCE = Path(skyproof.__file__).parent
COMMAND_LINE = "command line"
SHOWN = 12
"""Messages of one place that are printed."""

NEVER_RAISED: dict[str, str] = {}
"""Places ("file function") whose errors no test can raise, with the reason."""


@dataclass(frozen=True)
class Message:
    """One error: its class, the file and line that made it, its words, and the test that saw it first."""

    error: str
    file: str
    line: int
    words: str
    test: str

    @property
    def key(self) -> tuple[str, str, int, str]:
        """Return the same key for messages that differ in numbers, quoted words and folders only."""
        words = re.sub(r"\S+ is not a known key; did you mean \S+", "…", shorten_paths(self.words))
        words = re.sub(r"\"[^\"]*\"|'[^']*'", "…", words)
        return self.error, self.file, self.line, re.sub(r"\d+(\.\d+)?(e[+-]?\d+)?", "0", words)[:120]


@dataclass(frozen=True)
class Site:
    """A place of the source that makes an error."""

    file: str
    function: str
    first_line: int
    last_line: int

    @property
    def name(self) -> str:
        return f"{self.file} {self.function}"

    def made(self, message: Message) -> bool:
        return message.file == self.file and self.first_line <= message.line <= self.last_line


class Recorder:
    """Notes every SkyproofError that is made from now on, and every error in the use of the command line."""

    def __init__(self) -> None:
        self.messages: dict[tuple[str, str, int, str], Message] = {}
        words_of, init = cli._words_of, SkyproofError.__init__

        def noting_words_of(error: Exception) -> str:
            words = words_of(error)
            if isinstance(error, CycloptsError):
                self._note(type(error).__name__, COMMAND_LINE, 0, words)
            return words

        def noting_init(error: SkyproofError, *args: str) -> None:
            init(error, *args)
            caller: FrameType | None = sys._getframe(1)
            while caller is not None and caller.f_locals.get("self") is error:  # an error that words itself
                caller = caller.f_back
            if caller is None:
                return
            path = Path(caller.f_code.co_filename)
            if SOURCE in path.parents:
                self._note(type(error).__name__, path.relative_to(SOURCE).as_posix(), caller.f_lineno, str(error))

        cli._words_of = noting_words_of
        SkyproofError.__init__ = noting_init  # type: ignore[method-assign]

    def _note(self, error: str, file: str, line: int, words: str) -> None:
        test = os.environ.get("PYTEST_CURRENT_TEST", "").partition(" (")[0]
        self.add(Message(error, file, line, words, re.sub(r"\[.*", "", test)))

    def add(self, message: Message) -> None:
        self.messages.setdefault(message.key, message)

    def sent(self) -> list[dict[str, object]]:
        """Return what another process can take with `add`."""
        return [asdict(message) for message in self.messages.values()]


@cache
def list_sites() -> tuple[Site, ...]:
    """List every place of the source that makes a SkyproofError, by file and line."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(SOURCE.rglob("*.py"))}
    names = {name for name, value in vars(errors).items() if isinstance(value, type)}
    for text in texts.values():  # a room may have an error of its own
        names |= set(re.findall(rf"^class (\w+)\((?:{'|'.join(names)})\)", text, re.MULTILINE))
    found: list[Site] = []
    for path, text in texts.items():
        if any(name in text for name in names):
            found += _list_sites_in(ast.parse(text), path.relative_to(SOURCE).as_posix(), names)
    return tuple(found)


def _list_sites_in(node: ast.AST, file: str, names: set[str], function: str = "") -> Iterator[Site]:
    for child in ast.iter_child_nodes(node):
        inner = child.name if isinstance(child, ast.FunctionDef | ast.ClassDef) else function
        if isinstance(child, ast.Call) and isinstance(child.func, ast.Name) and child.func.id in names:
            yield Site(file, function, child.lineno, child.end_lineno or child.lineno)
        yield from _list_sites_in(child, file, names, inner)


def list_unraised(messages: list[Message]) -> list[Site]:
    """List places whose error was not seen and that have no reason for it."""
    return [
        site
        for site in list_sites()
        if site.name not in NEVER_RAISED and not any(site.made(message) for message in messages)
    ]


def make_table(messages: list[Message]) -> str:
    """Make a table of all messages in Markdown, by the file of the source that makes them."""
    seen = sorted(messages, key=lambda m: (m.file, m.line, m.words))
    lines = [
        "# Messages",
        "",
        "Every error that the tests raise, as printed: `skyproof: ` and these words on one line, exit code 2. "
        "Folders are left out; of one place in the source no more than "
        f"{SHOWN} messages are shown.",
    ]
    for file in dict.fromkeys(message.file for message in seen):
        lines += ["", f"## {file}", "", "| error | message | made at line | test |", "|---|---|---|---|"]
        places: dict[int, int] = {}
        for message in (m for m in seen if m.file == file):
            places[message.line] = places.get(message.line, 0) + 1
            if places[message.line] <= SHOWN or file == COMMAND_LINE:
                cells = (message.error, shorten_paths(message.words), str(message.line or ""), message.test)
                lines.append(f"| {' | '.join(map(_make_cell, cells))} |")
    if NEVER_RAISED:
        lines += ["", "## Raised by no test", "", "| place | why |", "|---|---|"]
        lines += [f"| {_make_cell(place)} | {_make_cell(why)} |" for place, why in NEVER_RAISED.items()]
    return "\n".join(lines) + "\n"


def shorten_paths(words: str) -> str:
    """Shorten paths to their last part: the folders are those of one machine."""
    return re.sub(r"(?<![\w.`])(?:/[^\s/:;,'\"()`]+)+/(?=[^\s/])", "", words)


def _make_cell(text: str) -> str:
    """Return the words on one line, whatever signs of Markdown are in them."""
    plain = "".join(sign if sign.isprintable() else "�" for sign in " ".join(text.split()))
    return re.sub(r"[|`*\\]", lambda sign: f"&#{ord(sign[0])};", html.escape(plain, quote=False))
