"""Compute exact derivatives: arithmetic on Taylor series in time.

A series is an array (order + 1, ..., n) for n moments: entry k is the k-th derivative over k!. What is worked out of
two series has the order of the shorter one. A vector stands in the last axis but one: (order + 1, 3, n).

The recurrences are those of automatic differentiation: Griewank and Walther, Evaluating Derivatives, 2nd ed., 13.2.
"""

from collections.abc import Sequence

import numpy as np

from skyproof.arrays import Reals

__all__ = [
    "compute_reciprocal_root",
    "compute_sine_cosine",
    "differentiate",
    "evaluate_polynomial",
    "integrate",
    "multiply",
    "multiply_cross",
    "multiply_dot",
    "normalise",
]


def multiply(a: Reals, b: Reals) -> Reals:
    """Multiply a and b; shapes broadcast behind the first axis."""
    order = min(len(a), len(b))
    out = np.zeros((order, *np.broadcast_shapes(a.shape[1:], b.shape[1:])))
    for k in range(order):
        for j in range(k + 1):
            out[k] += a[j] * b[k - j]
    return out


def multiply_dot(a: Reals, b: Reals) -> Reals:
    """Compute the scalar product of vectors: (order + 1, n)."""
    order = min(len(a), len(b))
    out = np.zeros((order, a.shape[-1]))
    for k in range(order):
        for j in range(k + 1):
            out[k] += np.einsum("in,in->n", a[j], b[k - j])
    return out


def multiply_cross(a: Reals, b: Reals) -> Reals:
    """Compute the vector product: (order + 1, 3, n)."""
    order = min(len(a), len(b))
    out = np.empty((order, 3, a.shape[-1]))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[:, i] = multiply(a[:, j], b[:, k]) - multiply(a[:, k], b[:, j])
    return out


def differentiate(a: Reals) -> Reals:
    """Differentiate to da/dt, one order less."""
    return a[1:] * _make_column(np.arange(1.0, len(a)), a)


def integrate(a: Reals, start: Reals) -> Reals:
    """Integrate to the series whose derivative is `a` and whose value is `start`, one order more."""
    return np.concatenate([start[np.newaxis], a / _make_column(np.arange(1.0, len(a) + 1), a)])


def compute_reciprocal_root(a: Reals) -> Reals:
    """Compute 1 / sqrt(a), for positive values."""
    out = np.empty_like(a)
    out[0] = 1.0 / np.sqrt(a[0])
    for k in range(1, len(a)):
        out[k] = sum((0.5 * j - k) * a[j] * out[k - j] for j in range(1, k + 1)) / (k * a[0])
    return out


def normalise(a: Reals) -> Reals:
    """Divide the vector by its length."""
    return multiply(a, compute_reciprocal_root(multiply_dot(a, a))[:, np.newaxis])


def compute_sine_cosine(a: Reals) -> tuple[Reals, Reals]:
    """Compute sin(a) and cos(a), angles in radians."""
    sine, cosine = np.empty_like(a), np.empty_like(a)
    sine[0], cosine[0] = np.sin(a[0]), np.cos(a[0])
    for k in range(1, len(a)):
        sine[k] = sum(j * a[j] * cosine[k - j] for j in range(1, k + 1)) / k
        cosine[k] = -sum(j * a[j] * sine[k - j] for j in range(1, k + 1)) / k
    return sine, cosine


def evaluate_polynomial(coefficients: Sequence[float], a: Reals) -> Reals:
    """Evaluate a polynomial of a, its coefficients from the highest power down to the constant (Horner)."""
    out = np.zeros_like(a)
    for coefficient in coefficients:
        out = multiply(out, a)
        out[0] += coefficient
    return out


def _make_column(values: Reals, like: Reals) -> Reals:
    return values.reshape(-1, *(1,) * (like.ndim - 1))
