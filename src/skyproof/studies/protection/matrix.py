"""Every ready-made scene with every equipment: `skyproof study protection-matrix`, and `protection-stanford`, which
shows the trusted fixes of the same cells and takes them from the same folder.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Final

from skyproof.report.chart import Axes
from skyproof.simulator.scenes import load_ready_made, read_ready_made
from skyproof.studies.base import Row, Study, StudySettings
from skyproof.studies.protection.errors import STANFORD
from skyproof.studies.protection.items import SharedSamples, list_cells, run_cells

__all__ = ["NAME", "STUDIES", "cells"]

NAME: Final = "protection-matrix"
QUICK: Final = ("takeover", ("second receiver at 20 m",))  # whose fixes are trusted: it shows which signals are true
QUICK_S: Final = 12.0


def cells(settings: StudySettings) -> list[SharedSamples]:
    """List all items of work; trials : how many of them. What is quick ends before the attack."""
    every = []
    for name in load_ready_made():
        scenario = read_ready_made(name)
        seed = scenario.seed + settings.seed - 1
        every += list_cells(scenario.model_copy(update={"seed": seed}))
    if settings.quick:
        scene, equipments = QUICK
        short = {"duration_s": QUICK_S, "attacks": ()}
        return [
            SharedSamples(scenario=cell.scenario.model_copy(update=short), equipments=equipments)
            for cell in every
            if cell.scenario.name == scene and set(equipments) <= set(cell.equipments)
        ]
    return every[: settings.trials]


def rows(settings: StudySettings) -> Iterator[Row]:
    """Yield a row per cell; of those that could not be done, the error.

    Raises KeyboardInterrupt after the rows that are there, if Ctrl-C left some out.
    """
    for row in run_cells(cells(settings), NAME, settings):
        yield {name: value for name, value in row.items() if name != STANFORD}


def stanford(settings: StudySettings) -> Iterator[Row]:
    """Yield a row for each bin of protection level and error that any trusted fix is in.

    fixes_from : the power of ten that `fixes` reaches. Raises as `rows`, once all rows are there.
    """
    found, interrupted = Counter[tuple[str, float, float]](), False
    try:
        for row in run_cells(cells(settings), NAME, settings):
            for fixes_row in row.get(STANFORD, ()):
                found[fixes_row["axis"], fixes_row["protection_m"], fixes_row["error_m"]] += fixes_row["fixes"]
    except KeyboardInterrupt:
        interrupted = True
    for (axis, protection_m, error_m), fixes in sorted(found.items(), key=lambda one: (len(str(one[1])), one)):
        size = {"fixes": fixes, "fixes_from": 10 ** (len(str(fixes)) - 1)}
        yield {"axis": axis, "protection_m": protection_m, "error_m": error_m, **size}
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
