"""Samples missing from signals that overlap: found, with their length, and none found where none are.

    python bench/missing_samples.py --scenes 120 --out missing.jsonl    behind drawn correlators, a second or two each
    python bench/missing_samples.py --table missing.jsonl

False signals, -1 to +10 dB, grow on the true ones of seven satellites and are drawn off by a chip at most; meanwhile
0.1 to 50 ms of samples are left out of three scenes in four, at any sample. Found is what the receiver reports within
a second; its length modulo a code period is what codes moved by, in all what a fix's time is ahead of before.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np
from rows import parser_of, rows_of

from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import asked
from skyproof.app.receive.reception import Reception
from skyproof.app.receive.tracker import Tracker, build_receiver_settings
from skyproof.arrays import Reals
from skyproof.fusion.trusted import fix_of
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.gnss.time import seconds_between
from skyproof.receiver.settings import ReceiverSettings
from skyproof.records import FixStatus, NavigationData, ObservationLog
from skyproof.simulator.attacks import Takeover
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd, Scenario, SceneReceiver, Sky
from skyproof.simulator.sites import Site
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import STEP_S, ModelReceiver, Waves, track_scene

SEED = 23
ONSET_S, CUT_S, AFTER_S = 9.0, (12.0, 22.0), 16.0
"""Of the attack; samples are missing between; so long after the latest of it: time of week is read anew."""
LONGEST_M = 290.0
SATS = 7
WHOLE = 0.4
"""Share of lengths that are whole code periods, which leave codes where they are."""
BEFORE_S, SOON_S = 0.5, 1.0
"""Around what is missing: the receiver states when it last had the signals."""
SAME_S = 2e-6
"""So far may a length be off: fixes move with what false signals show of time."""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """missing_s : 0 where nothing is missing. cut : the sample before which it is."""

    number: int
    missing_s: float
    cut: int
    power_db: float
    apart_m: float
    push: str
    rate_hz: float


def made(number: int) -> tuple[Drawn, Scene, NavigationData]:
    """The scene of a number, whatever others are drawn."""
    rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(number,)))
    start = np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s")
    navigation = make_nominal_constellation(start)
    rate_hz = float(rng.choice([4e6, 5e6]))
    missing_s = float(1e-4 * 500.0 ** rng.random()) if rng.random() < 0.75 else 0.0
    if missing_s and np.random.default_rng([SEED, number]).random() < WHOLE:
        missing_s = 1e-3 * math.ceil(1e3 * missing_s)
    drawn = Drawn(
        number=number,
        missing_s=round(missing_s * rate_hz) / rate_hz,
        cut=int(rng.uniform(*CUT_S) * rate_hz),
        power_db=float(rng.uniform(-1.0, 10.0)),
        apart_m=float(rng.uniform(0.0, LONGEST_M)),
        push=str(rng.choice(["held", "position", "clock"])),
        rate_hz=rate_hz,
    )
    place = {"lat_deg": float(rng.uniform(-65.0, 65.0)), "lon_deg": float(rng.uniform(-180.0, 180.0))}
    bearing_rad, end_s = rng.uniform(0.0, 2.0 * np.pi), CUT_S[1] + AFTER_S
    east_m, north_m = drawn.apart_m * math.sin(bearing_rad), drawn.apart_m * math.cos(bearing_rad)
    away = ((ONSET_S, 0.0, 0.0, 0.0), (end_s, east_m, north_m, 0.0)) if drawn.push == "position" else ()
    late = ((ONSET_S, 0.0), (end_s, drawn.apart_m / 299_792_458.0)) if drawn.push == "clock" else ()
    attack = Takeover(
        name="false",
        transmit=Site(lat_deg=place["lat_deg"] + 1e-3, lon_deg=place["lon_deg"], height_m=60.0),
        target="rx",
        power_db=drawn.power_db,
        power_points_db=((ONSET_S, -24.0), (ONSET_S + 2.0, 0.0)),
        onset_s=ONSET_S,
        away_points_enu_m=away,
        clock_points_s=late,
        phase=str(rng.choice(["aligned", "random"])),  # type: ignore[arg-type]
    )
    plain = Scenario(
        seed=int(rng.integers(2**31)),
        start_gpst=start,
        duration_s=end_s,
        mask_deg=15.0,
        receivers=(SceneReceiver(name="rx", height_m=50.0, oscillator="tcxo-good", **place),),
        front_end=FrontEnd(rate_hz=rate_hz, bandwidth_hz=0.8 * rate_hz, bits=2, encoding="sign-magnitude"),
        sky=Sky(zenith_cn0_dbhz=float(rng.uniform(45.0, 50.0)), horizon_cn0_dbhz=float(rng.uniform(40.0, 44.0))),
    )
    under = make_scene(plain, navigation).skies[0]
    order = np.argsort(-under.el_rad[under.knots_s.size // 2])[:SATS]
    sats = tuple(sorted(under.signals[column].id.sat for column in order))
    few = plain.model_copy(
        update={
            "attacks": (attack.model_copy(update={"sats": sats}),),
            "sky": plain.sky.model_copy(update={"sats": sats}),
        }
    )
    return drawn, make_scene(few, navigation), navigation


def without(waves: Waves, missing_s: float) -> Waves:
    """What arrives so much earlier: after samples that are missing."""
    at_s = STEP_S * (np.arange(len(waves.code_s))[:, None] + np.array([0.0, 0.5, 1.0])) + missing_s
    step = np.minimum((at_s / STEP_S).astype(np.int64), len(waves.code_s) - 1)
    u = (at_s / STEP_S - step)[..., None]

    def moved(parabolas: Reals) -> Reals:
        a, b, c = np.moveaxis(parabolas[step], -1, 0)
        first, middle, last = np.moveaxis(a + u * (b + u * c), 1, 0)
        return np.stack([first, 4.0 * middle - 3.0 * first - last, 2.0 * (first + last) - 4.0 * middle], axis=-1)

    code_s = moved(waves.code_s)
    code_s[..., 0] += missing_s
    return replace(waves, code_s=code_s, turns_cyc=moved(waves.turns_cyc))


class CutReceiver(ModelReceiver):
    """Behind drawn correlators, of a recording from which samples are missing before sample `cut`."""

    def __init__(self, scene: Scene, settings: ReceiverSettings, rng: np.random.Generator, drawn: Drawn) -> None:
        super().__init__(scene, 0, settings, rng)
        self._cut, self._after = drawn.cut, without(self.waves, drawn.missing_s)

    def stretches(self, begin: int, end: int) -> list[tuple[Waves, int]]:
        if begin < self._cut < end:
            return [(self.waves, self._cut), (self._after, end)]
        if begin >= self._cut:
            self.replace_waves(self._after)
        return super().stretches(begin, end)


def received(drawn: Drawn, scene: Scene, navigation: NavigationData) -> tuple[Reception, Tracker]:
    """Return what the receiver makes of a scene, and how it tracked."""
    settings = Settings()
    wanted = build_receiver_settings(GPS_SATS, settings, asked())
    receiver = CutReceiver(scene, wanted, np.random.default_rng([SEED, drawn.number]), drawn)
    return track_scene(scene, 0, receiver, navigation, settings)


def row_of(number: int) -> dict[str, Any]:
    """One row of the result: what was drawn, found and wrong."""
    begin = process_time()
    drawn, scene, navigation = made(number)
    reception, tracker = received(drawn, scene, navigation)
    cut_s, period_s = drawn.cut / drawn.rate_hz, GPS_L1_CA.period_s
    near = [g for g in tracker.gaps if drawn.missing_s and -BEFORE_S < g.elapsed_s - cut_s < SOON_S]
    result = [round((-g.shift_s % period_s) * 1e3, 5) for g in near if g.shift_s]
    rest = [round(g.elapsed_s, 2) for g in tracker.gaps if g not in near]
    ahead_s = None if reception.observations is None else _ahead_s(reception.observations, navigation, scene, cut_s)
    return vars(drawn) | {
        "cut_s": cut_s,
        "found": bool(near),
        "shown_ms": result,
        "others_s": rest,
        "ahead_s": ahead_s,
        "cpu_s": round(process_time() - begin, 1),
    }


def _ahead_s(o: ObservationLog, navigation: NavigationData, scene: Scene, cut_s: float) -> float | None:
    """By how much the time of fixes is ahead of that of samples after the cut, against before."""
    fix = fix_of(o.read(0, o.elapsed_s.size), navigation, multipath_sigma_m=1.0, elevation_mask_deg=5.0)
    if fix is None:
        return None
    good = fix.status == FixStatus.OK
    ahead_s = seconds_between(fix.gpst, scene.scenario.start_gpst) - o.elapsed_s
    sides = [ahead_s[good & side] for side in (o.elapsed_s < cut_s - 0.2, o.elapsed_s > cut_s + SOON_S)]
    return float(np.median(sides[1]) - np.median(sides[0])) if all(side.size for side in sides) else None


def table(rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """The counts, as markdown, and the numbers of what went wrong."""
    rows = list(rows)
    yield "| missing, ms | scenes | found | length in all right | no fix after | wrong length | elsewhere |"
    yield "|---|---|---|---|---|---|---|"
    for words, part in _parts(rows):
        known = [r for r in part if r["ahead_s"] is not None]
        right = [r for r in known if abs(r["ahead_s"] - r["missing_s"]) < SAME_S]
        yield (
            f"| {words} | {len(part)} | {sum(r['found'] for r in part)} "
            f"| {len(right)} | {len(part) - len(known)} | {len(known) - len(right)} "
            f"| {sum(bool(r['others_s']) for r in part)} |"
        )
    for words, chosen in (
        ("missed", [r for r in rows if r["missing_s"] and not r["found"]]),
        ("elsewhere", [r for r in rows if r["others_s"]]),
        (
            "wrong length",
            [r for r in rows if r["ahead_s"] is not None and abs(r["ahead_s"] - r["missing_s"]) >= SAME_S],
        ),
    ):
        yield f"{words}: {' '.join(str(r['number']) for r in chosen) or 'none'}"


def _parts(rows: list[Mapping[str, Any]]) -> Iterator[tuple[str, list[Mapping[str, Any]]]]:
    def is_whole(row: Mapping[str, Any]) -> bool:
        return abs(row["missing_s"] - 1e-3 * round(1e3 * row["missing_s"])) < 1e-9

    cut = [row for row in rows if row["missing_s"]]
    yield "none", [row for row in rows if not row["missing_s"]]
    for low, high in ((0.1, 1.0), (1.0, 20.0), (20.0, 50.0)):
        yield f"{low:g} to {high:g}", [r for r in cut if low <= 1e3 * r["missing_s"] < high and not is_whole(r)]
    bits = [row for row in cut if is_whole(row) and round(1e3 * row["missing_s"]) % 20 == 0]
    yield "whole code periods", [row for row in cut if is_whole(row) and row not in bits]
    yield "whole data bits", bits


def main() -> None:
    options = parser_of(__doc__)
    options.add_argument("--scenes", type=int, default=0)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--only", type=int, nargs="*")
    chosen = options.parse_args()
    if chosen.only is not None:
        rows = [row_of(number) for number in chosen.only]
        print(json.dumps(rows, indent=1))
    else:
        numbers = range(chosen.first, chosen.first + chosen.scenes)
        rows = rows_of(chosen, numbers, row_of, key="number")
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
