"""The door: items in, results in a folder, whoever does them."""

import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Protocol

from skyproof.batch.item import Ended, Item, Task, Work
from skyproof.batch.store import Store

__all__ = ["Runner", "run"]

POLL_S = 0.5
"""Between looks at whether Ctrl-C was pressed."""


class Runner(Protocol):
    """Who does tasks: processes, or the nodes of a cluster."""

    @property
    def free(self) -> int:
        """How many tasks can be begun now."""

    def begin(self, task: Task) -> None:
        """Have a task done, and come back at once."""

    def ended(self, timeout_s: float) -> list[Ended]:
        """The tasks that ended since it was asked last; waits so long for one, at most."""


def run(
    items: Sequence[Item],
    work: Work,
    store: Store,
    runner: Runner,
    *,
    report: Callable[[int], None] = lambda done: None,
    say: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, str], bool]:
    """Do every item that the store does not have, and return the errors by key, and whether Ctrl-C left items out.

    An item whose worker dies is done once more, since that may not have been its fault; whoever loses two is listed.
    After a first Ctrl-C no item is begun and those under way come to their end; a second one stops them.

    Parameters
    ----------
    store : within its `with` block. runner : as well.
    report : is given how many items have ended, those of earlier runs too. say : a line for the user.

    Raises
    ------
    ValueError : two items have one key, or the work is a function of the program itself, which others cannot import.
    KeyboardInterrupt : Ctrl-C came twice.
    """
    if len({item.key for item in items}) < len(items):
        raise ValueError("two items have one key")
    if work.__module__ == "__main__":
        raise ValueError(f"{work.__qualname__} is a function of the program that runs; put it into a module of its own")
    waiting = deque(item for item in items if not store.has(item))
    for item in waiting:
        store.forget(item.key)  # what is there is of something else
    by_key = {item.key: item for item in waiting}
    errors: dict[str, str] = {}
    lost: set[str] = set()
    under_way = 0
    report(len(items) - len(waiting))
    with _interruptions(say) as interrupted:
        while under_way or (waiting and not interrupted()):
            while waiting and runner.free > 0 and not interrupted():
                runner.begin(Task(item=waiting.popleft(), work=work, store=store.folder.absolute()))
                under_way += 1
            for ended in runner.ended(POLL_S):
                under_way -= 1
                if ended.lost and ended.key not in lost:
                    lost.add(ended.key)
                    waiting.appendleft(by_key[ended.key])
                elif ended.error is not None:
                    errors[ended.key] = f"{ended.error}, twice" if ended.lost else ended.error
            report(len(items) - len(waiting) - under_way)
    return errors, bool(waiting)


@contextmanager
def _interruptions(say: Callable[[str], None]) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed; a second one raises KeyboardInterrupt. Only the main thread hears of it."""
    pressed = False

    def press(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        if pressed:
            raise KeyboardInterrupt("interrupted a second time: what is done is kept; the same command goes on from it")
        pressed = True
        say("interrupted: items under way come to their end; interrupt again to stop them too")

    if threading.current_thread() is not threading.main_thread():
        yield lambda: pressed
        return
    before = signal.signal(signal.SIGINT, press)
    try:
        yield lambda: pressed
    finally:
        signal.signal(signal.SIGINT, before)
