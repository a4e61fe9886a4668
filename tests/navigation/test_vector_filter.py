"""The navigation filter of a vector receiver, on ranges and rates that are drawn."""

import numpy as np
import pytest
from scipy import stats

from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.vector_filter import (
    VectorEpoch,
    VectorSettings,
    VectorState,
    dopplers_from_rates,
    predict_measurements,
    propagate_state,
    rates_from_dopplers,
    start_state,
    update_state,
)
from skyproof.navigation.vector_sky import SkyEpoch

STEP_S, SIGMA_M, SIGMA_M_S = 0.2, 1.0, 0.05
L1_HZ = 1575.42e6
SETTINGS = VectorSettings()
TRUE = np.array([4.0e6, 7.0e5, 4.9e6, 3.0, -2.0, 1.0, 5e4, 30.0])


def draw_sky(n=8, seed=4):
    """Draw satellites anywhere above the horizon."""
    rng = np.random.default_rng(seed)
    up = TRUE[:3] / np.linalg.norm(TRUE[:3])
    away = rng.standard_normal((200, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    away = away[away @ up > 0.2][:n]
    zeros, ones = np.zeros(n), np.ones(n)
    return SkyEpoch(TRUE[:3] + 2.2e7 * away, zeros, zeros, ones, 500.0 * rng.standard_normal(n), ones, zeros)


SKY = draw_sky()


def measure(truth, rng, sky_epoch=SKY):
    range_m, rate_m_s, _ = predict_measurements(truth, sky_epoch)
    n = range_m.size
    return VectorEpoch(
        range_m + rng.normal(0.0, SIGMA_M, n),
        np.full(n, SIGMA_M),
        rate_m_s + rng.normal(0.0, SIGMA_M_S, n),
        np.full(n, SIGMA_M_S),
    )


def move(truth, step_s=STEP_S):
    after = truth.copy()
    after[:3] += step_s * truth[3:6]
    after[6] += step_s * truth[7]
    return after


def run(state, truth, rng, steps, change=lambda epoch: epoch, drives=None):
    """Run the filter over so many epochs; return the outcomes, and the truth at the end."""
    drives = np.ones(8, bool) if drives is None else drives
    outcomes = []
    for _ in range(steps):
        truth = move(truth)
        before = propagate_state(state, state.elapsed_s + STEP_S, SETTINGS)
        outcomes.append(
            update_state(before, change(measure(truth, rng)), predict_measurements(before.mean, SKY), drives, SETTINGS)
        )
        state = outcomes[-1].state
    return outcomes, truth


def draw_start(rng):
    return start_state(measure(TRUE, rng), SKY, TRUE[:3] + 300.0, 0.0)


def test_the_error_is_what_the_covariance_says():
    squares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        outcomes, truth = run(draw_start(rng), TRUE, rng, 10)
        error = outcomes[-1].state.mean - truth
        squares.append(error @ np.linalg.solve(outcomes[-1].state.covariance, error))
        assert not any(outcome.diverged for outcome in outcomes)
    # The truth moves evenly, so that the errors are smaller than with the accelerations that are allowed for.
    assert np.mean(squares) < stats.chi2.isf(1e-3, 8 * 60) / 60
    assert np.mean(squares) > 0.25 * 8


@pytest.mark.parametrize(
    "off", [(100.0, 0, 0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0, 299792.458, 0), (0, 0, 0, 9, 9, 0, 0, 0)]
)
def test_a_state_gone_wrong_is_noticed_within_a_second(off):
    rng = np.random.default_rng(1)
    outcomes, truth = run(draw_start(rng), TRUE, rng, 10)
    sure = outcomes[-1].state
    for held in (np.zeros((8, 8)), sure.covariance):  # that does not learn, and that would
        wrong = VectorState(elapsed_s=sure.elapsed_s, mean=sure.mean + np.array(off), covariance=held)
        after, _ = run(wrong, truth, rng, 5)
        home = np.linalg.norm(after[-1].state.mean[:3] - truth[:3]) < 20.0
        assert any(item.diverged for item in after) or home


def test_an_unfitting_signal_moves_the_state_as_least_squares():
    rng = np.random.default_rng(2)
    false_m = 117.0 * np.eye(8)[3]
    outcomes, truth = run(draw_start(rng), TRUE, rng, 30, lambda e: e._replace(range_m=e.range_m + false_m))
    assert not any(outcome.diverged for outcome in outcomes)
    _, unit, _ = compute_line_of_sight(SKY.satellite_ecef_m, truth[:3])
    design = np.column_stack((-unit, np.ones(8)))
    projector = np.eye(8) - design @ np.linalg.pinv(design)
    left_m = np.mean([outcome.range_left_m for outcome in outcomes[10:]], axis=0)
    np.testing.assert_allclose(left_m, projector @ false_m, atol=2.0)
    pulled = outcomes[-1].state.mean[[0, 1, 2, 6]] - truth[[0, 1, 2, 6]]
    np.testing.assert_allclose(pulled, np.linalg.pinv(design) @ false_m, atol=15.0)


def test_who_does_not_drive_the_filter_does_not_move_it():
    rng, drives = np.random.default_rng(3), np.arange(8) != 3
    outcomes, truth = run(
        draw_start(rng), TRUE, rng, 20, lambda e: e._replace(range_m=e.range_m + 500.0 * ~drives), drives
    )
    assert np.linalg.norm(outcomes[-1].state.mean[:3] - truth[:3]) < 5.0
    assert np.isnan(outcomes[-1].range_left_m[3])


def test_without_measurements_the_state_goes_on_and_is_less_sure():
    rng = np.random.default_rng(4)
    outcomes, truth = run(draw_start(rng), TRUE, rng, 20)
    lost, truth = run(outcomes[-1].state, truth, rng, 25, lambda e: VectorEpoch(*(x * np.nan for x in e)))
    assert np.linalg.norm(lost[-1].state.mean[:3] - truth[:3]) < 5.0
    assert np.trace(lost[-1].state.covariance[:3, :3]) > 10 * np.trace(outcomes[-1].state.covariance[:3, :3])
    assert not lost[-1].diverged


def test_four_satellites_do_not_begin_a_filter():
    rng = np.random.default_rng(5)
    epoch = measure(TRUE, rng)
    few = epoch._replace(range_m=np.where(np.arange(8) < 4, epoch.range_m, np.nan))
    assert start_state(few, SKY, TRUE[:3], 0.0) is None


def test_rates_and_dopplers_are_each_others_inverse():
    doppler_hz = np.linspace(-4e3, 4e3, 8)
    sky_epoch = SKY._replace(moving=1.0 + 1e-6 * np.arange(8), satellite_drift=1e-11 * np.arange(8))
    back = dopplers_from_rates(sky_epoch, rates_from_dopplers(sky_epoch, doppler_hz, L1_HZ), L1_HZ)
    np.testing.assert_allclose(back, doppler_hz, atol=1e-6)
