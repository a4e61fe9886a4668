"""The door: items in, results in a folder, whoever does them."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from skyproof.batch.item import Ended, Item, Task, Work
from skyproof.batch.store import Store
from skyproof.interruption import Stopped, defer, has_come

__all__ = ["Runner", "run"]

POLL_S = 0.5
"""Between looks at whether the run is to end early."""


class Runner(Protocol):
    """Who does tasks: processes, or the nodes of a cluster."""

    @property
    def free(self) -> int:
        """Return how many tasks can be begun now."""

    def begin(self, task: Task) -> None:
        """Begin a task, and return at once."""

    def collect_ended(self, timeout_s: float) -> list[Ended]:
        """Collect the tasks that ended since the last call, waiting up to a time for one."""


def run(
    items: Sequence[Item],
    work: Work,
    store: Store,
    runner: Runner,
    *,
    report: Callable[[int], None] = lambda done: None,
    say: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, str], bool]:
    """Run every item that the store lacks; return errors by key, and whether Ctrl-C left items out.

    An item whose worker dies is done once more, since that may not have been its fault; whoever loses two is listed.
    After a first Ctrl-C, SIGTERM or SIGHUP no item is begun and those under way come to their end; a second one stops
    them.

    Parameters
    ----------
    store : within its `with` block. runner : as well.
    report : is given how many items have ended, those of earlier runs too. say : a line for the user.

    Raises
    ------
    ValueError : two items have one key, or the work is a function of the program itself, which others cannot import.
    Stopped : a signal came twice.
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
    announced = False
    try:
        with defer():
            while under_way or (waiting and not has_come()):
                while waiting and runner.free > 0 and not has_come():
                    runner.begin(Task(item=waiting.popleft(), work=work, store=store.folder.absolute()))
                    under_way += 1
                if has_come() and not announced:
                    say("interrupted: items under way come to their end; interrupt again to stop them too")
                    announced = True
                for ended in runner.collect_ended(POLL_S):
                    under_way -= 1
                    if ended.lost and ended.key not in lost:
                        lost.add(ended.key)
                        waiting.appendleft(by_key[ended.key])
                    elif ended.error is not None:
                        errors[ended.key] = f"{ended.error}, twice" if ended.lost else ended.error
                report(len(items) - len(waiting) - under_way)
    except Stopped:
        raise Stopped("what is done is kept; the same command continues from it") from None
    return errors, bool(waiting)
