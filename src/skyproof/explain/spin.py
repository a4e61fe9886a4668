"""What `spin` finds, in words: of directions, those of the arrays."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain import array_common, ins_array
from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_bent(finding: Finding) -> str:
    """Name the signals whose phases fit no single direction, and when."""
    data: Mapping[str, Any] = finding.data
    receiver = finding.signals[0].receiver
    words = "its phases fit no single direction"
    if "bent" in data:
        words = f"the phases of {data['bent']} of {data['of']} signals in {receiver} each fit no single direction"
    elif "ago_s" in data:
        ago = f"{data['ago_s']:.0f} s before" if data["ago_s"] else "just before"
        words = f"{ago}, the phases of several signals in {receiver} each fitted no single direction"
    return f"{words}, because of slips, strong reflections, or two signals within a chip"


ENTRIES: Final[Mapping[str, Entry]] = {
    **array_common.ENTRIES,
    **ins_array.ENTRIES,
    "no_arm": Entry("the window has no receiver on an arm", "observations of the receiver on the arm"),
    "few_signals": Entry(
        "{signals} signals of {receiver} have an unbroken phase, and two are needed",
        "carrier phases of two or more signals through the window",
    ),
    "few_epochs": Entry(
        "{epochs} epochs of {receiver} are too few to follow the arm's turn", "carrier phases about ten times a second"
    ),
    "phases_bent": Entry(
        _describe_bent,
        "a place without strong reflections, or a longer recording in which the two signals separate",
    ),
    "not_from_satellites": Entry(
        "{off} of {n_signals} signals do not come to {receiver} from where their satellites stand: strong reflections, "
        "two signals within a chip, or an arm that is not as stated",
        "a check of the arm in the platform file, or a longer recording in which the two signals separate",
    ),
}
