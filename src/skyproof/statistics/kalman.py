"""Kalman update of a linear state by measurements with Gaussian noise."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals

__all__ = ["KalmanUpdate", "kalman_update"]


class KalmanUpdate(NamedTuple):
    """What measurements change.

    change : (..., n) to be added to the state. covariance : (..., n, n) of the state's errors after it.
    innovation : (..., m). spread : (..., m, m) its covariance.
    """

    change: Reals
    covariance: Reals
    innovation: Reals
    spread: Reals

    @property
    def statistic(self) -> Reals:
        """Return the innovation's square over its covariance (...): chi-square with m degrees if the models hold."""
        y = self.innovation
        return np.asarray(np.sum(y * np.linalg.solve(self.spread, y[..., None])[..., 0], axis=-1))


def kalman_update(
    covariance: ArrayLike,
    sensitivity: ArrayLike,
    noise: ArrayLike,
    innovation: ArrayLike,
    *,
    assumed_covariance: ArrayLike | None = None,
    assumed_noise: ArrayLike | None = None,
) -> KalmanUpdate:
    """Update a state by measurements that are linear in it.

    The covariance has Joseph's form, which holds for any gain and stays positive whatever the rounding. See Groves,
    Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., 3.2.2, (3.58).

    Parameters
    ----------
    covariance : (..., n, n) of the state's errors before.
    sensitivity : (..., m, n) of the measurements to the state.
    noise : (..., m, m) covariance of the measurements.
    innovation : (..., m) measured less predicted. Predicted less measured gives the state's errors, to be taken off.
    assumed_covariance, assumed_noise : from which the gain is computed, in place of the true ones.

    Raises
    ------
    numpy.linalg.LinAlgError : the innovation's covariance is singular.
    """
    p, h, r, y = (np.asarray(values, np.float64) for values in (covariance, sensitivity, noise, innovation))
    assumed_p = p if assumed_covariance is None else np.asarray(assumed_covariance, np.float64)
    assumed_r = r if assumed_noise is None else np.asarray(assumed_noise, np.float64)
    shared = h @ assumed_p
    spread = shared @ np.swapaxes(h, -1, -2) + assumed_r
    gain_t = np.linalg.solve(spread, shared)
    gain = np.swapaxes(gain_t, -1, -2)
    kept = np.eye(p.shape[-1]) - gain @ h
    return KalmanUpdate(
        change=(gain @ y[..., None])[..., 0],
        covariance=kept @ p @ np.swapaxes(kept, -1, -2) + gain @ r @ gain_t,
        innovation=y,
        spread=spread,
    )
