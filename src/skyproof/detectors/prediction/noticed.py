"""How far a position has to be moved for a window to notice it."""

import numpy as np

from skyproof.arrays import Reals
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.records import NOTICED
from skyproof.statistics.distributions import chi_square_threshold, noncentrality_for_power

__all__ = ["compute_least_move_m"]


def compute_least_move_m(
    covariance_m2: Reals, position_ecef_m: Reals, *, dof: int, false_alarm_probability: float
) -> float:
    """Return the smallest level move that a chi-square test notices with the probability `NOTICED`, the worst way.

    covariance_m2 : (n, n) of what is tested, the position in ECEF first, or the velocity: then the move is one of it,
        in m/s. dof : degrees of freedom of the test.
    """
    threshold = chi_square_threshold(false_alarm_probability, dof)
    needed = float(noncentrality_for_power(threshold, dof, power=NOTICED))
    information = np.linalg.inv(covariance_m2)[:3, :3]
    level = rot_enu_ecef(*geodetic_from_ecef(position_ecef_m)[:2])[:2]
    return float(np.sqrt(needed / np.linalg.eigvalsh(level @ information @ level.T)[0]))
