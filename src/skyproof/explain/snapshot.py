"""What changes within a recording too short to follow signals, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]

_HOW: Final = {"begins": "begins about", "ends": "ends about", "turns": "comes from elsewhere after about"}


def _describe_changes(finding: Finding) -> str:
    """State which satellites' signals change, how and when."""
    data: Mapping[str, Any] = finding.data
    changes = zip(data["changed"], data["kinds"], data["after_s"], strict=True)
    words = ", ".join(f"{signal} {_HOW[kind]} {after_s:.3g} s" for signal, kind, after_s in changes)
    changed = len({signal.split()[0] for signal in data["changed"]})
    of = len({ref.signal.sat for ref in finding.signals})
    return (
        f"{changed} of {of} satellites' signals change within {finding.signals[0].receiver}'s recording, as when an "
        f"attack begins: {words}"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "unchanged": Entry("the signals of {receiver} do not change during the snapshot", "nothing"),
    "changes": Entry(_describe_changes, "a later recording, or one of ten seconds or more"),
}
