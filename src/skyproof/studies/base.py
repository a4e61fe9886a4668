"""A study: one figure or table of a paper again, as rows, with ours beside it.

A module a paper holds its studies in `STUDIES`. A study counts with a generator of its own, so that the same seed gives
the same rows whatever else is run; `quick` takes no more than 20 s.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from skyproof.records import AntennaArray, SpinArm
from skyproof.report.chart import Axes

__all__ = ["Claim", "Row", "Study", "StudySettings", "rows_where", "value_of"]

Row = Mapping[str, Any]
"""One line of a study's result: names with units to numbers, words or None."""

PAPER, SAME, BETTER, PROTECT, REFERENCE = "paper", "ours, same method", "ours, better", "through protect", "reference"
COLUMNS: Final = (PAPER, SAME, BETTER, PROTECT, REFERENCE)


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """trials : None means the study's own number, fewer if `quick`.

    arrays, arms : of the user's platform, for studies that take one; some usual ones where there are none.
    folder : where a study that takes hours keeps what is ready, and finds it again. report : is given how many pieces
        of such a study are done.
    """

    trials: int | None = None
    seed: int = 1
    quick: bool = False
    arrays: Mapping[str, AntennaArray] = field(default_factory=dict)
    arms: tuple[SpinArm, ...] = ()
    folder: Path | None = None
    report: Callable[[int], None] = lambda done: None

    def count(self, usual: int, quick: int) -> int:
        """Return how many trials to run."""
        if self.trials is not None:
            return self.trials
        return quick if self.quick else usual

    def rng(self, stream: int = 0) -> np.random.Generator:
        """Return random numbers of this study; streams are independent."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(stream,)))


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One line of the table of validation: a figure of the paper, ours by the same method, by a better one, and what is
    right by an independent check.

    paper, reference : a number, or words where it is none (why it cannot be reproduced, for example).
    same, better : from the rows to a number; None where there is none. `reference` may be from the rows too: a bound.
    protect : from the rows to the number that the command `protect` gives a user; None where it reaches no such figure.
    across : column of a table of its own, for claims of one `what` that differ in this only.
    tolerance : of `same`, or of `better` where there is no `same`, against `reference` (else `paper`), absolute; from
        the rows to it where it depends on how many were counted; None where they are not to agree.
    """

    what: str
    paper: float | str | None = None
    reference: float | str | Callable[[Sequence[Row]], float] | None = None
    same: Callable[[Sequence[Row]], float] | None = None
    better: Callable[[Sequence[Row]], float] | None = None
    protect: Callable[[Sequence[Row]], float] | None = None
    tolerance: float | Callable[[Sequence[Row]], float] | None = None
    digits: int = 4
    across: str = ""


@dataclass(frozen=True, kw_only=True)
class Study:
    """name : paper.figure, as on the command line. figure : where in the paper; `run` yields each row when it is ready.

    platform : which key of a receiver in a platform file the study takes; None if it takes none.
    note : what holds for all its figures, for the page of validation.
    """

    name: str
    title: str
    paper: str
    figure: str
    run: Callable[[StudySettings], Iterator[Row]]
    charts: tuple[Axes, ...] = ()
    claims: tuple[Claim, ...] = ()
    platform: Literal["antennas_m", "spin"] | None = None
    note: str = ""


def rows_where(rows: Sequence[Row], **where: Any) -> list[Row]:
    """Select the rows with these values."""
    return [row for row in rows if all(row.get(key) == value for key, value in where.items())]


def value_of(
    column: str, choose: Callable[[Sequence[float]], float] = lambda values: values[0], **where: Any
) -> Callable[[Sequence[Row]], float]:
    """Make a claim's function from rows to one figure, which `choose` makes of a column in `rows_where`.

    None in the column does not count; NaN if nothing is left, as in a quick run that leaves those rows out.
    """

    def find_value(rows: Sequence[Row]) -> float:
        values = [row[column] for row in rows_where(rows, **where) if row[column] is not None]
        return float(choose(values)) if values else float("nan")

    return find_value
