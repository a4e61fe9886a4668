"""Medians of the finite values of each series, all series at once."""

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals

__all__ = ["medians"]


def medians(values: ArrayLike, axis: int = 0) -> Reals:
    """Return the median along `axis` of what is finite; NaN where nothing is."""
    whole = np.asarray(values, np.float64)
    known = np.isfinite(whole)
    count = known.sum(axis=axis, keepdims=True)
    ordered = np.sort(np.where(known, whole, np.inf), axis=axis)
    if ordered.shape[axis] == 0:
        return np.full(count.squeeze(axis).shape, np.nan)
    low = np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, axis)
    high = np.take_along_axis(ordered, np.minimum(count // 2, ordered.shape[axis] - 1), axis)
    return np.asarray(np.where(count > 0, 0.5 * (low + high), np.nan).squeeze(axis))
