"""What `own_fixes` finds, in words."""

from collections.abc import Mapping
from typing import Final

from skyproof.explain.entry import Entry
from skyproof.explain.units import clock

__all__ = ["ENTRIES"]

ENTRIES: Final[Mapping[str, Entry]] = {
    "few_own_fixes": Entry(
        "{receiver} gives fewer than {needed} fixes of its own", "a log with the receiver's fixes, once a second"
    ),
    "goes_on": Entry("the fixes that {receiver} computed itself are continuous"),
    "jumps": Entry(
        lambda f: (
            f"the position that {f.data['receiver']} computed itself jumps by {f.data['jump_m']:.0f} m at "
            f"{clock(f.dated_gpst, 1)}, more than any platform can move"
        ),
        "the receiver's measurements (UBX-RXM-RAWX, SBF MeasEpoch, RTCM MSM7), or a second receiver",
    ),
}
