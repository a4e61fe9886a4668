"""Where a receiver's epochs come from: the only door, of what is whole and of what is still coming."""

from dataclasses import dataclass
from typing import Protocol

from skyproof.formats.pieces import Workspace
from skyproof.formats.spool import ObservationSpool
from skyproof.records import ObservationLog, Observations

__all__ = ["EpochSource", "FedSource", "WholeSource"]


class EpochSource(Protocol):
    """Measurements of one receiver.

    log : all epochs that came so far. ended : whether nothing more comes.
    """

    @property
    def log(self) -> ObservationLog: ...
    @property
    def ended(self) -> bool: ...


@dataclass(frozen=True, eq=False)
class WholeSource:
    """A log that is whole: a file, or a recording that was tracked."""

    log: ObservationLog
    ended: bool = True


class FedSource:
    """Epochs that are fed as they come, in pieces of any size.

    workspace : on whose disk measurements are kept; in a temporary folder if absent. Of each epoch 16 bytes stay in
    memory, and a quarter of a byte a cell.
    """

    def __init__(self, receiver: str, workspace: Workspace | None = None) -> None:
        self._spool = ObservationSpool(workspace or Workspace(None), receiver)
        self._ended = False

    @property
    def log(self) -> ObservationLog:
        """Return what came so far."""
        return self._spool

    @property
    def ended(self) -> bool:
        """Return whether nothing more comes."""
        return self._ended

    def feed(self, piece: Observations) -> None:
        """Add epochs. Raises ValueError if they do not follow those before in time, or after the end."""
        if self._ended:
            raise ValueError(f"{self._spool.receiver}: epochs after the end")
        self._spool.append(piece)

    def end(self) -> None:
        """Mark the end of the epochs: the last window is then complete."""
        self._ended = True
