"""What `code_motion` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.explain.units import clock
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _name_tested(finding: Finding) -> str:
    """Name what was tested: position or clock, the receiver, and the signals if not all."""
    data: Mapping[str, Any] = finding.data
    alone = f"{', '.join(data['alone'])} " if data["alone"] else ""
    return f"the {data['what']} of {finding.signals[0].receiver} from {alone}codes"


def _describe_jump(finding: Finding) -> str:
    """Describe what jumps, when and by how much."""
    data: Mapping[str, Any] = finding.data
    by = f"{data['moved_m']:.0f} m" if data["what"] == "position" else f"{1e6 * data['clock_s']:.3g} µs"
    return f"{_name_tested(finding)} jumps by {by} at {clock(finding.dated_gpst, 1)}"


ENTRIES: Final[Mapping[str, Entry]] = {
    "received_twice": Entry(
        "{receiver} receives a satellite twice, so which codes belong together is not known",
        "one signal of each satellite",
    ),
    "few_fixes": Entry(
        "fewer than {needed} epochs of {receiver} have a position with a satellite to spare",
        "five or more satellites with pseudoranges and orbits at {needed} epochs or more",
    ),
    "goes_on": Entry(lambda f: f"{_name_tested(f)} is continuous"),
    "jumps": Entry(_describe_jump),
    "jumps_by_two": Entry(
        lambda f: f"{_describe_jump(f)}, which one or two faulty satellites may explain",
        "more satellites, carrier phases or Dopplers",
    ),
    "jumps_by_all": Entry(
        lambda f: f"{_describe_jump(f)}, more than any platform can move, also without any two of the satellites",
        "a second receiver",
    ),
}
