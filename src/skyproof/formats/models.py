"""Base of all TOML files that people write: frozen tables that refuse unknown keys, and their faults in words."""

from collections.abc import Iterator
from datetime import date, datetime
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Final, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    Strict,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic_core import ErrorDetails

from skyproof.errors import describe_fault, shorten, write_value
from skyproof.formats.bounds import describe_first
from skyproof.gnss.time import format_iso, parse_iso

__all__ = ["FilePath", "Instant", "Model", "Name", "Number", "describe_faults", "find_repeated"]

NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"  # names become file names


def _parse_instant(value: Any) -> np.datetime64:
    if isinstance(value, date):  # or a datetime, which is one
        if isinstance(value, datetime) and value.tzinfo is not None:
            raise ValueError("has a time zone; write GPS time without a zone, as in 2022-01-01T21:45:58")
        value = value.isoformat()
    if isinstance(value, np.datetime64):
        instant: np.datetime64 = value.astype("datetime64[ns]")
        return instant
    if not isinstance(value, str):
        raise ValueError(f"is {write_value(value)}, expected GPS time as 2022-01-01T21:45:58, without a zone")
    return parse_iso(value)


def _format_instant(value: np.datetime64) -> str:
    return format_iso(value, 9)


def _resolve_beside(path: Path, info: ValidationInfo) -> Path:
    if not path.name or "\0" in str(path):
        raise ValueError("not the name of a file; give its path, relative to this file")
    folder: Path = (info.context or {}).get("folder", Path())
    return folder / path


Name = Annotated[str, Field(pattern=NAME, max_length=100)]
Number = Annotated[float, Strict()]
"""Whole or not; a text that holds one is refused."""
Instant = Annotated[
    np.datetime64,
    PlainValidator(_parse_instant),
    PlainSerializer(_format_instant, return_type=str),
    WithJsonSchema({"type": "string", "description": "GPS time without a zone, as 2022-01-01T21:45:58"}),
]
FilePath = Annotated[Path, AfterValidator(_resolve_beside)]
"""A file. Relative paths count from the folder that the validation's context names."""


class Model(BaseModel):
    """A table that refuses what it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, arbitrary_types_allowed=True)


def find_repeated(names: list[Any]) -> list[int]:
    """Find where a list repeats an earlier member."""
    return [number for number, name in enumerate(names) if name in names[:number]]


def describe_faults(error: ValidationError, root: type[BaseModel]) -> list[str]:
    """Describe what is wrong with a table: each fault by key, value and expectation.

    The first faults are named with the path of their key as in the file ("receivers[1].spin.rate_hz"); the others are
    counted. An unknown key is named with the nearest known one.
    """
    faults = error.errors(include_url=False)
    with_members = {fault["loc"][:k] for fault in faults for k in range(len(fault["loc"]))}
    # a list is too short because of faults in its members, which are named themselves
    first = [fault for fault in faults if fault["type"] != "too_short" or fault["loc"] not in with_members]
    return describe_first(first, lambda fault: _describe_fault(fault, root))


def _describe_fault(fault: ErrorDetails, root: type[BaseModel]) -> str:
    kind, loc = fault["type"], fault["loc"]
    parts: list[str] = []
    known: Any = root
    for place, part in enumerate(loc):
        if isinstance(part, int):
            parts.append(f"[{part}]")
            continue
        tagged = {
            model.model_fields["kind"].default: model
            for model in _iterate_models(known)
            if "kind" in model.model_fields
        }
        if part in tagged and place > 0:  # what kind of table it is stands in the place, not in the file
            known = tagged[part]
            continue
        parts.append(f".{part}")
        for model in _iterate_models(known):
            if part in model.model_fields:
                known = model.model_fields[part].annotation
                break
        else:
            known = known if kind == "extra_forbidden" else None
    path = shorten("".join(parts).lstrip("."))
    if kind == "extra_forbidden":
        names = [name for model in _iterate_models(known) for name in model.model_fields]
        near = get_close_matches(str(loc[-1])[:60], names, 1, cutoff=0.5)
        hint = f", did you mean {near[0]}?" if near else ""
        return f"{path}: unknown key{hint}; known here: {', '.join(names)}"
    if fault.get("ctx", {}).get("pattern") == NAME:
        return f"{path} = {write_value(fault['input'])}, expected a name of letters, digits, '.', '_' and '-'"
    return describe_fault(path, fault)


def _iterate_models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Iterate over the models that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for part in get_args(annotation):
            yield from _iterate_models(part)
