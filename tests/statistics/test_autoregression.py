import numpy as np
import pytest

from skyproof.statistics.autoregression import (
    ar1_fit,
    ar1_line,
    ar1_whiten,
    correlation_grid,
    estimate_ar1,
    lag_one_expectation,
)
from skyproof.statistics.distributions import binomial_two_sided
from skyproof.statistics.lines import fit_line


def draw_ar1(rng, shape, phi):
    """Draw a stationary process of variance 1, along the second last axis."""
    noise = rng.standard_normal(shape)
    for n in range(1, shape[-2]):
        noise[..., n, :] = phi * noise[..., n - 1, :] + np.sqrt(1 - phi**2) * noise[..., n, :]
    return noise


@pytest.mark.parametrize("gaps", [None, np.array([1.0, 3.0, 1.0, 2.5])])
def test_whitening_turns_the_covariance_into_the_identity(gaps):
    times = np.arange(5.0) if gaps is None else np.concatenate([[0.0], np.cumsum(gaps)])
    covariance = 0.8 ** np.abs(np.subtract.outer(times, times))
    w = ar1_whiten(np.eye(5), 0.8, gaps)
    np.testing.assert_allclose(w @ covariance @ w.T, np.eye(5), atol=1e-12)


def test_a_grid_of_coefficients_goes_along_a_leading_axis():
    values = np.random.default_rng(0).standard_normal((3, 7, 2))
    phi = np.array([0.0, 0.5, 0.9])
    together = ar1_line(values, phi[:, None])
    for k, coefficient in enumerate(phi):
        alone = ar1_line(values, coefficient)
        np.testing.assert_allclose(together.level[k], alone.level)
        np.testing.assert_allclose(together.rss[k], alone.rss)
        np.testing.assert_allclose(together.support[k], alone.support)


def test_without_correlation_the_fit_is_the_plain_line():
    values = np.random.default_rng(0).standard_normal((7, 2))
    plain, fit = fit_line(values), ar1_fit(values, 0.0)
    np.testing.assert_allclose(fit.level, plain.level)
    np.testing.assert_allclose(np.abs(fit.slope), np.abs(plain.slope))
    np.testing.assert_allclose(fit.residual, plain.residual, atol=1e-12)
    assert fit.gain == pytest.approx(np.sqrt(7))


def test_a_level_comes_back_with_the_variance_stated():
    rng = np.random.default_rng(1)
    gaps = np.array([1.0, 1.0, 4.0, 1.0, 1.0, 2.0, 1.0])
    times = np.concatenate([[0.0], np.cumsum(gaps)]).astype(int)
    noise = draw_ar1(rng, (20_000, 13, 1), 0.7)[:, times]
    fit = ar1_line(noise + 5.0, 0.7, gaps)
    level = fit.level[:, 0] / fit.gain
    assert level.mean() == pytest.approx(5.0, abs=0.03)
    assert level.std() * fit.gain == pytest.approx(1.0, abs=0.02)
    assert np.mean(fit.rss) == pytest.approx(6.0, abs=0.1)  # N - 2 degrees


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("n", [15, 60])
def test_the_pooled_estimate_is_free_of_the_bias_of_the_line_fit(n, phi):
    rng = np.random.default_rng(2)
    residual = fit_line(draw_ar1(rng, (400, n, 28), phi)).residual
    found = estimate_ar1(residual)
    raw = np.sum(residual[:, 1:] * residual[:, :-1], axis=(1, 2)) / np.sum(residual**2, axis=(1, 2))
    assert np.median(found) == pytest.approx(phi, abs=0.02)
    assert np.median(raw) < phi - 0.02  # what the correction is for


def test_the_expected_lag_one_coefficient_grows_with_phi():
    grid, expectation = lag_one_expectation(12)
    assert np.all(np.diff(grid) > 0)
    assert np.all(np.diff(expectation) > 0)


@pytest.mark.parametrize("phi", [0.0, 0.9])
@pytest.mark.parametrize(("n", "m", "slack"), [(5, 6, 1.6), (15, 4, 1.0), (30, 6, 1.0)])
def test_the_true_coefficient_leaves_its_set_at_the_rate(n, m, slack, phi):
    trials, rate = 40_000, 0.01
    support = ar1_line(draw_ar1(np.random.default_rng(3), (trials, n, m), phi), phi).support
    missed = int(np.sum(support < rate))
    if slack == 1.0:
        assert binomial_two_sided(missed, trials, rate) > 1e-4
    else:  # few degrees of freedom: the Beta law is matched in two moments only
        assert rate / slack < missed / trials < rate * slack


def test_white_noise_rules_out_large_coefficients_in_30_s():
    values = np.random.default_rng(4).standard_normal((200, 30, 6))
    grid = correlation_grid(0.98)
    largest = [grid[s >= 1e-4].max() for s in ar1_line(values, grid[:, None]).support.T]
    assert np.median(largest) < 0.45


def test_the_grid_is_white_alone_if_nothing_else_may_be():
    assert correlation_grid(0.0).tolist() == [0.0]
    assert correlation_grid(0.9)[[0, -1]] == pytest.approx([0.0, 0.9])
