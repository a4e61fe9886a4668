"""Tests in parity space that add up over time, and what they cannot see."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Complexes, Integers, Reals
from skyproof.detectors.correlators import correlator_laws as law
from skyproof.detectors.correlators.vector_parity import Branch, Whitener, build_whitener, parity_vector
from skyproof.statistics.cusum import CusumPath, cusum_path
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold
from skyproof.studies import discriminator_laws as laws
from skyproof.studies.run_lengths import cusum_threshold

__all__ = [
    "BANK",
    "Suspects",
    "cusum_bank",
    "indistinguishable_attack",
    "parity_noncentrality",
    "parity_threshold",
    "run_branch",
    "suspects",
    "whitener",
]


BANK: Final = ((1, 1.0), (10, 1.0), (10, 0.25))
"""Integrations summed for one step, and reference k, of each branch: fast for large attacks, slow for small ones."""


def whitener(parity: Reals, amplitude: ArrayLike) -> Whitener:
    """From a parity basis B (n - 4, n) and prompt amplitudes A_K, one number or (n,)."""
    a = np.broadcast_to(np.asarray(amplitude, float), parity.shape[-1:])
    return build_whitener(parity, laws.code_sigma_chips(a), laws.phase_sigma_rad(a), a)


def parity_noncentrality(
    white: Whitener, code_chips: ArrayLike, doppler_hz: ArrayLike, *, coherent_s: float = 1e-3
) -> Reals:
    """Noncentrality of the test under an attack (..., n), for discriminators of slope 1: for satellite j alone
    S_jj ((C^s / s_C)^2 + (pi T f^s / s_phi)^2)."""
    code = np.asarray(code_chips, float) @ white.code.T
    phase = np.pi * coherent_s * np.asarray(doppler_hz, float) @ white.phase.T
    return np.asarray(np.sum(code**2, axis=-1) + np.sum(phase**2, axis=-1), float)


def cusum_bank(
    satellites: int, mean_s: float, *, branches: Sequence[tuple[int, float]] = BANK, coherent_s: float = 1e-3
) -> tuple[Branch, ...]:
    """Branches that together alarm falsely once in `mean_s` or less often: each has its share of the rate.

    Thresholds are exact for y standard normal and white.
    """
    return tuple(
        Branch(sums, k, cusum_threshold(mean_s * len(branches) / (sums * coherent_s), k, 2 * (satellites - 4)))
        for sums, k in branches
    )


def run_branch(
    taps: Complexes, branch: Branch, white: Whitener, state: Reals | None = None, *, scores: bool = True
) -> CusumPath:
    """Run one branch over early, prompt, late (..., integrations, n, 3), whole steps only.

    `white` is for the amplitude of `branch.sums` integrations. The state goes into the next call.
    """
    steps = taps.shape[-3] // branch.sums
    blocks = taps[..., : steps * branch.sums, :, :].reshape(*taps.shape[:-3], steps, branch.sums, *taps.shape[-2:])
    summed = laws.combine_taps(blocks, axis=-3)
    u = laws.code_discriminator(summed[..., 0], summed[..., 2])
    y = parity_vector(u, law.phase_discriminator(summed[..., 1]), white, scores=scores)
    return cusum_path(y, branch.reference, state)


class Suspects(NamedTuple):
    """If one satellite alone is attacked, which.

    statistic : (..., n), Z_j, how much of |y|^2 an attack on satellite j explains. suspect : (...), the largest.
    left, p_value : (...) what it leaves, chi-square with `dof` = 2 (n - 5) degrees if that is all; a small p-value
        means that more than one is attacked. With n = 5 every satellite explains everything.
    """

    statistic: Reals
    suspect: Integers
    left: Reals
    p_value: Reals
    dof: int


def suspects(y: Reals, white: Whitener) -> Suspects:
    """Single-satellite hypotheses, code and phase each of any size.

    The directions are those of plain discriminators: of large attacks take y without scores.
    """
    half = white.code.shape[0]
    z = np.square(y[..., :half] @ white.code) / np.sum(white.code**2, axis=0)
    z = z + np.square(y[..., half:] @ white.phase) / np.sum(white.phase**2, axis=0)
    suspect = np.argmax(z, axis=-1)
    remaining = np.maximum(np.sum(y**2, axis=-1) - np.max(z, axis=-1), 0.0)
    dof = 2 * (half - 1)
    p_value = chi_square_survival(remaining, dof) if dof else np.ones(remaining.shape)
    return Suspects(z, suspect, np.asarray(remaining, float), p_value, dof)


def indistinguishable_attack(design: Reals, attack: ArrayLike, authentic: int) -> Reals:
    """Another attack (n,) with the same parity vector that leaves the satellite `authentic` alone and is smallest.

    attack : (n,) in any unit. The set of all such attacks is attack + G x; here x is bound by one equation and the sum
    of squares is least.
    """
    attack = np.asarray(attack, float)
    row = design[authentic]
    # least |attack + G x|^2 under row x = -attack[authentic]
    inverse = np.linalg.inv(design.T @ design)
    free = -inverse @ design.T @ attack
    lift = inverse @ row / (row @ inverse @ row)
    return np.asarray(attack + design @ (free - lift * (row @ free + attack[authentic])), float)


def parity_threshold(false_alarm_probability: ArrayLike, satellites: int) -> Reals:
    """Threshold of |y|^2."""
    return chi_square_threshold(false_alarm_probability, 2 * (satellites - 4))
