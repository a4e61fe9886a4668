"""Test if a channel is on a signal: the phase-lock statistic of a few frames, with stated error rates.

A frame sums the squares of n coherent prompts: I^2 carries signal and noise, Q^2 noise alone when the phase is held.
d = (I^2 - Q^2)/(I^2 + Q^2) is 2 B - 1 with B ~ Beta(n/2, n/2) on noise, whatever its power (the square of a Gaussian
is a Gamma variable). The statistic is the mean of d over the last frames: frames of equal weight, so that a strong
signal that ended is not remembered by its strength.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals

__all__ = ["lock_threshold", "lock_value"]


def lock_value(i_squares: Reals, q_squares: Reals) -> Reals:
    """Compute d of each frame from the sums of squares, any shape; 0 where there is nothing."""
    total = i_squares + q_squares
    return np.divide(i_squares - q_squares, total, out=np.zeros_like(total), where=total > 0.0)


def lock_threshold(n_prompts: ArrayLike, n_frames: int, false_hold_probability: float) -> Reals:
    """Return what the mean of d over `n_frames` frames exceeds on noise with this probability.

    Each frame has `n_prompts` prompts.

    One frame is exact. The mean of several has the Beta law with the same two first moments (the third is zero): a
    frame's variance is 1/(n + 1), and 2 Beta(a, a) - 1 has 1/(2 a + 1). Any shape of `n_prompts`.
    """
    a = 0.5 * (n_frames * (np.asarray(n_prompts, np.float64) + 1.0) - 1.0)
    return np.asarray(2.0 * special.betaincinv(a, a, 1.0 - false_hold_probability) - 1.0)
