"""Track every signal in recordings and write what was measured, without judging it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skyproof.app.outputs import check_folder, write_received
from skyproof.app.progress import Progress, Silent
from skyproof.app.reception import Reception, observe, open_inputs, require_signals, track
from skyproof.app.settings import resolve_settings
from skyproof.formats.rinex_nav import read_nav

__all__ = ["ReceiveResult", "receive"]


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiveResult:
    """What each receiver heard, the folder with its files, and whether Ctrl-C ended it early."""

    receptions: tuple[Reception, ...]
    folder: Path | None = None
    interrupted: bool = False

    @property
    def observations(self) -> Any:
        """Those of the first receiver; None if no time of week could be decoded."""
        return self.receptions[0].observations


def receive(
    inputs: str | Path | Sequence[str | Path],
    *,
    nav: str | Path | None = None,
    out: str | Path | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> ReceiveResult:
    """Track everything in one or several recordings.

    Parameters and errors are those of `protect`; outputs are RINEX observation files, one a receiver and copy, and a
    navigation file.
    """
    progress = progress or Silent()
    settings = resolve_settings(None, **options)
    if out is not None:
        check_folder(Path(out))
    paths = [inputs] if isinstance(inputs, str | Path) else list(inputs)
    recordings = open_inputs([Path(p) for p in paths], settings)
    navigation = None if nav is None else read_nav(Path(nav))
    trackers, interrupted = track(recordings, settings, progress, watchful=False)
    if not interrupted:
        require_signals(trackers)
    receptions = tuple(observe(tracker, navigation) for tracker in trackers)
    if out is not None:
        write_received(Path(out), receptions, navigation)
    return ReceiveResult(
        receptions=receptions, folder=None if out is None else Path(out), interrupted=interrupted
    )  # fmt: skip
