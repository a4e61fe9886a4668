import numpy as np
import pytest

from skyproof.statistics.distributions import binomial_two_sided
from skyproof.studies.linear_tests import linear_model, linear_noncentrality, linear_power, linear_test

N = 12
T = np.linspace(-1.0, 1.0, N)
A = np.column_stack([T, T**2])
B = np.ones((N, 1))
COVARIANCE = 0.8 ** np.abs(np.subtract.outer(np.arange(N), np.arange(N)))


@pytest.mark.parametrize("sigma", [None, 2.0])
@pytest.mark.parametrize("covariance", [None, COVARIANCE])
def test_false_alarms_come_as_stated_whatever_is_free(sigma, covariance):
    rng, trials = np.random.default_rng(1), 100_000
    root = np.eye(N) if covariance is None else np.linalg.cholesky(covariance)
    values = 2.0 * rng.standard_normal((trials, N)) @ root.T + 100.0 * rng.standard_normal((trials, 1))
    test = linear_test(values, linear_model(A, B, covariance), sigma)
    assert (test.dof_num, test.dof_den) == (2, np.inf if sigma else N - 3)
    for level in (0.5, 0.01, 0.001):
        assert binomial_two_sided(int(np.sum(test.p_value < level)), trials, level) > 1e-4


@pytest.mark.parametrize("sigma", [None, 1.0])
def test_the_power_is_what_is_counted(sigma):
    rng = np.random.default_rng(2)
    model, mean = linear_model(A, B), A @ np.array([1.0, 1.5])
    test = linear_test(mean + rng.standard_normal((50_000, N)), model, sigma)
    power = float(linear_power(0.01, linear_noncentrality(mean, model, 1.0), test.dof_num, test.dof_den))
    assert 0.1 < power < 0.9
    assert np.mean(test.p_value < 0.01) == pytest.approx(power, abs=0.01)


def test_the_statistic_is_twice_the_log_likelihood_ratio():
    values = np.random.default_rng(3).standard_normal(N)

    def squares(columns):
        return np.sum((values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]) ** 2)

    test = linear_test(values, linear_model(A, B), 1.0)
    assert 2 * test.statistic == pytest.approx(squares(B) - squares(np.column_stack([A, B])))


def test_columns_that_depend_on_each_other_are_refused():
    with pytest.raises(ValueError, match="each other"):
        linear_model(np.column_stack([T, 2.0 * T]), B)
    with pytest.raises(ValueError, match="each other"):
        linear_model(B, np.column_stack([B, T]))
