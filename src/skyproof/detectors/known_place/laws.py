"""Test codes of one epoch against a known place, whatever the receiver's clock shows.

Model. A code less the range from the known place has three parts: the clock of its time scale, an error independent
between satellites, and minus the projection of the place's error. The covariance of the place is known. After the
clocks are removed, the squared length over the covariance is chi-square, with one degree for each satellite beyond one
per scale. See Kay, Detection Theory, 4.6: a linear model with nuisance parameters. Two satellites of one scale are
enough.
"""

import numpy as np

from skyproof.arrays import Reals
from skyproof.statistics.distributions import chi_square_survival

__all__ = ["chance_at_place"]


def chance_at_place(
    misfit_m: Reals, sigma_m: Reals, unit: Reals, clocks: Reals, place_m2: Reals, kept: Reals | None = None
) -> float:
    """Return the chance of misfits at least so large; 1 with no satellite beyond one of each scale.

    misfit_m, sigma_m : (n,) of each code at the place. unit : (n, 3) to the satellites. clocks : (n, c) one where a
    code uses a scale. place_m2 : (3, 3) covariance of the place. kept : (n,) which of them are used; all by default.
    """
    rows = np.arange(misfit_m.size) if kept is None else np.flatnonzero(kept)
    scales = clocks[rows][:, clocks[rows].any(axis=0)]
    dof = rows.size - scales.shape[1]
    if dof < 1:
        return 1.0
    covariance_m2 = np.diag(sigma_m[rows] ** 2) + unit[rows] @ place_m2 @ unit[rows].T
    weight = np.linalg.inv(covariance_m2)
    normal = scales.T @ weight
    clock_m = np.linalg.solve(normal @ scales, normal @ misfit_m[rows])
    left_m = misfit_m[rows] - scales @ clock_m
    return float(chi_square_survival(left_m @ weight @ left_m, dof))
