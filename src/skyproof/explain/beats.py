"""What `beats` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry

__all__ = ["ENTRIES"]

ENTRIES: Final[Mapping[str, Entry]] = {
    "few_signals": Entry(
        "fewer than {needed} signals of {receiver} have correlators and a direction", "more satellites with orbits"
    ),
    "apart": Entry("the power of {n_signals} signals in {receiver} shows no second sky: {lines} of them beat"),
    "together": Entry(
        "the power of {n_signals} signals in {receiver} beats as with a second sky that overlaps the tracked one and "
        "moves by {motion_m_s:.2f} m/s beside it, its clock by {clock_m_s:.2f} m/s",
        'a platform file that states that the receiver stands (motion = "static"), if it does',
    ),
}
