import numpy as np
import pytest
from scipy import special

from skyproof.statistics.distributions import binomial_survival
from skyproof.studies.roc import area_under, chi_square_power, count_interval, count_roc


def test_counted_roc_of_two_normals_is_the_formula():
    rng = np.random.default_rng(1)
    null, moved = rng.standard_normal(200_000), 1.5 + rng.standard_normal(200_000)
    rates = np.array([0.5, 0.1, 0.01])
    roc = count_roc(null, moved, rates)
    np.testing.assert_allclose(roc.false_alarm, rates, atol=1e-5)
    np.testing.assert_allclose(roc.detection, special.ndtr(1.5 + special.ndtri(rates)), atol=0.01)
    assert area_under(null, moved) == pytest.approx(special.ndtr(1.5 / np.sqrt(2.0)), abs=0.003)


def test_thresholds_never_let_through_more_than_asked():
    null = np.array([1.0, 2.0, 2.0, 2.0, 5.0])
    assert np.all(count_roc(null, null, [0.2, 0.4, 0.6, 0.8]).false_alarm <= [0.2, 0.4, 0.6, 0.8])


def test_area_of_equal_draws_is_a_half():
    assert area_under([1.0, 1.0, 1.0], [1.0, 1.0]) == 0.5


def test_power_without_an_attack_is_the_false_alarm_probability():
    np.testing.assert_allclose(chi_square_power([0.1, 1e-3], 4, 0.0), [0.1, 1e-3], rtol=1e-9)
    # noncentrality of 90 % power at 1e-3 with 4 degrees of freedom
    assert chi_square_power(1e-3, 4, 27.683) == pytest.approx(0.9, abs=1e-4)


def test_interval_leaves_its_tails_outside():
    low, high = count_interval(7, 50)
    assert binomial_survival(7, 50, low) == pytest.approx(0.025)
    assert 1.0 - binomial_survival(8, 50, high) == pytest.approx(0.025)
    assert count_interval(0, 10)[0] == 0.0
    assert count_interval(10, 10)[1] == 1.0
