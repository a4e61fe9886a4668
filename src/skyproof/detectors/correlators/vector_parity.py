"""Reduce an attack on a vector receiver to as few numbers as possible: the parity space of the discriminators.

In the equilibrium the mean of the discriminators, of code and of phase, is orthogonal to the columns of the geometry
(20), (21) (paper: see `vector_sqm`). So the whole attack lies in n - 4 dimensions each, B u and B q; noise in the other
four, and the choice of one satellite, only do harm. Moreover, in the linear loop B u is white whatever the loops'
bandwidths. It is the same with a navigation filter in place of a snapshot solution.

y : (..., 2 (n - 4)), code first, standard normal under the null. `Whitener` computes it from discriminators, which
first become normal scores: exactly normal at any amplitude, where the plain discriminators of 1 ms have heavy tails.
Left over is the dependence of code and phase of one satellite. At an amplitude of 4.5 (1 ms at 40 dB-Hz) tests at 1e-2,
1e-3 and 1e-4 alarm 1.04, 1.1 and 1.3 times as often as stated (counted in a million; plain discriminators 1.2, 1.5 and
2.2 times), from 10 on as stated.

Only B C^s is visible: attacks C^s and C^s + G x look the same for every x. Which satellites are false is a question of
prior belief where several sets explain y; `find_explanations` gives all the smallest ones.
"""

from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.detectors.correlators import correlator_laws as law
from skyproof.statistics.distributions import chi_square_survival

__all__ = [
    "Branch",
    "Explanation",
    "ParityTest",
    "Whitener",
    "build_whitener",
    "find_explanations",
    "parity_test",
    "parity_vector",
    "select_likely_sets",
    "separability",
]


class Whitener(NamedTuple):
    """Numbers that turn discriminators of n satellites into y.

    amplitude : (n,) A_K. sigma_chips, sigma_rad : (n,) of the discriminators. code, phase : (n - 4, n), whitened B: the
        column j is the direction of an attack on satellite j.
    """

    amplitude: Reals
    sigma_chips: Reals
    sigma_rad: Reals
    code: Reals
    phase: Reals


def build_whitener(parity: Reals, sigma_chips: Reals, sigma_rad: Reals, amplitude: ArrayLike = np.nan) -> Whitener:
    """Build a whitener from the discriminators' sigmas (n,); without amplitudes there are no scores."""
    code, phase = (
        np.linalg.solve(np.linalg.cholesky((parity * sigma**2) @ parity.T), parity)
        for sigma in (sigma_chips, sigma_rad)
    )
    a = np.broadcast_to(np.asarray(amplitude, float), parity.shape[-1:])
    return Whitener(a, sigma_chips, sigma_rad, code, phase)


def parity_vector(code_chips: ArrayLike, phase_rad: ArrayLike, white: Whitener, *, scores: bool = True) -> Reals:
    """Compute y (..., 2 (n - 4)) from discriminators (..., n); it is standard normal without an attack.

    scores : make them exactly normal first. Without it, the tails of sums with A^2 < 400 are heavier than normal. Of
        parity tests at 1e-5, 2.6 times as many alarm at A^2 = 100, 1.5 times at 200.
    """
    u, q = np.asarray(code_chips, float), np.asarray(phase_rad, float)
    if scores:
        u = white.sigma_chips * _score_by_satellite(law.code_score, u, white.amplitude)
        q = white.sigma_rad * _score_by_satellite(law.phase_score, q, white.amplitude)
    return np.concatenate((u @ white.code.T, q @ white.phase.T), axis=-1)


def _score_by_satellite(score: Callable[[Reals, float], Reals], values: Reals, amplitude: Reals) -> Reals:
    if np.all(amplitude == amplitude[0]):
        return np.asarray(score(values, float(amplitude[0])))
    return np.stack([score(values[..., j], float(a)) for j, a in enumerate(amplitude)], axis=-1)


# The test -------------------------------------------------------------------------------------------------------------


class ParityTest(NamedTuple):
    """statistic, p_value : (...). dof : 2 (n - 4)."""

    statistic: Reals
    p_value: Reals
    dof: int


def parity_test(y: Reals) -> ParityTest:
    """Test |y|^2: chi-square with as many degrees as y has numbers."""
    statistic = np.sum(y**2, axis=-1)
    return ParityTest(np.asarray(statistic, float), chi_square_survival(statistic, y.shape[-1]), y.shape[-1])


# Cumulative sums ------------------------------------------------------------------------------------------------------


class Branch(NamedTuple):
    """A cumulative sum over steps of `sums` integrations: alarm when |s| exceeds `threshold`."""

    sums: int
    reference: float
    threshold: float


# Which satellites -----------------------------------------------------------------------------------------------------


class Explanation(NamedTuple):
    """Satellites (their places) that, if they alone are attacked, leave a residual that passes; with its p-value."""

    satellites: tuple[int, ...]
    statistic: float
    p_value: float


def find_explanations(y: Reals, white: Whitener, probability: float) -> tuple[Explanation, ...]:
    """Find all sets of the smallest size that explain one y (2 (n - 4),), best first: they are indistinguishable.

    One empty set means no sign of an attack. `probability` : that a true set is missed, if the discriminators are
    linear. This needs long sums (A^2 above 2000), y without scores, and offsets up to 0.2 chip and 0.3 rad.
    """
    half, n = white.code.shape
    for size in range(half + 1):
        dof = 2 * (half - size)
        found = []
        for satellites in combinations(range(n), size):
            columns = list(satellites)
            remaining = _residual_square(y[:half], white.code[:, columns]) + _residual_square(
                y[half:], white.phase[:, columns]
            )
            p_value = float(chi_square_survival(remaining, dof)) if dof else 1.0
            if p_value >= probability:
                found.append(Explanation(satellites, remaining, p_value))
        if found:
            return tuple(sorted(found, key=lambda each: each.statistic))
    return ()


def select_likely_sets(y: Reals, white: Whitener, wrong_probability: float) -> tuple[Explanation, ...]:
    """Select the sets of `find_explanations` that cannot be ruled out, the likeliest first; a single set is named.

    Of the sets of one size that fit, the fewest are kept that contain the true one with 1 - `wrong_probability`. Half
    of that probability is that the true set does not fit, half that it is not kept. A set's offsets of code and of
    phase are equally likely over all sizes. So its weight is exp(-rest / 2) / sqrt(det C'C det F'F), C and F its
    directions. The result is empty if t false satellites cannot be distinguished, n < 4 + 2 t: others would fit as
    well, larger sets among them.
    """
    half = white.code.shape[0]
    found = find_explanations(y, white, 0.5 * wrong_probability)
    if not found or 2 * len(found[0].satellites) > half:
        return ()
    log_weight = np.empty(len(found))
    for i, each in enumerate(found):
        columns = list(each.satellites)
        volumes = (np.linalg.slogdet(w[:, columns].T @ w[:, columns]).logabsdet for w in (white.code, white.phase))
        log_weight[i] = -0.5 * (each.statistic + sum(volumes))
    order = np.argsort(-log_weight)
    weight = np.exp(log_weight[order] - log_weight[order[0]])
    share = np.cumsum(weight) / np.sum(weight)
    kept = int(np.searchsorted(share, 1.0 - 0.5 * wrong_probability)) + 1
    return tuple(found[i] for i in order[:kept])


def _residual_square(y: Reals, columns: Reals) -> float:
    """Compute the squared length of y outside the span of the columns."""
    fitted = columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(np.sum((y - fitted) ** 2))


def separability(parity: Reals, size: int) -> float:
    """Compute the smallest singular value of any 2 `size` columns of B (n - 4, n).

    Sets of up to `size` attacked satellites can be distinguished for all amplitudes if and only if it is above zero.
    This needs n >= 4 + 2 size: one from 6 satellites, two from 8. It is zero with fewer.
    """
    rows, n = parity.shape
    if 2 * size > rows:
        return 0.0
    chosen = np.array(list(combinations(range(n), 2 * size)))
    return float(np.linalg.svd(np.moveaxis(parity[:, chosen], 1, 0), compute_uv=False).min())
