import numpy as np
import pytest
from scipy import stats

from skyproof.statistics.distributions import binomial_two_sided, f_threshold
from skyproof.studies.double_difference import (
    counting_rule,
    difference_test,
    estimate_pooled_correlation,
    line_power,
    pair_tests,
    reject_pairs,
)


def draw_differences(rng, shape, phi=0.0, constant_m=0.0):
    """Draw (..., Q, N, R-1) single differences of false signals: nothing but noise. shape = (..., Q, N, R)."""
    noise = rng.standard_normal(shape)
    for n in range(1, shape[-2]):
        noise[..., n, :] = phi * noise[..., n - 1, :] + np.sqrt(1 - phi**2) * noise[..., n, :]
    noise = noise + constant_m * rng.standard_normal((*shape[:-2], 1, shape[-1]))
    return noise[..., 1:] - noise[..., :1]


@pytest.mark.parametrize("n", [5, 30, 120])
@pytest.mark.parametrize("receivers", [2, 3, 5])
def test_false_pairs_are_missed_at_the_rate_for_any_receivers(receivers, n):
    trials = 2_000_000 // (n * receivers)
    sd = draw_differences(np.random.default_rng(receivers), (trials, 2, n, receivers))
    p_value = difference_test(sd[:, 0] - sd[:, 1]).p_value
    assert binomial_two_sided(int(np.sum(p_value < 0.01)), trials, 0.01) > 1e-4


def test_the_degrees_of_freedom_count_all_receivers():
    test = difference_test(np.random.default_rng(0).standard_normal((30, 2)))
    assert (test.dof_num, test.dof_den) == (4, 56)


def test_the_fast_form_equals_the_plain_one():
    rng = np.random.default_rng(1)
    sd = draw_differences(rng, (6, 10, 3), phi=0.5) + rng.standard_normal((6, 1, 2))
    fast = pair_tests(sd, phi=0.4, constant_sigma_m=0.5)
    for k in range(6):
        for l in range(k):  # noqa: E741
            plain = difference_test(sd[k] - sd[l], phi=0.4, constant_sigma_m=0.5)
            assert fast.statistic[k, l] == pytest.approx(float(plain.statistic), rel=1e-9)
            assert fast.p_value[l, k] == pytest.approx(float(plain.p_value), rel=1e-9)
    assert np.all(np.diag(fast.p_value) == 1.0)


def test_a_baseline_is_seen():
    rng = np.random.default_rng(2)
    assert difference_test(draw_differences(rng, (30, 2)) + 5.0).p_value < 1e-6


@pytest.mark.parametrize(("phi", "most"), [(0.5, 0.015), (0.9, 0.045)])
def test_correlated_noise_is_covered_by_the_pooled_coefficient(phi, most):
    # The guide's 28 single differences of 7 satellites with two tracks each; its figures 0.011 to 0.013, and 0.029.
    rng = np.random.default_rng(3)
    tracks = draw_differences(rng, (1000, 28, 30, 2), phi)
    corrected = pair_tests(tracks[:, :7], phi=estimate_pooled_correlation(tracks)).p_value
    plain = pair_tests(tracks[:, :7]).p_value
    pairs = np.triu_indices(7, 1)
    assert np.mean(corrected[:, pairs[0], pairs[1]] < 0.01) < most
    assert np.mean(plain[:, pairs[0], pairs[1]] < 0.01) > 0.15


@pytest.mark.parametrize("n", [10, 30, 120])
def test_an_allowed_constant_error_does_not_authenticate(n):
    trials = 4000
    dd = np.diff(draw_differences(np.random.default_rng(4), (trials, 2, n, 2), constant_m=1.0), axis=1)[:, 0]
    assert np.mean(difference_test(dd, constant_sigma_m=1.0).p_value < 0.01) < 0.0125
    assert np.mean(difference_test(dd).p_value < 0.01) > 0.2


@pytest.mark.parametrize(("sats", "survive", "any_survives"), [(4, 2.9e-2, 5.3e-2), (5, 3.1e-3, 1.4e-2)])
def test_false_signals_survive_as_rarely_as_the_guide_states(sats, survive, any_survives):
    rng = np.random.default_rng(5)
    sd = rng.standard_normal((20_000, sats, 30, 1))
    rejected = pair_tests(sd).p_value < 0.01
    kept = ~counting_rule(rejected, np.arange(sats), np.zeros((sats, 2), int)).removed[:, 0, :, 0]
    assert kept.mean() == pytest.approx(survive, rel=0.2)
    assert kept.any(axis=1).mean() == pytest.approx(any_survives, rel=0.2)


def test_the_rule_keeps_the_true_track_and_drops_the_false_one():
    # 5 satellites, 2 tracks in each of 2 receivers, of which 1 is false: differences of two false tracks agree.
    satellite = np.repeat(np.arange(5), 4)
    track = np.tile([(0, 0), (0, 1), (1, 0), (1, 1)], (5, 1))
    false = np.all(track == 1, axis=1)
    rejected = ~(false[:, None] & false[None, :])
    rule = counting_rule(rejected, satellite, track)
    assert rule.removed[:, :, 1].all()
    assert not rule.removed[:, :, 0].any()
    assert np.all(rule.usable == 0)


def test_three_false_satellites_are_too_few_to_be_removed():
    rejected = np.zeros((3, 3), bool)
    rule = counting_rule(rejected, np.arange(3), np.zeros((3, 2), int))
    assert not rule.removed.any()


def test_two_tracks_left_leave_none_usable():
    satellite, track = np.repeat(np.arange(5), 2), np.tile([(0, 0), (1, 1)], (5, 1))
    rule = counting_rule(np.ones((10, 10), bool), satellite, track)
    assert np.all(rule.usable == -1)


# Detectors 1a, 2a, 2b, and what the paper prints


@pytest.mark.parametrize("tested", ["line", "slope"])
@pytest.mark.parametrize("sigma_m", [None, 1.0])
@pytest.mark.parametrize("receivers", [2, 3, 5])
def test_every_detector_misses_false_pairs_as_often_as_stated(tested, sigma_m, receivers):
    trials = 40_000
    sd = draw_differences(np.random.default_rng(receivers), (trials, 2, 12, receivers))
    test = difference_test(sd[:, 0] - sd[:, 1], tested=tested, sigma_m=sigma_m)
    assert test.dof_num == (2 if tested == "line" else 1) * (receivers - 1)
    assert test.dof_den == (10 * (receivers - 1) if sigma_m is None else np.inf)
    assert binomial_two_sided(int(np.sum(test.p_value < 0.01)), trials, 0.01) > 1e-4
    assert binomial_two_sided(int(np.sum(test.p_value < 0.5)), trials, 0.5) > 1e-4


def test_the_slope_does_not_see_the_offset_that_carriers_have():
    rng = np.random.default_rng(4)
    dd = 0.004 * rng.standard_normal((30, 1))
    moved = difference_test(dd + 17.3, tested="slope")
    assert moved.statistic == pytest.approx(float(difference_test(dd, tested="slope").statistic), rel=1e-6)
    assert difference_test(dd + 17.3).p_value < 1e-9
    assert difference_test(dd + 0.001 * np.arange(30.0)[:, None], tested="slope").p_value < 1e-6


@pytest.mark.parametrize(("receivers", "rate"), [(2, 0.31), (3, 0.53), (5, 0.75)])
def test_the_printed_root_gives_the_rates_of_the_guide(receivers, rate):
    sd = draw_differences(np.random.default_rng(5), (20_000, 2, 30, receivers))
    test = difference_test(sd[:, 0] - sd[:, 1], sigma_m=1.0, whitened=False)
    assert np.mean(test.p_value < 0.01) == pytest.approx(rate, abs=0.015)


@pytest.mark.parametrize(("receivers", "rate"), [(3, 0.055), (5, 0.33)])
def test_the_printed_degrees_of_freedom_give_the_guides_rates(receivers, rate):
    sd = draw_differences(np.random.default_rng(6), (20_000, 2, 30, receivers))
    test = difference_test(sd[:, 0] - sd[:, 1], sigma_m=1.0, degrees="printed")
    assert np.mean(test.p_value < 0.01) == pytest.approx(rate, abs=0.015)


@pytest.mark.parametrize("tested", ["line", "slope"])
@pytest.mark.parametrize("sigma_m", [None, 0.7])
def test_the_fast_form_of_every_detector_equals_the_plain_one(tested, sigma_m):
    sd = draw_differences(np.random.default_rng(7), (5, 10, 3))
    fast = pair_tests(sd, tested=tested, sigma_m=sigma_m)
    plain = difference_test(sd[1] - sd[3], tested=tested, sigma_m=sigma_m)
    assert fast.statistic[1, 3] == pytest.approx(float(plain.statistic), rel=1e-9)
    rejected = reject_pairs(sd, 0.3, tested=tested, sigma_m=sigma_m)
    np.testing.assert_array_equal(rejected, fast.p_value < 0.3)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("tested", ["line", "slope"])
def test_the_power_is_what_is_counted(tested, known):
    rng = np.random.default_rng(8)
    mean = np.linspace(0.2, 2.2, 20)[:, None] * np.array([1.0, -0.4])
    sd = draw_differences(rng, (20_000, 2, 20, 3))
    test = difference_test(mean + sd[:, 0] - sd[:, 1], tested=tested, sigma_m=1.0 if known else None)
    power = float(line_power(mean, 0.01, 1.0, tested=tested, known=known))
    assert 0.05 < power < 0.95
    assert np.mean(test.p_value < 0.01) == pytest.approx(power, abs=0.015)


@pytest.mark.parametrize(("n", "two", "one"), [(5, 30.82, 34.12), (30, 5.453, 7.636), (120, 4.790, 6.855)])
def test_the_thresholds_are_those_of_the_guide(n, two, one):
    assert f_threshold(0.01, 2, n - 2) == pytest.approx(two, abs=0.005)
    assert f_threshold(0.01, 1, n - 2) == pytest.approx(one, abs=0.005)


@pytest.mark.long
@pytest.mark.parametrize("tested", ["line", "slope"])
@pytest.mark.parametrize("sigma_m", [None, 1.0])
@pytest.mark.parametrize("receivers", [2, 3, 5])
def test_p_values_of_false_pairs_are_uniform(tested, sigma_m, receivers):
    trials = 300_000
    sd = draw_differences(np.random.default_rng(30 + receivers), (trials, 2, 8, receivers))
    p_value = difference_test(sd[:, 0] - sd[:, 1], tested=tested, sigma_m=sigma_m).p_value
    assert stats.kstest(p_value, "uniform").pvalue > 1e-3
    for tail in (1e-2, 1e-3, 1e-4):
        assert binomial_two_sided(int(np.sum(p_value < tail)), trials, tail) > 1e-4
