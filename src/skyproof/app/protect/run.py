"""The main job: recordings and observations in, spoofed signals named, the true position out."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from skyproof.app.common.body import (
    BodyFiles,
    open_body,
    with_imu,
    with_logged_imu,
    with_stored_readings,
)
from skyproof.app.common.folder import ClaimedFolder, claim
from skyproof.app.common.kernels import JUDGING, RECEIVING, make_ready
from skyproof.app.common.memory import give_back
from skyproof.app.common.platform import Platform, read_platform
from skyproof.app.common.platform_antennas import build_arrays
from skyproof.app.common.platform_use import derive_settings, match_tables, select_inputs
from skyproof.app.common.progress import Progress, Silent, Stage
from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.app.common.windows import asked
from skyproof.app.protect.behind_null import recover_behind_nulls
from skyproof.app.protect.document import document
from skyproof.app.protect.explanation import why_untested
from skyproof.app.protect.judging import judge
from skyproof.app.protect.orbits import add_logged_orbits, list_missing_orbits, require_same_day
from skyproof.app.protect.outcome import InputNote, Outcome
from skyproof.app.protect.outputs import require_outputs_free, write_outputs
from skyproof.app.protect.predictors import build_antenna_units, build_unit
from skyproof.app.protect.preview import Preview
from skyproof.app.protect.so_far import NOTES, WordsSoFar
from skyproof.app.protect.stated import Stated, find_span
from skyproof.app.receive.inputs import adopt_antenna_multipath, list_antennas, list_paths, open_inputs
from skyproof.app.receive.observed import ObservedFile, observe_file
from skyproof.app.receive.reception import Reception, observe, overlap_s, require_signals
from skyproof.app.receive.short import is_short, observe_short, require_some
from skyproof.app.receive.tracker import track
from skyproof.errors import IncompleteOutput, InputError, NotEnoughData, SettingsError, make_readable
from skyproof.formats.atomic_write import Unwritten, describe_missing
from skyproof.formats.byte_io import compute_sha256
from skyproof.formats.pieces import Workspace
from skyproof.formats.rinex_nav import read_nav
from skyproof.fusion.policy import POLICY
from skyproof.gnss.time import format_iso, seconds_between
from skyproof.interruption import Stopped, defer, has_come, raise_at_signal
from skyproof.navigation.vector_inertia import AntennaUnit
from skyproof.records import (
    AntennaArray,
    NavigationData,
    OpenFile,
    Samples,
)
from skyproof.remarks import Remark, RemarkKind
from skyproof.short_repr import ShortRepr
from skyproof.verdict import Verdict

__all__ = ["ProtectResult", "protect", "verdict_of"]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ProtectResult(ShortRepr):
    """What `protect` gives: the verdict, the folder with all outputs, and whether a signal (Ctrl-C) ended it early.

    outcome : everything behind the verdict, for a notebook: observations, evidence, fixes, labels. Measurements of a
        long run (4096 epochs and more) are on a disk as long as this is held, or if a folder was given until its
        outputs are written: `signals.parquet` has them.
    """

    verdict: Verdict
    outcome: Outcome
    folder: Path | None = None
    interrupted: bool = False

    def _repr_html_(self) -> str:
        """Show the verdict in a notebook."""
        return self.verdict._repr_html_()


def protect(
    inputs: Sequence[str | Path] = (),
    *,
    nav: str | Path | None = None,
    imu: str | Path | None = None,
    platform: str | Path | None = None,
    out: str | Path | ClaimedFolder | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> ProtectResult:
    """Tell true signals from false ones in what one or several receivers recorded or measured.

    Parameters
    ----------
    inputs : one per receiver: recordings, each with its sidecar NAME.toml, and observation files (RINEX); none if the
        platform file names them.
    nav : RINEX navigation file; without one the orbits come from the signals of recordings.
    imu : inertial readings (CSV or Parquet) in place of the file in [imu] of the platform file.
    platform : TOML file of receivers, their inputs and places, and settings: see `app.common.platform`.
    out : folder for the outputs, made if absent; None writes nothing.
    overwrite : whether what an earlier run wrote there may be replaced; what else is there never is.
    options : any field of `Settings`; None means not given.

    Raises
    ------
    SkyproofError : an input, option or folder that cannot be used, or one that no test can run on; says what to do.
    IncompleteOutput : not all files could be written; its `result` is what would have been returned.
    """
    progress = progress or Silent()
    carrier = with_imu(Platform() if platform is None else read_platform(Path(platform)), imu)
    platform_sum = None if platform is None else compute_sha256(platform)
    settings = resolve_settings(carrier.protect, **options)
    with nullcontext() if out is None else claim(out) as claimed:
        folder = None if claimed is None else claimed.path
        if folder is not None:
            require_outputs_free(folder, overwrite=overwrite)
        given = _Given(inputs, nav, imu, platform, carrier, platform_sum, settings, overwrite)
        result, unwritten = _run(given, folder, progress)
    if folder is not None and unwritten:
        raise IncompleteOutput(describe_missing(folder, unwritten), result)
    return result


@dataclass(frozen=True)
class _Given:
    """What `protect` was given, and what of it was read."""

    inputs: Sequence[str | Path]
    nav: str | Path | None
    imu: str | Path | None
    platform: str | Path | None
    carrier: Platform
    platform_sum: str | None
    settings: Settings
    overwrite: bool


def _run(given: _Given, out: Path | None, progress: Progress) -> tuple[ProtectResult, tuple[Unwritten, ...]]:
    """Return the result, and which of its files could not be written into the folder `out`."""
    nav, platform, carrier, settings = given.nav, given.platform, given.carrier, given.settings
    navigation = None if nav is None else read_nav(Path(nav))
    nav_sum = None if nav is None else compute_sha256(nav)  # now, of what was read: it may be gone at the end
    body_files = open_body(carrier, str(platform or given.imu))
    paths, called = select_inputs(carrier, given.inputs, str(platform))
    with defer(), Workspace(out) as workspace:
        if workspace.removed:
            progress.say(f"{out}: what a run that was killed had found so far (unfinished-run) is removed")
        with raise_at_signal():  # nothing is decided yet
            sources = open_inputs(paths, settings, navigation, called, workspace)
            carrier, body_files = _use_logged_imu(carrier, body_files, sources, str(platform or given.imu))
            body_files = with_stored_readings(body_files, workspace)
            sidecars = _sum_sidecars(sources)
            names = [source.name for source in sources]
            if out is not None:
                require_outputs_free(out, names, overwrite=given.overwrite)
            tables = match_tables(carrier, names, str(platform))
            settings, unused = derive_settings(carrier, settings, names, tables)
            settings = adopt_antenna_multipath(settings, sources)
            arrays = build_arrays(
                tables, {source.name: len(list_antennas(source)) for source in sources}, str(platform)
            )
            _require_two(settings, names)
            navigation = add_logged_orbits(navigation, sources)
            _require_orbits(sources, navigation)
            units = build_antenna_units(build_unit(carrier, body_files, names, tables, _find_first_sample(sources)))
            recorded = any(isinstance(source, Samples) for source in sources)
            make_ready(RECEIVING if recorded else JUDGING, progress)
        stated = Stated(platform=carrier, files=body_files, names=names, tables=tables)
        so_far = WordsSoFar(progress, workspace)
        preview = Preview(stated, navigation, settings, arrays, so_far)
        receptions, interrupted = _receive_all(
            sources, navigation, settings, progress, arrays, workspace, units, preview
        )
        give_back()
        _require_same_time(receptions, navigation)
        no_orbits = () if navigation is None else list_missing_orbits(receptions, navigation)
        receptions = [_add_common_time(r, receptions) for r in receptions]
        ready = stated.equip(receptions, settings)
        receptions, settings, body, unit = list(ready.receptions), ready.settings, ready.body, ready.unit
        outcome, cut_short = judge(
            receptions, navigation, settings, progress, ready.spin_arms, body, ready.predictors, so_far
        )
        interrupted |= cut_short
        outcome = recover_behind_nulls(outcome, sources, navigation, settings, progress, ready.predictors)
        receptions = [r.reception for r in outcome.receivers]
        if (untested := why_untested(outcome)) is not None:
            if interrupted:
                raise KeyboardInterrupt(f"interrupted before any test could run, and nothing was written: {untested}")
            raise NotEnoughData(untested)
        # Whoever interrupts does not wait for the sums of large files.
        sums = {} if has_come() else _sum_files(_list_files(receptions), progress)
        notes = [note for r in receptions for note in _make_notes(r, interrupted, sums)]
        notes += [InputNote(path=path, format="sidecar", sha256=sum_, remarks=()) for path, sum_ in sidecars.items()]
        if nav is not None:
            remarks = _list_navigation_remarks(navigation) + no_orbits
            notes.append(
                InputNote(path=make_readable(str(nav)), format="RINEX navigation", sha256=nav_sum, remarks=remarks)
            )
        for path, kind, remarks in body_files.remarks(
            body, find_span(receptions), None if unit is None else unit.readings
        ):
            notes.append(
                InputNote(path=make_readable(path), format=kind, sha256=body_files.sums[path], remarks=remarks)
            )
        if platform is not None:
            remarks = unused
            notes.append(
                InputNote(
                    path=make_readable(str(platform)), format="platform", sha256=given.platform_sum, remarks=remarks
                )
            )
        verdict = document(outcome, notes, settings, interrupted=interrupted)
        for name in NOTES:
            workspace.drop_notes(name)
        unwritten = () if out is None else _write(out, verdict, outcome, settings, progress)
        return ProtectResult(verdict=verdict, outcome=outcome, folder=out, interrupted=has_come()), unwritten


def _receive_all(
    sources: Sequence[Samples | ObservedFile],
    navigation: NavigationData | None,
    settings: Settings,
    progress: Progress,
    arrays: Mapping[str, AntennaArray],
    workspace: Workspace,
    units: Mapping[str, AntennaUnit],
    preview: Preview,
) -> tuple[list[Reception], bool]:
    """Return what each source's receiver received, in their order, and whether a signal ended the tracking early."""
    recordings = [recording for recording in sources if isinstance(recording, Samples) and not is_short(recording)]
    trackers, interrupted = track(
        recordings,
        settings,
        progress,
        navigation,
        summed=True,
        asked=asked(),
        workspace=workspace,
        units=units,
        look=preview.look if len(recordings) == len(sources) else None,
    )
    if not interrupted and len(recordings) == len(sources) and not any(samples.others for samples in recordings):
        require_signals(trackers)  # an array may hold some behind a null
    tracked = iter(trackers)

    def received(source: Samples | ObservedFile) -> Reception:
        if not isinstance(source, Samples):
            with nullcontext() if trackers else raise_at_signal():  # what was tracked is not lost for it
                return observe_file(source, workspace, navigation)
        array = arrays.get(source.name)
        if is_short(source):
            return observe_short(source, navigation, settings, progress, array)
        return observe(next(tracked), navigation, array, workspace)

    receptions = [received(source) for source in sources]
    if all(is_short(source) for source in sources):
        require_some(receptions)
    return receptions, interrupted


def _use_logged_imu(
    carrier: Platform, files: BodyFiles, sources: list[Samples | ObservedFile], where: str
) -> tuple[Platform, BodyFiles]:
    """Return the platform and its files with the inertial readings of the first receiver's log, where there are any.

    Readings that are none of a unit are reported with the log, and left out, but where the platform file asks for them.
    """
    first = sources[0]
    rows = first.inertial if isinstance(first, ObservedFile) else None
    if isinstance(first, ObservedFile):
        sources[0] = first = replace(first, inertial=None)  # they are not held twice
    try:
        return with_logged_imu(carrier, files, first.path or first.name, rows, where)
    except InputError as error:
        if carrier.imu is not None or not isinstance(first, ObservedFile):
            raise
        unused = Remark(f"its inertial readings are not used: {error}", RemarkKind.BEARS)
        sources[0] = replace(first, remarks=(*first.remarks, unused))
        return carrier, files


def _find_first_sample(sources: Sequence[Samples | ObservedFile]) -> np.datetime64:
    """Return the first start that any recording states; NaT without one."""
    starts = [source.start_gpst for source in sources if isinstance(source, Samples) and source.start_gpst is not None]
    return min(starts, default=np.datetime64("NaT", "ns"))


def verdict_of(
    *inputs: str | Path | Iterable[str | Path],
    nav: str | Path | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    **options: Any,
) -> Verdict:
    """Tell true signals from false ones in what one or several receivers recorded or measured.

        verdict = sp.protect("rx1.bin", "rx2.bin", nav="brdc0010.22n", out="result")
        print(verdict.verdict, verdict.summary)

    Parameters
    ----------
    inputs : one per receiver, separately or together in a list: raw samples with their sidecar NAME.toml, SigMF, or
        a RINEX observation file (2.1x, 3.0x, 4.0x, compact and gzip too). None if the platform file names them.
    nav : RINEX navigation file of that day; without one the orbits come from the signals of recordings (30 s of them).
    out : folder for the verdict, the report, fixes and all other files, made if absent; None writes nothing.
    overwrite : whether what an earlier run wrote there may be replaced.
    options : any field of `skyproof.app.common.settings.Settings`, such as `antenna_separation_m` or `duration_s`;
        `platform`, a TOML file of receivers, their inputs and places, and settings; `progress`, called with how far the
        work is.

    Returns
    -------
    Verdict : what verdict.json holds. `skyproof.app.protect.protect` gives everything behind it as well: observations,
        evidence, fixes.

    Raises
    ------
    InputError : an input cannot be read, or inputs do not belong together.
    NotEnoughData : no signal in any recording, or too little in the inputs for any test.
    SettingsError : an option or setting makes no sense.
    OutputError : the folder cannot be written, or holds what would be overwritten.
    IncompleteOutput : not all files could be written, and `result.verdict` of the error is the verdict.
    """
    return protect(list_paths(inputs), nav=nav, out=out, overwrite=overwrite, **options).verdict


def _write(
    folder: Path, verdict: Verdict, outcome: Outcome, settings: Settings, progress: Progress
) -> tuple[Unwritten, ...]:
    """Write all outputs, and return what could not be; a second signal ends that, and its message names the verdict."""
    try:
        return write_outputs(folder, verdict, outcome, settings, progress)
    except Stopped:
        raise Stopped(f"the verdict is {verdict.verdict!r}, but not all files were written to {folder}") from None


def _require_two(settings: Settings, names: Sequence[str]) -> None:
    """Raise SettingsError if a distance is given for any other number of receivers than two."""
    if settings.antenna_distance_m is not None and len(names) != 2:
        raise SettingsError(
            f"setting antenna_distance_m is the distance between two receivers' antennas, but the receivers are "
            f"{', '.join(names)}; give antennas_enu_m, where each antenna stands"
            + (", or leave it out" if len(names) == 1 else "")
        )


def _require_orbits(sources: Sequence[Samples | ObservedFile], navigation: NavigationData | None) -> None:
    """Raise InputError if nothing gives orbits, or a file has the orbits of another day."""
    for source in sources:
        if navigation is not None and source.start_gpst is not None:
            require_same_day(navigation, source.start_gpst, source)
    files = [source for source in sources if isinstance(source, ObservedFile) and source.ranged]
    if navigation is None and len(files) == len(sources) and not any(file.decoded.ephemerides for file in files):
        raise InputError(
            f"{sources[0].path}: it holds no orbits; give the navigation file of that day (--nav, RINEX), or have the "
            "receiver log the broadcast messages (UBX-RXM-SFRBX)"
        )


def _require_same_time(receptions: Sequence[Reception], navigation: NavigationData | None) -> None:
    """Raise InputError if two receivers were recorded at different times, or the orbits belong to another time."""
    received = [(r.source.path, r.observations) for r in receptions if r.observations is not None]
    received = [(path, o) for path, o in received if o.gpst.size]
    for (path, a), (other_path, b) in combinations(received, 2):
        if overlap_s(a, b) <= 0.0:
            raise InputError(
                f"{other_path} was recorded from {format_iso(b.gpst[0], 1)} to {format_iso(b.gpst[-1], 1)}, but {path} "
                f"from {format_iso(a.gpst[0], 1)} to {format_iso(a.gpst[-1], 1)} (GPS time, by the signals): there "
                "is no common time to compare them in; give recordings of the same time, or protect each alone"
            )
    if navigation is not None:
        for r in receptions:
            if r.observations is not None and r.observations.gpst.size:
                require_same_day(navigation, r.observations.gpst[0], r.source)


def _add_common_time(reception: Reception, receptions: Sequence[Reception]) -> Reception:
    """Tell how much of a recording another one covers, if that is not nearly all: the rest cannot be compared."""
    observations = reception.observations
    others = [r for r in receptions if r is not reception and r.observations is not None]
    if observations is None or observations.gpst.size < 2:
        return reception
    length_s = seconds_between(observations.gpst[-1], observations.gpst[0])
    used = tuple(
        Remark(
            f"only {overlap_s(observations, r.observations):.1f} of its {length_s:.1f} s with measurements are common "
            f"with {r.source.path or r.source.name}",
            RemarkKind.BEARS,
        )
        for r in others
        if r.observations is not None and overlap_s(observations, r.observations) < POLICY.covered_share * length_s
    )
    return replace(reception, remarks=(*reception.remarks, *used))


def _list_files(receptions: Sequence[Reception]) -> dict[str, OpenFile]:
    """List what was read, by its path."""
    sources = [source for r in receptions for source in (r.source, *(() if r.samples is None else r.samples.others))]
    return {source.path: source.file for source in sources if source.file is not None}


def _sum_sidecars(sources: Sequence[Samples | ObservedFile]) -> dict[str, str]:
    """Return the SHA-256 of what says how to read the recordings, now: it was just read, and may be gone at the end."""
    files = [
        recording.stated_in
        for source in sources
        if isinstance(source, Samples)
        for recording in (source, *source.others)
    ]
    return {make_readable(str(file)): compute_sha256(file) for file in dict.fromkeys(files) if file is not None}


def _sum_files(files: Mapping[str, OpenFile], progress: Progress) -> dict[str, str | None]:
    """Return the SHA-256 of each file, of the bytes that were read; a signal leaves some out."""
    sums: dict[str, str | None] = {}
    with (
        suppress(KeyboardInterrupt),
        raise_at_signal(),
        progress.stage("computing checksums of the inputs", float(len(files))) as stage,
    ):
        for number, (path, file) in enumerate(files.items()):
            sums[path] = file.sha256(_select_from(number, stage))
            stage.advance(number + 1.0)
    return sums


def _select_from(number: int, stage: Stage) -> Callable[[int, int], None]:
    return lambda done, size: stage.advance(number + done / size)


def _make_notes(reception: Reception, interrupted: bool, sums: Mapping[str, str | None]) -> list[InputNote]:
    """Make a row for each file of a receiver; what is to be said of the receiver stands in the first."""
    source = reception.source
    read = f"{reception.examined_s:.1f} of {source.duration_s:.1f} s were processed before the run was interrupted"
    files = _list_files([reception])
    notes = [
        InputNote(path=path, format=source.format or "raw", sha256=sums.get(path), remarks=file.changes())
        for path, file in files.items()
    ] or [InputNote(path=source.path or source.name, format=source.format or "raw", sha256=None, remarks=())]
    remarks = (*source.remarks, *reception.noted, *notes[0].remarks, *((read,) if interrupted else ()))
    return [replace(notes[0], remarks=remarks), *notes[1:]]


def _list_navigation_remarks(navigation: NavigationData | None) -> tuple[str, ...]:
    return () if navigation is None else tuple(getattr(navigation, "remarks", ()))
