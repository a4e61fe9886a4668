"""Shared by all tests: where the recordings are, if they are; and the table of all messages, if it is wanted."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from tests.messages import Message, Recorder, list_unraised, make_table

from skyproof.interruption import ENDING

ROOT = Path(__file__).resolve().parent.parent
RECORDER = pytest.StashKey[Recorder]()

# The same examples every time, but for numbers that Hypothesis takes from the modules read so far, however slow the
# machine; `pytest --hypothesis-profile search` looks for new ones, and for more where a test does not say how many.
settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=25)
settings.register_profile("search", deadline=None, max_examples=1000)
settings.load_profile("repeatable")

# Under `nohup`, or behind `&` in a script, signals are ignored, also by the programs that tests start.
for number in ENDING:
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of recordings: $SKYPROOF_DATA, or the one beside the checkout; skip without it."""
    folder = Path(os.environ.get("SKYPROOF_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set SKYPROOF_DATA to the folder that holds them")
    return folder


# Messages


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--messages", metavar="FILE", help="write a table of all error messages that the tests raise")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--messages"):
        config.stash[RECORDER] = Recorder()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Add what a worker of pytest-xdist has seen to the table when it ends."""
    for message in getattr(node, "workeroutput", {}).get("messages", ()):
        node.config.stash[RECORDER].add(Message(**message))


def pytest_sessionfinish(session: pytest.Session) -> None:
    recorder = session.config.stash.get(RECORDER, None)
    if recorder is None:
        return
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["messages"] = recorder.sent()
        return
    path, messages = Path(session.config.getoption("--messages")), list(recorder.messages.values())
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(make_table(messages), encoding="utf-8")
    report = session.config.pluginmanager.get_plugin("terminalreporter")
    missing = [f"{site.name}, line {site.first_line}" for site in list_unraised(messages)]
    lines = [f"{len(messages)} messages in {path}", *(f"no test raises the error of {name}" for name in missing)]
    for line in lines:
        report.write_line(line)
    if missing:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
