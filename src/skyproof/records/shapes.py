"""Check that the arrays of a record fit each other, keep them read-only, and select epochs of them."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from skyproof.arrays import Booleans, Indices

__all__ = [
    "Channels",
    "Selectable",
    "freeze",
]


class Selectable:
    """A dataclass whose rows can be selected: epochs, mostly, along axis 0 of its arrays.

    BY_ROW : the fields that have these rows, each an array, a mapping to arrays, or None; all fields if it is empty.
    TIME : the one of them by which `select_between` selects.
    """

    __slots__ = ()
    BY_ROW: ClassVar[tuple[str, ...]] = ()
    TIME: ClassVar[str] = "gpst"

    def select(self, rows: slice | Booleans | Indices) -> Self:
        """Select rows: as views by a slice, as copies by a mask (n,) or by numbers."""
        names = self.BY_ROW or [field.name for field in fields(self)]  # type: ignore[arg-type]
        chosen: dict[str, Any] = {name: _rows_of(getattr(self, name), rows) for name in names}
        return replace(self, **chosen)  # type: ignore[type-var]

    def select_between(self, begin: Any, end: Any) -> Self:
        """Select the rows with begin <= time < end: labels, or seconds where `TIME` is `elapsed_s`."""
        time = getattr(self, self.TIME)
        return self.select((time >= begin) & (time < end))


class Channels:
    """A dataclass whose channels, one of each of its `signals`, can be selected.

    CELLS : the fields that have them along axis 1, or are None. OF_CHANNELS : those that have them along axis 0.
    """

    __slots__ = ()
    CELLS: ClassVar[tuple[str, ...]] = ()
    OF_CHANNELS: ClassVar[tuple[str, ...]] = ()

    def select_channels(self, columns: Indices) -> Self:
        """Select channels by their numbers, as copies."""
        chosen: dict[str, Any] = {
            name: None if (cells := getattr(self, name)) is None else cells[:, columns] for name in self.CELLS
        }
        chosen |= {name: getattr(self, name)[columns] for name in self.OF_CHANNELS}
        signals: Any = getattr(self, "signals")  # noqa: B009
        return replace(self, signals=tuple(signals[k] for k in columns), **chosen)  # type: ignore[type-var]


def _rows_of(values: Any, rows: slice | Booleans | Indices) -> Any:
    if isinstance(values, Mapping):
        return {key: part[rows] for key, part in values.items()}
    return None if values is None else values[rows]


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
