"""What a prediction rests on, in words."""

from collections.abc import Mapping, Sequence
from typing import Final

from skyproof.explain.entry import join

__all__ = ["name_bases"]

_BASES: Final[Mapping[str, str]] = {
    "surveyed_place": "its surveyed place",
    "standing": "the statement that it stands still",
    "inertial_unit": "the inertial unit",
    "clock": "its clock",
}


def name_bases(codes: Sequence[str]) -> str:
    """Return what a prediction rests on: "its standing still and its clock"."""
    return join([_BASES[code] for code in codes])
