"""Arrays of antennas under drawn attacks and clean skies, at measurement level: what is named, and what wrongly.

    python bench/arrays.py --attacks 300 --clean 600     counts; --first 300 goes on elsewhere
    python bench/arrays.py --only 17                     all that is said of one scene
    python bench/arrays.py --few 100                     one or two signals that move nothing: false, or by echoes only
    python bench/arrays.py --one 60                      two to four of one transmitter, or by echoes off walls only

Each scene is one window of 10 s, judged by `ins_array`, `array_common`, `residual` and `second_signals`, and fused as
`protect` does. A wrong word is a true signal called spoofed or a false one called authentic. A direction's error is
that of the nearest of the directions given, which are more than one where whole cycles leave it open.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from skyproof.arrays import Reals
from skyproof.detectors.array.array_common import ArrayCommon, ArrayCommonSettings
from skyproof.detectors.array.array_model import predict_directions
from skyproof.detectors.array.ins_array import InsArray, InsArraySettings, build_level_states
from skyproof.detectors.array.policy import POLICY as ARRAY_POLICY
from skyproof.detectors.residual import Residual, ResidualSettings
from skyproof.detectors.second_signals.detector import SecondSignals, SecondSignalsSettings
from skyproof.explain import explain, stands_beside
from skyproof.fusion.fuse import fuse
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic, rot_enu_ecef
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.sets import find_consistent_sets
from skyproof.records import ArrayPhases, Evidence, NavState, Observations, Records
from skyproof.statistics.directions import direction_cosines
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

WAVE_M = SPEED_OF_LIGHT_M_S / L1_HZ
ALPHA = 1e-3 * 10.0 / 3600.0 / 9.0
"""Of a test: one false word in a thousand hours of windows of 10 s, shared by nine detectors."""
EPOCHS, STEP_S = 50, 0.2
LASTING_CYC = 0.01
NOWHERE_M = (0.0, 0.0, 0.0)
ECHO_DELAY = (2.81, 80.93)
"""Shape and scale, metres, of the gamma law of an echo's delay at 30 to 45 degrees: Chen, He, Pei, Satellite Navigation
1:26, 2020, table 1."""
KINDS = ("replaced", "doubled", "below")
LOST_DB = 10.0  # by which a false signal drowns the true one of its satellite


@dataclass(frozen=True)
class Drawn:
    """What was drawn. false : whether each signal is; place : number of the place that it comes from, -1 for the sky.
    directions : (places, 3) east, north, up."""

    number: int
    records: Records
    false: np.ndarray[Any, np.dtype[np.bool_]]
    place: np.ndarray[Any, np.dtype[np.intp]]
    directions: Reals
    words: dict[str, Any]


def elements_of(rng: np.random.Generator, antennas: int, side_m: float, flat: bool) -> Reals:
    """(M, 3): a regular polygon, of seven one in the middle; not flat: every other one raised by half a side."""
    ring = antennas - (antennas == 7)
    turn = 2.0 * np.pi * np.arange(ring) / ring
    radius_m = 0.5 * side_m / np.sin(np.pi / ring)
    places = np.column_stack([radius_m * np.cos(turn), radius_m * np.sin(turn), np.zeros(ring)])
    places = np.vstack([np.zeros((antennas - ring, 3)), places])
    if not flat:
        places[1::2, 2] -= 0.5 * side_m
    return places @ Rotation.from_euler("z", rng.uniform(0.0, 2.0 * np.pi)).as_matrix().T


def drawn(
    number: int,
    *,
    attack: bool,
    reflections_cyc: float = 0.0,
    pattern_cyc: float = 0.0,
    stated_m: float | None = None,
    few: bool = False,
) -> Drawn:
    """One scene by its number.

    pattern_cyc : sigma of what each antenna's pattern writes into phases, the same for signals from one direction.
    stated_m : what is stated of it.

    few : one or two signals instead of the true ones, which show the true place and time.
    """
    rng = np.random.default_rng([number, attack])
    words: dict[str, Any] = {
        "antennas": int(rng.choice([3, 4, 7])),
        "side": float(rng.uniform(0.5, 2.0)),
        "flat": bool(rng.random() < 0.5),
        "attitude_deg": rng.choice([0.1, 0.5, 1.0, 2.0, 5.0, np.inf]),
        "lines": bool(rng.random() < 0.5),
        "places": int(rng.integers(1, 4)) if attack else 0,
        "power_db": float(rng.uniform(-3.0, 20.0)),
    }
    words |= {"pattern_cyc": pattern_cyc, "stated_m": stated_m}
    lat_deg, lon_deg = rng.uniform(-65.0, 65.0), rng.uniform(-180.0, 180.0)
    shows_m = (*rng.uniform(-1e3, 1e3, 2), rng.uniform(-20.0, 20.0))
    false_sky = FalseSky(shows_enu_m=shows_m, delay_m=rng.uniform(-1e3, 1e3))
    if few:
        words |= {"places": 2, "power_db": float(rng.uniform(-3.0, 6.0))}
        false_sky = FalseSky(antenna_enu_m=NOWHERE_M, shows_enu_m=NOWHERE_M, delay_m=0.0)
    scene = MeasuredScene(
        antennas_enu_m={"rx1": (0.0, 0.0, 0.0)},
        false=(false_sky,) * attack,
        epochs=EPOCHS,
        step_s=STEP_S,
        errors=TrackErrors(1.0, 0.9, 0.7),
        place_deg=(lat_deg, lon_deg, 50.0),
        max_satellites=int(rng.integers(7, 13)),
    )
    records = scene.records(rng)
    (o,) = records.observations
    false = np.array([s.copy == "b" for s in o.signals])
    sats = sorted({s.sat for s in o.signals})
    changed = (
        set(rng.choice(sats, rng.integers(1, 3 if few else len(sats) + 1), replace=False)) if attack or few else set()
    )
    copied = changed if attack else set()
    lost = copied if few or words["power_db"] > LOST_DB else set()
    kept = np.array([(s.sat in copied) if s.copy == "b" else s.sat not in lost for s in o.signals])
    o, false = _columns(o, kept), false[kept]
    o = replace(o, cn0_dbhz=o.cn0_dbhz + np.where(false, words["power_db"], 0.0))
    directions = direction_cosines(rng.uniform(0.0, 2.0 * np.pi, 3), np.radians(rng.uniform(0.0, 40.0, 3)))[
        : words["places"]
    ][:, [1, 0, 2]]
    of_sat = dict(zip(sats, rng.integers(0, max(words["places"], 1), len(sats)), strict=True))
    elsewhere = false if attack else np.array([s.sat in changed for s in o.signals])
    place = np.where(elsewhere, [of_sat[s.sat] for s in o.signals], -1)
    if few and not attack:
        late_m = np.where(elsewhere, rng.gamma(*ECHO_DELAY, elsewhere.size), 0.0)
        weaker_db = np.where(elsewhere, rng.uniform(1.0, 12.0, elsewhere.size), 0.0)
        o = replace(o, pseudorange_m=o.pseudorange_m + late_m, cn0_dbhz=o.cn0_dbhz - weaker_db)
    phases, state = _phases(rng, scene, o, place, directions, words, reflections_cyc)
    records = replace(
        records,
        observations=(o,),
        sets=tuple(find_consistent_sets(o, records.navigation)),
        array_phases=(phases,),
        nav_state={phases.receiver: state},
    )
    return Drawn(number, records, false, place, directions, words)


def drawn_one(number: int, *, attack: bool) -> Drawn:
    """One scene with a place that is known to 5 m: two to four false signals of one transmitter, or as many echoes.

    False signals move nothing: each is instead of its true one, beside it, or of a satellite below the horizon. Echoes
    come off one or two walls, of satellites that are seen by them only.
    """
    rng = np.random.default_rng([number, attack, 46])
    words: dict[str, Any] = {
        "antennas": int(rng.choice([3, 4, 7])),
        "side": float(rng.uniform(0.5, 2.0)),
        "flat": bool(rng.random() < 0.5),
        "attitude_deg": rng.choice([0.5, 1.0, 2.0, 5.0, np.inf]),
        "lines": bool(rng.random() < 0.5),
        "kinds": tuple(str(kind) for kind in rng.permutation([*KINDS, rng.choice(KINDS)])[: rng.integers(2, 5)]),
        "power_db": float(rng.uniform(-3.0, 6.0)),
    }
    scene = MeasuredScene(
        antennas_enu_m={"rx1": NOWHERE_M},
        false=(FalseSky(antenna_enu_m=NOWHERE_M, shows_enu_m=NOWHERE_M, delay_m=0.0),),
        epochs=EPOCHS,
        step_s=STEP_S,
        errors=TrackErrors(1.0, 0.9, 0.7),
        place_deg=(rng.uniform(-65.0, 65.0), rng.uniform(-180.0, 180.0), 50.0),
        mask_deg=-80.0,
    )
    records = scene.records(rng)
    (o,) = records.observations
    lat, lon = np.radians(scene.place_deg[:2])
    place_m = ecef_from_geodetic(lat, lon, scene.place_deg[2])
    week, tow_s = week_and_tow(scene.start_gpst)
    seen = {
        orbit.sat: compute_azimuth_elevation(place_m, compute_satellite_state_s(orbit, week, tow_s).position_ecef_m)
        for orbit in scene.navigation.ephemerides
    }
    high = sorted(seen, key=lambda sat: -float(seen[sat][1]))[: int(rng.integers(7, 13))]
    high = [sat for sat in high if np.degrees(seen[sat][1]) >= 8.0]
    low = [sat for sat, (_, elevation) in seen.items() if np.degrees(elevation) < -15.0]
    some = iter(rng.permutation(high))
    below = iter(rng.permutation(low))
    changed = {str(next(below if kind == "below" else some)): kind for kind in words["kinds"]}
    if not attack:
        changed = {str(sat): "replaced" for sat in rng.permutation(high)[: len(changed)]}
    keeps = [
        (s.copy == "b" and s.sat in changed and attack)
        or (s.copy == "a" and s.sat in high and (changed.get(s.sat) != "replaced" or not attack))
        for s in o.signals
    ]
    o = _columns(o, np.array(keeps))
    false = np.array([s.copy == "b" for s in o.signals])
    beside = np.array([f and changed[s.sat] == "doubled" for f, s in zip(false, o.signals, strict=True)])
    late_m = np.where(beside, rng.choice([-1.0, 1.0]) * rng.uniform(500.0, 1500.0), 0.0)
    o = replace(
        o, pseudorange_m=o.pseudorange_m + late_m, cn0_dbhz=o.cn0_dbhz + np.where(false, words["power_db"], 0.0)
    )
    directions = direction_cosines(rng.uniform(0.0, 2.0 * np.pi, 1), np.radians(rng.uniform(0.0, 40.0, 1)))[
        :, [1, 0, 2]
    ]
    place = np.where(false, 0, -1)
    if not attack:
        walls = rng.uniform(0.0, 2.0 * np.pi, rng.integers(1, 3))
        echoes, late_m, words["walls"] = [], np.zeros(len(o.signals)), np.degrees(walls).round().tolist()
        for k, s in enumerate(o.signals):
            if s.sat not in changed:
                continue
            wall = np.array([np.cos(w := rng.choice(walls)), np.sin(w), 0.0])
            to = direction_cosines(*seen[s.sat])[[1, 0, 2]]
            place[k], late_m[k] = len(echoes), 2.0 * rng.uniform(2.0, 150.0) * abs(to @ wall)
            echoes.append(to - 2.0 * (to @ wall) * wall)
        directions = np.array(echoes)
        weaker_db = np.where(place >= 0, rng.uniform(1.0, 12.0, place.size), 0.0)
        o = replace(o, pseudorange_m=o.pseudorange_m + late_m, cn0_dbhz=o.cn0_dbhz - weaker_db)
    phases, state = _phases(rng, scene, o, place, directions, words, 0.0)
    if state is None:
        (state,) = build_level_states(records, [place_m], ARRAY_POLICY.free_attitude_sigma_rad)
    assert state.covariance is not None
    covariance = state.covariance.copy()
    covariance[:, :3, :3], covariance[:, 3:6, 3:6] = 25.0 * np.eye(3), 1e-4 * np.eye(3)
    off_m = 5.0 * rng.standard_normal(3)
    state = replace(state, position_ecef_m=state.position_ecef_m + off_m, covariance=covariance)
    records = replace(
        records,
        observations=(o,),
        sets=tuple(find_consistent_sets(o, records.navigation)),
        array_phases=(phases,),
        nav_state={phases.receiver: state},
    )
    return Drawn(number, records, false, place, directions, words)


def _columns(o: Observations, kept: Any) -> Observations:
    changes = {
        name: value[:, kept]
        for name, value in vars(o).items()
        if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == kept.size
    }
    single = {name: getattr(o, name)[kept] for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")}
    signals = tuple(s for s, there in zip(o.signals, kept, strict=True) if there)
    return replace(o, signals=signals, **changes, **single)


def _phases(
    rng: np.random.Generator,
    scene: MeasuredScene,
    o: Observations,
    place: Any,
    directions: Reals,
    words: dict[str, Any],
    reflections_cyc: float,
) -> tuple[ArrayPhases, NavState | None]:
    lat, lon = np.radians(scene.place_deg[:2])
    place_ecef_m = np.tile(ecef_from_geodetic(lat, lon, scene.place_deg[2]), (2, 1))
    angles = np.array([rng.uniform(0.0, 2.0 * np.pi), *np.radians(rng.uniform(-10.0, 10.0, 2))])
    true = attitude_ecef(place_ecef_m, *np.tile(angles[:, None], 2))
    gpst = np.array([o.gpst[0] - np.timedelta64(1, "s"), o.gpst[-1] + np.timedelta64(1, "s")])
    state = NavState(gpst=gpst, position_ecef_m=place_ecef_m, velocity_ecef_m_s=np.zeros((2, 3)), attitude=true)
    elements_m = elements_of(rng, words["antennas"], words["side"] * WAVE_M, words["flat"])
    cn0_hz = 10.0 ** (0.1 * o.cn0_dbhz)
    shape = (*cn0_hz.shape, words["antennas"])
    sigma_cyc = np.repeat((1.0 / np.sqrt(2.0 * STEP_S * cn0_hz) / (2.0 * np.pi))[..., None], shape[2], axis=2)
    made = ArrayPhases(
        receiver="rx1",
        signals=o.signals,
        gpst=o.gpst,
        elapsed_s=o.elapsed_s,
        elements_m=elements_m,
        phase_cyc=np.zeros(shape),
        sigma_cyc=sigma_cyc,
        calibrated=words["lines"],
        elements_sigma_m=0.003,
        pattern_sigma_m=words.get("stated_m"),
        lasting_sigma_cyc=LASTING_CYC,
    )
    towards = predict_directions(made, state, scene.navigation)
    ground = directions @ rot_enu_ecef(lat, lon) @ true[0]
    for k, number in enumerate(place):
        if number >= 0:
            towards[:, k] = ground[number]
    wrong_m = elements_m + 0.003 * rng.standard_normal(elements_m.shape)
    phase = towards @ wrong_m.T / WAVE_M + sigma_cyc * rng.standard_normal(shape)
    phase = phase + LASTING_CYC * rng.standard_normal(shape[1:]) + rng.random((*shape[:2], 1))
    phase = phase + reflections_cyc * rng.standard_normal(shape[1:])
    if words.get("pattern_cyc"):
        sats = sorted({s.sat for s in o.signals})
        patterns = np.random.default_rng(rng.integers(2**32)).standard_normal((len(directions) + len(sats), shape[2]))
        of = [k if k >= 0 else len(directions) + sats.index(s.sat) for k, s in zip(place, o.signals, strict=True)]
        phase = phase + words["pattern_cyc"] * patterns[of]
    phase = phase + (0.005 if words["lines"] else 1.0) * rng.standard_normal(shape[2])
    made = replace(made, phase_cyc=phase - np.floor(phase))
    if not np.isfinite(words["attitude_deg"]):
        return made, None
    sigma_rad = np.radians(words["attitude_deg"])
    turned = Rotation.from_rotvec(sigma_rad * rng.standard_normal(3)).as_matrix() @ true
    covariance = np.tile(np.diag(np.repeat([np.inf, np.inf, sigma_rad**2], 3)), (2, 1, 1))
    return made, replace(state, attitude=turned, covariance=covariance)


def judged(scene: Drawn) -> tuple[list[Evidence], dict[Any, str], str]:
    """All evidence, the label of each signal, and the run's word."""
    detectors = (
        InsArray(InsArraySettings(false_alarm_probability=ALPHA)),
        ArrayCommon(ArrayCommonSettings(false_alarm_probability=ALPHA)),
        Residual(ResidualSettings(false_alarm_probability=ALPHA)),
        SecondSignals(SecondSignalsSettings(false_alarm_probability=ALPHA)),
    )
    evidence = [findings for detector in detectors for findings in detector.examine(scene.records)[0]]
    decision = fuse(evidence, scene.records.observations, scene.records.sets)
    return evidence, {s.ref.signal: s.label for s in decision.labels}, decision.verdict


def counted(scenes: Iterator[Drawn]) -> tuple[Counter[str], list[float], list[str]]:
    """Signals and scenes by what was said, direction errors over sigma, and the scenes with a wrong word."""
    count: Counter[str] = Counter()
    off: list[float] = []
    wrong: list[str] = []
    for scene in scenes:
        evidence, labels, word = judged(scene)
        count[f"run {word}"] += 1
        signals = scene.records.observations[0].signals
        said = [(labels.get(s, "unknown"), bool(f)) for s, f in zip(signals, scene.false, strict=True)]
        count.update(f"{'false' if f else 'true'} {label}" for label, f in said)
        words = {("spoofed", False), ("authentic", True)} & set(said)
        if words:
            wrong.append(f"{scene.number}: {sorted(words)} {scene.words}")
        count["scenes"] += 1
        count["attitude noted"] += any(stands_beside(e) for e in evidence)
        for e in evidence:
            if e.directions and e.says == "spoofed" and e.directions[0].frame == "enu":
                of = scene.place[signals.index(e.signals[0].signal)]
                if of >= 0:
                    off.append(min(off_sigma(d, scene.directions[of]) for d in e.directions))
                    count["directions given"] += len(e.directions)
    return count, off, wrong


def off_sigma(direction: Any, true: Reals) -> float:
    """How far a direction is off, the square root of chi-square with two degrees. true : (3,) east, north, up."""
    seen = direction_cosines(direction.azimuth_rad, direction.elevation_rad)[[1, 0, 2]]
    east = np.array([np.cos(direction.azimuth_rad), -np.sin(direction.azimuth_rad), 0.0])
    error = np.array([east @ true, np.cross(east, seen) @ true])
    return float(np.sqrt(error @ np.linalg.solve(direction.covariance_rad2, error)))


def report() -> Iterator[str]:
    """Rows of the table of `make bench`: few scenes, for the counts of a run of its own."""
    yield from table(attacks=20, clean=20)


def table(*, attacks: int, clean: int, few: int = 0, one: int = 0, patterned: int = 0, first: int = 0) -> Iterator[str]:
    """Counts of drawn scenes."""
    kinds: tuple[tuple[str, int, dict[str, Any]], ...] = (
        ("attacks", attacks, {"attack": True}),
        ("clean", clean, {"attack": False}),
        ("clean, patterns of 0.02 cycle", clean, {"attack": False, "pattern_cyc": 0.02}),
        ("clean, patterns of 0.05 cycle, as stated", clean, {"attack": False, "pattern_cyc": 0.05, "stated_m": 0.01}),
        ("attacks, patterns of 0.02 cycle", patterned, {"attack": True, "pattern_cyc": 0.02}),
        ("one or two false signals that move nothing", few, {"attack": True, "few": True}),
        ("one or two satellites by an echo only", few, {"attack": False, "few": True}),
        ("two to four false signals of one transmitter", one, {"attack": True, "one": True}),
        ("two to four satellites by echoes off walls only", one, {"attack": False, "one": True}),
    )
    for name, number, how in kinds:
        draw = drawn_one if how.pop("one", False) else drawn
        count, off, wrong = counted(draw(k, **how) for k in range(first, first + number))
        yield f"{name}: {dict(sorted(count.items()))}"
        if off:
            squares = np.array(off) ** 2
            yield (
                f"  direction errors over sigma: {len(off)}, median {np.sqrt(np.median(squares)):.2f} (1.18), "
                f"beyond 3.03 (1 %): {np.mean(squares > 9.21):.3f}"
            )
        yield from (f"  WRONG {item}" for item in wrong)


def main() -> None:
    """Counts, or one scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--attacks", type=int, default=300)
    parser.add_argument("--clean", type=int, default=600)
    parser.add_argument("--few", type=int, default=0)
    parser.add_argument("--one", type=int, default=0)
    parser.add_argument("--patterned", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--quiet-sky", action="store_true", help="of --only: the clean scene of that number")
    options = parser.parse_args()
    if options.only is None:
        for row in table(
            attacks=options.attacks,
            clean=options.clean,
            few=options.few,
            one=options.one,
            patterned=options.patterned,
            first=options.first,
        ):
            print(row, flush=True)
        return
    if options.one:
        scene = drawn_one(options.only, attack=not options.quiet_sky)
    else:
        scene = drawn(options.only, attack=not options.quiet_sky, few=options.few > 0)
    evidence, labels, word = judged(scene)
    print(word, scene.words)
    for e in evidence:
        print(e.detector, e.says, explain(e).sentence, e.p_value, [f"{r.signal.sat}{r.signal.copy}" for r in e.signals])
        print("   ", [np.degrees([d.azimuth_rad, d.elevation_rad]).round(1).tolist() for d in e.directions])
    for signal, label in labels.items():
        print(signal, label)


if __name__ == "__main__":
    main()
