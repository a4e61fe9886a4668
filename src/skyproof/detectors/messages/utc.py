"""Check what satellites state of UTC: its whole seconds are known, and the rest is bounded.

GPS time is within a microsecond of UTC but for whole seconds (IS-GPS-200N, 3.3.4); Galileo's and BeiDou's are nearer.
Leap seconds are announced half a year before (IERS Bulletin C). So GPS minus UTC is known for the time of every log
until then. After it the navigation file says it, or what most satellites of the system say.

A satellite that says otherwise is odd. It may err: in January 2016 fifteen satellites of GPS were 13.7 microseconds
off.
"""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from skyproof.detectors.messages.policy import POLICY
from skyproof.gnss.ephemeris import UtcParameters, UtcStatement
from skyproof.gnss.time import LEAPS_KNOWN_UNTIL, leap_seconds

__all__ = ["leap_seconds_expected", "seconds_beyond_utc"]


def leap_seconds_expected(gpst: np.datetime64, filed: UtcParameters | None, heard: Iterable[UtcStatement]) -> int:
    """Return GPS minus UTC at an instant, in whole seconds.

    filed : what the navigation file says. heard : the latest statements of the satellites of a system, one at least.
    """
    if gpst < LEAPS_KNOWN_UNTIL:
        return leap_seconds(gpst)
    if filed is not None:
        return filed.leap_seconds
    return Counter(each.leap_seconds_at(gpst) for each in heard).most_common(1)[0][0]


def seconds_beyond_utc(stated: UtcStatement, gpst: np.datetime64, expected: int) -> float:
    """Return by how many seconds a statement is off UTC beyond what the system's time may be; 0 where it is not."""
    off_s = stated.leap_seconds_at(gpst) - expected + stated.off_s(gpst)
    return off_s if abs(off_s) > POLICY.utc_apart_s else 0.0
