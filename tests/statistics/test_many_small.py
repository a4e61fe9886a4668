"""Berk and Jones's test: its law, and what it sees."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.statistics.distributions import binomial_survival, binomial_two_sided
from skyproof.statistics.many_small import many_small, many_small_chance


@pytest.mark.parametrize(("least", "most"), [(1, 1.0), (2, 1.0), (2, 0.05)])
def test_p_values_come_as_often_as_they_say(least, most):
    drawn = np.random.default_rng(4).random((1500, 8))
    p = np.array([many_small(p_values, least=least, most=most).p_value for p_values in drawn])
    for level in (0.03, 0.01):
        assert binomial_two_sided(int((p <= level).sum()), p.size, level) > 1e-3


@given(chance=st.floats(1e-12, 0.5), n=st.integers(1, 30))
def test_the_law_lies_between_one_count_and_the_union_bound(chance, n):
    p_value = many_small_chance(chance, n)
    assert chance * (1.0 - 1e-9) <= p_value <= min(1.0, n * chance) * (1.0 + 1e-9)


def test_of_one_value_it_is_that_value():
    assert many_small([0.03]).p_value == pytest.approx(0.03)
    assert many_small([]).p_value == 1.0


def test_it_says_how_many_are_small():
    test = many_small([1e-3, 0.4, 2e-3, 1e-3, 0.9, 0.7])
    assert test.how_many == 3
    assert test.chance == pytest.approx(float(binomial_survival(3, 6, 2e-3)))


def test_too_few_and_large_ones_are_no_alarm():
    assert many_small([1e-9, 0.9, 0.9], least=2).p_value > 0.5
    assert many_small([1e-9, 0.06, 0.06], least=2, most=0.05).p_value == 1.0
