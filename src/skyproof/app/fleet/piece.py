"""One item of a catalogue as a piece of work: what is done for it, and what its result depends on."""

import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from skyproof.app.fleet.catalogue import CatalogueItem
from skyproof.app.protect import protect
from skyproof.batch import Item
from skyproof.errors import InputError, SkyproofError
from skyproof.formats.documents import read_toml

__all__ = ["make_piece", "protect_piece"]

BESIDE = (".toml", ".sigmf-meta", ".sigmf-data")
"""Endings of what is read with an input."""


def make_piece(item: CatalogueItem, folder: Path) -> Item:
    """Describe an item as a piece of work. // folder : the catalogue's."""
    return Item(key=item.name, given=(item, str(folder.absolute())), same_as=_same_as(item, folder))


def protect_piece(given: tuple[CatalogueItem, str], out: Path) -> None:
    """Protect one item in a process of its own, from the catalogue's folder."""
    item, folder = given
    try:
        os.chdir(folder)
    except OSError as error:
        raise SkyproofError(
            f"{folder}: this node cannot enter the catalogue's folder ({error.strerror}); all nodes see the same files"
        ) from error
    protect(item.inputs, nav=item.nav, imu=item.imu, platform=item.platform, out=out, **item.settings)


def _same_as(item: CatalogueItem, folder: Path) -> str:
    """Describe what an item's result depends on: the item, the version, its files' lengths and times.

    Reading the files whole would take as long as the work on them.
    """
    paths = [folder / name for name in (*item.inputs, item.nav, item.imu, item.platform) if name is not None]
    if item.platform is not None:
        paths += _list_paths(folder / item.platform)
    paths += [path.with_suffix(ending) for path in list(paths) for ending in BESIDE]
    files = {os.path.relpath(path, folder): _stamp(path) for path in paths}
    return json.dumps([asdict(item), files, version("skyproof")], sort_keys=True)


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns


def _list_paths(platform: Path) -> list[Path]:
    """List the paths that a platform file names, each text that may be one.

    An unreadable platform file fails its item when that is begun.
    """
    try:
        table = read_toml(platform, "the platform file", "", "")
    except InputError:
        return []
    return [platform.parent / text for text in _texts(table) if "\0" not in text]


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for element in value.values() if isinstance(value, dict) else value:
            yield from _texts(element)
