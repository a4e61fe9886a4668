"""How the geometry of the satellites used dilutes precision."""

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.least_squares import compute_line_of_sight, design_matrix, invert_normal
from skyproof.navigation.ranges import correct_ranges, list_time_scales
from skyproof.records import Fix, FixStatus, NavigationData

__all__ = ["compute_horizontal_dilution"]

_TRAVEL_S = 0.075  # within 12 ms of any satellite's: it moves by less than 50 m in that
_BLOCK_EPOCHS = 4096  # bounds the memory of a day at 1 Hz


def compute_horizontal_dilution(fix: Fix, navigation: NavigationData) -> Reals:
    """Compute the HDOP of each epoch of a fix, (n_epochs,): the horizontal error for unit range errors.

    Kaplan & Hegarty, "Understanding GPS/GNSS", 3rd edition, 11.2.1. NaN where there is no fix.
    """
    blocks = [slice(first, first + _BLOCK_EPOCHS) for first in range(0, max(fix.gpst.size, 1), _BLOCK_EPOCHS)]
    return np.concatenate([_compute_block(fix, navigation, rows) for rows in blocks])


def _compute_block(fix: Fix, navigation: NavigationData, rows: slice) -> Reals:
    used, position_m = np.isfinite(fix.residual_m[rows]), fix.position_ecef_m[rows]
    travel_m = np.full(used.shape, _TRAVEL_S * SPEED_OF_LIGHT_M_S)
    satellite_m = correct_ranges(fix.signals, fix.gpst[rows], travel_m, navigation).satellite_ecef_m
    _, unit, _ = compute_line_of_sight(satellite_m, position_m)
    design = np.where(used[..., None], design_matrix(unit, list_time_scales(fix.signals)[1]), 0.0)
    cofactor = invert_normal(np.swapaxes(design, -1, -2) @ design)[..., :3, :3]
    lat_rad, lon_rad, _ = geodetic_from_ecef(position_m)
    rot_enu = rot_enu_ecef(lat_rad, lon_rad)
    east_north = np.diagonal(rot_enu @ cofactor @ np.swapaxes(rot_enu, -1, -2), axis1=-2, axis2=-1)[..., :2]
    return np.asarray(np.where(fix.status[rows] == FixStatus.OK, np.sqrt(east_north.sum(axis=-1)), np.nan))
