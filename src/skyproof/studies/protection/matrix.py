"""Every ready-made scene with every equipment: `skyproof study protection-matrix`, and `protection-stanford`, which
shows the trusted fixes of the same cells and takes them from the same folder.

The cells of a scene that can use the same samples are one item of work, which takes some minutes of a processor, half
of them to render the samples. Items are done by as many processes as there are cores; what a folder has is not done
again, whenever and however the run before it ended.
"""

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from skyproof.batch import Item, Processes, Store, run
from skyproof.compiled import threads
from skyproof.report.chart import Axes
from skyproof.simulator.scenario import Scenario
from skyproof.simulator.scenes import ready, ready_made
from skyproof.studies.base import Row, Study, StudySettings
from skyproof.studies.protection.cell import rows_of, stretch_of
from skyproof.studies.protection.equipment import EQUIPMENT, equipped
from skyproof.studies.protection.errors import STANFORD

__all__ = ["STUDIES"]

NAME: Final = "protection-matrix"
ROWS: Final = "rows.json"
QUICK: Final = ("takeover", ("standing",))
QUICK_S: Final = 12.0


SAME_SAMPLES: Final = (tuple(name for name in EQUIPMENT if name != "spinning"), ("spinning",))
"""Equipment by what can share samples: a body's antennas stand still or turn."""


@dataclass(frozen=True, kw_only=True)
class SceneCells:
    """What is run. duration_s : in place of the scene's, then without its attacks."""

    scene: str
    equipments: tuple[str, ...]
    seed: int
    duration_s: float | None = None

    @property
    def scenario(self) -> Scenario:
        scenario = ready(self.scene)
        changes: dict[str, Any] = {"seed": scenario.seed + self.seed - 1}
        if self.duration_s is not None:
            changes |= {"duration_s": self.duration_s, "attacks": ()}
        return scenario.model_copy(update=changes)

    @property
    def item(self) -> Item:
        made = stretch_of(self.scenario).model_dump_json()
        same_as = "\n".join((version("skyproof"), json.dumps(asdict(self)), made))
        return Item(key=f"{self.scene}--{self.equipments[0].replace(' ', '-')}", given=self, same_as=same_as)


def cells(settings: StudySettings) -> list[SceneCells]:
    """All that can be; trials : how many items of them."""
    if settings.quick:
        scene, equipments = QUICK
        return [SceneCells(scene=scene, equipments=equipments, seed=settings.seed, duration_s=QUICK_S)]
    every = []
    for scene in ready_made():
        for same in SAME_SAMPLES:
            possible = tuple(name for name in same if equipped(ready(scene), name) is not None)
            every += [SceneCells(scene=scene, equipments=possible, seed=settings.seed)] if possible else []
    return every[: settings.trials]


def work(asked: SceneCells, folder: Path) -> None:
    """The cells' rows, into the folder: the same but for the seconds that they took."""
    with TemporaryDirectory(prefix="skyproof-cells") as made:
        rows = rows_of(asked.scenario, asked.equipments, Path(made))
    (folder / ROWS).write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def rows(settings: StudySettings) -> Iterator[Row]:
    """A row a cell; of those that could not be done, the error.

    Raises KeyboardInterrupt after the rows that are there, if Ctrl-C left some out.
    """
    for row in _done(settings):
        yield {name: value for name, value in row.items() if name != STANFORD}


def stanford(settings: StudySettings) -> Iterator[Row]:
    """A row for each bin of protection level and error that a trusted fix of any cell is in, the emptiest first.

    fixes_from : the power of ten that `fixes` reaches. Raises as `rows`, once all rows are there.
    """
    found, interrupted = Counter[tuple[str, float, float]](), False
    try:
        for row in _done(settings):
            for one in row.get(STANFORD, ()):
                found[one["axis"], one["protection_m"], one["error_m"]] += one["fixes"]
    except KeyboardInterrupt:
        interrupted = True
    for (axis, protection_m, error_m), fixes in sorted(found.items(), key=lambda one: (len(str(one[1])), one)):
        size = {"fixes": fixes, "fixes_from": 10 ** (len(str(fixes)) - 1)}
        yield {"axis": axis, "protection_m": protection_m, "error_m": error_m, **size}
    if interrupted:
        raise KeyboardInterrupt


def _done(settings: StudySettings) -> Iterator[dict[str, Any]]:
    """What the folder has of each cell once all are done."""
    asked = cells(settings)
    with TemporaryDirectory(prefix="skyproof-matrix") as made:
        folder = Path(made) if settings.folder is None else settings.folder / NAME
        with Store(folder) as store, Processes(min(threads(), len(asked))) as processes:
            items = [cell.item for cell in asked]
            errors, interrupted = run(items, work, store, processes, report=settings.report)
            for cell, item in zip(asked, items, strict=True):
                if item.key in errors:
                    yield {"scene": cell.scene, "equipment": ", ".join(cell.equipments), "error": errors[item.key]}
                elif store.has(item):
                    yield from json.loads((store.of(item.key) / ROWS).read_text(encoding="utf-8"))
    if interrupted:
        raise KeyboardInterrupt


STUDIES = (
    Study(
        name=NAME,
        title="What every equipment makes of every ready-made scene, through samples and the whole job.",
        paper="skyproof",
        figure="protection matrix",
        run=rows,
    ),
    Study(
        name="protection-stanford",
        title="Errors of the trusted fixes of all those cells beside their protection levels: a Stanford diagram",
        paper="skyproof",
        figure="Stanford diagram",
        run=stanford,
        charts=tuple(
            Axes(
                title=f"Trusted fixes, {axis}: beyond their level above the line",
                x="protection_m",
                y="error_m",
                x_label="protection level, m",
                y_label="error, m",
                by=("fixes_from",),
                where={"axis": axis},
                x_log=True,
                y_log=True,
                scattered=True,
                diagonal=True,
            )
            for axis in ("horizontal", "vertical")
        ),
    ),
)
