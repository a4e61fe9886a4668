"""How often each word of the answer is said: of attacks, and of clean skies, by what equipment there is.

    python bench/words.py --attacks 300 --clean 150 --out words.jsonl --processes 2    goes on where it was stopped
    python bench/words.py --table words.jsonl                                          the table alone

Scenes are those of `skyproof.studies.random_scenes`, of two receivers, at measurement level through the whole decision;
each is judged with every equipment. An attack captures an equipment if one of its receivers follows false signals of
four satellites for five seconds. Clean skies are as errors are assumed ("plain"), with reflections and what models of
the air leave ("reflections"), or plain with a jammer 0.2 to 2 km away for 5 to 20 s, 0 to 30 dB over the receiver's
noise ("jammed").
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from drawn import FOLLOWED_S, heard_of, of_receiver, pairs_of
from rows import Row, parser_of, rows_of

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge
from skyproof.simulator.attacks import Interference
from skyproof.simulator.sites import Site
from skyproof.simulator.sky import make_scene
from skyproof.studies.random_scenes import BuiltScene, DrawnScene, build_scene, draw_scene
from skyproof.verdict import WORDS, write_word

CLEAN: Final = ("plain", "reflections", "jammed")
FAR_M: Final = 100.0
OF_CAPTURED: Final = ("from the start", f"{FAR_M:.0f} m off or more", "nearer")
GROUPS: Final = ("captured", *(f"captured, {how}" for how in OF_CAPTURED), "not captured", *CLEAN)
EQUIPMENT: Final = ("one receiver", "one that stands", "two", "two, their distance", "two, their places")
METRES_PER_DEG: Final = 111e3


def row_of(name: str) -> Row:
    """The words of a scene of a name such as "jammed-17", by equipment."""
    kind, _, number = name.partition("-")
    drawn = draw_scene(f"{'attack' if kind == 'attack' else 'clean'}-{number}", most_receivers=2)
    made = build_scene(drawn if kind == "attack" else replace(drawn, field=kind == "reflections"))
    if made is None:
        return {"name": name, "words": {}}
    heard = heard_of(jammed(made, int(number)) if kind == "jammed" else made)
    words, captured, by = {}, {}, {}
    for equipment, settings in equipment_of(made).items():
        used = heard[:1] if equipment.startswith("one") else heard
        outcome, _ = judge([h.reception for h in used], made.navigation, settings, Silent())
        words[equipment] = outcome.decision.verdict
        by[equipment] = sorted({e.detector for e in outcome.evidence if e.failed})
        each = [of_receiver(made, h, r) for h, r in pairs_of(used, outcome)]
        captured[equipment] = any(item["captured_s"] >= FOLLOWED_S for item in each)
    how = None if drawn.attack is None else _how(drawn.attack.onset_s, float(np.linalg.norm(drawn.attack.away_enu_m)))
    return {"name": name, "words": words, "captured": captured, "failed": by, "how": how}


def _how(onset_s: float, away_m: float) -> str:
    """Say which of the captured an attack would be of."""
    return OF_CAPTURED[0] if onset_s <= 0.0 else OF_CAPTURED[1 if away_m >= FAR_M else 2]


def equipment_of(made: BuiltScene) -> dict[str, Settings]:
    """What is stated, by equipment, where it is true."""
    drawn = made.drawn
    found = {"one receiver": Settings(), "two": Settings()}
    if drawn.motion == "still":
        found["one that stands"] = Settings(speed_max_m_s=0.0)
    if drawn.motion != "turning":
        found["two, their places"] = Settings(antennas_enu_m=made.antennas_enu_m)
    found["two, their distance"] = Settings(antenna_distance_m=drawn.given_distance_m)
    return found


def jammed(made: BuiltScene, number: int) -> BuiltScene:
    rng = np.random.default_rng(np.random.SeedSequence(made.drawn.seed, spawn_key=(number,)))
    drawn, lasts_s = made.drawn, float(rng.uniform(5.0, 20.0))
    onset_s = float(rng.uniform(8.0, drawn.duration_s - lasts_s - 5.0))
    jammer = Interference(
        kind="noise",
        name="jam",
        transmit=_away(drawn, float(rng.uniform(200.0, 2000.0)), float(rng.uniform(0.0, 2.0 * np.pi))),
        power_db=float(rng.uniform(0.0, 30.0)),
        onset_s=onset_s,
        until_s=onset_s + lasts_s,
    )
    scenario = made.scenario.model_copy(update={"interference": (jammer,)})
    return replace(made, scenario=scenario, scene=make_scene(scenario, made.navigation))


def _away(drawn: DrawnScene, distance_m: float, bearing_rad: float) -> Site:
    north_m, east_m = distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)
    east_deg = east_m / METRES_PER_DEG / math.cos(math.radians(drawn.lat_deg))
    lon_deg = (drawn.lon_deg + east_deg + 180.0) % 360.0 - 180.0
    return Site(lat_deg=drawn.lat_deg + north_m / METRES_PER_DEG, lon_deg=lon_deg, height_m=drawn.height_m)


def table(rows: Sequence[Row]) -> Iterator[str]:
    """A line for each equipment and kind of scene: shares of the words, and how many runs each test made suspect."""
    yield f"| equipment | scenes | runs | {' | '.join(write_word(word) for word in reversed(WORDS))} | suspect by |"
    yield f"|---|---|---{'|---' * len(WORDS)}|---|"
    for equipment in EQUIPMENT:
        for group in GROUPS:
            matching = [row for row in rows if equipment in row["words"] and group in _groups(row, equipment)]
            if matching:
                yield f"| {equipment} | {group} | {_cells(matching, equipment)} |"


def _groups(row: Mapping[str, Any], equipment: str) -> tuple[str, ...]:
    kind = str(row["name"]).partition("-")[0]
    if kind in CLEAN:
        return (kind,)
    return ("captured", f"captured, {row['how']}") if row["captured"][equipment] else ("not captured",)


def _cells(rows: Sequence[Row], equipment: str) -> str:
    counts = Counter(row["words"][equipment] for row in rows)
    by = Counter(name for row in rows if row["words"][equipment] == "suspect" for name in row["failed"][equipment])
    shares = [f"{counts[word] / len(rows):.2f}" for word in reversed(WORDS)]
    return " | ".join([str(len(rows)), *shares, ", ".join(f"{name} {n}" for name, n in by.most_common()) or "–"])


def main() -> None:
    """Run and print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--attacks", type=int, default=0)
    parser.add_argument("--clean", type=int, default=0, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first scene")
    chosen = parser.parse_args()
    counts = {"attack": chosen.attacks} | dict.fromkeys(CLEAN, chosen.clean)
    names = [f"{kind}-{number}" for kind, n in counts.items() for number in range(chosen.first, chosen.first + n)]
    print("\n".join(table(rows_of(chosen, sorted(names, key=lambda name: int(name.partition("-")[2])), row_of))))


if __name__ == "__main__":
    main()
