"""Nested tables as TOML (version 1.0.0), so that `tomllib` reads back the same."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

__all__ = ["toml_lines"]

_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")


def toml_lines(table: Mapping[str, Any]) -> Iterator[str]:
    """The lines of a document that holds `table`: strings, whole numbers, floats, booleans, lists and tables of them.

    Numbers keep every digit. A table within a list that is not all tables stands inline.

    Raises
    ------
    TypeError : a value that TOML has no word for, None for instance, or a key that is no string.
    """
    yield from _section(table, ())


def _section(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    """Plain values first: what follows a heading belongs to it."""
    for key, value in table.items():
        if not isinstance(value, Mapping) and not _is_tables(value):
            yield f"{_key(key)} = {_inline(value)}"
    for key, value in table.items():
        here = (*path, key)
        if isinstance(value, Mapping):
            yield from ("", f"[{_dotted(here)}]")
            yield from _section(value, here)
        elif _is_tables(value):
            for one in value:
                yield from ("", f"[[{_dotted(here)}]]")
                yield from _section(one, here)


def _is_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) > 0 and all(isinstance(one, Mapping) for one in value)


def _inline(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return _string(value)
        case int():
            return str(value)
        case float():
            return repr(float(value)) if math.isfinite(value) else str(float(value))  # nan, inf, -inf
        case Mapping():
            pairs = ", ".join(f"{_key(key)} = {_inline(one)}" for key, one in value.items())
            return f"{{{pairs}}}"
        case Sequence():
            return "[" + ", ".join(map(_inline, value)) + "]"
    raise TypeError(f"TOML has no word for {value!r}")


def _dotted(path: tuple[str, ...]) -> str:
    return ".".join(map(_key, path))


def _key(key: Any) -> str:
    if not isinstance(key, str):
        raise TypeError(f"a key of TOML is a string, not {key!r}")
    return key if _BARE.fullmatch(key) else _string(key)


def _string(text: str) -> str:
    # TOML's basic strings are JSON's, but for the delete character, which TOML wants escaped
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
