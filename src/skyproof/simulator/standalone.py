"""Write a scenario as a file that stands alone: defaults filled in, and the files that it names beside it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import tomli_w

from skyproof.errors import InputError, ScenarioError
from skyproof.formats.bounds import NAVIGATION_BYTES, TRACK_BYTES
from skyproof.formats.byte_io import unpack_text
from skyproof.simulator.scenario import Scenario, parse_scenario

__all__ = ["NAVIGATION", "Standalone", "collect_standalone", "override", "resolve"]

NAVIGATION: Final = "broadcast.rnx"
_OF_WHAT_STANDS_STILL: Final = ("heading_deg", "pitch_deg", "roll_deg")


@dataclass(frozen=True, eq=False)
class Standalone:
    """A scenario's table with names of files in its own folder, and what these files hold."""

    table: dict[str, Any]
    files: Mapping[str, bytes]

    def lines(self, *comments: str) -> Iterator[str]:
        """Write TOML that `read_scenario` reads back."""
        yield from (f"# {comment}" for comment in comments)
        yield from tomli_w.dumps(self.table).rstrip("\n").split("\n")


def resolve(scenario: Scenario) -> dict[str, Any]:
    """Build the table that makes this scenario, with every default written out.

    Absent values (None) have no key.
    """
    table: dict[str, Any] = scenario.model_dump(mode="json", exclude_none=True)
    for site in _iterate_tables(table):
        if "path" in site and "lat_deg" in site:  # a site that moves: its attitude follows from the motion
            for name in _OF_WHAT_STANDS_STILL:
                site.pop(name, None)
    return table


def override(scenario: Scenario, *, seed: int | None = None, duration_s: float | None = None) -> Scenario:
    """Change the seed or duration. Raises ScenarioError if that makes no sense."""
    changes = {key: value for key, value in (("seed", seed), ("duration_s", duration_s)) if value is not None}
    return parse_scenario(resolve(scenario) | changes, source=scenario.name) if changes else scenario


def collect_standalone(scenario: Scenario) -> Standalone:
    """Collect the navigation file and recorded ways that a scenario names, to be laid beside it.

    A scenario without a navigation file stays so: the nominal constellation is the same to the last bit.

    Raises
    ------
    ScenarioError : a file that is named cannot be read.
    """
    table, files = resolve(scenario), dict[str, bytes]()
    if scenario.navigation is not None:
        files[NAVIGATION] = _read(scenario.navigation, "navigation", NAVIGATION_BYTES)
        table["navigation"] = NAVIGATION
    ways: dict[str, str] = {}  # name by path
    for site in _iterate_tables(table):
        if site.get("kind") == "file" and "path" in site:
            path = Path(site["path"])
            name = ways.setdefault(str(path), f"track-{len(ways) + 1}{path.suffix.lower()}")
            files[name] = _read(path, "path", TRACK_BYTES)
            site["path"] = name
    return Standalone(table, files)


def _iterate_tables(value: Any) -> Iterator[dict[str, Any]]:
    """Iterate over every table within."""
    if isinstance(value, dict):
        yield value
    for member in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _iterate_tables(member)


def _read(path: Path, key: str, most: int) -> bytes:
    try:
        return unpack_text(path, most, "it", "give a file that can")
    except InputError as error:
        raise ScenarioError(f"{key}: {error}") from error
