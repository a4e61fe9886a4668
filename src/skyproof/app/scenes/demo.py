"""The demonstration: simulate two receivers that are jammed, then led away, protect them, write the report."""

from collections.abc import Sequence
from pathlib import Path

from skyproof.app.common.folder import claim, list_new_files, list_stamps, require_free
from skyproof.app.common.kernels import RECEIVING, make_ready
from skyproof.app.common.progress import Progress, Silent
from skyproof.app.protect import ProtectResult, protect
from skyproof.app.protect.outputs import require_outputs_free
from skyproof.app.scenes.simulate import read_earlier_scene
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import utc_from_gpst
from skyproof.simulator import scenes
from skyproof.simulator.files import write
from skyproof.simulator.scenario import Scenario

__all__ = ["demo"]

TRUTH, NAVIGATION, CATALOGUE = "truth.json", "broadcast.rnx", "catalogue.csv"


def _write_catalogue(recordings: Sequence[Path], nav: Path) -> list[str]:
    """Write each receiver alone, and both together, as a catalogue for `skyproof fleet`."""
    each = [f"{recording.stem},{recording.name},{nav.name}" for recording in recordings]
    return ["name,inputs,nav", *each, f"both,{';'.join(recording.name for recording in recordings)},{nav.name}"]


def demo(out: str | Path, *, overwrite: bool = False, progress: Progress | None = None, seed: int = 1) -> ProtectResult:
    """Simulate the demonstration into `out` and protect it there.

    Recordings, navigation file and truth stand beside the outputs of `protect`.

    overwrite : whether an earlier demonstration there may be replaced.

    Raises
    ------
    OutputError : the folder cannot be written, or holds what would be overwritten.
    """
    progress = progress or Silent()
    with claim(out) as claimed:
        scenario = scenes.make_demo(seed=seed)
        _require_free(claimed.path, scenario, overwrite=overwrite)
        recordings, nav = _simulate(scenario, claimed.path, progress)
        return protect(recordings, nav=nav, out=claimed, overwrite=overwrite, progress=progress)


def _require_free(folder: Path, scenario: Scenario, *, overwrite: bool) -> None:
    """Raise OutputError if the demonstration would overwrite what is in the folder, as `require_free` says."""
    names = [f"{receiver.name}{ending}" for receiver in scenario.receivers for ending in (".bin", ".toml")]
    taken = [name for name in (*names, TRUTH, NAVIGATION, CATALOGUE) if (folder / name).exists()]
    earlier = taken if read_earlier_scene(folder)[0] == scenario.name else []
    require_free(folder, taken, earlier, "an earlier demonstration", overwrite=overwrite)
    require_outputs_free(folder, overwrite=overwrite)


def _simulate(scenario: Scenario, folder: Path, progress: Progress) -> tuple[list[Path], Path]:
    """Simulate the recordings and the navigation file."""
    before = list_stamps(folder)
    make_ready(RECEIVING, progress)
    navigation = make_nominal_constellation(scenario.start_gpst)
    nav = folder / NAVIGATION
    try:
        with progress.stage("simulating two receivers, jammed and then meaconed", 1.0) as stage:
            recordings = write(scenario, navigation, folder, progress=lambda done, total: stage.advance(done / total))
        write_nav(nav, navigation, created=utc_from_gpst(scenario.start_gpst))
        write_lines(folder / CATALOGUE, _write_catalogue(recordings, nav))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"interrupted while recordings were simulated; whole in {folder}: {list_new_files(folder, before)}"
        ) from None
    return recordings, nav
