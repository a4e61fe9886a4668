"""What an early-minus-late discriminator gives for an error, and with how much noise, at a sample rate and a spacing.

The replica is the code smoothed under a triangle of one sample to either side (`kernels.code_table`). With rectangular
chips the correlation of signal and replica is the chips' triangle R smoothed once, that of the replica with itself R
smoothed twice: both follow from the chips a sample alone.
"""

from dataclasses import dataclass

import numpy as np

__all__ = ["Discriminator", "discriminator"]

_STEP_CHIPS = 1e-3


@dataclass(frozen=True, kw_only=True)
class Discriminator:
    """Of (E - L)/P, in phase, with early and late `early_late_chips` apart.

    gain : change of (E - L)/P for one chip of error; 2 for sharp chips (Kaplan & Hegarty, 8.7.3).
    noise_chips2 : variance of the error found is this over C/N0 and the time of integration. d/4 for sharp chips: their
        eq. 8.81 with B = 1/(2 T) and without squaring loss. C/N0 is that of the prompt correlator.
    """

    gain: float
    noise_chips2: float


def discriminator(chips_per_sample: float, early_late_chips: float) -> Discriminator:
    """Gain and noise for replicas smoothed under a triangle of `chips_per_sample` to either side."""
    reach = 1.0 + 2.0 * chips_per_sample + early_late_chips
    x = np.arange(-round(reach / _STEP_CHIPS), round(reach / _STEP_CHIPS) + 1) * _STEP_CHIPS
    chips = np.maximum(1.0 - np.abs(x), 0.0)
    weight = np.maximum(1.0 - np.abs(x) / chips_per_sample, 0.0)
    weight = weight[weight > 0.0] / np.sum(weight)
    once = np.convolve(chips, weight, "same")
    twice = np.convolve(once, weight, "same")
    half, step = 0.5 * early_late_chips, 0.01
    seen = np.interp([0.0, half - step, half + step], x, once)
    gain = (seen[1] - seen[2]) / step / seen[0]
    apart = np.interp(early_late_chips, x, twice) / np.interp(0.0, x, twice)
    return Discriminator(gain=float(gain), noise_chips2=float((1.0 - apart) / gain**2))
