"""Cells of the matrix: a scene rendered for certain equipment, protected as a user would, beside the truth."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, Final

import numpy as np
import tomli_w

from skyproof.app.protect import protect
from skyproof.arrays import Reals
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import heading_pitch_roll_rad
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.files import write_samples, write_series
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import Antenna, Attack, FrontEnd, Interference, Scenario, Takeover
from skyproof.simulator.sky import make_scene
from skyproof.studies.protection.equipment import ATTITUDE_DEG, Equipped, equip
from skyproof.studies.protection.score import score

__all__ = ["cut_scene", "make_rows", "write_platform", "write_without_samples"]

AT_MOST_HZ: Final = 5e6
FIVE_MSPS: Final = FrontEnd(rate_hz=5e6, bandwidth_hz=4e6, encoding="sign-magnitude", bits=2)
LONGEST_S, BEFORE_S = 110.0, 20.0
LATE_S: Final = {"meacon-ramp": 180.0}
"""Where a stretch begins that does not begin before the onset: what is 14 dB too weak at first is not received."""


def cut_scene(scenario: Scenario) -> Scenario:
    """Cut at most `LONGEST_S` of a scene, from `BEFORE_S` before it begins, at no more than `AT_MOST_HZ`."""
    changes: dict[str, Any] = {}
    if scenario.front_end.rate_hz > AT_MOST_HZ:
        changes["front_end"] = FIVE_MSPS
    if scenario.duration_s > LONGEST_S:
        from_s = max(min(map(_begins_s, (*scenario.attacks, *scenario.interference)), default=0.0) - BEFORE_S, 0.0)
        from_s = LATE_S.get(scenario.name, min(from_s, scenario.duration_s - LONGEST_S))
        changes["duration_s"] = LONGEST_S
        for kind in ("attacks", "interference"):
            changes[kind] = tuple(source for source in getattr(scenario, kind) if source.onset_s < from_s + LONGEST_S)
        changes["receivers"] = tuple(
            r.model_copy(update={"start_offset_s": r.start_offset_s + from_s}) for r in scenario.receivers
        )
    return scenario.model_copy(update=changes)


def _begins_s(attack: Attack | Interference) -> float:
    """Return the onset; of a takeover that is there from the start, when it begins to drag off."""
    if attack.onset_s > 0.0 or not isinstance(attack, Takeover):
        return attack.onset_s
    return min((point[0] for point in (*attack.away_points_enu_m, *attack.clock_points_s)), default=0.0)


def make_rows(scenario: Scenario, equipments: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    """Make a row for each equipment that the scene can have.

    Samples are rendered once, for the equipment that has all antennas of the others, which use some of its files.
    Raises ValueError if none of them has. folder : for samples and outputs, empty.
    """
    stretch = cut_scene(scenario)
    found = {name: equipped_scene for name in equipments if (equipped_scene := equip(stretch, name)) is not None}
    scenes = {
        name: make_scene(equipped_scene.scenario, make_navigation(equipped_scene.scenario))
        for name, equipped_scene in found.items()
    }
    files = _render(max(scenes.values(), key=lambda scene: len(scene.skies)), folder)
    return [
        _row(scenario.name, name, scenes[name], equipped_scene, files, folder) for name, equipped_scene in found.items()
    ]


_Files = Mapping[tuple[str, Antenna], Path]
"""By receiver and antenna, whatever that is called."""


def _render(scene: Scene, folder: Path) -> _Files:
    return dict(zip(_antennas(scene), write_samples(scene, folder, "raw"), strict=True))


def _antennas(scene: Scene) -> list[tuple[str, Antenna]]:
    return [(sky.receiver.name, sky.antenna.model_copy(update={"name": ""})) for sky in scene.skies]


def _row(name: str, equipment: str, scene: Scene, found: Equipped, files: _Files, folder: Path) -> dict[str, Any]:
    if not files.keys() >= set(_antennas(scene)):
        raise ValueError(f"{equipment}: has an antenna that no other equipment of the same samples has")
    platform = _platform(scene, found, [files[key] for key in _antennas(scene)], folder)
    out = folder / equipment.replace(" ", "-")
    begin = perf_counter()
    result = protect(nav=folder / "broadcast.rnx", platform=platform, out=out)
    seconds = perf_counter() - begin
    made = found.scenario
    return {
        "scene": name,
        "equipment": equipment,
        "verdict": result.verdict.verdict,
        "no_sign": "no sign of spoofing" in result.verdict.summary,
        **score(scene, result.verdict, result.outcome),
        "from_s": made.receivers[0].start_offset_s,
        "duration_s": made.duration_s,
        "rate_msps": made.front_end.rate_hz / 1e6,
        "seconds": round(seconds, 1),
    }


def write_platform(scene: Scene, found: Equipped, folder: Path) -> Path:
    """Write the platform file with all that it names, and the orbits in `broadcast.rnx` beside it."""
    return _platform(scene, found, list(_render(scene, folder).values()), folder)


def write_without_samples(scene: Scene, found: Equipped, folder: Path) -> Path:
    """Write the platform file of a scene whose samples are not read, and the orbits and readings beside it."""
    return _platform(scene, found, [Path(f"{sky.name}.bin") for sky in scene.skies], folder)


def _platform(scene: Scene, found: Equipped, files: Sequence[Path], folder: Path) -> Path:
    """Write the platform file. files : of the antennas of the scene, in their order."""
    write_nav(folder / "broadcast.rnx", scene.navigation)
    write_series(scene, folder)
    stated = dict(found.stated) | {"receivers": _tables(scene, found.stated["receivers"], files)}
    if "imu" in stated:
        name = found.first.name
        stated["imu"] = {**stated["imu"], "file": f"{name}-imu.csv", "initial": _attitude_deg(scene, name)}
    path = folder / "platform.toml"
    path.write_text(tomli_w.dumps(stated), encoding="utf-8")
    return path


def _tables(scene: Scene, tables: Sequence[Mapping[str, Any]], files: Sequence[Path]) -> list[dict[str, Any]]:
    """Add the recordings of each receiver's antennas to its table."""
    of = [sky.receiver.name for sky in scene.skies]
    return [
        {**table, "inputs": [file.name for name, file in zip(of, files, strict=True) if name == table["name"]]}
        for table in tables
    ]


def _attitude_deg(scene: Scene, name: str) -> dict[str, float]:
    start_s = next(sky.receiver.start_offset_s for sky in scene.skies if sky.receiver.name == name)
    at = scene.trajectories[name].at(np.array([start_s]))
    angles: Reals = np.degrees(heading_pitch_roll_rad(at.position_ecef_m[0], at.attitude[0]))
    named = zip(("heading_deg", "pitch_deg", "roll_deg"), angles, strict=True)
    return {key: float(angle) for key, angle in named} | {"sigma_deg": ATTITUDE_DEG}
