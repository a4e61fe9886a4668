import numpy as np

from skyproof.navigation.least_squares import compute_line_of_sight, fit_position, invert_spd


def test_the_inverse_is_that_of_numpy():
    root = np.random.default_rng(1).standard_normal((50, 7, 4))
    matrix = np.swapaxes(root, -1, -2) @ root
    np.testing.assert_allclose(invert_spd(matrix), np.linalg.inv(matrix), rtol=1e-9, atol=1e-12)


def test_a_singular_matrix_is_nan_and_leaves_the_others_alone():
    matrix = np.stack((np.eye(4), np.ones((4, 4)), 4.0 * np.eye(4), np.zeros((4, 4))))
    inverse = invert_spd(matrix)
    np.testing.assert_array_equal(np.isnan(inverse).any(axis=(1, 2)), [False, True, False, True])
    np.testing.assert_allclose(inverse[2], np.eye(4) / 4.0)


def test_the_distance_solves_the_light_time_equation():
    rng = np.random.default_rng(3)
    position = rng.standard_normal((200, 3))
    position *= 6.37e6 / np.linalg.norm(position, axis=1, keepdims=True)
    satellite = position + rng.uniform(0.5, 1.5, (200, 1)) * position + 1.8e7 * rng.standard_normal((200, 3))
    travel_s = np.full(200, 0.07)
    for _ in range(10):  # a thing fixed to the Earth turns by its rate times the travel time until reception
        angle = 7.2921151467e-5 * travel_s
        x = np.cos(angle) * satellite[:, 0] + np.sin(angle) * satellite[:, 1]
        y = np.cos(angle) * satellite[:, 1] - np.sin(angle) * satellite[:, 0]
        seen = np.stack((x, y, satellite[:, 2]), axis=1)
        travel_s = np.linalg.norm(seen - position, axis=1) / 299792458.0
    turned, unit, distance = compute_line_of_sight(satellite[:, None, :], position)
    np.testing.assert_allclose(distance[:, 0], 299792458.0 * travel_s, rtol=0.0, atol=2e-8)
    np.testing.assert_allclose(turned[:, 0], position + distance * unit[:, 0], atol=1e-7)


def test_problems_solve_together_as_alone_without_unused_ranges():
    rng = np.random.default_rng(2)
    satellite = rng.standard_normal((6, 8, 3))
    satellite[..., 2] = np.abs(satellite[..., 2]) + 0.5
    satellite *= 2.66e7 / np.linalg.norm(satellite, axis=-1, keepdims=True)
    position = np.array([100e3, -200e3, 6.3e6]) + 1e5 * rng.standard_normal((6, 3))
    clock = rng.uniform(-3e8, 3e8, 6)
    _, _, distance = compute_line_of_sight(satellite, position)
    ranges = distance + clock[:, None]
    ranges[:, 7] = 1e9 * rng.standard_normal(6)
    ranges[2, 3:] = np.nan
    sigma = np.ones_like(ranges)
    sigma[:, 7] = np.nan
    together = fit_position(satellite, ranges, sigma, np.zeros((6, 4)))
    solvable = [0, 1, 3, 4, 5]
    np.testing.assert_allclose(together.state_m[solvable, :3], position[solvable], atol=1e-5)
    np.testing.assert_allclose(together.state_m[solvable, 3], clock[solvable], atol=1e-5)
    assert np.isnan(together.state_m[2]).all()
    alone = fit_position(satellite[4], ranges[4], sigma[4], np.zeros(4))
    np.testing.assert_allclose(alone.state_m, together.state_m[4], atol=1e-6)
    np.testing.assert_array_equal(together.residual_m[:, 7], 0.0)
