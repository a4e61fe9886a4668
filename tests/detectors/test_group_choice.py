"""Which pairing of two skies comes from one antenna: exact p-values, and what they can see."""

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.group_choice import (
    choose,
    fraction_test,
    known_baseline_test,
    known_sky_test,
    lone_sky,
    pairings,
    span_test,
    split_skies,
    transmit_antennas,
)
from skyproof.statistics.distributions import binomial_two_sided

UNITS = np.array([[0.1, 0.2, 0.97], [0.8, 0.1, 0.59], [-0.6, 0.6, 0.53], [-0.3, -0.8, 0.52], [0.5, -0.7, 0.51],
                  [-0.9, 0.0, 0.43], [0.3, 0.8, 0.52]])  # fmt: skip
UNITS /= np.linalg.norm(UNITS, axis=1, keepdims=True)
BASELINE = np.array([[14.0, 14.0, 0.5]])


def tables(rng, trials, baseline_m, sigma_m=1.0, receivers=2):
    """Means of a pairing of one antenna and of the sky beside it, (trials, 7, R) each."""
    baseline_m = np.broadcast_to(baseline_m, (receivers - 1, 3))
    terms = 1e3 * rng.standard_normal((2, trials, 7, 1)) + 1e5 * rng.standard_normal((2, trials, 1, receivers))
    false, sky = terms + sigma_m * rng.standard_normal((2, trials, 7, receivers))
    sky[..., 1:] -= (UNITS @ baseline_m.T)[None]
    return false, sky


def well_calibrated(p_values, level=0.01):
    return binomial_two_sided(int(np.sum(p_values < level)), p_values.size, level) > 1e-4


@pytest.mark.parametrize("receivers", [2, 3, 5])
@pytest.mark.parametrize("sigma_m", [0.1, 3.0])
def test_a_pairing_of_one_antenna_is_rejected_as_often_as_stated_whatever_the_baseline(receivers, sigma_m):
    false, sky = tables(np.random.default_rng(receivers), 40_000, BASELINE, sigma_m, receivers)
    assert well_calibrated(span_test(false, sky, UNITS).p_value)
    assert well_calibrated(span_test(false, sky, UNITS).p_value, 0.5)


def test_tracks_of_known_unequal_noise_keep_the_rate_and_spoil_it_if_not_told():
    rng = np.random.default_rng(1)
    sigma_m = np.array([[0.2, 0.2]] * 3 + [[3.0, 3.0]] * 4)[[0, 3, 1, 4, 2, 5, 6]]
    false, sky = (sigma_m * rng.standard_normal((40_000, 7, 2)) for _ in range(2))
    assert well_calibrated(span_test(false, sky, UNITS, sigma_m).p_value)
    assert not well_calibrated(span_test(false, sky, UNITS).p_value)


def test_the_sky_is_seen_at_a_fraction_of_the_noise_that_an_average_leaves():
    false, sky = tables(np.random.default_rng(2), 2000, BASELINE, 0.37)
    assert np.mean(span_test(sky, false, UNITS).p_value < 1e-3) > 0.999


@pytest.mark.parametrize("baseline", [BASELINE, 0.1 * BASELINE])
def test_with_the_baseline_known_the_rate_is_kept(baseline):
    false, sky = tables(np.random.default_rng(3), 40_000, baseline)
    p_value = known_baseline_test(false, sky, UNITS, baseline)
    # The smaller of two independent-looking p-values, doubled: 0.01 becomes 0.009975.
    assert well_calibrated(p_value)


def test_with_the_baseline_known_shorter_ones_are_seen():
    baseline = 0.25 * BASELINE  # 5 m
    false, sky = tables(np.random.default_rng(4), 5000, baseline, 2.0 / np.sqrt(30.0))
    known = np.mean(known_baseline_test(sky, false, UNITS, baseline) < 1e-3)
    unknown = np.mean(span_test(sky, false, UNITS).p_value < 1e-3)
    assert known > 0.999
    assert unknown < known


def test_pairings_that_mix_are_rejected_also_on_the_transmitters_line():
    rng = np.random.default_rng(5)
    for where in (-25.0 * BASELINE[0], np.array([300.0, -500.0, 10.0])):  # in line with the baseline, and not
        sky = rng.standard_normal((500, 7, 2)) - UNITS @ np.stack([np.zeros(3), BASELINE[0]], axis=-1)
        false = rng.standard_normal((500, 7, 2)) + (UNITS @ where)[:, None] + np.array([900.0, 920.0])
        mixed, other = (np.stack([a[..., 0], b[..., 1]], axis=-1) for a, b in ((sky, false), (false, sky)))
        for one, complement in ((mixed, other), (other, mixed)):
            assert np.all(known_baseline_test(one, complement, UNITS, BASELINE) < 1e-3)
            assert np.all(span_test(one, complement, UNITS).p_value < 1e-3)


def test_no_baseline_cannot_tell():
    false, sky = tables(np.random.default_rng(6), 5, np.zeros((1, 3)))
    assert np.all(known_baseline_test(false, sky, UNITS, np.zeros((1, 3))) == 1.0)


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


def two_antennas(rng, trials):
    """Means (trials, 7, 2 receivers, 2 tracks) of 1 m over 30 s; false signals of 4 and 3 satellites, 300 m apart."""
    noise_m = rng.standard_normal((trials, 7, 2, 2)) / np.sqrt(30.0)
    places = np.where(np.arange(7)[:, None] < 4, [-300.0, 400.0, 20.0], [-100.0, 180.0, 40.0])
    ways_m = np.where(np.arange(7)[:, None] < 4, [900.0, 915.0], [900.0, 892.0])
    false_m = np.sum(UNITS * places, axis=1)[:, None] + ways_m
    true_m = np.column_stack([np.zeros(7), -UNITS @ BASELINE[0]])
    return noise_m + np.stack([true_m, false_m], axis=-1)


def test_beside_two_transmit_antennas_the_true_sky_is_the_one_that_fits():
    means_m = two_antennas(np.random.default_rng(11), 500)
    found = lone_sky(np.swapaxes(means_m, 1, 2), UNITS)
    assert np.all(found.first == 0)
    sky = means_m[..., 0]
    assert well_calibrated(known_sky_test(sky, UNITS, BASELINE, 1.0 / 30.0))
    assert np.all(known_sky_test(means_m[..., 1], UNITS, BASELINE, 1.0 / 30.0) < 1e-6)


def test_two_transmit_antennas_are_counted_and_their_signals_sorted():
    means_m = two_antennas(np.random.default_rng(12), 2000)[..., 1]
    found = transmit_antennas(means_m[..., 1] - means_m[..., 0], np.sqrt(2.0 / 30.0), 1e-3)
    assert np.mean(found.number > 2) < 3e-3
    assert np.all(found.label[found.number == 2] == [1] * 4 + [0] * 3)


# Choice


def test_a_choice_needs_all_others_to_be_rejected():
    p_values = np.array([[0.4, 1e-5, 1e-6, 1e-7], [0.4, 0.3, 1e-6, 1e-7], [1e-12, 1e-15, 1e-15, 1e-15]])
    np.testing.assert_array_equal(choose(p_values, 1e-3).which, [0, -1, -1])
    np.testing.assert_allclose(choose(p_values, 1e-3).p_value[:2], [1e-5, 0.3])


def test_a_choice_errs_no_more_often_than_stated_where_nothing_can_be_told():
    false, sky = tables(np.random.default_rng(8), 40_000, np.zeros((1, 3)))
    p_values = np.stack([span_test(false, sky, UNITS).p_value, span_test(sky, false, UNITS).p_value], axis=-1)
    assert np.mean(choose(p_values, 0.01).which == 1) < 0.0125


# Fractions of cycles


@pytest.mark.parametrize("modulus", [1.0, 0.5])
def test_equal_fractions_pass_as_often_as_stated(modulus):
    rng = np.random.default_rng(9)
    shape = (40_000, 7)
    cycles = rng.random((shape[0], 1)) + modulus * rng.integers(-9, 9, shape) + 0.01 * rng.standard_normal(shape)
    assert well_calibrated(fraction_test(cycles, 0.01, modulus_cyc=modulus).p_value)


def test_fractions_that_fit_by_chance_are_as_rare_as_told():
    rng = np.random.default_rng(10)
    test = fraction_test(rng.random((400_000, 5)), 0.04)
    radius = 0.04 * np.sqrt(13.277)  # 1 % of chi-square with 4
    told = np.sqrt(5) * np.pi**2 / 2.0 * radius**4
    assert np.mean(test.p_value > 0.01) == pytest.approx(told, rel=0.15)


def test_half_cycles_that_are_open_are_told_apart_only_if_they_are_not_allowed():
    cycles = np.array([0.1, 0.6, 0.1, 0.6, 0.1])
    assert fraction_test(cycles, 0.01, modulus_cyc=0.5).p_value > 0.99
    assert fraction_test(cycles, 0.01).p_value < 1e-9


# Uniform p-values


def uniform(p_values, tails=(1e-2, 1e-3, 1e-4)):
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    for tail in tails:
        assert binomial_two_sided(int(np.sum(p_values < tail)), p_values.size, tail) > 1e-4


@pytest.mark.long
@pytest.mark.parametrize("receivers", [2, 3])
def test_p_values_of_the_span_test_are_uniform_whatever_the_noise_over_time(receivers):
    rng, trials = np.random.default_rng(20 + receivers), 500_000
    false, sky = tables(rng, trials, BASELINE, 1.0, receivers)
    uniform(span_test(false, sky, UNITS).p_value)
    # Means of 10 epochs of AR(1) 0.9 and a constant: what the tests' own variances know nothing of.
    steps = np.abs(np.subtract.outer(np.arange(10), np.arange(10)))
    sigma = np.sqrt(np.mean(0.9**steps) + 1.0)
    false, sky = tables(rng, trials, BASELINE, sigma, receivers)
    uniform(span_test(false, sky, UNITS).p_value)


@pytest.mark.long
def test_p_values_of_fractions_are_uniform():
    rng = np.random.default_rng(21)
    shape = 1_000_000, 7
    cycles = rng.random((shape[0], 1)) + rng.integers(-9, 9, shape) + 0.01 * rng.standard_normal(shape)
    uniform(fraction_test(cycles, 0.01).p_value)


@pytest.mark.long
@pytest.mark.parametrize("level", [1e-2, 1e-3, 1e-4])
def test_the_test_over_a_known_baseline_is_hardly_conservative(level):
    false, sky = tables(np.random.default_rng(22), 1_000_000, BASELINE)
    p_value = known_baseline_test(false, sky, UNITS, BASELINE)
    count = int(np.sum(p_value < level))
    assert binomial_two_sided(count, p_value.size, level) > 1e-4 or 0.99 < count / p_value.size / level < 1.0
