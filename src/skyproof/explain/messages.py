"""What `messages` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry, name_first
from skyproof.records import Finding

__all__ = ["ENTRIES"]


_REMEDY: Final = "the orbits of the day (--nav), or another receiver"


def _count_odd(finding: Finding) -> str:
    """State how many satellites are odd."""
    data: Mapping[str, Any] = finding.data
    number = f"{len(data['odd'])} of {data['satellites']} satellites"
    return f"{number} in {data['receiver']} have a suspicious message or position in the sky"


def _describe_odd(finding: Finding) -> str:
    """State how many satellites are odd, which, and how the first of them."""
    data: Mapping[str, Any] = finding.data
    amount = data["amount"]
    how = {
        "issue_repeated": "sends two orbits under one issue of data",
        "other_orbit": f"sends an orbit or clock whose ranges differ by {amount:.0f} m from another data set",
        "other_time": f"sends an orbit that is {abs(amount):.1f} h {'too old' if amount > 0.0 else 'too new'}",
        "goes_back": "returns to an earlier orbit",
        "mistimed": "sends a wrong time of week",
        "utc": f"sends a UTC that is {amount:.3g} s off",
        "orbit_of_day": f"sends an orbit whose ranges differ by {amount:.0f} m from the last day's orbit, extrapolated",
        "clock_of_day": f"sends a clock that differs by {amount:.0f} m from the last day's clock, extrapolated",
        "below_horizon": f"stands {amount:.0f} degrees below the horizon",
    }[data["how"]]
    return f"{_count_odd(finding)} ({name_first(data['odd'])}); {data['odd'][0]} {how}"


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_message": Entry(
        "{receiver} gives no broadcast message, and no position from which satellites could be predicted",
        "a log with broadcast messages (UBX-RXM-SFRBX), or five satellites with pseudoranges",
    ),
    "expected": Entry(_count_odd),
    "odd": Entry(_describe_odd, _REMEDY),
    "of_day_expected": Entry(_count_odd),
    "of_day_odd": Entry(_describe_odd, _REMEDY),
}
