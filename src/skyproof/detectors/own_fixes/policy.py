"""Numbers by which the test of a receiver's own fixes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.records.policy import number

__all__ = ["POLICY", "OwnFixesPolicy"]


@dataclass(frozen=True)
class OwnFixesPolicy:
    """Numbers by which the test of a receiver's own fixes decides, each with its reason."""

    fix_error_m: float = number(
        20.0, "m", "Reflections in streets put fixes tens of metres off, rarely more.", "Kaplan & Hegarty, 9.5"
    )


POLICY: Final = OwnFixesPolicy()
