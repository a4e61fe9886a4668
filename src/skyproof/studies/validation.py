"""The table of validation: every figure of the papers beside ours by the same method, a better one, and what is right.

What cannot be reproduced stands in the table as well, with the reason in place of a number.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import date
from importlib.metadata import version

from skyproof.studies.base import COLUMNS, Claim, Row, Study, StudySettings
from skyproof.studies.reached import list_methods_called, list_unreached

__all__ = ["Checked", "check", "table"]

NONE = "–"
NOT_REACHED = "not reached"
NOT_RUN = "not run"
FAMILY = ("same", "better", "through protect", "reference")


class Checked:
    """A claim beside what the rows gave. `agrees` is None where nothing is promised to agree."""

    def __init__(self, claim: Claim, rows: Sequence[Row]) -> None:
        reference = float(claim.reference(rows)) if callable(claim.reference) else claim.reference
        self.claim = replace(claim, reference=reference)
        self.reference = reference
        self.same = None if claim.same is None else float(claim.same(rows))
        self.better = None if claim.better is None else float(claim.better(rows))
        self.protect = None if claim.protect is None else float(claim.protect(rows))
        aim = claim.paper if reference is None or isinstance(reference, str) else reference
        ours = self.better if self.same is None else self.same
        self.tolerance = float(claim.tolerance(rows)) if callable(claim.tolerance) else claim.tolerance
        self.agrees: bool | None = None
        if self.tolerance is not None and ours is not None and isinstance(aim, int | float):
            self.agrees = bool(abs(ours - aim) <= self.tolerance)

    def cells(self) -> tuple[str, ...]:
        """What stands in the columns of `studies.base.COLUMNS`, then the verdict."""
        claim = self.claim
        before = (claim.paper, self.same, self.better)
        if self.agrees is None:
            verdict = NONE
        else:
            verdict = f"{'within' if self.agrees else '**not** within'} {_format_value(self.tolerance, claim.digits)}"
        return (
            *(_format_value(value, claim.digits) for value in before),
            self._through(),
            _format_value(self.reference, claim.digits),
            verdict,
        )

    def _through(self) -> str:
        """What a user gets. Rows of long windows are left out of quick counts."""
        if self.protect is None:
            return NONE if self.same is None and self.better is None else NOT_REACHED
        return _format_value(self.protect, self.claim.digits) if math.isfinite(self.protect) else NOT_RUN


def check(study: Study, rows: Sequence[Row]) -> list[Checked]:
    """Every claim of a study beside its rows."""
    return [Checked(claim, rows) for claim in study.claims]


def table(
    studies: Mapping[str, Study],
    settings: StudySettings,
    *,
    made_on: date | None = None,
    before: Callable[[str], None] | None = None,
) -> str:
    """Run every study and write the page, in Markdown.

    Parameters
    ----------
    made_on : the date that the page shows; today if None.
    before : is given the name of each study before it runs.
    """
    return "\n".join(_lines(studies, settings, made_on or date.today(), before)) + "\n"


def _lines(
    studies: Mapping[str, Study], settings: StudySettings, made_on: date, before: Callable[[str], None] | None
) -> Iterator[str]:
    counts = "quick counts" if settings.quick else "full counts"
    if settings.trials is not None:
        counts = f"{settings.trials} trials each"
    yield "# Validation"
    yield ""
    yield ("Every figure of the papers beside ours, or the reason why it cannot be reproduced.")
    yield ""
    yield "| column | holds |"
    yield "|---|---|"
    yield "| paper | what the paper prints |"
    yield "| ours, same method | the paper's method, corrected where it has errors |"
    yield "| ours, better | the method that we recommend instead |"
    yield "| through protect | what the command answers on the same ranges and errors, in four of the skies |"
    yield "| reference | an independent check |"
    yield "| within | the tolerance that ours keeps to the reference, or else to the paper, or does **not** keep |"
    yield ""
    yield (
        "Figures that differ in one thing only stand side by side, as the numbers that the first cell of their table "
        "names. The columns *ours* measure functions. [Protection](protection.md) shows what `protect` answers in the "
        "papers' scenes."
    )
    yield ""
    yield (
        f"skyproof {version('skyproof')}, {made_on.isoformat()}, seed {settings.seed}, {counts}. `skyproof study NAME` "
        "prints the rows of one figure; `skyproof study --validation docs/validation.md` makes this page."
    )
    paper = ""
    for name, study in studies.items():
        if before is not None:
            before(name)
        if study.paper != paper:
            paper = study.paper
            yield from ("", f"## {_cell(paper)}")
        figure = "" if study.figure == "none" else f"{_cell(study.figure)}.".replace("..", ".")
        about = (figure, study.note, _name_unreached(study))
        yield from ("", f"### `{name}`: {_cell(study.title)}", "", " ".join(text for text in about if text))
        if not study.claims:
            yield from ("", "No single figure to compare; the rows are the result.")
            continue
        checked = check(study, list(study.run(settings)))
        yield from _figures([(claim.claim.what, *claim.cells()) for claim in checked if not claim.claim.across])
        yield from _families(
            [(claim.claim.what, claim.claim.across, claim.cells()) for claim in checked if claim.claim.across]
        )
    yield from ("", "## Functions that no command reaches", "")
    yield "Public functions of the methods that only studies, tests or users' own code call, by module."
    yield ""
    yield from (
        f"- `{module}`: {', '.join(f'`{name}`' for name in names)}" for module, names in list_unreached().items()
    )


def _figures(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Yield the lines of a table, without the columns in which no row holds anything or all rows hold the same."""
    if not rows:
        return
    heads = ("what", *COLUMNS, "within")
    texts = [(*row[:-1], row[-1].replace("within ", "")) for row in rows]
    kept = [column for column in range(len(heads)) if _is_filled(row[column] for row in texts)]
    alike = [column for column in kept[1:] if len(rows) > 2 and len({row[column] for row in texts}) == 1]
    if alike:
        yield from ("", f"In each row: {', '.join(f'*{heads[n]}* {_cell(texts[0][n])}' for n in alike)}.")
    yield ""
    for row in (heads, ["---"] * len(heads), *texts):
        yield _row(*(row[column] for column in kept if column not in alike))


def _is_filled(cells: Iterable[str]) -> bool:
    return any(cell not in (NONE, NOT_REACHED) for cell in cells)


def _families(rows: Sequence[tuple[str, str, tuple[str, ...]]]) -> Iterator[str]:
    """Yield tables of claims that differ in one thing only, which is the column."""
    of_what: dict[str, dict[str, tuple[str, ...]]] = {}
    for parameter, across, cells in rows:
        of_what.setdefault(parameter, {})[across] = cells
    tables: dict[tuple[str, ...], list[str]] = {}
    for parameter, cells_of in of_what.items():
        tables.setdefault(tuple(cells_of), []).append(parameter)
    for columns, names in tables.items():
        every = [cells for parameter in names for cells in of_what[parameter].values()]
        kept = [n for n in range(len(FAMILY)) if _is_filled(cells[n + 1] for cells in every)]
        papers = {cells[0] for cells in every}
        paper = f"paper: {papers.pop()}; " if len(papers) == 1 and NONE not in papers else ""
        head = paper + ", ".join(FAMILY[n] for n in kept)
        yield from ("", _row(head, *columns), _row(*["---"] * (len(columns) + 1)))
        for parameter in names:
            row = of_what[parameter].values()
            yield _row(parameter + _name_tolerance(row), *(_of_family(cells, kept) for cells in row))


def _name_tolerance(row: Iterable[tuple[str, ...]]) -> str:
    """Name the tolerance that all figures of a row share."""
    tolerances = {cells[-1].removeprefix("**not** ") for cells in row}
    tolerance = tolerances.pop()
    return "" if tolerances or tolerance == NONE else f", {tolerance}"


def _of_family(cells: tuple[str, ...], kept: Sequence[int]) -> str:
    """Return those numbers of one cell of a family, in the order of the columns of the usual table."""
    _, *numbers, verdict = cells
    return " ".join(numbers[n] for n in kept) + (f" {verdict}" if verdict.startswith("**") else "")


def _name_unreached(study: Study) -> str:
    """Name the code of a study that no command reaches."""
    names = ", ".join(f"`{name}`" for name in list_methods_called(study.run).not_reached)
    return f"No command reaches {names}." if names else ""


def _row(*cells: str) -> str:
    return f"| {' | '.join(_cell(cell) for cell in cells)} |"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _format_value(value: float | str | None, digits: int) -> str:
    if value is None:
        return NONE
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "not found"
    return f"{value:.{digits}g}"
