"""Gain and noise of an early-minus-late discriminator at a sample rate and a spacing.

The replica is the code behind a low-pass (`replica.low_pass_gain`). With rectangular chips the spectra of signal and
replica, and so gain and noise, follow from the chips a sample alone.
"""

from dataclasses import dataclass

import numpy as np

from skyproof.receiver.replica import low_pass_gain

__all__ = ["Discriminator", "compute_discriminator"]

_LINES = 4000


@dataclass(frozen=True, kw_only=True)
class Discriminator:
    """Of (E - L)/P, in phase, with early and late `early_late_chips` apart.

    gain : change of (E - L)/P for one chip of error; 2 for sharp chips (Kaplan & Hegarty, 8.7).
    noise_chips2 : variance of the error found is this over C/N0 and the time of integration. d/4 for sharp chips: their
        eq. 8.81 with B = 1/(2 T) and without squaring loss. C/N0 is that of the prompt correlator.
    """

    gain: float
    noise_chips2: float


def compute_discriminator(chips_per_sample: float, early_late_chips: float) -> Discriminator:
    """Compute gain and noise for sharp chips and the replica's low-pass, from their spectra, in white noise."""
    f = (np.arange(_LINES) + 0.5) / _LINES * 0.5 / chips_per_sample  # cycles a chip, to half the rate
    low_pass, chip = low_pass_gain(f * chips_per_sample), np.sinc(f) ** 2
    signal, noise = chip * low_pass, chip * low_pass**2
    apart = np.pi * f * early_late_chips
    gain = np.sum(signal * 4.0 * np.pi * f * np.sin(apart)) / np.sum(signal)
    noise_chips2 = 2.0 * np.sum(noise * np.sin(apart) ** 2) / np.sum(noise) / gain**2
    return Discriminator(gain=float(gain), noise_chips2=float(noise_chips2))
