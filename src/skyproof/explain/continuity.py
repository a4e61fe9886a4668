"""What `continuity` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.detectors.base import NEEDS
from skyproof.explain.entry import Entry, join
from skyproof.explain.units import clock, metres, seconds
from skyproof.records import Cause, Finding, Need

__all__ = ["ENTRIES"]

_LONGER: Final = "more satellites with pseudoranges over a longer time"
_TOO_FEW: Final = "{receiver} has {epochs} epochs with {satellites} satellites or more"


def _describe_step(finding: Finding) -> str:
    """Describe what breaks, when, by how much, and what that may be."""
    data: Mapping[str, Any] = finding.data
    found = {
        "position": f"the position jumps by {metres(data['position_m'])}",
        "clock": f"the signals' time goes {'back' if data['clock_s'] > 0.0 else 'ahead'} by "
        f"{seconds(abs(data['clock_s']))}",
        "velocity": f"the velocity jumps by {data['speed_m_s']:.1f} m/s",
        "rate": f"the clock's frequency jumps by {1e6 * data['rate']:+.2f} ppm",
    }
    words = [found[kind] for kind in data["kinds"]]
    words += ["all carriers break at once"] if data["broke"] else []
    after = f" after {data['outage_s']:.1f} s without measurements" if data["outage_s"] > 0.0 else ""
    may_be = ["the recording is not continuous", "other signals took over"]
    if Cause.REFLECTIONS in finding.may_also_be:
        may_be.append(
            f"reflections are larger than the stated {data['multipath_sigma_m']:g} m, one sigma (multipath_sigma_m)"
        )
    receiver = finding.signals[0].receiver
    return f"{receiver}: at {clock(finding.dated_gpst, 1)}{after} {join(words)}: {', or '.join(may_be)}"


def _describe_gap(finding: Finding) -> str:
    """State where samples are missing."""
    data: Mapping[str, Any] = finding.data
    ahead = seconds(data["missing_s"])
    return (
        f"{finding.signals[0].receiver}: at {data['at'][11:]} the signals' time jumps {ahead} ahead and all carriers "
        "break at once, so samples are missing there, or the time is false"
    )


def _describe_motion(finding: Finding) -> str:
    """State how far the carriers move a receiver that is stated to stand."""
    data: Mapping[str, Any] = finding.data
    return (
        f"the carriers of {data['satellites']} satellites in {finding.signals[0].receiver} move its position by "
        f"{metres(data['moved_m'])} within {data['time_s']:.1f} s, although it is stated to stand still"
    )


def _describe_drag(finding: Finding) -> str:
    """State how far codes move a receiver without its carriers."""
    data: Mapping[str, Any] = finding.data
    return (
        f"the codes of {data['satellites']} satellites in {finding.signals[0].receiver} move its position by "
        f"{metres(data['moved_m'])} within {data['time_s']:.0f} s, but their carriers do not"
    )


ENTRIES: Final[Mapping[str, Entry]] = {
    "no_set": Entry("no position fits the signals of {receiver}, so there is nothing to follow", NEEDS[Need.SETS]),
    "few_satellites": Entry(
        "{receiver} has pseudoranges of {most} satellites at most at one epoch, and {needed} are needed",
        "pseudoranges of {needed} or more satellites at the same epochs",
    ),
    "few_epochs": Entry(f"{_TOO_FEW}, and {{needed}} are needed", f"{{satellites}} or {_LONGER}"),
    "few_epochs_since_step": Entry(
        f"{_TOO_FEW} since the last step, and {{needed}} are needed", f"{{satellites}} or {_LONGER}"
    ),
    "no_frequency": Entry(
        "the carrier frequencies of {without} of {ranged} signals of {receiver} are not known",
        "the frequency numbers of GLONASS, in the header of the file or a navigation file",
    ),
    "ranges_alone": Entry(
        "{without} of {tuned} signals of {receiver} have pseudoranges alone, and without carrier phases or Dopplers "
        "nothing predicts them",
        "carrier phases or Dopplers beside the pseudoranges",
    ),
    "one_side": Entry(
        "fewer than {needed} satellites in {receiver} are received both before and after any moment of the window",
        f"{{needed}} or {_LONGER}",
    ),
    "goes_on": Entry("position, velocity, clock and time of {receiver} are continuous"),
    "time_ahead": Entry(_describe_gap, "a recording without gaps", beside=True),
    "step": Entry(
        _describe_step,
        "the recording as the receiver made it, uncut; or one run for each of the two parts",
    ),
    "stands": Entry("the carriers show that {receiver} stands still"),
    "moves": Entry(
        lambda f: f"{_describe_motion(f)}; either the signals are false or it does move",
        "a second receiver; or, if it does move, a platform file that does not state that it stands",
        beside=True,
    ),
    "moves_by_some": Entry(
        lambda f: (
            f"{_describe_motion(f)}; the evidence rests on two of them: something that moves nearby may "
            "reflect them, or they are false"
        ),
        "a second receiver",
    ),
    "one_motion": Entry("codes and carriers in {receiver} show the same motion"),
    "dragged": Entry(_describe_drag, "a second receiver", beside=True),
    "dragged_by_some": Entry(
        lambda f: f"{_describe_drag(f)}; the evidence rests on two of them or on one moment, so it may be chance",
        "a second receiver",
    ),
}
