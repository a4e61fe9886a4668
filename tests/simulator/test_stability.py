"""What the page of errors shows: generated data have the Allan deviation that their class promises."""

import numpy as np
import pytest

from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.simulator.stability import Stability, measure_clock_stability, measure_imu_stability


@pytest.fixture(scope="module")
def deviations() -> list[Stability]:
    return [*measure_imu_stability(), *measure_clock_stability()]


def test_every_noisy_oscillator_and_both_sensors_are_measured(deviations):
    assert {item.name for item in deviations if item.what == "oscillator"} == set(OSCILLATORS) - {"perfect"}
    assert {(item.name, item.what) for item in deviations if item.what != "oscillator"} == {
        (name, kind) for name in ("navigation", "tactical") for kind in ("accelerometer", "gyro")
    }


def test_deviations_agree_with_theory_within_their_own_spread(deviations):
    # 90 % limits: about a tenth of the points lie outside, and hardly any by more than twice the limits' width.
    inside = np.concatenate([(item.lower <= item.theory) & (item.theory <= item.upper) for item in deviations])
    assert inside.mean() > 0.75
    for item in deviations:
        reach = np.maximum(item.upper - item.deviation, 0.03 * item.theory)
        assert (np.abs(item.deviation - item.theory) < 3.0 * reach).all(), item.name


def test_a_seed_determines_the_points_and_another_differs():
    first, again, other = (measure_imu_stability(seed=seed)[0].deviation for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
