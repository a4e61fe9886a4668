"""Attacks and clean skies drawn at random, judged as `protect` judges, held against the truth and counted.

    python bench/drawn.py --attacks 1000 --clean 500 --out drawn.jsonl --processes 2   goes on where it was stopped
    python bench/drawn.py --several 300 --out drawn.jsonl                              some satellites, some antennas
    python bench/drawn.py --beside 40 --out drawn.jsonl                                four of ten beside true ones
    python bench/drawn.py --samples 60 --out drawn.jsonl                               attacks through samples
    python bench/drawn.py --several-samples 30 --out drawn.jsonl                       some satellites through samples
    python bench/drawn.py --only attack-17 -v                                          everything about one scene
    python bench/drawn.py --table drawn.jsonl                                          the counts alone

A trusted fix is wrong if it is off horizontally by more than three times its stated 95 % bound, 2.45 times its larger
horizontal sigma. Where only a distance is stated, a false place that fits it within three sigma is counted apart.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from rows import parser_of, rows_of, run

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge, protect
from skyproof.app.protect.document import document
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.explain import explain
from skyproof.formats.rinex_nav import write_nav
from skyproof.simulator.files import write_samples
from skyproof.studies.protection.errors import compare_with_truth
from skyproof.studies.random_scenes import BESIDE_SATS, BuiltScene, DrawnScene, build_scene, default_sigma_m, draw_scene
from skyproof.studies.receiver_model import ChannelNoise, KnownReception, add_truth, model_receptions, true_offset_s
from skyproof.verdict import WORDS, write_word

WRONG_BOUNDS = 3.0
FOLLOWED_S = 5.0
"""An attack that no receiver follows with a signal for so long, or more weakly than by half, is not there for it."""
SHOWN_FIELDS = ("kind", "place", "clock", "reached", "power_db", "noise_db", "onset_s", "n_sats", "others_enu_m")
SAMPLES: dict[str, dict[str, Any]] = {
    "attack": {"duration_s": 26.0, "most_receivers": 3},
    "several": {"duration_s": 26.0, "most_receivers": 5},
}
MOST_SATS = 8


def settings_of(made: BuiltScene) -> Settings:
    """What the user states."""
    drawn = made.drawn
    if drawn.given == "positions":
        return Settings(antennas_enu_m=made.antennas_enu_m)
    if drawn.given == "distance":
        return Settings(antenna_distance_m=drawn.given_distance_m)
    return Settings()


def judged(made: BuiltScene) -> tuple[list[KnownReception], Outcome, Settings]:
    """A scene through the receivers at measurement level and the judge."""
    heard, settings = heard_of(made), settings_of(made)
    outcome, _ = judge([h.reception for h in heard], made.navigation, settings, Silent())
    return heard, outcome, settings


def heard_of(made: BuiltScene) -> list[KnownReception]:
    """What a scene's receivers measure, with the errors that were drawn for it."""
    drawn = made.drawn
    noise = ChannelNoise(code_m=drawn.code_sigma_m, ar1=drawn.ar1, constant_m=drawn.constant_m, field=drawn.field)
    return model_receptions(made.scene, noise, rng=np.random.default_rng(drawn.seed))


def protected(made: BuiltScene) -> tuple[list[KnownReception], Outcome, Settings]:
    """The same through samples, by the command's own function."""
    settings = settings_of(made)
    with TemporaryDirectory(prefix="drawn") as folder:
        nav = Path(folder) / "broadcast.rnx"
        write_nav(nav, made.navigation)
        paths = write_samples(made.scene, Path(folder), "raw")
        outcome = protect(paths, nav=nav, **settings.model_dump(exclude_defaults=True)).outcome
    heard = [
        add_truth(made.scene, index, r.reception)
        for index, r in enumerate(outcome.receivers)
        if r.reception.observations is not None
    ]
    return heard, outcome, settings


def row_of(name: str) -> dict[str, Any]:
    """The row of `examined`, or what it failed with."""
    try:
        return examined(name)
    except Exception as error:  # whatever it is, it is counted
        return {"name": name, "verdict": "crashed", "error": f"{type(error).__name__}: {error}"}


def examined(name: str, **options: Any) -> dict[str, Any]:
    """One row of the result: what was drawn, said and wrong. Names that begin with "samples-" go through samples."""
    begin = perf_counter()
    drawn, made, by_samples = scene_of_name(name, **options)
    row: dict[str, Any] = {
        "name": name,
        "given": drawn.given,
        "receivers": len(drawn.antennas_body_m),
        "motion": drawn.motion,
        "distance_m": drawn.distance_m,
    }
    if drawn.attack is not None:
        row |= {key: getattr(drawn.attack, key) for key in SHOWN_FIELDS}
    if made is None:
        return row | {"verdict": "no scene"}
    heard, outcome, settings = (protected if by_samples else judged)(made)
    verdict = document(outcome, (), settings)
    rows = [of_receiver(made, h, r) for h, r in pairs_of(heard, outcome)]
    return row | {
        "verdict": verdict.verdict,
        "summary": verdict.summary,
        "because": verdict.reason,
        "each": rows,
        "seconds": round(perf_counter() - begin, 2),
        "followed": any(one["followed_s"] >= FOLLOWED_S for one in rows),
        "captured": any(one["captured_s"] >= FOLLOWED_S for one in rows),
        "fits": fits_distance(made, heard, outcome) if any(one["wrong"] for one in rows) else None,
        "wrong_labels": wrong_labels(heard, outcome),
        "epochs": epochs_by_label(heard, outcome),
    }


def scene_of_name(name: str, **options: Any) -> tuple[DrawnScene, BuiltScene | None, bool]:
    """As drawn and as worked out, and whether it goes through samples: shorter, of fewer receivers and satellites."""
    own = name.removeprefix("samples-")
    if own == name:
        drawn = draw_scene(name, **options)
        return drawn, build_scene(drawn, n_sats=BESIDE_SATS if name.startswith("beside") else None), False
    drawn = draw_scene(own, **(SAMPLES[own.partition("-")[0]] | options))
    return drawn, build_scene(drawn, n_sats=MOST_SATS), True


def pairs_of(heard: Sequence[KnownReception], outcome: Outcome) -> list[tuple[KnownReception, ReceiverOutcome]]:
    """What each receiver heard beside what came out of it; those that heard nothing are left out."""
    by_name = {r.reception.samples.name: r for r in outcome.receivers}
    return [(h, by_name[h.reception.samples.name]) for h in heard]


def of_receiver(made: BuiltScene, heard: KnownReception, outcome: ReceiverOutcome) -> dict[str, Any]:
    """A receiver's trusted fixes against the truth, and what it followed."""
    share = heard.false_share
    lead_s = float(np.diff(heard.true_s[:2])[0])
    false = np.sum(share > 0.5, axis=1)
    row: dict[str, Any] = {
        "followed_s": float(lead_s * (false >= 1).sum()),
        "captured_s": float(lead_s * (false >= 4).sum()),
        "fixes": 0,
        "wrong": 0,
    }
    fix = outcome.trusted
    good = np.flatnonzero(fix.status == 0) if fix is not None else np.empty(0, np.int64)
    if fix is None or not good.size:
        return row
    errors = compare_with_truth(fix, good, heard.position_ecef_m[good])
    level_m, bound_m = errors.horizontal_m, errors.bound_m
    late_s = true_offset_s(heard, fix.gpst, made.scenario.start_gpst)[good]
    worst = int(np.argmax(level_m / bound_m))
    times = level_m / bound_m
    return row | {
        "fixes": int(good.size),
        "wrong": int(np.sum(times > WRONG_BOUNDS)),
        "beyond": int(np.sum(times > 1.0)),
        "wrong_3d": int(np.sum(errors.space_m > WRONG_BOUNDS * errors.space_bound_m)),
        "worst_bounds": float(times[worst]),
        "worst_m": float(level_m[worst]),
        "bound_m": float(bound_m[worst]),
        "worst_at_s": float(heard.true_s[good[worst]]),
        "time_off_s": float(np.abs(late_s).max()),
    }


def fits_distance(made: BuiltScene, heard: Sequence[KnownReception], outcome: Outcome) -> str | None:
    """Whether wrong fixes are so far from another antenna as was stated: "knows" if the attacker aimed at that, else
    "chance"; None where they are not.
    """
    attack = made.drawn.attack
    if made.drawn.given != "distance" or attack is None:
        return None
    stated_m = made.drawn.given_distance_m
    for k, (h, r) in enumerate(pairs_of(heard, outcome)):
        if r.trusted is None:
            continue
        good = np.flatnonzero(r.trusted.status == 0)
        errors = compare_with_truth(r.trusted, good, h.position_ecef_m[good])
        wrong = good[errors.horizontal_m > WRONG_BOUNDS * errors.bound_m]
        wrong = wrong[wrong < min(o.position_ecef_m.shape[0] for o in heard)]
        if wrong.size:
            apart_m = np.linalg.norm(r.trusted.position_ecef_m[wrong] - heard[1 - k].position_ecef_m[wrong], axis=1)
            if np.median(np.abs(apart_m - stated_m)) > 3.0 * default_sigma_m(stated_m):
                return None
    return "knows" if attack.place == "sphere" else "chance"


def wrong_labels(heard: Sequence[KnownReception], outcome: Outcome) -> list[str]:
    """Signals called what they are not for a second or more, in words."""
    faults = []
    for h in heard:
        o = h.reception.observations
        for s in outcome.decision.labels if o is not None else ():
            if o is None or s.ref.receiver != o.receiver or s.label not in ("authentic", "spoofed"):
                continue
            share = h.false_share[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)]
            wrong = share > 0.6 if s.label == "authentic" else share < 0.4
            if wrong.sum() * float(np.diff(o.elapsed_s[:2])[0]) >= 1.0:
                faults.append(f"{s.ref} {s.label} in {int(wrong.sum())} of {wrong.size} epochs wrongly")
    return faults


def epochs_by_label(heard: Sequence[KnownReception], outcome: Outcome) -> dict[str, dict[str, int]]:
    """How many epochs of true and of false signals bear each label."""
    found: dict[str, Counter[str]] = {"true": Counter(), "false": Counter()}
    for h in heard:
        o = h.reception.observations
        for s in outcome.decision.labels if o is not None else ():
            if o is not None and s.ref.receiver == o.receiver:
                share = h.false_share[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)]
                found["true"][s.label] += int((share < 0.4).sum())
                found["false"][s.label] += int((share > 0.6).sum())
    return {kind: dict(counts) for kind, counts in found.items()}


# ---------------------------------------------------------------------- all of them


def names_of(counts: Mapping[str, int], first: int = 0) -> list[str]:
    """Of so many scenes of each kind, from the number `first` on."""
    return [f"{kind}-{k}" for kind, n in counts.items() for k in range(first, first + n)]


def wrong_attacks(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """With a trusted fix off by more than three bounds, but for places that fit a distance that alone was stated."""
    return [row for row in rows if _wrong(row) and not row.get("fits")]


def _wrong(row: dict[str, Any]) -> bool:
    return any(item["wrong"] for item in row.get("each", ()))


def passed_over(row: dict[str, Any]) -> bool:
    """An attack whose signals were followed, and of which nothing is said."""
    return bool(row["verdict"] == "authentic" and row["followed"] and "kind" in row)


def table(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """The counts."""
    yield from (f"{row['name']} crashed: {row['error']}" for row in rows if row["verdict"] == "crashed")
    rows = [row for row in rows if row["verdict"] not in ("no scene", "crashed")]
    for kind in ("attack", "several", "beside", "clean", "samples-attack", "samples-several"):
        mine = [row for row in rows if row["name"].startswith(kind)]
        if not mine:
            continue
        yield f"{kind}: {len(mine)} scenes, {sum(row['seconds'] for row in mine) / len(mine):.2f} s each"
        cells = [
            (given, sub)
            for given in ("nothing", "distance", "positions")
            for sub in (("takeover", "spoofer", "meaconer") if kind != "clean" else (None,))
        ]
        for given, sub in cells:
            part = [row for row in mine if row["given"] == given and (sub is None or row["kind"] == sub)]
            if part:
                yield f"  {given:<9} {sub or '':<8} {_counts(part)}"
        yield f"  all                {_counts(mine)}"
        yield f"  {_shares(mine)}"
        yield from _listed(mine, kind)


def _counts(part: Sequence[dict[str, Any]]) -> str:
    counts = Counter(row["verdict"] for row in part)
    words = ", ".join(f"{write_word(word)} {counts[word]:3d}" for word in reversed(WORDS))
    each = [item for row in part for item in row["each"]]
    fixes, beyond = sum(item["fixes"] for item in each), sum(item.get("beyond", 0) for item in each)
    return (
        f"{len(part):4d}: {words} (passed over {sum(passed_over(row) for row in part):2d}); captured "
        f"{sum(row['captured'] for row in part):3d}; wrong {len(wrong_attacks(part)):2d}, fits the distance "
        f"{sum(bool(row['fits']) for row in part):2d}; {fixes:6d} trusted fixes, beyond 95 % "
        f"{100.0 * beyond / max(fixes, 1):4.1f} %"
    )


def _shares(rows: Sequence[dict[str, Any]]) -> str:
    """Of all epochs of signals: how many were named, rightly or wrongly."""
    words = []
    for kind, named in (("false", "spoofed"), ("true", "authentic")):
        count: Counter[str] = Counter()
        for row in rows:
            count.update(row.get("epochs", {}).get(kind, {}))
        total = max(sum(count.values()), 1)
        other = "authentic" if named == "spoofed" else "spoofed"
        words.append(
            f"{kind} signals {named} in {100.0 * count[named] / total:.1f} %, {other} in "
            f"{100.0 * count[other] / total:.2f} % of {sum(count.values())} epochs"
        )
    return "; ".join(words)


def _listed(rows: Sequence[dict[str, Any]], kind: str) -> Iterator[str]:
    groups = {
        "wrong": wrong_attacks(rows),
        "fits the distance": [row for row in rows if row["fits"]],
        "passed over": [row for row in rows if passed_over(row)],
        "passed over, though a fix is beyond its bound or its time by 1 us": [
            row
            for row in rows
            if passed_over(row) and any(item.get("beyond") or item.get("time_off_s", 0) > 1e-6 for item in row["each"])
        ],
        "wrong in height or by 3-D only": [
            row for row in rows if not _wrong(row) and any(item.get("wrong_3d") for item in row["each"])
        ],
        "1 to 3 bounds in more than 5 % of fixes": [
            row
            for row in rows
            if not _wrong(row) and any(item.get("beyond", 0) > 0.05 * item["fixes"] for item in row["each"])
        ],
        "time off by over 1 us": [row for row in rows if any(item.get("time_off_s", 0) > 1e-6 for item in row["each"])],
        "a label wrong": [row for row in rows if row["wrong_labels"]],
        "an attack, and no sign is said": [row for row in rows if "kind" in row and "no sign" in row["summary"]],
    }
    if kind == "clean":
        groups["called spoofed"] = [row for row in rows if row["verdict"] == "spoofed"]
    for title, found in groups.items():
        yield f"  {title}: {len(found)}  {' '.join(row['name'].partition('-')[2] for row in found[:40])}"


def reported(name: str) -> Iterator[str]:
    """Everything about one scene."""
    drawn, made, by_samples = scene_of_name(name)
    yield from _fields(drawn)
    if made is None:
        yield "makes no scene"
        return
    heard, outcome, settings = (protected if by_samples else judged)(made)
    verdict = document(outcome, (), settings)
    yield f"{verdict.verdict}: {verdict.summary} {verdict.reason}"
    yield from (json.dumps(of_receiver(made, h, r)) for h, r in pairs_of(heard, outcome))
    yield from wrong_labels(heard, outcome)
    for e in outcome.evidence:
        if e.p_value is not None or e.detector == "multi_receiver":
            subject = " ".join(sorted(f"{ref.receiver}:{ref.signal.sat}{ref.signal.copy}" for ref in e.signals))
            yield f"{e.start_gpst} {e.detector} {e.says} p={e.p_value} group={e.group} {subject}: {explain(e).sentence}"
    for s in outcome.decision.labels:
        yield f"{s.ref} {s.label} {s.first_epoch}-{s.last_epoch} {s.because}"
    for h, r in pairs_of(heard, outcome):
        o = h.reception.observations
        if o is None:
            continue
        followed = [
            f"{signal}:{''.join('.' if not math.isfinite(x) else str(min(int(10 * x), 9)) for x in column)}"
            for signal, column in zip(o.signals, h.false_share.T, strict=True)
        ]
        yield "\n".join([o.receiver, *followed])
        if r.trusted is not None:
            good = np.flatnonzero(r.trusted.status == 0)
            errors = compare_with_truth(r.trusted, good, h.position_ecef_m[good])
            yield "  trusted fixes (epoch error bound): " + " ".join(
                f"{k}:{e:.1f}/{b:.1f}" for k, e, b in zip(good, errors.horizontal_m, errors.bound_m, strict=True)
            )


def report() -> Iterator[str]:
    """Rows of the table of `make bench`: some of all."""
    yield "attacks and clean skies drawn at random, at the level of measurements"
    yield from table(run(names_of({"attack": 40, "clean": 20}), row_of, None, 1))


def _fields(drawn: DrawnScene) -> Iterator[str]:
    for key, value in asdict(drawn).items():
        if key == "attack" and value is not None:
            yield from (f"  {name} = {one}" for name, one in value.items())
        else:
            yield f"{key} = {value}"


def main() -> None:
    options = parser_of(__doc__)
    options.add_argument("--attacks", type=int, default=0)
    options.add_argument("--clean", type=int, default=0)
    options.add_argument("--several", type=int, default=0, help="some satellites imitated from one to four antennas")
    options.add_argument("--beside", type=int, default=0, help="four of ten imitated beside the true ones")
    options.add_argument("--samples", type=int, default=0, help="attacks that go through samples and protect itself")
    options.add_argument("--several-samples", type=int, default=0, help="those that go through samples and protect")
    options.add_argument("--first", type=int, default=0, help="number of the first scene of each kind")
    options.add_argument("--only", nargs="+", help="names of scenes, such as attack-17")
    options.add_argument("-v", "--verbose", action="store_true", help="with --only: everything about them")
    chosen = options.parse_args()
    if chosen.only and chosen.verbose:
        for name in chosen.only:
            print("\n".join(reported(name)))
        return
    counts = {
        "attack": chosen.attacks,
        "clean": chosen.clean,
        "several": chosen.several,
        "beside": chosen.beside,
        "samples-attack": chosen.samples,
        "samples-several": chosen.several_samples,
    }
    print("\n".join(table(rows_of(chosen, chosen.only or names_of(counts, chosen.first), row_of))))


if __name__ == "__main__":
    main()
