"""One cell of the matrix: a scene rendered for certain equipment, protected as a user would, beside the truth."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, Final

import numpy as np
import tomli_w

from skyproof.app.protect import ProtectResult, protect
from skyproof.arrays import Reals
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import heading_pitch_roll_rad
from skyproof.simulator.constellation import navigation_of
from skyproof.simulator.files import write_samples, write_series
from skyproof.simulator.received import Scene
from skyproof.simulator.scenario import Attack, FrontEnd, Interference, Scenario, Takeover
from skyproof.simulator.sky import scene_of
from skyproof.studies.protection.equipment import ATTITUDE_DEG, Equipped, equipped
from skyproof.studies.protection.score import score

__all__ = ["cell_of", "stretch_of", "written"]

AT_MOST_HZ: Final = 5e6
FIVE_MSPS: Final = FrontEnd(rate_hz=5e6, bandwidth_hz=4e6, encoding="sign-magnitude", bits=2)
LONGEST_S, BEFORE_S = 110.0, 20.0
LATE_S: Final = {"meacon-ramp": 180.0}
"""Where a stretch begins that does not begin before the onset: what is 14 dB too weak at first is not received."""


def stretch_of(scenario: Scenario) -> Scenario:
    """At most `LONGEST_S` of a scene, from `BEFORE_S` before it begins, at no more than `AT_MOST_HZ`."""
    changes: dict[str, Any] = {}
    if scenario.front_end.rate_hz > AT_MOST_HZ:
        changes["front_end"] = FIVE_MSPS
    if scenario.duration_s > LONGEST_S:
        from_s = max(min(map(_begins_s, (*scenario.attacks, *scenario.interference)), default=0.0) - BEFORE_S, 0.0)
        from_s = LATE_S.get(scenario.name, min(from_s, scenario.duration_s - LONGEST_S))
        changes["duration_s"] = LONGEST_S
        for kind in ("attacks", "interference"):
            changes[kind] = tuple(one for one in getattr(scenario, kind) if one.onset_s < from_s + LONGEST_S)
        changes["receivers"] = tuple(
            r.model_copy(update={"start_offset_s": r.start_offset_s + from_s}) for r in scenario.receivers
        )
    return scenario.model_copy(update=changes)


def _begins_s(attack: Attack | Interference) -> float:
    """The onset; of a takeover that is there before the first sample, when it begins to draw off."""
    if attack.onset_s > 0.0 or not isinstance(attack, Takeover):
        return attack.onset_s
    return min((point[0] for point in (*attack.away_points_enu_m, *attack.clock_points_s)), default=0.0)


def cell_of(scenario: Scenario, equipment: str, folder: Path) -> dict[str, Any] | None:
    """A cell's row; None where the scene cannot have the equipment.

    folder : for the samples and outputs, empty.
    """
    found = equipped(stretch_of(scenario), equipment)
    if found is None:
        return None
    scene = scene_of(found.scenario, navigation_of(found.scenario))
    platform = written(scene, found, folder)
    begin = perf_counter()
    result = protect(nav=folder / "broadcast.rnx", platform=platform, out=folder / "out")
    seconds = perf_counter() - begin
    made = found.scenario
    return {
        "scene": scenario.name,
        "equipment": equipment,
        **_said(result),
        **score(scene, result.verdict, result.outcome),
        "from_s": made.receivers[0].start_offset_s,
        "duration_s": made.duration_s,
        "rate_msps": made.front_end.rate_hz / 1e6,
        "seconds": round(seconds, 1),
    }


def _said(result: ProtectResult) -> dict[str, Any]:
    return {"verdict": result.verdict.verdict, "no_sign": "no sign of spoofing" in result.verdict.summary}


def written(scene: Scene, found: Equipped, folder: Path) -> Path:
    """The platform file, with all that it names; the orbits in `broadcast.rnx` beside it."""
    write_nav(folder / "broadcast.rnx", scene.navigation)
    files = write_samples(scene, folder, "raw")
    write_series(scene, folder)
    stated = dict(found.stated) | {"receivers": _tables(scene, found.stated["receivers"], files)}
    if "imu" in stated:
        name = found.first.name
        stated["imu"] = {**stated["imu"], "file": f"{name}-imu.csv", "initial": _attitude_deg(scene, name)}
    path = folder / "platform.toml"
    path.write_text(tomli_w.dumps(stated), encoding="utf-8")
    return path


def _tables(scene: Scene, tables: Sequence[Mapping[str, Any]], files: Sequence[Path]) -> list[dict[str, Any]]:
    """With the recordings of each receiver's antennas."""
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
