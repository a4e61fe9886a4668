"""The catalogue of a fleet: a CSV table with one line for each item, as a spreadsheet writes it.

    name,inputs,nav,antenna_distance_m
    harbour,harbour/bow.bin;harbour/stern.bin,brdc0010.22n,61.5
    mast,mast.obs.gz,brdc0010.22n,

`inputs` holds one path a receiver with ";" between them; `nav`, `imu` and `platform` what the options of
`skyproof protect` of these names take; a column may have the name of any setting that is one number or word. What is
empty is not given. Paths are relative to the catalogue. Spreadsheets of some countries part columns by ";" or tabs: the
first line shows which, and several inputs then stand in quotes.
"""

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.errors import InputError, SettingsError, shorten
from skyproof.formats.bounds import METADATA_BYTES
from skyproof.formats.byte_io import read_text
from skyproof.formats.documents import read_rows

__all__ = ["CatalogueItem", "read_catalogue"]

FILES: Final = ("nav", "imu", "platform")
WORDS: Final = ("oscillator", "tracking")
IN_PLATFORM: Final = ("antennas_enu_m", "not_driving", "place_deg")
"""Settings of several numbers or words."""
SETTINGS: Final = tuple(name for name in Settings.model_fields if name not in IN_PLATFORM)
COLUMNS: Final = ("name", "inputs", *FILES, *SETTINGS)
_WORDS: Final = {",": "a comma", ";": 'a ";"', "\t": "a tab"}
"""What may part columns, in words."""
_NAME: Final = re.compile(r"\w[\w.+ -]{0,99}(?<! )")


@dataclass(frozen=True, kw_only=True)
class CatalogueItem:
    """What `protect` takes, once. name : of its folder. Paths are relative to the catalogue's folder."""

    name: str
    inputs: tuple[str, ...]
    nav: str | None = None
    imu: str | None = None
    platform: str | None = None
    settings: Mapping[str, Any]


def read_catalogue(path: Path) -> list[CatalogueItem]:
    """Read the items of a catalogue, in its order.

    Raises
    ------
    InputError : it cannot be read, or a line or column is wrong; names file, line and column. SettingsError : a
        setting makes no sense.
    """
    content = read_text(path, METADATA_BYTES, "the catalogue", "give a CSV file with one line for each item")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is no UTF-8; save the table as CSV in UTF-8") from error
    delimiter = _find_delimiter(text)
    lines = _read_lines(text, path, delimiter)
    number, head = next(lines, (1, []))
    names = [name.strip() for name in head]
    _require_columns(names, f"{path}: line {number}")
    items: dict[str, CatalogueItem] = {}
    at: dict[str, int] = {}
    for number, cells in lines:
        where = f"{path}: line {number}"
        if len(cells) > len(names):
            raise InputError(
                f"{where}: {len(cells)} fields, but the first line names {len(names)} columns; separate several "
                f'inputs by ";", and quote a field that holds {_WORDS[delimiter]}: "a.obs;b.obs"'
            )
        item = _item({name: cell.strip() for name, cell in zip(names, cells, strict=False) if cell.strip()}, where)
        if (taken := item.name.casefold()) in at:  # of folders, which some file systems tell apart by letters alone
            raise InputError(
                f"{where}: name = {item.name!r} is that of line {at[taken]}; give each line a name of its own, in the "
                "column name"
            )
        at[taken], items[item.name] = number, item
    if not items:
        raise InputError(f"{path}: no item; write one line for each item below the first line, which names the columns")
    return list(items.values())


def _find_delimiter(text: str) -> str:
    """Find the delimiter by which most names of the first line are known columns."""
    head = next((line for line in text.splitlines() if line.strip()), "")

    def count_known(delimiter: str) -> int:
        return sum(name.strip().strip('"') in COLUMNS for name in head.split(delimiter))

    return max(_WORDS, key=count_known)


def _read_lines(text: str, path: Path, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells of each line that holds any."""
    rows = read_rows(text, str(path), "save the table as CSV again", delimiter=delimiter, strict=True)
    return ((number, cells) for number, cells in rows if any(cell.strip() for cell in cells))


def _require_columns(names: list[str], where: str) -> None:
    for name in names:
        if name in IN_PLATFORM:
            raise InputError(f"{where}: column {name!r} holds several numbers; give them in a platform file")
        if name not in COLUMNS:
            near = difflib.get_close_matches(name, COLUMNS, n=1) or ["inputs"]
            raise InputError(
                f"{where}: column {shorten(name)!r} is not known, nearest is {near[0]!r}; the first line names the "
                "columns: name, inputs, nav, imu, platform, and settings"
            )
        if names.count(name) > 1:
            raise InputError(f"{where}: column {name!r} is named twice; remove one")
    if not {"inputs", "platform"} & set(names):
        raise InputError(f"{where}: it names no column inputs, nor platform; give one of them")


def _item(cells: dict[str, str], where: str) -> CatalogueItem:
    inputs = tuple(path.strip() for path in cells.get("inputs", "").split(";") if path.strip())
    if not inputs and "platform" not in cells:
        raise InputError(f"{where}: inputs is empty; give one path a receiver, or a platform file that names them")
    name = cells.get("name") or _name_from_paths(inputs or (cells["platform"],))
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{where}: name = {shorten(name)!r} cannot be that of a folder; give one of letters, digits, "
            '"_", "-", "+", "." and spaces, at most 100, that begins with a letter or digit'
        )
    settings: dict[str, Any] = {key: _value(key, cells[key], where) for key in SETTINGS if key in cells}
    try:
        resolve_settings(**settings)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from error
    return CatalogueItem(name=name, inputs=inputs, settings=settings, **{key: cells.get(key) for key in FILES})


def _name_from_paths(paths: Sequence[str]) -> str:
    """Make a name of the files' names up to their first point."""
    names = (Path(path).name.lstrip(".").partition(".")[0] for path in paths)
    return re.sub(r"[^\w+-]", "_", "_" + "+".join(names))[1:101] or "_"


def _value(key: str, text: str, where: str) -> float | str:
    if key in WORDS:
        return text
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where}: {key} = {shorten(text)!r}, expected a number; write it with a point") from None
