"""What `vector_sqm` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_misfit(finding: Finding) -> str:
    """State that channels do not fit one position, since when, and which of them would explain it."""
    data: Mapping[str, Any] = finding.data
    when = f", seen at {data['seen_s']:.1f} s of the recording" if "seen_s" in data else ""
    when += f", from {data['began_s']:.1f} s on" if "began_s" in data else ""
    return (
        f"{data['channels']} channels of {finding.signals[0].receiver} do not fit one position and clock{when}; "
        f"{_name_suspects(data)} (smallest singular value of two satellites' directions {data['separability']:.2g})"
    )


def _name_suspects(data: Mapping[str, Any]) -> str:
    """State which signals alone would explain a misfit."""
    number, size, names = data["sets"], data["set_size"], data["suspects"]
    if not number:
        return "too many of them to tell which are false"
    if not size:
        return "the misfit is too small to tell which signals cause it"
    named = [" and ".join(names[k : k + size]) for k in range(0, len(names), size)]
    if number == 1:
        return f"{named[0]} alone would explain it"
    more = " or others" if number > len(named) else ""
    return f"any of {number} would explain it alone: {', '.join(named)}{more}"


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_pair": Entry(
        "{receiver} has no early and late correlators within a chip that are symmetric about the prompt",
        "correlators at -0.5, 0 and +0.5 chip",
    ),
    "no_position": Entry(
        "fewer than four satellites of {receiver} above the elevation mask have ranges and orbits, so there is no "
        "position to compare channels with",
        "pseudoranges and orbits of four or more satellites",
    ),
    "few_satellites": Entry(
        "{channels} satellites in {receiver} were tracked together through the window",
        "{needed} or more satellites tracked together through the window",
    ),
    "weak_geometry": Entry(
        "the directions of the {channels} signals in {receiver} give no position", "satellites in other directions"
    ),
    "few_looks": Entry(
        "the {channels} channels of {receiver} have {looks} common outputs", "{needed_looks} common outputs or more"
    ),
    "fits": Entry("{n_signals} channels of {receiver} agree with one position and clock"),
    "does_not_fit": Entry(
        _describe_misfit,
        "another receiver or several antennas, to tell a false signal from a reflection or a fault",
    ),
}
