"""Clean sky at many places, times and strengths: nothing of it may be called spoofed, and what is labelled is right."""

import numpy as np
import pytest
from scipy import stats

from skyproof.app.common.epoch_source import WholeSource
from skyproof.app.common.progress import Silent
from skyproof.app.common.session import examine_all, open_session
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import asked
from skyproof.app.protect import judge
from skyproof.app.receive.reception import Reception, observe
from skyproof.app.receive.tracker import track
from skyproof.fusion.fuse import fuse
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import scenes
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, ScenePlace


def draw_place(rng: np.random.Generator) -> tuple[ScenePlace, np.datetime64]:
    """Draw a place between 70 S and 70 N, and a moment in four years."""
    place = ScenePlace(
        lat_deg=float(np.degrees(np.arcsin(rng.uniform(-0.94, 0.94)))),
        lon_deg=float(rng.uniform(-180.0, 180.0)),
        height_m=float(rng.uniform(0.0, 1500.0)),
    )
    return place, np.datetime64("2021-01-01T00:00:00", "ns") + np.timedelta64(int(rng.integers(126_230_400)), "s")


def clean_windows_by_measurement(n_scenes: int, seed: int) -> tuple[int, int, int]:
    """Windows examined, false labels and false verdicts of scenes of 60 s at the level of measurements."""
    rng = np.random.default_rng(seed)
    windows_seen = false_labels = false_verdicts = 0
    for number in range(n_scenes):
        place, start = draw_place(rng)
        baseline_m = float(rng.uniform(20.0, 200.0))
        settings = Settings(antenna_distance_m=baseline_m if number % 2 else None)
        scenario = scenes.make_clean(
            place,
            start,
            duration_s=61.0,
            baseline_m=baseline_m,
            mask_deg=10.0,
            seed=number,
            zenith_cn0_dbhz=float(rng.uniform(42.0, 52.0)),
            horizon_cn0_dbhz=float(rng.uniform(34.0, 42.0)),
        )
        navigation = make_nominal_constellation(start)
        noise = NoiseModel(sigma_m=0.7, ar1=float(rng.choice([0.0, 0.9])), constant_m=1.0)
        observed, _ = simulate_observations(scenario, navigation, rng=rng, noise=noise)
        session = open_session([WholeSource(o) for o in observed], navigation, settings)
        evidence, sets, _ = examine_all(session, Silent())
        decision = fuse(evidence, observed, sets)
        windows_seen += len(session.windows)
        false_labels += sum(s.label == "spoofed" for s in decision.labels)
        false_verdicts += decision.verdict == "spoofed"
    return windows_seen, false_labels, false_verdicts


def test_eight_clean_scenes_bear_no_false_label():
    windows, labels, verdicts = clean_windows_by_measurement(8, seed=11)
    assert windows >= 40
    # Stated: 0.001 an hour, here 8 minutes of sky: one false verdict has probability 1.3e-4.
    assert (labels, verdicts) == (0, 0)


@pytest.mark.long
def test_false_verdicts_on_clean_measurements_keep_their_rate():
    windows, _, verdicts = clean_windows_by_measurement(1500, seed=12)
    hours = windows * 10.0 / 3600.0
    assert stats.poisson.sf(verdicts - 1, 1e-3 * hours) > 1e-3


def protect_in_memory(scenario, baseline_m=None):
    """Render a scene to samples without files, and return the decision."""
    navigation = make_nominal_constellation(scenario.start_gpst)
    settings = Settings(antenna_distance_m=baseline_m)
    trackers, _ = track(render_samples(scenario, navigation), settings, asked=asked())
    receptions: list[Reception] = [observe(tracker, navigation) for tracker in trackers]
    outcome, _ = judge(receptions, navigation, settings, Silent())
    return outcome


@pytest.mark.long
def test_two_hundred_clean_sample_windows_have_no_false_label():
    # 34 scenes of 60 s at sample level, 45 down to 36 dB-Hz at the horizon: about 20 minutes.
    rng = np.random.default_rng(13)
    windows = false = authentic = 0
    for number in range(34):
        place, start = draw_place(rng)
        baseline_m = float(rng.uniform(30.0, 150.0))
        scenario = scenes.make_clean(
            place,
            start,
            duration_s=60.5,
            baseline_m=baseline_m,
            mask_deg=8.0,
            seed=number,
            zenith_cn0_dbhz=float(rng.uniform(44.0, 51.0)),
            horizon_cn0_dbhz=float(rng.uniform(36.0, 42.0)),
        )
        outcome = protect_in_memory(scenario, baseline_m)
        windows += len({e.start_gpst for e in outcome.evidence})
        false += sum(s.label == "spoofed" for s in outcome.decision.labels) + (outcome.decision.verdict == "spoofed")
        authentic += outcome.decision.verdict == "authentic"
    assert windows >= 200
    assert false == 0
    assert authentic >= 30


FRONT_ENDS = {
    "that of the demonstration": FrontEnd(),
    "two bits": FrontEnd(encoding="sign-magnitude", bits=2, bandwidth_hz=2.08e6),
    "two bits at 5 Msps": FrontEnd(rate_hz=5e6, encoding="sign-magnitude", bits=2, bandwidth_hz=4e6),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", [*FRONT_ENDS, "reflections"])
def test_grids_of_clean_samples_raise_no_alarm(kind):
    # Four scenes of 24 s of each: `dccaf` looks at them all, and none is near an alarm.
    rng = np.random.default_rng(14)
    p_values = []
    for number in range(4):
        place, start = draw_place(rng)
        scenario = scenes.make_clean(place, start, duration_s=24.5, receivers=1, seed=number, mask_deg=8.0)
        if kind == "reflections":
            scenario = scenes.read_ready_made("multipath")
            receivers = scenario.receivers[number % 2 : number % 2 + 1]
            scenario = scenario.model_copy(update={"seed": number, "duration_s": 24.5, "receivers": receivers})
        else:
            scenario = scenario.model_copy(update={"front_end": FRONT_ENDS[kind]})
        outcome = protect_in_memory(scenario)
        findings = [e for e in outcome.evidence if e.detector == "dccaf"]
        assert {e.says for e in findings} <= {"clean", "undecided"}
        p_values += [e.p_value for e in findings if e.p_value is not None]
    assert len(p_values) >= 6
    assert min(p_values) > 0.01
