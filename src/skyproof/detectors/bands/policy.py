"""Numbers by which the comparison of bands decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "BandsPolicy"]


@dataclass(frozen=True)
class BandsPolicy:
    """Numbers by which the comparison of bands decides, each with its reason."""

    most_ionosphere_m: float = number(
        150.0,
        "m",
        "Slant delay at L1: 50 m at the zenith in a storm, three times as much low down.",
        "Kaplan & Hegarty, 10.2.4.1",
    )
    group_delay_sigma_m: float = number(3.0, "m", "A satellite delays one band against another by so much: 10 ns.")
    reflected_chips: float = number(
        0.125, "chip", "A reflection draws a code off by so much, and codes of two bands apart by both."
    )
    least_satellites: int = number(3, "1", "The median of three satellites outvotes one that is wrong.")


POLICY: Final = BandsPolicy()
