"""Numbers by which the test of motion by codes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "CodeMotionPolicy"]


@dataclass(frozen=True)
class CodeMotionPolicy:
    """Numbers by which the test of motion by codes decides, each with its reason."""

    fault_probability: float = number(
        1e-4, "1", "Measurements of an epoch that fit its position more rarely are left out of the fix."
    )
    misfit_probability: float = number(0.01, "1", "Residuals of three epochs are larger than their model so rarely.")
    part_satellites: int = number(
        5, "1", "Satellites of a time scale or a second band that are looked at by themselves: four fit any position."
    )


POLICY: Final = CodeMotionPolicy()
