"""Every item of a catalogue protected, by processes of this machine or the nodes of a Ray cluster."""

from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from skyproof.app.common.folder import claim, require_free
from skyproof.app.common.kernels import RECEIVING, make_ready
from skyproof.app.common.progress import Progress, Silent
from skyproof.app.fleet.catalogue import CatalogueItem, read_catalogue
from skyproof.app.fleet.piece import make_piece, protect_piece
from skyproof.app.fleet.rows import FleetRow, make_row, write_rows
from skyproof.batch import ITEMS, Item, Processes, Runner, Store, run
from skyproof.compiled import count_threads
from skyproof.errors import OutputError, SettingsError
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.bounds import list_names
from skyproof.report.fleet import write_fleet_html

__all__ = ["PAGE", "TABLE", "FleetResult", "fleet"]

PAGE, TABLE = "fleet.html", "fleet.parquet"


@dataclass(frozen=True, kw_only=True)
class FleetResult:
    """A row an item, in the catalogue's order; the folder with all outputs; whether Ctrl-C left items out."""

    rows: tuple[FleetRow, ...]
    folder: Path
    interrupted: bool = False

    @property
    def counts(self) -> Counter[str]:
        """Count items by verdict, those without one by how they ended: failed, not run."""
        return Counter(row.verdict or row.state for row in self.rows)


def fleet(
    catalogue: str | Path,
    *,
    out: str | Path,
    workers: int | None = None,
    ray: str | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> FleetResult:
    """Protect every item of a catalogue; the same bytes in however many processes.

    Items that `out` has are not done again; those that failed are. An item that cannot be done costs itself.

    Parameters
    ----------
    catalogue : CSV, one line for each item; see `skyproof.app.fleet.catalogue`.
    out : folder, made if absent: items/NAME holds what `protect` writes for each, fleet.html and fleet.parquet all.
    workers : processes; as many as cores if None.
    ray : address of a Ray cluster, whose nodes do the items in place of processes of this machine.
    overwrite : whether items are done again whose files or settings, or our version, changed since they were done.

    Raises
    ------
    InputError, SettingsError : the catalogue cannot be read, or a line of it makes no sense. OutputError : the folder
        cannot be written, another run writes into it, or it holds what would be overwritten.
    """
    progress, path, folder = progress or Silent(), Path(catalogue), Path(out)
    items = read_catalogue(path)
    runner = _runner(workers, ray)
    pieces = [make_piece(item, path.parent) for item in items]
    with claim(folder):
        _require_free(folder)
        return _fleet(items, pieces, Store(folder), runner, overwrite, progress)


def _require_free(folder: Path) -> None:
    """Raise OutputError if what is there is not of a fleet and would be overwritten."""
    taken = [name for name in (PAGE, TABLE, ITEMS) if (folder / name).exists()]
    require_free(folder, taken, taken if Store(folder).exists else (), "", overwrite=True)


def _require_same(pieces: Sequence[Item], store: Store) -> None:
    """Raise OutputError if results would be overwritten by others."""
    if changed := [item.key for item in pieces if store.has_other(item)]:
        raise OutputError(
            f"{store.folder}: done there of other files or settings, or by another version of skyproof: "
            f"{list_names(sorted(changed))}; name another folder with --out, or give --overwrite to do them again"
        )


def _fleet(
    items: Sequence[CatalogueItem],
    pieces: Sequence[Item],
    store: Store,
    runner: AbstractContextManager[Runner],
    overwrite: bool,
    progress: Progress,
) -> FleetResult:
    folder = store.folder
    make_ready(RECEIVING, progress)  # once, before as many processes as there are cores would each do it
    with store:
        if not overwrite:
            _require_same(pieces, store)
        with progress.stage(f"protecting {len(items)} items", float(len(items))) as stage, runner as doing:
            errors, interrupted = run(pieces, protect_piece, store, doing, report=stage.advance, say=progress.say)
        rows = tuple(make_row(item, store.of(item.name), errors.get(item.name)) for item in items)
        write_rows(rows, folder / TABLE)
        write_lines(folder / PAGE, [write_fleet_html(rows)], end="", encoding="utf-8")
    return FleetResult(rows=rows, folder=folder, interrupted=interrupted)


def _runner(workers: int | None, ray: str | None) -> AbstractContextManager[Runner]:
    if ray is not None:
        return _load_ray_nodes(ray, workers)
    if workers is not None and workers < 1:
        raise SettingsError(f"workers is {workers}, expected 1 or more; leave it out for one a core")
    return Processes(count_threads() if workers is None else workers)


def _load_ray_nodes(address: str, workers: int | None) -> AbstractContextManager[Runner]:
    """Load Ray, which need only be installed where a cluster is asked for."""
    if workers is not None:
        raise SettingsError("workers and ray are both given; a cluster does as many items as it has processors")
    try:
        nodes: AbstractContextManager[Runner] = import_module("skyproof.batch.ray_nodes").RayNodes(address)
    except ModuleNotFoundError as error:
        raise SettingsError(
            f"{error.name} is not installed, which a cluster needs; install skyproof[ray], on every node"
        ) from error
    return nodes
