"""Allan deviation: closed forms, its law under known noises, and the coverage of its limits."""

import numpy as np
import pytest
from scipy import stats

from skyproof.statistics.allan import allan_deviation, allan_freedom
from skyproof.statistics.gauss_markov import gauss_markov_allan_variance, gauss_markov_path, gauss_markov_step


def test_a_steady_frequency_has_none_an_ageing_one_its_form():
    t_s = 0.5 * np.arange(200)
    steady = allan_deviation(3.0 + 2e-6 * t_s, 0.5, [1, 10, 90])
    np.testing.assert_allclose(steady.deviation, 0.0, atol=1e-14)
    ageing = allan_deviation(0.5e-3 * t_s**2, 0.5, [1, 10, 90])  # drift 1e-3 a second
    np.testing.assert_allclose(ageing.deviation, 1e-3 * ageing.tau_s / np.sqrt(2.0), rtol=1e-12)


def test_it_averages_squared_differences_over_every_start():
    phase = np.random.default_rng(1).standard_normal(40).cumsum()
    m, interval_s = 7, 0.25
    means = np.array([(phase[k + m] - phase[k]) / (m * interval_s) for k in range(40 - m)])
    squares = [(means[k + m] - means[k]) ** 2 for k in range(len(means) - m)]
    got = allan_deviation(phase, interval_s, [m])
    assert got.deviation[0] == pytest.approx(np.sqrt(0.5 * np.mean(squares)), rel=1e-12)
    assert got.tau_s[0] == 1.75


def test_leading_axes_are_free():
    phase = np.random.default_rng(2).standard_normal((3, 2, 100)).cumsum(axis=-1)
    together = allan_deviation(phase, 1.0, [1, 4, 20])
    assert together.deviation.shape == together.lower.shape == (3, 2, 3)
    alone = allan_deviation(phase[2, 1], 1.0, [1, 4, 20])
    np.testing.assert_array_equal(together.deviation[2, 1], alone.deviation)
    np.testing.assert_array_equal(together.upper[2, 1], alone.upper)


@pytest.mark.parametrize("factors", [[], [0], [50], [1, 60]])
def test_a_factor_that_does_not_fit_is_refused(factors):
    with pytest.raises(ValueError, match=r"\b1 to 49\b.*\b100 phases"):
        allan_deviation(np.zeros(100), 1.0, factors)


@pytest.mark.parametrize("noise", ["white phase", "white", "random walk"])
@pytest.mark.parametrize("m", [1, 8, 40])
def test_limits_hold_the_truth_as_often_as_they_say(noise, m):
    rng, n, runs = np.random.default_rng(3), 256, 3000
    steps = rng.standard_normal((runs, n))
    phase = {"white phase": steps, "white": steps.cumsum(axis=1), "random walk": steps.cumsum(axis=1).cumsum(axis=1)}
    # E of the squared second difference of the phase at lag m, over 2 m^2
    truth = {"white phase": 3.0 / m**2, "white": 1.0 / m, "random walk": (2.0 * m**2 + 1.0) / (6.0 * m) * 2.0}[noise]
    truth *= 0.5 if noise == "random walk" else 1.0
    got = allan_deviation(phase[noise], 1.0, [m], noise=noise, confidence=0.8)
    mean = np.mean(got.deviation**2)
    assert abs(mean / truth - 1.0) < 4.5 * np.std(got.deviation**2) / truth / np.sqrt(runs)
    for outside in (got.lower[:, 0] > np.sqrt(truth), got.upper[:, 0] < np.sqrt(truth)):
        assert outside.mean() == pytest.approx(0.1, abs=0.035)  # the freedom is good to some per cent, as printed


def test_flicker_freedom_lies_between_white_and_random_walk():
    for m in (4, 16, 64):
        white, flicker, walk = (allan_freedom(1024, m, kind) for kind in ("white", "flicker", "random walk"))
        assert walk < flicker < white


@pytest.mark.parametrize("interval_s", [0.01, 3.0, 400.0])
def test_a_gauss_markov_step_has_the_exact_joint_law(interval_s):
    sigma, correlation_s = 2.0, 50.0
    step = gauss_markov_step(sigma, correlation_s, interval_s)
    decay = np.exp(-interval_s / correlation_s)
    assert step.keep == pytest.approx(decay)
    assert step.keep**2 * sigma**2 + step.drive**2 == pytest.approx(sigma**2)
    whole = 2.0 * (sigma * correlation_s) ** 2 * (interval_s / correlation_s - 1.0 + decay)
    ends = 2.0 * sigma**2 * (1.0 + decay)
    assert step.half**2 * ends + step.spread**2 == pytest.approx(whole, rel=1e-6)
    with_start = sigma**2 * correlation_s * (1.0 - decay)
    assert step.half * sigma**2 * (1.0 + decay) == pytest.approx(with_start)


def test_gauss_markov_spread_meets_its_series_without_a_step():
    below, above = (gauss_markov_step(1.0, 1.0, 1e-3 * (1.0 + side)).spread for side in (-1e-6, 1e-6))
    assert above / below == pytest.approx(1.0 + 3e-6, abs=2e-6)


def test_gauss_markov_path_is_the_recursion_and_can_be_cut():
    step = gauss_markov_step(np.array([1.0, 3.0]), np.array([10.0, 5.0]), 1.0)
    normals, start = np.random.default_rng(4).standard_normal((50, 2)), np.array([0.5, -1.0])
    whole = gauss_markov_path(step, start, normals)
    value = start
    for k in range(50):
        value = step.keep * value + step.drive * normals[k]
        np.testing.assert_allclose(whole[k + 1], value, rtol=1e-12)
    first = gauss_markov_path(step, start, normals[:20])
    np.testing.assert_array_equal(np.concatenate([first, gauss_markov_path(step, first[-1], normals[20:])[1:]]), whole)


def test_gauss_markov_allan_follows_from_the_autocovariance():
    sigma, correlation_s = 1.5, 20.0
    for tau_s in (1e-4, 0.1, 5.0, 37.8, 1000.0):
        n = 400
        middles = (np.arange(2 * n) + 0.5) * tau_s / n
        signs = np.repeat([-1.0, 1.0], n) / n
        covariance = sigma**2 * np.exp(-np.abs(np.subtract.outer(middles, middles)) / correlation_s)
        want = 0.5 * signs @ covariance @ signs
        assert gauss_markov_allan_variance(sigma, correlation_s, tau_s) == pytest.approx(want, rel=2e-3)
    tau_s = np.linspace(20.0, 60.0, 4001)
    variance = gauss_markov_allan_variance(1.0, 20.0, tau_s)
    assert tau_s[variance.argmax()] / 20.0 == pytest.approx(1.89, abs=0.01)
    assert np.sqrt(variance.max()) == pytest.approx(0.617, abs=0.001)


def test_a_gauss_markov_process_has_its_allan_variance():
    rng = np.random.default_rng(5)
    step = gauss_markov_step(np.ones(200), np.full(200, 30.0), 10.0)
    path = gauss_markov_path(step, rng.standard_normal(200), rng.standard_normal((2000, 200)))
    means = (path[1:] + path[:-1]) * step.half / 10.0 + step.spread / 10.0 * rng.standard_normal((2000, 200))
    phase = 10.0 * np.concatenate([np.zeros((1, 200)), means.cumsum(axis=0)])
    got = allan_deviation(phase.T, 10.0, [1, 6, 30])
    want = gauss_markov_allan_variance(1.0, 30.0, got.tau_s)
    z = (np.mean(got.deviation**2, axis=0) - want) / (np.std(got.deviation**2, axis=0) / np.sqrt(200))
    assert stats.chi2.sf(np.sum(z**2), 3) > 1e-3
    np.testing.assert_allclose(np.mean(got.deviation**2, axis=0), want, rtol=0.03)
