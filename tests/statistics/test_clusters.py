from itertools import product

import numpy as np
import pytest

from skyproof.statistics.clusters import divide_line
from skyproof.statistics.distributions import chi_square_survival


def count_clusters(values, sigma, probability):
    """Count the fewest clusters over every labelling of K values."""
    k = len(values)
    weight = np.broadcast_to(1.0 / np.asarray(sigma) ** 2, k)
    best = np.full(k + 1, np.inf)
    for labels in product(range(k), repeat=k):
        groups = [np.flatnonzero(np.array(labels) == c) for c in set(labels)]
        squares = sum(np.sum(weight[g] * (values[g] - np.average(values[g], weights=weight[g])) ** 2) for g in groups)
        best[len(groups)] = min(best[len(groups)], squares)
    for count in range(1, k):
        if chi_square_survival(best[count], k - count) >= probability:
            return count, best[count]
    return k, 0.0


@pytest.mark.parametrize("seed", range(4))
def test_no_other_parting_is_better(seed):
    rng = np.random.default_rng(seed)
    values, sigma = 4.0 * rng.standard_normal(5), rng.uniform(0.5, 2.0, 5)
    count, squares = count_clusters(values, sigma, 0.05)
    found = divide_line(values, sigma, 0.05)
    assert found.number == count
    assert len(set(found.label.tolist())) == count
    if count < 5:
        assert found.p_value == pytest.approx(float(chi_square_survival(squares, 5 - count)))


@pytest.mark.parametrize("centres", [(0.0,), (0.0, 30.0), (0.0, 3.0, 40.0)])
def test_excess_clusters_come_no_more_often_than_stated(centres):
    rng = np.random.default_rng(1)
    values = np.resize(centres, 9) + rng.standard_normal((20_000, 9))
    found = divide_line(values, 1.0, 0.01)
    assert np.mean(found.number > len(centres)) < 0.0125
    if len(centres) == 1:  # then the parting is the true one, and the test exact
        assert np.mean(found.number > 1) == pytest.approx(0.01, rel=0.25)


def test_clusters_far_apart_are_found_in_any_order_of_the_values():
    rng = np.random.default_rng(2)
    truth = rng.permuted(np.tile(np.repeat([0, 1], [4, 3]), (500, 1)), axis=1)
    found = divide_line(20.0 * truth + rng.standard_normal((500, 7)) + 1e6, 1.0, 1e-6)
    assert np.all(found.number == 2)
    np.testing.assert_array_equal(found.label, truth)


def test_leading_axes_give_what_single_calls_give():
    values = 3.0 * np.random.default_rng(3).standard_normal((2, 3, 6))
    found = divide_line(values, 1.0, 0.01)
    for index in np.ndindex(2, 3):
        single = divide_line(values[index], 1.0, 0.01)
        assert single.number == found.number[index]
        np.testing.assert_array_equal(single.label, found.label[index])
