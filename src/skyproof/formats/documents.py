"""TOML, JSON and CSV as tables, within the bounds of what is read."""

import csv
import io
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from skyproof.errors import InputError
from skyproof.formats.bounds import METADATA_BYTES, SETTINGS_BYTES, require_toml_depth
from skyproof.formats.byte_io import read_content, read_text, strip_mark

__all__ = ["parse_json", "read_json", "read_rows", "read_toml"]


def read_rows(
    text: str, source: str, to_do: str = "fix the line or leave it out", *, delimiter: str = ",", strict: bool = False
) -> Iterator[tuple[int, list[str]]]:
    """Yield each row of a table of text with the number of its last line; empty lines are empty rows.

    Raises InputError for what is no such table, as a field of more than 131072 characters is none.
    """
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=strict)
    try:
        for row in rows:
            yield rows.line_num, row
    except csv.Error as error:
        raise InputError(f"{source}: line {rows.line_num}: {error}; {to_do}") from error


def read_toml(path: Path, what: str, no_toml: str, to_do: str) -> dict[str, Any]:
    """Read the tables of a TOML file.

    what : the file in words, for what the system says of it: "the platform file".
    no_toml : what to do about a file that is no TOML. to_do : about one that cannot be read.

    Raises
    ------
    InputError : the file cannot be read, is too long or too deep, or is no TOML in UTF-8.
    """
    content = read_text(path, SETTINGS_BYTES, what, to_do)
    try:
        text = content.decode("utf-8")
        require_toml_depth(text)
        return tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; {no_toml}") from error
    except (ValueError, RecursionError) as error:  # no TOML, too deep, or a whole number of thousands of digits
        raise InputError(f"{path}: not valid TOML: {error}; {no_toml}") from error


def read_json(path: Path, what: str, to_do: str) -> Any:
    """Read a JSON file. Raises InputError as `read_toml` and `parse_json` do."""
    return parse_json(read_content(path, METADATA_BYTES, what, to_do), str(path), to_do)


def parse_json(content: bytes, where: str, to_do: str) -> Any:
    """Parse bytes of JSON in UTF-8. `where` begins a message, `to_do` ends it. Raises InputError."""
    try:
        return json.loads(strip_mark(content, where).decode("utf-8"))
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: byte {error.start} is not UTF-8; {to_do}") from error
    except RecursionError as error:
        raise InputError(f"{where}: not valid JSON: nested too deep; {to_do}") from error
    except ValueError as error:
        raise InputError(f"{where}: not valid JSON: {error}; {to_do}") from error
