"""What the decision says of many scenes, files and logs, kept so that two trees can be held against each other.

    make corpus                                           into .cache/corpus.jsonl; goes on where it was stopped
    python bench/corpus.py --scenes 20 --out a.jsonl      so many scenes of each kind
    python bench/corpus.py --compare a.jsonl b.jsonl      what differs, sorted: better, worse, other

A row holds the word, labels by epoch, trusted positions and p-values of one run. Scenes are those that the other
benches draw, at measurement level; files are those of the data folder, where there is one.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import arms
import arrays
import damaged
import numpy as np
import takeovers
import words
from drawn import FOLLOWED_S, heard_of, of_receiver, pairs_of
from drawn_correlators import judged as judged_by_correlators
from drawn_scenes import draw_scene, make
from rows import Row, read, run

from skyproof.app.common.progress import Silent
from skyproof.app.protect import judge, protect
from skyproof.app.protect.document import Outcome
from skyproof.detectors.array.spin import Spin, SpinSettings
from skyproof.errors import SkyproofError
from skyproof.fusion.fuse import fuse
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.time import seconds_between
from skyproof.records import Evidence
from skyproof.simulator.files import write_series
from skyproof.verdict import WORDS

DIGITS: Final = 4
"""Of a p-value that are kept."""
MOVED_M: Final = 1e-3
"""A trusted position that differs by less is the same."""
P_RATIO: Final = 1e-3
"""A p-value that differs by less is the same."""


def row_of(name: str) -> Row:
    """What is said of a scene or file of a name such as "attack-17" or "file-rinex-mosaic-1m"."""
    kind, _, rest = name.partition("-")
    try:
        return {"name": name} | KINDS[kind](rest)
    except SkyproofError as error:
        return {"name": name, "truth": "", "runs": {"": {"word": f"error: {error}"}}}


# --- what is kept


def said(outcome: Outcome) -> dict[str, Any]:
    """What is kept of an outcome."""
    places = {}
    for one in outcome.receivers:
        fix = one.trusted
        if fix is not None:
            places[one.reception.source.name] = [[round(float(x), 3) for x in row] for row in fix.position_ecef_m]
    return {
        "word": outcome.decision.verdict,
        "labels": {
            f"{s.ref.receiver} {s.ref.signal} {s.first_epoch}-{s.last_epoch}": s.label for s in outcome.decision.labels
        },
        "places": places,
        "p": p_values(outcome.evidence),
    }


def p_values(evidence: Iterable[Evidence]) -> dict[str, float]:
    """The least p-value of each test in each window."""
    found: dict[str, float] = {}
    start = None
    for one in evidence:
        start = one.start_gpst if start is None else start
        if one.p_value is not None:
            where = f"{one.detector} {float(seconds_between(one.start_gpst, start)):.1f}"
            found[where] = min(found.get(where, 1.0), float(f"{one.p_value:.{DIGITS}g}"))
    return found


# --- kinds of scenes and files


def _of_words(kind: str) -> Callable[[str], Row]:
    def made(number: str) -> Row:
        drawn = draw_scene(f"{'attack' if kind == 'attack' else 'clean'}-{number}", most_receivers=2)
        scene = make(drawn if kind == "attack" else replace(drawn, field=kind == "reflections"))
        if scene is None:
            return {"truth": "", "runs": {}}
        heard = heard_of(words.jammed(scene, int(number)) if kind == "jammed" else scene)
        runs, captured = {}, False
        for equipment, settings in words.equipment_of(scene).items():
            used = heard[:1] if equipment.startswith("one") else heard
            outcome, _ = judge([h.reception for h in used], scene.navigation, settings, Silent())
            runs[equipment] = said(outcome)
            each = [of_receiver(scene, h, r) for h, r in pairs_of(used, outcome)]
            captured |= any(one["captured_s"] >= FOLLOWED_S for one in each)
        return {"truth": "captured" if captured else "attack" if kind == "attack" else "clean", "runs": runs}

    return made


def _takeover(number: str) -> Row:
    drawn = takeovers.draw(int(number))
    _, scene = takeovers.made(drawn)
    with TemporaryDirectory(prefix="corpus") as name:
        folder = Path(name)
        if drawn.given == "imu":
            write_series(scene, folder)
        platform = takeovers.platform_of(drawn, folder)
        navigation = nominal_constellation(drawn.start_gpst)
        _, outcome = judged_by_correlators(scene, navigation, platform, drawn.seed)
    return {"truth": "captured", "runs": {drawn.given: said(outcome)}}


def _array(rest: str) -> Row:
    number, _, attack = rest.partition("-")
    evidence, labels = arrays.judged(arrays.drawn(int(number), attack=bool(attack)))
    return _of_evidence(evidence, labels, bool(attack))


def _arm(rest: str) -> Row:
    number, _, attack = rest.partition("-")
    drawn = arms.DrawnArm(int(number), attack=bool(attack))
    evidence, _ = Spin(SpinSettings(false_alarm_probability=arms.WINDOWS_ALPHA)).examine(drawn.records)
    decision = fuse(evidence, drawn.records.observations, drawn.records.sets)
    return _of_evidence(evidence, {s.ref.signal: s.label for s in decision.labels}, bool(attack))


def _of_evidence(evidence: Sequence[Evidence], labels: Mapping[Any, str], attacked: bool) -> Row:
    kept = {"labels": {str(signal): label for signal, label in labels.items()}, "p": p_values(evidence)}
    return {"truth": "attack" if attacked else "clean", "runs": {"": {"word": "", "places": {}} | kept}}


def _damaged(rest: str) -> Row:
    kind, number = rest.split("-")
    rng = np.random.default_rng([damaged.SEED, damaged.KINDS.index(kind), int(number)])
    sky = damaged.simulated(rng)
    inputs = damaged.clean_inputs(sky)
    damaged.DAMAGES[kind](rng, sky, inputs)
    found = damaged.said(inputs)
    return {"truth": "clean", "runs": {inputs.damage: {"word": found["word"], "codes": found["codes"]}}}


def _file(name: str) -> Row:
    """A real pair and its receivers alone, or a log alone."""
    inputs, nav, options, truth = FILES[name]
    real = damaged.folder()
    both = {"both": inputs} if len(inputs) > 1 else {}
    runs = {}
    for label, kept in {**both, **{one: (one,) for one in inputs}}.items():
        paths, stated = [real / one for one in kept], options if len(kept) > 1 else {}
        runs[label] = said(protect(paths, nav=nav and real / nav, **stated).outcome)
    return {"truth": truth, "runs": runs}


FILES: Final[dict[str, tuple[tuple[str, ...], str | None, dict[str, Any], str]]] = {
    "1m": (
        ("rinex-mosaic-1m/base.obs", "rinex-mosaic-1m/rover.obs"),
        "rinex-mosaic-1m/base.nav",
        {"antenna_distance_m": 0.99},
        "clean",
    ),
    "5km": (
        ("rinex-mosaic-5km/3034265G.21O", "rinex-mosaic-5km/SEPT265G.21O"),
        "rinex-mosaic-5km/SEPT2650.21P",
        {},
        "clean",
    ),
    "3km": (
        ("rinex-gsi-3km/07590920.05o", "rinex-gsi-3km/30400920.05o"),
        "rinex-gsi-3km/07590920.05n",
        {"antenna_distance_m": 3335.0},
        "clean",
    ),
    "jump": (
        ("../cases/02_code_only_jump_unseen/jump.obs",),
        "../cases/02_code_only_jump_unseen/base.nav",
        {},
        "captured",
    ),
    "walk": (("imu-gnss-walk/gnss_1730.ubx",), None, {}, "clean"),
}

KINDS: Final[dict[str, Callable[[str], Row]]] = {
    **{kind: _of_words(kind) for kind in ("attack", *words.CLEAN)},
    "takeover": _takeover,
    "array": _array,
    "arm": _arm,
    "damaged": _damaged,
    "file": _file,
}


def names_of(scenes: int) -> list[str]:
    """Names of so many scenes of each kind, and of all files that are there."""
    names = [f"{kind}-{k}" for k in range(scenes) for kind in ("attack", *words.CLEAN, "takeover")]
    names += [f"{kind}-{k}{end}" for k in range(scenes) for kind in ("array", "arm") for end in ("", "-attack")]
    names += [f"damaged-{kind}-{k}" for k in range(-(-scenes // len(damaged.KINDS))) for kind in damaged.KINDS]
    return [*names, *(f"file-{one}" for one in FILES if (damaged.folder() / FILES[one][0][0]).exists())]


# --- two trees


def differences(before: Sequence[Row], after: Sequence[Row]) -> Iterator[tuple[str, str]]:
    """What differs: "better", "worse" or "other", and a line that says what."""
    then = {row["name"]: row for row in before}
    for row in after:
        old = then.get(row["name"])
        if old is None:
            yield "other", f"{row['name']}: not there before"
            continue
        for run_name, new in row["runs"].items():
            was, where = old["runs"].get(run_name, {"word": "not run"}), f"{row['name']} {run_name}"
            if was["word"] != new["word"]:
                yield _sorted(row["truth"], was["word"], new["word"]), f"{where}: {was['word']} -> {new['word']}"
            yield from (("other", f"{where}: {text}") for text in _parts(was, new))
    for name in then.keys() - {row["name"] for row in after}:
        yield "other", f"{name}: not there any more"


def _sorted(truth: str, before: str, after: str) -> str:
    """Whether the second word is nearer to the truth than the first one."""
    if truth not in ("clean", "captured") or not {before, after} <= set(WORDS):
        return "other"
    order = WORDS if truth == "captured" else WORDS[::-1]
    return "better" if order.index(after) > order.index(before) else "worse"


def _parts(was: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    old, own = was.get("labels", {}), new.get("labels", {})
    changed = [key for key in old.keys() | own.keys() if old.get(key) != own.get(key)]
    if changed:
        key = min(changed)
        yield f"{len(changed)} stretches of labels, as {key}: {old.get(key)} -> {own.get(key)}"
    for receiver in sorted(was.get("places", {}).keys() | new.get("places", {}).keys()):
        yield from _moved(receiver, was.get("places", {}).get(receiver, []), new.get("places", {}).get(receiver, []))
    old, own = was.get("p", {}), new.get("p", {})
    tests = Counter(
        key.split()[0]
        for key in old.keys() | own.keys()
        if abs(old.get(key, -1.0) - own.get(key, -1.0)) > P_RATIO * max(old.get(key, 1.0), own.get(key, 1.0))
    )
    if tests:
        yield "p-values of windows: " + ", ".join(f"{name} {count}" for name, count in sorted(tests.items()))


def _moved(receiver: str, was: Sequence[Any], new: Sequence[Any]) -> Iterator[str]:
    if len(was) != len(new):
        yield f"{receiver}: {len(was)} -> {len(new)} trusted epochs"
    elif was:
        step_m = np.linalg.norm(np.array(was, float) - np.array(new, float), axis=1)
        known = np.isfinite(np.array(was, float)).all(axis=1) == np.isfinite(np.array(new, float)).all(axis=1)
        if not known.all() or np.nanmax(step_m, initial=0.0) > MOVED_M:
            yield f"{receiver}: trusted places by up to {np.nanmax(step_m, initial=0.0):.3f} m"


def compare(before: Path, after: Path) -> int:
    """Print what differs and return how many words are worse."""
    found = list(differences(read(before), read(after)))
    for kind in ("worse", "other", "better"):
        own = [text for sort, text in found if sort == kind]
        print(f"{kind}: {len(own)}", *(f"  {text}" for text in own), sep="\n")
    return sum(kind == "worse" for kind, _ in found)


def main() -> int:
    """Make the corpus, or compare two."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=100, help="of each kind")
    parser.add_argument("--out", type=Path, default=Path(".cache/corpus.jsonl"))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    chosen = parser.parse_args()
    if chosen.compare:
        return compare(*chosen.compare)
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    rows = run(names_of(chosen.scenes), row_of, chosen.out, chosen.processes)
    counts = Counter((row["truth"], one["word"]) for row in rows for one in row["runs"].values())
    for (truth, word), count in sorted(counts.items()):
        print(f"{truth or '-':10s} {word or '-':16s} {count}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
