"""The ready-made scenes of papers through `protect`, behind drawn correlators: names, delay and trusted errors."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from skyproof.simulator import scenes
from skyproof.simulator.attacks import Takeover
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.sky import make_scene
from skyproof.studies.base import Row, StudySettings
from skyproof.studies.correlator_model import protect_scene
from skyproof.studies.protection.cell import cut_scene, write_without_samples
from skyproof.studies.protection.equipment import equip
from skyproof.studies.protection.score import onset_s, score

__all__ = ["judge_scenes"]

_DRAWS, _QUICK_DRAWS = 4, 1


def judge_scenes(settings: StudySettings, cells: Sequence[tuple[str, str]], longest_s: float = np.inf) -> Iterator[Row]:
    """Yield a row for each scene and equipment, a mean over draws of noise.

    spoofed_share : of draws whose word is *spoofed*. named_share, true_named : of the attacked satellites those that
    are called *spoofed*, and how many others are. delay_s : from the first pull, or the first sample if there is none,
    to the end of the first window in which a test reports it. wrong_labels, wrong_fixes, trusted_* : as of
    `protection.score`. None where there is nothing to average.
    """
    draws = settings.count(_DRAWS, _QUICK_DRAWS)
    for name, equipment in cells:
        judged = [_judge(name, equipment, settings.seed + number, longest_s) for number in range(draws)]
        columns = {key: [row[key] for row in judged if row[key] is not None] for key in judged[0]}
        means = {key: float(np.mean(values)) if values else None for key, values in columns.items()}
        yield {"scene": name, "equipment": equipment, "draws": draws, **means}


def _judge(name: str, equipment: str, seed: int, longest_s: float) -> dict[str, Any]:
    scenario = cut_scene(scenes.read_ready_made(name))
    scenario = scenario.model_copy(update={"duration_s": min(scenario.duration_s, longest_s)})
    found = equip(scenario, equipment)
    if found is None:
        raise ValueError(f"{name} cannot have {equipment}; take other equipment")
    scene = make_scene(found.scenario, make_navigation(found.scenario))
    with TemporaryDirectory(prefix="skyproof-study-") as folder:
        path = write_without_samples(scene, found, Path(folder))
        verdict, outcome = protect_scene(scene, scene.navigation, path, seed)
    made = score(scene, verdict, outcome)
    attacked = {sat for attack in scenario.attacks for sat in attack.sats or ()}
    named = {item.ref.signal.sat for item in outcome.decision.labels if item.label == "spoofed"}
    pulls_s = [
        point[0]
        for attack in scenario.attacks
        if isinstance(attack, Takeover)
        for point in (*attack.away_points_enu_m, *attack.clock_points_s)
    ]
    from_s = scenario.receivers[0].start_offset_s
    began_s = onset_s(scene)
    late_s = 0.0 if began_s is None or not pulls_s else max(min(pulls_s), from_s) - began_s
    return {
        "spoofed_share": float(verdict.verdict == "spoofed"),
        "named_share": len(named & attacked) / len(attacked) if attacked else None,
        "true_named": float(len(named - attacked)) if attacked else None,
        "delay_s": None if made["delay_s"] is None else made["delay_s"] - late_s,
        "wrong_labels": float(made["wrong_labels"]),
        "wrong_fixes": float(made["wrong_fixes"]),
        "trusted_worst_m": made["trusted_worst_m"],
        "trusted_share": made["trusted_share"],
    }
