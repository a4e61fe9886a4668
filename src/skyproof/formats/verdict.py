"""`verdict.json`: the verdict as one UTF-8 document, and its published JSON Schema.

The schema is the file `verdict.schema.json` beside this module (JSON Schema 2020-12); `make_verdict_schema` makes it
from the models, and a test holds the two together.
"""

import json
import os
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from skyproof.errors import InputError, describe_fault
from skyproof.formats.atomic_write import write_whole
from skyproof.formats.bounds import METADATA_BYTES, describe_first
from skyproof.formats.byte_io import read_text
from skyproof.verdict import VERDICT_FORMAT, Verdict

__all__ = ["SCHEMA_PATH", "make_verdict_schema", "read_verdict", "write_verdict", "write_verdict_json"]

SCHEMA_PATH = Path(__file__).with_name("verdict.schema.json")


def write_verdict_json(verdict: Verdict) -> str:
    """Write the document: keys in the order of the models, numbers unrounded, null for what is absent."""
    return json.dumps(verdict.model_dump(mode="json"), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def write_verdict(path: str | os.PathLike[str], verdict: Verdict) -> None:
    """Write the document, whole or not at all.

    Raises
    ------
    OutputError : the file cannot be written.
    """
    with write_whole(path) as file:
        file.write(write_verdict_json(verdict).encode())


def read_verdict(path: str | os.PathLike[str]) -> Verdict:
    """Read a document that `write_verdict` wrote.

    Raises
    ------
    InputError : the file cannot be read, is not JSON or is not a verdict; the message lists what is wrong and where.
    """
    name = os.fspath(path)
    text = read_text(Path(path), METADATA_BYTES, "the verdict", "give the path of a verdict.json")
    try:
        return Verdict.model_validate_json(text, strict=True)
    except ValidationError as error:
        faults = describe_first(
            error.errors(include_url=False), lambda fault: describe_fault(_place(fault["loc"]), fault)
        )
        raise InputError(
            f"{name} is not a {VERDICT_FORMAT} document: {'; '.join(faults)}. "
            "Let skyproof write it again, or compare it with the published schema, verdict.schema.json"
        ) from error


def _place(location: tuple[int | str, ...]) -> str:
    path = ""
    for step in location:
        path += f"[{step}]" if isinstance(step, int) else f".{step}" if path else step
    return path


def make_verdict_schema() -> dict[str, Any]:
    """Return the JSON Schema of the document: every key required, none beside them."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Verdict.model_json_schema()}
