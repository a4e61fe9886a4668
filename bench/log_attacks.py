"""Attacks and jammings put into logs of real receivers, judged as `protect` judges, and counted.

    python bench/log_attacks.py --attacks 300 --jammings 100 --out drawn.jsonl    goes on where it was stopped
    python bench/log_attacks.py --only attack-17 -v                               all that failed in one draw
    python bench/log_attacks.py --table drawn.jsonl                               the counts alone

Logs are those of `real_logs` that hold two dozen epochs or more. A draw puts one attack into one of them, by
`skyproof.studies.log_attacks`, all observables together; every third has codes and levels alone. Kinds: `jump` 30 m to
100 km, `drag` 0.05 to 20 m/s, `push` 1 ns/s to 1 us/s and `step` 10 ns to 1 us of the time, `start` false from the
first epoch on, `torn` between true and false signals. Half of the jumps and drags come after a jamming. Equipment: one
receiver of which nothing is stated, one that is stated to stand, one that was surveyed, and two 0.99 m apart.

A delay is from the onset to the epoch that the answer dates the attack to; `noticed` to the end of the first window in
which a test fails. An attack is there once its shift exceeds three sigma of the codes' fix, which a receiver could know
at `reached`. What fails in a window that ends before the onset is counted as a false alarm.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from functools import cache
from typing import Any, Final

import numpy as np
from real_logs import LOGS, cut_log, open_real
from rows import Row, parser_of, rows_of

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import widen_windows
from skyproof.app.protect.judging import judge
from skyproof.app.protect.outcome import Outcome
from skyproof.app.receive.inputs import adopt_antenna_multipath
from skyproof.app.receive.observed import ObservedFile, observe_file
from skyproof.arrays import Reals
from skyproof.detectors.code_motion.detector import select_primary_signals
from skyproof.errors import SkyproofError
from skyproof.explain import explain
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import timedelta_from_s
from skyproof.navigation.fix import fix
from skyproof.navigation.predictor import Standing, place_surveyed
from skyproof.records import NavigationData, Observations
from skyproof.studies.log_attacks import (
    SCOPES,
    TORN,
    FalseShift,
    Jamming,
    Tearing,
    drop_carriers,
    put_attack,
    put_jamming,
    put_tearing,
    select_signals,
    true_place_ecef_m,
)

KINDS: Final = ("jump", "drag", "push", "step", "start", "torn")
EQUIPMENT: Final = ("one", "standing", "surveyed", "pair")
SEED: Final = 43
LEAST_EPOCHS: Final = 24
MOST_EPOCHS: Final = {"drag": 160, "push": 160}
"""Of a stretch that an attack is put into; 70 of the other kinds."""
SIGMAS: Final = 3.0
SURVEY_M: Final = 1.0
WRONG_BOUNDS: Final = 3.0
TO_95: Final = 2.45  # of a circle about two equal sigmas


@cache
def usable() -> list[str]:
    """List the logs that are there, can be read, and are long enough."""
    found = []
    for name in (name for name in LOGS if not name.startswith("osnma")):  # those hold messages alone
        try:
            source, _ = open_real(name)
        except SkyproofError:
            continue
        if source.observations.gpst.size >= LEAST_EPOCHS:
            found.append(name)
    return found


def direction(rng: np.random.Generator) -> Reals:
    """Draw a direction, mostly level, east north up."""
    azimuth, up = rng.uniform(0.0, 2.0 * np.pi), rng.normal(0.0, 0.2)
    vector = np.array([np.sin(azimuth), np.cos(azimuth), up])
    return np.asarray(vector / np.linalg.norm(vector))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_shift(rng: np.random.Generator, kind: str, onset_s: float, usual_s: float) -> FalseShift:
    """Draw what false signals show."""
    sign = float(rng.choice([-1.0, 1.0]))
    options: dict[str, Any] = {"onset_s": onset_s, "power_db": float(rng.uniform(-2.0, 6.0))}
    if kind in ("jump", "start", "torn"):
        options["jump_enu_m"] = tuple(log_uniform(rng, 30.0, 1e5) * direction(rng))
        options["clock_s"] = sign * log_uniform(rng, 1e-8, 1e-5)
    elif kind == "drag":
        options["velocity_enu_m_s"] = tuple(log_uniform(rng, 0.05, 20.0) * direction(rng))
        options["acceleration_m_s2"] = log_uniform(rng, 0.05, 5.0) if usual_s < 5.0 else np.inf
        options["breaks"] = bool(rng.random() < 0.5)
    elif kind == "push":
        options["clock_drift"] = sign * log_uniform(rng, 1e-9, 1e-6)
        options["breaks"] = bool(rng.random() < 0.5)
    else:
        options["clock_s"] = sign * log_uniform(rng, 1e-8, 1e-6)
    return FalseShift(**options)


def row_of(name: str) -> Row:
    """Make the row of a name such as "attack-17" or "jamming-3"."""
    return made(name)[0]


def made(name: str) -> tuple[Row, Outcome]:
    """Draw, put in, judge, and hold against the truth."""
    what, number = name.split("-")
    rng = np.random.default_rng([SEED, int(number), what == "jamming"])
    logs = usable()
    kind = KINDS[int(number) % len(KINDS)] if what == "attack" else "jamming"
    equipment = EQUIPMENT[(int(number) // len(KINDS)) % len(EQUIPMENT)]
    some = [log for log in logs if LOGS[log].stands or equipment == "one"]
    if equipment == "surveyed":  # a phone's own codes do not survey it
        some = [log for log in some if not log.startswith("phone")]
    log = "base" if equipment == "pair" else str(rng.choice(some))
    names = ["base", "rover"] if equipment == "pair" else [log]
    source, navigation = open_real(log)
    all_s = float(source.observations.elapsed_s[-1])
    usual_s = float(np.median(np.diff(source.observations.elapsed_s)))
    whole_s = min(all_s, MOST_EPOCHS.get(kind, 70) * usual_s)
    begin_s = float(rng.uniform(0.0, 1.0)) * (all_s - whole_s)
    onset_s = 0.0 if kind == "start" else float(rng.uniform(0.3, 0.5)) * whole_s
    clean = [cut_log(open_real(each)[0].observations, begin_s, begin_s + whole_s) for each in names]
    scope = "all" if kind == "torn" or rng.random() < 0.5 else str(rng.choice(SCOPES))
    sats = sorted({signal.sat for signal in clean[0].signals})
    satellite = str(rng.choice(sats))
    system = satellite[0]
    shift = draw_shift(rng, kind, onset_s, usual_s)
    after_jam = kind in ("jump", "drag") and rng.random() < 0.5
    jam_s = max(float(rng.uniform(5.0, 30.0)), 3.0 * usual_s)
    loss_db = float(rng.uniform(5.0, 30.0))
    codes_alone = bool(rng.random() < 1.0 / 3.0)
    tearing = Tearing(
        onset_s=onset_s, how=TORN[int(number) // len(KINDS) % len(TORN)], share=float(rng.uniform(0.2, 0.8))
    )
    jamming = Jamming(
        begin_s=onset_s if kind == "jamming" else onset_s - jam_s,
        end_s=onset_s + jam_s if kind == "jamming" else onset_s,
        loss_db=loss_db,
        upper_only=bool(rng.random() < 0.5),
    )
    places = [place_of(each, o, navigation) for each, o in zip(names, clean, strict=True)]
    attacked = []
    for o, place in zip(clean, places, strict=True):
        chosen = select_signals(o, scope, satellite=satellite, system=system)
        origin = np.broadcast_to(places[0].mean(axis=0), place.shape) if len(clean) > 1 else None
        if kind == "jamming" or after_jam:
            o = put_jamming(o, jamming, rng)
        if kind != "jamming":
            false = put_attack(o, navigation, shift, signals=chosen, place_ecef_m=place, origin_ecef_m=origin)
            o = put_tearing(o, false, tearing, rng) if kind == "torn" else false
        attacked.append(drop_carriers(o) if codes_alone else o)
    outcome = judged(names, attacked, navigation, equipment, places)
    row: Row = {
        "name": name,
        "kind": kind,
        "how": tearing.how if kind == "torn" else "",
        "scope": scope,
        "log": log,
        "equipment": equipment,
        "codes_alone": codes_alone,
        "after_jam": after_jam,
        "onset_s": round(onset_s, 2),
        "usual_s": usual_s,
        "satellite": satellite,
        "seconds_after": round(float(clean[0].elapsed_s[-1]) - onset_s, 1),
        "reached": int(select_signals(clean[0], scope, satellite=satellite, system=system).sum()),
    }
    row |= {"loss_db": round(loss_db, 1), "upper_only": jamming.upper_only} if kind == "jamming" or after_jam else {}
    row |= {"jam_s": round(jam_s, 1)} if after_jam else {}
    row |= {} if kind == "jamming" else {f"shift_{key}": value for key, value in asdict(shift).items()}
    from_s = onset_s - jam_s if after_jam else onset_s
    return row | against_truth(outcome, clean[0], navigation, shift, onset_s, from_s, places[0], kind), outcome


def place_of(log: str, o: Observations, navigation: NavigationData) -> Reals:
    """Return where the receiver is at each epoch, (n, 3): as it was surveyed, else by its codes."""
    surveyed_m = LOGS[log].ecef_m
    if surveyed_m is None:
        return true_place_ecef_m(o, navigation)
    return np.broadcast_to(np.array(surveyed_m), (o.gpst.size, 3))


def judged(
    names: Sequence[str],
    attacked: Sequence[Observations],
    navigation: NavigationData,
    equipment: str,
    places: Sequence[Reals],
) -> Outcome:
    """Judge as `protect` does."""
    sources: list[ObservedFile] = [
        replace(open_real(name)[0], observations=o) for name, o in zip(names, attacked, strict=True)
    ]
    receptions = [observe_file(source) for source in sources]
    options: dict[str, Any] = {"standing": {"speed_max_m_s": 0.0}, "pair": {"antenna_distance_m": 0.99}}.get(
        equipment, {}
    )
    if equipment == "pair":
        options |= {"antenna_distance_sigma_m": 0.02}
    settings = adopt_antenna_multipath(Settings(**options), sources)
    settings = widen_windows(settings, [r.observations for r in receptions if r.observations is not None])
    predictors = None
    if equipment == "surveyed":
        place = place_surveyed(
            Standing(stands=True, oscillator=None, by=("surveyed_place",)),
            places[0].mean(axis=0),
            SURVEY_M**2 * np.eye(3),
        )
        predictors = {attacked[0].receiver: place}
    return judge(receptions, navigation, settings, Silent(), predictors=predictors)[0]


def against_truth(
    outcome: Outcome,
    clean: Observations,
    navigation: NavigationData,
    shift: FalseShift,
    onset_s: float,
    from_s: float,
    place_ecef_m: Reals,
    kind: str,
) -> Row:
    """Say what was said, when, and whether a position that was called trusted is wrong."""
    start = clean.gpst[0] - timedelta_from_s(float(clean.elapsed_s[0]))

    def since_s(gpst: np.datetime64 | None) -> float | None:
        if gpst is None:
            return None
        return round(float((gpst - start) / np.timedelta64(1, "ns")) * 1e-9 - onset_s, 2)

    decision = outcome.decision
    failed = [e for e in outcome.evidence if e.failed or e.says in ("attack", "spoofed")]
    before = [e for e in failed if (since_s(e.end_gpst) or 0.0) < from_s - onset_s]
    later = [e for e in failed if e not in before]
    seen = None if decision.onset is None else since_s(decision.onset.seen)
    accused = [e for e in failed if e.says in ("attack", "spoofed")]
    reason = None if decision.suspicion is None else decision.suspicion.finding
    row: Row = {
        "verdict": decision.verdict,
        "seen_s": seen,
        "noticed_s": min((since_s(e.end_gpst) for e in later), default=None),
        "by": dict(Counter(f"{e.detector}:{e.says}" for e in later)),
        "before": sorted({f"{e.detector}: {explain(e).sentence}" for e in before}),
        "why": "" if reason is None else explain(reason).sentence,
        "accused": sorted({f"{e.detector}: {explain(e).sentence}" for e in accused})[:3],
    }
    if kind == "jamming":
        return row
    found = fix(clean, navigation, signals=select_primary_signals(clean), multipath_sigma_m=1.0)
    good = np.isfinite(found.covariance_m2).all(axis=(1, 2))
    sigma_m = np.sqrt(np.median(found.covariance_m2[good], axis=0).diagonal())
    moved_m = np.linalg.norm(shift.offset_enu_m(clean.elapsed_s), axis=1)
    clock_m = SPEED_OF_LIGHT_M_S * np.abs(shift.offset_clock_s(clean.elapsed_s))
    place_sigma_m = float(np.sqrt((sigma_m[:3] ** 2).sum()))
    reached = (moved_m > SIGMAS * place_sigma_m) | (clock_m > SIGMAS * sigma_m[3])
    row |= {
        "sigma_m": round(place_sigma_m, 2),
        "reached_s": round(float(clean.elapsed_s[reached][0]) - onset_s, 2) if reached.any() else None,
        "most_m": round(float(moved_m.max()), 1),
        "trusted_wrong": 0,
        "trusted_after": 0,
    }
    for receiver in outcome.receivers:
        track = receiver.tracks.get("trusted")
        if receiver.positions is None or track is None:
            continue
        rows = (
            np.flatnonzero(track.fixed & (clean.elapsed_s[: track.gpst.size] >= onset_s))
            if track.gpst.size == clean.gpst.size
            else np.array([], np.intp)
        )
        off_m = np.linalg.norm(track.position_ecef_m[rows] - place_ecef_m[rows], axis=1)
        row["trusted_after"] += int(rows.size)
        row["trusted_wrong"] += int((off_m > WRONG_BOUNDS * TO_95 * max(place_sigma_m, 1.0)).sum())
    return row


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Print the counts."""
    attacks = [row for row in rows if row["kind"] != "jamming"]
    there = [row for row in attacks if row["reached_s"] is not None]
    yield f"{len(attacks)} attacks, {len(there)} reach three sigma of the fix"
    for title, key in (
        ("kind", "kind"),
        ("how torn", "how"),
        ("scope", "scope"),
        ("equipment", "equipment"),
        ("log", "log"),
    ):
        yield f"by {title}:"
        for value in sorted({row[key] for row in there}):
            if value:
                yield f"  {value:10} {_counts([row for row in there if row[key] == value])}"
    for key in ("codes_alone", "after_jam"):
        yield f"{key}: {_counts([row for row in there if row[key]])}"
    for kind in KINDS:
        for equipment in EQUIPMENT:
            some = [
                row for row in there if row["kind"] == kind and row["equipment"] == equipment and row["scope"] == "all"
            ]
            if some:
                yield f"  all satellites, {kind:6} {equipment:9} {_counts(some)}"
    unreached = [row for row in attacks if row["reached_s"] is None]
    yield f"below three sigma: {_words(unreached)}"
    yield f"something fails before the onset: {sum(bool(row['before']) for row in rows)} of {len(rows)}"
    yield from (f"    {row['name']} {row['log']}: {row['before']}" for row in rows if row["before"])
    wrong = [row for row in attacks if row.get("trusted_wrong")]
    yield f"a trusted position is wrong: {[row['name'] for row in wrong]}"
    authentic = [row["name"] for row in there if row["verdict"] == "authentic"]
    yield f"attacks called authentic: {authentic}"
    jams = [row for row in rows if row["kind"] == "jamming"]
    if jams:
        yield f"{len(jams)} jammings: {_words(jams)}"
        yield from (f"    {row['name']} {row['log']}: {row['accused']}" for row in jams if row["verdict"] == "spoofed")


def _words(rows: Sequence[Row]) -> str:
    return ", ".join(f"{word} {count}" for word, count in sorted(Counter(row["verdict"] for row in rows).items()))


def _counts(rows: Sequence[Row]) -> str:
    if not rows:
        return "none"
    seen = [row["seen_s"] - max(row["reached_s"], 0.0) for row in rows if row["seen_s"] is not None]
    named = sum(row["verdict"] in ("spoofed", "suspect") for row in rows)
    words = f"{len(rows):3}: {_words(rows)}; named {named / len(rows):.3f}"
    if seen:
        late = np.percentile(seen, [50, 90, 100])
        words += f"; after three sigma by {late[0]:.1f} s, 90 % {late[1]:.1f}, most {late[2]:.1f}"
    return words


def main() -> None:
    """Run and print the counts."""
    parser = parser_of(__doc__)
    parser.add_argument("--attacks", type=int, default=0)
    parser.add_argument("--jammings", type=int, default=0)
    parser.add_argument("--only", help="one draw, everything that failed in it")
    chosen: argparse.Namespace = parser.parse_args()
    if chosen.only:
        row, outcome = made(chosen.only)
        print("\n".join(f"{key}: {value}" for key, value in row.items()))
        for e in outcome.evidence:
            if e.failed or e.says in ("attack", "spoofed"):
                print(e.start_gpst, e.end_gpst, e.detector, e.says, e.p_value, explain(e).sentence[:200])
        return
    names = [f"attack-{k}" for k in range(chosen.attacks)] + [f"jamming-{k}" for k in range(chosen.jammings)]
    print("\n".join(table(rows_of(chosen, names, row_of))))


if __name__ == "__main__":
    main()
