"""Kalman's update beside solutions that do not use it."""

import numpy as np
import pytest
from scipy import stats

from skyproof.statistics.kalman import kalman_update


def draw_problem(rng, n=5, m=3):
    """Draw a covariance (n, n), sensitivity (m, n), noise (m, m) and innovation (m,)."""
    root, half = rng.standard_normal((n, n)), rng.standard_normal((m, m))
    return root @ root.T, rng.standard_normal((m, n)), half @ half.T + 0.1 * np.eye(m), rng.standard_normal(m)


def test_it_is_weighted_least_squares_of_state_and_measurements():
    # The state before is one more measurement: normal equations in information form.
    p, h, r, y = draw_problem(np.random.default_rng(1))
    information = np.linalg.inv(p) + h.T @ np.linalg.inv(r) @ h
    update = kalman_update(p, h, r, y)
    np.testing.assert_allclose(update.covariance, np.linalg.inv(information), rtol=1e-9)
    np.testing.assert_allclose(update.change, np.linalg.solve(information, h.T @ np.linalg.solve(r, y)), rtol=1e-9)


def test_two_updates_are_the_update_by_both_measurements():
    p, h, r, y = draw_problem(np.random.default_rng(2), m=4)
    r = np.diag(np.diag(r))
    joint = kalman_update(p, h, r, y)
    first = kalman_update(p, h[:2], r[:2, :2], y[:2])
    second = kalman_update(first.covariance, h[2:], r[2:, 2:], y[2:] - h[2:] @ first.change)
    np.testing.assert_allclose(first.change + second.change, joint.change, rtol=1e-9)
    np.testing.assert_allclose(second.covariance, joint.covariance, rtol=1e-9)
    assert first.statistic + second.statistic == pytest.approx(joint.statistic)


def test_the_statistic_is_chi_square_and_the_error_as_stated():
    rng = np.random.default_rng(3)
    p, h, r, _ = draw_problem(rng)
    state = rng.multivariate_normal(np.zeros(5), p, size=4000)
    y = state @ h.T + rng.multivariate_normal(np.zeros(3), r, size=4000)
    update = kalman_update(p, h, r, y)
    assert stats.kstest(update.statistic, stats.chi2(3).cdf).pvalue > 1e-3
    error = state - update.change
    squares = np.einsum("ki,ij,kj->k", error, np.linalg.inv(update.covariance), error)
    assert stats.kstest(squares, stats.chi2(5).cdf).pvalue > 1e-3


def test_leading_axes_are_problems_of_their_own():
    rng = np.random.default_rng(4)
    problems = [draw_problem(rng) for _ in range(3)]
    together = kalman_update(*(np.stack(part) for part in zip(*problems, strict=True)))
    for k, case in enumerate(problems):
        for alone, of_all in zip(kalman_update(*case), together, strict=True):
            np.testing.assert_allclose(of_all[k], alone, rtol=1e-9)


def test_a_gain_of_other_assumptions_has_its_true_covariance():
    # Counted: errors of a gain that was computed from the wrong covariances.
    rng = np.random.default_rng(6)
    p, h, r, _ = draw_problem(rng)
    state = rng.multivariate_normal(np.zeros(5), p, size=20_000)
    y = state @ h.T + rng.multivariate_normal(np.zeros(3), r, size=20_000)
    update = kalman_update(p, h, r, y, assumed_covariance=4.0 * p, assumed_noise=9.0 * np.diag(r))
    error = state - update.change
    squares = np.einsum("ki,ij,kj->k", error, np.linalg.inv(update.covariance), error)
    assert squares.mean() == pytest.approx(5.0, abs=5.0 * np.sqrt(10.0 / 20_000))
    assert np.all(np.linalg.eigvalsh(update.covariance - kalman_update(p, h, r, y[0]).covariance) > -1e-9)


def test_a_measurement_without_noise_leaves_no_negative_variance():
    p, h, _, y = draw_problem(np.random.default_rng(7))
    sure = kalman_update(1e12 * p, h, 1e-9 * np.eye(3), y)
    assert np.linalg.eigvalsh(sure.covariance).min() >= -1e-3
    np.testing.assert_allclose(h @ sure.change, y, atol=1e-6)


def test_no_measurements_change_nothing():
    p, h, r, y = draw_problem(np.random.default_rng(8))
    update = kalman_update(p, h[:0], r[:0, :0], y[:0])
    np.testing.assert_array_equal(update.covariance, p)
    assert not update.change.any()
    assert update.statistic == 0.0
