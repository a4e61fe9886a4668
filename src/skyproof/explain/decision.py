"""What findings of a window show together, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry, join
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe(finding: Finding) -> str:
    data: Mapping[str, Any] = finding.data
    return (
        f"{join([name.replace('_', ' ') for name in data['tests']])} failed in {finding.signals[0].receiver} at the "
        "same time, and no benign cause explains all of it, alone or with another one"
    )


ENTRIES: Final[Mapping[str, Entry]] = {"no_cause_left": Entry(_describe)}
