"""What one antenna shows, drawn under the null: bursts of grids of one signal, and what all satellites do alike."""

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.common_change.laws import alike_p_value, turn_p_value, turn_sigma_m
from skyproof.detectors.dccaf.bursts import autocorrelate_code, build_shapes, fit_components, joint_p_value
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import Oscillator
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.studies.decomposition_laws import noise_variance

__all__ = ["burst_of_one_signal", "rates_alike", "turns"]


def burst_of_one_signal(rng: np.random.Generator, n: int) -> Reals:
    """Four intervals of 20 ms of one signal in a band of 3 MHz, the noise's variance known of 64 values."""
    prn, band_hz, intervals, known = 7, 3e6, 4, 64
    taps = np.arange(-5.0, 6.0) * 0.3
    bursts = build_shapes(GPS_L1_CA, prn, tuple(taps.tolist()), band_hz, 1.3)
    variance = float(noise_variance(42.0, 0.02, band_hz))
    signal = autocorrelate_code(GPS_L1_CA, prn, taps - rng.uniform(-0.2, 0.2, (n, 1)), band_hz)
    turn = np.exp(2j * np.pi * rng.random((n, intervals, 1)))
    root = np.linalg.cholesky(
        autocorrelate_code(GPS_L1_CA, prn, taps[:, None] - taps, band_hz) + 1e-9 * np.eye(taps.size)
    )
    noise = (rng.standard_normal((n, intervals, taps.size, 2)) @ [1.0, 1j]) @ root.T
    stated = variance * rng.chisquare(2.0 * known, (n, 1)) / (2.0 * known) * np.ones(intervals)
    found = fit_components(turn * signal[:, None] + np.sqrt(0.5 * variance) * noise, bursts, stated)
    return joint_p_value(found.second, intervals, bursts.path, known)


def rates_alike(rng: np.random.Generator, n: int) -> Reals:
    """Code against carrier of eight satellites."""
    sigma = np.linspace(0.2, 0.6, 8)
    return alike_p_value(sigma * rng.standard_normal((n, 8)), sigma)


def turns(rng: np.random.Generator, n: int) -> Reals:
    """A clock of white frequency noise over twice ten seconds, by carriers to 2 cm."""
    clock, apart_s, sigma_m = Oscillator(white_s=2e-22), 10.0, 0.02
    steps_m = SPEED_OF_LIGHT_M_S * np.sqrt(0.5 * clock.white_s * apart_s) * rng.standard_normal((2, n))
    turn_m = steps_m[1] - steps_m[0] + sigma_m * rng.standard_normal(n)
    return turn_p_value(turn_m, sigma_m**2, turn_sigma_m(clock, apart_s))
