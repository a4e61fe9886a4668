"""A recording of samples beside an observation file of the same scene."""

import numpy as np
import pytest
from tests.app.kit import ENU_M, make_scenario, record
from tests.app.protect.captured import capture_receiver

from skyproof.app.protect import protect
from skyproof.formats.rinex_obs import write_obs
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.measurements import NoiseModel, simulate_observations

pytestmark = pytest.mark.long

ANTENNAS = {name: ENU_M[name] for name in ("bow", "stern")}
MIDDLE = 20


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Record both receivers' samples and their measurements once a second."""
    scenario = make_scenario(duration_s=40.0)
    navigation = make_nominal_constellation(scenario.start_gpst)
    recorded = record(scenario, tmp_path_factory.mktemp("mixed"), navigation=navigation)
    rng = np.random.default_rng(5)
    measured, _ = simulate_observations(scenario, navigation, rng=rng, noise=NoiseModel(sigma_m=0.5, constant_m=0.3))
    return recorded, dict(zip(("bow", "stern"), measured, strict=True))


def write_mixed(recorded, observations, folder):
    path = folder / "stern.obs"
    write_obs(path, observations, signals=observations.signals, holds="simulated", marker="stern", version="test")
    inputs = [next(p for p in recorded.paths if p.stem == "bow"), path]
    return protect(inputs, nav=recorded.nav, out=folder / "out", antennas_enu_m=ANTENNAS)


def test_a_clean_sky_is_authentic_in_samples_and_in_measurements(scene, tmp_path):
    recorded, measured = scene
    result = write_mixed(recorded, measured["stern"], tmp_path)
    assert result.verdict.verdict == "authentic", result.verdict.summary
    assert {r.name for r in result.verdict.receivers} == {"bow", "stern"}
    assert all(r.trusted_fix is not None for r in result.verdict.receivers)
    formats = [i.format for i in result.verdict.inputs]
    assert formats[1] == "RINEX 3.05 observations"
    assert "RINEX" not in formats[0]


def test_logs_that_follow_the_recordings_antenna_are_spoofed(scene, tmp_path):
    recorded, measured = scene
    stern = capture_receiver(measured["stern"], measured["bow"], MIDDLE, rng=np.random.default_rng(6))
    verdict = write_mixed(recorded, stern, tmp_path).verdict
    assert verdict.verdict == "spoofed", verdict.summary
    since = stern.gpst[MIDDLE]
    assert abs(np.datetime64(verdict.since_latest_gpst, "ns") - since) <= np.timedelta64(11, "s")
    assert {s.receiver for s in verdict.signals if s.label == "spoofed"} == {"bow", "stern"}
