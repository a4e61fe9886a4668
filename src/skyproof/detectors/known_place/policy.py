"""Numbers by which the test of a known place decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "KnownPlacePolicy"]


@dataclass(frozen=True)
class KnownPlacePolicy:
    """Numbers by which the test of a known place decides, each with its reason."""

    survey_sigma_m: float = number(
        2.0, "m", "The datum of a surveyed place lies 1 to 2 m from that of the orbits.", "EPSG:1188"
    )
    least_satellites: int = number(3, "1", "Of three satellites at an epoch one may be left out.")
    most_epochs: int = number(
        100, "1", "Ten a second of a usual window: errors last for seconds, and more epochs say the same."
    )


POLICY: Final = KnownPlacePolicy()
