"""Which signals belong to one sky: right as often as stated, with the stated covariance, and never by chance."""

import numpy as np
from scipy import stats
from tests.detectors.dccaf.test_inverse_raim import UP_EAST, draw_sky
from tests.detectors.dccaf.test_inverse_raim import draw_two_skies as drawn

from skyproof.detectors.dccaf.two_skies import find_two_skies

SIGMA_M, MOST = 4.0, 1e-3


def find_all(units, misfit_m, sigma_m=SIGMA_M):
    sigmas = np.full(len(units), sigma_m)
    return find_two_skies(units, misfit_m, sigmas, window_m=760.0, set_probability=1e-3, most_doubt=MOST)


def exchange_signals(rng, misfit_m):
    """Exchange which of a satellite's signals comes first."""
    return np.where(rng.random((len(misfit_m), 1)) < 0.5, misfit_m, misfit_m[:, ::-1])


def draw_squared_errors(rng, n, offset_m, draws):
    """Draw squared errors over stated ones (found, 2) of the true and the false sky."""
    squares = []
    for _ in range(draws):
        units, misfit_m = drawn(rng, n, SIGMA_M, offset_m)
        two = find_all(units, exchange_signals(rng, misfit_m))
        if two is not None:
            true = int(np.argmin(np.linalg.norm(two.state_m, axis=1)))
            off_m = two.state_m[[true, 1 - true]] - np.stack([np.zeros(4), np.append(offset_m * UP_EAST, 0.0)])
            spread_m2 = two.covariance_m2[[true, 1 - true]]
            squares.append(np.einsum("ki,kij,kj->k", off_m, np.linalg.inv(spread_m2), off_m))
            assert two.doubt <= MOST
    return np.array(squares)


def test_distant_skies_are_found_with_the_stated_covariance():
    squares = draw_squared_errors(np.random.default_rng(1), 8, 150.0, 150)
    assert len(squares) > 100
    low, high = stats.chi2.ppf([1e-3, 1.0 - 1e-3], 4 * squares.size)
    assert low < squares.sum() < high
    assert squares.max() < stats.chi2.isf(1e-3 / squares.size, 4)


def test_the_covariance_allows_for_exchanged_near_signals():
    # Some satellites' signals differ by less than their noise.
    squares = draw_squared_errors(np.random.default_rng(2), 8, 60.0, 300)
    assert len(squares) > 30
    assert squares.sum() < stats.chi2.ppf(1.0 - 1e-3, 4 * squares.size)
    assert squares.max() < stats.chi2.isf(1e-3 / squares.size, 4)


def test_signals_that_belong_to_no_sky_make_none():
    # A sky, and another signal of each satellite anywhere within a chip: as rarely taken for a sky as asked.
    rng, count = np.random.default_rng(3), 0
    for _ in range(400):
        units = draw_sky(rng, 7)
        misfit_m = np.stack([SIGMA_M * rng.standard_normal(7), rng.uniform(-380.0, 380.0, 7)], axis=1)
        count += find_all(units, exchange_signals(rng, misfit_m)) is not None
    assert count <= stats.binom.ppf(0.999, 400, MOST)


def test_four_satellites_and_near_skies_claim_nothing():
    rng = np.random.default_rng(4)
    assert find_all(*drawn(rng, 4, SIGMA_M, 200.0)) is None
    near = [two for _ in range(30) if (two := find_all(*drawn(rng, 8, SIGMA_M, 6.0))) is not None]
    for two in near:
        apart = two.state_m[1] - two.state_m[0]
        assert apart @ np.linalg.solve(two.covariance_m2.sum(axis=0), apart) < stats.chi2.isf(1e-3, 4)
