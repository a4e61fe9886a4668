"""What there is to do, and how it ended."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Ended", "Item", "Task", "Work"]

Work = Callable[[Any, Path], None]
"""What is done for an item: takes `given` and an empty folder, and writes into it. A function of a module, since other
processes find it by name; of the same `given` it makes the same bytes."""


@dataclass(frozen=True, kw_only=True)
class Item:
    """key : its name among all, and of its folder. given : what the work takes; is pickled.

    same_as : text that changes with everything that the result depends on: an item whose result was made of another
        text is done again.
    """

    key: str
    given: Any
    same_as: str


@dataclass(frozen=True, kw_only=True)
class Task:
    """One item to be done, with the work and the folder of the store: all that another process needs."""

    item: Item
    work: Work
    store: Path


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How an attempt ended. error : in one line; None if the item is done. lost : whoever did it ended before it."""

    key: str
    error: str | None = None
    lost: bool = False
