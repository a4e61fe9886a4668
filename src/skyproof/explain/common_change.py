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
        "this is the first window of {receiver}: later ones are held against it", "half a minute of signal or more"
    ),
    "nothing_shared": Entry(
        "no {needed} satellites in {receiver} have code and carrier both now and before",
        "{needed} or more satellites with code and carrier over half a minute",
    ),
    "together": Entry("code and carrier of the satellites in {receiver} stay together"),
    "parted": Entry(
        "code and carrier in {receiver} part by {rate_m_s:+.2f} m/s on all satellites alike: codes are dragged and "
        "carriers are not, or the sampling clock and the carrier come from two oscillators",
        "a receiver with one oscillator",
    ),
    "turns_as_clock": Entry("the carriers in {receiver} turn as motion and an oscillator of the class {oscillator} do"),
    "turned": Entry(
        "all carriers in {receiver} turn by {turn_m:+.2f} m within {time_s:.0f} s as no motion turns them, more than "
        "an oscillator of the class {oscillator} wanders",
        "what the receiver's clock runs on, or whether it is steered",
    ),
}
