"""How long work reports how far it is: the protocol that the use cases call, and the one that is silent."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

__all__ = ["Progress", "Silent", "Stage"]


class Stage(Protocol):
    """A stretch of work with a known amount to do."""

    def advance(self, to: float) -> None:
        """Report that `to` of the stage's total is done, counted from its start."""


class Progress(Protocol):
    """Whoever wants to know how far the work is."""

    def stage(self, name: str, total: float | None) -> AbstractContextManager[Stage]:
        """Begin a stage. `name` reads as what is being done ("tracking rx1.bin"); `total` is in any unit, None if it
        is not known before the end.
        """

    def say(self, text: str) -> None:
        """Tell the user one line that is not an error."""


class Silent:
    """Progress without a display: the default of every use case."""

    def advance(self, to: float) -> None:
        """Ignore how far the stage is."""

    def say(self, text: str) -> None:
        """Ignore the line."""

    @contextmanager
    def stage(self, name: str, total: float | None) -> Iterator[Stage]:
        """Begin a silent stage."""
        yield self
