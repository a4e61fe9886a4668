"""Positions of a verdict in words: how far they can be off, and how far one lies from another."""

import math

from skyproof.report.words import offset_m, offset_words
from skyproof.verdict import Position, ReceiverResult, radius_95_m

__all__ = ["away_m", "describe_distance", "measure_misleading_m", "within_m"]


def measure_misleading_m(receiver: ReceiverResult) -> float:
    """Return how far the unprotected fix lies from the usable one, horizontally; 0 within their errors."""
    usable, other = receiver.usable, receiver.unprotected_fix
    if usable is None or other is None:
        return 0.0
    apart_m = away_m(receiver, other)
    return apart_m if apart_m > within_m(usable[1]) + within_m(other) + (usable[1].hidden_m or 0.0) else 0.0


def within_m(fix: Position) -> float:
    """Return `radius_95_m` of a fix."""
    return radius_95_m(fix.sigma_east_m, fix.sigma_north_m)


def away_m(receiver: ReceiverResult, fix: Position) -> float:
    """Return how far a fix lies from the last one that may be used, horizontally, metres; NaN without one."""
    if receiver.usable is None:
        return math.nan
    true = receiver.usable[1]
    return math.hypot(*offset_m((true.lat_deg, true.lon_deg), (fix.lat_deg, fix.lon_deg)))


def describe_distance(receiver: ReceiverResult, fix: Position) -> str:
    """State how far a fix lies from the last usable one, and in which direction; empty without one."""
    if receiver.usable is None:
        return ""
    true = receiver.usable[1]
    return offset_words((true.lat_deg, true.lon_deg), (fix.lat_deg, fix.lon_deg))
