"""Correlators of a vector receiver by their model, for studies: draws of settled channels, and the loops themselves.

Early, prompt and late are A R(offset) exp(j phase) + n with noise of variance 1 in I and in Q, correlated as R of the
taps' distance. Equations in brackets: X. Zhang, H. Li, C. Yang and M. Lu, IET Radar, Sonar & Navigation, 2020.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Complexes, Reals
from skyproof.detectors.correlators import correlator_laws as law
from skyproof.detectors.correlators.vector_sqm import SatelliteGeometry
from skyproof.studies import discriminator_laws as laws

__all__ = ["Loops", "draw_discriminators", "draw_taps", "mean_taps", "tap_noise", "vector_loops"]

_AT_ONCE = 20_000  # trials, so that memory does not grow with their number


def mean_taps(amplitude: ArrayLike, code_chips: ArrayLike, phase_rad: ArrayLike) -> Complexes:
    """Early, prompt, late (..., 3) without noise."""
    code = np.asarray(code_chips, float)[..., None] + np.array([-0.5, 0.0, 0.5])
    turn = np.exp(1j * np.asarray(phase_rad, float))
    return np.asarray((np.asarray(amplitude, float) * turn)[..., None] * law.triangle(code))


def tap_noise(rng: np.random.Generator, shape: tuple[int, ...]) -> Complexes:
    """Noise (*shape, 3) of variance 1 in I and in Q; prompt 0.5 correlated with early and with late."""
    z = rng.standard_normal((3, *shape, 2)).view(np.complex128)[..., 0]
    noise = np.empty((*shape, 3), np.complex128)
    noise[..., 0] = z[0]
    noise[..., 1] = 0.5 * z[0] + np.sqrt(0.75) * z[1]
    noise[..., 2] = z[1] / np.sqrt(3.0) + np.sqrt(2.0 / 3.0) * z[2]
    return noise


def draw_taps(
    rng: np.random.Generator, shape: tuple[int, ...], amplitude: ArrayLike, code_chips: ArrayLike, phase_rad: ArrayLike
) -> Complexes:
    """Taps (*shape, 3); amplitude and offsets broadcast against `shape`."""
    return np.asarray(tap_noise(rng, shape) + mean_taps(amplitude, code_chips, phase_rad))


def draw_discriminators(
    rng: np.random.Generator, trials: int, amplitude: ArrayLike, code_chips: Reals, phase_rad: Reals
) -> tuple[Reals, Reals]:
    """Code and phase discriminators (trials, n) of channels with offsets (n,); amplitude A_K of the summed taps."""
    n = code_chips.size
    u, q = np.empty((trials, n)), np.empty((trials, n))
    for start in range(0, trials, _AT_ONCE):
        some = slice(start, min(start + _AT_ONCE, trials))
        taps = draw_taps(rng, (some.stop - start, n), amplitude, code_chips, phase_rad)
        u[some] = laws.code_discriminator(taps[..., 0], taps[..., 2])
        q[some] = law.phase_discriminator(taps[..., 1])
    return u, q


class Loops(NamedTuple):
    """Mean offsets of code and phase (n,) over the second half, with the standard error of each mean."""

    code_chips: Reals
    phase_rad: Reals
    code_error_chips: Reals
    phase_error_rad: Reals


def vector_loops(
    rng: np.random.Generator,
    where: SatelliteGeometry,
    code_chips: Reals,
    doppler_hz: Reals,
    cn0_dbhz: float,
    *,
    trials: int,
    seconds: float = 3.0,
    code_bandwidth_hz: float = 1.0,
    phase_bandwidth_hz: float = 10.0,
    coherent_s: float = 1e-3,
) -> Loops:
    """The loops closed, (4) to (7), from perfect lock on: noise, nonlinear discriminators, a solution each millisecond.

    Code, first order: the local code moves by g = 4 B T times P (C^l + dC^) - C^l. Carrier, second order: its input is
    dphi^ + pi T f^c, with f^c = P f^l - f^l the correction that the solution gives.
    """
    n = code_chips.size
    ahead = np.eye(n) - where.projector
    amplitude = laws.prompt_amplitude(cn0_dbhz, coherent_s=coherent_s)
    gain = 4.0 * code_bandwidth_hz * coherent_s
    natural = phase_bandwidth_hz / 0.53
    # Started near where it settles, since the parity part of the code moves with the slow time constant 1 / (4 B).
    local = np.broadcast_to(code_chips @ ahead, (trials, n)).copy()
    steady = np.broadcast_to(doppler_hz, (trials, n)).copy()
    phase = np.zeros((trials, n))
    sums, counted = np.zeros((2, trials, n)), 0
    steps = round(seconds / coherent_s)
    for step in range(steps):
        code = code_chips - local
        taps = draw_taps(rng, (trials, n), amplitude, code, phase)
        u = laws.code_discriminator(taps[..., 0], taps[..., 2])
        local = local + gain * ((local + u) @ ahead - local)
        error = law.phase_discriminator(taps[..., 1]) - np.pi * coherent_s * (steady @ where.projector)
        steady = steady + natural**2 * coherent_s / (2.0 * np.pi) * error
        nco = steady + np.sqrt(2.0) * natural / (2.0 * np.pi) * error
        if step >= steps // 2:
            sums += np.stack((code, phase))
            counted += 1
        phase = phase + 2.0 * np.pi * coherent_s * (doppler_hz - nco)
    means = sums / counted
    spread = means.std(axis=1, ddof=1) / np.sqrt(trials)
    return Loops(*means.mean(axis=1), *spread)
