"""What the places of receivers that stand show, in words."""

from collections.abc import Callable, Mapping
from typing import Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _say(why: str) -> Callable[[Finding], str]:
    """Return a function that says how far off a place is, and why that may be."""

    def words(finding: Finding) -> str:
        place = "was surveyed" if finding.data["surveyed"] else "stood at first, although it is stated not to move"
        receiver, off_m = finding.signals[0].receiver, finding.data["statistic"]
        slip = finding.wrong_statements[0].sentence if finding.wrong_statements else ""
        return f"the signals put {receiver} {off_m:.1f} m from where it {place}{why.format(slip=slip)}"

    return words


def _remedy(finding: Finding) -> str:
    if finding.data["surveyed"]:
        return "a check of the surveyed position (WGS-84, height above the ellipsoid)"
    return "a second receiver"


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_place": Entry("the place of {receiver} is not known yet, or no position is found", "a longer recording"),
    "there": Entry("the signals put {receiver} where it stands, to within {statistic:.1f} m"),
    "elsewhere": Entry(_say("; before that they put it there"), beside=True),
    "slip": Entry(_say(": {slip}, or they are false"), "a check of the surveyed position"),
    "never_there": Entry(_say(": they are false, or the stated place or stated errors are wrong"), _remedy),
    "as_before": Entry(_say("; they put it near there before, so the stated place may be wrong"), _remedy),
    "others_misfit": Entry(_say("; other satellites do not fit that, so errors may be larger than stated"), _remedy),
    "by_some": Entry(_say("; the evidence rests on two satellites, so it may be chance, or reflections"), _remedy),
}
