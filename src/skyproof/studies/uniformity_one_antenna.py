"""What one antenna shows, drawn under the null: bursts of grids of one signal."""

import numpy as np

from skyproof.arrays import Reals
from skyproof.decomposition.correlation import noise_variance
from skyproof.detectors.dccaf.bursts import components, joint_p_value, own_correlation, shapes

__all__ = ["burst_of_one_signal"]


def burst_of_one_signal(rng: np.random.Generator, n: int) -> Reals:
    """Four intervals of 20 ms of one signal in a band of 3 MHz, the noise's variance known of 64 values."""
    prn, band_hz, intervals, known = 7, 3e6, 4, 64
    taps = np.arange(-5.0, 6.0) * 0.3
    own = shapes(prn, tuple(taps.tolist()), band_hz, 1.3)
    variance = float(noise_variance(42.0, 0.02, band_hz))
    signal = own_correlation(prn, taps - rng.uniform(-0.2, 0.2, (n, 1)), band_hz)
    turn = np.exp(2j * np.pi * rng.random((n, intervals, 1)))
    root = np.linalg.cholesky(own_correlation(prn, taps[:, None] - taps, band_hz) + 1e-9 * np.eye(taps.size))
    noise = (rng.standard_normal((n, intervals, taps.size, 2)) @ [1.0, 1j]) @ root.T
    stated = variance * rng.chisquare(2.0 * known, (n, 1)) / (2.0 * known) * np.ones(intervals)
    found = components(turn * signal[:, None] + np.sqrt(0.5 * variance) * noise, own, stated, band_hz)
    return joint_p_value(found.second, intervals, own.path, known)
