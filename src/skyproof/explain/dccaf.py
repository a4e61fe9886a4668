"""What `dccaf` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_count(finding: Finding) -> str:
    """State how many satellites have a second signal, and what position those signals fit."""
    data: Mapping[str, Any] = finding.data
    words = (
        f"of {data['satellites']} satellites in {finding.signals[0].receiver}, {data['unlike']} have a second signal "
        "within a chip that no reflection explains: it is earlier than the stronger one, or less than "
        f"{data['reflected_db']:g} dB weaker"
    )
    if data.get("without_position"):
        words += "; no choice of one signal per satellite fits one position"
    if "sky_satellites" in data:
        words += (
            f"; signals of {data['sky_satellites']} fit a second position {data['apart_m']:.0f} m away, with a time "
            f"{data['time_apart_m']:.0f} m off"
        )
    if data["doubles"] and finding.says == "clean":
        words += f"; {data['doubles']} have a second signal of any kind"
    return words


ENTRIES: Final[Mapping[str, Entry]] = {
    "few_grids": Entry(
        "{satellites} satellites in {receiver} have whole correlation grids and a time of week; {needed} at one time "
        "are needed",
        "correlation grids of {needed} or more satellites with their times of week",
    ),
    "few_second_signals": Entry(_describe_count),
    "as_reflections": Entry(_describe_count, "second signals of more satellites, or farther apart"),
    "unlike_reflections": Entry(_describe_count),
}
