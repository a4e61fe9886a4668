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
        f"codes of two bands diverge more than any ionosphere explains: {parted}; "
        f"{data['first']} is {abs(data['late_m']):.0f} m {side} against {data['second']}"
    )


def _describe_step(finding: Finding) -> str:
    """State which bands part together, when and by how much."""
    data: Mapping[str, Any] = finding.data
    return (
        f"{data['first']} of {data['satellites']} satellites in {finding.signals[0].receiver} diverges from "
        f"{data['second']} by the same {abs(data['statistic']):.1f} m on each, since {clock(finding.dated_gpst, 1)}; "
        "an oscillator drives both bands, so it cannot be the cause"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "one_band": Entry(
        "fewer than {needed} satellites of {receiver} have codes of two bands", "a receiver of two bands or more"
    ),
    "together": Entry("the codes of {tested} pairs of bands in {receiver} differ no more than the ionosphere explains"),
    "go_on_together": Entry("the difference between bands of {satellites} satellites in {receiver} stays constant"),
    "part_together": Entry(_describe_step, "another receiver, to tell a fault from a false signal"),
    "parted": Entry(_describe_parted, "another receiver, to tell a fault from a false signal"),
}
