"""What `residual` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.entry import Entry
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.records import Finding

__all__ = ["ENTRIES"]

_MOST_NAMED: Final = 8  # satellites in a sentence
_NEEDED: Final = "the test needs five satellites, and one more for each further system"
_REMEDY: Final = "another receiver, or both signals of the satellites that have two"
_MISFIT: Final = "{n_satellites} satellites in {receiver} do not fit one position"


def _describe_skies(finding: Finding) -> str:
    """State how many signals fit which positions, and how far those are apart in place and time."""
    data: Mapping[str, Any] = finding.data
    sizes = " and ".join(f"{size:.0f}" for size in data["sizes"])
    words = f"{sizes} signals in {finding.signals[0].receiver} fit positions up to {data['apart_m']:.0f} m apart"
    if "times_apart_s" not in data:
        return words
    late_s = data["times_apart_s"]
    return f"{words}, and times {late_s * 1e6:.2f} µs ({late_s * SPEED_OF_LIGHT_M_S:.0f} m) apart"


def _describe_orbits(finding: Finding) -> str:
    """State which satellites miss the place of the others, and by how much."""
    data: Mapping[str, Any] = finding.data
    sats = ", ".join(data["far"][:_MOST_NAMED]) + (" and others" if len(data["far"]) > _MOST_NAMED else "")
    count = len({ref.signal.sat for ref in finding.signals})
    return (
        f"{count} satellites in {finding.signals[0].receiver} do not fit one position; {sats} disagree with the others "
        f"by {data['least_m'] / 1e3:.0f} km or more, as with a wrong orbit or clock"
    )


def _describe_second_signals(finding: Finding) -> str:
    """State how many satellites have a second signal."""
    doubled: Any = finding.data["doubled"]
    count = len({ref.signal.sat for ref in finding.signals})
    return (
        f"{count} satellites in {finding.signals[0].receiver} do not fit one position, and {doubled} of them "
        f"{'has' if doubled == 1 else 'have'} more than one signal, so true and false ones may be mixed"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_epochs": Entry("no epoch of {receiver} lies in the window", "measurements over the window"),
    "few_ranges": Entry(
        f"{{ranged}} satellites in {{receiver}} have pseudoranges for half of the window: {_NEEDED}",
        "five or more satellites with pseudoranges",
    ),
    "few_orbits": Entry(
        f"the orbits of {{known}} of {{ranged}} satellites in {{receiver}} are known: {_NEEDED}",
        "orbits of these satellites at this time: a navigation file of the day",
    ),
    "few_above_mask": Entry(
        "too few of {known} satellites in {receiver} stand above the elevation mask of {mask_deg:g} degrees: "
        f"{_NEEDED}",
        "a lower elevation_mask_deg",
    ),
    "no_position": Entry(
        f"the {{known}} satellites in {{receiver}} give no position: {_NEEDED}", "more satellites of one system"
    ),
    "sets_by_chance": Entry(
        lambda f: f"{_describe_skies(f)}, but unrelated signals can do so by chance",
        "more satellites with a second signal",
    ),
    "several_skies": Entry(_describe_skies),
    "fits": Entry("{n_satellites} satellites in {receiver} fit one position"),
    "reflected": Entry(
        "the signals of {n_satellites} satellites in {receiver} are late, as reflections are; the others fit one "
        "position"
    ),
    "orbits_off": Entry(_describe_orbits, _REMEDY),
    "misfit_with_second_signals": Entry(_describe_second_signals, _REMEDY),
    "single_misfit": Entry(
        f"{_MISFIT}; without {{excluded}} they do, so it is faulty, or the others are false", _REMEDY
    ),
    "misfit": Entry(
        f"{_MISFIT}, and no single one explains it: several are faulty, or true and false signals are mixed", _REMEDY
    ),
}
