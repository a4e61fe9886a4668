"""Run items on the nodes of a Ray cluster, which see the same files and have the same version installed.

Ray is an extra of the package, so this module is imported only where a cluster is asked for.
"""

import logging
import socket
from importlib.metadata import version
from typing import Any, Final, Self

import ray
from ray.exceptions import RayError

from skyproof.batch.attempt import ONE_THREAD, attempt
from skyproof.batch.item import Ended, Task
from skyproof.errors import SettingsError

__all__ = ["RayNodes"]

AHEAD: Final = 2
"""Tasks given to the cluster per processor: one at work, and one that can begin at once when that ends."""

REACHED_S: Final = 5.0
"""Longest time to wait for the address to answer."""


class RayNodes:
    """The cluster at an address: "auto" for the one that this machine belongs to, HOST:PORT or ray://HOST:PORT.

    The driver is connected within a `with` block.

    Raises
    ------
    SettingsError : on entering, if there is no cluster at the address.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._keys: dict[Any, str] = {}

    def __enter__(self) -> Self:
        try:
            _require_reached(self.address)
            ray.init(
                address=self.address,
                runtime_env={"env_vars": ONE_THREAD},
                log_to_driver=False,
                logging_level=logging.ERROR,
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise SettingsError(
                f"no Ray cluster can be used at {self.address!r} ({' '.join(str(error).split())}); start one with "
                "`ray start --head` and name its address"
            ) from error
        # No retries of Ray's own: the run notices a dead worker and repeats its item, with every runner alike.
        self._attempt = ray.remote(num_cpus=1, max_retries=0)(_attempt)
        self._version = version("skyproof")
        return self

    def __exit__(self, *_: object) -> None:
        for reference in self._keys:
            ray.cancel(reference, force=True)
        ray.shutdown()

    @property
    def free(self) -> int:
        """Return how many tasks can be begun now; grows with nodes that join."""
        return AHEAD * max(int(ray.cluster_resources().get("CPU", 0.0)), 1) - len(self._keys)

    def begin(self, task: Task) -> None:
        """Give a task to the cluster."""
        self._keys[self._attempt.remote(task, self._version)] = task.item.key

    def collect_ended(self, timeout_s: float) -> list[Ended]:
        """Collect the tasks that ended since the last call, waiting up to a time for one."""
        ready, _ = ray.wait(list(self._keys), num_returns=1, timeout=timeout_s)
        return [self._read_answer(reference) for reference in ready]

    def _read_answer(self, reference: Any) -> Ended:
        key = self._keys.pop(reference)
        try:
            answer: Ended = ray.get(reference)
        except RayError as error:
            return Ended(
                key=key, error=f"its process ended before it was done (Ray: {type(error).__name__})", lost=True
            )
        return answer


def _require_reached(address: str) -> None:
    """Raise OSError within seconds if nothing answers; Ray itself would try for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host, int(port)), REACHED_S).close()


def _attempt(task: Task, expected: str) -> Ended:
    """Attempt a task on a node, which must have the run's version, as another one makes other bytes."""
    if (found := version("skyproof")) != expected:
        return Ended(
            key=task.item.key, error=f"a node has skyproof {found}, the run {expected}; install the same on all"
        )
    return attempt(task)
