"""`skyproof simulate`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from skyproof import app
from skyproof.cli.options import Debug, OneDocument, Overwrite
from skyproof.cli.progress import progress
from skyproof.cli.screen import complain, print_document, print_path, print_table, table, words
from skyproof.errors import SettingsError
from skyproof.interruption import get_exit_code

if TYPE_CHECKING:
    from skyproof.app.scenes.simulate import SimulateResult

__all__ = ["simulate"]

SHOWN = 8
"""Names of files of one kind that are listed one by one."""


def simulate(
    scenario: Annotated[
        str | None, Parameter(name="SCENARIO", help="A scenario's TOML file, or the name of a ready-made scene.")
    ] = None,
    /,
    *,
    out: Annotated[
        Path | None,
        Parameter(help="Folder for samples, observations, inertial readings, truth.json and scenario.toml."),
    ] = None,
    list_scenes: Annotated[bool, Parameter(name="--list", help="List the ready-made scenes instead.")] = False,
    seed: Annotated[
        int | None, Parameter(help="Random seed. The same seed gives the same data. Default: the scenario's.")
    ] = None,
    duration_s: Annotated[
        float | None, Parameter(help="Length of the scene. In seconds. Default: the scenario's.")
    ] = None,
    depth: Annotated[
        Literal["samples", "measurements", "all"],
        Parameter(help="Recordings, RINEX observations of every signal, or both.", show_default=True),
    ] = "all",
    container: Annotated[
        Literal["sigmf", "raw"] | None,
        Parameter(name="--format", help="Format of samples. Default: sigmf where it can hold them (8 bits and more)."),
    ] = None,
    log: Annotated[
        Literal["ubx"] | None,
        Parameter(
            help="Beside RINEX: the log of an ordinary receiver at each antenna, which follows the strongest copy of "
            "each signal, in u-blox's UBX."
        ),
    ] = None,
    plot: Annotated[
        bool,
        Parameter(help="Draw the scene as a page, scene.html; without --out only that, NAME.html in this folder."),
    ] = False,
    overwrite: Overwrite = False,
    pages: Annotated[
        Path | None,
        Parameter(help="Folder for the pages of all ready-made scenes, and of generated errors, instead."),
    ] = None,
    json: OneDocument = False,
    debug: Debug = False,
) -> int:
    """Simulate recordings and measurements of a scene with attacks, and write the truth beside them."""
    if list_scenes:
        _print_scenes(as_json=json)
        return 0
    if pages is not None:
        return _draw_all(pages)
    if scenario is None:
        raise SettingsError("SCENARIO is missing: give a TOML file or a name that `skyproof simulate --list` shows")
    if out is None and plot:
        print_path("page:", app.pages.plot(scenario, seed=seed, duration_s=duration_s))
        return 0
    if out is None:
        raise SettingsError("--out is missing: name the folder for what is made, as in --out data")
    result = app.simulate.simulate(
        scenario,
        out=out,
        seed=seed,
        duration_s=duration_s,
        depth=depth,
        container=container,
        log=log,
        plot=plot,
        overwrite=overwrite,
        progress=progress(),
    )
    if result.interrupted:
        complain(f"interrupted: {len(result.files)} files in {out} are complete, the others are missing")
    if json:
        print_document(app.simulate.write_document_json(result))
    else:
        _print_result(result)
    return get_exit_code() if result.interrupted else 0


def _draw_all(folder: Path) -> int:
    try:
        drawn = app.pages.write_pages(folder, progress=progress())
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"interrupted: not all pages were drawn; those in {folder} are whole") from None
    print_path(f"{len(drawn)} pages in", folder)
    return 0


def _print_result(result: "SimulateResult") -> None:
    console, made = Console(), result.scenario
    console.print(words(made.name, style="bold"))
    if made.description:
        console.print(words(made.description))
    attacks = ", ".join(made.attack_names) or "none"
    console.print(words(f"{made.duration_s:g} s, seed {made.seed}, attacks: {attacks}", style="dim"))
    kinds = (("recording", result.recordings), ("observations", result.observations), ("log", result.logs))
    for name, paths in kinds:
        for path in paths[:SHOWN]:
            print_path(f"{name}:", path)
        if len(paths) > SHOWN:
            console.print(words(f"  and {len(paths) - SHOWN} more"))
    print_path("truth:", result.folder / "truth.json")
    if app.scene_page.PAGE in result.files:
        print_path("page:", result.folder / app.scene_page.PAGE)
    print_path("the same again: skyproof simulate --out FOLDER", result.folder / "scenario.toml")


def _print_scenes(*, as_json: bool) -> None:
    if as_json:
        print_document(app.simulate.write_ready_made_json())
        return
    listed = table("scene", "what happens")
    for scene in app.simulate.load_ready_made().values():
        listed.add_row(words(scene.name), words(scene.title))
    print_table(Console(), listed)
