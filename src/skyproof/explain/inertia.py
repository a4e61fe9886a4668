"""What the test against an inertial unit finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry

__all__ = ["ENTRIES"]

_OFF: Final = (
    "position and velocity of {receiver} depart from the inertial prediction by {statistic:.1f} m and {off_m_s:.1f} m/s"
)
_REMEDY: Final = "a second receiver, or a manoeuvre under clean signals first, which calibrates the inertial unit"

ENTRIES: Final[Mapping[str, Entry]] = {
    "not_aligned": Entry(
        "the inertial unit of {receiver} is not aligned yet, or no velocity is measured", "the attitude at its start"
    ),
    "goes_on": Entry("position and velocity of {receiver} agree with the inertial prediction"),
    "departs": Entry(f"{_OFF}; until then signals and inertial unit agreed", beside=True),
    **{
        code: Entry(f"{_OFF}: {why}", _REMEDY)
        for code, why in {
            "not_tried": "the unit was not compared with clean signals before, so its errors may be larger than stated",
            "moved_more": "this motion is stronger than any before, so the unit's errors may be larger than stated",
            "parts_slowly": "the departure is slow, as with an error of the unit",
            "blow": "the unit felt a shock, or its readings are wrong",
            "by_some": "the evidence rests on two satellites, so it may be chance, or reflections",
        }.items()
    },
}
