"""Cells that can use the same samples, as one item of work: some minutes of a processor, half of them to render.

Items are done by as many processes as there are cores; what a folder has is not done again, whenever and however the
run before it ended.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from skyproof.batch import Item, Processes, Store, run
from skyproof.compiled import count_threads
from skyproof.simulator.scenario import Scenario
from skyproof.studies.base import StudySettings
from skyproof.studies.protection.cell import cut_scene, make_rows
from skyproof.studies.protection.equipment import EQUIPMENT, equip

__all__ = ["ROWS", "SharedSamples", "list_cells", "run_cells"]

ROWS: Final = "rows.json"
SAME_SAMPLES: Final = (tuple(name for name in EQUIPMENT if name != "spinning"), ("spinning",))
"""Equipment by what can share samples: a body's antennas stand still or turn."""


@dataclass(frozen=True, kw_only=True)
class SharedSamples:
    """A scene, and equipment that it can have."""

    scenario: Scenario
    equipments: tuple[str, ...]

    @property
    def item(self) -> Item:
        made = cut_scene(self.scenario).model_dump_json()
        same_as = "\n".join((version("skyproof"), ", ".join(self.equipments), made))
        return Item(key=f"{self.scenario.name}--{self.equipments[0].replace(' ', '-')}", given=self, same_as=same_as)


def list_cells(scenario: Scenario) -> list[SharedSamples]:
    """List the items of a scene with all equipment that it can have."""
    found = [tuple(name for name in same if equip(scenario, name) is not None) for same in SAME_SAMPLES]
    return [SharedSamples(scenario=scenario, equipments=possible) for possible in found if possible]


def run_cells(asked: Sequence[SharedSamples], name: str, settings: StudySettings) -> Iterator[dict[str, Any]]:
    """Yield the rows of each cell once all are done, and the errors of those that failed.

    name : of the folder.

    Raises KeyboardInterrupt after the rows that are there, if Ctrl-C left some out.
    """
    with TemporaryDirectory(prefix=f"skyproof-{name}") as made:
        folder = Path(made) if settings.folder is None else settings.folder / name
        with Store(folder) as store, Processes(min(count_threads(), len(asked))) as processes:
            items = [cells.item for cells in asked]
            errors, interrupted = run(items, _work, store, processes, report=settings.report)
            for cells, item in zip(asked, items, strict=True):
                if item.key in errors:
                    at = {"scene": cells.scenario.name, "equipment": ", ".join(cells.equipments)}
                    yield {**at, "error": errors[item.key]}
                elif store.has(item):
                    yield from json.loads((store.of(item.key) / ROWS).read_text(encoding="utf-8"))
    if interrupted:
        raise KeyboardInterrupt


def _work(asked: SharedSamples, folder: Path) -> None:
    """Write the cells' rows into the folder: the same but for the seconds that they took."""
    with TemporaryDirectory(prefix="skyproof-cells") as made:
        rows = make_rows(asked.scenario, asked.equipments, Path(made))
    (folder / ROWS).write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
