"""Numbers by which the test of motion by codes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "CodeMotionPolicy"]


@dataclass(frozen=True)
class CodeMotionPolicy:
    """Numbers by which the test of motion by codes decides, each with its reason."""

    fault_probability: float = number(1e-4, "1", "Chosen: a good measurement is left out of the fix so rarely.")
    misfit_probability: float = number(
        0.01, "1", "Chosen: residuals of three epochs are larger than their model so rarely, and then nothing is said."
    )
    part_satellites: int = number(
        5, "1", "Four satellites of a time scale or band fit any position: five test it.", "Kaplan & Hegarty, 2.5.2"
    )


POLICY: Final = CodeMotionPolicy()
