"""What `sqm` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]

_BESIDE: Final = "a second receiver nearby, or an antenna array"


def _name_correlators(finding: Finding) -> str:
    """Return whose correlators are distorted."""
    sats = ", ".join(sorted(ref.signal.sat for ref in finding.signals))
    return f"the correlators of {sats} in {finding.signals[0].receiver}"


def _count_correlators(finding: Finding) -> str:
    """Return whose correlators are distorted, and how many of all."""
    return f"{_name_correlators(finding)}, {len(finding.signals)} of {finding.data['of']} signals,"


def _describe_some(finding: Finding) -> str:
    """State whose correlators are distorted, by a reflection or a second signal."""
    return f"{_name_correlators(finding)} are distorted, by a reflection or a second signal"


def _describe_many(finding: Finding) -> str:
    """State whose correlators are distorted at once, by reflections all around or by second signals."""
    return f"{_count_correlators(finding)} are distorted at once, by reflections all around or by second signals"


def _describe_earlier(finding: Finding) -> str:
    """State whose correlators hold a second signal that comes before the tracked one, as no reflection does."""
    return (
        f"{_count_correlators(finding)} hold a second signal of the same satellite that is earlier than the tracked "
        "one, as no reflection is"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_pair": Entry(
        "{receiver} has no pair of correlators symmetric about the prompt",
        "correlators at the prompt and symmetric on both sides of it",
    ),
    "few_looks": Entry(
        "the window holds {looks} outputs of the correlators of {receiver}; {needed_looks} are needed",
        "two seconds of signal or more",
    ),
    "several_of_a_satellite": Entry(
        "{examined} of {satellites} satellites in {receiver} have only one signal for long enough; several signals of "
        "a satellite distort each other, and {needed} satellites are needed",
        "at least {needed} satellites with one signal each",
    ),
    "few_signals": Entry(
        "{examined} signals of {receiver} were tracked without a break for {needed_looks} outputs; {needed} signals "
        "are needed",
        "at least {needed} satellites tracked without a break for 2 s",
    ),
    "undistorted": Entry(
        "noise and multipath of {multipath_sigma_m:g} m explain the correlators of {n_signals} signals of {receiver}"
    ),
    "some_distorted": Entry(_describe_some, _BESIDE, beside=True),
    "many_distorted": Entry(_describe_many, _BESIDE),
    "earlier_signals": Entry(_describe_earlier),
}
