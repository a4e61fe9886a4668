"""What the codes of two bands change by together, satellite by satellite, and how improbable that is: arrays only.

Model. The difference of two codes of satellite s of n changes from one window to another by `c + e_s`. Whatever the
receiver's oscillator does is in both codes. So c is the ionosphere's, at most `slack_m` in size, and the receiver's,
which delays its bands alike all the time. `e_s` is noise and reflections, normal and independent between satellites,
with variances known up to a common factor: 1 where the scatter of the changes is as modelled, else the scatter gives
it. The mean beyond the slack, squared over its variance, is then F with 1 and n - 1 degrees (Kay, Detection Theory,
9.3); chi-square with one where the factor is known.
"""

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.bands.policy import POLICY
from skyproof.statistics.distributions import chi_square_survival, f_survival

__all__ = ["evaluate_common_change"]


def evaluate_common_change(change_m: Reals, variance_m2: Reals, slack_m: float) -> tuple[float, float]:
    """Estimate the common change of n satellites (n,), metres, and the chance of one at least so large."""
    n = change_m.size
    weight = 1.0 / variance_m2
    mean_m = float((weight * change_m).sum() / weight.sum())
    scatter, dof = float((weight * (change_m - mean_m) ** 2).sum()), n - 1
    fits = chi_square_survival(scatter, dof) >= POLICY.misfit_probability
    factor, degrees = (1.0, np.inf) if fits else (scatter / dof, float(dof))
    beyond_m = max(abs(mean_m) - slack_m, 0.0)
    return mean_m, float(f_survival(beyond_m**2 * weight.sum() / factor, 1, degrees))
