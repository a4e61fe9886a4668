"""First-order Gauss-Markov processes in continuous time, stepped and integrated without approximation.

dz/dt = -z / T + noise, stationary with standard deviation s: cov(z(t), z(t + d)) = s^2 exp(-|d| / T). The
joint law of the values at the ends of each step and of the integrals between them is exact, whatever the step.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from skyproof.arrays import Reals

__all__ = ["GaussMarkovStep", "gauss_markov_allan_variance", "gauss_markov_path", "gauss_markov_step"]

_SMALL = 1e-3  # of a correlation time; below, differences lose digits and the series is exact to 1e-13


class GaussMarkovStep(NamedTuple):
    """One step, arrays (...): z1 = keep z0 + drive n, with the integral half (z0 + z1) + spread m.

    n and m are standard normal.

    The integral's mean given both ends is T tanh(d / 2T) (z0 + z1), its variance s^2 T^2 (2 d / T - 4 tanh(d / 2T)).
    """

    keep: Reals
    drive: Reals
    half: Reals
    spread: Reals


def gauss_markov_step(sigma: ArrayLike, correlation_s: ArrayLike, interval_s: float) -> GaussMarkovStep:
    """Compute the step of processes of sigma `sigma` (...) and correlation time `correlation_s` (...)."""
    sigma, correlation_s = np.broadcast_arrays(np.asarray(sigma, np.float64), np.asarray(correlation_s, np.float64))
    steps = interval_s / correlation_s
    tanh = np.tanh(0.5 * steps)
    variance = np.where(steps < _SMALL, steps**3 / 6.0 * (1.0 - steps**2 / 10.0), 2.0 * steps - 4.0 * tanh)
    return GaussMarkovStep(
        keep=np.exp(-steps),
        drive=sigma * np.sqrt(-np.expm1(-2.0 * steps)),
        half=correlation_s * tanh,
        spread=sigma * correlation_s * np.sqrt(variance),
    )


def gauss_markov_path(step: GaussMarkovStep, start: ArrayLike, normals: Reals) -> Reals:
    """Simulate values (n + 1, k) from `start` (k,) on, one column a process, driven by standard normals (n, k)."""
    start = np.asarray(start, np.float64)
    path = np.empty((normals.shape[0] + 1, normals.shape[1]))
    path[0] = start
    keep, drive = (np.broadcast_to(each, start.shape) for each in (step.keep, step.drive))
    for k in range(start.size):
        path[1:, k], _ = scipy.signal.lfilter([1.0], [1.0, -keep[k]], drive[k] * normals[:, k], zi=[keep[k] * start[k]])
    return path


def gauss_markov_allan_variance(sigma: ArrayLike, correlation_s: ArrayLike, tau_s: ArrayLike) -> Reals:
    """Compute the Allan variance of such a process as a rate: IEEE Std 952-1997, annex C, equation C.21.

    Shapes broadcast.

    It peaks at 1.89 correlation times, at (0.617 sigma)^2.
    """
    sigma, ratio = np.asarray(sigma, np.float64), np.asarray(tau_s, np.float64) / np.asarray(correlation_s, np.float64)
    # 3 - 4 exp(-x) + exp(-2x), in a form that keeps digits
    bend = -4.0 * np.expm1(-ratio) + np.expm1(-2.0 * ratio)
    series = ratio / 3.0 * (1.0 - 0.75 * ratio)
    return np.asarray(sigma**2 * np.where(ratio < 1e-4, 2.0 * series, 2.0 / ratio * (1.0 - bend / (2.0 * ratio))))
