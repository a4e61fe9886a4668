from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy import stats
from tests.navigation import sky

from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.navigation.fix import fix_and_geometry
from skyproof.navigation.protection import add_protection, compute_protection_levels

EYE = np.eye(3)


def design_of(rng, leading, k, clocks=1):
    """Design matrices of random skies, east-north-up for ECEF, the satellites dealt out to the clocks in turn."""
    azimuth, elevation = rng.uniform(0, 2 * np.pi, (*leading, k)), np.arcsin(rng.uniform(0.1, 1.0, (*leading, k)))
    unit = np.stack(
        (np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)), axis=-1
    )
    of = np.eye(clocks)[np.arange(k) % clocks]
    return np.concatenate((-unit, np.broadcast_to(of, (*leading, k, clocks))), axis=-1)


def fit(design, misfit, sigma):
    """Return position errors of the weighted fit by NumPy's own solver."""
    return np.einsum("...ij,...j->...i", np.linalg.pinv(design / sigma[..., None]), misfit / sigma)[..., :3]


def find_most_harmful(design, sigma):
    """Find the satellite whose bias moves the position most for what it adds to the residuals."""
    scaled = design / sigma[..., None]
    inverse = np.linalg.pinv(scaled)
    redundancy = 1.0 - np.einsum("...ij,...ji->...i", scaled, inverse)
    return np.argmax(np.linalg.norm(inverse[..., :3, :], axis=-2) / np.sqrt(redundancy), axis=-1), redundancy


@pytest.mark.parametrize(("k", "clocks"), [(6, 1), (9, 1), (12, 2), (16, 3)])
def test_alarms_without_a_fault_keep_the_stated_rate(k, clocks):
    rng = np.random.default_rng(k)
    trials, rate = 20000, 0.01
    design = design_of(rng, (trials,), k, clocks)
    sigma = rng.uniform(0.5, 3.0, (trials, k))
    found = compute_protection_levels(
        design, sigma * rng.standard_normal(sigma.shape), sigma, EYE, false_alarm_probability=rate
    )
    alarms = int(found.alarm.sum())
    assert stats.binomtest(alarms, trials, rate, alternative="greater").pvalue > 1e-3
    assert alarms > 0.4 * rate * trials  # correlated residuals are why it is not all of it


def test_one_redundant_satellite_alarms_at_exactly_the_rate():
    rng = np.random.default_rng(1)
    design, trials = design_of(rng, (40000,), 5), 40000
    found = compute_protection_levels(
        design, rng.standard_normal((trials, 5)), np.ones((trials, 5)), EYE, false_alarm_probability=0.02
    )
    assert stats.binomtest(int(found.alarm.sum()), trials, 0.02).pvalue > 1e-3


def count_worst(k, clocks, biases_sigma, trials, risk, rng, scale=1.0):
    """Count errors over `scale` levels without an alarm, for the worst bias of the most harmful satellite.

    Biases are in sigmas of the residual's own test, so that those near the threshold are among them everywhere.
    """
    design = design_of(rng, (trials,), k, clocks)
    sigma = rng.uniform(0.5, 3.0, (trials, k))
    faulty, redundancy = find_most_harmful(design, sigma)
    cell = np.arange(trials), faulty
    worst = 0
    for bias in biases_sigma:
        misfit = sigma * rng.standard_normal(sigma.shape)
        misfit[cell] += bias * sigma[cell] / np.sqrt(redundancy[cell])
        found = compute_protection_levels(design, misfit, sigma, EYE, integrity_risk=risk, false_alarm_probability=0.01)
        error = fit(design, misfit, sigma)
        horizontal = np.hypot(error[:, 0], error[:, 1]) > scale * found.horizontal_m
        vertical = np.abs(error[:, 2]) > scale * found.vertical_m
        worst = max(worst, int((horizontal & ~found.alarm).sum()), int((vertical & ~found.alarm).sum()))
    return worst


@pytest.mark.parametrize(("k", "clocks"), [(6, 1), (9, 1), (14, 3)])
def test_one_biased_satellite_keeps_the_levels_risk(k, clocks):
    rng = np.random.default_rng(20 + k)
    trials, risk = 6000, 0.01
    worst = count_worst(k, clocks, (0.0, 1.0, 2.0, 3.0, 3.5, 4.0, 4.5, 5.0, 7.0, 30.0), trials, risk, rng)
    assert stats.binomtest(worst, trials, risk, alternative="greater").pvalue > 1e-3


def count_worst_sets(k, faults, biases_sigma, trials, rng, believed):
    """Count errors beyond the horizontal level without an alarm, where an attacker biases the best of all sets.

    believed : for how many faults the level is asked.
    """
    design, sigma = design_of(rng, (trials,), k), rng.uniform(0.5, 3.0, (trials, k))
    scaled = design / sigma[..., None]
    gain = np.linalg.pinv(scaled)
    left = np.eye(k) - scaled @ gain
    best, bias = np.zeros(trials), np.zeros((trials, k))
    for some in combinations(range(k), faults):
        rows = np.ix_(some, some)
        least = np.linalg.inv(left[:, rows[0], rows[1]] + 1e-9 * np.eye(faults))
        seen = gain[:, :2][:, :, some]
        value, vector = np.linalg.eigh(seen @ least @ np.swapaxes(seen, -1, -2))
        better = value[:, -1] > best
        best = np.where(better, value[:, -1], best)
        along = (least @ np.swapaxes(seen, -1, -2) @ vector[..., -1:])[..., 0] / np.sqrt(value[:, -1:])
        bias[better] = 0.0
        bias[np.ix_(better, some)] = along[better]
    worst = 0
    for size in biases_sigma:
        misfit = sigma * (rng.standard_normal(sigma.shape) + size * bias)
        found = compute_protection_levels(
            design, misfit, sigma, EYE, faults=believed, integrity_risk=0.01, false_alarm_probability=0.01
        )
        error = fit(design, misfit, sigma)
        worst = max(worst, int(((np.hypot(error[:, 0], error[:, 1]) > found.horizontal_m) & ~found.alarm).sum()))
    return worst


@pytest.mark.parametrize(("k", "faults"), [(8, 2), (9, 3)])
def test_several_biased_satellites_keep_the_risk_of_a_level_for_so_many(k, faults):
    rng, trials = np.random.default_rng(k), 1000
    sizes = (0.0, 2.0, 3.0, 4.0, 8.0)
    worst = count_worst_sets(k, faults, sizes, trials, rng, faults)
    assert stats.binomtest(worst, trials, 0.01, alternative="greater").pvalue > 1e-3
    assert count_worst_sets(k, faults, sizes, trials, rng, 1) > 0.1 * trials  # which one for a single one does not


def test_a_level_grows_with_the_number_of_faults_to_none_where_too_few_are_left():
    rng = np.random.default_rng(4)
    design, sigma = design_of(rng, (50,), 8), rng.uniform(0.5, 3.0, (50, 8))
    misfit = np.zeros(sigma.shape)
    one, two = (compute_protection_levels(design, misfit, sigma, EYE, faults=faults) for faults in (1, 2))
    assert np.all(two.horizontal_m > one.horizontal_m)
    none = compute_protection_levels(design, misfit, sigma, EYE, faults=5)
    assert np.all(np.isinf(none.horizontal_m))
    assert np.all(np.isinf(none.vertical_m))


def test_the_level_is_not_so_wide_that_it_says_nothing():
    worst = count_worst(9, 1, (2.5, 3.0, 3.5), 6000, 0.01, np.random.default_rng(3), scale=0.6)
    assert worst > 0.03 * 6000  # three fifths of it would be left more often than stated


def test_an_uncontrolled_satellite_has_no_finite_level():
    rng = np.random.default_rng(4)
    design = design_of(rng, (), 4)
    four = compute_protection_levels(design, np.zeros(4), np.ones(4), EYE)
    assert np.isinf(four.horizontal_m)
    assert np.isnan(four.statistic)
    assert not four.alarm
    alone = np.zeros((8, 5))  # seven of one clock, and one that is alone with its own
    alone[:7, :4], alone[7, :3], alone[7, 4] = design_of(rng, (), 7), [0.3, -0.4, -0.87], 1.0
    assert np.isfinite(compute_protection_levels(alone, np.zeros(8), np.ones(8), EYE).horizontal_m)
    none = compute_protection_levels(design, np.zeros(4), np.array([1.0, 1.0, 1.0, np.nan]), EYE)
    assert np.isnan(none.horizontal_m)


def test_levels_turn_with_the_axes_and_shrink_with_the_noise():
    rng = np.random.default_rng(5)
    design, misfit = design_of(rng, (30,), 9), rng.standard_normal((30, 9))
    plain = compute_protection_levels(design, misfit, np.ones((30, 9)), EYE)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turned = design.copy()
    turned[..., :3] = design[..., :3] @ turn  # columns are x' = turn.T x
    again = compute_protection_levels(turned, misfit, np.ones((30, 9)), turn)
    np.testing.assert_allclose(again.horizontal_m, plain.horizontal_m, rtol=1e-8)
    np.testing.assert_allclose(again.vertical_m, plain.vertical_m, rtol=1e-8)
    half = compute_protection_levels(design, misfit, np.full((30, 9), 0.5), EYE)
    np.testing.assert_allclose(half.vertical_m, 0.5 * plain.vertical_m, rtol=1e-8)


def fix_epochs(n_satellites, *, bias_m=0.0, risk=1e-4):
    """Fix ten epochs with their levels; a satellite of the last epoch is off by `bias_m`."""
    nav, place = sky.make_navigation(), sky.place(48.0, 11.0, 500.0)
    names = sky.list_visible(nav, place)[:n_satellites]
    seen = sky.make_scene(nav, [(names, place, 3e-4)], noise_m=0.3).observations
    ranges_m = seen.pseudorange_m.copy()
    ranges_m[-1, 2] += bias_m
    fix, geometry = fix_and_geometry(replace(seen, pseudorange_m=ranges_m), nav)
    return add_protection(fix, geometry, integrity_risk=risk)


def test_a_fixs_level_is_not_below_its_covariances():
    found, risk = fix_epochs(9), 1e-4
    lat_rad, lon_rad, _ = geodetic_from_ecef(found.position_ecef_m)
    rot = rot_enu_ecef(lat_rad, lon_rad)
    covariance_m2 = rot @ found.covariance_m2[:, :3, :3] @ np.swapaxes(rot, -1, -2)
    level_sigma_m = np.sqrt(np.linalg.eigvalsh(covariance_m2[:, :2, :2])[:, 1])
    assert (found.protection_m[:, 0] > np.sqrt(-2.0 * np.log(risk)) * level_sigma_m).all()
    assert (found.protection_m[:, 1] > stats.norm.isf(0.5 * risk) * np.sqrt(covariance_m2[:, 2, 2])).all()
    assert (found.protection_m < 100.0).all()


def test_a_fix_with_an_alarm_has_no_level_its_neighbours_do():
    found = fix_epochs(9, bias_m=60.0)
    assert (found.status == 0).all()
    assert np.isnan(found.protection_m[-1]).all()
    assert np.isfinite(found.protection_m[:-1]).all()


def test_a_fix_without_redundancy_has_no_level():
    assert np.isnan(fix_epochs(4).protection_m).all()
    three = fix_epochs(3)
    assert (three.status != 0).all()
    assert np.isnan(three.protection_m).all()
