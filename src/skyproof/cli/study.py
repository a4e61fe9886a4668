"""`skyproof study`."""

import difflib
import json as json_text
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from rich.console import Console
from rich.text import Text

from skyproof.app.common.platform import read_platform
from skyproof.app.common.platform_antennas import build_arrays, build_spin_arms
from skyproof.cli.options import Debug, OneDocument
from skyproof.cli.progress import progress
from skyproof.cli.screen import complain, print_document, print_path, print_table, table
from skyproof.errors import OutputError, SettingsError
from skyproof.formats.atomic_write import write_lines
from skyproof.interruption import get_exit_code
from skyproof.report.chart import draw_chart_svg
from skyproof.studies import studies
from skyproof.studies.base import COLUMNS, Row, Study, StudySettings
from skyproof.studies.validation import check
from skyproof.studies.validation import table as validation_table

__all__ = ["study"]


def study(
    name: Annotated[str | None, Parameter(name="NAME", help="A study that --list shows, as in spin.roc.")] = None,
    /,
    *,
    list_studies: Annotated[
        bool, Parameter(name="--list", help="List the studies with paper and figure instead.")
    ] = False,
    trials: Annotated[int | None, Parameter(help="Number of trials. Default: the study's.")] = None,
    seed: Annotated[
        int,
        Parameter(
            help="Random seed. The same seed gives the same rows, except for run times (ms, seconds).",
            show_default=True,
        ),
    ] = 1,
    quick: Annotated[bool, Parameter(help="Fewer trials: 20 s at most.")] = False,
    platform: Annotated[
        Path | None,
        Parameter(
            help="Platform file with the antennas_m or spin of your receivers, for geometry.array, geometry.arm."
        ),
    ] = None,
    plot: Annotated[bool, Parameter(help="Draw the rows as a chart, NAME.svg, here or in the --out folder.")] = False,
    out: Annotated[Path | None, Parameter(help="Folder for NAME.json, the document that --json prints.")] = None,
    validation: Annotated[
        Path | None, Parameter(help="Run all studies and write the table of all figures here, in Markdown, instead.")
    ] = None,
    json: OneDocument = False,
    debug: Debug = False,
) -> int:
    """Reproduce a figure of a paper, with the figures of skyproof beside it."""
    found = studies()
    settings = _settings(trials, seed, quick)
    if list_studies:
        _print_studies(found, as_json=json)
        return 0
    if validation is not None:
        lines = _validation(found, settings).splitlines()
        write_lines(validation, lines, encoding="utf-8")
        print_path("table:", validation)
        return 0
    chosen = _find_study(name, found)
    settings = _on_platform(chosen, settings, platform)
    if out is not None:
        _make(out)
        settings = replace(settings, folder=out)
    rows, interrupted = _run(chosen, settings)
    document = _document(chosen, settings, rows, interrupted=interrupted)
    if json:
        print_document(document)
    else:
        _print_result(chosen, rows, whole=not interrupted)
    folder = out if out is not None else Path()
    if out is not None:
        write_lines(folder / f"{chosen.name}.json", document.splitlines(), encoding="utf-8")
    if plot and not chosen.charts:
        complain(f"{chosen.name} has no chart: its rows are above" + (f", and in {folder}" if out is not None else ""))
    elif plot:
        path = folder / f"{chosen.name}.svg"
        write_lines(path, str(draw_chart_svg(rows, chosen.charts)).splitlines(), encoding="utf-8")
        if not json:
            print_path("chart:", path)
    return get_exit_code() if interrupted else 0


def _settings(trials: int | None, seed: int, quick: bool) -> StudySettings:
    if trials is not None and trials < 1:
        raise SettingsError(f"--trials is {trials}, expected 1 or more; leave it out for the study's own number")
    if seed < 0:
        raise SettingsError(f"--seed is {seed}, expected 0 or more; give another one")
    return StudySettings(trials=trials, seed=seed, quick=quick)


def _on_platform(chosen: Study, settings: StudySettings, platform: Path | None) -> StudySettings:
    """Add the arrays and arms of the platform file, if one is given."""
    if platform is None:
        return settings
    if chosen.platform is None:
        raise SettingsError(f"{chosen.name} takes no --platform; geometry.array and geometry.arm do")
    receivers = read_platform(platform).receivers
    tables = {receiver.name or f"receiver {number}": receiver for number, receiver in enumerate(receivers, 1)}
    arrays = build_arrays(
        tables, {name: len(receiver.antennas_m or ()) for name, receiver in tables.items()}, str(platform)
    )
    arms = build_spin_arms(tables)
    if not (arrays if chosen.platform == "antennas_m" else arms):
        raise SettingsError(f"{platform}: no receiver has {chosen.platform}, which {chosen.name} needs; give it there")
    return replace(settings, arrays=arrays, arms=arms)


def _find_study(name: str | None, found: Mapping[str, Study]) -> Study:
    if name is None:
        raise SettingsError("NAME is missing: give a study that `skyproof study --list` shows")
    if name in found:
        return found[name]
    same_paper = [other for other in found if other.startswith(f"{name.split('.')[0]}.")]
    near = difflib.get_close_matches(name, found, n=3, cutoff=0.4)
    nearest = list(dict.fromkeys([*near, *same_paper]))[:8]
    hint = f"nearest: {', '.join(nearest)}" if nearest else "`skyproof study --list` shows all"
    raise SettingsError(f"no study is named {name!r}; {hint}")


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); name another folder with --out") from error


def _run(chosen: Study, settings: StudySettings) -> tuple[list[Row], bool]:
    """Run the study, and return its rows, and whether it was interrupted."""
    rows: list[Row] = []
    try:
        with progress().stage(f"rows of {chosen.name}", None) as stage:
            for row in chosen.run(replace(settings, report=stage.advance)):
                rows.append(row)
                stage.advance(len(rows))
    except KeyboardInterrupt:
        complain(f"interrupted with {len(rows)} row{'s' * (len(rows) != 1)} ready")
        return rows, True
    return rows, False


def _validation(found: Mapping[str, Study], settings: StudySettings) -> str:
    """Make the table of all figures, and report progress in studies."""
    display, begun = progress(), list(found)
    try:
        with display.stage("making the table of all figures", len(found)) as stage:

            def before(name: str) -> None:
                stage.advance(begun.index(name))
                display.say(name)

            return validation_table(found, settings, before=before)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("interrupted: not all studies were run, no table was written") from None


def _document(chosen: Study, settings: StudySettings, rows: Sequence[Row], *, interrupted: bool) -> str:
    claims = [] if interrupted else check(chosen, rows)
    document = {
        "format": "skyproof-study/1",
        "version": version("skyproof"),
        "study": chosen.name,
        "title": chosen.title,
        "paper": chosen.paper,
        "figure": chosen.figure,
        "seed": settings.seed,
        "trials": settings.trials,
        "quick": settings.quick,
        "interrupted": interrupted,
        "rows": [{key: _plain(value) for key, value in row.items()} for row in rows],
        "claims": [
            {
                "what": checked.claim.what,
                "paper": _plain(checked.claim.paper),
                "same": _plain(checked.same),
                "better": _plain(checked.better),
                "protect": _plain(checked.protect),
                "reference": _plain(checked.claim.reference),
                "tolerance": _plain(checked.tolerance),
                "agrees": checked.agrees,
            }
            for checked in claims
        ],
    }
    return json_text.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """Convert NumPy's numbers to Python's; what is not a number to null."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, list | tuple):
        return [_plain(element) for element in value]
    return value


def _print_result(chosen: Study, rows: Sequence[Row], *, whole: bool) -> None:
    console = Console()
    console.print(Text(f"{chosen.name}: {chosen.title}", style="bold"))
    console.print(Text(f"{chosen.paper}; {chosen.figure}", style="dim"))
    keys = list(dict.fromkeys(key for row in rows for key in row))
    words = [key for key in keys if any(isinstance(row.get(key), str) for row in rows)]
    listed = table(*keys)
    for column, key in zip(listed.columns, keys, strict=True):
        column.justify = "left" if key in words else "right"
        column.overflow = "fold"
    for row in rows:
        listed.add_row(*(Text(_cell(row.get(key))) for key in keys))
    print_table(console, listed)
    claims = check(chosen, rows) if whole else []
    if claims:
        claims_table = table("what", *COLUMNS, "agrees")
        for checked in claims:
            claims_table.add_row(Text(checked.claim.what), *(Text(cell.replace("*", "")) for cell in checked.cells()))
        console.print()
        print_table(console, claims_table)


def _cell(value: Any) -> str:
    value = _plain(value)
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _print_studies(found: Mapping[str, Study], *, as_json: bool) -> None:
    if as_json:
        listed = [{"study": s.name, "title": s.title, "paper": s.paper, "figure": s.figure} for s in found.values()]
        document = {"format": "skyproof-studies/1", "version": version("skyproof"), "studies": listed}
        print_document(json_text.dumps(document, indent=2, ensure_ascii=False) + "\n")
        return
    console, paper = Console(), None
    papers = dict.fromkeys(listed_study.paper for listed_study in found.values())
    for paper in papers:
        console.print(Text(paper, style="bold"), soft_wrap=True)
        listing = table("study", "figure", "what it makes")
        listing.columns[0].no_wrap = True  # it is to be copied
        for listed_study in found.values():
            if listed_study.paper == paper:
                listing.add_row(Text(listed_study.name), Text(listed_study.figure), Text(listed_study.title))
        print_table(console, listing)
        console.print()
