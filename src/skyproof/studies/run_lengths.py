"""Mean numbers of steps between false alarms of cumulative sums, and the thresholds for them.

Under the null the size of Crosier's sum (`statistics.cusum`) is a Markov chain, so that the mean number of steps L(r)
to an alarm from a size r obeys an integral equation, solved here on Gauss-Legendre nodes instead of the cells of
D. Brook and D. A. Evans ("An approach to the probability distribution of CUSUM run length", Biometrika 59(3), 1972):
50 nodes give 8 digits where 300 cells give 3. Page's one-sided form in one dimension, s <- max(0, s + y - k),
alarm if s > h, goes the same way. `protect` needs no thresholds: it has the law of a window's largest sum.
"""

from collections.abc import Callable

import numpy as np
from scipy import special
from scipy.optimize import brentq

from skyproof.arrays import Reals
from skyproof.statistics.cusum import ORIGIN, quadrature_nodes, transition_matrix

__all__ = ["cusum_run_length", "cusum_threshold", "page_run_length", "page_threshold"]

_LONGEST_THRESHOLD = 50.0  # beyond, run lengths exceed what float64 resolves


def cusum_run_length(reference: float, threshold: float, degrees: int) -> float:
    """Mean number of steps from s = 0 to an alarm under the null; infinite where float64 cannot express it any more."""
    nodes, weights = quadrature_nodes(threshold)
    start = np.concatenate(([ORIGIN], nodes))
    return _solve(transition_matrix(start, nodes, weights, reference, degrees))


def page_run_length(reference: float, threshold: float) -> float:
    """Mean number of steps from s = 0 to an alarm of Page's one-sided sum of standard normal numbers."""
    nodes, weights = quadrature_nodes(threshold)
    start = np.concatenate(([0.0], nodes))
    apart = nodes + reference - start[:, None]
    kernel = weights * np.exp(-0.5 * apart**2) / np.sqrt(2.0 * np.pi)
    return _solve(np.column_stack((special.ndtr(reference - start), kernel)))


def _solve(transition: Reals) -> float:
    """L at the first state from (I - Q) L = 1."""
    try:
        length = np.linalg.solve(np.eye(len(transition)) - transition, np.ones(len(transition)))
    except np.linalg.LinAlgError:
        return np.inf
    return float(length[0]) if 0.0 < length[0] < 1e13 else np.inf


def cusum_threshold(mean_steps: float, reference: float, degrees: int) -> float:
    """The threshold h with `mean_steps` between false alarms.

    Raises
    ------
    ValueError : no threshold up to 50 gives so many; a larger reference needs a smaller threshold.
    """
    return _threshold(lambda h: cusum_run_length(reference, h, degrees), mean_steps)


def page_threshold(mean_steps: float, reference: float) -> float:
    """The threshold of Page's one-sided sum with `mean_steps` between false alarms; raises as `cusum_threshold`."""
    return _threshold(lambda h: page_run_length(reference, h), mean_steps)


def _threshold(run_length: Callable[[float], float], mean_steps: float) -> float:
    def excess(h: float) -> float:
        return float(np.log(min(run_length(h), 1e15) / mean_steps))

    low, high = 1e-3, 2.0
    while excess(high) < 0.0:
        low, high = high, 1.5 * high
        if high > _LONGEST_THRESHOLD * 1.5:
            raise ValueError(
                f"no threshold up to {_LONGEST_THRESHOLD:g} gives {mean_steps:g} steps between false alarms; "
                "take a larger reference"
            )
    return float(brentq(excess, low, high, xtol=1e-6))
