"""Empty epochs that are no fix: residuals reject them, or no receiver on Earth can show them."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.navigation.fix import FixGeometry
from skyproof.records import Fix, FixStatus
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["empty_epochs", "reject_misfits"]

MISFIT_PROBABILITY = 1e-6
"""Of rejecting a good fix: rare at ten fixes a second for a day."""
HEIGHT_M = (-1e3, 40e3)
"""Where a fix without redundancy is believed: from the Dead Sea to a balloon."""
NUMBERS = (
    "position_ecef_m",
    "velocity_ecef_m_s",
    "clock_bias_s",
    "clock_drift",
    "covariance_m2",
    "residual_m",
    "protection_m",
    "hidden_m",
)


def reject_misfits(fix: Fix, geometry: FixGeometry, *, with_misfits: bool = False) -> Fix:
    """Empty the epochs of a fix that are no fix.

    with_misfits : keep epochs whose residuals fit no one position, wherever a receiver on Earth can be, as a receiver
    shows them that does not test its residuals.

    The sum of squared residuals over their sigmas is chi-square if all satellites fit one position, with as many
    degrees as there are satellites beyond the unknowns. Without such a satellite anything fits: true and false signals
    mixed gave heights of a thousand kilometres.
    """
    good = fix.status == FixStatus.OK
    used = np.isfinite(geometry.misfit_m) & np.isfinite(geometry.design).all(axis=-1)
    unknowns = 3 + np.any(np.where(used[..., None], geometry.design[..., 3:], 0.0) != 0.0, axis=1).sum(axis=-1)
    dof = used.sum(axis=1) - unknowns
    squared = np.nansum(np.where(used, fix.residual_m / geometry.sigma_m, np.nan) ** 2, axis=1)
    redundant = (dof > 0) & (not with_misfits)
    misfit = good & redundant & (chi_square_survival(squared, np.maximum(dof, 1)) < MISFIT_PROBABILITY)
    height_m = geodetic_from_ecef(np.where(good[:, None], fix.position_ecef_m, 6.4e6))[2]
    off = good & ~redundant & ((height_m < HEIGHT_M[0]) | (height_m > HEIGHT_M[1]))
    status = np.where(misfit, FixStatus.MISFIT, np.where(off, FixStatus.OFF_EARTH, fix.status)).astype(np.uint8)
    return empty_epochs(fix, misfit | off, status)


def empty_epochs(fix: Fix, bad: Booleans, status: NDArray[np.uint8]) -> Fix:
    """Return the fix without the numbers of some epochs, (n,), and with the status of all, (n,)."""
    if not bad.any():
        return fix
    emptied: dict[str, Any] = {}
    for name in NUMBERS:
        emptied[name] = np.array(getattr(fix, name), float)
        emptied[name][bad] = np.nan
    return replace(fix, status=status, **emptied)
