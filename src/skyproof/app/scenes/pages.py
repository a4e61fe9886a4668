"""The pages of the documentation that are drawn: one for each ready-made scene, and one on generated errors."""

from importlib.metadata import version
from pathlib import Path

from skyproof.app.common.folder import claim
from skyproof.app.common.progress import Progress, Silent
from skyproof.app.scenes.scene_page import write_page
from skyproof.app.scenes.simulate import load_scenario
from skyproof.formats.atomic_write import write_lines
from skyproof.report.stability import AllanCurve, write_stability_html
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.scenario import Scenario
from skyproof.simulator.stability import Stability, measure_clock_stability, measure_imu_stability
from skyproof.simulator.standalone import override

__all__ = ["ERRORS_PAGE", "plot", "write_pages", "write_stability_page"]

ERRORS_PAGE = "errors.html"


def plot(
    scenario: str | Path | Scenario, *, folder: Path = Path(), seed: int | None = None, duration_s: float | None = None
) -> Path:
    """Write the page of a scene as NAME.html, and nothing else; the arguments are those of `simulate`.

    Raises
    ------
    ScenarioError : the scenario cannot be read, is not known, or makes no sense.
    OutputError : the page cannot be written.
    """
    made = override(load_scenario(scenario), seed=seed, duration_s=duration_s)
    path = folder / f"{made.name}.html"
    write_page(path, made, make_navigation(made))
    return path


def write_stability_page() -> str:
    """Draw Allan deviations of generated clocks and inertial units beside theory."""
    imus, clocks = measure_imu_stability(), measure_clock_stability()
    plots = [
        (f"{heading.capitalize()}s", found[0].unit, tuple(map(_curve, found)))
        for heading, found in (
            ("accelerometer", [curve for curve in imus if curve.what == "accelerometer"]),
            ("gyro", [curve for curve in imus if curve.what == "gyro"]),
            ("oscillator", clocks),
        )
    ]
    return write_stability_html(plots, f"Drawn by skyproof {version('skyproof')}.")


def _curve(one: Stability) -> AllanCurve:
    return AllanCurve(
        name=one.name, tau_s=one.tau_s, deviation=one.deviation, lower=one.lower, upper=one.upper, theory=one.theory
    )


def write_pages(folder: str | Path, *, progress: Progress | None = None) -> list[Path]:
    """Write NAME.html of every ready-made scene and errors.html into `folder`, which is made if need be.

    Raises OutputError if the folder cannot be written.
    """
    folder, progress = Path(folder), progress or Silent()
    names = list(scenes.load_ready_made())
    paths = []
    with claim(folder), progress.stage("drawing scenes", len(names) + 1) as stage:
        for number, name in enumerate(names, 1):
            paths.append(plot(name, folder=folder))
            stage.advance(number)
        paths.append(folder / ERRORS_PAGE)
        write_lines(paths[-1], [write_stability_page()], end="", encoding="utf-8")
        stage.advance(len(names) + 1)
    return paths
