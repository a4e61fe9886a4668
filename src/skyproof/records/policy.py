"""The numbers by which a room decides stand together: one frozen record a room, a field a number.

What is set by a user stands in settings; what only makes a computation fast or exact stays where it is.
"""

from dataclasses import field, fields
from typing import Any, NamedTuple

__all__ = ["PolicyNumber", "number", "numbers_of"]


class PolicyNumber(NamedTuple):
    """A number of a policy: its name, value and unit, why it is so, and where that stands."""

    name: str
    value: Any
    unit: str
    reason: str
    source: str


def number(value: Any, unit: str, reason: str, source: str = "") -> Any:
    """Make a field of a policy, a frozen dataclass.

    unit : "1" of a count, a share or a probability. reason : one sentence. source : document and section, or empty
    where the reason says how the number was derived.
    """
    return field(default=value, metadata={"unit": unit, "reason": reason, "source": source})


def numbers_of(policy: Any) -> list[PolicyNumber]:
    """Return the numbers of a policy, as its fields give them."""
    return [PolicyNumber(each.name, getattr(policy, each.name), **each.metadata) for each in fields(policy)]
