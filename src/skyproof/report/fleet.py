"""The page over all items of a fleet: how many came out how, and one line for each item with a link to its report."""

from collections import Counter
from collections.abc import Sequence
from typing import Final, Protocol
from urllib.parse import quote

from skyproof.report.template import load_environment
from skyproof.verdict import write_word

__all__ = ["FleetLine", "write_fleet_html"]

ORDER: Final = ("spoofed", "suspect", "no_attack_seen", "authentic", "failed", "not run")
"""What needs a look first comes first."""


class FleetLine(Protocol):
    """What the page shows of an item."""

    @property
    def name(self) -> str: ...
    @property
    def inputs(self) -> str: ...
    @property
    def state(self) -> str: ...
    @property
    def error(self) -> str | None: ...
    @property
    def verdict(self) -> str | None: ...
    @property
    def summary(self) -> str | None: ...
    @property
    def since_gpst(self) -> str | None: ...
    @property
    def since_sigma_s(self) -> float | None: ...
    @property
    def signals(self) -> int: ...
    @property
    def share_spoofed(self) -> float | None: ...
    @property
    def share_unknown(self) -> float | None: ...
    @property
    def position_kind(self) -> str | None: ...
    @property
    def position_lat_deg(self) -> float | None: ...
    @property
    def position_lon_deg(self) -> float | None: ...
    @property
    def position_height_m(self) -> float | None: ...


def write_fleet_html(rows: Sequence[FleetLine]) -> str:
    """Write the whole page without any clock, so that the same rows give the same bytes."""
    counts = Counter(_how(row) for row in rows)
    groups = [(how, [row for row in rows if _how(row) == how]) for how in ORDER if counts[how]]
    page = load_environment().get_template("fleet.html.j2")
    return page.render(
        total=len(rows), groups=groups, shown=write_word, link=lambda name: f"items/{quote(name)}/report.html"
    )


def _how(row: FleetLine) -> str:
    return row.verdict or row.state
