"""Which signals `vector_sqm` names through the whole vector receiver: drawn scenes of samples.

`python bench/vector_drawn.py 10` : so many scenes. Fewer and slower than the draws of correlators in `bench/vector.py`.
`python bench/vector_drawn.py ready` : the ready-made scenes, and one of them without its false signals.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from vector import EVERY_20_MS, _in_memory, _tracked

from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import windows_of
from skyproof.app.receive.reception import observe
from skyproof.detectors.correlators.vector_sqm_detector import VectorSqm, VectorSqmSettings
from skyproof.records import Finding
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, SatelliteDirection, Scenario

SCENES, SCENE_S, WINDOW_S, SETTLED_S = 8, 16.0, 3.0, 7.0
RATE_HZ = 2.6e6
READY_S, READY_WINDOW_S, READY_FROM_S = 20.0, 2.0, 10.0
FURTHER = (("G06", 30.0, 45.0), ("G19", 130.0, 15.0))


def report(count: int = SCENES) -> Iterator[str]:
    """A row for each scene, and the sums."""
    yield (
        f"{count} scenes of {SCENE_S:g} s at {RATE_HZ / 1e6:g} Msps, none, one or two false of eight, 0.05 to 0.4 "
        f"chip, 5 to 200 Hz, 40 to 50 dB-Hz; windows of {WINDOW_S:g} s from {SETTLED_S:g} s on, at 0.0001"
    )
    sums = dict.fromkeys(("windows", "alarms", "right", "wrong"), 0)
    for number in range(count):
        rng = np.random.default_rng([5, number])
        scene, false = _scene(rng, number % 3)
        said = _said(scene)
        failed = [item for item in said if item.failed]
        named = [item for item in failed if item.data["sets"] == 1 and item.data["set_size"]]
        wrong = sum(_names(item) - set(false) != set() for item in named)
        right = sum(_names(item) == set(false) for item in named)
        yield f"  {number}: {' '.join(false) or 'none':<8} {len(failed)} of {len(said)}, {right} right, {wrong} wrong"
        if false:
            for key, value in (("windows", len(said)), ("alarms", len(failed)), ("right", right), ("wrong", wrong)):
                sums[key] += value
    yield (
        f"  of {sums['windows']} windows with false signals {sums['alarms']} noticed, {sums['right']} rightly named, "
        f"{sums['wrong']} wrongly"
    )


def ready() -> Iterator[str]:
    """A row for each ready-made scene."""
    yield f"{READY_S:g} s, {RATE_HZ / 1e6:g} Msps, windows of {READY_WINDOW_S:g} s from {READY_FROM_S:g} s on"
    front_end = FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=2.4e6, encoding="int", bits=8)
    one, many = (scenes.read_ready_made(f"vector-{name}") for name in ("one-spoofer", "many"))
    assert one.sky.directions is not None
    all_true = one.sky.model_copy(update={"sats": tuple(each.sat for each in one.sky.directions)})
    clean = one.model_copy(update={"sky": all_true, "attacks": ()})
    for name, scene in (("vector-one-spoofer", one), ("vector-many", many), ("without false signals", clean)):
        short = scene.model_copy(update={"duration_s": READY_S, "front_end": front_end})
        said = _said(short, READY_WINDOW_S, READY_FROM_S)
        p_values = [evidence.p_value for evidence in said if evidence.p_value is not None]
        words = Counter(_describe(finding) for finding in said)
        result = "; ".join(f"{number} x {text}" for text, number in words.items())
        yield f"  {name}: {sum(each.failed for each in said)} of {len(said)}, p at most {max(p_values):.2g}; {result}"


def _names(finding: Finding) -> set[str]:
    """Return the satellites of the signals that are named."""
    suspects: Any = finding.data["suspects"]
    return {ref.signal.sat for ref in finding.signals if str(ref.signal) in suspects}


def _describe(finding: Finding) -> str:
    """Return the code, and how many sets of which signals would explain a misfit."""
    data: Any = finding.data
    return f"{finding.code}, {data['sets']} sets: {' '.join(data['suspects'])}" if finding.failed else finding.code


def _scene(rng: np.random.Generator, attacked: int) -> tuple[Scenario, tuple[str, ...]]:
    scene = scenes.read_ready_made("vector-one-spoofer")
    assert scene.sky.directions is not None
    more = tuple(SatelliteDirection(sat=sat, az_deg=az, el_deg=el) for sat, az, el in FURTHER)
    everywhere = (*scene.sky.directions, *more)
    sats = tuple(item.sat for item in everywhere)
    level = float(rng.uniform(40.0, 50.0))
    false = tuple(sorted(str(sat) for sat in rng.permutation(sats)[:attacked]))
    sky = scene.sky.model_copy(
        update={
            "directions": everywhere,
            "sats": tuple(sat for sat in sats if sat not in false),
            "zenith_cn0_dbhz": level,
            "horizon_cn0_dbhz": level,
        }
    )
    attack = scene.attacks[0].model_copy(
        update={
            "sats": false,
            "sat_code_m": {sat: 293.05 * float(rng.uniform(0.05, 0.4) * rng.choice([-1, 1])) for sat in false},
            "sat_doppler_hz": {sat: float(rng.uniform(5.0, 200.0) * rng.choice([-1, 1])) for sat in false},
        }
    )
    front_end = FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=2.4e6, encoding="int", bits=8)
    changes = {
        "sky": sky,
        "attacks": (attack,) if false else (),
        "duration_s": SCENE_S,
        "front_end": front_end,
        "seed": int(rng.integers(1, 10_000)),
    }
    return scene.model_copy(update=changes), false


def _said(scene: Scenario, window_s: float = WINDOW_S, settled_s: float = SETTLED_S) -> list[Finding]:
    """Of each window once the loops have settled."""
    navigation = make_navigation(scene)
    samples = render_samples(scene, navigation)[0]
    tracker, _ = _tracked(_in_memory(samples, samples.read(0, samples.n_samples)), navigation, "vector", EVERY_20_MS)
    reception = observe(tracker, navigation)
    assert reception.observations is not None
    assert reception.vector_taps is not None
    windows = windows_of(
        [reception.observations], navigation, Settings(window_s=window_s), vector_taps=[reception.vector_taps]
    )
    detector, state, findings = VectorSqm(VectorSqmSettings(false_alarm_probability=1e-4)), None, []
    for records in windows:
        evidence, state = detector.examine(records, state)
        looks = records.vector_taps[0].elapsed_s
        findings += [
            item for item in evidence if item.p_value is not None and looks.size and looks[0] > settled_s - 0.1
        ]
    return findings


if __name__ == "__main__":
    asked = sys.argv[1] if len(sys.argv) > 1 else str(SCENES)
    for text in ready() if asked == "ready" else report(int(asked)):
        print(text, flush=True)
