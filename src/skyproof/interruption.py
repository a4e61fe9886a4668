"""Ctrl-C, SIGTERM and SIGHUP: one wish that a run ends early, heard in one place.

The first signal raises KeyboardInterrupt where nothing is lost by it. In a block `defer` it is only noted: loops ask
`watch` between two steps and end there, so that nothing is left half done. The second one raises `Stopped`, and the
third one kills.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import Final

__all__ = ["ENDING", "Stopped", "defer", "get_exit_code", "has_come", "listen", "raise_at_signal", "watch"]

ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What a terminal, a service manager or a scheduler sends to end a program."""

PAIR_S: Final = 0.5
"""A signal that follows the first one so soon is the same wish: `timeout` sends SIGTERM to a process and to its group,
a shell passes SIGHUP on to processes that the kernel has sent it to, systemd can send SIGTERM and SIGHUP. Ctrl-C is
pressed by a person and always counts."""


class Stopped(BaseException):
    """A second signal: everything ends here. Code that uses what a first signal left must not catch it."""


class _State:
    """What was heard in this process; signals are handled in its main thread only."""

    def __init__(self) -> None:
        self.listens = False
        self.defers = False
        self.number: int | None = None
        self.heard_s = 0.0


_STATE = _State()


def _hear(number: int, frame: FrameType | None) -> None:
    now_s = time.monotonic()
    if _STATE.number is None:
        _STATE.number, _STATE.heard_s = number, now_s
        if not _STATE.defers:
            raise KeyboardInterrupt
    elif number == signal.SIGINT or now_s - _STATE.heard_s > PAIR_S:
        for each in ENDING:
            if signal.getsignal(each) is _hear:
                signal.signal(each, signal.SIG_DFL)
        raise Stopped


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def listen(*numbers: signal.Signals) -> Iterator[None]:
    """Listen to the signals during the block; an ignored one, as under `nohup`, stays ignored.

    Does nothing within another such block, or in another thread than the main one, which hears no signals.
    """
    if _STATE.listens or not _is_main():
        yield
        return
    before = {each: signal.getsignal(each) for each in numbers}
    _STATE.listens, _STATE.number = True, None
    try:
        for each, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(each, _hear)
        yield
    finally:
        _STATE.listens = False
        for each, handler in before.items():
            signal.signal(each, signal.SIG_DFL if handler is None else handler)


@contextmanager
def defer() -> Iterator[None]:
    """Note a first signal during the block, in place of raising KeyboardInterrupt.

    Hears Ctrl-C if no other block listens.
    """
    with ExitStack() as stack:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            stack.enter_context(listen(signal.SIGINT))
        stack.enter_context(_set_deferring(True))
        yield


@contextmanager
def raise_at_signal() -> Iterator[None]:
    """Raise KeyboardInterrupt at a first signal during the block, also within a block `defer`."""
    with _set_deferring(False):
        yield


@contextmanager
def _set_deferring(defers: bool) -> Iterator[None]:
    if not _is_main():
        yield
        return
    before, _STATE.defers = _STATE.defers, defers
    try:
        yield
    finally:
        _STATE.defers = before


def watch() -> Callable[[], bool]:
    """Return a function that says whether a first signal was heard since now."""
    earlier = has_come()
    return lambda: has_come() and not earlier


def has_come() -> bool:
    """Test whether a signal was heard since listening began."""
    return _STATE.number is not None


def get_exit_code() -> int:
    """Return 128 and the number of the signal that was heard, as a shell does; of Ctrl-C if none was."""
    return 128 + (signal.SIGINT if _STATE.number is None else _STATE.number)
