"""Numbers by which the test of a known place decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "KnownPlacePolicy"]


@dataclass(frozen=True)
class KnownPlacePolicy:
    """Numbers by which the test of a known place decides, each with its reason."""

    survey_sigma_m: float = policy_field(
        2.0,
        unit="m",
        reason="The datum of a surveyed place lies 1 to 2 m from that of the orbits.",
        source="EPSG:1188",
    )
    least_satellites: int = policy_field(
        3,
        unit="1",
        reason="Of three satellites at an epoch one may be left out.",
    )
    most_epochs: int = policy_field(
        100,
        unit="1",
        reason="So many epochs of a window, evenly, hold what it says: its errors last for seconds.",
    )


POLICY: Final = KnownPlacePolicy()
