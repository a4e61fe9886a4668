"""Statistics of changes common to all satellites of one antenna, with their laws under the null: arrays only.

**Code and carrier diverge alike.** Ionosphere, reflections and noise make a satellite's code diverge from its carrier,
independently of other satellites but for the ionosphere's common rate, which is bounded. The part of the receiver's
oscillators is constant. Let x be the rate of divergence less the earlier rate. It is independent for each satellite,
and normal of zero mean beside the bound. The chance that most have one sign and a size is that of an order statistic
(`alike_p_value`).

**All carriers turn.** The clock at three moments t apart has a second difference x2 - 2 x1 + x0. Its variance is 2 t^2
times the oscillator's Allan variance at t, whatever its time and rate are. See D. W. Allan, Statistics of atomic
frequency standards, Proc. IEEE 54(2), 1966; NIST SP 1065, 5.2.2. Carriers show it to a centimetre.

**The level changes.** The noise in many correlators shows the power of what is received beside the signals. A
receiver's gain wanders by a stated step from one time to another.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals
from skyproof.detectors.common_change.policy import POLICY
from skyproof.detectors.continuity.policy import POLICY as CONTINUITY
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import Oscillator
from skyproof.statistics.distributions import binomial_survival, normal_two_sided

__all__ = ["Rate", "alike_p_value", "fit_rates", "turn_p_value", "turn_sigma_m"]


class Rate(NamedTuple):
    """Slope of a series and its sigma, m/s: an upper bound where part of the noise has an unknown correlation."""

    rate_m_s: float
    sigma_m_s: float


def fit_rates(elapsed_s: Reals, values_m: Reals, sigma_m: Reals, multipath_sigma_m: float) -> list[Rate]:
    """Fit the slopes of lines through values (n, m) with white noise of `sigma_m` (n, m) and multipath beside it.

    A slope is a sum w x. Multipath is normal with one sigma and any correlation from epoch to epoch. So its part has
    at most that sigma times the sum of |w|, which is 3 over the span.
    """
    centred_s = elapsed_s - elapsed_s.mean()
    weight = centred_s / np.sum(centred_s**2)
    white, slow = weight**2 @ sigma_m**2, multipath_sigma_m * np.sum(np.abs(weight))
    slopes, sigmas = weight @ (values_m - values_m[0]), np.sqrt(white + slow**2)
    return [Rate(*pair) for pair in zip(slopes.tolist(), sigmas.tolist(), strict=True)]


def alike_p_value(difference: ArrayLike, sigma: ArrayLike, slack: float = 0.0) -> Reals:
    """Return the chance (...) of three in four independent values (..., n) so far out on one side.

    The values are normal with mean zero.

    Let m of n be required, and take the m-th largest of the values over their sigmas. The chance that so many are as
    large is binomial; two sides double it. For `slack` zero and true sigmas it is uniform below the chance that m of n
    have one sign (0.29 of eight), and 1 above. For smaller errors than stated it is a bound. It is 1 with fewer than
    five values.

    slack : by which all may be off together.
    """
    values, sigmas = np.asarray(difference, np.float64), np.asarray(sigma, np.float64)
    n = values.shape[-1]
    if n < CONTINUITY.one_sky_satellites:
        return np.ones(values.shape[:-1])
    most = int(np.ceil(POLICY.parting_share * n))
    up, down = (np.sort((side * values - slack) / sigmas, axis=-1)[..., n - most] for side in (1.0, -1.0))
    farthest = np.maximum(up, down)
    # Below zero a smaller error would be the likelier: a stated sigma would be no bound.
    return np.where(farthest > 0.0, 2.0 * binomial_survival(most, n, special.ndtr(-farthest)), 1.0)


def turn_sigma_m(oscillator: Oscillator, apart_s: float) -> float:
    """Return the sigma of the second difference of c times a clock over times `apart_s` apart."""
    return float(SPEED_OF_LIGHT_M_S * np.sqrt(2.0) * apart_s * oscillator.allan_deviation(apart_s))


def turn_p_value(turn_m: ArrayLike, variance_m2: ArrayLike, clock_sigma_m: ArrayLike) -> Reals:
    """Return the two-sided p-value of a clock's second difference measured with `variance_m2`.

    It is uniform if both sigmas are true.
    """
    return np.asarray(normal_two_sided(np.asarray(turn_m) / np.sqrt(variance_m2 + np.square(clock_sigma_m))))
