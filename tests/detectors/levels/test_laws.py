"""The laws of levels: uniform p-values where they are exact, bounds where they are not."""

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.levels.laws import (
    OwnRate,
    OwnScale,
    chance_of_excess,
    estimate_shared_change,
    pattern_slope,
    split_in_two,
)
from skyproof.detectors.levels.policy import POLICY


def assert_uniform(p_values) -> bool:
    return stats.kstest(p_values, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("n", [6, 12, 40])
def test_the_median_change_has_the_stated_sigma(n) -> None:
    rng = np.random.default_rng(n)
    changes = [
        estimate_shared_change(0.5 * rng.standard_normal() + 2.0 * rng.standard_normal(n), fading_db=2.0, common_db=0.5)
        for _ in range(4000)
    ]
    normalised = np.array([change.change_db / change.sigma_db for change in changes])
    assert 0.9 < normalised.std() < 1.03  # the variance of a median of few is less than its limit


def test_a_single_satellite_moves_the_common_change_little() -> None:
    change_db = np.zeros(9)
    change_db[4] = -30.0
    assert estimate_shared_change(change_db, fading_db=2.0, common_db=0.5).change_db == 0.0


@pytest.mark.parametrize("earlier", [0, 3, 40])
def test_a_scale_of_its_own_past_keeps_the_rate(earlier) -> None:
    rng = np.random.default_rng(earlier)
    p_values = []
    for _ in range(2000):
        sigma = np.sqrt(POLICY.prior_degrees / rng.chisquare(POLICY.prior_degrees))
        scale = OwnScale()
        for _ in range(earlier):
            scale = scale.after(sigma * rng.standard_normal())
        p_values.append(scale.above(sigma * rng.standard_normal()))
    assert assert_uniform(p_values)
    assert stats.binomtest(int(np.sum(np.array(p_values) < 0.01)), 2000, 0.01).pvalue > 1e-3


@pytest.mark.parametrize("earlier", [0, 5, 40])
def test_losses_at_their_own_rate_are_no_surprise(earlier) -> None:
    rng = np.random.default_rng(earlier)
    p_values = []
    for _ in range(3000):
        probability = rng.beta(1.0, 9.0)
        rate = OwnRate()
        for _ in range(earlier):
            rate = rate.after(int(rng.binomial(10, probability)), 10)
        p_values.append(rate.above(int(rng.binomial(10, probability)), 10))
    for level in (0.3, 0.05, 0.01):  # a count is discrete: no more than the level
        assert (
            stats.binomtest(int(np.sum(np.array(p_values) <= level)), 3000, level, alternative="greater").pvalue > 1e-3
        )
    assert np.mean(np.array(p_values) <= 0.3) > 0.08


def test_the_loss_of_all_is_a_surprise_where_few_were_lost() -> None:
    rate = OwnRate()
    assert rate.above(0, 10) == pytest.approx(1.0)
    assert rate.above(10, 10) < 2e-5
    for _ in range(10):
        rate = rate.after(1, 10)
    assert rate.above(10, 10) < 1e-8
    assert rate.above(2, 10) > 0.2


def test_both_sides_of_a_scale_sum_to_one() -> None:
    scale = OwnScale().after(1.3).after(-0.4)
    assert scale.above(1.7) + scale.below(1.7) == pytest.approx(1.0)


def test_old_values_fade_from_a_scale() -> None:
    scale = OwnScale()
    for _ in range(500):
        scale = scale.after(3.0)
    assert scale.seen == pytest.approx(60.0)
    assert scale.sigma == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("windows", [1, 2, 6])
def test_the_slope_of_a_pattern_is_zero_of_a_clean_sky(windows) -> None:
    rng = np.random.default_rng(windows)
    statistics = []
    for _ in range(3000):
        own_db = 43.0 + 6.0 * rng.standard_normal(12)
        reference_db = own_db + 2.0 * rng.standard_normal(12) / np.sqrt(windows)
        change_db = own_db + 2.0 * rng.standard_normal(12) - reference_db
        found = pattern_slope(reference_db, change_db, fading_db=2.0, windows=np.full(12, windows))
        if found is not None:
            statistics.append(found[0] / found[1])
    assert abs(np.mean(statistics)) < 0.15
    assert 0.8 < np.std(statistics) < 1.2


def test_equal_power_has_the_slope_minus_one() -> None:
    own_db = np.array([36.0, 39.0, 42.0, 45.0, 48.0, 51.0])
    slope, sigma = pattern_slope(own_db, 44.0 - own_db, fading_db=1.0, windows=np.full(6, 1e9))
    assert slope == pytest.approx(-1.0)
    assert sigma == pytest.approx(1.0 / np.sqrt(np.sum((own_db - own_db.mean()) ** 2)))


def test_levels_that_hardly_differ_have_no_pattern() -> None:
    assert pattern_slope(np.full(8, 45.0), np.zeros(8), fading_db=2.0, windows=np.ones(8)) is None


def test_a_step_is_dated_to_its_row() -> None:
    values = np.r_[np.zeros(7), np.full(12, -6.0)]
    values[[2, 9]] = np.nan
    assert split_in_two(values) == 7
    assert split_in_two(np.array([np.nan, 1.0])) == 1


@pytest.mark.parametrize("seconds", [5, 10, 30])
def test_an_excess_of_noise_alone_has_the_chance_that_is_said(seconds: int) -> None:
    # At the highest level that a satellite's can have; the median of few readings is surer than its law.
    readings_db = POLICY.reading_sigma_db * np.random.default_rng(seconds).standard_normal((20_000, seconds))
    p_values = [chance_of_excess([over], [seconds], signals=1) for over in np.median(readings_db, axis=1)]
    for asked in (0.1, 0.01):
        below = int(np.sum(np.array(p_values) < asked))
        assert stats.binomtest(below, len(p_values), asked, alternative="greater").pvalue > 1e-4
        assert stats.binomtest(below, len(p_values), 0.5 * asked, alternative="less").pvalue > 1e-4
    assert chance_of_excess([0.0], [seconds], signals=8) == 1.0
