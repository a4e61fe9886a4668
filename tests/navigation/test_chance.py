from itertools import combinations
from math import gamma

import numpy as np
import pytest
from scipy import stats

from skyproof.navigation.chance import bound_chance_p_value, count_set_combinations


def design(rng, k):
    unit = rng.standard_normal((k, 3))
    unit[:, 2] = np.abs(unit[:, 2]) + 0.3
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return np.concatenate((-unit, np.ones((k, 1))), axis=1)


def compute_statistic(h, sigma, z):
    """Compute the statistic of the least-squares fit for many z (n, k)."""
    q, _ = np.linalg.qr(h / sigma[:, None])
    y = z / sigma
    return np.sum(y**2, axis=1) - np.sum((y @ q) ** 2, axis=1)


def compute_four_probability(h, sigma, window, limit):
    """Compute the volume of the other signals' ellipsoid by the best four over that of the window."""
    k = len(sigma)
    volumes = []
    for four in combinations(range(k), 4):
        rest = [i for i in range(k) if i not in four]
        if abs(np.linalg.det(h[list(four)])) < 1e-9:
            continue
        g = h[rest] @ np.linalg.inv(h[list(four)])
        c = np.diag(sigma[rest] ** 2) + g @ np.diag(sigma[list(four)] ** 2) @ g.T
        d = k - 4
        ball = np.pi ** (d / 2) / gamma(d / 2 + 1)
        volumes.append(ball * limit ** (d / 2) * np.sqrt(np.linalg.det(c)) / window**d)
    return min(volumes)


@pytest.mark.parametrize("k", [5, 6, 7])
def test_the_bound_holds_for_any_geometry_and_is_not_idle(k):
    rng = np.random.default_rng(k)
    for _ in range(4):
        h, sigma = design(rng, k), rng.uniform(1.0, 2.0, k)
        window, limit = 40.0 if k > 5 else 200.0, 9.0
        inside = compute_statistic(h, sigma, rng.uniform(0.0, window, (400_000, k))) <= limit
        bound = bound_chance_p_value(sigma, window_m=window, largest_statistic=limit)
        upper = stats.beta(inside.sum() + 1, inside.size - inside.sum()).ppf(0.001)  # surely not less than this
        assert upper <= bound
        assert inside.mean() >= bound / 200.0
        exact = compute_four_probability(h, sigma, window, limit)
        assert upper <= exact <= bound * (1 + 1e-12)


def test_without_a_cut_of_the_ellipsoid_the_volume_is_exact():
    rng = np.random.default_rng(1)
    h = design(rng, 5)
    h[:, :3] *= 0.2  # mild prediction: the fifth is never far outside the window
    h[4] = h[:4].mean(axis=0)
    sigma = np.array([1.0, 1.5, 1.2, 0.8, 1.1])
    inside = compute_statistic(h, sigma, rng.uniform(0.0, 300.0, (400_000, 5))) <= 4.0
    g = h[4:] @ np.linalg.inv(h[:4])
    c = sigma[4] ** 2 + g @ np.diag(sigma[:4] ** 2) @ g.T
    exact = 2.0 * np.sqrt(4.0 * c[0, 0]) / 300.0
    assert stats.binomtest(int(inside.sum()), inside.size, exact).pvalue > 1e-3
    assert exact <= bound_chance_p_value(sigma, window_m=300.0, largest_statistic=4.0)


def test_the_union_bound_holds_over_all_sets_that_can_be_formed():
    rng = np.random.default_rng(2)
    h, copies, sigma, window, limit = design(rng, 6), 2, np.ones(6), 400.0, 6.0
    delays = rng.uniform(0.0, window, (40_000, 6, copies))
    some = np.zeros(len(delays), bool)
    for five in combinations(range(6), 5):
        for pick in np.ndindex(*(copies,) * 5):
            z = delays[:, five, pick]
            some |= compute_statistic(h[list(five)], sigma[:5], z) <= limit
    count = count_set_combinations([copies] * 6, 5)
    assert count == 6 * 2**5
    bound = bound_chance_p_value(np.ones(5), window_m=window, largest_statistic=limit, combinations=count)
    assert some.mean() <= bound
    single = bound_chance_p_value(np.ones(5), window_m=window, largest_statistic=limit)
    assert some.mean() > 2.0 * single  # one set alone would be far too bold


def test_combinations_are_counted():
    assert count_set_combinations([1] * 12, 12) == 1
    assert count_set_combinations([2, 3, 1], 2) == 2 * 3 + 2 * 1 + 3 * 1
    np.testing.assert_array_equal(count_set_combinations([2, 2, 2], [0, 1, 2, 3, 4]), [1, 6, 12, 8, 0])


def test_four_always_fit_and_leading_axes_are_free():
    np.testing.assert_array_equal(
        bound_chance_p_value(np.ones((3, 4)), window_m=1e5, largest_statistic=1.0), np.ones(3)
    )
    sigma = np.random.default_rng(3).uniform(1.0, 4.0, (2, 3, 8))
    together = bound_chance_p_value(
        sigma, window_m=np.array([1e3, 1e4, 3e5]), largest_statistic=20.0, combinations=100.0
    )
    assert together.shape == (2, 3)
    alone = bound_chance_p_value(sigma[1, 2], window_m=3e5, largest_statistic=20.0, combinations=100.0)
    np.testing.assert_allclose(together[1, 2], alone)
    assert (np.diff(together, axis=1) < 0).all()
    assert bound_chance_p_value(np.ones(5), window_m=1.0, largest_statistic=20.0) == 1.0
