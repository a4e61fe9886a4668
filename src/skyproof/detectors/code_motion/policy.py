"""Numbers by which the test of motion by codes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "CodeMotionPolicy"]


@dataclass(frozen=True)
class CodeMotionPolicy:
    """Numbers by which the test of motion by codes decides, each with its reason."""

    fault_probability: float = policy_field(
        1e-4,
        unit="1",
        reason="Measurements of an epoch that fit its position more rarely are left out of the fix.",
    )
    misfit_probability: float = policy_field(
        0.01,
        unit="1",
        reason="Residuals of three epochs are larger than their model so rarely.",
    )
    part_satellites: int = policy_field(
        5,
        unit="1",
        reason=("Satellites of a time scale or a second band that are looked at by themselves: four fit any position."),
    )


POLICY: Final = CodeMotionPolicy()
