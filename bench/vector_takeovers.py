"""Takeovers of all satellites at once under scalar and under vector tracking: where receivers end, and what shows.

`python bench/vector_takeovers.py 0 2` : some of the variants of the scene `takeover`, shortened, 2 Msps. For each
tracking: the ordinary fix at the end beside truth and beside what the false signals show, epochs in which the fix's own
residual test fails at 0.001, arcs whose code left its carrier, satellites followed twice and since when, and windows of
4 s in which `sqm` and `vector_sqm` say something, of those after the onset, from the end of the first one.
"""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from vector import _in_memory, _tracked
from vector_limits import _strongest

from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import windows_of
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import Tracker
from skyproof.detectors.correlators.sqm_detector import Sqm
from skyproof.detectors.correlators.vector_sqm_detector import VectorSqm
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.navigation.fix import fix
from skyproof.records import FixStatus, NavigationData
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario

ONSET_S, PULL_S, END_S, WINDOW_S = 8.0, 14.0, 44.0, 4.0
VARIANTS = ((4.0, 10.0, 0.0), (1.0, 10.0, 0.0), (4.0, 0.0, 10.0), (4.0, 3.0, 0.0))
"""Power over the true signals, dB, and what they are led by: metres a second of place, and of the clock."""


def report(numbers: tuple[int, ...] = tuple(range(len(VARIANTS)))) -> Iterator[str]:
    """Rows of the table."""
    for number in numbers:
        power_db, place_m_s, clock_m_s = VARIANTS[number]
        scene = _scene(power_db, place_m_s, clock_m_s)
        navigation = make_navigation(scene)
        samples = render_samples(scene, navigation)[0]
        held = _in_memory(samples, samples.read(0, samples.n_samples))
        yield f"  {power_db:+g} dB, place {place_m_s:g} m/s, clock {clock_m_s:g} m/s, {END_S - PULL_S:g} s of pull"
        for tracking in ("scalar", "vector"):
            tracker, _ = _tracked(held, navigation, tracking, Sqm.asks)
            yield f"    {tracking}: {_row(tracker, navigation, scene, place_m_s * (END_S - PULL_S))}"


def _scene(power_db: float, place_m_s: float, clock_m_s: float) -> Scenario:
    scene, long_s = scenes.read_ready_made("takeover"), END_S - PULL_S
    changes: dict[str, Any] = {
        "onset_s": ONSET_S,
        "power_db": power_db,
        "power_points_db": ((ONSET_S, -24.0), (PULL_S - 2.0, 0.0)),
        "away_points_enu_m": ((PULL_S, 0.0, 0.0, 0.0), (END_S, place_m_s * long_s, 0.0, 0.0)),
    }
    if clock_m_s:
        changes["clock_points_s"] = ((PULL_S, 0.0), (END_S, clock_m_s * long_s / 299_792_458.0))
    front_end = FrontEnd(rate_hz=2e6, bandwidth_hz=1.8e6, encoding="int", bits=8)
    attack = scene.attacks[0].model_copy(update=changes)
    return scene.model_copy(
        update={
            "receivers": scene.receivers[:1],
            "attacks": (attack,),
            "duration_s": END_S,
            "front_end": front_end,
        }
    )


def _row(tracker: Tracker, navigation: NavigationData, scene: Scenario, led_m: float) -> str:
    reception, at = observe(tracker, navigation), scene.receivers[0]
    assert reception.observations is not None
    o = reception.observations.read(0, reception.observations.gpst.size)
    found = fix(o, navigation, signals=_strongest(o), false_alarm_probability=1e-3)
    place_m = ecef_from_geodetic(np.radians(at.lat_deg), np.radians(at.lon_deg), at.height_m)
    off_m = np.linalg.norm(found.position_ecef_m - place_m, axis=1)
    last = off_m[np.isfinite(off_m)][-1]
    failed = int(np.sum((found.status == FixStatus.MISFIT) & (o.elapsed_s > ONSET_S)))
    pulled = sum(arc.began == "pulled away" for arc in tracker.arcs.values())
    twice = sorted(arc.found_s for arc in tracker.arcs.values() if arc.signal.copy != "a" and arc.began == "found")
    second = f"{len(twice)} followed twice" + (f" from {twice[0]:.1f} s on" if twice else "")
    windows = windows_of(
        [o],
        navigation,
        Settings(window_s=WINDOW_S),
        taps=[item for item in (reception.taps,) if item is not None],
        vector_taps=[item for item in (reception.vector_taps,) if item is not None],
    )
    words, state = {"sqm": list[float](), "vector_sqm": list[float]()}, None
    for records in windows:
        end_s = float(records.observations[0].elapsed_s[-1])
        findings, state = VectorSqm().examine(records, state)
        findings = [*findings, *Sqm().examine(records)[0]]
        for item in findings:
            if (item.failed or item.says == "attack") and end_s > ONSET_S:
                words[item.detector].append(end_s)
    names = ", ".join(f"{name} {len(at_s)} (first {min(at_s, default=np.nan):.0f} s)" for name, at_s in words.items())
    return (
        f"{last:.0f} m off at the end, led by {led_m:g} m; {failed} fixes fail; {pulled} pulled away; {second}; {names}"
    )


if __name__ == "__main__":
    for text in report(*filter(None, [tuple(map(int, sys.argv[1:]))])):
        print(text, flush=True)
