"""Everything that `protect` writes into its folder."""

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from skyproof.app.common.progress import Progress
from skyproof.app.common.rinex import date_of, one_a_transmission, write_channels
from skyproof.app.common.settings import Settings
from skyproof.app.protect.document import Outcome, versions
from skyproof.app.protect.pictures import fixes_by_kind, last_position, pictures_of, possible_fixes
from skyproof.errors import InputError
from skyproof.formats.atomic_write import UNFINISHED, write_lines, writing_together
from skyproof.formats.kml import write_kml
from skyproof.formats.nmea import nmea_sentences, write_nmea
from skyproof.formats.rinex_nav import write_nav
from skyproof.formats.tables import fixes_columns, write_table
from skyproof.formats.verdict import read_verdict, write_verdict
from skyproof.fusion.labels import LabelledSignal
from skyproof.fusion.trusted import labelled
from skyproof.gnss.frames import geodetic_from_ecef
from skyproof.gnss.geoid import GEOID_SIGMA_M, geoid_separation_m
from skyproof.navigation.dilution import horizontal_dilution
from skyproof.records import CELL_STATUS, Evidence, Fix, FixStatus, NavigationData, Observations
from skyproof.report.page import report_html
from skyproof.verdict import Verdict

__all__ = ["write_outputs"]


def write_outputs(folder: Path, verdict: Verdict, outcome: Outcome, settings: Settings, progress: Progress) -> None:
    """Write verdict, tables, RINEX, tracks and the report, in place of what an earlier run wrote; all or nothing."""
    with (
        progress.stage("writing outputs", 5) as stage,
        writing_together(folder, instead_of=_older(folder), last="verdict.json") as part,
    ):
        write_verdict(part / "verdict.json", verdict)
        write_lines(part / "settings.toml", _settings_lines(settings), encoding="utf-8")
        stage.advance(1)
        _write_tables(part, outcome)
        stage.advance(2)
        _write_rinex(part, outcome)
        stage.advance(3)
        _write_tracks(part, outcome)
        stage.advance(4)
        write_lines(part / "report.html", [report_html(verdict, pictures_of(outcome))], encoding="utf-8")
        stage.advance(5)


def _older(folder: Path) -> list[str]:
    """What an earlier run wrote here and this one may not write anew, by its verdict, or by that of one that was killed
    while its files appeared: the results of two runs never mix.
    """
    names = []
    for verdict in (folder / "verdict.json", folder / UNFINISHED / "verdict.json"):
        with contextlib.suppress(InputError):
            names += [re.escape(r.name) for r in read_verdict(verdict).receivers]
    own = re.compile(rf"({'|'.join(names)})-((authentic|other|unknown)(-\d+)?\.obs|trusted\.nmea)|nav\.rnx")
    return [path.name for path in folder.iterdir() if names and own.fullmatch(path.name)]


def _settings_lines(settings: Settings) -> list[str]:
    values = settings.model_dump()
    given = {name: value for name, value in values.items() if value is not None}
    return [
        f"# the settings of this run; skyproof {versions()['skyproof']}",
        *tomli_w.dumps({"protect": given}).rstrip("\n").split("\n"),
        *(f"# not given: {name}" for name in values if name not in given),
    ]


# ---------------------------------------------------------------------- tables


def _write_tables(folder: Path, outcome: Outcome) -> None:
    fixes = fixes_columns([pair for r in outcome.receivers for pair in (*fixes_by_kind(r), *possible_fixes(r))])
    write_table(folder / "fixes.csv", fixes)
    write_table(folder / "fixes.parquet", fixes)
    write_table(folder / "signals.parquet", _signal_columns(outcome))
    write_table(folder / "evidence.parquet", _evidence_columns(outcome.evidence))


def _signal_columns(outcome: Outcome) -> dict[str, Any]:
    """One row a receiver, epoch and signal: the measurement, why it is missing, and its label.

    `receiver_clock` is what the receiver's clock shows, which pseudoranges count from; a fix of the same epoch has that
    less its clock bias.
    """
    parts: list[Mapping[str, Any]] = []
    for r in outcome.receivers:
        o = r.reception.observations
        if o is not None:
            labels = _label_cells(o, outcome.decision.labels)
            n_epochs, n_signals = o.pseudorange_m.shape
            each = {
                name: np.tile([getattr(s, name) for s in o.signals], n_epochs)
                for name in ("sat", "band", "code", "copy")
            }
            words = np.array([CELL_STATUS[code] for code in sorted(CELL_STATUS)])
            values = {
                name: getattr(o, name).ravel()
                for name in (
                    "pseudorange_m",
                    "carrier_cyc",
                    "doppler_hz",
                    "cn0_dbhz",
                    "pseudorange_sigma_m",
                    "carrier_sigma_cyc",
                    "doppler_sigma_hz",
                    "half_cycle_open",
                )
            }
            parts.append(
                {"receiver": np.repeat(o.receiver, n_epochs * n_signals)}
                | {"receiver_clock": np.repeat(o.gpst, n_signals)}
                | each
                | values
                | {"status": words[o.status.ravel()], "label": labels.ravel()}
            )
    names = parts[0].keys() if parts else ()
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _label_cells(o: Observations, labels: Sequence[LabelledSignal]) -> Any:
    cells = np.full(o.pseudorange_m.shape, "unknown", dtype="U9")
    for s in labels:
        if s.ref.receiver == o.receiver:
            cells[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)] = s.label
    return cells


def _evidence_columns(evidence: Sequence[Evidence]) -> dict[str, Any]:
    def numbers(name: str) -> Any:
        return np.array([np.nan if getattr(e, name) is None else getattr(e, name) for e in evidence], np.float64)

    def words(name: str) -> Any:
        return np.array([getattr(e, name) or "" for e in evidence], dtype=str)

    def instants(name: str) -> Any:
        return np.array([getattr(e, name) for e in evidence], dtype="datetime64[ns]")

    return {
        "detector": words("detector"),
        "start_gpst": instants("start_gpst"),
        "end_gpst": instants("end_gpst"),
        "says": words("says"),
        "subject": np.array([", ".join(map(str, e.subject)) for e in evidence], dtype=str),
        "statistic": numbers("statistic"),
        "threshold": numbers("threshold"),
        "p_value": numbers("p_value"),
        "false_alarm_probability": numbers("false_alarm_probability"),
        "log_likelihood_ratio": numbers("log_likelihood_ratio"),
        "because": words("because"),
        "would_need": words("would_need"),
    }


# ---------------------------------------------------------------------- RINEX, KML, NMEA


def _write_rinex(folder: Path, outcome: Outcome) -> None:
    if outcome.navigation.ephemerides:
        created = date_of(r.reception.observations for r in outcome.receivers)
        write_nav(folder / "nav.rnx", outcome.navigation, created=created)
    for r in outcome.receivers:
        o = r.reception.observations
        if o is None:
            continue
        place = None if r.trusted is None else last_position(r.trusted)
        authentic = labelled(o, outcome.decision.labels, "authentic")
        write_channels(folder / f"{o.receiver}-authentic.obs", authentic, "authentic", place)
        for label, name in (("spoofed", "other"), ("unknown", "unknown")):
            others = labelled(o, outcome.decision.labels, label)  # type: ignore[arg-type]
            for number, signals in enumerate(one_a_transmission(others)):
                suffix = name if number == 0 else f"{name}-{number + 1}"
                write_channels(folder / f"{o.receiver}-{suffix}.obs", others, label, place, signals)


def _geodetic_deg(fix: Fix) -> tuple[Any, Any, Any]:
    lat, lon, height = geodetic_from_ecef(fix.position_ecef_m)
    return np.degrees(lat), np.degrees(lon), height


def _write_tracks(folder: Path, outcome: Outcome) -> None:
    tracks = {
        f"{r.reception.source.name} {kind}": (fix.gpst, *_geodetic_deg(fix))
        for r in outcome.receivers
        for kind, fix in (*fixes_by_kind(r), *((f"{sky} possible", fix) for sky, fix in possible_fixes(r)))
    }
    write_kml(folder / "tracks.kml", tracks)
    for r in outcome.receivers:
        if r.trusted is not None:
            path = folder / f"{r.reception.source.name}-trusted.nmea"
            write_nmea(path, _sentences(r.trusted, outcome.navigation))


def _sentences(fix: Fix, navigation: NavigationData) -> Iterator[str]:
    columns = fixes_columns([("trusted", fix)])
    place = columns["lat_deg"], columns["lon_deg"]
    return nmea_sentences(
        columns["gpst"],
        *place,
        columns["height_m"],
        columns["satellites"],
        hdop=horizontal_dilution(fix, navigation)[fix.status == FixStatus.OK],
        geoid_separation_m=geoid_separation_m(*place),
        sigma_east_m=columns["sigma_east_m"],
        sigma_north_m=columns["sigma_north_m"],
        sigma_up_m=np.hypot(columns["sigma_up_m"], GEOID_SIGMA_M),
    )
