"""Which satellites stand too low for their ranges to be held against a position."""

from typing import Final

import numpy as np

from skyproof.arrays import Booleans, Reals
from skyproof.gnss.sky import compute_azimuth_elevation

__all__ = ["RECEIVED_FROM_DEG", "find_low"]

RECEIVED_FROM_DEG: Final = -4.0
"""No signal comes from farther below the horizon: its dip from 10 km is 3.2 degrees, and refraction lifts by 0.6. That
such a signal is there is no matter of the air, so no mask hides it."""


def find_low(place_ecef_m: Reals, satellite_ecef_m: Reals, mask_deg: float) -> Booleans:
    """Find the satellites (n, 3) that stand below the mask as seen from a place (3,), and can be received: (n,)."""
    elevation_deg = np.degrees(compute_azimuth_elevation(place_ecef_m, satellite_ecef_m)[1])
    return np.asarray((elevation_deg >= RECEIVED_FROM_DEG) & (elevation_deg < mask_deg))
