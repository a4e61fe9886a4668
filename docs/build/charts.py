"""Tables of a page as curves: the numbers stand in the page once, and the picture cannot say others."""

import re
from collections.abc import Iterator

from skyproof.report.chart import Axes, draw_chart_svg

__all__ = ["UNBUILT", "chart_of", "charts_in"]

UNBUILT = "*`make docs` draws this table here.*"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
CHART = re.compile(r"((?:^\|.*\n)+)\n<!-- chart: (.*?) -->", re.MULTILINE)
"""A table, and the mark right after it: its title, what is along and what is up, and `log` if that goes by powers."""


def charts_in(page: str) -> Iterator[tuple[str, str]]:
    """What a page's marks ask for, and the table before each."""
    for found in CHART.finditer(page):
        yield found[2], found[1]


def chart_of(what: str, table: str) -> str:
    """The chart, an SVG: a line a row, named by its first cell, over the numbers of the table's head.

    The first number of a cell counts; where a cell has none the line goes on to the next.
    """
    title, x_label, y_label, *more = (word.strip() for word in what.split("|"))
    head, _, *lines = (_cells(line) for line in table.strip().splitlines())
    at = {k: float(found[0]) for k, cell in enumerate(head) if k and (found := NUMBER.search(cell))}
    rows = [
        {"of": cells[0], "x": x, "y": float(found[0])}
        for cells in lines
        for k, x in at.items()
        if (found := NUMBER.search(cells[k]))
    ]
    axes = Axes(title=title, x="x", y="y", x_label=x_label, y_label=y_label, by=("of",), y_log="log" in more)
    return str(draw_chart_svg(rows, [axes]))


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]
