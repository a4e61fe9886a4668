"""Numbers by which the comparison of bands decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "BandsPolicy"]


@dataclass(frozen=True)
class BandsPolicy:
    """Numbers by which the comparison of bands decides, each with its reason."""

    most_ionosphere_m: float = policy_field(
        150.0,
        unit="m",
        reason="Slant delay at L1: 50 m at the zenith in a storm, three times as much low down.",
        source="Kaplan & Hegarty, 10.2.4.1",
    )
    group_delay_sigma_m: float = policy_field(
        3.0,
        unit="m",
        reason="A satellite delays one band against another by so much: 10 ns.",
    )
    reflected_chips: float = policy_field(
        0.125,
        unit="chip",
        reason="A reflection draws a code off by so much, and codes of two bands apart by both.",
    )
    least_satellites: int = policy_field(
        3,
        unit="1",
        reason="The median of three satellites outvotes one that is wrong.",
    )


POLICY: Final = BandsPolicy()
