"""When loud takeovers are noticed, and how often clean skies with reflections or a jammer are suspect.

    python bench/onsets.py --scenes 40 --out onsets.jsonl     of each kind, seconds a scene; it continues
    python bench/onsets.py --table onsets.jsonl               the counts alone

One receiver that stands, behind drawn correlators (`bench/takeovers.py`), with and without that being stated. False
signals begin 25 to 60 s after the start within a second, 10 dB stronger than the true ones, on top of them, and are
held there. Clean skies are plain, with four to eight reflections, or with noise, a line or a chirp of 0 to 30 dB for 5
to 20 s. The delay is that of the first word after the onset (the end of its window), and of the time that it gives.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rows import Row, parser_of, rows_of
from takeovers import MOST_SATS, draw, made, platform_of

from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import seconds_between
from skyproof.simulator.attacks import Interference
from skyproof.simulator.scenario import Multipath, Scenario
from skyproof.simulator.sites import Site
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene

KINDS = ("loud", "jammed", "reflections", "plain")
OVER_DB = 10.0
AFTER_S = 22.0


def row_of(name: str) -> Row:
    """Return when a scene of a name such as "jammed-17" is first suspect or spoofed, and by which tests."""
    kind, _, number = name.partition("-")
    rng = np.random.default_rng(np.random.SeedSequence(46, spawn_key=(int(number),)))
    onset_s = float(rng.uniform(25.0, 60.0))
    drawn = replace(
        draw(int(number)),
        motion="standing",
        given="static" if int(number) % 2 else "nothing",
        power_db=OVER_DB,
        rise_s=float(rng.uniform(0.0, 1.0)),
        onset_s=onset_s,
        held_s=AFTER_S,
        pull_s=1.0,
    )
    scenario, _ = made(drawn)
    scenario = scenario.model_copy(update={"duration_s": round(onset_s + AFTER_S)})
    scene = make_scene(changed(scenario, kind, rng, onset_s), make_nominal_constellation(drawn.start_gpst))
    with TemporaryDirectory(prefix="onset") as folder:
        navigation = make_nominal_constellation(drawn.start_gpst)
        verdict, outcome = protect_scene(scene, navigation, platform_of(drawn, Path(folder)), drawn.seed)
    start = scene.scenario.start_gpst
    bad = [e for e in outcome.evidence if e.failed or e.says in ("spoofed", "attack")]
    times = [
        (float(seconds_between(e.end_gpst, start)), float(seconds_between(e.dated_gpst or e.end_gpst, start)), e)
        for e in bad
    ]
    later = [item for item in sorted(times, key=lambda item: item[0]) if item[0] >= onset_s]
    return {
        "name": name,
        "given": drawn.given,
        "rate_hz": drawn.rate_hz,
        "bits": drawn.bits,
        "verdict": verdict.verdict,
        "before": sorted({e.detector for end_s, _, e in times if end_s < onset_s}),
        "by": sorted({f"{e.detector} {e.data.get('test', e.code)}" for _, _, e in later}),
        "word_s": later[0][0] - onset_s if later else None,
        "dated_s": min(item[1] for item in later) - onset_s if later else None,
    }


def changed(scenario: Scenario, kind: str, rng: np.random.Generator, onset_s: float) -> Scenario:
    """Return the scenario with what its kind has in place of the attack."""
    if kind == "loud":
        return scenario
    update: dict[str, object] = {"attacks": ()}
    if kind == "reflections":
        sats = sorted(scenario.sky.sats or ())
        some = rng.choice(sats, size=min(MOST_SATS, int(rng.integers(4, 9))), replace=False)
        rays = tuple(
            Multipath(
                delay_m=float(rng.uniform(5.0, 250.0)),
                power_db=float(rng.uniform(-20.0, -6.0)),
                phase_deg=float(rng.uniform(0.0, 360.0)),
                rate_hz=float(rng.uniform(-0.2, 0.2)),
                sats=(str(sat),),
            )
            for sat in some
        )
        (receiver,) = scenario.receivers
        update["receivers"] = (receiver.model_copy(update={"multipath": rays}),)
    if kind == "jammed":
        (receiver,) = scenario.receivers
        jammer = Interference(
            kind=str(rng.choice(["noise", "cw", "chirp"])),
            name="jam",
            transmit=Site(lat_deg=receiver.lat_deg + 5e-3, lon_deg=receiver.lon_deg, height_m=60.0),
            power_db=float(rng.uniform(0.0, 30.0)),
            offset_hz=float(rng.uniform(-5e5, 5e5)),
            sweep_hz=1e6,
            period_s=2e-5,
            onset_s=onset_s - 10.0,
            until_s=onset_s - 10.0 + float(rng.uniform(5.0, 20.0)),
        )
        update["interference"] = (jammer,)
        update["front_end"] = scenario.front_end.model_copy(update={"agc": bool(rng.random() < 0.5)})
    return scenario.model_copy(update=update)


def table(rows: Sequence[Row]) -> Iterator[str]:
    """A line for each kind of scene and what is stated."""
    yield "| scenes | given | runs | spoofed | suspect | no attack seen | word, s: median (all) | time given, s | by |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for kind in KINDS:
        for given in ("nothing", "static"):
            some = [row for row in rows if row["name"].startswith(kind) and row["given"] == given]
            if not some:
                continue
            words = Counter(row["verdict"] for row in some)
            by = Counter(name for row in some for name in row["by"])
            yield (
                f"| {kind} | {given} | {len(some)} | {words['spoofed']} | {words['suspect']} | "
                f"{words['no_attack_seen']} | {_spread(some, 'word_s')} | {_spread(some, 'dated_s')} | "
                f"{', '.join(f'{name} {n}' for name, n in by.most_common()) or '–'} |"
            )


def _spread(rows: Sequence[Row], name: str) -> str:
    values = [row[name] for row in rows if row[name] is not None]
    return f"{np.median(values):.1f} ({min(values):.1f} to {max(values):.1f})" if values else "–"


def main() -> None:
    """Run and print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=int, default=0, help="of each kind")
    chosen = parser.parse_args()
    names = [f"{kind}-{number}" for number in range(chosen.scenes) for kind in KINDS]
    print("\n".join(table(rows_of(chosen, names, row_of))))


if __name__ == "__main__":
    main()
