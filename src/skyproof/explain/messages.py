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
    return f"{number} in {data['receiver']} are odd by their message or place"


def _describe_odd(finding: Finding) -> str:
    """State how many satellites are odd, which, and how the first of them."""
    data: Mapping[str, Any] = finding.data
    amount = data["amount"]
    how = {
        "issue_repeated": "sends two orbits under one issue of data",
        "other_orbit": f"sends an orbit or clock whose ranges differ by {amount:.0f} m from another one",
        "other_time": f"sends an orbit of {abs(amount):.1f} h {'before' if amount > 0.0 else 'after'}",
        "goes_back": "goes back to an orbit of before",
        "mistimed": "sends another time of week",
        "utc": f"sends a UTC that is {amount:.3g} s off",
        "orbit_of_day": f"sends an orbit {amount:.0f} m of range from one of the last day that is carried on",
        "clock_of_day": f"sends a clock {amount:.0f} m from one of the last day that is carried on",
        "below_horizon": f"stands {amount:.0f} degrees below the horizon",
    }[data["how"]]
    return f"{_count_odd(finding)} ({name_first(data['odd'])}); {data['odd'][0]} {how}"


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_message": Entry(
        "no message of {receiver} is known, and no place by which satellites could be looked for",
        "a log with broadcast messages (UBX-RXM-SFRBX), or five satellites with pseudoranges",
    ),
    "expected": Entry(_count_odd),
    "odd": Entry(_describe_odd, _REMEDY),
    "of_day_expected": Entry(_count_odd),
    "of_day_odd": Entry(_describe_odd, _REMEDY),
}
