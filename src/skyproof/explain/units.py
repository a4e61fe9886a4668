"""Figures in sentences."""

import numpy as np

from skyproof.gnss.time import format_iso

__all__ = ["clock", "metres", "seconds"]


def clock(gpst: np.datetime64 | None, digits: int = 0) -> str:
    """Return the time of day, "12:00:00.0"."""
    return "an unknown time" if gpst is None else format_iso(gpst, digits)[11:]


def metres(length_m: float) -> str:
    """Return a length in metres or kilometres."""
    return f"{length_m:.1f} m" if length_m < 1000.0 else f"{length_m / 1000.0:.1f} km"


def seconds(time_s: float) -> str:
    """Return a time in the unit that leaves no zeros."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if time_s >= size:
            return f"{time_s / size:.4g} {unit}"
    return f"{time_s * 1e9:.0f} ns"
