"""The demonstration: simulate two receivers that are jammed, then led away, protect them, write the report."""

from collections.abc import Sequence
from pathlib import Path

from skyproof.app.common.folder import check_folder, stamps, written_since
from skyproof.app.common.kernels import RECEIVING, make_ready
from skyproof.app.common.progress import Progress, Silent
from skyproof.app.protect import ProtectResult, protect
from skyproof.formats.atomic_write import write_lines
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.time import utc_from_gpst
from skyproof.simulator import scenes
from skyproof.simulator.files import write

__all__ = ["demo"]


def _catalogue(recordings: Sequence[Path], nav: Path) -> list[str]:
    """Each receiver alone, and both together, for `skyproof fleet`."""
    each = [f"{one.stem},{one.name},{nav.name}" for one in recordings]
    return ["name,inputs,nav", *each, f"both,{';'.join(one.name for one in recordings)},{nav.name}"]


def demo(out: str | Path, *, progress: Progress | None = None, seed: int = 1) -> ProtectResult:
    """Recordings, navigation file and truth go into `out`, and so do the outputs of `protect`.

    Raises
    ------
    OutputError : the folder cannot be written.
    """
    progress = progress or Silent()
    folder = Path(out)
    check_folder(folder)
    before = stamps(folder)
    make_ready(RECEIVING, progress)
    scenario = scenes.demo(seed=seed)
    navigation = nominal_constellation(scenario.start_gpst)
    nav = folder / "broadcast.rnx"
    write_nav(nav, navigation, created=utc_from_gpst(scenario.start_gpst))
    try:
        with progress.stage("simulating two receivers, jammed and then meaconed", 1.0) as stage:
            recordings = write(scenario, navigation, folder, progress=lambda done, total: stage.advance(done / total))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"interrupted while recordings were simulated; whole in {folder}: {written_since(folder, before)}"
        ) from None
    write_lines(folder / "catalogue.csv", _catalogue(recordings, nav))
    return protect(recordings, nav=nav, out=folder, progress=progress)
