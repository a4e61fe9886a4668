"""What `levels` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _describe_odd(finding: Finding) -> str:
    """State which test failed, and how."""
    data: Mapping[str, Any] = finding.data
    receiver = finding.signals[0].receiver
    match data["test"]:
        case "rise":
            number = f"{data['satellites']} satellites in {receiver}"
            return f"{_name_unit(data['unit'])} of {number} became stronger together, by {data['change_db']:.0f} dB"
        case "entered":
            return (
                f"more power comes in and {_name_unit(data['unit'])} of {data['satellites']} satellites in {receiver} "
                f"became stronger with it within seconds, by {data['change_db']:.0f} dB"
            )
        case "pattern":
            return (
                f"the differences between the satellites' levels of {_name_unit(data['unit'])} in {receiver} shrink "
                f"by {-data['slope']:.0%}"
            )
        case "strong":
            return (
                f"{data['strong']} signals in {receiver} are stronger than any satellite's, up to "
                f"{data['strongest_dbhz']:.0f} dB-Hz: they are false, unless a high-gain antenna receives them"
            )
        case _:
            by = f" by {data['rise_db']:.0f} dB" if "rise_db" in data else ""
            return f"the power in the front end of {receiver} rises{by} ({data['chain']}), but C/N0 does not fall"


def _describe_fall(finding: Finding) -> str:
    """State by how much C/N0 falls, and on which carriers."""
    falls = ", ".join(f"{rise.fall_db:.0f} dB on {rise.carrier}" for rise in finding.interference or ())
    return f"C/N0 of all satellites in {finding.signals[0].receiver} falls: {falls}"


def _name_unit(unit: tuple[str, ...]) -> str:
    """Name a carrier, or a kind of signal, as people read it."""
    return f"the signals on {unit[0]}" if len(unit) == 1 else f"the signals {' '.join(unit)}"


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_levels": Entry("{receiver} states no C/N0", "C/N0 in the receiver's file (S1C and so on in RINEX)"),
    "nothing_before": Entry("there are no earlier levels of {receiver} to compare with", "a longer recording"),
    "few_satellites": Entry(
        "fewer than {needed} satellites of one system continue in {receiver}", "{needed} or more satellites of a system"
    ),
    "steady": Entry("the levels in {receiver} are steady"),
    "interfered": Entry(_describe_fall),
    "odd": Entry(_describe_odd, "a second receiver whose levels are steady"),
}
