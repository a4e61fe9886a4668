"""Items done by processes of this machine."""

import os
import socket
import subprocess
import sys
from multiprocessing.connection import Connection, wait
from typing import Self

from skyproof.batch.attempt import ONE_THREAD
from skyproof.batch.item import Ended, Task

__all__ = ["Processes"]


class _Worker:
    """One process, and the task that it has."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "skyproof.batch.worker", str(theirs.fileno()), str(os.getpid())],
                pass_fds=(theirs.fileno(),),
                # the same modules are to be found there as here, by the same names
                env=os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C at a terminal is for the run, which lets items come to their end
            )
        self.tasks = Connection(ours.detach())
        self.key: str | None = None

    def begin(self, task: Task) -> None:
        """Raises OSError if the process has ended."""
        self.tasks.send(task)
        self.key = task.item.key

    def wait_for_end(self) -> Ended:
        """Wait until its task has ended, and return how."""
        key, self.key = self.key or "", None
        try:
            answer: Ended = self.tasks.recv()
        except (EOFError, OSError):
            code = self.process.wait()
            how = f"signal {-code}" if code < 0 else f"exit code {code}"
            return Ended(key=key, error=f"the process that did it ended before it ({how})", lost=True)
        return answer

    def stop(self) -> None:
        self.tasks.close()
        self.process.kill()
        self.process.wait()


class Processes:
    """As many processes as given; one that dies loses its item and is replaced. For a block `with`, at whose end all
    are stopped.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._workers: list[_Worker] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        while self._workers:
            self._workers.pop().stop()

    @property
    def free(self) -> int:
        """Return how many tasks can be begun now."""
        return self.count - sum(worker.key is not None for worker in self._workers)

    def begin(self, task: Task) -> None:
        """Give a task to a process that has none."""
        for worker in [free for free in self._workers if free.key is None]:
            try:
                return worker.begin(task)
            except OSError:
                self._drop(worker)
        self._workers.append(_Worker())
        self._workers[-1].begin(task)

    def collect_ended(self, timeout_s: float) -> list[Ended]:
        """Collect the tasks that ended since the last call, waiting up to a time for one."""
        busy = {worker.tasks: worker for worker in self._workers if worker.key is not None}
        found = []
        for ready in wait(list(busy), timeout_s):
            worker = busy[ready]  # type: ignore[index]
            found.append(worker.wait_for_end())
            if found[-1].lost:
                self._drop(worker)
        return found

    def _drop(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.stop()
