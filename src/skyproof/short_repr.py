"""How a record of arrays shows itself at a prompt or in a log, in a line or two, and a result in a notebook."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from html import escape
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["ShortRepr", "summarize", "write_notebook_html"]

_TIMES: Final = ("gpst", "elapsed_s")
_LISTED: Final = 6
"""Members of a tuple that are named."""
_SMALL: Final = 9
"""Numbers of an array that are written out."""
_LONGEST: Final = 60
"""Characters of a text."""


class ShortRepr:
    """A dataclass, with `repr=False`, whose `repr` is what `summarize` says of its fields."""

    __slots__ = ()

    def __repr__(self) -> str:
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return summarize(type(self).__name__, values)


def summarize(name: str, values: Mapping[str, Any]) -> str:
    """Return what a record holds in a line or two: small values, the span of its times, shapes of large arrays.

    Arrays along the record's times are left out, as are fields that are None or empty: the class names them all.
    """
    times = next((values[key].size for key in _TIMES if isinstance(values.get(key), np.ndarray)), None)
    words = [f"{key}={_short(value)}" for key, value in values.items() if not _is_silent(key, value, times)]
    return f"{name}({', '.join(words)})"


def _is_silent(key: str, value: Any, times: int | None) -> bool:
    if isinstance(value, np.ndarray):
        return key not in _TIMES and value.ndim > 0 and value.shape[0] == times
    return value is None or (isinstance(value, tuple | str | Mapping) and not value) or callable(value)


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _short_array(value)
    if isinstance(value, np.datetime64):
        return re.sub(r"\.?0+$", "", text) if "." in (text := str(value)) else text
    if isinstance(value, np.generic | float):
        return f"{value:.6g}" if isinstance(value, float | np.floating) else str(value)
    if isinstance(value, tuple | list):
        return _short_items(value)
    if isinstance(value, Mapping):
        return f"{len(value)} of {_name_some(list(value))}"
    if isinstance(value, str):
        return repr(value if len(value) <= _LONGEST else f"{value[: _LONGEST - 3]}...")
    text = repr(value)
    return text if len(text) <= _LONGEST else type(value).__name__


def _short_array(values: NDArray[Any]) -> str:
    if 0 < values.size <= _SMALL and values.dtype.kind in "fiub":
        return " ".join(np.array2string(values, precision=4, separator=", ").split())
    if values.ndim == 1 and values.size and values.dtype.kind in "fM":
        first, last = map(_short, values[[0, -1]])
        return f"{values.size} from {first} to {last}"
    return f"{values.dtype} {values.shape}"


def _short_items(items: Sequence[Any]) -> str:
    if not items:
        return "()"
    first = items[0]
    if isinstance(first, int | float) or (not isinstance(first, np.ndarray) and str(first) != repr(first)):
        return f"{len(items)}: {_name_some(items)}"  # numbers, and what has a name of its own
    return f"{len(items)} {type(first).__name__}"


def _name_some(items: Sequence[Any]) -> str:
    names = [name if len(name := str(item)) <= _LONGEST else f"{name[: _LONGEST - 3]}..." for item in items[:_LISTED]]
    return ", ".join(names + ["..."] * (len(items) > _LISTED))


def write_notebook_html(
    title: str, sentences: Iterable[str], *tables: tuple[Sequence[str], Iterable[Sequence[str]]]
) -> str:
    """Show a result in a notebook: words and tables (names of columns, rows), all escaped."""

    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f'<{tag} style="text-align:left">{escape(cell)}</{tag}>' for cell in cells) + "</tr>"

    parts = [f"<p><strong>{escape(title)}</strong></p>", *(f"<p>{escape(sentence)}</p>" for sentence in sentences)]
    for head, body in tables:
        rows = "".join(row(cells, "td") for cells in body)
        if rows:
            parts.append(f"<table><thead>{row(head, 'th')}</thead><tbody>{rows}</tbody></table>")
    return f"<div>{''.join(parts)}</div>"
