"""What `known_place` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry

__all__ = ["ENTRIES"]

ENTRIES: Final[Mapping[str, Entry]] = {
    "no_place": Entry("the place of {receiver} is not known", "the receiver's surveyed position"),
    "fixed": Entry("the satellites of {receiver} give a position, which other tests check", "nothing"),
    "received_twice": Entry("{receiver} receives no satellite, or one twice", "one signal of each"),
    "few_satellites": Entry(
        "fewer than {least} satellites at any epoch of {receiver} have codes and orbits",
        "more satellites with pseudoranges and orbits",
    ),
    "fits": Entry("the codes of {n_satellites} satellites in {receiver} fit the place where it stands"),
    "does_not_fit": Entry(
        "the codes of {n_satellites} satellites in {receiver} do not fit the place where it stands",
        "more satellites, or another receiver",
    ),
}
