"""How probable it is that signals with no common origin look like one sky."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from skyproof.arrays import Reals

__all__ = ["bound_chance_p_value", "count_set_combinations"]

_UNKNOWNS = 4


def bound_chance_p_value(
    sigma_m: ArrayLike, *, window_m: ArrayLike, largest_statistic: ArrayLike, combinations: ArrayLike = 1.0
) -> Reals:
    """Bound the probability that some set of K unrelated signals fits one position and clock.

    Unrelated means: pseudoranges independent and uniform in a window of `window_m`. Any four of the K signals have a
    solution H_B^-1 z_B. It predicts the K - 4 others with covariance C = S_R + G S_B G^T, where G = H_R H_B^-1 and S is
    diag(sigma^2). The statistic of the least-squares fit is the squared Mahalanobis distance of the others from the
    prediction. It is below t if they lie in an ellipsoid of volume V(K-4) sqrt(t^(K-4) det C). The probability of that
    is at most this volume over that of the window; V(d) is the volume of the unit ball. By the determinant lemma and
    Cauchy-Binet

        det C = det S det(H^T S^-1 H) / det(H_B)^2
              = sum over fours A of (det(H_A)/det(H_B))^2 prod_(k not in A) sigma_k^2

    With B the four of largest |det| each ratio is at most one, hence for every geometry

        p <= V(K-4) sqrt(t^(K-4) e_(K-4)(sigma_1^2, ..., sigma_K^2)) / window^(K-4)

    with e the elementary symmetric polynomial; for equal sigmas sqrt(e) = sqrt(binomial(K, 4)) sigma^(K-4). The union
    bound over all sets that could be formed multiplies by their number. Linear in the position over the window:
    right for windows that are small beside the distance of the satellites.

    Parameters
    ----------
    sigma_m : (..., K) of the set's signals.
    window_m : (...) range of possible delays: 293 km (1 ms) if only the code phase is known, else the spread searched.
    largest_statistic : (...) the threshold below which a set counts as consistent (or a set's own statistic).
    combinations : (...) number of sets that were tried, see `count_set_combinations`.

    Returns
    -------
    (...) at most 1; 1 for K of 4 and below, where every set fits.
    """
    sigma = np.asarray(sigma_m, np.float64)
    window, limit, count = (np.asarray(value, np.float64) for value in (window_m, largest_statistic, combinations))
    d = sigma.shape[-1] - _UNKNOWNS
    if d < 1:
        return np.ones(np.broadcast_shapes(sigma.shape[:-1], window.shape, limit.shape, count.shape))
    log_ball = 0.5 * d * np.log(np.pi) - special.gammaln(0.5 * d + 1.0)
    relative = np.moveaxis((sigma / window[..., None]) ** 2, -1, 0)
    with np.errstate(divide="ignore"):
        log_p = log_ball + 0.5 * d * np.log(limit) + 0.5 * np.log(_compute_symmetric_sum(relative, d)) + np.log(count)
    return np.asarray(np.exp(np.minimum(log_p, 0.0)))


def count_set_combinations(copies: ArrayLike, satellites: ArrayLike) -> Reals:
    """Count the sets of `satellites` signals, one per satellite, when satellite k has `copies[k]` signals.

    Shapes: copies (n,), satellites (...) -> (...).
    """
    counts = np.asarray(copies, np.float64)
    sizes = np.asarray(satellites)
    by_size = _compute_symmetric_sums(counts, counts.size)
    return np.asarray(np.where(sizes <= counts.size, by_size[np.minimum(sizes, counts.size)], 0.0))


def _compute_symmetric_sum(values: Reals, degree: int) -> Reals:
    """Sum over all choices of `degree` of the values along axis 0 of their product."""
    return np.asarray(_compute_symmetric_sums(values, degree)[degree])


def _compute_symmetric_sums(values: Reals, most: int) -> Reals:
    """Sum the products for all degrees from 0 to `most`, along axis 0."""
    sums = np.zeros((most + 1, *values.shape[1:]))
    sums[0] = 1.0
    for value in values:
        sums[1:] = sums[1:] + value * sums[:-1]
    return sums
