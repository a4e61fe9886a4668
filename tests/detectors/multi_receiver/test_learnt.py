"""A true sky that is drowned: what windows before it taught of the antennas serves after it."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.learnt import LearntDistances
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.records import Baseline
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (24.0, 18.0, 0.0)}
ERRORS = TrackErrors(sigma_m=1.0, correlation=0.5, constant_m=0.5)
START = np.datetime64("2024-05-14T10:00:00", "ns")


def make_scene(start_s=0, **changes):
    options = {"antennas_enu_m": PLACES, "errors": ERRORS, "epochs": 10, "max_satellites": 10}
    return MeasuredScene(**(options | {"start_gpst": START + np.timedelta64(round(1e3 * start_s), "ms")} | changes))


def examine_records(*scenes, receivers=None):
    """Examine windows in a row and list their findings."""
    rng, detector, state, findings = np.random.default_rng(2), MultiReceiver(MultiReceiverSettings()), None, []
    for made in scenes:
        records = made.records(rng)
        evidence, state = detector.examine(records, state)
        findings.append([e for e in evidence if e.start_gpst == records.start_gpst])
    return findings


def state_both(count):
    return [make_scene(10.5 * k, false=(FalseSky(),)) for k in range(count)]


def test_one_antenna_after_the_sky_is_drowned_is_spoofed():
    drowned = [make_scene(10.5 * k, sky=(), false=(FalseSky(),)) for k in range(3, 9)]
    for apart_m, windows in ((30.0, 6), (60.0, 1)):
        places = {"rx1": (0.0, 0.0, 0.0), "rx2": (0.8 * apart_m, 0.6 * apart_m, 0.0)}
        *_, last = examine_records(
            *(replace(made, antennas_enu_m=places) for made in (*state_both(3), *drowned[:windows]))
        )
        (spoofed,) = [e for e in last if e.says == "spoofed"]
        assert spoofed.data["known"] == "learnt_distance"
        assert "distance_kept" in spoofed.data["assumes"]


def test_without_windows_of_both_skies_it_is_undecided():
    for before in (state_both(2), [make_scene(10.5 * k) for k in range(3)]):
        *_, drowned = examine_records(*before, make_scene(31.5, sky=(), false=(FalseSky(),)))
        assert [e.says for e in drowned] == ["undecided"]


def test_the_true_sky_is_authentic_after_an_attack_and_a_turn():
    turned = {"rx1": (0.0, 0.0, 0.0), "rx2": (-18.0, 24.0, 0.0)}
    for after in (make_scene(31.5), make_scene(31.5, antennas_enu_m=turned)):
        *_, last = examine_records(*state_both(3), after)
        assert [e.says for e in last] == ["authentic"]
        assert "distance_kept" in last[0].data["assumes"]


def test_one_receiver_that_is_captured_alone_is_not_authentic():
    *_, last = examine_records(*state_both(3), make_scene(31.5, sky=("rx1",), false=(FalseSky(receivers=("rx2",)),)))
    assert "authentic" not in {e.says for e in last}


def test_a_true_sky_over_moved_antennas_is_no_attack():
    apart = {"rx1": (0.0, 0.0, 0.0), "rx2": (90.0, 70.0, 0.0)}
    *_, last = examine_records(*state_both(3), make_scene(31.5, antennas_enu_m=apart))
    assert [e.says for e in last] == ["undecided"]


@pytest.mark.parametrize("moved_m", [0.0, 40.0])
def test_antennas_that_move_apart_have_no_distance(moved_m):
    learnt = LearntDistances()
    for k in range(3):
        enu_m = np.array([[30.0 + 0.5 * moved_m * k, 0.0, 0.0]])
        baseline = Baseline(
            receivers=("rx1", "rx2"), start_gpst=START, end_gpst=START, enu_m=enu_m, covariance_m2=np.eye(3)
        )
        learnt = learnt.and_of(baseline)
    assert (learnt.of(("rx1", "rx2")) is None) == (moved_m > 0.0)
    assert learnt.of(("rx2", "rx1")) is None
    assert (
        learnt.and_of(replace(baseline, receivers=("a", "b", "c"), enu_m=np.zeros((2, 3)))).of(("a", "b", "c")) is None
    )
