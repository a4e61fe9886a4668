"""What words of findings assume that no measurement shows, by the codes in a finding's data "assumes"."""

from collections.abc import Mapping
from typing import Final

__all__ = ["ASSUMPTIONS"]

ASSUMPTIONS: Final[Mapping[str, str]] = {
    "receiver_stands": "{receiver} does not move",
}
