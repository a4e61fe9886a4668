"""What `ins_array` finds, in words."""

from collections.abc import Mapping
from typing import Any, Final

from skyproof.explain.array_common import FEW_ANTENNAS
from skyproof.explain.entry import Entry, Words, join
from skyproof.records import Finding

__all__ = ["ENTRIES"]


def _name_antennas(alone: str, together: str) -> Entry:
    """Return the entry of a fault of one antenna or of several. alone, together : what is wrong, of one and of more."""

    def describe(finding: Finding) -> str:
        names: Any = finding.data["antennas"]
        receiver = finding.signals[0].receiver
        if len(names) == 1:
            return f"antenna {names[0]} of {receiver} {alone}, and is left out"
        return f"antennas {join(names)} of {receiver} {together}, and are left out"

    describe.__doc__ = f"Say that an antenna {alone}, and is left out."
    return Entry(describe, beside=True)


def _describe_attitude(finding: Finding) -> str:
    """State how far the attitude that was given is from the one that the signals show."""
    data: Mapping[str, Any] = finding.data
    how = f"is {data['off_deg']:.0f} degrees from" if "off_deg" in data else "disagrees with"
    return (
        f"the stated attitude {how} the one that the signals of {finding.signals[0].receiver} show, and is not "
        "used; check [attitude] or [imu], antennas_m and their order"
    )


def _count_true(finding: Finding) -> str:
    """State how many signals come from their satellites, and how many do not."""
    data: Mapping[str, Any] = finding.data
    words = (
        f"{data['from_satellites']} of {data['of']} signals come to {finding.signals[0].receiver} from where their "
        "satellites stand"
    )
    return words + (f"; {data['as_reflections']} look like reflections" if data["as_reflections"] else "")


def _describe_elsewhere(how: str) -> Words:
    """Return words that name the satellites whose signals come from elsewhere. how : what of their delays is so."""

    def describe(finding: Finding) -> str:
        data: Mapping[str, Any] = finding.data
        over = f"over {data['over_s']:.0f} s " if "over_s" in data else ""
        where = f"{finding.signals[0].receiver} from elsewhere than their satellites"
        return f"{over}signals of {join(data['sats'])} come to {where}, {how}"

    return describe


def _describe_unlike(finding: Finding) -> str:
    """State how many signals do not come from their satellites, and that nothing shows why."""
    data: Mapping[str, Any] = finding.data
    which = f"{'the other ' if data['beside'] else ''}{len(finding.signals)}"
    return (
        f"{data['off']} of {which} signals do not come to {finding.signals[0].receiver} from where their satellites "
        "stand, and too few others confirm the stated attitude, line biases and antennas"
    )


_LATE: Final = Entry(_describe_elsewhere("late as reflections are"))
_NOT_LATE: Final = Entry(
    _describe_elsewhere("and are not late as reflections are"), "a place without reflectors within some metres"
)

ENTRIES: Final[Mapping[str, Entry]] = {
    "few_antennas": FEW_ANTENNAS,
    "no_place": Entry(
        "the place of {receiver} is not known, as it is not surveyed and no position fits its signals",
        "a surveyed position, or pseudoranges of at least 5 satellites with their orbits",
    ),
    "no_signal": Entry(
        "no signal of {receiver} is on all antennas while its orbit and the attitude are known",
        "orbits and attitude over the time of the phases",
    ),
    "antennas_silent": _name_antennas("gives no phases", "give no phases"),
    "antennas_deaf": _name_antennas(
        "receives none of the signals that the others do", "receive none of the signals that the others do"
    ),
    "antennas_noisy": _name_antennas("is noisy", "are noisy"),
    "antennas_jumping": _name_antennas("has a phase that jumps", "have phases that jump"),
    "attitude_unused": Entry(_describe_attitude, beside=True),
    "lines_unused": Entry(
        "line_bias_cyc of {receiver} disagrees with its signals and is not used; calibrate it again", beside=True
    ),
    "all_from_satellites": Entry("{n_signals} signals come to {receiver} from where their satellites stand"),
    "from_satellites": Entry(_count_true),
    "from_elsewhere": Entry("a signal of {sat} does not come to {receiver} from its satellite"),
    "from_one_direction": Entry("signals of {n_satellites} satellites come to {receiver} from one direction"),
    "from_elsewhere_over_time": Entry(
        "over {over_s:.0f} s a signal of {sat} does not come to {receiver} from its satellite"
    ),
    "from_one_direction_over_time": Entry(
        "over {over_s:.0f} s signals of {n_satellites} satellites come to {receiver} from one direction"
    ),
    "repeated": Entry(
        "signals of {n_satellites} satellites come to {receiver} from one direction, where none of them stands, later "
        "and weaker than true ones: a repeater, a reflector, or false signals",
        "more antennas, or antennas farther apart",
    ),
    "reflected": _LATE,
    "reflected_over_time": _LATE,
    "not_late": _NOT_LATE,
    "not_late_over_time": _NOT_LATE,
    "not_as_stated": Entry(
        _describe_unlike, "a check of attitude, antennas_m and line_bias_cyc of {receiver} in the platform file"
    ),
}
