"""How many signals a correlation function holds: the law of the count."""

import numpy as np
import pytest
from scipy import stats

from skyproof.studies.decomposition_laws import (
    count_statistic,
    count_test,
    delay_dictionary,
    noise_variance,
    simulate_taps,
)


def draw_two_signals(rng, n, separation_chips, rate_hz):
    """Draw noise variance and taps of two signals of random phases."""
    delays, variance = delay_dictionary(rate_hz), noise_variance(45.0, 0.02, rate_hz)
    delay = rng.uniform(-0.2, 0.2, (n, 1)) + [0.0, separation_chips]
    amplitude = np.array([1.0, 0.87]) * np.exp(2j * np.pi * rng.random((n, 2)))
    return variance, simulate_taps(delay, amplitude, variance, delays, rng)


def draw_null_statistics(rng, n, rate_hz, cn0_dbhz=45.0):
    delays, variance = delay_dictionary(rate_hz), noise_variance(cn0_dbhz, 0.02, rate_hz)
    delay, amplitude = rng.uniform(-0.5, 0.5, (n, 1)), np.exp(2j * np.pi * rng.random((n, 1)))
    return count_statistic(simulate_taps(delay, amplitude, variance, delays, rng), delays, variance)[0]


def test_one_signal_is_called_two_as_often_as_asked():
    rng = np.random.default_rng(13)
    test = count_test(delay_dictionary(5e6), rng, runs=6000)
    assert test.threshold(np.array([0.5, 0.1, 0.01])) == pytest.approx([5.4, 9.6, 14.6], rel=0.06)
    p_value = test.p_value(draw_null_statistics(rng, 6000, 5e6, cn0_dbhz=42.0))
    for asked in (0.5, 0.1, 0.02):
        alarms = int(np.sum(p_value < asked))
        sigma = np.sqrt(6000 * asked * (1 - asked) * 2)  # the law is counted as coarsely
        assert abs(alarms - 6000 * asked) < 3.5 * sigma + 0.05 * 6000 * asked


@pytest.mark.long
def test_two_signals_are_counted():
    rng = np.random.default_rng(14)
    delays = delay_dictionary(25e6)
    test = count_test(delays, rng, runs=1500)
    variance, taps = draw_two_signals(rng, 100, 0.1, 25e6)
    assert np.mean(test.p_value(count_statistic(taps, delays, variance)[0]) < 1e-3) > 0.97


def test_an_estimated_noise_level_makes_the_test_more_careful():
    test = count_test(delay_dictionary(5e6), np.random.default_rng(15), runs=3000)
    rough = type(test)(statistics=test.statistics, tail=test.tail, noise_samples=30)
    assert rough.threshold(0.01) > test.threshold(0.01) + 0.3
    assert rough.p_value(test.threshold(0.001)) > 1.3e-3


@pytest.mark.long
@pytest.mark.parametrize(("rate_hz", "quantiles"), [(5e6, (5.4, 9.6, 14.6, 19.5)), (25e6, (6.6, 10.9, 16.2, 21.4))])
def test_p_values_of_the_count_are_uniform(rate_hz, quantiles):
    rng = np.random.default_rng(16)
    test = count_test(delay_dictionary(rate_hz), rng, runs=30_000)
    assert test.threshold(np.array([0.5, 0.1, 0.01, 0.001])) == pytest.approx(quantiles, rel=0.06)
    p_value = test.p_value(draw_null_statistics(rng, 30_000, rate_hz))
    assert stats.kstest(p_value, "uniform").statistic < 0.015
    for asked in (0.01, 0.001):
        assert np.mean(p_value < asked) == pytest.approx(asked, rel=0.2 + 3.0 / np.sqrt(30_000 * asked))
