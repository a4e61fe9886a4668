"""Everything that `protect` writes into its folder."""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import tomli_w

from skyproof.app.common.folder import require_free
from skyproof.app.common.memory import give_back
from skyproof.app.common.progress import Progress
from skyproof.app.common.rinex import first_epoch_utc, group_by_transmission, write_channels
from skyproof.app.common.settings import Settings
from skyproof.app.protect.coasting import usable_fixes
from skyproof.app.protect.document import list_versions
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.app.protect.own_words import select_receiver_words, select_rows_with_place
from skyproof.app.protect.pictures import build_pictures, list_kinds
from skyproof.app.protect.positions import KINDS, SatelliteKind, Track
from skyproof.app.receive.observed import ObservedFile
from skyproof.errors import InputError
from skyproof.explain import explain
from skyproof.formats.atomic_write import UNFINISHED, OutputStep, Unwritten, name_replaced, write_in_turn, write_lines
from skyproof.formats.checksums import CHECKSUMS, write_checksums
from skyproof.formats.documents import read_json
from skyproof.formats.kml import write_kml
from skyproof.formats.nmea import write_nmea, write_nmea_sentences
from skyproof.formats.pieces import UNFINISHED_RUN, is_unfinished
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.tables import Words, build_fixes_columns, build_own_fixes_columns, open_growing_tables
from skyproof.formats.verdict import write_verdict
from skyproof.fusion.labels import LabelledSignal
from skyproof.fusion.trusted import carries
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.geoid import GEOID_SIGMA_M, interpolate_geoid_m
from skyproof.gnss.time import format_iso
from skyproof.navigation.dilution import compute_horizontal_dilution
from skyproof.records import (
    CELL_STATUS,
    LABELS,
    OBSERVABLES,
    Finding,
    Fix,
    FixStatus,
    Label,
    NavigationData,
    ObservationLog,
    Observations,
    SignalId,
)
from skyproof.report.page import write_report_html
from skyproof.verdict import USABLE, Verdict

__all__ = ["require_outputs_free", "write_evidence_line", "write_outputs"]

VERDICT, REPORT, SETTINGS, NAVIGATION, TRACKS = "verdict.json", "report.html", "settings.toml", "nav.rnx", "tracks.kml"
TABLES = ("fixes.csv", "fixes.parquet", "evidence.parquet", "signals.parquet")
_LABEL_NAMES: tuple[tuple[Label, str], ...] = (("authentic", "authentic"), ("spoofed", "other"), ("unknown", "unknown"))
"""Of labels, and what files of signals are called for them."""
_TABLE_CELLS = 1 << 15  # made into rows at once, of some 400 bytes each
_TABLE_EVIDENCE = 1 << 10  # of some kilobytes each


def require_outputs_free(folder: Path, receivers: Iterable[str] = (), *, overwrite: bool) -> None:
    """Raise OutputError if a run would overwrite what is in the folder, as `require_free` says.

    receivers : their names, once they are known.
    """
    output = _compile_names("|".join(map(re.escape, receivers)))
    names = {path.name for path in folder.iterdir() if output.fullmatch(path.name)}
    if (folder / UNFINISHED_RUN).exists() and not is_unfinished(folder):
        names.add(UNFINISHED_RUN)
    words, earlier = _read_earlier(folder)
    require_free(folder, names, earlier, f"the results of an earlier run ({words})", overwrite=overwrite)


def _read_earlier(folder: Path) -> tuple[str, list[str]]:
    """Read the word of an earlier run in the folder, and the names of its files.

    Also of one that was killed while its files appeared: the results of two runs never mix.
    """
    unfinished, word, receivers = folder / UNFINISHED, "", []
    for path in (unfinished / name_replaced(VERDICT), unfinished / VERDICT, folder / VERDICT):
        with suppress(InputError):
            document = read_json(path, "the verdict", "name another folder")
            if isinstance(document, dict) and str(document.get("format")).startswith("skyproof-verdict/"):
                word = str(document.get("verdict"))
                receivers += [re.escape(str(receiver.get("name"))) for receiver in document.get("receivers", [])]
    outputs = _compile_names("|".join(receivers))
    return word, [path.name for path in folder.iterdir() if word and outputs.fullmatch(path.name)]


def _compile_names(receivers: str) -> re.Pattern[str]:
    """Compile the pattern of the names of a run's files. receivers : their names, as a pattern."""
    whole = "|".join(re.escape(name) for name in (VERDICT, REPORT, SETTINGS, *TABLES, NAVIGATION, TRACKS, CHECKSUMS))
    return re.compile(
        rf"{whole}|({receivers})-((authentic|other|unknown)(-\d+)?\.obs|(trusted|consistent)\.nmea)", re.DOTALL
    )


def write_outputs(
    folder: Path, verdict: Verdict, outcome: Outcome, settings: Settings, progress: Progress
) -> tuple[Unwritten, ...]:
    """Write verdict, report, tables, RINEX, tracks and sums in place of what an earlier run wrote.

    Verdict and report come first, what is large later, and the sums if nothing is missing. Returns what is.
    """
    steps = [
        OutputStep((VERDICT,), lambda part: write_verdict(part / VERDICT, verdict)),
        OutputStep((REPORT,), lambda part: _write_report(part, verdict, outcome)),
        OutputStep((SETTINGS,), lambda part: write_lines(part / SETTINGS, _settings_lines(settings), encoding="utf-8")),
        *_track_steps(outcome),
        *_list_rinex_steps(outcome),
        *_list_table_steps(outcome),
    ]
    names = [name for step in steps for name in step.names]
    sums = OutputStep((CHECKSUMS,), lambda part: write_checksums(part / CHECKSUMS, folder, names), after_all=True)
    with progress.stage("writing outputs", len(steps) + 1) as stage:

        def report_done(count: int) -> None:
            give_back()
            stage.advance(count)

        return write_in_turn(folder, [*steps, sums], ahead=2, instead_of=_read_earlier(folder)[1], done=report_done)


def _write_report(folder: Path, verdict: Verdict, outcome: Outcome) -> None:
    write_lines(folder / REPORT, [write_report_html(verdict, build_pictures(outcome))], encoding="utf-8")


def _settings_lines(settings: Settings) -> list[str]:
    values = settings.model_dump()
    stated = {name: value for name, value in values.items() if value is not None}
    return [
        f"# the settings of this run; skyproof {list_versions()['skyproof']}",
        *tomli_w.dumps({"protect": stated}).rstrip("\n").split("\n"),
        *(f"# not given: {name}" for name in values if name not in stated),
    ]


# ---------------------------------------------------------------------- tables


def _list_table_steps(outcome: Outcome) -> list[OutputStep]:
    """List the steps that write the tables, the largest last."""
    writers = (_write_fixes, _write_evidence, _write_signals)
    names = (TABLES[:2], TABLES[2:3], TABLES[3:])
    return [OutputStep(each, partial(write, outcome)) for each, write in zip(names, writers, strict=True)]


def _write_fixes(outcome: Outcome, folder: Path) -> None:
    with open_growing_tables([folder / name for name in TABLES[:2]]) as take:
        take(build_fixes_columns([]))
        for r in outcome.receivers:
            for kind, fix in _walk_fixes(r):
                take(build_fixes_columns([(kind, fix)]))
            receiver_fixes = select_receiver_words(r.reception).fixes
            rows = select_rows_with_place(receiver_fixes)
            for first in range(0, rows.size, _TABLE_CELLS):
                assert receiver_fixes is not None
                take(
                    build_own_fixes_columns(r.reception.source.name, receiver_fixes, rows[first : first + _TABLE_CELLS])
                )


def _write_evidence(outcome: Outcome, folder: Path) -> None:
    with open_growing_tables((folder / "evidence.parquet",)) as take:
        take(_evidence_columns([]))
        for first in range(0, len(outcome.evidence), _TABLE_EVIDENCE):
            take(_evidence_columns(outcome.evidence[first : first + _TABLE_EVIDENCE]))


def _write_signals(outcome: Outcome, folder: Path) -> None:
    logs = [r.reception.observations for r in outcome.receivers if r.reception.observations is not None]
    with open_growing_tables((folder / "signals.parquet",)) as take:
        for log in logs:
            for first, part in _walk_log(log, max(_TABLE_CELLS // max(len(log.signals), 1), 1)):
                take(_build_signal_columns(part, _label_cells(part, first, outcome.decision.labels)))
        if not logs:
            take({})


def _walk_fixes(r: ReceiverOutcome) -> Iterator[tuple[str, Fix]]:
    """Yield all published fixes with their kinds: usable ones in order of time, then the others."""
    if r.positions is not None and r.usable is not None:
        yield from usable_fixes(r.positions)
    for kind in list_kinds(r):
        if kind not in USABLE:
            yield from ((kind, fix) for _, fix in _walk_stretches(r, kind))


def _walk_stretches(r: ReceiverOutcome, kind: str) -> Iterator[tuple[int, Fix]]:
    return iter(()) if r.positions is None else r.positions.stretches(kind)


def _walk_log(log: ObservationLog, epochs: int) -> Iterator[tuple[int, Observations]]:
    """Yield a log in stretches of so many epochs, each with its first one."""
    for first in range(0, log.gpst.size, epochs):
        yield first, log.read(first, min(first + epochs, log.gpst.size))


def _build_signal_columns(o: Observations, labels: Any) -> dict[str, Any]:
    """Build one row per epoch and signal: the measurement, why it is missing, and its label.

    labels : (n_epochs, n_signals).

    `receiver_clock` is what the receiver's clock shows, which pseudoranges count from; a fix of the same epoch has that
    less its clock bias.
    """
    n_epochs, n_signals = o.pseudorange_m.shape
    names = {name: [getattr(s, name) for s in o.signals] for name in ("sat", "band", "code", "copy")}
    words = [CELL_STATUS[code] for code in sorted(CELL_STATUS)]
    column = np.tile(np.arange(n_signals), n_epochs)
    return (
        {"receiver": Words(np.zeros(n_epochs * n_signals, np.int8), [o.receiver])}
        | {"receiver_clock": np.repeat(o.gpst, n_signals)}
        | {name: Words(column, each) for name, each in names.items()}
        | {name: getattr(o, name).ravel() for name in (*OBSERVABLES, "half_cycle_open", "quadrature_m")}
        | {"status": Words(o.status.ravel(), words), "label": Words(labels.ravel(), LABELS)}
    )


def _label_cells(o: Observations, first: int, labels: Sequence[LabelledSignal]) -> Any:
    """Labels (n_epochs, n_signals), their places in `LABELS`, of a stretch that begins at epoch `first` of the run."""
    cells = np.full(o.pseudorange_m.shape, LABELS.index("unknown"), np.int8)
    for s in labels:
        if s.ref.receiver == o.receiver:
            rows = slice(max(s.first_epoch - first, 0), max(s.last_epoch + 1 - first, 0))
            cells[rows, o.column_of[s.ref.signal]] = LABELS.index(s.label)
    return cells


def _evidence_columns(evidence: Sequence[Finding]) -> dict[str, Any]:
    def numbers(name: str) -> Any:
        return np.array([np.nan if getattr(e, name) is None else getattr(e, name) for e in evidence], np.float64)

    def words(name: str) -> Any:
        return np.array([getattr(e, name) or "" for e in evidence], dtype=str)

    def instants(name: str) -> Any:
        found = (getattr(e, name) for e in evidence)
        return np.array([np.datetime64("NaT") if t is None else t for t in found], dtype="datetime64[ns]")

    explained = [explain(e) for e in evidence]
    return {
        "detector": words("detector"),
        "start_gpst": instants("start_gpst"),
        "end_gpst": instants("end_gpst"),
        "says": words("says"),
        "subject": np.array([", ".join(map(str, e.signals)) for e in evidence], dtype=str),
        "statistic": numbers("statistic"),
        "threshold": numbers("threshold"),
        "p_value": numbers("p_value"),
        "false_alarm_probability": numbers("alpha"),
        "log_likelihood_ratio": numbers("log_likelihood_ratio"),
        "code": words("code"),
        "because": np.array([explanation.sentence for explanation in explained], dtype=str),
        "may_also_be": np.array([", ".join(e.may_also_be) for e in evidence], dtype=str),
        "dated_gpst": instants("dated_gpst"),
        "would_need": np.array([explanation.remedy or "" for explanation in explained], dtype=str),
    }


def write_evidence_line(e: Finding) -> str:
    """Write a piece of evidence as JSON with the columns of evidence.parquet; null for what is absent."""
    columns = {name: values[0].item() for name, values in _evidence_columns([e]).items()}
    instants = {"start_gpst": e.start_gpst, "end_gpst": e.end_gpst, "dated_gpst": e.dated_gpst}
    columns |= {name: None if t is None or np.isnat(t) else format_iso(t, 3) for name, t in instants.items()}
    absent = {name: None if isinstance(value, float) and np.isnan(value) else value for name, value in columns.items()}
    return json.dumps(absent, ensure_ascii=False, allow_nan=False)


# ---------------------------------------------------------------------- RINEX, KML, NMEA


def _list_rinex_steps(outcome: Outcome) -> list[OutputStep]:
    """List the steps that write the orbits, and each receiver's signals of each label.

    Several signals of one transmission go into a file each.
    """
    steps = []
    if outcome.navigation.ephemerides:
        steps.append(OutputStep((NAVIGATION,), partial(_write_orbits, outcome)))
    for r in outcome.receivers:
        o, source = r.reception.observations, r.reception.source
        if o is None or (isinstance(source, ObservedFile) and not source.ranged):
            continue
        for label, name in _LABEL_NAMES:
            groups = group_by_transmission(o, carries(o, outcome.decision.labels, label))
            for number, signals in enumerate(groups if label != "authentic" else groups[:1], 1):
                file = f"{o.receiver}-{name}.obs" if number == 1 else f"{o.receiver}-{name}-{number}.obs"
                steps.append(OutputStep((file,), partial(_write_signals_of, outcome, r, label, signals, file)))
    return steps


def _write_orbits(outcome: Outcome, folder: Path) -> None:
    created = first_epoch_utc(r.reception.observations for r in outcome.receivers)
    write_nav(folder / NAVIGATION, outcome.navigation, created=created)


def _write_signals_of(
    outcome: Outcome, r: ReceiverOutcome, label: Label, signals: tuple[SignalId, ...], name: str, folder: Path
) -> None:
    o = r.reception.observations
    assert o is not None
    track = r.tracks.get("trusted")
    place = None if track is None else track.last.position_ecef_m[0]
    write_channels(folder / name, o, label, place, signals, carries(o, outcome.decision.labels, label))


def _track_steps(outcome: Outcome) -> list[OutputStep]:
    steps = [OutputStep((TRACKS,), partial(_write_tracks, outcome))]
    for r in outcome.receivers:
        for kind in get_args(SatelliteKind):
            if kind in r.tracks:
                name = f"{r.reception.source.name}-{kind}.nmea"
                steps.append(OutputStep((name,), partial(_write_sentences, outcome, r, kind, name)))
    return steps


def _write_tracks(outcome: Outcome, folder: Path) -> None:
    tracks = {
        f"{r.reception.source.name} {kind if kind in KINDS else f'{kind} possible'}": _points(r.tracks[kind])
        for r in outcome.receivers
        for kind in list_kinds(r)
    }
    write_kml(folder / TRACKS, tracks | _collect_receiver_tracks(outcome), _draw_shapes(outcome))


def _collect_receiver_tracks(outcome: Outcome) -> dict[str, Any]:
    """Return what receivers computed themselves."""
    tracks = {}
    for r in outcome.receivers:
        receiver_fixes = select_receiver_words(r.reception).fixes
        rows = select_rows_with_place(receiver_fixes)
        if receiver_fixes is not None and rows.size:
            lat, lon, height_m = geodetic_from_ecef(receiver_fixes.position_ecef_m[rows])
            tracks[f"{r.reception.source.name} receiver"] = (
                receiver_fixes.gpst[rows],
                np.degrees(lat),
                np.degrees(lon),
                height_m,
            )
    return tracks


def _write_sentences(outcome: Outcome, r: ReceiverOutcome, kind: str, name: str, folder: Path) -> None:
    fixes = (fix for _, fix in _walk_stretches(r, kind))
    write_nmea(folder / name, (line for fix in fixes for line in _sentences(fix, outcome.navigation)))


def _draw_shapes(outcome: Outcome) -> dict[str, Any]:
    """Draw each source's last rays, two sigmas to either side, and where it stands."""
    shapes = {}
    for name, bearing in outcome.bearings.items():
        for words, line, wedge in bearing.draw():
            shapes[words] = _on_ground(line)
            shapes[f"{words}, two sigmas"] = _on_ground(wedge)
        if (ring := bearing.ring()) is not None and bearing.meets is not None:
            shapes[f"{name} stands here"] = _on_ground(bearing.meets.position_ecef_m[None])
            shapes[f"{name} stands within, 95 %"] = _on_ground(ring)
    return shapes


def _on_ground(ecef_m: Any) -> tuple[Any, Any]:
    lat, lon, _ = geodetic_from_ecef(ecef_m)
    return np.degrees(lat), np.degrees(lon)


def _points(track: Track) -> tuple[Any, Any, Any, Any]:
    """Times and places for a map, NaN where there is no fix."""
    lat, lon, height = geodetic_from_ecef(track.position_ecef_m)
    return track.gpst, np.degrees(lat), np.degrees(lon), height


def _sentences(fix: Fix, navigation: NavigationData) -> Iterator[str]:
    columns = build_fixes_columns([("trusted", fix)])
    place = columns["lat_deg"], columns["lon_deg"]
    return write_nmea_sentences(
        columns["gpst"],
        *place,
        columns["height_m"],
        columns["satellites"],
        hdop=compute_horizontal_dilution(fix, navigation)[fix.status == FixStatus.OK],
        geoid_separation_m=interpolate_geoid_m(*place),
        sigma_east_m=columns["sigma_east_m"],
        sigma_north_m=columns["sigma_north_m"],
        sigma_up_m=np.hypot(columns["sigma_up_m"], GEOID_SIGMA_M),
    )
