"""What words of findings assume that no measurement shows, by the codes in a finding's data "assumes"."""

from collections.abc import Mapping
from typing import Final

from skyproof.gnss.oscillators import PLATFORM_CLASSES

__all__ = ["ASSUMPTIONS"]

ASSUMPTIONS: Final[Mapping[str, str]] = {
    "receiver_stands": "{receiver} does not move",
    "stands_where_surveyed": "{receiver} stands where it was surveyed",
    "inertial_as_stated": "the inertial unit errs no more than is stated of it",
    **{
        f"oscillator_{name}": f"the clock of {{receiver}} runs freely on an oscillator of the class {name}"
        for name in PLATFORM_CLASSES
    },
    "one_transmit_antenna": "false signals are several, and come from one transmit antenna",
    "none_from_satellites": "no false signal comes from where its satellite stands",
    "no_concert": "no two transmitters act in concert",
    "clean_start": "the signals of {receiver} were true until {clean_until}, before a second sky was seen",
    "one_of_overlapping": "one of the skies that overlap in {receiver} is the true one",
}
