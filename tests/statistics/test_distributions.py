"""Against tables, and against scipy.stats, which is slow but not ours."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from skyproof.statistics.distributions import (
    binomial_survival,
    binomial_threshold,
    binomial_two_sided,
    chi_square_survival,
    chi_square_threshold,
    f_survival,
    f_threshold,
    noncentral_chi_square_survival,
    noncentral_chi_square_tail,
    noncentral_f_survival,
)


@pytest.mark.parametrize(
    ("n", "one_percent", "one_per_mille"),
    [(5, 30.82, 148.5), (10, 8.649, 18.49), (30, 5.453, 8.931), (120, 4.790, 7.328), (360, 4.665, 7.043)],
)
def test_f_thresholds_are_those_of_the_tables(n, one_percent, one_per_mille):
    # F with 2 and n - 2 degrees has the closed form (n-2)/2 (p^(-2/(n-2)) - 1); rounded to four digits.
    assert f_threshold(0.01, 2, n - 2) == pytest.approx(one_percent, rel=1e-3)
    assert f_threshold(0.001, 2, n - 2) == pytest.approx(one_per_mille, rel=1e-3)


def test_chi_square_thresholds_are_those_of_the_tables():
    assert chi_square_threshold(0.01, [1, 2]) == pytest.approx([6.635, 9.210], abs=1e-3)


@pytest.mark.parametrize("probability", [0.5, 1e-3, 1e-12, 1e-100])
@pytest.mark.parametrize("dof", [2.0, 30.0, np.inf])
def test_thresholds_invert_survival_far_into_the_tail(probability, dof):
    assert f_survival(f_threshold(probability, 3, dof), 3, dof) == pytest.approx(probability, rel=1e-6)
    assert chi_square_survival(chi_square_threshold(probability, 5), 5) == pytest.approx(probability, rel=1e-6)


def test_f_with_infinitely_many_degrees_is_the_limit_of_many():
    assert f_survival(2.5, 4, np.inf) == pytest.approx(f_survival(2.5, 4, 1e7), rel=1e-4)
    assert f_threshold(1e-3, 4, np.inf) == pytest.approx(f_threshold(1e-3, 4, 1e7), rel=1e-4)


def test_noncentral_tails_agree_with_scipy_stats():
    x = np.array([0.5, 3.0, 20.0])
    np.testing.assert_allclose(noncentral_chi_square_survival(x, 3, 4.0), stats.ncx2.sf(x, 3, 4.0), atol=1e-9)
    np.testing.assert_allclose(noncentral_f_survival(x, 3, 9, 4.0), stats.ncf.sf(x, 3, 9, 4.0), atol=1e-7)


@given(st.integers(1, 400), st.floats(0.0, 5000.0), st.floats(-8.0, 30.0))
def test_the_noncentral_chi_square_tail_keeps_its_digits(dof, noncentrality, sigmas):
    x = max(dof + noncentrality + sigmas * np.sqrt(2.0 * (dof + 2.0 * noncentrality)), 0.0)
    expected = float(stats.ncx2.sf(x, dof, noncentrality))
    assert noncentral_chi_square_tail(x, dof, noncentrality) == pytest.approx(expected, rel=1e-9)


def test_the_noncentral_chi_square_tail_is_that_of_sixty_digits():
    # Of an even number of degrees the central tail is a finite sum, e^-h (1 + h + h^2 / 2 ...) with h = x / 2.
    for x, dof, noncentrality in ((300, 10, 5), (1200, 160, 90), (1, 2, 8)):
        with localcontext() as context:
            context.prec = 60
            h, mean = Decimal(x) / 2, Decimal(noncentrality) / 2
            term, central = (-h).exp(), Decimal(0)
            for j in range(dof // 2):
                central, term = central + term, term * h / (j + 1)
            weight, exact = (-mean).exp(), Decimal(0)
            for k in range(600):
                exact, central = exact + weight * central, central + term
                weight, term = weight * mean / (k + 1), term * h / (dof // 2 + k + 1)
        assert noncentral_chi_square_tail(x, dof, noncentrality) == pytest.approx(float(exact), rel=1e-12)


def test_binomial_tail_agrees_with_scipy_stats_at_its_ends_too():
    k = np.arange(-1, 15)
    np.testing.assert_allclose(binomial_survival(k, 12, 0.01), stats.binom.sf(k - 1, 12, 0.01), rtol=1e-9, atol=0)


def test_the_binomial_threshold_attains_at_most_what_is_asked():
    count, attained = binomial_threshold(1e-3, 12, 0.01)
    assert count == 3
    assert attained == pytest.approx(stats.binom.sf(2, 12, 0.01))
    assert binomial_threshold(1e-9, 2, 0.1) == (3, 0.0)  # not even both would be rare enough


def test_the_two_sided_chance_is_small_on_both_sides():
    assert binomial_two_sided(100, 10_000, 0.01) == pytest.approx(1.0, abs=0.1)
    assert binomial_two_sided(150, 10_000, 0.01) < 1e-4
    assert binomial_two_sided(60, 10_000, 0.01) < 1e-4
