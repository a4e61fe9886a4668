"""Takeovers drawn at random, of one receiver with one antenna, through the whole of `protect`.

    python bench/takeovers.py --scenes 300 --out drawn.jsonl                     behind drawn correlators, a minute each
    python bench/takeovers.py --level measurements --scenes 300 --out m.jsonl    of drawn measurements, half a minute
    python bench/takeovers.py --level samples --longest-s 20 --scenes 30 --out s.jsonl    through samples, minutes
    python bench/takeovers.py --only 17                                         one scene, its row
    python bench/takeovers.py --tracking vector --scenes 30 --out vector.jsonl  the same, loops closed by one filter
    python bench/takeovers.py --table takeovers.jsonl                           the counts alone

All go on where they were stopped. False signals begin between 15 s and `--longest-s` after the start, which the run is
not told, grow on the true ones, are held there, and drawn off in position, time or both. A trusted fix is wrong if it
is off horizontally by more than three times its stated 95 % bound. The word comes at the end of the first window after
the pull's start in which a test says spoofed or attack; the run's verdict is its last word.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, Literal

import numpy as np
import tomli_w
from rows import parser_of, rows_of

from skyproof.app.protect import protect
from skyproof.app.protect.coasting import usable_fixes
from skyproof.app.protect.outcome import Outcome
from skyproof.app.receive.reception import Reception
from skyproof.arrays import Reals
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import seconds_between
from skyproof.records import Fix, FixStatus
from skyproof.simulator.attacks import Takeover
from skyproof.simulator.files import write_samples, write_series
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd, Scenario, SceneImu, SceneReceiver, Sky
from skyproof.simulator.sites import Site, WayPoints
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene
from skyproof.studies.protection.errors import fix_errors
from skyproof.studies.receiver_model import ChannelNoise, model_receptions
from skyproof.verdict import WORDS, Verdict, write_word

SEED = 7
WRONG_BOUNDS = 3.0
EARLIEST_S, LONGEST_S = 15.0, 3600.0
"""Between which the attack begins, early ones drawn more often: every ratio of times is as likely."""
RATES_HZ = (4e6, 5e6, 8e6, 25e6)
RATE_SHARES = (0.45, 0.4, 0.1, 0.05)
AFTER_S = 6.0
"""Of the run after the pull."""
MOST_SATS = 8


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """All that a scene is made of. push : which of position and time is drawn off. given : what the user states.
    onset_s : of the false signals. grade : of the inertial unit."""

    number: int
    seed: int
    lat_deg: float
    lon_deg: float
    start_gpst: np.datetime64
    rate_hz: float
    bits: int
    zenith_cn0_dbhz: float
    horizon_cn0_dbhz: float
    motion: Literal["standing", "walking", "driving"]
    heading_deg: float
    given: Literal["nothing", "static", "imu"]
    power_db: float
    rise_s: float
    held_s: float
    push: Literal["position", "clock", "both"]
    pull_m_s: float
    pull_s: float
    bearing_rad: float
    phase: Literal["aligned", "random"]
    carrier: Literal["follows", "locked"]
    onset_s: float
    grade: Literal["tactical", "navigation"]

    @property
    def pull_from_s(self) -> float:
        return self.onset_s + self.rise_s + self.held_s

    @property
    def duration_s(self) -> float:
        return math.ceil(self.pull_from_s + self.pull_s + AFTER_S)


@dataclass(frozen=True, kw_only=True)
class Way:
    """How scenes are judged. level : what is drawn. longest_s : to the latest onset."""

    level: str
    tracking: str
    longest_s: float


def draw(number: int, longest_s: float = LONGEST_S) -> Drawn:
    """Draw the scene of a number, whatever others are drawn."""
    rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(number,)))
    motion = str(rng.choice(["standing", "walking", "driving"], p=[0.5, 0.2, 0.3]))
    helped = "static" if motion == "standing" else "imu"
    pull_m_s = float(math.exp(rng.uniform(math.log(0.3), math.log(10.0))))
    return Drawn(
        number=number,
        seed=int(rng.integers(2**31)),
        lat_deg=float(rng.uniform(-65.0, 65.0)),
        lon_deg=float(rng.uniform(-180.0, 180.0)),
        start_gpst=np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s"),
        rate_hz=float(rng.choice(RATES_HZ, p=RATE_SHARES)),
        bits=int(rng.choice([1, 2, 8])),
        zenith_cn0_dbhz=float(rng.uniform(45.0, 50.0)),
        horizon_cn0_dbhz=float(rng.uniform(38.0, 44.0)),
        motion=motion,
        heading_deg=float(rng.uniform(0.0, 360.0)),
        given=str(rng.choice(["nothing", helped], p=[0.35, 0.65])),
        power_db=0.0 if rng.random() < 0.2 else float(rng.uniform(-1.0, 10.0)),
        rise_s=float(rng.uniform(0.0, 6.0)),
        held_s=float(rng.choice([0.0, rng.uniform(0.0, 12.0), rng.uniform(12.0, 30.0)], p=[0.2, 0.6, 0.2])),
        push=str(rng.choice(["position", "clock", "both"])),
        pull_m_s=pull_m_s,
        pull_s=float(np.clip(rng.uniform(60.0, 400.0) / pull_m_s, 12.0, 50.0)),
        bearing_rad=float(rng.uniform(0.0, 2.0 * np.pi)),
        phase=str(rng.choice(["aligned", "random"])),
        carrier=str(rng.choice(["follows", "locked"], p=[0.7, 0.3])),
        onset_s=float(math.exp(rng.uniform(math.log(EARLIEST_S), math.log(longest_s)))),
        grade=str(rng.choice(["tactical", "navigation"])),
    )  # type: ignore[arg-type]


def made(drawn: Drawn) -> tuple[Scenario, Scene]:
    """The scene of the highest satellites, worked out."""
    navigation = make_nominal_constellation(drawn.start_gpst)
    under = make_scene(_scenario(drawn, None).model_copy(update={"attacks": ()}), navigation)
    sky = under.skies[0]
    order = np.argsort(-sky.el_rad[sky.knots_s.size // 2])[:MOST_SATS]
    scenario = _scenario(drawn, tuple(sorted(sky.signals[column].id.sat for column in order)))
    return scenario, make_scene(scenario, navigation)


def _scenario(drawn: Drawn, sats: tuple[str, ...] | None) -> Scenario:
    begin_s, end_s = drawn.pull_from_s, drawn.pull_from_s + drawn.pull_s
    off_m = drawn.pull_m_s * drawn.pull_s
    east_m, north_m = off_m * math.sin(drawn.bearing_rad), off_m * math.cos(drawn.bearing_rad)
    away = ((begin_s, 0.0, 0.0, 0.0), (end_s, east_m, north_m, 0.0)) if drawn.push != "clock" else ()
    late = ((begin_s, 0.0), (end_s, off_m / SPEED_OF_LIGHT_M_S)) if drawn.push != "position" else ()
    moving = {} if drawn.motion == "standing" else {"path": _way(drawn)}
    attack = Takeover(
        name="false",
        transmit=Site(lat_deg=drawn.lat_deg + 1e-3, lon_deg=drawn.lon_deg, height_m=60.0, **moving),
        target="rx",
        power_db=drawn.power_db,
        power_points_db=((drawn.onset_s, -24.0), (drawn.onset_s + drawn.rise_s, 0.0)) if drawn.rise_s else (),
        onset_s=drawn.onset_s,
        away_points_enu_m=away,
        clock_points_s=late,
        phase=drawn.phase,
        carrier=drawn.carrier,
        sats=sats,
    )
    receiver = SceneReceiver(
        name="rx",
        lat_deg=drawn.lat_deg,
        lon_deg=drawn.lon_deg,
        height_m=50.0,
        oscillator="tcxo-good",
        imu=SceneImu(grade=drawn.grade, rate_hz=100.0) if drawn.given == "imu" else None,
        **moving,
    )
    return Scenario(
        seed=drawn.seed,
        start_gpst=drawn.start_gpst,
        duration_s=drawn.duration_s,
        mask_deg=8.0,
        receivers=(receiver,),
        front_end=FrontEnd(
            rate_hz=drawn.rate_hz,
            bandwidth_hz=0.8 * drawn.rate_hz,
            bits=drawn.bits,
            encoding="sign" if drawn.bits == 1 else "sign-magnitude" if drawn.bits == 2 else "int",
        ),
        attacks=(attack,),
        sky=Sky(zenith_cn0_dbhz=drawn.zenith_cn0_dbhz, horizon_cn0_dbhz=drawn.horizon_cn0_dbhz, sats=sats),
    )


def _way(drawn: Drawn) -> WayPoints:
    """Turns left and right every ten seconds or so."""
    speed_m_s = 1.4 if drawn.motion == "walking" else 12.0
    places, heading = [(0.0, 0.0, 0.0)], math.radians(drawn.heading_deg)
    for leg in range(int(drawn.duration_s / 10.0) + 4):
        turned = heading + (0.5 if leg % 2 else -0.3)
        east_m, north_m, up_m = places[-1]
        places.append(
            (east_m + 10.0 * speed_m_s * math.sin(turned), north_m + 10.0 * speed_m_s * math.cos(turned), up_m)
        )
    return WayPoints(points_enu_m=tuple(places), speed_m_s=speed_m_s, start_s=-10.0, from_rest=False, to_rest=False)


def platform_of(drawn: Drawn, folder: Path, tracking: str = "scalar", **settings: Any) -> Path:
    """Write what the user states as a platform file. settings : beside the default ones."""
    chosen = {"tracking": tracking} | settings
    stated: dict[str, Any] = {"receivers": [{"name": "rx"}], "protect": chosen}
    if drawn.given == "static":
        stated |= {"motion": "static", "oscillator": "tcxo"}
    elif drawn.given == "imu":
        stated |= {"motion": "moving", "imu": {"file": "rx-imu.csv", "grade": drawn.grade}}
    path = folder / "platform.toml"
    path.write_text(tomli_w.dumps(stated), encoding="utf-8")
    return path


def row_of(number: int, way: Way) -> dict[str, Any]:
    """Return the row of `examine`, or what it failed with."""
    try:
        return examine(number, way)
    except Exception as error:  # whatever it is, it is counted
        return {"number": number, "verdict": "crashed", "error": f"{type(error).__name__}: {error}"}


def examine(number: int, way: Way) -> dict[str, Any]:
    """Return a row of the result: what was drawn, said and wrong."""
    begin = process_time()
    drawn = draw(number, way.longest_s)
    _, scene = made(drawn)
    with TemporaryDirectory(prefix="takeover") as name:
        folder = Path(name)
        if drawn.given == "imu":
            write_series(scene, folder)
        platform = platform_of(drawn, folder, way.tracking)
        verdict, outcome = LEVELS[way.level](drawn, scene, folder, platform)
    row = vars(drawn) | {
        "start_gpst": str(drawn.start_gpst),
        "duration_s": drawn.duration_s,
        "verdict": verdict.verdict,
        "summary": verdict.summary,
        "because": verdict.reason,
        "cpu_s": round(process_time() - begin, 1),
    }
    return row | _words(drawn, scene, outcome) | fixes_of(drawn, scene, outcome)


def _by_samples(drawn: Drawn, scene: Scene, folder: Path, platform: Path) -> tuple[Verdict, Outcome]:
    paths, nav = write_samples(scene, folder, "raw"), folder / "nav.rnx"
    write_nav(nav, make_nominal_constellation(drawn.start_gpst))
    result = protect(paths, nav=nav, platform=platform)
    return result.verdict, result.outcome


def _by_correlators(drawn: Drawn, scene: Scene, folder: Path, platform: Path) -> tuple[Verdict, Outcome]:
    return protect_scene(scene, make_nominal_constellation(drawn.start_gpst), platform, drawn.seed)


def _by_measurements(drawn: Drawn, scene: Scene, folder: Path, platform: Path) -> tuple[Verdict, Outcome]:
    def receive(scene: Scene, index: int, settings: Any, navigation: Any, rng: Any, unit: Any = None) -> Reception:
        return model_receptions(scene, ChannelNoise(code_m=0.5), rng=rng)[index].reception

    return protect_scene(scene, make_nominal_constellation(drawn.start_gpst), platform, drawn.seed, receive)


LEVELS = {"correlators": _by_correlators, "measurements": _by_measurements, "samples": _by_samples}


def _words(drawn: Drawn, scene: Scene, outcome: Outcome) -> dict[str, Any]:
    """When a test said that there is an attack, and what was chosen."""
    start = scene.scenario.start_gpst
    saying = [e for e in outcome.evidence if e.says in ("spoofed", "attack")]
    ends_s = sorted(float(seconds_between(e.end_gpst, start)) for e in saying)
    early = [s for s in ends_s if s < drawn.onset_s]
    later = [s for s in ends_s if s >= drawn.onset_s]
    word_s = later[0] - drawn.pull_from_s if later else None
    doubting = [e for e in outcome.evidence if e.says == "undecided" and e.overrules]
    open_s = [float(seconds_between(e.end_gpst, start)) for e in doubting]
    return {
        "alarms_before": len(early),
        "word_s": word_s,
        "word_m": None if word_s is None else max(word_s, 0.0) * drawn.pull_m_s,
        "by": sorted({e.detector for e in saying}),
        "doubt_s": min(open_s) - drawn.pull_from_s if open_s else None,
        "doubted_by": sorted({e.detector for e in doubting}),
    }


def fixes_of(drawn: Drawn, scene: Scene, outcome: Outcome) -> dict[str, Any]:
    """Compare fixes that may be used with the truth; tell how long an ordinary receiver had one, and how far off.

    unbounded : fixes that say that nothing bounds how far an attack may have moved them; they are beyond no bound.
    """
    sky, (r,) = scene.skies[0], outcome.receivers
    row: dict[str, Any] = {
        "wrong": 0,
        "fixes": 0,
        "beyond": 0,
        "worst_m": None,
        "worst_bound_m": None,
        "worst_bounds": None,
        "unbounded": 0,
    }
    row |= {"ordinary": 0.0, "ordinary_off_m": None, "trusted_s": 0.0, "consistent_s": 0.0, "inertia_s": 0.0}
    row["time_off_s"] = None
    o = r.reception.observations
    if o is None or r.positions is None:
        return row
    interval_s = float(np.median(np.diff(o.elapsed_s)))
    level, bounds, off_s = [], [], []
    for kind, fix in usable_fixes(r.positions):
        good = np.flatnonzero(fix.status == FixStatus.OK)
        errors = fix_errors(scene, sky, fix)
        level.append(errors.horizontal_m)
        bounds.append(errors.horizontal_m / (errors.bound_m + np.nan_to_num(errors.hidden_m, nan=np.inf)))
        row["unbounded"] += int(np.isnan(errors.hidden_m).sum())
        row["inertia_s" if kind in ("inertial", "held") else f"{kind}_s"] += interval_s * good.size
        if kind in ("trusted", "consistent"):
            off_s.append(_time_off_s(scene, o, fix, good, drawn.onset_s))
    if level and (every := np.concatenate(level)).size:
        times = np.concatenate(bounds)
        row |= {
            "fixes": int(every.size),
            "wrong": int(np.sum(times > WRONG_BOUNDS)),
            "beyond": int(np.sum(times > 1.0)),
            "worst_m": float(every.max()),
            "worst_bound_m": float(every.max() / times[np.argmax(every)]) if times[np.argmax(every)] else None,
            "worst_bounds": float(times.max()),
        }
    if off_s and (late := np.concatenate(off_s)).size:
        row["time_off_s"] = float(np.abs(late).max())
    ordinary = r.positions.whole("unprotected") if "unprotected" in r.positions.masks else None
    trusted = r.positions.whole("trusted")
    fixed = sum(_fixed_seconds([f for f in (ordinary, trusted) if f is not None], drawn.duration_s, scene))
    row["ordinary"] = round(fixed / max(drawn.duration_s - 6.0, 1.0), 3)
    last = ordinary if ordinary is not None else trusted
    if last is not None and (last.status == FixStatus.OK).any():
        row["ordinary_off_m"] = float(fix_errors(scene, sky, last).horizontal_m[-1])
    return row


def _true_s(scene: Scene, fix: Fix, good: Any) -> Reals:
    """Of a fix's own time: a false one is off by less than 3 us here, in which nothing moves."""
    return np.asarray(seconds_between(fix.gpst[good], scene.scenario.start_gpst), np.float64)


def _time_off_s(scene: Scene, o: Any, fix: Fix, good: Any, onset_s: float) -> Reals:
    """Time given less true time: epochs are evenly spaced by the receiver's clock, whose error before the attack and
    its drift then are its own."""
    t = _true_s(scene, fix, good)
    bias = fix.clock_bias_s[good]
    clean = t < onset_s
    if clean.sum() < 10:
        return np.empty(0)
    line = np.polyfit(t[clean], bias[clean], 1)
    return np.asarray(bias - np.polyval(line, t))


def _fixed_seconds(fixes: Sequence[Fix], duration_s: float, scene: Scene) -> list[int]:
    """For each whole second, 1 if there is a fix of any kind in it."""
    seen: set[int] = set()
    for fix in fixes:
        good = np.flatnonzero(fix.status == FixStatus.OK)
        seen |= set(np.floor(_true_s(scene, fix, good)).astype(int).tolist())
    return [int(second in seen) for second in range(6, int(duration_s))]


# ---------------------------------------------------------------------- all of them


def table(rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """The counts: by what is drawn off and what is given."""
    rows = list(rows)
    yield from (f"{row['number']} crashed: {row['error']}" for row in rows if row["verdict"] == "crashed")
    rows = [row for row in rows if row["verdict"] != "crashed"]
    for push in ("position", "clock", "both"):
        for given in ("nothing", "static", "imu"):
            part = [row for row in rows if row["push"] == push and row["given"] == given]
            if part:
                yield f"{push:<8} {given:<7} {_counts(part)}"
    yield f"all              {_counts(rows)}"
    for words, chosen in (
        ("wrong trusted fixes", [r for r in rows if r["wrong"]]),
        ("authentic", [r for r in rows if r["verdict"] == "authentic"]),
        ("alarm before the onset", [r for r in rows if r["alarms_before"]]),
    ):
        yield f"{words}: {' '.join(str(r['number']) for r in chosen) or 'none'}"


def _counts(part: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(row["verdict"] for row in part)
    named = [row for row in part if row["word_s"] is not None]
    words = f"{len(part):3d}: " + ", ".join(f"{write_word(word)} {counts[word]:2d}" for word in reversed(WORDS))
    if named:
        s, m = (np.median([row[key] for row in named]) for key in ("word_s", "word_m"))
        words += f"; word in {len(named)}, median {s:.0f} s and {m:.0f} m after the pull's start"
    worst = [row["worst_m"] for row in part if row["worst_m"] is not None]
    ordinary = np.mean([row["ordinary"] for row in part])
    return (
        f"{words}; wrong {sum(bool(row['wrong']) for row in part)}; worst trusted {max(worst, default=0.0):.1f} m; "
        f"seconds with an ordinary fix {ordinary:.3f}"
    )


def main() -> None:
    options = parser_of(__doc__)
    options.add_argument("--scenes", type=int, default=0)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--only", type=int, nargs="*")
    options.add_argument("--level", choices=tuple(LEVELS), default="correlators")
    options.add_argument("--longest-s", type=float, default=LONGEST_S)
    options.add_argument("--tracking", choices=("scalar", "vector"), default="scalar")
    chosen = options.parse_args()
    way = Way(level=chosen.level, tracking=chosen.tracking, longest_s=chosen.longest_s)
    if chosen.only is not None:
        rows = [examine(number, way) for number in chosen.only]
        print(json.dumps(rows, default=str, indent=1))
    else:
        numbers = range(chosen.first, chosen.first + chosen.scenes)
        rows = rows_of(chosen, numbers, partial(row_of, way=way), key="number")
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
