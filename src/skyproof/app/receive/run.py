"""Track every signal in recordings and write what was measured, without judging it."""

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from skyproof.app.common.folder import claim, require_free
from skyproof.app.common.kernels import RECEIVING, make_ready
from skyproof.app.common.progress import Progress, Silent
from skyproof.app.common.rinex import first_epoch_utc, group_by_transmission, is_ours, write_channels
from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.app.receive.inputs import list_paths, open_inputs, require_recordings
from skyproof.app.receive.reception import Reception, observe, require_signals
from skyproof.app.receive.time_tag import select_first_copies
from skyproof.app.receive.tracker import track
from skyproof.errors import IncompleteOutput, NotEnoughData
from skyproof.formats.atomic_write import OutputStep, Unwritten, describe_missing, write_in_turn
from skyproof.formats.pieces import UNFINISHED_RUN, Workspace, is_unfinished
from skyproof.formats.rinex_nav import read_nav, write_nav
from skyproof.gnss.time import format_iso
from skyproof.interruption import defer, has_come
from skyproof.navigation.fix import fix
from skyproof.records import FixStatus, NavigationData, ObservationLog, Observations, SignalId
from skyproof.short_repr import ShortRepr, write_notebook_html

__all__ = ["ReceiveResult", "list_signals", "receive", "write_document_json"]

DIGITS: Final = 6  # of a second in instants
HEADER_FIXES: Final = 25  # about so many make the approximate position of a header


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReceiveResult(ShortRepr):
    """What each receiver received, the folder with its files, and whether a signal (Ctrl-C) ended it early.

    Measurements of a recording longer than some 13 minutes are on a disk as long as this is held, or if a folder was
    given until its files are written.

    signals : of each receiver, a row a signal.
    files : of each receiver, the names of what was written into the folder.
    """

    receptions: tuple[Reception, ...]
    signals: tuple[tuple[dict[str, Any], ...], ...]
    folder: Path | None = None
    files: tuple[tuple[str, ...], ...] = ()
    interrupted: bool = False

    @property
    def observations(self) -> ObservationLog:
        """Return the observations of the first receiver.

        Raises
        ------
        NotEnoughData : it has none, as where no time of week could be decoded; `receptions` says why of each.
        """
        reception = self.receptions[0]
        if reception.observations is None:
            raise NotEnoughData(
                f"{reception.source.path or reception.source.name}: no observations: {reception.left_out}"
            )
        return reception.observations

    def _repr_html_(self) -> str:
        """Show the signals of each receiver in a notebook."""
        heads, rows = [], []
        for r, signals in zip(self.receptions, self.signals, strict=True):
            heads.append(
                f"{r.source.name}: {r.n_signals} signals in {r.examined_s:.1f} s"
                + (f"; left out: {r.left_out}" if r.left_out is not None else "")
            )
            for signal in signals:
                cn0_dbhz, doppler_hz = signal["cn0_dbhz"], signal["doppler_hz"]
                rows.append(
                    (
                        r.source.name,
                        f"{signal['sat']} {signal['band']} {signal['code']} {signal['copy']}",
                        f"{signal['found_s']:.1f}",
                        str(signal["n_epochs"]),
                        "" if cn0_dbhz is None else f"{cn0_dbhz:.1f}",
                        "" if doppler_hz is None else f"{doppler_hz:.0f}",
                    )
                )
        columns = ("receiver", "signal", "found after, s", "epochs", "C/N0, dB-Hz", "Doppler, Hz")
        return write_notebook_html("Received", heads, (columns, rows))


def receive(
    *inputs: str | Path | Iterable[str | Path],
    nav: str | Path | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> ReceiveResult:
    """Track every signal in one or several recordings, without judging it.

        observations = sp.receive("rx1.bin", nav="brdc0010.22n").observations
        print(observations.signals, observations.pseudorange_m.shape)

    Parameters
    ----------
    inputs : recordings, one per receiver, as arguments or in a list: raw samples with their sidecar
        NAME.toml, or SigMF.
    nav : RINEX navigation file of that day; without one the orbits come from the signals.
    out : folder for NAME.obs, NAME-2.obs (second signals of satellites) and so on, and NAME-nav.rnx; None writes
        nothing.
    overwrite : whether files of these names that were made by skyproof may be replaced; those of others never are.
    progress : is called with how far the work is.
    options : `start_s`, `duration_s`, `doppler_max_hz`, `place_deg` and `tracking` of
        `skyproof.app.common.settings.Settings`.

    Returns
    -------
    ReceiveResult : `receptions`, one per receiver; `observations` are those of the first.

    Raises
    ------
    InputError : an input cannot be read.
    NotEnoughData : no signal in any recording.
    SettingsError : an option makes no sense.
    OutputError : the folder cannot be written, or holds what would be overwritten.
    IncompleteOutput : not all files could be written, and `result` of the error is what would have been returned.
    """
    progress = progress or Silent()
    settings = resolve_settings(None, **options)
    paths = list_paths(inputs)
    if out is None:
        return _receive(paths, nav, None, overwrite, settings, progress)[0]
    with claim(out) as claimed:
        result, unwritten = _receive(paths, nav, claimed.path, overwrite, settings, progress)
    if unwritten:
        raise IncompleteOutput(describe_missing(claimed.path, unwritten), result)
    return result


def _receive(
    paths: Sequence[Path],
    nav: str | Path | None,
    out: Path | None,
    overwrite: bool,
    settings: Settings,
    progress: Progress,
) -> tuple[ReceiveResult, tuple[Unwritten, ...]]:
    """Receive the recordings, and list the files that could not be written into the folder `out`."""
    recordings = require_recordings(open_inputs(paths, settings))
    earlier = (
        ()
        if out is None
        else _require_outputs_free(out, [recording.name for recording in recordings], overwrite=overwrite)
    )
    navigation = None if nav is None else read_nav(Path(nav))
    make_ready(RECEIVING, progress)
    with defer(), Workspace(out) as workspace:
        trackers, interrupted = track(recordings, settings, progress, navigation, watchful=False, workspace=workspace)
        if not interrupted:
            require_signals(trackers)
        receptions = tuple(observe(tracker, navigation, workspace=workspace) for tracker in trackers)
        signals = tuple(list_signals(r.observations) for r in receptions)
        if out is None:
            return ReceiveResult(receptions=receptions, signals=signals, interrupted=has_come()), ()
        steps = [_steps(reception, navigation) for reception in receptions]
        unwritten = write_in_turn(out, [step for each in steps for step in each], instead_of=earlier)
        missing = {name for each in unwritten for name in each.names}
        files = tuple(tuple(n for step in each for n in step.names if n not in missing) for each in steps)
        result = ReceiveResult(receptions=receptions, signals=signals, folder=out, files=files, interrupted=has_come())
        return result, unwritten


def _require_outputs_free(folder: Path, names: Sequence[str], *, overwrite: bool) -> list[str]:
    """Return the files that earlier runs on recordings of these names wrote.

    Raises OutputError as `require_free` does.
    """
    outputs = re.compile(rf"({'|'.join(map(re.escape, names))})(-nav\.rnx|(-\d+)?\.obs)")
    present = [path for path in folder.iterdir() if outputs.fullmatch(path.name)]
    taken, earlier = [path.name for path in present], [path.name for path in present if is_ours(path)]
    if (folder / UNFINISHED_RUN).exists() and not is_unfinished(folder):
        taken.append(UNFINISHED_RUN)
    require_free(folder, taken, earlier, "what was received earlier", overwrite=overwrite)
    return earlier


def _steps(reception: Reception, navigation: NavigationData | None) -> list[OutputStep]:
    """Write one receiver's orbits and signals; of a satellite with several signals each into a file of its own."""
    steps = []
    orbits = navigation if navigation is not None else reception.decoded
    if orbits.ephemerides:
        name = f"{reception.source.name}-nav.rnx"
        steps.append(OutputStep((name,), partial(_write_orbits, reception, orbits, name)))
    o = reception.observations
    for number, signals in enumerate(() if o is None else group_by_transmission(o), 1):
        name = f"{reception.source.name}.obs" if number == 1 else f"{reception.source.name}-{number}.obs"
        steps.append(OutputStep((name,), partial(_write_signals, reception, orbits, signals, name)))
    return steps


def _write_orbits(reception: Reception, orbits: NavigationData, name: str, folder: Path) -> None:
    write_nav(folder / name, orbits, created=first_epoch_utc([reception.observations]))


def _write_signals(
    reception: Reception, orbits: NavigationData, signals: tuple[SignalId, ...], name: str, folder: Path
) -> None:
    o = reception.observations
    assert o is not None
    write_channels(folder / name, o, "unjudged", _estimate_place_ecef_m(o, orbits), signals)


def _estimate_place_ecef_m(o: ObservationLog, orbits: NavigationData) -> Any:
    """Estimate the place (3,) by the first copies, unjudged like them; None without a fix."""
    step = max(o.gpst.size // HEADER_FIXES, 1)
    some = Observations.join([o.read(row, row + 1) for row in range(0, o.gpst.size, step)])
    fixes = fix(some, orbits, signals=select_first_copies(some))
    good = fixes.status == FixStatus.OK
    return np.median(fixes.position_ecef_m[good], axis=0) if good.any() else None


def write_document_json(result: ReceiveResult) -> str:
    """Write what was received as one JSON document. Keys in order, numbers unrounded, null for what is absent."""
    document = {
        "format": "skyproof-receive/1",
        "version": version("skyproof"),
        "interrupted": result.interrupted,
        "folder": None if result.folder is None else str(result.folder),
        "receivers": [
            _receiver(reception, signals, names)
            for reception, signals, names in zip(
                result.receptions, result.signals, result.files or [()] * len(result.receptions), strict=True
            )
        ],
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _receiver(reception: Reception, signals: tuple[dict[str, Any], ...], files: tuple[str, ...]) -> dict[str, Any]:
    source = reception.source
    return {
        "name": source.name,
        "path": source.path,
        "examined_s": reception.examined_s,
        "n_signals": reception.n_signals,
        "left_out": reception.left_out,
        "signals": list(signals),
        "messages_differ": list(reception.messages_differ),
        "satellites_with_orbits": sorted({ephemeris.sat for ephemeris in reception.decoded.ephemerides}),
        "remarks": [*source.remarks, *reception.noted],
        "files": list(files),
    }


def list_signals(o: ObservationLog | None) -> tuple[dict[str, Any], ...]:
    """List the signals of a receiver in rows."""
    return () if o is None else tuple(_describe_signal(o, column) for column in range(len(o.signals)))


def _describe_signal(o: ObservationLog, column: int) -> dict[str, Any]:
    """Describe one signal; without a pseudorange it never gave a time."""
    signal, received = o.signals[column], np.flatnonzero(o.measured[:, column])
    is_received = received.size > 0
    return {
        "sat": signal.sat,
        "band": signal.band,
        "code": signal.code,
        "copy": signal.copy,
        "found_s": float(o.found_elapsed_s[column]),
        "first_gpst": format_iso(o.gpst[received[0]], DIGITS) if is_received else None,
        "last_gpst": format_iso(o.gpst[received[-1]], DIGITS) if is_received else None,
        "n_epochs": int(received.size),
        "cn0_dbhz": float(np.median(o.series("cn0_dbhz", column)[received])) if is_received else None,
        "doppler_hz": float(np.median(o.series("doppler_hz", column)[received])) if is_received else None,
    }
