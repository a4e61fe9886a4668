import numpy as np
import pytest

from skyproof.statistics.lines import additive_contrasts, fit_line, line_columns
from skyproof.studies.double_difference import difference_whitener


@pytest.mark.parametrize("n", [1, 2, 4])
def test_the_whitener_turns_differences_to_the_identity(n):
    covariance = np.eye(n) + np.ones((n, n))
    w = difference_whitener(n)
    np.testing.assert_allclose(w @ covariance @ w, np.eye(n), atol=1e-12)


def test_a_line_leaves_no_residual_and_noise_keeps_its_square():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.5, 2.0, 9))
    line = fit_line(3.0 + 2.0 * times[:, None] * np.ones((9, 2)), times)
    assert np.abs(line.residual).max() < 1e-12
    assert line.level / 3.0 == pytest.approx((3.0 + 2.0 * times).mean() * np.ones(2))
    noise = rng.standard_normal((5, 9, 2))
    fit = fit_line(noise, times)
    total = fit.level**2 + fit.slope**2 + np.sum(fit.residual**2, axis=-2)
    np.testing.assert_allclose(total, np.sum(noise**2, axis=-2))
    np.testing.assert_allclose(line_columns(9, times).T @ line_columns(9, times), np.eye(2), atol=1e-12)


def test_contrasts_ignore_rows_and_columns_and_whiten_noise():
    rng = np.random.default_rng(1)
    sigma = rng.uniform(0.3, 4.0, (6, 5, 3))  # six tables of 5 x 3
    contrasts, gain = additive_contrasts(sigma)
    assert contrasts.shape == (6, 15, 8)
    additive = rng.standard_normal((5, 1)) + rng.standard_normal(3)
    np.testing.assert_allclose(additive.ravel() @ contrasts, 0.0, atol=1e-10)
    variance = sigma.reshape(6, 15) ** 2
    covariance = np.einsum("bij,bi,bik->bjk", contrasts, variance, contrasts)
    np.testing.assert_allclose(covariance, np.broadcast_to(np.eye(8), (6, 8, 8)), atol=1e-10)
    constant = np.einsum("bij,bik->bjk", contrasts, contrasts)
    np.testing.assert_allclose(constant, gain[..., None] * np.eye(8), atol=1e-10)


def test_group_contrasts_ignore_what_a_column_adds():
    rng = np.random.default_rng(5)
    sigma, groups = rng.uniform(0.5, 2.0, (9, 3)), np.array([0, 0, 0, 1, 1, 1, 1, 2, 2])
    contrasts, _ = additive_contrasts(sigma, groups)
    assert contrasts.shape == (27, (9 - 3) * 2)
    effects = rng.standard_normal((3, 3)) * 50.0
    table = rng.standard_normal((9, 1)) * 100.0 + effects[groups]
    np.testing.assert_allclose(table.ravel() @ contrasts, 0.0, atol=1e-10)
    np.testing.assert_allclose(contrasts.T @ np.diag(sigma.ravel() ** 2) @ contrasts, np.eye(12), atol=1e-12)
    np.testing.assert_allclose(additive_contrasts(sigma, np.zeros(9, int))[0], additive_contrasts(sigma)[0])
