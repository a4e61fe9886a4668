"""Cumulative sums that alarm as soon as a mean has moved, with the exact mean time between false alarms.

Crosier's multivariate form (R. B. Crosier, "Multivariate generalizations of cumulative sum quality-control schemes",
Technometrics 30(3), 1988, section 3): with y standard normal in d dimensions under the null,

    s <- s + y;  c = |s|;  s <- s max(0, 1 - k / c);  alarm if |s| > h.

Under the null |s| alone is a Markov chain: |s + y| given |s| = r is a non-central chi of d degrees, noncentrality r. So
its law obeys integral equations, solved here on Gauss-Legendre nodes. No simulation is needed.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special

from skyproof.arrays import Reals

__all__ = [
    "ORIGIN",
    "CusumPath",
    "cusum_path",
    "cusum_step",
    "cusum_within",
    "quadrature_nodes",
    "transition_matrix",
]

ORIGIN = 1e-9  # at s = 0 the density has a limit, reached well before
_LARGEST = 60.0  # no sum is larger under the null but with a probability that makes no difference
_STEP = 8.0  # no single one is longer under the null but with a probability of 1e-15
_LONG_RUN = 4096  # steps


def cusum_step(state: Reals, y: Reals, reference: float) -> Reals:
    """Run one step of the sum: state and y (..., d).

    `reference` k is about half the shift |E y| that is to be found.
    """
    total = state + y
    size = np.linalg.norm(total, axis=-1, keepdims=True)
    return np.asarray(total * np.maximum(0.0, 1.0 - reference / np.maximum(size, 1e-300)), float)


class CusumPath(NamedTuple):
    """size : |s| after each step, (..., n). state : s at the end, (..., d), to continue with. Nothing is reset."""

    size: Reals
    state: Reals


def cusum_path(y: Reals, reference: float, state: Reals | None = None) -> CusumPath:
    """Run the sum over y (..., n, d) from `state` (..., d), zero by default; pieces give what the whole gives."""
    s = np.zeros((*y.shape[:-2], y.shape[-1])) if state is None else state
    size = np.empty(y.shape[:-1])
    for n in range(y.shape[-2]):
        s = cusum_step(s, y[..., n, :], reference)
        size[..., n] = np.linalg.norm(s, axis=-1)
    return CusumPath(size, s)


def quadrature_nodes(threshold: float) -> tuple[Reals, Reals]:
    """Compute Gauss-Legendre nodes and weights on (0, threshold).

    There are at least two for each unit: the kernel is one unit wide.
    """
    x, w = _legendre(24 + 2 * int(np.ceil(threshold)))
    return 0.5 * threshold * (x + 1.0), 0.5 * threshold * w


_legendre = lru_cache(np.polynomial.legendre.leggauss)


def _chi_density(x: Reals, degrees: int, r: Reals) -> Reals:
    """Compute the density at x > 0 of the length of a standard normal vector around a point.

    The point is at distance r > 0 from the origin.
    """
    half = 0.5 * degrees
    return np.asarray(x * (x / r) ** (half - 1.0) * np.exp(-0.5 * (x - r) ** 2) * special.ive(half - 1.0, r * x), float)


def cusum_within(size: float, steps: int, reference: float, degrees: int) -> float:
    """Return the chance under the null that a sum which has run for long reaches `size` > 0 in so many steps.

    It is the law of a window's largest |s|, where the window continues the sum of the one before. Growth that began
    there counts here as well, so that this is more than `steps` over the run length. All terms are
    positive, and small probabilities keep their digits. A size beyond 60 counts as 60.
    """
    size = min(size, _LARGEST)
    start, law = _stationary(reference, degrees)
    near = start < size + _STEP  # from further off no step leads below
    start, law, further = start[near], law[near], float(law[~near].sum())
    below, weights = quadrature_nodes(size)
    above, weights_above = quadrature_nodes(2.0 * _STEP)
    above = above + size
    start_below = np.concatenate(([ORIGIN], below))
    stays = transition_matrix(start_below, below, weights, reference, degrees)
    leaves = _chi_density(above + reference, degrees, start_below[:, None]) @ weights_above
    reached = np.zeros(len(start_below))
    for _ in range(steps - 1):
        reached = leaves + stays @ reached
    first = np.concatenate((law[:1], weights * (law @ _chi_density(below + reference, degrees, start[:, None]))))
    beyond = law @ _chi_density(above + reference, degrees, start[:, None]) @ weights_above
    return min(float(further + beyond + first @ reached), 1.0)


def transition_matrix(start: Reals, nodes: Reals, weights: Reals, reference: float, degrees: int) -> Reals:
    """Compute the probabilities of one step from each start to zero and to each node: (n_start, 1 + n_nodes)."""
    back = special.chndtr(reference**2, degrees, start**2)
    return np.column_stack((back, weights * _chi_density(nodes + reference, degrees, start[:, None])))


@lru_cache(maxsize=64)
def _stationary(reference: float, degrees: int) -> tuple[Reals, Reals]:
    """Return sizes, zero and nodes up to the largest, and the probability of each in the long run."""
    nodes, weights = quadrature_nodes(_LARGEST)
    start = np.concatenate(([ORIGIN], nodes))
    # Powers of a positive matrix keep the digits of small probabilities; solving for its eigenvector does not.
    law = np.linalg.matrix_power(transition_matrix(start, nodes, weights, reference, degrees), _LONG_RUN)[0]
    return start, law / law.sum()
