"""Check that the arrays of a record fit each other, and keep them read-only."""

from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = [
    "freeze",
]


def freeze(record: Any, shapes: Mapping[str, tuple[str, ...]]) -> None:
    """Replace each named array by a read-only view after checking that shapes agree.

    Parameters
    ----------
    record : dataclass instance under construction.
    shapes : field name to symbolic shape, e.g. {"pseudorange_m": ("epoch", "channel")}; equal symbols must be equal
        sizes; a symbol that is a number is that size.

    Raises
    ------
    ValueError : a shape does not fit; the message names the record, the field, and both shapes.
    """
    sizes: dict[str, int] = {}
    for name, symbols in shapes.items():
        array = np.asarray(getattr(record, name))
        if array.ndim != len(symbols):
            raise ValueError(f"{type(record).__name__}.{name} has shape {array.shape}, expected ({', '.join(symbols)})")
        for size, symbol in zip(array.shape, symbols, strict=True):
            wanted = int(symbol) if symbol.isdigit() else sizes.setdefault(symbol, size)
            if size != wanted:
                raise ValueError(
                    f"{type(record).__name__}.{name} has shape {array.shape}, but {symbol} is {wanted} elsewhere"
                )
        view = array.view()
        view.flags.writeable = False
        object.__setattr__(record, name, view)
