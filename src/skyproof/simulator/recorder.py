"""Quantise samples as a recorder does, and compute what becomes of signals in its numbers.

One sigma of receiver noise is 24 steps of 8 bits and 4096 of 16: that leaves 14 and 18 dB for stronger signals.
"""

import numpy as np
import scipy

from skyproof.arrays import Floats, Reals
from skyproof.simulator.scenario import FrontEnd

__all__ = ["compute_recorded", "quantise"]

_INT_SIGMA = {8: 24.0, 16: 4096.0}


def quantise(planes: Floats, front_end: FrontEnd) -> None:
    """Quantise in place, with levels for a noise of variance 1."""
    if front_end.encoding == "sign":
        np.copysign(np.float32(1.0), planes, out=planes)
    elif front_end.encoding == "sign-magnitude":  # threshold at one sigma, best to 0.01 dB (Max, 1960: 0.98)
        np.copysign(np.where(np.abs(planes) > 1.0, np.float32(3.0), np.float32(1.0)), planes, out=planes)
    elif front_end.encoding == "int":
        limit = 2 ** (front_end.bits - 1) - 1
        np.multiply(planes, np.float32(_INT_SIGMA[front_end.bits]), out=planes)
        np.clip(np.rint(planes, out=planes), -limit, limit, out=planes)


def compute_recorded(front_end: FrontEnd, power: Reals) -> tuple[Reals, Reals]:
    """Compute gain and power of the recorder's numbers, for normal samples of variance `power`, any shape.

    The gain of a staircase is the sum of its steps times the density there (Bussgang's theorem).
    """
    sigma = np.sqrt(power)
    before = 1.0 / sigma if front_end.agc else np.ones(power.shape)  # of the gain control
    at = sigma * before
    if front_end.encoding == "sign":
        return before * np.sqrt(2.0 / np.pi) / at, np.ones(power.shape)
    if front_end.encoding == "sign-magnitude":
        density = (2.0 + 4.0 * np.exp(-0.5 / at**2)) / (np.sqrt(2.0 * np.pi) * at)
        return before * density, 1.0 + 16.0 * scipy.special.ndtr(-1.0 / at)
    steps = _INT_SIGMA[front_end.bits] if front_end.encoding == "int" else 1.0
    return before * steps, (at * steps) ** 2 + (1.0 / 12.0 if steps > 1.0 else 0.0)
