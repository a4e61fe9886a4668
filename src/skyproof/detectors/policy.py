"""The numbers by which a detector decides stand together: one frozen record a room, a field a number.

What is set by a user stands in a detector's settings; what only makes a computation fast or exact stays where it is.
"""

from dataclasses import field, fields
from typing import Any, NamedTuple

__all__ = ["PolicyNumber", "numbers_of", "policy_field"]


class PolicyNumber(NamedTuple):
    """A number of a policy: its name, value and unit, why it is so, and where that stands."""

    name: str
    value: Any
    unit: str
    reason: str
    source: str


def policy_field(default: Any, *, unit: str, reason: str, source: str = "") -> Any:
    """Make a field of a policy, a frozen dataclass.

    unit : "1" of a count, a share or a probability. reason : one sentence. source : document and section, or empty
    where the reason says all.
    """
    return field(default=default, metadata={"unit": unit, "reason": reason, "source": source})


def numbers_of(policy: Any) -> list[PolicyNumber]:
    """Return the numbers of a policy, as its fields give them."""
    return [PolicyNumber(one.name, getattr(policy, one.name), **one.metadata) for one in fields(policy)]
