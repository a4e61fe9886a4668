"""Ready-made scenes: those of the papers and our own as files to copy and change, and three made to measure.

Each TOML file of this folder is one scene, under its own name; its first lines say what it shows, what its source
gives, and what was chosen here. None needs another file.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from types import MappingProxyType

import numpy as np

from skyproof.errors import ScenarioError
from skyproof.simulator.scenario import (
    FrontEnd,
    Interference,
    Meaconer,
    Scenario,
    ScenePlace,
    SceneReceiver,
    Site,
    Sky,
    read_scenario,
)

__all__ = ["ReadyMade", "load_ready_made", "make_clean", "make_demo", "make_meaconed", "read_ready_made"]

DEMO_START_GPST = np.datetime64("2024-05-14T09:59:58", "ns")
"""Two seconds before subframe 1 begins, so that 20 s of recording hold a whole ephemeris."""


@dataclass(frozen=True)
class ReadyMade:
    """A scene that comes with the package: what it shows in a sentence, where it is described, and its file."""

    name: str
    title: str
    source: str
    path: Path


@cache
def load_ready_made() -> Mapping[str, ReadyMade]:
    """Load all ready-made scenes by name, in alphabetical order."""
    scenes = {}
    for path in sorted(Path(__file__).parent.glob("*.toml"), key=lambda path: path.stem):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        scenes[path.stem] = ReadyMade(path.stem, table["description"], table["source"], path)
    return MappingProxyType(scenes)


def read_ready_made(name: str) -> Scenario:
    """Read a ready-made scene. Raises ScenarioError if there is none of that name."""
    scenes = load_ready_made()
    if name not in scenes:
        near = get_close_matches(name, scenes, 1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ScenarioError(f"{name!r} is not a ready-made scene; {hint}there are: {', '.join(scenes)}")
    return read_scenario(scenes[name].path)


JAMMED_S = (9.1, 14.0)


def make_demo(*, seed: int = 1) -> Scenario:
    """Make the pair of `make_meaconed`, jammed until it has lost the sky, then meaconed 8 dB stronger.

    Whoever looks for the strongest signals after the jamming is led to the meaconer's receive antenna, 0.9 km away. The
    jammer is 30 dB over the receivers' noise, for 5 s; the meaconer stands beside it.
    """
    scene = make_meaconed(seed=seed, duration_s=34.0, onset_s=JAMMED_S[1], power_db=8.0)
    jammer = Interference(
        kind="noise",
        name="jammer",
        transmit=scene.attacks[0].transmit,
        power_db=30.0,
        onset_s=JAMMED_S[0],
        until_s=JAMMED_S[1],
    )
    return scene.model_copy(update={"name": "demo", "interference": (jammer,)})


def make_meaconed(*, seed: int = 1, duration_s: float, onset_s: float, power_db: float = 0.0) -> Scenario:
    """Make two receivers 60 m apart on a ship at a quay, and a meaconer that receives 0.9 km away.

    One bit for I and for Q at 2.6 million samples a second. The meaconer's own noise lies 13 dB below theirs while
    its signals are as strong as the true ones, and grows with `power_db`.
    """
    return Scenario(
        name="meaconed",
        seed=seed,
        start_gpst=DEMO_START_GPST,
        duration_s=duration_s,
        receivers=(
            SceneReceiver(
                name="bow",
                lat_deg=57.7012,
                lon_deg=11.9321,
                height_m=52.0,
                start_offset_s=2.1e-5,
                clock_offset_s=1.9e-4,
                lo_ppm=0.4,
            ),
            SceneReceiver(
                name="stern",
                lat_deg=57.7009,
                lon_deg=11.93295,
                height_m=51.0,
                start_offset_s=6.4e-5,
                clock_offset_s=-2.7e-4,
                lo_ppm=-0.6,
            ),
        ),
        sky=Sky(zenith_cn0_dbhz=50.0, horizon_cn0_dbhz=42.0),
        attacks=(
            Meaconer(
                receive=Site(lat_deg=57.6951, lon_deg=11.9405, height_m=66.0),
                transmit=Site(lat_deg=57.7018, lon_deg=11.9333, height_m=58.0),
                delay_s=4.0e-6,
                power_db=power_db,
                noise_db=power_db - 13.0,
                onset_s=onset_s,
            ),
        ),
    )


def make_clean(
    place: ScenePlace,
    start_gpst: np.datetime64,
    *,
    zenith_cn0_dbhz: float = 50.0,
    horizon_cn0_dbhz: float = 42.0,
    baseline_m: float = 60.0,
    receivers: int = 2,
    duration_s: float = 30.0,
    mask_deg: float = 5.0,
    front_end: FrontEnd | None = None,
    seed: int = 0,
) -> Scenario:
    """Make receivers around `place` that receive nothing but the sky.

    The first stands at `place`, the others `baseline_m` from it, spread evenly over the compass from north on. Clocks
    and oscillators differ from receiver to receiver, by what `seed` gives.
    """
    rng = np.random.default_rng(seed)
    to_north_deg = np.degrees(baseline_m / 6.37e6)
    to_east_deg = to_north_deg / max(np.cos(np.radians(place.lat_deg)), 1e-3)
    turns_rad = 2.0 * np.pi * np.arange(receivers - 1) / max(receivers - 1, 1)
    north_deg = [0.0, *(to_north_deg * np.cos(turns_rad))]
    east_deg = [0.0, *(to_east_deg * np.sin(turns_rad))]
    return Scenario(
        name="clean",
        seed=seed,
        start_gpst=start_gpst,
        duration_s=duration_s,
        mask_deg=mask_deg,
        receivers=tuple(
            SceneReceiver(
                name=f"rx{number}",
                lat_deg=place.lat_deg + float(north),
                lon_deg=(place.lon_deg + float(east) + 180.0) % 360.0 - 180.0,
                height_m=place.height_m,
                start_offset_s=rng.uniform(0.0, 1e-4),
                clock_offset_s=rng.uniform(-4e-4, 4e-4),
                lo_ppm=rng.uniform(-1.0, 1.0),
            )
            for number, (north, east) in enumerate(zip(north_deg, east_deg, strict=True), 1)
        ),
        front_end=front_end if front_end is not None else FrontEnd(),
        sky=Sky(zenith_cn0_dbhz=zenith_cn0_dbhz, horizon_cn0_dbhz=horizon_cn0_dbhz),
    )
