"""Counts of wrong authentication: signals of one antenna that the test takes for signals of the sky."""

import numpy as np
import pytest
from scipy.signal import lfilter

from skyproof.detectors.multi_receiver.one_antenna import (
    WHITE,
    TrackNoise,
    average_contrasts,
    baseline_design,
    compute_contrasts,
    distance_p_value,
    estimate_baselines,
    one_antenna_test,
    ratio_test,
)
from skyproof.statistics.distributions import binomial_survival, binomial_two_sided


def draw_tracks(rng, shape, sigma_m=1.0, phi=0.0, constant_m=0.0):
    """Draw errors (trials, N, K, R) of tracks."""
    white = rng.standard_normal(shape)
    white[:, 1:] *= np.sqrt(1.0 - phi**2)
    return sigma_m * lfilter([1.0], [1.0, -phi], white, axis=1) + constant_m * rng.standard_normal(
        (shape[0], 1, *shape[2:])
    )


def find_p_values(ranges_m, noise, sigma_m=None, unit_enu=None):
    """Return p-values along baselines alone, if the directions of the satellites are known."""
    sigma_m = np.ones(ranges_m.shape[-2:]) if sigma_m is None else sigma_m
    values, gain, matrix = compute_contrasts(ranges_m, sigma_m)
    along = None if unit_enu is None else baseline_design(matrix, unit_enu)
    return one_antenna_test(average_contrasts(values, gain, noise), along=along).p_value


def count_alarms(rng, trials, shape, noise, rates, unit_enu=None, **errors):
    """Count how often the p-value is below each of `rates`, in blocks that fit into memory."""
    block = max(1, 400_000 // int(np.prod(shape)))
    counts = np.zeros(len(rates), int)
    for begin in range(0, trials, block):
        p = find_p_values(draw_tracks(rng, (min(block, trials - begin), *shape), **errors), noise, unit_enu=unit_enu)
        counts += np.sum(p[:, None] < np.array(rates), axis=0)
    return counts


def draw_sky(sats=7, seed=0):
    """Draw directions east, north, up, spread over the sky above 10 degrees."""
    rng = np.random.default_rng(seed)
    up = np.sin(np.radians(np.linspace(10, 80, sats)))
    azimuth = rng.uniform(0, 2 * np.pi) + np.arange(sats) * 2.4
    return np.column_stack([np.sqrt(1 - up**2) * np.sin(azimuth), np.sqrt(1 - up**2) * np.cos(azimuth), up])


@pytest.mark.parametrize("n", [5, 30, 120])
@pytest.mark.parametrize("receivers", [2, 3])
def test_white_noise_gives_exactly_the_stated_wrong_rate(receivers, n):
    trials = 1_500_000 // (n * receivers)
    (count,) = count_alarms(np.random.default_rng(n), trials, (n, 5, receivers), WHITE, [0.01])
    assert binomial_two_sided(count, trials, 0.01) > 1e-3


@pytest.mark.parametrize("receivers", [2, 3])
def test_along_baselines_the_stated_rate_is_exact_as_well(receivers):
    trials = 40_000
    (count,) = count_alarms(np.random.default_rng(5), trials, (10, 7, receivers), WHITE, [0.01], unit_enu=draw_sky())
    assert binomial_two_sided(count, trials, 0.01) > 1e-3


def test_baselines_tell_what_all_contrasts_together_do_not():
    unit_enu = draw_sky(10)
    away_m = np.stack([np.zeros(10), -unit_enu @ (4.0, 3.0, 0.0)], axis=-1)
    errors_m = draw_tracks(np.random.default_rng(6), (200, 60, 10, 2), phi=0.5, constant_m=1.0)
    noise = TrackNoise(miss_probability=1e-4)
    along, whole = (np.mean(find_p_values(away_m + errors_m, noise, unit_enu=u) < 1e-3) for u in (unit_enu, None))
    assert along > whole + 0.1


@pytest.mark.long
@pytest.mark.parametrize("n", [5, 30, 120])
@pytest.mark.parametrize("receivers", [2, 3])
def test_the_rate_holds_within_a_fifth_at_both_levels(receivers, n):
    trials = 400_000
    at_1, at_01 = count_alarms(np.random.default_rng(n), trials, (n, 7, receivers), WHITE, [0.01, 0.001])
    assert at_1 / trials == pytest.approx(0.01, rel=0.2)
    assert at_01 / trials == pytest.approx(0.001, rel=0.2)
    assert binomial_two_sided(at_1, trials, 0.01) > 1e-4
    assert binomial_two_sided(at_01, trials, 0.001) > 1e-4


ERRORS = [
    {"phi": 0.0},
    {"phi": 0.5},
    {"phi": 0.9},
    {"phi": 0.9, "sigma_m": 0.5, "constant_m": 1.0},
    {"phi": 0.0, "constant_m": 1.0},
    {"phi": 0.5, "constant_m": 1.0},
    {"phi": 0.9, "sigma_m": 3.0, "constant_m": 1.0},
]


@pytest.mark.parametrize("errors", ERRORS, ids=str)
@pytest.mark.parametrize(("n", "sats", "receivers"), [(5, 7, 2), (30, 5, 2), (15, 7, 3)])
def test_coloured_noise_and_constant_errors_do_not_authenticate(n, sats, receivers, errors):
    trials = 600
    noise = TrackNoise(miss_probability=1e-3)
    (count,) = count_alarms(np.random.default_rng(1), trials, (n, sats, receivers), noise, [0.01], **errors)
    assert binomial_survival(count, trials, 0.01) > 1e-3


SHAPES = [(5, 2), (12, 2), (7, 3)]
EPOCHS = [5, 15, 30, 120]
# Any errors with any number of epochs and with any shape: of the three, a third shows every two together.
COVERED = [(*SHAPES[(i + j) % 3], n, errors) for i, n in enumerate(EPOCHS) for j, errors in enumerate(ERRORS)]


@pytest.mark.long
@pytest.mark.parametrize("rate", [0.01, 0.001])
@pytest.mark.parametrize(("sats", "receivers", "n", "errors"), COVERED, ids=str)
def test_wrong_authentications_stay_below_the_stated_rate(sats, receivers, n, errors, rate):
    trials = 10_000
    noise = TrackNoise(miss_probability=rate / 10)
    for unit_enu in (None, draw_sky(sats)):
        (count,) = count_alarms(
            np.random.default_rng(1), trials, (n, sats, receivers), noise, [rate], unit_enu=unit_enu, **errors
        )
        assert binomial_survival(count, trials, rate) > 1e-3


def test_what_the_cures_are_for():
    rng = np.random.default_rng(2)
    assert np.mean(find_p_values(draw_tracks(rng, (400, 30, 7, 2), phi=0.9), WHITE) < 0.01) > 0.9
    assert np.mean(find_p_values(draw_tracks(rng, (400, 30, 7, 2), constant_m=1.0), WHITE) < 0.01) > 0.9


def test_wrong_weights_do_not_authenticate_either():
    # One satellite is three times as noisy as its C/N0 says: the exact test errs by a factor of five, the other not.
    scale = np.ones((7, 2))
    scale[0] = 3.0
    errors = draw_tracks(np.random.default_rng(3), (1000, 30, 7, 2)) * scale
    assert np.mean(find_p_values(errors, WHITE) < 0.01) > 0.03
    assert np.mean(find_p_values(errors, TrackNoise(miss_probability=1e-3)) < 0.01) < 0.01


@pytest.mark.parametrize(("distance_m", "n", "power"), [(10, 30, 0.9), (20, 10, 0.8), (20, 30, 0.99), (60, 10, 0.99)])
def test_the_sky_is_told_from_one_antenna(distance_m, n, power):
    errors = draw_tracks(np.random.default_rng(4), (200, n, 7, 2), constant_m=1.0)
    errors[..., 1] -= draw_sky() @ np.array([0.6 * distance_m, 0.8 * distance_m, 0.0])
    assert np.mean(find_p_values(errors, TrackNoise()) < 1e-3) > power


def test_unequal_thermal_noise_keeps_the_law_exact():
    rng = np.random.default_rng(5)
    sigma_m = rng.uniform(0.5, 3.0, (6, 2))
    p = find_p_values(draw_tracks(rng, (20_000, 8, 6, 2)) * sigma_m, WHITE, 10.0 * sigma_m)  # known up to a factor
    assert binomial_two_sided(int(np.sum(p < 0.01)), p.size, 0.01) > 1e-3


def test_clock_and_satellite_terms_of_any_size_do_not_matter():
    rng = np.random.default_rng(6)
    errors = draw_tracks(rng, (3, 10, 6, 2))
    moved = errors + 2e7 + 3e5 * rng.standard_normal((10, 6, 1)) + 3e5 * rng.standard_normal((10, 1, 2))
    np.testing.assert_allclose(find_p_values(moved, WHITE), find_p_values(errors, WHITE), rtol=1e-4)


def test_the_threshold_is_where_the_p_value_crosses_the_rate():
    rng = np.random.default_rng(7)
    for noise in (WHITE, TrackNoise(miss_probability=1e-4)):
        values, gain, _ = compute_contrasts(draw_tracks(rng, (300, 10, 6, 2)) * 1.3, np.ones((6, 2)))
        values = values + rng.uniform(0, 12, (300, 1, 1))
        levels = average_contrasts(values, gain, noise)
        test = one_antenna_test(levels)
        assert 0 < np.mean(test.p_value < 1e-3) < 1
        above = test.statistic > levels.threshold(1e-3, values.shape[-1], test.decides)
        np.testing.assert_array_equal(above, test.p_value < 1e-3)


@pytest.mark.parametrize("errors", [{"phi": 0.9}, {"constant_m": 2.0}, {"sigma_m": 5.0}], ids=str)
def test_the_ratio_test_holds_its_rate_whatever_the_common_noise(errors):
    trials = 20_000
    rng = np.random.default_rng(8)
    first, second = (draw_tracks(rng, (trials, 4, 7, 2), **errors).mean(axis=1) for _ in range(2))
    sigma_m = np.ones((7, 2))
    p = ratio_test(first, sigma_m, second, sigma_m).p_value
    assert binomial_two_sided(int(np.sum(p < 0.01)), trials, 0.01) > 1e-3


def test_the_ratio_test_errs_to_the_safe_side():
    trials, limit = 20_000, 230  # 200 expected, 2 sigma
    rng = np.random.default_rng(9)
    both_tables = rng.standard_normal((trials, 7, 3))
    sigma_m = np.ones((7, 2))
    shared = ratio_test(both_tables[..., [0, 2]], sigma_m, both_tables[..., [1, 2]], sigma_m).p_value
    assert np.sum(shared < 0.01) < limit
    other = rng.standard_normal((trials, 7, 2))
    other[..., 1] -= draw_sky() @ np.array([2.0, 0.0, 0.0])
    assert np.sum(ratio_test(both_tables[..., :2], sigma_m, other, sigma_m).p_value < 0.01) < limit
    for share in (0.0, 0.5, 1.0):  # the first is weak: from none of its noise by C/N0 to all of it
        weak = both_tables[..., :2] * np.sqrt(share * 9.0 + (1.0 - share))
        p = ratio_test(weak, 3.0 * sigma_m, rng.standard_normal((trials, 7, 2)), sigma_m).p_value
        assert np.sum(p < 0.01) < limit


def test_the_baseline_comes_back_with_its_covariance():
    rng = np.random.default_rng(10)
    baseline_m = np.array([12.0, -5.0, 3.0])
    ranges_m = draw_tracks(rng, (3000, 10, 8, 2))
    ranges_m[..., 1] -= draw_sky(8) @ baseline_m
    values, gain, matrix = compute_contrasts(ranges_m, np.ones((8, 2)))
    found = estimate_baselines(average_contrasts(values, gain, WHITE), baseline_design(matrix, draw_sky(8)))
    error_m = found.enu_m[0] - baseline_m
    assert np.abs(error_m.mean(axis=0)).max() < 0.1
    np.testing.assert_allclose(np.cov(error_m.T), found.covariance_m2[0].mean(axis=0), rtol=0.15, atol=0.02)


@pytest.mark.parametrize(("true_m", "hypothesis"), [(5.0, "at least"), (5.0, "at most")])
def test_a_distance_that_is_true_is_rarely_rejected(true_m, hypothesis):
    trials, rng = 4000, np.random.default_rng(11)
    angle = rng.uniform(0, 2 * np.pi, trials)
    baseline_m = true_m * np.column_stack([np.sin(angle), np.cos(angle), rng.uniform(-1, 1, trials)])
    ranges_m = draw_tracks(rng, (trials, 10, 7, 2))
    ranges_m[..., 1] -= (baseline_m @ draw_sky().T)[:, None, :]
    values, gain, matrix = compute_contrasts(ranges_m, np.ones((7, 2)))
    levels = average_contrasts(values, gain, WHITE)
    p = distance_p_value(levels, estimate_baselines(levels, baseline_design(matrix, draw_sky())), 5.0, hypothesis)
    # At the rim of the hypothesis; the region is a disc or its outside, not a point, so fewer than stated.
    assert binomial_survival(int(np.sum(p < 0.01)), trials, 0.01) > 1e-3


def test_one_antenna_is_told_from_a_distance():
    ranges_m = draw_tracks(np.random.default_rng(12), (100, 30, 7, 2))
    values, gain, matrix = compute_contrasts(ranges_m, np.ones((7, 2)))
    levels = average_contrasts(values, gain, WHITE)
    baseline = estimate_baselines(levels, baseline_design(matrix, draw_sky()))
    assert np.mean(distance_p_value(levels, baseline, 5.0, "at least") < 1e-3) > 0.95
    assert np.mean(distance_p_value(levels, baseline, 5.0, "at most") == 1.0) > 0.95


def test_epochs_that_are_missing_are_known_by_their_gaps():
    rng = np.random.default_rng(13)
    kept = np.array([0, 1, 2, 6, 7, 8, 9, 14, 15, 16])
    ranges_m = draw_tracks(rng, (2000, 17, 6, 2), phi=0.9)[:, kept]
    values, gain, _ = compute_contrasts(ranges_m, np.ones((6, 2)))
    noise = TrackNoise(miss_probability=1e-3)
    count = np.sum(one_antenna_test(average_contrasts(values, gain, noise, np.diff(kept).astype(float))).p_value < 0.01)
    assert binomial_survival(int(count), 2000, 0.01) > 1e-3
