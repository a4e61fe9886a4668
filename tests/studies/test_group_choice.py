"""Which pairing of two skies comes from one antenna: exact p-values, and what they can see."""

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.multi_receiver.along_baselines import span_test
from skyproof.statistics.distributions import binomial_two_sided, f_threshold, noncentral_f_survival
from skyproof.studies.group_choice import (
    check_known_baseline,
    check_known_sky,
    choose,
    find_lone_sky,
    fraction_test,
    pairings,
    split_skies,
    transmit_antennas,
)

UNITS = np.array(
    [
        [0.1, 0.2, 0.97],
        [0.8, 0.1, 0.59],
        [-0.6, 0.6, 0.53],
        [-0.3, -0.8, 0.52],
        [0.5, -0.7, 0.51],
        [-0.9, 0.0, 0.43],
        [0.3, 0.8, 0.52],
    ]
)
UNITS /= np.linalg.norm(UNITS, axis=1, keepdims=True)
BASELINE = np.array([[14.0, 14.0, 0.5]])


def draw_tables(rng, trials, baseline_m, sigma_m=1.0, receivers=2, shared_m=0.0):
    """Draw means of a pairing of one antenna and of the sky beside it, (trials, 7, R) each.

    Each shows a place and a clock.
    shared_m : sigma of what a satellite's ranges have too much in all receivers.
    """
    baseline_m = np.broadcast_to(baseline_m, (receivers - 1, 3))
    terms = 300.0 * rng.standard_normal((2, trials, 3)) @ UNITS.T + shared_m * rng.standard_normal((2, trials, 7))
    terms = terms[..., None] + 1e5 * rng.standard_normal((2, trials, 1, receivers))
    false, sky = terms + sigma_m * rng.standard_normal((2, trials, 7, receivers))
    sky[..., 1:] -= (UNITS @ baseline_m.T)[None]
    return false, sky


def is_calibrated(p_values, level=0.01):
    return binomial_two_sided(int(np.sum(p_values < level)), p_values.size, level) > 1e-4


@pytest.mark.parametrize("receivers", [2, 3, 5])
@pytest.mark.parametrize("sigma_m", [0.1, 3.0])
def test_a_pairing_of_one_antenna_is_rejected_at_the_rate(receivers, sigma_m):
    rng = np.random.default_rng(receivers)
    for baseline, seen in ((0.0, ("fixes", "differences", "alone")), (BASELINE, ("alone",))):
        test = span_test(*draw_tables(rng, 40_000, baseline, sigma_m, receivers), UNITS)
        for name in seen:
            assert is_calibrated(getattr(test, name))
            assert is_calibrated(getattr(test, name), 0.5)
        assert np.mean(test.p_value < 0.01) < 0.0115


@pytest.mark.parametrize("baseline_m", [0.0, 0.05 * BASELINE, BASELINE])
@pytest.mark.parametrize("shared_m", [0.0, 1.0])
def test_shared_errors_make_it_only_more_careful(baseline_m, shared_m):
    test = span_test(*draw_tables(np.random.default_rng(31), 40_000, baseline_m, 1.0, shared_m=shared_m), UNITS)
    # Counts of 400 of 40000 and 40 of 40000, plus three standard deviations.
    for p_value in test:
        assert np.mean(p_value < 0.01) < 0.0115
        assert np.mean(p_value < 0.001) < 0.00148
    if shared_m:
        assert np.mean(test.fixes < 0.01) < 0.007


def test_known_unequal_noise_keeps_the_rate_unknown_spoils_it():
    rng = np.random.default_rng(1)
    sigma_m = np.array([[0.2, 3.0]] * 3 + [[3.0, 0.3]] * 4)[[0, 3, 1, 4, 2, 5, 6]]
    for shared_m in (0.0, 30.0):
        test = span_test(*draw_tables(rng, 40_000, 0.0, sigma_m, shared_m=shared_m), UNITS, sigma_m)
        for p_value in test[1:]:
            assert is_calibrated(p_value)
    untold = span_test(*draw_tables(rng, 40_000, 0.0, sigma_m[:, :1]), UNITS)
    assert not is_calibrated(untold.alone)


def test_factored_sigmas_leave_the_noise_of_all_fixes():
    sigma_m = np.linspace(0.5, 2.0, 7)[:, None] * np.array([1.0, 1.7])
    baseline = 0.25 * BASELINE
    false, sky = draw_tables(np.random.default_rng(32), 20_000, baseline, 0.65 * sigma_m)
    test = span_test(sky, false, UNITS, sigma_m)
    assert np.mean(test.fixes < 1e-3) > 1.1 * np.mean(test.differences < 1e-3)


def test_shared_errors_cost_only_what_fixes_would_have_gained():
    baseline = 0.25 * BASELINE  # 5 m
    false, sky = draw_tables(np.random.default_rng(33), 5000, baseline, 0.37, shared_m=100.0)
    test = span_test(sky, false, UNITS)
    assert np.mean(test.fixes < 1e-3) < 0.01
    assert np.mean(test.p_value < 1e-3) > np.mean(test.differences < 1e-4) > 0.9


def test_its_power_is_that_of_the_noncentral_law_over_all_noise():
    baseline, sigma_m = 0.25 * BASELINE, 0.9
    false, sky = draw_tables(np.random.default_rng(34), 40_000, baseline, sigma_m)
    result = -(UNITS @ baseline[0])
    squares = np.sum((result - result.mean()) ** 2) / 2.0 / sigma_m**2
    reported = noncentral_f_survival(f_threshold(1e-3, 3, 15), 3, 15, squares)
    assert np.mean(span_test(sky, false, UNITS).fixes < 1e-3) == pytest.approx(float(reported), abs=0.01)
    assert np.mean(span_test(sky, false, UNITS).p_value < 1e-3) > 0.9 * reported


@pytest.mark.parametrize("stated_m", [0.25 * BASELINE, -10.0 * BASELINE])
@pytest.mark.parametrize("baseline_m", [0.0, 0.25 * BASELINE, BASELINE])
def test_no_statement_of_places_rejects_one_antenna_more_often(stated_m, baseline_m):
    tables = draw_tables(np.random.default_rng(35), 40_000, baseline_m, shared_m=0.0)
    test = span_test(*tables, UNITS, stated_enu_m=stated_m)
    for p_value in test:
        assert np.mean(p_value < 0.01) < 0.0115
        assert np.mean(p_value < 0.001) < 0.00148
    if np.ndim(baseline_m) == 0:
        assert np.mean(test.fixes < 0.01) > 0.006  # of two tests that overlap by half


def test_the_sky_is_seen_better_where_places_are_stated_and_hardly_worse_where_these_are_wrong():
    baseline, sigma_m = 0.25 * BASELINE, 0.9
    false, sky = draw_tables(np.random.default_rng(36), 20_000, baseline, sigma_m)

    def missed(stated_m):
        return np.mean(span_test(sky, false, UNITS, stated_enu_m=stated_m).p_value >= 1e-3)

    assert missed(baseline) < 0.3 * missed(None)
    assert 1.0 - missed(-baseline) > 0.8 * (1.0 - missed(None))


def test_the_sky_is_seen_at_a_fraction_of_the_averages_noise():
    false, sky = draw_tables(np.random.default_rng(2), 2000, BASELINE, 0.37)
    assert np.mean(span_test(sky, false, UNITS).p_value < 1e-3) > 0.999


@pytest.mark.parametrize("baseline", [BASELINE, 0.1 * BASELINE])
def test_with_the_baseline_known_the_rate_is_kept(baseline):
    false, sky = draw_tables(np.random.default_rng(3), 40_000, baseline)
    p_value = check_known_baseline(false, sky, UNITS, baseline)
    assert 0.007 < np.mean(p_value < 0.01) < 0.0115
    shared = check_known_baseline(
        *draw_tables(np.random.default_rng(3), 40_000, baseline, shared_m=30.0), UNITS, baseline
    )
    assert np.mean(shared < 0.01) < 0.004


def test_with_a_known_baseline_only_the_reversed_side_counts():
    false = draw_tables(np.random.default_rng(35), 5000, BASELINE, 10.0)[0]
    farther = draw_tables(np.random.default_rng(36), 5000, 2.0 * BASELINE, 10.0)[1]
    nearer = draw_tables(np.random.default_rng(37), 5000, 0.0, 10.0)[1]
    far, near = (np.mean(check_known_baseline(false, table, UNITS, BASELINE) < 0.01) for table in (farther, nearer))
    assert far < 0.01
    assert near > 5.0 * far


def test_with_the_baseline_known_shorter_ones_are_seen():
    baseline = 0.25 * BASELINE  # 5 m
    false, sky = draw_tables(np.random.default_rng(4), 5000, baseline, 2.0 / np.sqrt(30.0))
    assert np.mean(check_known_baseline(sky, false, UNITS, baseline) < 1e-3) > 0.999
    assert np.mean(span_test(sky, false, UNITS).p_value < 1e-3) > 0.999
    false, sky = draw_tables(np.random.default_rng(4), 5000, 0.5 * baseline, 2.0 / np.sqrt(30.0))
    assert np.mean(check_known_baseline(sky, false, UNITS, 0.5 * baseline) < 1e-3) > 0.99
    assert np.mean(span_test(sky, false, UNITS).p_value < 1e-3) < 0.9


def test_mixed_pairings_are_rejected_on_the_transmitters_line():
    rng = np.random.default_rng(5)
    for where in (-25.0 * BASELINE[0], np.array([300.0, -500.0, 10.0])):  # in line with the baseline, and not
        sky = rng.standard_normal((500, 7, 2)) - UNITS @ np.stack([np.zeros(3), BASELINE[0]], axis=-1)
        false = rng.standard_normal((500, 7, 2)) + (UNITS @ where)[:, None] + np.array([900.0, 920.0])
        mixed, other = (np.stack([a[..., 0], b[..., 1]], axis=-1) for a, b in ((sky, false), (false, sky)))
        for item, complement in ((mixed, other), (other, mixed)):
            assert np.all(check_known_baseline(item, complement, UNITS, BASELINE) < 1e-3)
            assert np.all(span_test(item, complement, UNITS).p_value < 1e-3)


def test_no_baseline_cannot_tell():
    false, sky = draw_tables(np.random.default_rng(6), 5, np.zeros((1, 3)))
    assert np.all(check_known_baseline(false, sky, UNITS, np.zeros((1, 3))) == 1.0)


# Skies


def test_two_skies_are_split_whatever_the_order_of_tracks():
    rng = np.random.default_rng(7)
    offset_m = np.array([-300.0, 400.0, 20.0])
    false_m = UNITS @ -offset_m + 900.0
    swapped = rng.random((200, 7)) < 0.5
    tracks = np.stack(np.broadcast_arrays(np.zeros(7), false_m), axis=-1)[None].repeat(200, axis=0)
    tracks = np.where(swapped[..., None], tracks[..., ::-1], tracks) + 0.5 * rng.standard_normal((200, 7, 2))
    split = split_skies(tracks, UNITS)
    np.testing.assert_array_equal(split.first, swapped ^ swapped[:, :1])
    assert np.mean(split.squares) == pytest.approx(2 * 3 * 0.25, rel=0.2)
    assert np.all(split.runner_up > 50.0)


def test_pairings_and_their_complements_mirror():
    rows = pairings(3)
    np.testing.assert_array_equal(rows[::-1], 1 - rows)
    assert rows.shape == (8, 3)


# Two transmit antennas


def draw_two_antennas(rng, trials):
    """Draw means (trials, 7, 2 receivers, 2 tracks) of 1 m over 30 s: 4 and 3 false signals, 300 m apart."""
    noise_m = rng.standard_normal((trials, 7, 2, 2)) / np.sqrt(30.0)
    places = np.where(np.arange(7)[:, None] < 4, [-300.0, 400.0, 20.0], [-100.0, 180.0, 40.0])
    ways_m = np.where(np.arange(7)[:, None] < 4, [900.0, 915.0], [900.0, 892.0])
    false_m = np.sum(UNITS * places, axis=1)[:, None] + ways_m
    true_m = np.column_stack([np.zeros(7), -UNITS @ BASELINE[0]])
    return noise_m + np.stack([true_m, false_m], axis=-1)


def test_beside_two_transmit_antennas_the_true_sky_fits():
    means_m = draw_two_antennas(np.random.default_rng(11), 500)
    found = find_lone_sky(np.swapaxes(means_m, 1, 2), UNITS)
    assert np.all(found.first == 0)
    sky = means_m[..., 0]
    assert is_calibrated(check_known_sky(sky, UNITS, BASELINE, 1.0 / 30.0))
    assert np.all(check_known_sky(means_m[..., 1], UNITS, BASELINE, 1.0 / 30.0) < 1e-6)


def test_two_transmit_antennas_are_counted_and_sorted():
    means_m = draw_two_antennas(np.random.default_rng(12), 2000)[..., 1]
    found = transmit_antennas(means_m[..., 1] - means_m[..., 0], np.sqrt(2.0 / 30.0), 1e-3)
    assert np.mean(found.number > 2) < 3e-3
    assert np.all(found.label[found.number == 2] == [1] * 4 + [0] * 3)


# Choice


def test_a_choice_needs_all_others_to_be_rejected():
    p_values = np.array([[0.4, 1e-5, 1e-6, 1e-7], [0.4, 0.3, 1e-6, 1e-7], [1e-12, 1e-15, 1e-15, 1e-15]])
    np.testing.assert_array_equal(choose(p_values, 1e-3).which, [0, -1, -1])
    np.testing.assert_allclose(choose(p_values, 1e-3).p_value[:2], [1e-5, 0.3])


def test_an_undecidable_choice_errs_at_most_at_the_rate():
    false, sky = draw_tables(np.random.default_rng(8), 40_000, np.zeros((1, 3)))
    p_values = np.stack([span_test(false, sky, UNITS).p_value, span_test(sky, false, UNITS).p_value], axis=-1)
    assert np.mean(choose(p_values, 0.01).which == 1) < 0.0125


# Fractions of cycles


@pytest.mark.parametrize("modulus", [1.0, 0.5])
def test_equal_fractions_pass_as_often_as_stated(modulus):
    rng = np.random.default_rng(9)
    shape = (40_000, 7)
    cycles = rng.random((shape[0], 1)) + modulus * rng.integers(-9, 9, shape) + 0.01 * rng.standard_normal(shape)
    assert is_calibrated(fraction_test(cycles, 0.01, modulus_cyc=modulus).p_value)


def test_fractions_that_fit_by_chance_are_as_rare_as_stated():
    rng = np.random.default_rng(10)
    test = fraction_test(rng.random((400_000, 5)), 0.04)
    radius = 0.04 * np.sqrt(13.277)  # 1 % of chi-square with 4
    reported = np.sqrt(5) * np.pi**2 / 2.0 * radius**4
    assert np.mean(test.p_value > 0.01) == pytest.approx(reported, rel=0.15)


def test_open_half_cycles_are_told_apart_if_not_allowed():
    cycles = np.array([0.1, 0.6, 0.1, 0.6, 0.1])
    assert fraction_test(cycles, 0.01, modulus_cyc=0.5).p_value > 0.99
    assert fraction_test(cycles, 0.01).p_value < 1e-9


# Uniform p-values


def is_uniform(p_values, tails=(1e-2, 1e-3, 1e-4)):
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    for tail in tails:
        assert binomial_two_sided(int(np.sum(p_values < tail)), p_values.size, tail) > 1e-4


@pytest.mark.long
@pytest.mark.parametrize("receivers", [2, 3])
def test_p_values_of_the_span_test_are_uniform(receivers):
    rng, trials = np.random.default_rng(20 + receivers), 500_000
    # Means of 10 epochs of AR(1) 0.9 and a constant: what the tests' own variances know nothing of.
    steps = np.abs(np.subtract.outer(np.arange(10), np.arange(10)))
    for sigma_m in (1.0, np.sqrt(np.mean(0.9**steps) + 1.0)):
        test = span_test(*draw_tables(rng, trials, 0.0, sigma_m, receivers), UNITS)
        for p_value in test[1:]:
            is_uniform(p_value)
        for level in (1e-2, 1e-3, 1e-4):  # Bonferroni's bound is hardly careful
            assert 0.6 < np.mean(test.p_value < level) / level < 1.0 + 4.0 / np.sqrt(level * trials)
        is_uniform(span_test(*draw_tables(rng, trials, BASELINE, sigma_m, receivers), UNITS).alone)


@pytest.mark.long
def test_p_values_of_fractions_are_uniform():
    rng = np.random.default_rng(21)
    shape = 1_000_000, 7
    cycles = rng.random((shape[0], 1)) + rng.integers(-9, 9, shape) + 0.01 * rng.standard_normal(shape)
    is_uniform(fraction_test(cycles, 0.01).p_value)


@pytest.mark.long
@pytest.mark.parametrize("level", [1e-2, 1e-3, 1e-4])
def test_the_test_over_a_known_baseline_is_hardly_conservative(level):
    false, sky = draw_tables(np.random.default_rng(22), 1_000_000, BASELINE)
    p_value = check_known_baseline(false, sky, UNITS, BASELINE)
    assert 0.6 < np.mean(p_value < level) / level < 1.0 + 4.0 / np.sqrt(level * p_value.size)
