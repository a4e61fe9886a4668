"""What `array_common` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry

__all__ = ["ENTRIES", "FEW_ANTENNAS"]

FEW_ANTENNAS: Final = Entry("fewer than two antennas of {receiver} give phases", "phases of two antennas or more")

ENTRIES: Final[Mapping[str, Entry]] = {
    "few_antennas": FEW_ANTENNAS,
    "few_signals": Entry("{signals} signals make no pair to compare", "two or more signals over the same time"),
    "one_direction": Entry("signals of {size} of {of} satellites come to {receiver} from one direction"),
    "one_direction_or_antenna": Entry(
        "signals of all {of} satellites reach the two antennas of {receiver} with one phase difference: they come from "
        "one transmitter, or both inputs are from one antenna",
        "a check of the cables of {receiver} for a splitter, a third antenna, or a turn of the two",
    ),
    "directions_near": Entry(
        "the directions of some of {n_signals} signals in {receiver} are too close to tell apart, and the signals too "
        "few to prove one source",
        "a longer window, more satellites, or a larger array or arm",
    ),
    "two_skies": Entry(
        "no two of {n_signals} signals come to {receiver} from one direction, but they form two skies",
        "the attitude of the array, to compare directions with the orbits",
    ),
    "directions_differ": Entry("no two of {of} signals come to {receiver} from one direction"),
}
