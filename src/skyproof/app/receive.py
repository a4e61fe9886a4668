"""Track every signal in recordings and write what was measured, without judging it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from skyproof.app.folder import check_folder
from skyproof.app.progress import Progress, Silent
from skyproof.app.reception import Reception, observe, open_inputs, require_signals, track
from skyproof.app.rinex import one_a_satellite, write_channels
from skyproof.app.settings import resolve_settings
from skyproof.formats.rinex_nav import read_nav, write_nav
from skyproof.gnss.time import iso
from skyproof.records import NavigationData, Observations

__all__ = ["ReceiveResult", "document_json", "receive"]

DIGITS: Final = 6  # of a second in instants


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceiveResult:
    """What each receiver heard, the folder with its files, and whether Ctrl-C ended it early.

    files : of each receiver, the names of what was written into the folder.
    """

    receptions: tuple[Reception, ...]
    folder: Path | None = None
    files: tuple[tuple[str, ...], ...] = ()
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
    trackers, interrupted = track(recordings, settings, progress, navigation, watchful=False)
    if not interrupted:
        require_signals(trackers)
    receptions = tuple(observe(tracker, navigation) for tracker in trackers)
    folder = None if out is None else Path(out)
    return ReceiveResult(
        receptions=receptions, folder=folder, interrupted=interrupted,
        files=() if folder is None else tuple(_written(folder, reception, navigation) for reception in receptions),
    )  # fmt: skip


def _written(folder: Path, reception: Reception, navigation: NavigationData | None) -> tuple[str, ...]:
    """Write one receiver's orbits and signals; of a satellite with several signals each into a file of its own."""
    names = []
    orbits = navigation if navigation is not None else reception.told
    if orbits.ephemerides:
        names.append(f"{reception.samples.name}-nav.rnx")
        write_nav(folder / names[-1], orbits)
    o = reception.observations
    if o is not None:
        for number, signals in enumerate(one_a_satellite(o)):
            names.append(f"{o.receiver}.obs" if number == 0 else f"{o.receiver}-{number + 1}.obs")
            write_channels(folder / names[-1], o, "unjudged", None, signals)
    return tuple(names)


def document_json(result: ReceiveResult) -> str:
    """What was received as one JSON document: keys in order, numbers unrounded, null for what is absent."""
    document = {
        "format": "skyproof-receive/1",
        "version": version("skyproof"),
        "interrupted": result.interrupted,
        "folder": None if result.folder is None else str(result.folder),
        "receivers": [
            _receiver(reception, names)
            for reception, names in zip(result.receptions, result.files or [()] * len(result.receptions), strict=True)
        ],
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _receiver(reception: Reception, files: tuple[str, ...]) -> dict[str, Any]:
    o, samples = reception.observations, reception.samples
    return {
        "name": samples.name,
        "path": samples.path,
        "examined_s": reception.examined_s,
        "n_signals": reception.n_signals,
        "left_out": reception.left_out,
        "signals": [] if o is None else [_signal(o, column) for column in range(len(o.signals))],
        "messages_differ": list(reception.messages_differ),
        "satellites_with_orbits": sorted({ephemeris.sat for ephemeris in reception.told.ephemerides}),
        "remarks": [*samples.remarks, *reception.remarks],
        "files": list(files),
    }


def _signal(o: Observations, column: int) -> dict[str, Any]:
    """One signal; without a pseudorange it never told a time."""
    signal, heard = o.signals[column], np.flatnonzero(np.isfinite(o.pseudorange_m[:, column]))
    there = heard.size > 0
    return {
        "sat": signal.sat,
        "band": signal.band,
        "code": signal.code,
        "copy": signal.copy,
        "found_s": float(o.found_elapsed_s[column]),
        "first_gpst": iso(o.gpst[heard[0]], DIGITS) if there else None,
        "last_gpst": iso(o.gpst[heard[-1]], DIGITS) if there else None,
        "n_epochs": int(heard.size),
        "cn0_dbhz": float(np.median(o.cn0_dbhz[heard, column])) if there else None,
        "doppler_hz": float(np.median(o.doppler_hz[heard, column])) if there else None,
    }
