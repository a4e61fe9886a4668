import itertools

import numpy as np
import pytest

from skyproof.statistics.cusum import cusum_path, cusum_step, cusum_within
from skyproof.studies.run_lengths import cusum_run_length, cusum_threshold, page_run_length, page_threshold


def count_run_length(reference, threshold, degrees, trials, rng, run):
    """Average the first passage of `trials` sums that start at zero."""
    lengths, alive, steps = np.zeros(trials), np.arange(trials), 0
    state = np.zeros((trials, degrees))
    while alive.size:
        path = run(rng.standard_normal((alive.size, 200, degrees)), reference, state)
        over = path.size > threshold
        hit = over.any(axis=1)
        lengths[alive[hit]] = steps + 1 + over[hit].argmax(axis=1)
        alive, state, steps = alive[~hit], path.state[~hit], steps + 200
    return lengths.mean(), lengths.std() / np.sqrt(trials)


# From 300 cells of a Markov chain, an independent discretisation with an error of about 0.3 % in h at k = 0.25.
@pytest.mark.parametrize(
    ("mean_steps", "reference", "threshold"),
    [
        (1e3, 0.5, 10.547),
        (1e6, 0.25, 36.40),
        (1e6, 0.5, 19.36),
        (1e6, 1.0, 9.876),
        (2e5, 1.0, 8.925),
        (1e5, 0.25, 30.66),
        (1e5, 0.5, 16.57),
        (1e5, 1.0, 8.509),
        (3e6, 1.0, 10.516),
        (3e5, 1.0, 9.166),
    ],
)
def test_thresholds_are_those_of_the_chain_with_cells(mean_steps, reference, threshold):
    cells = 0.003 if reference < 0.5 else 0.001  # their error
    assert cusum_threshold(mean_steps, reference, 4) == pytest.approx(threshold, rel=cells)


def test_threshold_gives_back_the_run_length():
    assert cusum_run_length(0.5, cusum_threshold(5000.0, 0.5, 6), 6) == pytest.approx(5000.0, rel=1e-4)


def test_run_length_is_what_is_counted():
    mean, error = count_run_length(0.5, 8.0, 4, 3000, np.random.default_rng(1), cusum_path)
    assert cusum_run_length(0.5, 8.0, 4) == pytest.approx(mean, abs=4.0 * error)


def test_run_length_in_one_dimension_is_two_sided():
    mean, error = count_run_length(0.5, 3.0, 1, 4000, np.random.default_rng(2), cusum_path)
    assert cusum_run_length(0.5, 3.0, 1) == pytest.approx(mean, abs=4.0 * error)


@pytest.mark.parametrize(
    ("reference", "steps", "degrees", "size"),
    [(0.5, 2, 2, 4.0), (1.0, 20, 2, 3.2), (0.5, 2, 8, 13.0), (2.0, 50, 5, 3.0)],
)
def test_a_windows_largest_sum_has_the_stationary_law(reference, steps, degrees, size):
    rng, trials = np.random.default_rng(3), 8000
    before = cusum_path(rng.standard_normal((trials, 120, degrees)), reference)
    largest = cusum_path(rng.standard_normal((trials, steps, degrees)), reference, before.state).size.max(axis=1)
    found = cusum_within(size, steps, reference, degrees)
    assert 0.01 < found < 0.2
    assert np.mean(largest > size) == pytest.approx(found, abs=4.0 * np.sqrt(found / trials))


def test_small_window_probabilities_keep_their_digits():
    # Between alarms a sum of k = 1 passes a high threshold alone: steps over the run length, and more by what lasts.
    high = 14.0
    rare = cusum_within(high, 20, 1.0, 2)
    assert 1.0 < rare * cusum_run_length(1.0, high, 2) / 20 < 1.2
    sizes = [cusum_within(size, 20, 1.0, 2) for size in (1.0, 5.0, 20.0, 40.0, 59.0)]
    assert all(later < 1e-2 * sooner for sooner, later in itertools.pairwise(sizes[1:]))
    assert sizes[0] > 0.9
    assert sizes[-1] > 0.0
    assert cusum_within(90.0, 20, 1.0, 2) == cusum_within(60.0, 20, 1.0, 2)


# D. C. Montgomery, Introduction to Statistical Quality Control, 6th edition, table 9.3: two-sided 168 and 465;
# one-sided runs are twice as long.
@pytest.mark.parametrize(("threshold", "two_sided"), [(4.0, 168.0), (5.0, 465.0)])
def test_page_run_length_is_that_of_the_table(threshold, two_sided):
    assert page_run_length(0.5, threshold) / 2.0 == pytest.approx(two_sided, abs=0.6)
    assert page_threshold(2.0 * two_sided, 0.5) == pytest.approx(threshold, abs=0.01)


def test_the_sum_in_pieces_gives_what_the_whole_gives():
    y = np.random.default_rng(3).standard_normal((5, 40, 3)) + 0.5
    whole = cusum_path(y, 0.5)
    first = cusum_path(y[:, :13], 0.5)
    second = cusum_path(y[:, 13:], 0.5, first.state)
    np.testing.assert_array_equal(np.concatenate((first.size, second.size), axis=1), whole.size)
    np.testing.assert_array_equal(second.state, whole.state)


def test_a_step_shortens_the_sum_by_the_reference():
    s = cusum_step(np.array([3.0, 4.0]), np.array([3.0, 4.0]), 0.5)
    np.testing.assert_allclose(s, np.array([6.0, 8.0]) * 0.95)
    np.testing.assert_array_equal(cusum_step(np.zeros(2), np.array([0.3, 0.0]), 0.5), np.zeros(2))


def test_a_threshold_out_of_reach_is_refused():
    with pytest.raises(ValueError, match="larger reference"):
        cusum_threshold(1e9, 0.05, 4)


@pytest.mark.long
def test_run_length_at_a_low_rate_is_what_is_counted():
    mean, error = count_run_length(1.0, 7.0, 4, 1500, np.random.default_rng(4), cusum_path)
    assert cusum_run_length(1.0, 7.0, 4) == pytest.approx(mean, abs=4.0 * error)
