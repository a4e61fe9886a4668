import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.correlators.correlator_laws import triangle
from skyproof.statistics.distributions import binomial_survival, binomial_two_sided
from skyproof.studies import quality_metrics as sqm
from skyproof.studies.discriminator_laws import prompt_amplitude


def draw_taps(rng, trials, amplitude, spacing):
    """Draw early, prompt, late of a signal in lock, noise with the covariance of the taps."""
    delays = np.array([-spacing, 0.0, spacing])
    root = np.linalg.cholesky(sqm.tap_covariance(delays) + 1e-12 * np.eye(3))
    noise = rng.standard_normal((trials, 3)) @ root.T + 1j * rng.standard_normal((trials, 3)) @ root.T
    return tuple((noise + amplitude * triangle(delays)).T)


def overlap(spacing, share, delay, phase):
    """Add a second signal to the tracked one: in-phase and quadrature taps without noise."""
    offsets = np.array([-spacing, 0.0, spacing])
    return tuple(triangle(offsets) + share * np.exp(1j * phase) * triangle(offsets - delay))


@pytest.mark.parametrize(
    ("cn0_dbhz", "sums", "spacing", "ratio", "delta"),
    [
        (40, 10, 0.5, 0.0354, 0.0500),
        (40, 10, 0.1, 0.0212, 0.0224),
        (45, 1, 0.5, 0.0629, 0.0889),
        (35, 20, 0.05, 0.0194, 0.0199),
    ],
)
def test_standard_deviations_to_first_order(cn0_dbhz, sums, spacing, ratio, delta):
    amplitude = prompt_amplitude(cn0_dbhz, sums)
    assert np.sqrt(sqm.ratio_law(spacing).variance(amplitude)) == pytest.approx(ratio, abs=6e-5)
    assert np.sqrt(sqm.delta_law(spacing).variance(amplitude)) == pytest.approx(delta, abs=6e-5)


def test_a_wide_pair_has_the_wide_law():
    assert sqm.delta_law(0.8).variance(1.0) == pytest.approx(0.5)
    assert sqm.ratio_law(0.8).variance(1.0) == pytest.approx(0.5 - 0.2**2)


@pytest.mark.parametrize("spacing", [0.1, 0.5])
@pytest.mark.parametrize("amplitude", [4.472, 14.14])
def test_p_values_of_delta_and_ratio_are_uniform(amplitude, spacing):
    taps = draw_taps(np.random.default_rng(1), 100_000, amplitude, spacing)
    for metric, law in ((sqm.delta_metric, sqm.delta_law), (sqm.ratio_metric, sqm.ratio_law)):
        p_value = sqm.ratio_p_value(metric(*taps), law(spacing), amplitude)
        assert stats.kstest(p_value, "uniform").pvalue > 1e-4
        assert binomial_two_sided(int(np.sum(p_value < 1e-3)), 100_000, 1e-3) > 1e-3


@pytest.mark.parametrize("amplitude", [3.0, 14.14])
def test_deviates_are_normal_whatever_the_amplitude(amplitude):
    early, prompt, late = draw_taps(np.random.default_rng(7), 100_000, amplitude, 0.5)
    for metric, law in ((sqm.delta_metric, sqm.delta_law(0.5)), (sqm.ratio_metric, sqm.ratio_law(0.5))):
        value = metric(early, prompt, late)
        deviate = sqm.ratio_deviate(value, prompt, law)
        assert stats.kstest(deviate, "norm").pvalue > 1e-4
        plain = (value - law.mean) / np.sqrt(law.variance(amplitude))
        for limit in (2.6, 3.3):
            rate = 2.0 * stats.norm.sf(limit)
            assert binomial_two_sided(int(np.sum(np.abs(deviate) > limit)), 100_000, rate) > 1e-3
            assert amplitude > 5.0 or np.sum(np.abs(plain) > limit) > 2.0 * rate * 100_000


def test_loop_jitter_rounds_the_prompt_as_the_law_allows():
    rng, tracks, looks, amplitude, hz, coherent_s = np.random.default_rng(8), 3000, 50, 35.0, 1.0, 0.02
    delays = np.array([0.5, 0.125, 0.0, -0.125, -0.5])
    root = np.linalg.cholesky(sqm.tap_covariance(delays))
    code, total = np.zeros(tracks), np.zeros((tracks, 5))
    jitter = sqm.code_jitter_chips(hz, 0.125, amplitude, coherent_s)
    for look in range(-20, looks):
        taps = amplitude * triangle(code[:, None] + delays) + rng.standard_normal((tracks, 5)) @ root.T
        total += taps if look >= 0 else 0.0
        if look == 0:
            assert np.std(code) == pytest.approx(jitter, rel=0.1)
        code = code + 4.0 * hz * coherent_s * sqm.delta_metric(taps[:, 1], taps[:, 2], taps[:, 3])
    early, prompt, late = total[:, [0, 2, 4]].T / np.sqrt(looks)
    value = sqm.ratio_metric(early, prompt, late)
    none, lost = sqm.ratio_law(0.5), sqm.ratio_law(0.5, 2.0 * np.sqrt(2.0 / np.pi) * jitter)
    allowed, not_allowed = (
        int(np.sum(np.abs(sqm.ratio_deviate(value, prompt, none, up_to)) > 2.5758)) for up_to in (lost, None)
    )
    assert binomial_survival(allowed, tracks, 0.01) > 1e-3
    assert allowed > 0.3 * 0.01 * tracks
    assert binomial_survival(not_allowed, tracks, 0.01) < 1e-3


def test_tails_are_heavier_than_normal():
    law = sqm.delta_law(0.5)
    for amplitude, share in ((14.1421, 0.00334), (4.4721, 0.0127)):
        three_sigma = 3.0 * np.sqrt(law.variance(amplitude))
        assert sqm.ratio_p_value(three_sigma, law, amplitude) == pytest.approx(share, abs=3e-5)


@pytest.mark.parametrize("law", [sqm.delta_law(0.5), sqm.ratio_law(0.5), sqm.ratio_law(0.1)])
def test_thresholds_leave_half_of_the_probability_on_each_side(law):
    low, high = sqm.ratio_threshold(1e-3, law, np.array([5.0, 14.0]))
    np.testing.assert_allclose(sqm.ratio_cumulative(low, law, np.array([5.0, 14.0])), 5e-4, rtol=1e-9)
    np.testing.assert_allclose(1.0 - sqm.ratio_cumulative(high, law, np.array([5.0, 14.0])), 5e-4, rtol=1e-9)
    assert sqm.ratio_threshold(1e-3, law, 2.0) == (-np.inf, np.inf)


def test_magnitudes_spread_as_delta_does():
    amplitude = float(prompt_amplitude(40, 10))
    taps = draw_taps(np.random.default_rng(2), 100_000, amplitude, 0.5)
    assert np.std(sqm.magnitude_difference(*taps)) == pytest.approx(0.0499, abs=5e-4)


@pytest.mark.parametrize(
    ("offset_hz", "coherent_s", "sigma", "slope"),
    [(25.0, 0.01, 0.0301, -0.0077), (50.0, 0.01, 0.0500, -0.0127), (20.0, 0.02, 0.03095, -0.0224)],
)
def test_slow_and_fast_correlators(offset_hz, coherent_s, sigma, slope):
    amplitude = prompt_amplitude(40, coherent_s=coherent_s)
    law = sqm.doppler_law(offset_hz, coherent_s)
    assert np.sqrt(law.variance(amplitude)) == pytest.approx(sigma, abs=6e-5)
    assert sqm.doppler_slope(offset_hz, coherent_s) == pytest.approx(slope, abs=6e-5)
    # correlators of sampled noise and signal, the phase counted from the middle
    rng, n, trials = np.random.default_rng(3), 200, 20_000
    t_s = (np.arange(n) + 0.5) / n * coherent_s - 0.5 * coherent_s
    replicas = np.exp(-2j * np.pi * np.array([-offset_hz, 0.0, offset_hz])[:, None] * t_s)
    noise = (rng.standard_normal((trials, n)) + 1j * rng.standard_normal((trials, n))) / np.sqrt(n)
    slow, prompt, fast = ((noise + amplitude / n) @ replicas.T).T
    found = sqm.doppler_metric(slow, prompt, fast, magnitudes=False)
    assert stats.kstest(sqm.ratio_p_value(found, law, amplitude), "uniform").pvalue > 1e-4
    assert np.std(sqm.doppler_metric(slow, prompt, fast)) == pytest.approx(sigma, rel=0.03)
    moved = np.exp(2j * np.pi * 0.5 * t_s) @ replicas.T
    assert sqm.doppler_metric(*moved) == pytest.approx(0.5 * slope, rel=0.05)


# Static values of a second signal over the true one, by hand from the triangle.
@pytest.mark.parametrize(
    ("delay", "delta", "ratio"), [(0.3, -0.1765, 0.5882), (0.8, -0.2917, 0.7083), (1.4, -0.05, 0.55), (1.5, 0.0, 0.5)]
)
def test_an_overlapping_signal_distorts(delay, delta, ratio):
    taps = overlap(0.5, 1.0, delay, 0.0)
    assert sqm.delta_metric(*taps) == pytest.approx(delta, abs=6e-5)
    assert sqm.ratio_metric(*taps) == pytest.approx(ratio, abs=6e-5)


def test_a_signal_in_quadrature_shows_in_magnitudes_only():
    taps = overlap(0.5, 1.0, 0.5, np.pi / 2)
    assert sqm.delta_metric(*taps) == pytest.approx(0.0, abs=1e-12)
    assert sqm.ratio_metric(*taps) == pytest.approx(0.5, abs=1e-12)
    assert abs(sqm.magnitude_difference(*taps)) > 0.1


def test_moving_variance_is_chi_square():
    np.testing.assert_allclose(
        sqm.moving_variance_threshold(1e-3, 1.0, np.array([20, 50, 100])), [2.306, 1.742, 1.497], atol=6e-4
    )
    values = 0.3 * np.random.default_rng(4).standard_normal((20_000, 50))
    variance = sqm.moving_variance(values, 50)
    assert variance.shape == (20_000, 1)
    assert stats.kstest(sqm.moving_variance_p_value(variance, 0.3, 50).ravel(), "uniform").pvalue > 1e-4


def test_moving_variance_hardly_sees_slow_small_changes():
    windows = np.array([20, 50, 100])
    np.testing.assert_allclose(
        sqm.moving_variance_power(1e-3, 1.0, windows, windows * 0.125), [0.0045, 0.0081, 0.0152], atol=6e-5
    )


def test_alarms_of_sliding_windows_come_in_clusters():
    values = np.random.default_rng(5).standard_normal((40, 20_000))
    alarm = sqm.moving_variance(values, 50) > sqm.moving_variance_threshold(1e-3, 1.0, 50)
    assert np.mean(alarm) == pytest.approx(1e-3, abs=3e-4)
    assert np.mean(sqm.alarm_starts(alarm)) == pytest.approx(2.1e-4, abs=6e-5)
    np.testing.assert_array_equal(sqm.alarm_starts([True, True, False, True]), [True, False, False, True])


@pytest.mark.long
def test_tails_of_the_exact_laws_in_a_million_draws():
    taps = draw_taps(np.random.default_rng(6), 1_000_000, 4.472, 0.5)
    for metric, law in ((sqm.delta_metric, sqm.delta_law(0.5)), (sqm.ratio_metric, sqm.ratio_law(0.5))):
        p_value = sqm.ratio_p_value(metric(*taps), law, 4.472)
        for rate in (1e-2, 1e-3, 1e-4):
            assert binomial_two_sided(int(np.sum(p_value < rate)), 1_000_000, rate) > 1e-4
