"""What the test against an inertial unit finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry

__all__ = ["ENTRIES"]

_OFF: Final = (
    "position and velocity in {receiver} leave what the inertial unit lets expect by {statistic:.1f} m and "
    "{off_m_s:.1f} m/s"
)
_REMEDY: Final = "a second receiver, or an inertial unit that is tried by manoeuvres before"

ENTRIES: Final[Mapping[str, Entry]] = {
    "not_aligned": Entry(
        "the inertial unit of {receiver} is not aligned yet, or no velocity is measured", "the attitude at its start"
    ),
    "goes_on": Entry("position and velocity of {receiver} go on as the inertial unit lets expect"),
    "departs": Entry(f"{_OFF}, which had gone on with the signals before", beside=True),
    **{
        code: Entry(f"{_OFF}: {why}", _REMEDY)
        for code, why in {
            "not_tried": "they have not gone on together before, and the unit or what is stated of it may be wrong",
            "moved_more": "it was not moved so much before, and the unit or what is stated of it may be wrong",
            "parts_slowly": "they part slowly, as they do if the unit errs",
            "blow": "there was a blow, or an error in the unit's readings",
            "by_some": "without some two satellites it may be chance, or reflections",
        }.items()
    },
}
