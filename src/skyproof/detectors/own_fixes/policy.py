"""Numbers by which the test of a receiver's own fixes decides."""

from dataclasses import dataclass
from typing import Final

from skyproof.detectors.policy import policy_field

__all__ = ["POLICY", "OwnFixesPolicy"]


@dataclass(frozen=True)
class OwnFixesPolicy:
    """Numbers by which the test of a receiver's own fixes decides, each with its reason."""

    fix_error_m: float = policy_field(
        20.0,
        unit="m",
        reason="A receiver's own fix among buildings errs by so much without an attack.",
    )


POLICY: Final = OwnFixesPolicy()
