"""Fitting a straight line by orthonormal columns, and orthonormal contrasts of several series."""

from typing import NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals

__all__ = ["LineFit", "additive_contrasts", "fit_line", "line_columns"]


class LineFit(NamedTuple):
    """A line through each series, in orthonormal columns.

    level : (..., M) coefficient on 1/sqrt(N); the mean is level/sqrt(N).
    slope : (..., M) coefficient on (t - mean t)/norm.
    residual : (..., N, M).
    """

    level: Reals
    slope: Reals
    residual: Reals


def line_columns(n: int, times: Reals | None = None) -> Reals:
    """Build orthonormal columns (n, 2) of level and slope; `times` (n,) if the points are not evenly spaced."""
    centred = np.arange(n, dtype=float) if times is None else np.asarray(times, float)
    centred = centred - centred.mean()
    return np.column_stack([np.full(n, n**-0.5), centred / np.linalg.norm(centred)])


def fit_line(values: Reals, times: Reals | None = None) -> LineFit:
    """Fit a least-squares line through `values` (..., N, M), time along the second last axis."""
    columns = line_columns(values.shape[-2], times)
    coefficients = columns.T @ values
    return LineFit(coefficients[..., 0, :], coefficients[..., 1, :], values - columns @ coefficients)


def additive_contrasts(sigma: Reals, groups: Indices | None = None) -> tuple[Reals, Reals]:
    """Build orthonormal contrasts that remove row + column effects from a table of noisy numbers.

    With groups of rows a column has a separate effect on each group: M = (K-G)(R-1) with G groups.

    Parameters
    ----------
    sigma : (..., K, R), standard deviations, up to a common factor, of the table's entries.
    groups : (K,) number 0 to G-1 of each row's group; all one group if absent.

    Returns
    -------
    contrasts : (..., K*R, M) with M = (K-1)(R-1). `table.reshape(K*R) @ contrasts` does not see a_k + b_gr, and has
        unit covariance if the entries are independent with these sigmas.
    gain : (..., M) what an independent error of variance 1 added to every entry adds to each contrast's variance; the
        contrasts are rotated so that these errors too are uncorrelated.
    """
    *lead, n_rows, n_columns = sigma.shape
    group = np.zeros(n_rows, np.intp) if groups is None else np.asarray(groups)
    n_effects = n_rows + (int(group.max()) + 1) * (n_columns - 1)
    additive = np.zeros((n_rows, n_columns, n_effects))
    additive[np.arange(n_rows), :, np.arange(n_rows)] = 1.0
    for column in range(1, n_columns):
        additive[np.arange(n_rows), column, n_rows + group * (n_columns - 1) + column - 1] = 1.0
    inverse = 1.0 / sigma.reshape(*lead, n_rows * n_columns)
    q = np.linalg.qr(inverse[..., None] * additive.reshape(n_rows * n_columns, -1), mode="complete").Q
    whitened = inverse[..., None] * q[..., n_effects:]
    gain, rotation = np.linalg.eigh(np.swapaxes(whitened, -1, -2) @ whitened)
    return whitened @ rotation, gain
