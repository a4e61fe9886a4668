import numpy as np
import pytest
from scipy import stats

from skyproof.navigation.raim import check_residuals, compute_residual_statistic, exclude_one, normalise_residuals


def draw_geometry(rng, leading, k):
    unit = rng.standard_normal((*leading, k, 3))
    unit[..., 2] = np.abs(unit[..., 2]) + 0.2
    unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
    return np.concatenate((-unit, np.ones((*leading, k, 1))), axis=-1)


def fit(design, misfit, sigma):
    """Fit problem by problem with NumPy's solver; return residuals, NaN where not used."""
    residual = np.full(misfit.shape, np.nan)
    for index in np.ndindex(misfit.shape[:-1]):
        used = np.isfinite(sigma[index]) & np.isfinite(misfit[index])
        h, z, s = design[index][used], misfit[index][used], sigma[index][used]
        x = np.linalg.lstsq(h / s[:, None], z / s, rcond=None)[0]
        residual[index][used] = z - h @ x
    return residual


@pytest.mark.parametrize("k", [5, 8, 12])
def test_the_global_test_fails_at_the_stated_rate(k):
    rng = np.random.default_rng(k)
    design = draw_geometry(rng, (4000,), k)
    sigma = rng.uniform(0.5, 5.0, (4000, k))
    residual = fit(design, sigma * rng.standard_normal((4000, k)), sigma)
    tested = check_residuals(residual, sigma, false_alarm_probability=0.01)
    assert stats.binomtest(int((~tested.consistent).sum()), 4000, 0.01).pvalue > 1e-3
    assert stats.kstest(tested.p_value, "uniform").pvalue > 1e-3
    assert (tested.dof == k - 4).all()


def test_normalised_residuals_are_normal_and_explain_the_drop():
    rng = np.random.default_rng(5)
    design, sigma = draw_geometry(rng, (3000,), 7), rng.uniform(0.5, 5.0, (3000, 7))
    misfit = sigma * rng.standard_normal((3000, 7))
    w = normalise_residuals(design, misfit, sigma)
    assert stats.kstest(w[:, 0], "norm").pvalue > 1e-3
    without = sigma.copy()
    without[:, 3] = np.nan
    full, _ = compute_residual_statistic(fit(design, misfit, sigma), sigma)
    less, dof = compute_residual_statistic(fit(design, misfit, without), without)
    np.testing.assert_allclose(full - less, w[:, 3] ** 2, atol=1e-7)
    assert (dof == 2).all()


def test_a_single_fault_is_found_and_what_is_left_is_consistent():
    rng = np.random.default_rng(6)
    design, sigma = draw_geometry(rng, (200, 2), 9), np.full((200, 2, 9), 2.0)
    misfit = sigma * rng.standard_normal((200, 2, 9))
    faulty = rng.integers(0, 9, (200, 2))
    np.put_along_axis(misfit, faulty[..., None], 300.0, axis=-1)
    found = exclude_one(design, misfit, sigma, false_alarm_probability=1e-3)
    strong = np.take_along_axis(normalise_residuals(design, misfit, sigma), faulty[..., None], axis=-1)[..., 0]
    seen = np.abs(strong) > 30.0  # where the geometry controls the faulty one at all
    assert seen.mean() > 0.9
    assert (found.excluded == faulty)[seen].all()
    assert found.test.consistent[seen].mean() > 0.99
    assert (found.test.dof[seen] == 4).all()
    clean = exclude_one(design, 0.1 * misfit * 0.0, sigma, false_alarm_probability=1e-3)
    assert (clean.excluded == -1).all()


def test_without_redundancy_nothing_is_shown():
    design = draw_geometry(np.random.default_rng(7), (), 4)
    sigma = np.ones(4)
    tested = check_residuals(fit(design, np.arange(4.0), sigma), sigma, false_alarm_probability=0.01)
    assert not tested.consistent
    assert np.isnan(tested.p_value)
    excluded = exclude_one(design, np.arange(4.0), sigma, false_alarm_probability=0.01)
    assert excluded.excluded == -1
    assert not excluded.test.consistent


def test_one_redundant_measurement_detects_but_excludes_none():
    rng = np.random.default_rng(8)
    design = draw_geometry(rng, (), 5)
    found = exclude_one(design, np.array([1e4, 0.0, 0.0, 0.0, 0.0]), np.ones(5), false_alarm_probability=0.01)
    assert found.excluded == -1
    assert not found.test.consistent


def test_exclusion_believes_the_majority_even_a_false_one():
    rng = np.random.default_rng(9)
    design, sigma = draw_geometry(rng, (), 9), np.ones(9)
    false_place = np.array([500.0, -300.0, 100.0, 400.0])
    misfit = design @ false_place  # eight imitated signals agree on a false place
    misfit[4] = 0.0  # and one is true
    found = exclude_one(design, misfit, sigma, false_alarm_probability=1e-3)
    assert found.excluded == 4
    assert found.test.consistent
