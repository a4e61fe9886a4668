"""Generalised likelihood-ratio tests of linear models, and their power.

Model: y = A a + B b + e, e normal with covariance s^2 C, C known. H0: a = 0; b is free under both hypotheses. With s
known the test is chi-square, with s unknown F (H. Scheffe, "The Analysis of Variance", 1959, sections 2.5 and 2.8; the
likelihood ratio is a monotone function of either).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.statistics.distributions import (
    f_survival,
    f_threshold,
    noncentral_chi_square_survival,
    noncentral_f_survival,
)

__all__ = ["LinearModel", "LinearTest", "linear_model", "linear_noncentrality", "linear_power", "linear_test"]


class LinearTest(NamedTuple):
    """statistic and p_value (...): mean square of what is tested over the variance, F with dof_num and dof_den.

    With a known variance dof_den is infinite: dof_num times the statistic, twice the log likelihood ratio, is
    chi-square.
    """

    statistic: Reals
    p_value: Reals
    dof_num: int
    dof_den: float


class LinearModel(NamedTuple):
    """What `linear_model` makes of A, B and C once, for any number of tests.

    whitener : (N, N), None for C = 1. tested, fitted : orthonormal columns (N, r) of A less B, and of A and B together.
    """

    whitener: Reals | None
    tested: Reals
    fitted: Reals

    def white(self, values: Reals) -> Reals:
        """Whiten values (..., N) with errors of covariance s^2."""
        return values if self.whitener is None else values @ self.whitener.T


def linear_model(
    tested: ArrayLike, nuisance: ArrayLike | None = None, covariance: ArrayLike | None = None
) -> LinearModel:
    """Build the model of the columns A (N, r) that are tested, B (N, q) that are free, and C (N, N).

    Raises
    ------
    ValueError : columns of A and B depend on each other, so that H0 does not determine them.
    """
    a = np.asarray(tested, float)
    b = np.zeros((a.shape[0], 0)) if nuisance is None else np.asarray(nuisance, float)
    whitener = None
    if covariance is not None:
        whitener = np.asarray(np.linalg.inv(np.linalg.cholesky(np.asarray(covariance, float))), float)
        a, b = whitener @ a, whitener @ b
    q, r = np.linalg.qr(np.concatenate([b, a], axis=1))
    size = np.abs(np.diag(r))
    if np.any(size < 1e-10 * np.linalg.norm(np.concatenate([b, a], axis=1), axis=0)):
        raise ValueError("columns that are tested or free depend on each other")
    return LinearModel(whitener, q[:, b.shape[1] :], q)


def linear_test(values: Reals, model: LinearModel, sigma: float | None = None) -> LinearTest:
    """Test of a = 0 on values (..., N); `sigma` is s if it is known."""
    y = model.white(values)
    dof_num, n_fitted = model.tested.shape[1], model.fitted.shape[1]
    inside = np.sum((y @ model.tested) ** 2, axis=-1)
    if sigma is not None:
        statistic, dof_den = inside / dof_num / sigma**2, np.inf
    else:
        residual = y - (y @ model.fitted) @ model.fitted.T
        dof_den = float(y.shape[-1] - n_fitted)
        statistic = inside / dof_num / np.maximum(np.sum(residual**2, axis=-1) / dof_den, 1e-300)
    return LinearTest(np.asarray(statistic, float), f_survival(statistic, dof_num, dof_den), dof_num, dof_den)


def linear_noncentrality(mean: Reals, model: LinearModel, sigma: float) -> Reals:
    """Compute the noncentrality (...) of the test where the values are mean (..., N) and errors."""
    return np.asarray(np.sum((model.white(mean) @ model.tested) ** 2, axis=-1) / sigma**2, float)


def linear_power(false_alarm_probability: ArrayLike, noncentrality: ArrayLike, dof_num: int, dof_den: float) -> Reals:
    """Compute the power of a test at a false alarm probability; absolute accuracy 1e-10. dof_den may be infinite."""
    threshold = f_threshold(false_alarm_probability, dof_num, dof_den)
    if np.isinf(dof_den):
        return noncentral_chi_square_survival(dof_num * threshold, dof_num, noncentrality)
    return noncentral_f_survival(threshold, dof_num, dof_den, noncentrality)
