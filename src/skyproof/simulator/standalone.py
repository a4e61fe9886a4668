"""A scenario as a file that stands alone: every default filled in, and the files that it names laid beside it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import tomli_w

from skyproof.errors import InputError, ScenarioError
from skyproof.formats.bounds import NAVIGATION_BYTES, TRACK_BYTES
from skyproof.formats.byte_io import unpack_text
from skyproof.simulator.scenario import Scenario, parse_scenario

__all__ = ["NAVIGATION", "Standalone", "overridden", "resolved", "standalone"]

NAVIGATION: Final = "broadcast.rnx"
_OF_WHAT_STANDS_STILL: Final = ("heading_deg", "pitch_deg", "roll_deg")


@dataclass(frozen=True, eq=False)
class Standalone:
    """A scenario's table with names of files in its own folder, and what these files hold."""

    table: dict[str, Any]
    files: Mapping[str, bytes]

    def lines(self, *comments: str) -> Iterator[str]:
        """As TOML that `read_scenario` reads back."""
        yield from (f"# {comment}" for comment in comments)
        yield from tomli_w.dumps(self.table).rstrip("\n").split("\n")


def resolved(scenario: Scenario) -> dict[str, Any]:
    """The table that makes this scenario, with every default written out; what is absent (None) has no key."""
    table: dict[str, Any] = scenario.model_dump(mode="json", exclude_none=True)
    for one in _tables(table):
        if "path" in one and "lat_deg" in one:  # a site that moves: its attitude follows from the motion
            for name in _OF_WHAT_STANDS_STILL:
                one.pop(name, None)
    return table


def overridden(scenario: Scenario, *, seed: int | None = None, duration_s: float | None = None) -> Scenario:
    """The same with another seed or duration. Raises ScenarioError if that makes no sense."""
    changes = {key: value for key, value in (("seed", seed), ("duration_s", duration_s)) if value is not None}
    return parse_scenario(resolved(scenario) | changes, source=scenario.name) if changes else scenario


def standalone(scenario: Scenario) -> Standalone:
    """The scenario with the navigation file and recorded ways that it names, to be laid beside it.

    A scenario without a navigation file stays so: the nominal constellation is made anew to the last bit.

    Raises
    ------
    ScenarioError : a file that is named cannot be read.
    """
    table, files = resolved(scenario), dict[str, bytes]()
    if scenario.navigation is not None:
        files[NAVIGATION] = _read(scenario.navigation, "navigation", NAVIGATION_BYTES)
        table["navigation"] = NAVIGATION
    ways: dict[str, str] = {}  # name by path
    for one in _tables(table):
        if one.get("kind") == "file" and "path" in one:
            path = Path(one["path"])
            name = ways.setdefault(str(path), f"track-{len(ways) + 1}{path.suffix.lower()}")
            files[name] = _read(path, "path", TRACK_BYTES)
            one["path"] = name
    return Standalone(table, files)


def _tables(value: Any) -> Iterator[dict[str, Any]]:
    """Every table within."""
    if isinstance(value, dict):
        yield value
    for one in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _tables(one)


def _read(path: Path, key: str, most: int) -> bytes:
    try:
        return unpack_text(path, most, "it", "give a file that can")
    except InputError as error:
        raise ScenarioError(f"{key}: {error}") from error
