"""What the page of errors shows: generated data have the Allan deviation that their class promises."""

import numpy as np
import pytest

from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.simulator.stability import Stability, measure_clock_stability, measure_imu_stability


@pytest.fixture(scope="module")
def found() -> list[Stability]:
    return [*measure_imu_stability(), *measure_clock_stability()]


def test_every_noisy_oscillator_and_both_sensors_are_measured(found):
    assert {one.name for one in found if one.what == "oscillator"} == set(OSCILLATORS) - {"perfect"}
    assert {(one.name, one.what) for one in found if one.what != "oscillator"} == {
        (name, what) for name in ("navigation", "tactical") for what in ("accelerometer", "gyro")
    }


def test_deviations_agree_with_theory_within_their_own_spread(found):
    """90 % limits: about a tenth of the points lie outside, and hardly any by more than twice the limits' width."""
    inside = np.concatenate([(one.lower <= one.theory) & (one.theory <= one.upper) for one in found])
    assert inside.mean() > 0.75
    for one in found:
        reach = np.maximum(one.upper - one.deviation, 0.03 * one.theory)
        assert (np.abs(one.deviation - one.theory) < 3.0 * reach).all(), one.name


def test_a_seed_determines_the_points_and_another_differs():
    first, again, other = (measure_imu_stability(seed=seed)[0].deviation for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
