"""Recordings that were cut and joined: the verdict is not authentic, and says where they are not continuous."""

from dataclasses import replace

import numpy as np
import pytest
from tests.app import kit

from skyproof.app.common import windows
from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge, protect
from skyproof.app.protect.document import document
from skyproof.app.receive.reception import Reception
from skyproof.detectors.continuity.detector import Continuity
from skyproof.detectors.registry import load_detectors
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.records import OBSERVABLES, NavigationData, Samples
from skyproof.simulator.measurements import NoiseModel, simulate_observations
from skyproof.simulator.scenario import FrontEnd

EPOCH_S = 0.2


@pytest.fixture(autouse=True)
def with_continuity(monkeypatch):
    """Register this tree's detectors of continuity, whatever was installed with the package."""
    monkeypatch.setattr(windows, "load_detectors", lambda: load_detectors() | {"continuity": Continuity})


def make_reception(o):
    samples = Samples(name=o.receiver, rate_hz=1e6, n_samples=1, read=lambda start, count: np.zeros((2, 0), np.float32))
    return Reception(
        source=samples, observations=o, decoded=NavigationData(ephemerides=()), n_signals=len(o.signals), examined_s=1.0
    )


def join_halves(one, other, row):
    """Join the first half of one receiver's file and the second half of another's."""
    cells = {name: np.concatenate((getattr(one, name)[:row], getattr(other, name)[row:])) for name in OBSERVABLES}
    status = one.status.copy()
    status[row] = 3
    return replace(one, status=status, **cells)


def judge_pair(observed, navigation):
    settings = Settings(antenna_distance_m=61.0)
    outcome, _ = judge([make_reception(o) for o in observed], navigation, settings, Silent())
    return document(outcome, [], settings), outcome.evidence


@pytest.fixture(scope="module")
def pair():
    """Simulate two receivers 61 m apart over 35 s."""
    scenario = kit.make_scenario(duration_s=35.0)
    navigation = make_nominal_constellation(scenario.start_gpst)
    noise = NoiseModel(sigma_m=1.5, carrier_sigma_cyc=0.01, doppler_sigma_hz=0.3)
    observed, _ = simulate_observations(
        scenario, navigation, rng=np.random.default_rng(1), interval_s=EPOCH_S, noise=noise
    )
    return observed, navigation


def test_the_same_receivers_as_they_were_recorded_are_authentic(pair):
    observed, navigation = pair
    assert judge_pair(observed, navigation)[0].verdict == "authentic"


@pytest.mark.parametrize("row", [50, 88], ids=["between windows", "within one"])
def test_halves_of_two_receivers_swapped_are_not_authentic(pair, row):
    (first, other), navigation = pair
    verdict, found = judge_pair((join_halves(first, other, row), join_halves(other, first, row)), navigation)
    assert verdict.verdict == "suspect"
    steps = [e.data for e in found if (e.detector, e.code) == ("continuity", "step")]
    assert {(bool(step["broke"]), step["kinds"][0]) for step in steps} == {(True, "position")}
    assert all(60.0 < step["position_m"] < 70.0 for step in steps)
    assert verdict.may_also_be[0] == "joined"
    assert np.datetime64(verdict.since_gpst, "ns") == first.gpst[row]
    late = [s for s in verdict.signals if s.label == "authentic" and s.to_gpst > str(first.gpst[row])]
    assert not late


@pytest.mark.long
def test_a_file_joined_to_itself_is_not_authentic(tmp_path):
    front_end = FrontEnd(rate_hz=2_600_000, encoding="sign-magnitude", bits=2)
    recorded = kit.record(kit.make_scenario(duration_s=16.0, front_end=front_end), tmp_path)
    for path in recorded.paths:
        path.write_bytes(2 * path.read_bytes())
    result = protect(recorded.paths, nav=recorded.nav)
    assert result.verdict.verdict == "suspect"
    steps = [e for e in result.outcome.evidence if e.detector == "continuity" and e.code == "step"]
    assert any(e.data["clock_s"] == pytest.approx(16.0, abs=0.1) for e in steps)
    for r in result.outcome.receivers:
        assert (np.diff(r.reception.observations.gpst) > np.timedelta64(0)).all()
