"""Group columns that choose the same rows, so that they are computed together."""

import numpy as np

from skyproof.arrays import Booleans, Indices

__all__ = ["group_by_rows"]


def group_by_rows(chosen: Booleans) -> list[tuple[Indices, Indices]]:
    """Group the (n, m) columns by the rows that they choose; return each set of rows with its columns."""
    patterns, number = np.unique(chosen, axis=1, return_inverse=True)
    columns = number.ravel()
    return [(np.flatnonzero(rows), np.flatnonzero(columns == k)) for k, rows in enumerate(patterns.T)]
