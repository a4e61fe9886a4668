"""Scenes drawn at random: receivers standing or moving, one transmitter anywhere or none, what the user states.

A scene follows from its name alone: `attack-17` and `clean-3` are each drawn from a generator of their own.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from skyproof.errors import ScenarioError
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.attacks import TransmitAntenna
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import (
    Antenna,
    FrontEnd,
    Interference,
    Meaconer,
    Scenario,
    SceneReceiver,
    Sky,
    Spoofer,
    Takeover,
)
from skyproof.simulator.sites import Site, WayPoints
from skyproof.simulator.sky import make_scene

__all__ = ["BESIDE_SATS", "BuiltScene", "DrawnAttack", "DrawnScene", "build_scene", "default_sigma_m", "draw_scene"]

Vector = tuple[float, float, float]
Knowledge = Literal["nothing", "distance", "positions"]

SEED = 1
KINDS = ("clean", "attack", "several", "beside")
"""No attack; one transmitter that does anything; one or several antennas that imitate one satellite, or more; two that
imitate four of ten beside the true ones, up to 8 dB stronger, at two receivers 40 m apart, with that stated."""
BESIDE_SATS = 10
NEAREST_M, FARTHEST_M = 3.0, 300.0  # of two antennas
FARTHEST_OF_SEVERAL_M = 100.0
CHIP_S = 1e-3 / 1023
RIDES_WITHIN_M = 300.0
"""A transmitter nearer than this to what moves goes with it: it would be left behind within the scene."""
LONGEST_TURNING_M = 30.0
"""From the body's middle to an antenna: a longer arm would throw it about at tens of metres a second in a turn."""
MASK_DEG = 8.0
FRONT_END = FrontEnd(rate_hz=2.6e6, bandwidth_hz=2.08e6)


@dataclass(frozen=True, kw_only=True)
class DrawnAttack:
    """One transmitter. Powers are those at the antenna that it is aimed at, `focus`.

    reached : the receivers that hear it at all; from the others its antenna, or what stands between, is turned away.
        By free space some of the reached ones may still hear next to nothing.
    transmit_enu_m : of the focus antenna at the scene's start. rides : whether it moves with the receivers.
    noise_db : of its own noise over the receiver's. jam_s : of noise alone before the onset.
    place : how the false place was chosen; away_enu_m : that place from the focus's true one.
    drag_s : of a takeover, from the first offset to all of it; at_s : after the onset.
    late_s, drift : of the false time.
    n_sats : how many are imitated, None for all. others_enu_m : further transmit antennas, which share them.
    """

    kind: Literal["takeover", "spoofer", "meaconer"]
    focus: int
    reached: tuple[int, ...]
    transmit_enu_m: Vector
    rides: bool
    power_db: float
    power_rises_s: float
    noise_db: float | None
    jam_s: float
    onset_s: float
    place: Literal["true", "near", "random", "sphere"]
    away_enu_m: Vector
    held_s: float
    drag_s: float
    clock: Literal["true", "within a chip", "far", "drift"]
    late_s: float
    drift: float
    code_offset_m: float
    phase: Literal["aligned", "random"]
    carrier: Literal["follows", "locked"]
    n_sats: int | None
    others_enu_m: tuple[Vector, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DrawnScene:
    """All that a scene is made of, but for noise. antennas_body_m : forward, right, down; the first one at zero."""

    name: str
    seed: int
    lat_deg: float
    lon_deg: float
    height_m: float
    start_gpst: np.datetime64
    duration_s: float
    antennas_body_m: tuple[Vector, ...]
    motion: Literal["still", "straight", "turning"]
    speed_m_s: float
    heading_deg: float
    zenith_cn0_dbhz: float
    horizon_cn0_dbhz: float
    clocks_s: tuple[float, ...]
    lo_ppm: tuple[float, ...]
    code_sigma_m: float
    ar1: float
    constant_m: float
    field: bool
    given: Knowledge
    given_error: float
    attack: DrawnAttack | None = None

    @property
    def distance_m(self) -> float:
        """Return the distance between the first two antennas."""
        return math.dist(*self.antennas_body_m[:2])

    @property
    def given_distance_m(self) -> float:
        """Return the distance as the user states it, who errs."""
        return self.distance_m + self.given_error * default_sigma_m(self.distance_m)


@dataclass(frozen=True, eq=False, kw_only=True)
class BuiltScene:
    """A drawn scene as the simulator has it. antennas_enu_m : from the first one, in the scene's middle.

    scene : worked out; receivers that the attack does not reach have the sky of the scenario without it.
    """

    drawn: DrawnScene
    scenario: Scenario
    navigation: NavigationData
    scene: Scene
    antennas_enu_m: dict[str, Vector]


def default_sigma_m(distance_m: float) -> float:
    """Return the sigma of a distance stated without one: good to 5 % or 1 m in 95 of 100 cases."""
    return 0.5 * max(0.05 * distance_m, 1.0)


def draw_scene(name: str, *, most_receivers: int = 5, duration_s: float | None = None) -> DrawnScene:
    """Draw the scene of a name such as "attack-17". duration_s : in place of a drawn one."""
    kind, _, number = name.partition("-")
    if kind not in KINDS or not number.isdigit():
        raise ScenarioError(f"no scene named {name!r}; give one of {', '.join(KINDS)}, and -NUMBER")
    rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(KINDS.index(kind), int(number))))
    several = kind == "several"
    counts, shares = ([2, 3, 4, 5], [0.5, 0.2, 0.15, 0.15]) if several else ([2, 3, 4], [0.6, 0.25, 0.15])
    n = min(int(rng.choice(counts, p=shares)), most_receivers)
    motion = str(rng.choice(["still", "straight", "turning"], p=[0.6, 0.25, 0.15]))
    knowledge = str(rng.choice(["nothing", "distance", "positions"]))
    if (knowledge == "distance" and n > 2) or (knowledge == "positions" and motion == "turning"):
        knowledge = "nothing"
    lasts_s = duration_s or float(rng.uniform(40.0, 60.0))
    antennas = _antennas(rng, n, FARTHEST_OF_SEVERAL_M if several else FARTHEST_M)
    if motion == "turning" and max(math.hypot(*place) for place in antennas) > LONGEST_TURNING_M:
        motion = "straight"
    drawn: dict[str, Any] = {
        "name": name,
        "seed": int(rng.integers(2**31)),
        "lat_deg": float(np.degrees(np.arcsin(rng.uniform(-0.94, 0.94)))),
        "lon_deg": float(rng.uniform(-180.0, 180.0)),
        "height_m": float(rng.uniform(0.0, 1000.0)),
        "start_gpst": np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s"),
        "duration_s": lasts_s,
        "antennas_body_m": antennas,
        "motion": motion,
        "speed_m_s": float(rng.uniform(1.0, 25.0)),
        "heading_deg": float(rng.uniform(0.0, 360.0)),
        "zenith_cn0_dbhz": float(rng.uniform(44.0, 52.0)),
        "horizon_cn0_dbhz": float(rng.uniform(36.0, 42.0)),
        "clocks_s": tuple(rng.uniform(-3e-4, 3e-4, n).tolist()),
        "lo_ppm": tuple(rng.uniform(-1.0, 1.0, n).tolist()),
        "code_sigma_m": float(rng.uniform(0.4, 0.9)),
        "ar1": float(rng.choice([0.0, 0.9])),
        "constant_m": float(rng.choice([0.0, 0.5])),
        "field": bool(rng.random() < 0.8),
        "given": knowledge,
        "given_error": float(rng.uniform(-1.4, 1.4)),
    }
    attack = _attack(rng, antennas, lasts_s, motion, drawn["zenith_cn0_dbhz"]) if kind != "clean" else None
    if several and attack is not None:
        attack = _several(rng, attack, n)
    scene = DrawnScene(**drawn, attack=attack)
    return scene if kind != "beside" or attack is None else _stand_beside(rng, scene, attack)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _level(rng: np.random.Generator, distance: float, steepest: float) -> Vector:
    """Draw a vector of this length up to `steepest` rad over or under the horizon."""
    az_rad, el_rad = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-steepest, steepest)
    level = distance * math.cos(el_rad)
    return level * math.sin(az_rad), level * math.cos(az_rad), distance * math.sin(el_rad)


def _antennas(rng: np.random.Generator, n: int, farthest_m: float) -> tuple[Vector, ...]:
    """Place each antenna 3 m to `farthest_m` from every other."""
    reach_m = _log_uniform(rng, NEAREST_M, farthest_m)
    places: list[Vector] = [(0.0, 0.0, 0.0)]
    while len(places) < n:
        place = _level(rng, reach_m if n == 2 else _log_uniform(rng, NEAREST_M, farthest_m), 0.15)
        if all(NEAREST_M <= math.dist(place, other) <= farthest_m + 1e-6 for other in places):
            places.append(place)
    return tuple(places)


def _attack(
    rng: np.random.Generator, antennas: tuple[Vector, ...], duration_s: float, motion: str, zenith_dbhz: float
) -> DrawnAttack:
    n = len(antennas)
    focus = int(rng.integers(n))
    other_antennas = [k for k in range(n) if k != focus]
    reach = rng.choice(["one", "some", "all"], p=[0.3, 0.2, 0.5])
    joined = {"one": [], "all": other_antennas}.get(str(reach), [k for k in other_antennas if rng.random() < 0.5])
    away_m = _log_uniform(rng, 1.5, 1e4)
    kind: Any = str(rng.choice(["takeover", "spoofer", "meaconer"], p=[0.4, 0.45, 0.15]))
    power_db = float(rng.uniform(-10.0, 30.0))
    noise_db: float | None = None
    quiet = rng.choice(["quiet", "noisy", "drowning"], p=[0.45, 0.2, 0.35])
    if quiet == "noisy":
        noise_db = float(rng.uniform(-5.0, 10.0))
    elif quiet == "drowning":
        noise_db = float(zenith_dbhz - 27.0 + rng.uniform(0.0, 6.0))
        power_db = min(max(power_db, noise_db - float(rng.uniform(0.0, 5.0))), 30.0)
    within = rng.random() < 0.65
    onset_s = float(rng.uniform(10.0, duration_s - 15.0)) if within else -float(rng.uniform(2.0, 60.0))
    place: Any = str(rng.choice(["true", "near", "random", "sphere"], p=[0.15, 0.3, 0.25, 0.3]))
    away = {
        "true": (0.0, 0.0, 0.0),
        "near": _level(rng, _log_uniform(rng, 3.0, 300.0), 0.3),
        "random": _level(rng, _log_uniform(rng, 100.0, 2e4), 0.02),
    }.get(place)
    if away is None:  # on the sphere about an antenna that is left alone, or any other
        about = antennas[int(rng.choice([k for k in other_antennas if k not in joined] or other_antennas))]
        around = _level(rng, math.dist(about, antennas[focus]), 0.3)
        away = _difference(_sum(around, about), antennas[focus])
    clock: Any = str(rng.choice(["true", "within a chip", "far", "drift"], p=[0.45, 0.2, 0.2, 0.15]))
    late_s = {
        "true": 0.0,
        "within a chip": float(rng.uniform(-1.0, 1.0)) * CHIP_S,
        "far": float(rng.choice([-1.0, 1.0])) * _log_uniform(rng, CHIP_S, 2e-2),
        "drift": 0.0,
    }[clock]
    if kind == "meaconer":
        late_s = abs(late_s)
    return DrawnAttack(
        kind=kind,
        focus=focus,
        reached=tuple(sorted([focus, *joined])),
        transmit_enu_m=_above(_level(rng, away_m, 0.3)),
        rides=motion != "still" and (away_m < RIDES_WITHIN_M or rng.random() < 0.3),
        power_db=power_db,
        power_rises_s=float(rng.uniform(2.0, 10.0)) if rng.random() < 0.3 else 0.0,
        noise_db=noise_db,
        jam_s=float(rng.uniform(3.0, 10.0)) if within and rng.random() < 0.25 else 0.0,
        onset_s=onset_s,
        place=place,
        away_enu_m=away,
        held_s=float(rng.uniform(0.0, 8.0)),
        drag_s=max(math.hypot(*away) / _log_uniform(rng, 1.0, 100.0), 2.0),
        clock=clock,
        late_s=late_s,
        drift=float(rng.choice([-1.0, 1.0])) * _log_uniform(rng, 1e-9, 1e-7) if clock == "drift" else 0.0,
        code_offset_m=float(rng.uniform(-150.0, 150.0)) if kind == "takeover" and rng.random() < 0.3 else 0.0,
        phase="aligned" if rng.choice(["aligned", "random"]) == "aligned" else "random",
        carrier="locked" if rng.random() < 0.15 else "follows",
        n_sats=int(rng.integers(4, 8)) if rng.random() < 0.2 else None,
    )


def _several(rng: np.random.Generator, attack: DrawnAttack, n: int) -> DrawnAttack:
    """Change to a quiet attack by up to four antennas, 50 m to 1 km from the receivers, heard by all."""
    antennas = [_above(_level(rng, _log_uniform(rng, 50.0, 1000.0), 0.3)) for _ in range(int(rng.integers(1, 5)))]
    away = _level(rng, _log_uniform(rng, 100.0, 2e4), 0.02)
    return replace(
        attack,
        kind="meaconer" if rng.random() < 0.3 else "spoofer",
        reached=tuple(range(n)),
        transmit_enu_m=antennas[0],
        others_enu_m=tuple(antennas[1:]),
        power_db=float(rng.uniform(-6.0, 20.0)),
        noise_db=None,
        jam_s=0.0,
        place="random",
        away_enu_m=away,
        late_s=abs(attack.late_s),
        n_sats=int(rng.integers(1, 11)),
    )


def _stand_beside(rng: np.random.Generator, scene: DrawnScene, attack: DrawnAttack) -> DrawnScene:
    """Change to two receivers that stand 40 m apart, and a spoofer of four satellites by two antennas from 12 s on."""
    quiet = replace(_several(rng, attack, 2), kind="spoofer", focus=0, rides=False, power_rises_s=0.0, n_sats=4)
    transmit = [_above(_level(rng, _log_uniform(rng, 50.0, 1000.0), 0.3)) for _ in range(2)]
    return replace(
        scene,
        duration_s=56.0,
        antennas_body_m=((0.0, 0.0, 0.0), _level(rng, 40.0, 0.0)),
        motion="still",
        clocks_s=tuple(rng.uniform(-3e-4, 3e-4, 2).tolist()),
        lo_ppm=tuple(rng.uniform(-1.0, 1.0, 2).tolist()),
        given="distance",
        attack=replace(
            quiet,
            transmit_enu_m=transmit[0],
            others_enu_m=(transmit[1],),
            power_db=float(rng.uniform(0.0, 8.0)),
            onset_s=12.0,
        ),
    )


def _above(place: Vector) -> Vector:
    """Keep a place above the ground."""
    return place[0], place[1], max(place[2], -100.0)


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _difference(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


# ---------------------------------------------------------------------- to the simulator


def build_scene(drawn: DrawnScene, *, n_sats: int | None = None) -> BuiltScene | None:
    """Build the scene; None if what was drawn makes none, as a transmitter in an antenna's place.

    n_sats : the highest so many satellites alone, for what takes long with many.
    """
    navigation = make_nominal_constellation(drawn.start_gpst)
    clean = _scenario(drawn, [], [])
    under = make_scene(clean, navigation)
    if n_sats is not None:
        clean = _scenario(drawn, [], [], _highest(under, n_sats))
        under = make_scene(clean, navigation)
    made = BuiltScene(
        drawn=drawn, scenario=clean, navigation=navigation, scene=under, antennas_enu_m=_antennas_enu_m(under)
    )
    if drawn.attack is None:
        return made
    try:
        attack, jam = _transmitters(drawn, drawn.attack, under)
        if n_sats is not None and attack.sats is None:
            attack = attack.model_copy(update={"sats": clean.sky.sats})
        scenario = _scenario(drawn, [attack], jam, clean.sky.sats)
        scene = make_scene(scenario, navigation)
    except ScenarioError:
        return None
    reached = drawn.attack.reached
    skies = tuple(scene.skies[k] if k in reached else under.skies[k] for k in range(len(scene.skies)))
    return replace(made, scenario=scenario, scene=replace(scene, skies=skies))


def _highest(under: Scene, n_sats: int) -> tuple[str, ...]:
    sky = under.skies[0]
    order = np.argsort(-sky.el_rad[sky.knots_s.size // 2])[:n_sats]
    return tuple(sorted(sky.signals[column].id.sat for column in order))


def _scenario(
    drawn: DrawnScene, attacks: list[Any], jam: list[Interference], sats: tuple[str, ...] | None = None
) -> Scenario:
    site = _site(drawn, (drawn.lat_deg, drawn.lon_deg, drawn.height_m), rides=True)
    receivers = tuple(
        SceneReceiver(
            **site,
            name=f"rx{k + 1}",
            antennas=(Antenna(name="1", body_m=body_m),),
            clock_offset_s=clock_s,
            lo_ppm=lo_ppm,
        )
        for k, (body_m, clock_s, lo_ppm) in enumerate(
            zip(drawn.antennas_body_m, drawn.clocks_s, drawn.lo_ppm, strict=True)
        )
    )
    return Scenario(
        seed=drawn.seed,
        start_gpst=drawn.start_gpst,
        duration_s=drawn.duration_s,
        mask_deg=MASK_DEG,
        receivers=receivers,
        front_end=FRONT_END,
        attacks=tuple(attacks),
        interference=tuple(jam),
        sky=Sky(zenith_cn0_dbhz=drawn.zenith_cn0_dbhz, horizon_cn0_dbhz=drawn.horizon_cn0_dbhz, sats=sats),
    )


def _site(drawn: DrawnScene, place: Vector, *, rides: bool) -> dict[str, Any]:
    """Return the keys of a site at latitude, longitude, height; what rides moves as the receivers do."""
    site: dict[str, Any] = dict(zip(("lat_deg", "lon_deg", "height_m"), place, strict=True))
    if drawn.motion == "still" or not rides:
        return site | ({"heading_deg": drawn.heading_deg} if drawn.motion == "still" else {})
    heading_rad = math.radians(drawn.heading_deg)
    length_m = drawn.speed_m_s * (drawn.duration_s + 40.0)
    points = [(0.0, 0.0, 0.0)]
    legs = [1.0] if drawn.motion == "straight" else [0.25, 0.25, 0.5]
    for leg, share in enumerate(legs):
        turned_rad = heading_rad + (-1.0) ** leg * 0.4 * (drawn.motion == "turning") * leg
        leg_m = share * length_m
        points.append(_sum(points[-1], (leg_m * math.sin(turned_rad), leg_m * math.cos(turned_rad), 0.0)))
    return site | {
        "path": WayPoints(
            points_enu_m=tuple(points), speed_m_s=drawn.speed_m_s, start_s=-10.0, from_rest=False, to_rest=False
        )
    }


def _antennas_enu_m(scene: Scene) -> dict[str, Vector]:
    middle_s = np.array([0.5 * scene.scenario.duration_s])
    places = np.stack([sky.point(middle_s).position_ecef_m[0] for sky in scene.skies])
    lat, lon, _ = geodetic_from_ecef(places[0])
    away = (places - places[0]) @ rot_enu_ecef(lat, lon).T
    return {sky.name: tuple(row) for sky, row in zip(scene.skies, away.tolist(), strict=True)}


def _transmitters(drawn: DrawnScene, attack: DrawnAttack, under: Scene) -> tuple[Any, list[Interference]]:
    body_ecef_m = ecef_from_geodetic(np.radians(drawn.lat_deg), np.radians(drawn.lon_deg), drawn.height_m)
    start_s = np.zeros(1)
    focus_ecef_m = under.skies[attack.focus].point(start_s).position_ecef_m[0]
    rot = rot_enu_ecef(*geodetic_from_ecef(focus_ecef_m)[:2])

    def at(away_enu_m: Vector, rides: bool) -> dict[str, Any]:
        """Place something so far from the focus at the start; what rides begins with the receivers."""
        place = focus_ecef_m + rot.T @ np.array(away_enu_m)
        if rides and drawn.motion != "still":
            moved = under.skies[0].point(start_s).position_ecef_m[0] - body_ecef_m
            place = place - moved
        lat, lon, height_m = geodetic_from_ecef(place)
        return _site(drawn, (float(np.degrees(lat)), float(np.degrees(lon)), float(height_m)), rides=rides)

    transmit = Site(**at(attack.transmit_enu_m, attack.rides))
    first_db = _spread_db(under, attack, transmit)
    common: dict[str, Any] = {
        "name": "false",
        "transmit": transmit,
        "power_db": attack.power_db + first_db,
        "onset_s": attack.onset_s,
        "noise_db": None if attack.noise_db is None else attack.noise_db + first_db,
        "sats": _sats(under, attack),
    }
    if attack.others_enu_m and common["sats"]:
        shared = [common["sats"][k :: len(attack.others_enu_m) + 1] for k in range(1, len(attack.others_enu_m) + 1)]
        common["antennas"] = tuple(
            TransmitAntenna(**at(place, attack.rides), sats=sats)
            for place, sats in zip(attack.others_enu_m, shared, strict=True)
            if sats
        )
    if attack.power_rises_s:
        begin_s = attack.onset_s
        common["power_points_db"] = ((begin_s, -15.0), (begin_s + attack.power_rises_s, 0.0))
    jam = []
    if attack.jam_s:
        jam = [
            Interference(
                kind="noise",
                name="jam",
                transmit=transmit,
                power_db=min(30.0 + first_db, 80.0),
                onset_s=attack.onset_s - attack.jam_s,
                until_s=attack.onset_s,
            )
        ]
    if attack.kind == "meaconer":
        made: Any = Meaconer(**common, receive=Site(**at(attack.away_enu_m, True)), delay_s=attack.late_s)
    elif attack.kind == "spoofer":
        made = Spoofer(
            **common, shows=Site(**at(attack.away_enu_m, True)), clock_offset_s=attack.late_s, clock_drift=attack.drift
        )
    else:
        begin_s = attack.onset_s + attack.held_s
        end_s = begin_s + attack.drag_s
        clock_s = ((begin_s, 0.0), (begin_s + max(abs(attack.late_s) / 1e-7, 2.0), attack.late_s))
        made = Takeover(
            **common,
            target=under.skies[attack.focus].name,
            clock_drift=attack.drift,
            away_points_enu_m=((begin_s, 0.0, 0.0, 0.0), (end_s, *attack.away_enu_m)),
            clock_points_s=clock_s if attack.late_s else (),
            code_offset_m=attack.code_offset_m,
            phase=attack.phase,
            carrier=attack.carrier,
        )
    return made, jam


def _spread_db(under: Scene, attack: DrawnAttack, transmit: Site) -> float:
    """Compute the power at the first receiver over that at the focus."""
    at_s = np.array([max(attack.onset_s, 0.0)])
    transmit_ecef_m = ecef_from_geodetic(*transmit.geodetic_rad)
    if transmit.path is not None:  # it keeps its place beside the focus
        transmit_ecef_m = transmit_ecef_m + under.skies[attack.focus].point(at_s).position_ecef_m[0]
        transmit_ecef_m = transmit_ecef_m - under.skies[attack.focus].point(np.zeros(1)).position_ecef_m[0]
    away_m = [np.linalg.norm(sky.point(at_s).position_ecef_m[0] - transmit_ecef_m) for sky in under.skies]
    return float(20.0 * np.log10(away_m[attack.focus] / away_m[0]))


def _sats(under: Scene, attack: DrawnAttack) -> tuple[str, ...] | None:
    if attack.n_sats is None:
        return None
    visible = sorted(heard.id.sat for heard in under.skies[attack.focus].signals)
    rng = np.random.default_rng(under.scenario.seed)
    return tuple(sorted(rng.permutation(visible)[: attack.n_sats].tolist()))
