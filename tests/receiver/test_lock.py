"""The lock statistic: what it says of noise and of a held signal, and how often it errs."""

import numpy as np
import pytest
from scipy import stats

from skyproof.receiver.lock import lock_threshold, lock_value


def average_lock(rng, cn0_dbhz, *, prompt_s, n_prompts, n_frames, n_looks):
    """Average the lock value of snapshots of a signal on the real axis, noise of variance 1 in both parts."""
    amplitude = np.sqrt(2.0 * 10.0 ** (0.1 * cn0_dbhz) * prompt_s)
    in_phase = amplitude + rng.normal(size=(n_looks, n_frames, n_prompts))
    beside = rng.normal(size=(n_looks, n_frames, n_prompts))
    return lock_value(np.sum(in_phase**2, axis=-1), np.sum(beside**2, axis=-1)).mean(axis=-1)


def test_a_real_signal_gives_one_and_no_signal_gives_zero():
    assert lock_value(np.array([4.0, 1.0, 0.0, 0.0]), np.array([0.0, 1.0, 2.0, 0.0])).tolist() == [1.0, 0.0, -1.0, 0.0]


@pytest.mark.parametrize(
    ("n_prompts", "n_frames"),
    [
        (5, 1),
        (20, 1),
        (100, 1),
        (5, 2),
        (20, 2),
        pytest.param(100, 2, marks=pytest.mark.long),
        (5, 5),
        (20, 5),
        pytest.param(100, 5, marks=pytest.mark.long),
    ],
)
def test_noise_is_held_as_often_as_stated(n_prompts, n_frames):
    rng = np.random.default_rng(n_prompts + n_frames)
    n_looks, stated = 60_000, 5e-3
    looks = average_lock(rng, -np.inf, prompt_s=1e-3, n_prompts=n_prompts, n_frames=n_frames, n_looks=n_looks)
    held = int(np.sum(looks > lock_threshold(n_prompts, n_frames, stated)))
    if n_frames == 1:  # exact
        assert stats.binomtest(held, n_looks, stated).pvalue > 1e-4
    else:
        assert 0.7 * stated < held / n_looks < 1.2 * stated


def test_the_threshold_of_one_frame_is_that_of_the_beta_law():
    limit = float(lock_threshold(100, 1, 1e-4))
    assert stats.beta(50.0, 50.0).sf(0.5 * (limit + 1.0)) == pytest.approx(1e-4, rel=1e-6)


def test_a_longer_look_needs_less():
    limits = [float(lock_threshold(20, n, 1e-4)) for n in (1, 2, 5, 20)]
    assert limits == sorted(limits, reverse=True)
    assert lock_threshold(np.array([5, 20]), 5, 1e-4).shape == (2,)


@pytest.mark.parametrize(("prompt_s", "n_prompts"), [(5e-3, 20), (20e-3, 5)])
def test_a_signal_of_30_dbhz_is_hardly_ever_taken_for_lost(prompt_s, n_prompts):
    rng = np.random.default_rng(7)
    looks = average_lock(rng, 30.0, prompt_s=prompt_s, n_prompts=n_prompts, n_frames=5, n_looks=20_000)
    assert np.mean(looks < lock_threshold(n_prompts, 5, 1e-4)) < 1e-3


def test_the_statistic_does_not_know_the_power():
    rng = np.random.default_rng(3)
    i_squares, q_squares = rng.chisquare(10, (2, 50))
    np.testing.assert_allclose(lock_value(i_squares, q_squares), lock_value(1e6 * i_squares, 1e6 * q_squares))
