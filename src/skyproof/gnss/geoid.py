"""The geoid over the ellipsoid, coarsely: what altitudes above mean sea level need.

`geoid.npz` holds EGM96 (Lemoine et al., NASA/TP-1998-206861; public domain) in whole metres at every whole degree of
latitude and longitude. Between them it is interpolated, which is off from the whole model of degree 360 by 0.5 m one
sigma, less than 1.0 m in 95 % of places on Earth, and up to 8 m over deep-sea trenches and high mountains. The model
itself is off by half a metre to a metre, more where little was surveyed when it was made.
"""

from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals

__all__ = ["GEOID_SIGMA_M", "interpolate_geoid_m"]

GEOID_SIGMA_M: Final = 0.5
"""What the coarse grid is off from EGM96, one sigma over the whole Earth."""


def interpolate_geoid_m(lat_deg: ArrayLike, lon_deg: ArrayLike) -> Reals:
    """Interpolate the geoid's height above the WGS-84 ellipsoid, metres; NaN where a place is not finite."""
    lat, lon = np.broadcast_arrays(np.asarray(lat_deg, np.float64), np.asarray(lon_deg, np.float64))
    known = np.isfinite(lat) & np.isfinite(lon)
    y, x = np.where(known, lat, 0.0) + 90.0, np.mod(np.where(known, lon, 0.0), 360.0)
    row, column = np.clip(np.floor(y).astype(np.intp), 0, 179), np.floor(x).astype(np.intp)
    up, right = y - row, x - column
    grid = _load_grid()
    south, north = ((1.0 - right) * grid[r, column % 360] + right * grid[r, (column + 1) % 360] for r in (row, row + 1))
    return np.where(known, (1.0 - up) * south + up * north, np.nan)


@cache
def _load_grid() -> Reals:
    """Load the grid (181, 360): from the south pole northwards, from Greenwich eastwards."""
    with files("skyproof.gnss").joinpath("geoid.npz").open("rb") as file, np.load(file) as table:
        return np.asarray(table["egm96_m"], np.float64)
