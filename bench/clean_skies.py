"""Clean sky with reflections through the whole receiver and `protect`, behind drawn correlators.

    python bench/clean_skies.py --hours 0.5    of each surroundings; a table as markdown

Surroundings are those of `clean_grids.py`: open sky, ground below, one wall, and a moving vehicle between three; here
reflections last, with their Dopplers, through scenes of two minutes, at drawn places and times, for all that stands
above 8 degrees. Where the receiver stands that is stated, and the oscillator's class always. What is counted is the
windows in which a test says attack or spoofed, or leaves the window open against the others, by test; and verdicts.
"""

import argparse
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tomli_w
from clean_grids import CHIP_M, SURROUNDINGS, Sky

from skyproof.app.protect.outcome import Outcome
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import FrontEnd, Multipath, Scenario, SceneReceiver
from skyproof.simulator.scenario import Sky as SceneSky
from skyproof.simulator.sites import WayPoints
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene

SEED = 11
SCENE_S = 120.0
STANDING = {"receivers": [{"name": "rx"}], "motion": "static", "oscillator": "tcxo"}
MOVING = {"receivers": [{"name": "rx"}], "motion": "moving", "oscillator": "tcxo"}


def scene(name: str, number: int) -> Scene:
    """One of a surroundings."""
    rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(list(SURROUNDINGS).index(name), number)))
    start = np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s")
    navigation = make_nominal_constellation(start)
    plain = _scenario(rng, start, name)
    under = make_scene(plain, navigation).skies[0]
    middle = under.knots_s.size // 2
    seen = Sky(under.az_rad[middle], under.el_rad[middle])
    reflected = tuple(
        Multipath(
            sats=(signal.id.sat,),
            delay_m=float(chips * CHIP_M),
            power_db=float(level_db),
            phase_deg=float(rng.uniform(0.0, 360.0)),
            rate_hz=float(hz),
        )
        for signal, rays in zip(under.signals, SURROUNDINGS[name](rng, seen), strict=True)
        for chips, level_db, hz in zip(*rays, strict=True)
    )
    receivers = (plain.receivers[0].model_copy(update={"multipath": reflected}),)
    return make_scene(plain.model_copy(update={"receivers": receivers}), navigation)


def _scenario(rng: np.random.Generator, start: np.datetime64, name: str) -> Scenario:
    moving = {"path": _way(rng)} if name == "vehicle" else {}
    receiver = SceneReceiver(
        name="rx",
        lat_deg=float(rng.uniform(-65.0, 65.0)),
        lon_deg=float(rng.uniform(-180.0, 180.0)),
        height_m=50.0,
        oscillator="tcxo-good",
        **moving,
    )
    rate_hz = float(rng.choice([4e6, 5e6, 25e6]))
    return Scenario(
        seed=int(rng.integers(2**31)),
        start_gpst=start,
        duration_s=SCENE_S,
        mask_deg=8.0,
        receivers=(receiver,),
        front_end=FrontEnd(rate_hz=rate_hz, bandwidth_hz=0.8 * rate_hz, bits=2, encoding="sign-magnitude"),
        sky=SceneSky(zenith_cn0_dbhz=float(rng.uniform(45.0, 50.0)), horizon_cn0_dbhz=float(rng.uniform(38.0, 44.0))),
    )


def _way(rng: np.random.Generator) -> WayPoints:
    """Along a street with bends."""
    speed_m_s, heading, places = float(rng.uniform(3.0, 20.0)), float(rng.uniform(0.0, 2.0 * np.pi)), [(0.0, 0.0, 0.0)]
    for leg in range(int(SCENE_S / 15.0) + 4):
        heading += 0.4 if leg % 2 else -0.3
        east_m, north_m, _ = places[-1]
        off_m = 15.0 * speed_m_s
        places.append((east_m + off_m * math.sin(heading), north_m + off_m * math.cos(heading), 0.0))
    return WayPoints(points_enu_m=tuple(places), speed_m_s=speed_m_s, start_s=-10.0, from_rest=False, to_rest=False)


def outcome_of(name: str, number: int) -> tuple[str, Outcome]:
    """Verdict and what is behind it."""
    made = scene(name, number)
    with TemporaryDirectory(prefix="clean") as folder:
        platform = Path(folder) / "platform.toml"
        platform.write_text(tomli_w.dumps(MOVING if name == "vehicle" else STANDING), encoding="utf-8")
        verdict, outcome = protect_scene(made, made.navigation, platform, made.scenario.seed)
    return verdict.verdict, outcome


def row_of(name: str, hours: float) -> str:
    """One surroundings' hours as a row of the table."""
    verdicts, alarms, open_, windows = Counter[str](), Counter[str](), Counter[str](), 0
    for number in range(round(3600.0 * hours / SCENE_S)):
        verdict, outcome = outcome_of(name, number)
        verdicts[verdict] += 1
        windows += len({(e.start_gpst, e.end_gpst) for e in outcome.evidence})
        alarms.update(e.detector for e in outcome.evidence if e.says in ("attack", "spoofed"))
        open_.update(e.detector for e in outcome.evidence if e.says == "undecided" and e.overrules)
    cells = [name, f"{hours:g}", str(windows), _counts(alarms), _counts(open_), _counts(verdicts)]
    return "| " + " | ".join(cells) + " |"


def _counts(counter: Counter[str]) -> str:
    return ", ".join(f"{key} {count}" for key, count in counter.most_common()) or "none"


def table(hours: float) -> Iterator[str]:
    """All surroundings."""
    yield "| surroundings | hours | windows | attack or spoofed | left open against the others | verdicts |"
    yield "|---|---|---|---|---|---|"
    for name in SURROUNDINGS:
        yield row_of(name, hours)


def report() -> Iterator[str]:
    """A short table."""
    yield "clean sky with reflections through receiver and protect, behind drawn correlators"
    yield from table(0.1)


def main() -> None:
    """The table, for as many hours as wanted."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--hours", type=float, default=0.5, help="of each surroundings")
    for line in table(options.parse_args().hours):
        print(line, flush=True)


if __name__ == "__main__":
    main()
