"""What `torn` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry, name_first
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _count(finding: Finding, names: str = "") -> str:
    """State how many satellites have codes that no orbit explains, or change places."""
    data: Mapping[str, Any] = finding.data
    if data["by"] == "codes":
        number = f"{len(data['sats'])} of {data['of']} satellites"
        return f"{number} in {data['receiver']} have codes that no orbit explains{names}"
    number = f"{data['exchanged']} of {data['of']} tracked satellites"
    return f"{number} in {data['receiver']} are replaced by others from one epoch to the next{names}"


def _name_torn(finding: Finding) -> str:
    """State how many satellites, and which."""
    sats: Any = finding.data["sats"]
    return _count(finding, f" ({name_first(sats)})")


ENTRIES: Final[Mapping[str, Entry]] = {
    "received_twice": Entry(
        "{receiver} receives a satellite twice, so which codes belong together is not known",
        "one signal of each satellite",
    ),
    "no_good_fix": Entry(
        "no epoch of {receiver} so far has a position with two satellites to spare",
        "six or more satellites with pseudoranges and orbits",
    ),
    "whole": Entry(_count),
    "torn": Entry(_name_torn, "the recording of the samples, or another receiver"),
}
