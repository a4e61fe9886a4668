"""Ways to make one alarm of many p-values, `bench/fused.py`, and counts of clean hours, `bench/clean_hours.py`."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

BENCH = Path(__file__).parents[2] / "bench"
sys.path.insert(0, str(BENCH))
try:
    fused, hours = importlib.import_module("fused"), importlib.import_module("clean_hours")
finally:
    sys.path.remove(str(BENCH))

ASKED, RUNS = 0.05, 800
DETECTORS = ("common_change", "continuity", "residual", "second_signals")


def make_windows(p_values):
    """Make windows of (n_windows, n_detectors) p-values."""
    return [[(name, float(p), True) for name, p in zip(DETECTORS, row, strict=True)] for row in p_values]


def count_alarms(way, draw) -> float:
    """Return the share of runs of six windows with an alarm at `ASKED`; two sigma of it are 0.015."""
    rng = np.random.default_rng(3)
    return float(np.mean([fused.WAYS[way](make_windows(draw(rng))) < ASKED for _ in range(RUNS)]))


@pytest.mark.parametrize("way", ["union", "Holm", "Cauchy", "Fisher"])
def test_of_independent_tests_alarms_come_at_the_asked_rate(way):
    assert count_alarms(way, lambda rng: rng.random((6, 4))) == pytest.approx(ASKED, abs=0.02)


@pytest.mark.parametrize("way", ["union", "Holm", "Cauchy", "majority"])
def test_alarms_of_equal_tests_keep_the_asked_rate(way):
    assert count_alarms(way, lambda rng: np.full((6, 4), rng.random())) < ASKED + 0.02


def test_fisher_believes_one_test_as_often_as_it_is_repeated():
    assert count_alarms("Fisher", lambda rng: np.full((6, 4), rng.random())) > 4.0 * ASKED


def test_a_majority_needs_more_than_one_detector():
    alone = make_windows([[1e-12, 1.0, 1.0, 1.0]])
    most = make_windows([[1e-12, 1e-9, 1e-9, 1.0]])
    assert fused.majority(alone) == 1.0
    assert fused.majority(most) < 1e-8


def test_holm_alarms_as_the_union_does_and_rejects_more_tests():
    rng = np.random.default_rng(4)
    for _ in range(50):
        windows = make_windows(rng.random((6, 4)) ** 4)
        assert fused.holm(windows) == pytest.approx(fused.union(windows))
    by_union, by_holm = fused._rejected(make_windows([[1e-9, 1e-8, 3e-4, 0.5]]))
    assert (by_union, by_holm) == (2, 3)


def test_tests_that_cannot_reject_do_not_blind_the_tangents():
    windows = make_windows([[1e-12, 1.0, 1.0, 1.0], *np.ones((24, 4))])
    assert 1e-11 < fused.cauchy(windows) < 1e-9


def test_a_rejected_antenna_is_no_test_of_the_sky(invented):
    findings = [
        invented.evidence(0, "undecided", detector="multi_receiver", p_value=1e-30, null="one antenna"),
        invented.evidence(0, "spoofed", detector="multi_receiver", p_value=1e-9),
        invented.evidence(0, "undecided", detector="residual", p_value=1e-12),
        invented.evidence(0, "clean", detector="second_signals", p_value=0.3),
    ]
    (window,) = fused.tests_of(findings)
    assert sorted(window) == [
        ("multi_receiver", 1e-9, True),
        ("residual", 1e-12, False),
        ("second_signals", 0.3, True),
    ]


def test_a_p_value_far_below_its_share_rejects_at_lower_rates(invented):
    e = invented.evidence(0, "attack", p_value=1e-8, asked=4e-6)
    (at,) = hours._from_rates([e], 0.4).values()
    assert at == pytest.approx(1e-3)


def test_no_alarm_in_ten_hours_bounds_their_rate():
    assert hours._rate(0, 10.0) == "0.0000 (0.0000-0.3689)"
