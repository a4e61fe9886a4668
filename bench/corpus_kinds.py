"""The kinds of scenes, files and logs of `corpus.py`, and what is kept of each run."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import arms
import arrays
import clean_logs
import damaged
import log_attacks
import missing_samples
import numpy as np
import takeovers
import words
from drawn import (
    FOLLOWED_S,
    epochs_by_label,
    heard_of,
    of_receiver,
    pairs_of,
    scene_of_name,
    settings_of,
    wrong_labels,
)
from drawn import protected as protected_through_samples
from real_logs import LOGS
from rows import Row

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import widen_windows
from skyproof.app.inspect.run import inspect
from skyproof.app.protect import judge, protect
from skyproof.app.protect.outcome import Outcome
from skyproof.detectors.array.spin import Spin, SpinSettings
from skyproof.errors import SkyproofError
from skyproof.fusion.fuse import fuse
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import seconds_between
from skyproof.records import Evidence
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.files import write_series
from skyproof.simulator.scenes import load_ready_made, read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene
from skyproof.studies.protection.cell import cut_scene, make_rows, write_without_samples
from skyproof.studies.protection.equipment import EQUIPMENT, equip
from skyproof.studies.protection.score import score
from skyproof.studies.random_scenes import BuiltScene, DrawnScene, build_scene, draw_scene
from skyproof.studies.receiver_model import KnownReception

DIGITS: Final = 4
"""Of a p-value that are kept."""
CAPTURED, ATTACK, CLEAN = "captured", "attack", "clean"
BY_CORRELATORS: Final = ("one receiver", "standing", "with IMU", "second receiver at 20 m", "vector tracking")
"""Equipment of the matrix that needs no samples."""


def row_of(name: str) -> Row:
    """Return the row of a name such as "attack-17" or "file-1m"."""
    kind, _, rest = name.partition("-")
    try:
        return {"name": name, "runs": KINDS[kind](rest)}
    except SkyproofError as error:
        return {"name": name, "runs": {"": _refused(error)}}


# --- what is kept


def keep_outcome(outcome: Outcome, truth: str, counts: Mapping[str, int] | None = None) -> Row:
    """Return what is kept of an outcome.

    counts : of what is right and wrong by the truth; of a clean sky these are its labels.
    """
    decision = outcome.decision
    places = {}
    for receiver in outcome.receivers:
        fix = receiver.trusted
        if fix is not None:
            rows = [[round(float(x), 3) for x in row] for row in fix.position_ecef_m]
            places[receiver.reception.source.name] = rows
    if counts is None and truth == CLEAN:
        counts = {
            "wrong_labels": sum(s.label == "spoofed" for s in decision.labels),
            "right_labels": sum(s.last_epoch - s.first_epoch + 1 for s in decision.labels if s.label == "authentic"),
        }
    suspicion = decision.suspicion
    return {
        "truth": truth,
        "word": decision.verdict,
        "seen": None if decision.onset is None else str(decision.onset.seen),
        "may_also_be": [] if suspicion is None else list(suspicion.may_also_be),
        "interference": [
            [s.receiver, "+".join(s.carriers), str(s.since_gpst), str(s.until_gpst), round(s.fall_db, 2), s.lost]
            for s in decision.interference or ()
        ],
        "labels": {f"{s.ref.receiver} {s.ref.signal} {s.first_epoch}-{s.last_epoch}": s.label for s in decision.labels},
        "places": places,
        "counts": dict(counts or {}),
        **keep_evidence(outcome.evidence),
    }


def keep_evidence(evidence: Iterable[Evidence]) -> Row:
    """Return the least p-value of each test in each window, and how often each test failed, by its code."""
    least: dict[str, float] = {}
    failed: Counter[str] = Counter()
    start = None
    for e in evidence:
        start = e.start_gpst if start is None else start
        if e.p_value is not None:
            where = f"{e.detector} {float(seconds_between(e.start_gpst, start)):.1f}"
            least[where] = min(least.get(where, 1.0), float(f"{e.p_value:.{DIGITS}g}"))
        if e.failed or e.says in ("attack", "spoofed"):
            causes = [*e.may_also_be, *(w.code for w in e.wrong_statements)]
            failed[" ".join([e.detector, e.code or "-", e.says, ",".join(causes) or "-"])] += 1
    return {"p": least, "failed": dict(sorted(failed.items()))}


def _refused(error: SkyproofError, folder: Path | None = None) -> Row:
    text = str(error) if folder is None else str(error).replace(str(folder), "")
    return {"truth": "", "word": f"error: {text}"}


def _counts(made: BuiltScene, heard: Sequence[KnownReception], outcome: Outcome) -> dict[str, int]:
    """Count labels and trusted fixes, right and wrong."""
    each = [of_receiver(made, h, r) for h, r in pairs_of(heard, outcome)]
    epochs = epochs_by_label(heard, outcome)
    return {
        "captured": sum(row["captured_s"] >= FOLLOWED_S for row in each),
        "wrong_labels": len(wrong_labels(heard, outcome)),
        "right_labels": epochs["false"].get("spoofed", 0) + epochs["true"].get("authentic", 0),
        "wrong_fixes": sum(row["wrong"] for row in each),
        "right_fixes": sum(row["fixes"] - row["wrong"] for row in each),
    }


def _truth(drawn: DrawnScene, counts: Mapping[str, int]) -> str:
    return CLEAN if drawn.attack is None else CAPTURED if counts["captured"] else ATTACK


# --- drawn scenes


def _of_words(kind: str) -> Callable[[str], Row]:
    """One or two receivers, with every equipment."""

    def judged(number: str) -> Row:
        drawn = draw_scene(f"{'attack' if kind == 'attack' else 'clean'}-{number}", most_receivers=2)
        scene = build_scene(drawn if kind == "attack" else replace(drawn, field=kind == "reflections"))
        if scene is None:
            return {}
        heard = heard_of(words.jammed(scene, int(number)) if kind == "jammed" else scene)
        runs = {}
        for equipment, settings in words.equipment_of(scene).items():
            used = heard[:1] if equipment.startswith("one") else heard
            outcome, _ = judge([h.reception for h in used], scene.navigation, settings, Silent())
            counts = _counts(scene, used, outcome)
            runs[equipment] = keep_outcome(outcome, _truth(drawn, counts), counts)
        return runs

    return judged


def _several(number: str) -> Row:
    """Up to five receivers, transmitters of several antennas, some satellites."""
    drawn = draw_scene(f"several-{number}")
    scene = build_scene(drawn)
    if scene is None:
        return {}
    heard = heard_of(scene)
    outcome, _ = judge([h.reception for h in heard], scene.navigation, settings_of(scene), Silent())
    counts = _counts(scene, heard, outcome)
    return {drawn.given: keep_outcome(outcome, _truth(drawn, counts), counts)}


TAKEOVER_FROM_S = 14.0
"""Early, so that a row takes seconds, and stated: later ones, of which nothing is stated, are `takeovers.py`'s."""


def _takeover(rest: str) -> Row:
    number, _, tracking = rest.partition("-")
    drawn = replace(takeovers.draw(int(number)), onset_s=TAKEOVER_FROM_S, grade="tactical")
    _, scene = takeovers.made(drawn)
    with TemporaryDirectory(prefix="corpus") as name:
        folder = Path(name)
        if drawn.given == "imu":
            write_series(scene, folder)
        platform = takeovers.platform_of(drawn, folder, tracking or "scalar", clean_start_s=TAKEOVER_FROM_S)
        navigation = make_nominal_constellation(drawn.start_gpst)
        _, outcome = protect_scene(scene, navigation, platform, drawn.seed)
    fixes = takeovers.fixes_of(drawn, scene, outcome)
    counts = {"wrong_fixes": fixes["wrong"], "right_fixes": fixes["fixes"] - fixes["wrong"]}
    return {drawn.given: keep_outcome(outcome, CAPTURED, counts)}


def _missing(number: str) -> Row:
    """Samples that are missing from signals that overlap, behind drawn correlators."""
    drawn, scene, navigation = missing_samples.made(int(number))
    reception, tracker = missing_samples.received(drawn, scene, navigation)
    settings = widen_windows(Settings(), [] if reception.observations is None else [reception.observations])
    outcome, _ = judge([reception], navigation, settings, Silent())
    kept = keep_outcome(outcome, CAPTURED, {})
    return {drawn.push: kept | {"gaps": [[round(gap.elapsed_s, 3), gap.shift_s] for gap in tracker.gaps]}}


def _array(rest: str) -> Row:
    number, _, attack = rest.partition("-")
    drawn = arrays.drawn(int(number), attack=bool(attack))
    evidence, labels, _ = arrays.judged(drawn)
    signals = drawn.records.observations[0].signals
    return _of_evidence(evidence, labels, dict(zip(signals, drawn.false, strict=True)))


def _arm(rest: str) -> Row:
    number, _, attack = rest.partition("-")
    drawn = arms.DrawnArm(int(number), attack=bool(attack))
    evidence, _ = Spin(SpinSettings(false_alarm_probability=arms.WINDOWS_ALPHA)).examine(drawn.records)
    decision = fuse(evidence, drawn.records.observations, drawn.records.sets)
    signals = drawn.records.observations[0].signals
    labels = {s.ref.signal: s.label for s in decision.labels}
    return _of_evidence(evidence, labels, dict(zip(signals, drawn.false, strict=True)))


def _of_evidence(evidence: Sequence[Evidence], labels: Mapping[Any, str], false: Mapping[Any, Any]) -> Row:
    """Keep one window of some detectors."""
    right = [("spoofed" if false[signal] else "authentic") == label for signal, label in labels.items()]
    stated = [label in ("spoofed", "authentic") for label in labels.values()]
    counts = {
        "wrong_labels": sum(s and not r for s, r in zip(stated, right, strict=True)),
        "right_labels": sum(right),
    }
    kept = {"labels": {str(signal): label for signal, label in labels.items()}, "counts": counts}
    truth = ATTACK if any(false.values()) else CLEAN
    return {"": {"truth": truth, "word": "", "places": {}, **kept, **keep_evidence(evidence)}}


def _damaged(rest: str) -> Row:
    kind, number = rest.split("-")
    rng = np.random.default_rng([damaged.SEED, damaged.KINDS.index(kind), int(number)])
    sky = damaged.simulated(rng)
    inputs = damaged.clean_inputs(sky)
    damaged.DAMAGES[kind](rng, sky, inputs)
    found = damaged.said(inputs)
    return {inputs.damage: {"truth": CLEAN, "word": found["word"], "may_also_be": found["codes"]}}


# --- cells of the matrix


def _cell(rest: str) -> Row:
    """A ready-made scene with one equipment, behind drawn correlators."""
    scene_name, _, number = rest.rpartition("-")
    found = equip(cut_scene(read_ready_made(scene_name)), equipment := BY_CORRELATORS[int(number)])
    if found is None:
        return {}
    navigation = make_navigation(found.scenario)
    scene = make_scene(found.scenario, navigation)
    with TemporaryDirectory(prefix="corpus") as name:
        platform = write_without_samples(scene, found, Path(name))
        verdict, outcome = protect_scene(scene, navigation, platform, found.scenario.seed)
    kept = score(scene, verdict, outcome)
    counts = {key: kept[key] for key in ("wrong_labels", "wrong_fixes", "false_alarms")}
    return {equipment: keep_outcome(outcome, ATTACK if found.scenario.attacks else CLEAN, counts)}


def _cell_samples(rest: str) -> Row:
    """A ready-made scene with one equipment, through samples."""
    scene_name, _, number = rest.rpartition("-")
    equipment = list(EQUIPMENT)[int(number)]
    scenario = read_ready_made(scene_name)
    if equip(scenario, equipment) is None:
        return {}
    with TemporaryDirectory(prefix="corpus") as name:
        (row,) = make_rows(scenario, (equipment,), Path(name))
    counts = {key: row[key] for key in ("wrong_labels", "wrong_fixes", "false_alarms")}
    counts["right_fixes"] = round(1000 * row["trusted_share"])
    truth = ATTACK if scenario.attacks else CLEAN
    return {equipment: {"truth": truth, "word": row["verdict"], "counts": counts}}


def _drawn_samples(rest: str) -> Row:
    """An attack as `drawn.py --samples` draws it."""
    drawn, scene, _ = scene_of_name(f"samples-{rest}")
    if scene is None:
        return {}
    heard, outcome, _ = protected_through_samples(scene)
    counts = _counts(scene, heard, outcome)
    return {drawn.given: keep_outcome(outcome, _truth(drawn, counts), counts)}


# --- real files and logs


def _log_drawn(what: str) -> Callable[[str], Row]:
    """An attack or a jamming in a real log, as `log_attacks.py` draws it."""

    def judged(number: str) -> Row:
        row, outcome = log_attacks.made(f"{what}-{number}")
        counts = {}
        if what == "attack":
            counts["wrong_fixes"] = row["trusted_wrong"]
            counts["right_fixes"] = row["trusted_after"] - row["trusted_wrong"]
        reached = row.get("reached_s") is not None
        truth = CLEAN if what == "jamming" else CAPTURED if reached else ATTACK
        return {f"{row['log']} {row['equipment']}": keep_outcome(outcome, truth, counts or None)}

    return judged


def _log(name: str) -> Row:
    """A real log, whole or cut as `clean_logs.py` cuts it."""
    outcome = clean_logs.outcome_of(name)
    return {"": keep_outcome(outcome, CLEAN)}


def _file(name: str) -> Row:
    """A real pair and its receivers alone, or a file alone."""
    inputs, nav, options, truth = FILES[name]
    real = damaged.folder()
    both = {"both": inputs} if len(inputs) > 1 else {}
    runs = {}
    for label, kept in {**both, **{path: (path,) for path in inputs}}.items():
        paths, stated = [real / path for path in kept], options if len(kept) > 1 else {}
        runs[label] = _protected(paths, nav and real / nav, truth, real, **stated)
    return runs


def _protected(paths: Sequence[Path], nav: Path | None, truth: str, folder: Path, **options: Any) -> Row:
    try:
        return keep_outcome(protect(paths, nav=nav, **options).outcome, truth)
    except SkyproofError as error:
        return _refused(error, folder)


def _case(number: str) -> Row:
    """A small case, with each of its inputs."""
    folder = next((damaged.folder().parent / "cases").glob(f"{number}_*"))
    runs = {}
    for label, (inputs, nav, options) in CASES[number].items():
        truth = CAPTURED if number == "02" else CLEAN
        stated = {key: folder / value if key in ("platform", "imu") else value for key, value in options.items()}
        if nav == "inspect":
            runs[label] = _inspected(folder / inputs[0], folder, stated)
        else:
            paths = [folder / path for path in inputs]
            runs[label] = _protected(paths, nav and folder / nav, truth, folder, **stated)
    return runs


def _inspected(path: Path, folder: Path, layout: Mapping[str, object]) -> Row:
    try:
        return {"truth": "", "word": " | ".join(item.summary for item in inspect(path, layout=layout))}
    except SkyproofError as error:
        return _refused(error, folder)


_M1, _KM5, _GSI = "rinex-mosaic-1m", "rinex-mosaic-5km", "rinex-gsi-3km"
_Stated = dict[str, Any]
FILES: Final[dict[str, tuple[tuple[str, ...], str | None, _Stated, str]]] = {
    "1m": ((f"{_M1}/base.obs", f"{_M1}/rover.obs"), f"{_M1}/base.nav", {"antenna_distance_m": 0.99}, CLEAN),
    "5km": ((f"{_KM5}/3034265G.21O", f"{_KM5}/SEPT265G.21O"), f"{_KM5}/SEPT2650.21P", {}, CLEAN),
    "3km": (
        (f"{_GSI}/07590920.05o", f"{_GSI}/30400920.05o"),
        f"{_GSI}/07590920.05n",
        {"antenna_distance_m": 3335.0},
        CLEAN,
    ),
    "walk": (("imu-gnss-walk/gnss_1730.ubx",), None, {}, CLEAN),
    "pulled": (
        ("nmea-pulled/spoof_init_-0.5chips.DAT", "nmea-pulled/spoof_init_-4.0chips_0.5v_prn8.DAT"),
        None,
        {},
        CLEAN,
    ),
    "ubx": (("streams/ubx_20080526.ubx",), None, {}, CLEAN),
    "rawx": (("streams/pygpsdata-RXMRAWX.log",), None, {}, CLEAN),
    "mixed": (("streams/pygpsdata-MIXED-RTCM3.log",), None, {}, CLEAN),
    "glo": (("streams/testglo.rtcm3",), None, {}, CLEAN),
    "msm": (("streams/GMSD7_20121014.rtcm3",), None, {}, CLEAN),
    "kms3": (
        ("rinex-variety/KMS300DNK_R_20221591000_01H_30S_MO.crx",),
        "rinex-variety/KMS300DNK_R_20221591000_01H_MN.rnx.gz",
        {},
        CLEAN,
    ),
    "texbat2": (("spoofed-real/texbat_ds2.channel.csv.gz",), "spoofed-real/brdc2580.12n", {}, CAPTURED),
    "texbat3": (("spoofed-real/texbat_ds3.channel.csv.gz",), "spoofed-real/brdc2580.12n", {}, ATTACK),
}
_PAIR: Final = {"antenna_distance_m": 0.99, "antenna_distance_sigma_m": 0.02}
_BOTH: Final = (("b.obs", "r.obs"), "base.nav", _PAIR)
CASES: Final[dict[str, dict[str, tuple[tuple[str, ...], str | None, _Stated]]]] = {
    "01": {
        f"{nav} {len(inputs)}": (inputs, f"{nav}.nav", _PAIR if len(inputs) > 1 else {})
        for nav in ("true", "hour0", "day_before")
        for inputs in (("b.obs",), ("b.obs", "r.obs"))
    },
    "02": {
        "jump": (("jump.obs",), "base.nav", {}),
        "after gap": (("jump_after_gap.obs",), "base.nav", {}),
        "stated speed": ((), "base.nav", {"platform": "speed40.toml"}),
    },
    "03": {"both": _BOTH, "gaps alone": (("r.obs",), "base.nav", {})},
    "04": {"imu": (("b.obs",), "base.nav", {"imu": "imu.csv"})},
    "05": {
        "observations": (("r.obs",), "base.nav", {}),
        "orbits": (("r_plain.obs",), "bom.nav", {}),
        "platform": ((), "base.nav", {"platform": "p.toml"}),
    },
    "06": {"both": _BOTH},
    "07": {"both": _BOTH, "ranges alone": (("r.obs",), "base.nav", {})},
    "08": {"both": _BOTH, "types alone": (("r.obs",), "base.nav", {})},
    "11": {"masked": ((), "base.nav", {"platform": "mask.toml"}), "plain": (("rx.obs",), "base.nav", {})},
    "14": {"surveyed": ((), "base.nav", {"platform": "p.toml"})},
    "15": {"inspect": (("rec.sigmf-meta",), "inspect", {})},
    "16": {
        "inspect": (("rec.bin",), "inspect", {"rate_hz": 2048000.0, "kind": "complex", "encoding": "int", "bits": 12})
    },
}

KINDS: Final[dict[str, Callable[[str], Row]]] = {
    **{kind: _of_words(kind) for kind in ("attack", *words.CLEAN)},
    "several": _several,
    "takeover": _takeover,
    "missing": _missing,
    "array": _array,
    "arm": _arm,
    "damaged": _damaged,
    "cell": _cell,
    "logattack": _log_drawn("attack"),
    "logjamming": _log_drawn("jamming"),
    "log": _log,
    "file": _file,
    "case": _case,
    "cellsamples": _cell_samples,
    "samples": _drawn_samples,
}
REAL: Final = ("logattack", "logjamming", "log", "file", "case")


def names_of_cells() -> list[str]:
    """Return the cells of the matrix that need no samples."""
    return [f"cell-{scene}-{number}" for scene in load_ready_made() for number in range(len(BY_CORRELATORS))]


def names_of_files() -> list[str]:
    """Return all files, logs and cases of the data folder, that are there."""
    real = damaged.folder()
    found = [f"file-{name}" for name, (inputs, *_) in FILES.items() if (real / inputs[0]).exists()]
    found += [f"log-{name}-0" for name, log in LOGS.items() if (real / log.path).exists()]
    return found + [f"case-{number}" for number in CASES if any((real.parent / "cases").glob(f"{number}_*"))]
