"""A process that does items one after the other: `python -m skyproof.batch.worker DESCRIPTOR PARENT`.

It ends with the process that started it, at once, however that ends. What asks all processes of a service or job to end
(SIGTERM) is left to that one, which lets items under way come to their end.
"""

import ctypes
import os
import signal
import sys
from multiprocessing.connection import Connection

from skyproof.batch.attempt import attempt
from skyproof.interruption import ENDING

__all__ = ["main"]

_PR_SET_PDEATHSIG = 1


def main(descriptor: int, parent: int) -> None:
    """Take tasks from the connection and answer each with how it ended, until there are no more."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before that was asked for
        return
    with Connection(descriptor) as tasks:
        while True:
            try:
                tasks.send(attempt(tasks.recv()))
            except (EOFError, BrokenPipeError, ConnectionResetError):
                return


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
