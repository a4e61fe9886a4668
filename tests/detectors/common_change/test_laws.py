"""What satellites do alike by chance comes as often as stated, neither more nor less."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.detectors.common_change.laws import alike_p_value, fit_rates, turn_p_value, turn_sigma_m
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.statistics.distributions import binomial_two_sided


def assert_uniform(p_values, levels=(0.1, 0.01)):
    return all(binomial_two_sided(int((p_values <= p).sum()), p_values.size, p) > 1e-4 for p in levels)


@pytest.mark.parametrize("n", [5, 8, 11])
def test_rates_of_satellites_agree_by_chance_as_often_as_stated(n):
    rng = np.random.default_rng(n)
    sigma = rng.uniform(0.5, 3.0, n)
    drawn = sigma * rng.standard_normal((20_000, n))
    assert assert_uniform(alike_p_value(drawn, sigma), (0.03, 0.01, 0.001))
    # Errors that are smaller than stated make fewer, whatever the number of satellites.
    many = alike_p_value(0.1 * rng.standard_normal((20_000, 8 * n)), np.ones(8 * n))
    assert all((many <= level).mean() <= 1.2 * level for level in (0.1, 0.01))
    # What all may do together is no evidence.
    common = alike_p_value(drawn + 0.3, sigma, 0.3)
    assert all((common <= level).mean() <= 1.2 * level for level in (0.1, 0.01))
    assert np.mean(alike_p_value(drawn + 5.0, sigma, 0.3) < 0.01) > 0.5


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), n=st.integers(8, 16), side=st.sampled_from([-1.0, 1.0]))
def test_three_of_four_satellites_are_enough_a_quarter_is_not(seed, n, side):
    rng = np.random.default_rng(seed)
    values, few = rng.standard_normal(n), n // 4
    most, some = values.copy(), values.copy()
    most[few:] = side * 9.0
    some[:few] = side * 1e6
    assert alike_p_value(most, np.ones(n)) < 1e-12
    assert alike_p_value(some, np.ones(n)) > 1e-3
    assert alike_p_value(-most, np.ones(n)) == pytest.approx(alike_p_value(most, np.ones(n)))
    assert alike_p_value(values[:4] + 100.0, np.ones(4)) == 1.0
    assert alike_p_value(values - np.median(values), np.ones(n)) == 1.0


def test_a_rate_has_white_sigma_and_a_multipath_bound():
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 10.0, 0.2)
    white = fit_rates(t, 1.5 * rng.standard_normal((t.size, 2000)), np.full((t.size, 2000), 1.5), 0.0)
    assert np.std([rate.rate_m_s for rate in white]) == pytest.approx(white[0].sigma_m_s, rel=0.07)
    assert fit_rates(t, 1e7 + 0.7 * t[:, None], np.ones((t.size, 1)), 0.0)[0].rate_m_s == pytest.approx(0.7)
    for correlation_s in (1.0, 10.0, 100.0):
        root = np.linalg.cholesky(np.exp(-np.abs(t[:, None] - t) / correlation_s))
        slow = fit_rates(t, root @ rng.standard_normal((t.size, 500)), np.zeros((t.size, 500)), 1.0)
        assert np.std([rate.rate_m_s for rate in slow]) < slow[0].sigma_m_s
    assert slow[0].sigma_m_s == pytest.approx(3.0 / 10.0, rel=0.01)


@pytest.mark.parametrize("name", ["csac", "rubidium"])
def test_a_clock_turns_by_its_allan_deviation(name):
    # Of white frequency noise, with phases measured to a millimetre.
    rng, apart_s = np.random.default_rng(4), 10.0
    oscillator = OSCILLATORS[name]
    white = type(oscillator)(white_s=oscillator.white_s)
    steps_s = np.sqrt(0.5 * white.white_s * apart_s) * rng.standard_normal((4000, 2))
    turn_m = SPEED_OF_LIGHT_M_S * (steps_s[:, 1] - steps_s[:, 0]) + 1e-3 * rng.standard_normal(4000)
    assert assert_uniform(turn_p_value(turn_m, 1e-6, turn_sigma_m(white, apart_s)))
