"""What `bands` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry, name_first
from skyproof.explain.units import clock
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_parted(finding: Finding) -> str:
    """State which codes part, and the worst by how much."""
    data: Mapping[str, Any] = finding.data
    side = "late" if data["late_m"] > 0.0 else "early"
    parted = f"{name_first(data['parted'])} in {finding.signals[0].receiver}"
    return (
        f"codes of two bands part beyond any ionosphere: {parted}; "
        f"{data['first']} is {abs(data['late_m']):.0f} m {side} against {data['second']}"
    )


def _describe_step(finding: Finding) -> str:
    """State which bands part together, when and by how much."""
    data: Mapping[str, Any] = finding.data
    return (
        f"{data['first']} of {data['satellites']} satellites in {finding.signals[0].receiver} parts from "
        f"{data['second']} by {abs(data['statistic']):.1f} m in all of them alike, since "
        f"{clock(finding.dated_gpst, 1)}: no oscillator does so, for it drives both bands"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "one_band": Entry(
        "fewer than {needed} satellites of {receiver} have codes of two bands", "a receiver of two bands or more"
    ),
    "together": Entry("the codes of {tested} pairs of bands in {receiver} differ as the ionosphere makes them"),
    "go_on_together": Entry("bands of {satellites} satellites in {receiver} stay apart as they were"),
    "part_together": Entry(_describe_step, "another receiver, to tell a fault from a false signal"),
    "parted": Entry(_describe_parted, "another receiver, to tell a fault from a false signal"),
}
