"""Inverse RAIM: the sets that pass, by two ways and by brute force; their clusters, subsets, attacks on time."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.detectors.dccaf.inverse_raim import find_passing_sets, find_second_subset, parity_matrix, set_states
from skyproof.studies.inverse_raim_choice import clusters, complementary_pair, innovations, inverse_raim, timing_only

UP_EAST = np.array([1.0, 0.0, 1.0]) * np.sqrt(0.5)


def draw_sky(rng, n):
    """Draw unit vectors east, north, up above 10 degrees, in a geometry that can be used."""
    while True:
        up, turn = rng.uniform(0.17, 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
        across = np.sqrt(1.0 - up**2)
        units = np.stack([across * np.sin(turn), across * np.cos(turn), up], axis=1)
        design = np.concatenate((-units, np.ones((n, 1))), axis=1)
        if np.linalg.cond(design) < 20.0:
            return units


def draw_two_skies(rng, n, sigma_m, offset_m, *, late_m=0.0):
    units = draw_sky(rng, n)
    misfit = sigma_m * rng.standard_normal((n, 2))
    misfit[:, 1] += late_m - offset_m * (units @ UP_EAST)
    return units, misfit


def test_parity_rows_are_orthonormal_and_blind_to_the_fix():
    rng = np.random.default_rng(1)
    for n in (5, 6, 12):
        units = draw_sky(rng, n)
        parity = parity_matrix(units)
        assert parity.shape == (n - 4, n)
        assert np.allclose(parity @ parity.T, np.eye(n - 4), atol=1e-12)
        assert np.allclose(parity @ np.concatenate((-units, np.ones((n, 1))), axis=1), 0.0, atol=1e-12)
        assert np.allclose(np.tril(parity, -1), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("n", "rate", "norm"),
    [
        (5, 1e-3, 3.29),
        (6, 1e-3, 3.72),
        (8, 1e-3, 4.30),
        (12, 1e-3, 5.11),
        (5, 1e-2, 2.58),
        (9, 1e-2, 3.88),
    ],
)
def test_thresholds_are_those_of_the_guide(n, rate, norm):
    found = find_passing_sets(draw_sky(np.random.default_rng(2), n), np.zeros((n, 1)), false_alarm_probability=rate)
    assert np.sqrt(found.threshold) == pytest.approx(norm, abs=0.006)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(5, 7), most=st.integers(1, 3))
def test_both_searches_match_least_squares_of_every_set(seed, n, most):
    rng = np.random.default_rng(seed)
    units, sigma = draw_sky(rng, n), rng.uniform(0.5, 3.0, n)
    misfit = rng.normal(0.0, 2.0, (n, most))
    counts = rng.integers(1, most + 1, n)
    misfit[np.arange(most) >= counts[:, None]] = np.nan
    design = np.concatenate((-units, np.ones((n, 1))), axis=1) / sigma[:, None]
    found = find_passing_sets(units, misfit, sigma, false_alarm_probability=0.1)
    expected = {}
    for choice in product(*(range(count) for count in counts)):
        z = misfit[np.arange(n), choice] / sigma
        residual = z - design @ np.linalg.lstsq(design, z, rcond=None)[0]
        if residual @ residual <= found.threshold:
            expected[choice] = residual @ residual
    for exhaustive in (True, False):
        sets = find_passing_sets(units, misfit, sigma, false_alarm_probability=0.1, exhaustive=exhaustive)
        assert {tuple(row): pytest.approx(s, abs=1e-9) for row, s in zip(sets.choice, sets.statistic, strict=True)} == (
            expected
        )
        assert sets.tried == np.prod(counts)


def test_both_searches_agree_on_all_531441_sets_of_twelve():
    rng = np.random.default_rng(3)
    units = draw_sky(rng, 12)
    misfit = rng.normal(0.0, 30.0, (12, 3))
    misfit[:, 0] = rng.standard_normal(12)
    every, pruned = (find_passing_sets(units, misfit, 1.0, exhaustive=kind) for kind in (True, False))
    assert every.tried == 531_441
    assert np.array_equal(every.choice, pruned.choice)
    assert [0] * 12 in every.choice.tolist()


def test_passing_sets_beyond_the_room_are_all_reported():
    rng = np.random.default_rng(4)
    units = draw_sky(rng, 8)
    misfit = 0.01 * rng.standard_normal((8, 3))
    found = find_passing_sets(units, misfit, 1.0)
    assert len(found.statistic) == 3**8 == len({tuple(row) for row in found.choice})
    assert np.all(np.diff(found.statistic) >= 0.0)


def test_a_true_set_fails_as_often_as_stated():
    rng = np.random.default_rng(5)
    fails = sum(
        len(find_passing_sets(draw_sky(rng, n), rng.standard_normal((n, 1)), false_alarm_probability=0.05).statistic)
        == 0
        for n in (5, 7, 9)
        for _ in range(1000)
    )
    assert abs(fails - 150) < 4 * np.sqrt(150 * 0.95)


def test_four_satellites_are_refused():
    with pytest.raises(ValueError, match="always fit"):
        find_passing_sets(np.eye(4, 3), np.zeros((4, 2)))


def test_the_two_pure_sets_pass_and_complement_each_other():
    rng = np.random.default_rng(6)
    right = 0
    for _ in range(100):
        units, misfit = draw_two_skies(rng, 8, 1.0, 300.0)
        found = inverse_raim(units, misfit, 1.0)
        if found.pair is None or found.sets.choice[list(found.pair)].sum() != 8:
            continue  # a pure set failed its test, as one in a thousand does
        right += sorted(found.sets.choice[list(found.pair)].sum(axis=1).tolist()) == [0, 8]
        assert not found.timing_only
        false = found.pair[int(np.argmax(found.sets.choice[list(found.pair)].sum(axis=1)))]
        if found.sets.choice[false].sum() == 8:
            apart = found.state_m[false] - np.append(300.0 * UP_EAST, 0.0)
            assert apart @ np.linalg.solve(found.covariance_m2, apart) < 27.0
    assert right >= 90


def test_mixed_sets_pass_about_as_often_as_the_guide_counts():
    rng = np.random.default_rng(7)
    mixed = []
    for _ in range(300):
        units, misfit = draw_two_skies(rng, 8, 3.0, 30.0)
        choice = inverse_raim(units, misfit, 3.0).sets.choice
        mixed.append(np.sum(~np.isin(choice.sum(axis=1), (0, 8))))
    assert 35.0 < np.mean(mixed) < 75.0  # guide: 47, in its own geometries


def test_an_attack_on_time_alone_is_reported():
    rng = np.random.default_rng(8)
    late, moved = [], []
    for _ in range(50):
        units, misfit = draw_two_skies(rng, 7, 1.0, 0.0, late_m=100.0)
        late.append(inverse_raim(units, misfit, 1.0).timing_only)
        units, misfit = draw_two_skies(rng, 8, 1.0, 300.0)
        moved.append(inverse_raim(units, misfit, 1.0).timing_only)
    assert np.mean(late) > 0.9
    assert not any(moved)
    covariance = np.eye(4)
    assert not timing_only(np.zeros(4), np.array([0.0, 0.0, 0.0, 4.6]), covariance)
    assert timing_only(np.zeros(4), np.array([0.0, 0.0, 0.0, 4.7]), covariance)  # 3.29 sigma of a difference: 4.65
    assert timing_only(np.zeros(4), np.array([5.6, 0.0, 0.0, 20.0]), covariance)
    assert not timing_only(np.zeros(4), np.array([5.8, 0.0, 0.0, 20.0]), covariance)  # 16.27 of chi-square: 5.70


def test_clusters_gather_fixes_of_one_place():
    states = np.array([[0.0, 0, 0, 0], [100, 0, 0, 0], [1, 0, 0, 0], [101, 1, 0, 0], [0, 0, 0, 50]])
    cluster, leader = clusters(states, np.eye(4))
    assert cluster.tolist() == [0, 1, 0, 1, 2]
    assert leader.tolist() == [0, 1, 4]


def test_complements_need_satellites_with_several_signals():
    choice = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert complementary_pair(choice, np.array([True, True, False])) == (0, 2)
    assert complementary_pair(choice, np.array([True, True, True])) is None
    assert complementary_pair(choice, np.zeros(3, bool)) is None


def test_five_false_of_eight_are_found_and_four_never():
    rng = np.random.default_rng(9)
    for false, wanted in ((5, 5), (4, None)):
        units, misfit = draw_two_skies(rng, 8, 1.0, 300.0)
        misfit[false:, 1] = np.nan
        found = find_second_subset(units, misfit, 1.0, np.zeros(8, np.int64))
        assert (None if found is None else len(found[0])) == wanted


def test_a_second_signal_off_the_set_stands_out_by_its_sigma():
    rng = np.random.default_rng(10)
    units = draw_sky(rng, 8)
    values = np.concatenate(
        [innovations(units, rng.standard_normal((8, 2)), 1.0, np.zeros(8, np.int64))[:, 1] for _ in range(2000)]
    )
    assert values.std() == pytest.approx(1.0, abs=0.03)
    state, covariance = set_states(units, -(units @ [10.0, 0, 0])[:, None], 1.0, np.zeros((1, 8), np.int64))
    assert np.allclose(state[0], [10.0, 0, 0, 0], atol=1e-9)
    assert covariance.shape == (4, 4)
