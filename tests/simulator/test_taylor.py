"""Series against those of closed forms, coefficient by coefficient."""

import numpy as np

from skyproof.simulator.taylor import (
    compute_reciprocal_root,
    compute_sine_cosine,
    differentiate,
    evaluate_polynomial,
    integrate,
    multiply,
    multiply_cross,
    multiply_dot,
    normalise,
)

T = np.array([[0.0], [1.0], [0.0], [0.0], [0.0]])  # the time itself, around 0
ONE = np.array([[1.0], [0.0], [0.0], [0.0], [0.0]])


def test_products_and_polynomials():
    np.testing.assert_array_equal(multiply(ONE + T, ONE - T)[:, 0], [1, 0, -1, 0, 0])
    np.testing.assert_array_equal(evaluate_polynomial((1.0, 2.0, 3.0), ONE + T)[:, 0], [6, 4, 1, 0, 0])
    assert multiply(T[:3], T).shape == (3, 1)


def test_the_reciprocal_root_of_a_square_is_the_geometric_series():
    np.testing.assert_allclose(compute_reciprocal_root(multiply(ONE + T, ONE + T))[:, 0], [1, -1, 1, -1, 1], atol=1e-15)


def test_sine_and_cosine_of_a_square():
    # sin(a + t^2) and cos(a + t^2), by their own series in t^2.
    sine, cosine = compute_sine_cosine(0.5 * ONE + multiply(T, T))
    s, c = np.sin(0.5), np.cos(0.5)
    np.testing.assert_allclose(sine[:, 0], [s, 0, c, 0, -s / 2], atol=1e-15)
    np.testing.assert_allclose(cosine[:, 0], [c, 0, -s, 0, -c / 2], atol=1e-15)


def test_derivative_undoes_the_integral():
    series = np.random.default_rng(1).standard_normal((5, 3, 7))
    np.testing.assert_allclose(differentiate(integrate(series, np.ones((3, 7)))), series)
    np.testing.assert_array_equal(integrate(series, np.ones((3, 7)))[0], 1.0)


def test_vectors():
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((2, 4, 3, 7))
    np.testing.assert_allclose(multiply_dot(a, multiply_cross(a, b)), 0.0, atol=1e-14)
    np.testing.assert_allclose(multiply_cross(a, b)[0].T, np.cross(a[0].T, b[0].T))
    length = multiply_dot(normalise(a), normalise(a))
    np.testing.assert_allclose(length[0], 1.0)
    np.testing.assert_allclose(length[1:], 0.0, atol=1e-10)
