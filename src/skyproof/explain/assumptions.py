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
    "one_false_sky": "one transmitter sends one false sky",
    "one_change": ("within two minutes signals do not go over from the sky to a transmitter more than once, and back"),
    "antennas_as_stated": "the antennas stand where they are said to",
    "antennas_rigid": "the antennas do not move relative to each other",
    "distance_as_stated": "the antennas stand {distance_m:g} ± {distance_sigma_m:.2g} m apart",
    "distance_as_stated_and_not_shown": (
        "the antennas stand {distance_m:g} ± {distance_sigma_m:.2g} m apart, and no false position of one receiver "
        "alone lies at that distance from the other"
    ),
    "distance_kept": "the antennas keep the distance that they had while both skies were received",
    "clean_start": "the signals of {receiver} were true until {clean_until}, before a second sky was seen",
    "one_of_overlapping": "one of the skies that overlap in {receiver} is the true one",
}
