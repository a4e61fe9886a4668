"""Which satellites stand above the horizon, for who knows time and place roughly."""

from typing import Final

import numpy as np

from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import seconds_between

__all__ = ["MARGIN_DEG", "list_sats_above"]

MARGIN_DEG: Final = 5.0
"""Below the horizon: what 500 km or ten minutes amount to."""
_STEP_S: Final = 300.0  # a satellite rises by 2.5 degrees


def list_sats_above(
    navigation: NavigationData,
    sats: tuple[str, ...],
    lat_rad: float,
    lon_rad: float,
    first_gpst: np.datetime64,
    last_gpst: np.datetime64,
) -> tuple[str, ...]:
    """List the satellites that stand higher than `MARGIN_DEG` below the horizon between two times.

    Satellites without an ephemeris that serves then are left out: the file says that they were not received.
    """
    place_ecef_m = ecef_from_geodetic(lat_rad, lon_rad, 0.0)
    n_steps = int(seconds_between(last_gpst, first_gpst) // _STEP_S) + 2
    at = first_gpst + np.linspace(0.0, 1.0, n_steps) * (last_gpst - first_gpst)
    above = []
    for sat in sats:
        ephemeris = navigation.best(sat, first_gpst)
        if ephemeris is not None:
            positions = np.stack([compute_satellite_state(ephemeris, gpst).position_ecef_m for gpst in at])
            el_rad = compute_azimuth_elevation(place_ecef_m, positions)[1]
            if el_rad.max() > -np.radians(MARGIN_DEG):
                above.append(sat)
    return tuple(above)
