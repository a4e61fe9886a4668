"""What `common_change` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry

__all__ = ["ENTRIES"]


ENTRIES: Final[Mapping[str, Entry]] = {
    "few_satellites": Entry(
        "fewer than two epochs of {receiver} have {needed} satellites with pseudoranges",
        "{needed} or more satellites with pseudoranges",
    ),
    "first_window": Entry(
        "this is the first window of {receiver}, with which later ones are compared", "half a minute of signal or more"
    ),
    "nothing_shared": Entry(
        "fewer than {needed} satellites in {receiver} have code and carrier both now and in earlier windows",
        "{needed} or more satellites with code and carrier over half a minute",
    ),
    "together": Entry("code and carrier of the satellites in {receiver} do not diverge"),
    "parted": Entry(
        "code and carrier in {receiver} diverge by {rate_m_s:+.2f} m/s on all satellites: only the codes are dragged, "
        "or the receiver takes its sampling clock and its carrier from two oscillators",
        "a receiver with one oscillator",
    ),
    "turns_as_clock": Entry("motion and a {oscillator} oscillator explain how the carrier phases in {receiver} change"),
    "turned": Entry(
        "all carrier phases in {receiver} change together by {turn_m:+.2f} m within {time_s:.0f} s, which neither "
        "motion nor a {oscillator} oscillator explains",
        "a statement of the receiver's oscillator, and whether it is steered",
    ),
}
