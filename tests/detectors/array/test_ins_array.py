"""Directions of arrival by an antenna array and an attitude: the paper's numbers, and error rates of calibrated tests.

Golden numbers are those of an independent re-derivation of the paper, to the digits printed there.
"""

import re
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest
from tests.detectors.nulls import NAVIGATION, PLACE_M, SIGNALS, START, STATE, TRUE, array_records

from skyproof.detectors.array.array_model import (
    array_design,
    between_signals,
    blind_directions,
    conditional_statistics,
    differences,
    direction_statistic,
    equilateral_triangle,
    joint_statistic,
    regular_tetrahedron,
    residual_covariance,
    single_statistic,
    sky_p_value,
    unexplained,
    white_covariance,
)
from skyproof.detectors.array.ins_array import InsArray, InsArraySettings
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.orbits import satellite_state_s
from skyproof.gnss.sky import azimuth_elevation
from skyproof.gnss.time import week_and_tow
from skyproof.records import ConsistentSet, Records
from skyproof.statistics.directions import (
    blocks,
    dead_zone,
    direction_cosines,
    hemisphere,
    nearest_whole,
    noncentrality_for_power,
    squared_norm,
)
from skyproof.statistics.distributions import (
    binomial_two_sided,
    chi_square_survival,
    chi_square_threshold,
    noncentral_chi_square_survival,
)

SIGMA = 0.01
WHITE = white_covariance([SIGMA] * 3)
POSITION = 0.003 / 0.19029
TILT = np.radians(0.05) ** 2
SKY_DEG = np.array([(20, 15), (75, 40), (110, 65), (160, 25), (205, 50), (250, 20), (300, 35), (340, 75)], float)


def towards(*pairs_deg):
    return direction_cosines(*np.radians(np.array(pairs_deg, float).T))


SKY = towards(*SKY_DEG)


def noncentrality(side, predicted, received):
    apart = array_design(equilateral_triangle(side)) @ (towards(predicted) - towards(received))[0]
    return float(squared_norm(apart, WHITE))


def power(p_fa, far, dof=2):
    return noncentral_chi_square_survival(chi_square_threshold(p_fa, dof), dof, far)


def errors_of(side, sky=SKY, **changes):
    settings = {"position_sigma_cyc": POSITION, "attitude_covariance_rad2": TILT} | changes
    return residual_covariance(equilateral_triangle(side), sky, sigma_cyc=SIGMA, **settings)


# The paper's test -----------------------------------------------------------------------------------------------------


def test_the_threshold_and_the_noncentrality_for_a_power():
    assert float(chi_square_threshold(0.01, 2)) == pytest.approx(9.2103, abs=5e-5)
    assert float(noncentrality_for_power(0.99, 0.01, 2)) == pytest.approx(27.4145, abs=5e-5)
    assert float(noncentrality_for_power(0.99, 0.01, 3)) == pytest.approx(29.826, abs=5e-4)
    assert float(chi_square_threshold(0.01, 3)) == pytest.approx(11.3449, abs=5e-5)


@pytest.mark.parametrize(
    ("side", "predicted", "received", "far", "powers"),
    [
        (1, (20, 40), (21, 40), 0.8938, (0.0009, 0.0060, 0.0365, 0.2051)),
        (2, (20, 40), (21, 40), 3.5750, (0.0130, 0.0508, 0.1759, 0.5019)),
        (3, (20, 40), (21, 40), 8.0439, (0.0948, 0.2343, 0.4901, 0.8156)),
        (4, (20, 40), (21, 40), 14.3002, (0.3501, 0.5791, 0.8150, 0.9651)),
        (5, (20, 40), (21, 40), 22.3440, (0.7078, 0.8708, 0.9660, 0.9969)),
        (5, (110, 35), (110, 34), 12.2155, (0.2525, 0.4676, 0.7311, 0.9375)),
        (5, (10, 10), (10, 9), 1.0372, (0.0012, 0.0072, 0.0418, 0.2221)),
    ],
)
def test_operating_characteristics_of_figures_5_and_6(side, predicted, received, far, powers):
    assert noncentrality(side, predicted, received) == pytest.approx(far, abs=5e-5)
    np.testing.assert_allclose(power([1e-4, 1e-3, 1e-2, 1e-1], far), powers, atol=6e-5)


def test_the_direction_printed_for_figure_5_would_be_found_always():
    assert noncentrality(1, (20, 40), (121, 40)) == pytest.approx(6988, abs=1)


def test_blocks_of_figure_7():
    predicted = towards((40, 35), (160, 20), (240, 55), (320, 70), (120, 70))
    on_degrees = direction_cosines(*np.radians(np.meshgrid(np.arange(360), np.arange(91)))).reshape(-1, 3)
    design, middle = array_design(equilateral_triangle(1)), blocks()
    assert list(dead_zone(predicted, on_degrees, design, WHITE)) == [123, 217, 119, 177, 177]
    assert list(dead_zone(predicted, middle.direction, design, WHITE)) == [124, 218, 120, 172, 172]
    five = array_design(equilateral_triangle(5))
    assert list(dead_zone(predicted, middle.direction, five, WHITE)) == [4, 8, 4, 8, 8]


def test_blocks_of_figure_8():
    received = blocks(azimuth_place=0.0).direction
    predicted = towards(*((2.5, el) for el in np.arange(2.5, 90, 5)))
    expected = {
        1: [162, 174, 190, 208, 184, 146, 128, 116, 112, 112, 122, 126, 136, 162, 200, 276, 466, 1402],
        5: [18, 24, 12, 10, 6, 6, 6, 6, 6, 6, 4, 4, 4, 4, 6, 8, 14, 40],
    }
    for side, counts in expected.items():
        assert list(dead_zone(predicted, received, array_design(equilateral_triangle(side)), WHITE)) == counts


def test_the_worst_blocks_1554_and_232_to_the_block():
    received = blocks(azimuth_place=0.0).direction
    predicted = towards(*((0.5, el) for el in np.arange(85.5, 90)))
    for side, counts in ((1, [898, 1240, 1402, 1500, 1554]), (5, [22, 28, 40, 66, 232])):
        assert list(dead_zone(predicted, received, array_design(equilateral_triangle(side)), WHITE)) == counts


def test_blocks_with_whole_cycles_unknown():
    received = blocks().direction
    predicted = towards(*((0, el) for el in (2.5, 22.5, 45.5, 67.5, 89.5)))
    for side, counts in ((1, [564, 420, 346, 420, 1554]), (5, [482, 438, 474, 598, 676])):
        design = array_design(equilateral_triangle(side))
        assert list(dead_zone(predicted, received, design, WHITE, wrapped=True)) == counts
    worst = dead_zone(towards((0.5, 89.5)), blocks(azimuth_place=0.0).direction, design, WHITE, wrapped=True)
    assert worst == [686]


def test_the_map_of_the_whole_sky_is_fast():
    predicted, received = blocks(5.0).direction, blocks().direction
    design = array_design(equilateral_triangle(5))
    took_s = []
    for _ in range(2):
        start = time.process_time()
        found = dead_zone(predicted, received, design, WHITE)
        took_s.append(time.process_time() - start)
    assert found.shape == (1296,)
    assert min(took_s) < 2.0


def test_a_weighted_map_sums_the_share_of_the_hemisphere():
    grid = blocks(0.25)
    design = array_design(equilateral_triangle(1))
    assert grid.share.sum() == pytest.approx(1.0)
    predicted = towards((40, 35), (160, 20), (240, 55), (320, 70))
    share = dead_zone(predicted, grid.direction, design, WHITE, weight=grid.share)
    np.testing.assert_allclose(100 * share, [0.487, 0.992, 0.336, 0.292], rtol=0.015)


# Errors that all satellites share -------------------------------------------------------------------------------------


def test_an_uncalibrated_position_error_makes_27_percent_of_false_alarms():
    stretch = 1.0 + (POSITION / SIGMA) ** 2
    assert stretch == pytest.approx(3.4854, abs=1.5e-4)  # 3.48548 with the wavelength of 190.29 mm
    covariance = errors_of(1, towards((148, 30)), attitude_covariance_rad2=0.0)
    np.testing.assert_allclose(covariance, stretch * WHITE, rtol=1e-12)
    assert float(chi_square_survival(chi_square_threshold(0.01, 2) / stretch, 2)) == pytest.approx(0.2668, abs=5e-5)


@pytest.mark.parametrize(
    ("sigma_mm", "nominal", "powers"),
    [
        (0.3, 0.0112, (0.063, 0.239, 0.973)),
        (1, 0.0271, (0.050, 0.179, 0.923)),
        (2, 0.1121, (0.032, 0.095, 0.688)),
        (3, 0.2668, (0.022, 0.053, 0.406)),
        (5, 0.5584, (0.015, 0.026, 0.141)),
    ],
)
def test_power_by_the_quality_of_the_antenna_positions(sigma_mm, nominal, powers):
    stretch = 1.0 + (0.001 * sigma_mm / 0.19029 / SIGMA) ** 2
    assert float(chi_square_survival(chi_square_threshold(0.01, 2) / stretch, 2)) == pytest.approx(nominal, abs=6e-5)
    np.testing.assert_allclose(power(0.01, np.array([1.5906, 4.6266, 23.8335]) / stretch), powers, atol=6e-4)


def test_averaging_meets_a_floor_that_calibration_does_not():
    apart = array_design(equilateral_triangle(1)) @ (towards((148.04, 30.85)) - towards((150, 23)))[0]
    for sigma_mm, expected in ((3, {1: 0.406, 10: 0.567, 100: 0.588, 10**9: 0.590}), (0.3, {1: 0.972, 10: 1.000})):
        for epochs, p_d in expected.items():
            covariance = residual_covariance(
                equilateral_triangle(1),
                towards((148.04, 30.85)),
                sigma_cyc=SIGMA / np.sqrt(epochs),
                position_sigma_cyc=0.001 * sigma_mm / 0.19029,
                attitude_covariance_rad2=TILT,
            )
            assert float(power(0.01, squared_norm(apart, covariance))) == pytest.approx(p_d, abs=1e-3)


@pytest.mark.parametrize(("side", "alone", "given", "unbiased"), [(1, 3.488, 1.484, 1.741), (5, 3.553, 1.486, 1.747)])
def test_what_the_other_satellites_show_of_the_errors(side, alone, given, unbiased):
    def mean_ratio(matrix, invert):
        own = [matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(8)]
        own = [np.linalg.inv(block) if invert else block for block in own]
        return np.mean([np.trace(np.linalg.solve(WHITE, block)) / 2 for block in own])

    covariance = errors_of(side)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert mean_ratio(covariance, False) == pytest.approx(alone, abs=1e-3)
    assert mean_ratio(np.linalg.inv(covariance), True) == pytest.approx(given, abs=1e-3)
    biased = np.linalg.inv(errors_of(side, bias_sigma_cyc=100.0))
    assert mean_ratio(biased, True) == pytest.approx(unbiased, abs=1e-3)


def drawn(rng, trials, side, sky=SKY, elements=None, bias=0.0, tilt=TILT, sigma=SIGMA):
    """Residuals of true signals under errors of positions, lines and attitude, by exact rotations, any cycles."""
    elements = equilateral_triangle(side) if elements is None else elements
    wrong = elements + POSITION * rng.standard_normal((trials, *elements.shape))
    rot = Rotation.from_rotvec(np.sqrt(tilt) * rng.standard_normal((trials, 3))).as_matrix()
    true = sky @ np.swapaxes(rot, -1, -2)
    phase = true @ np.swapaxes(wrong, -1, -2) + bias * rng.standard_normal((trials, 1, len(elements)))
    phase = phase + sigma * rng.standard_normal(phase.shape) + rng.random((trials, len(sky), 1))
    return unexplained(phase, elements, sky)


@pytest.mark.parametrize("side", [1, 5])
def test_calibrated_tests_alarm_at_the_rate_asked_for(side):
    rng = np.random.default_rng(side)
    z = drawn(rng, 20_000, side, bias=0.02)
    z = z + rng.integers(-3, 4, z.shape)
    covariance = errors_of(side, bias_sigma_cyc=0.02)
    own = np.array([covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(8)])
    near = nearest_whole(z, own)[0]
    without_bias, its_covariance = between_signals(near, errors_of(side))
    p_values = {
        "single": chi_square_survival(single_statistic(z, own, wrapped=True)[:, 3], 2),
        "joint": chi_square_survival(joint_statistic(z, covariance, wrapped=True), 16),
        "conditional": chi_square_survival(conditional_statistics(z, covariance, wrapped=True)[:, 5], 2),
        "without bias": chi_square_survival(joint_statistic(without_bias, its_covariance), 14),
    }
    union = float(np.mean(sky_p_value(z, covariance) < 0.1))
    assert 0.06 < union < 0.105  # both its tests share some alarms
    for name, p in p_values.items():
        for level in (0.1, 0.01):
            assert binomial_two_sided(int(np.sum(p < level)), p.size, level) > 1e-4, (name, level)


@pytest.mark.long
@pytest.mark.parametrize("side", [1, 5])
def test_calibrated_p_values_are_uniform(side):
    z = drawn(np.random.default_rng(side), 100_000, side)
    covariance = errors_of(side)
    joint = chi_square_survival(joint_statistic(z, covariance, wrapped=True), 16)
    given = chi_square_survival(conditional_statistics(z, covariance, wrapped=True), 2)
    for p in (joint, *given.T):
        assert kstest(p, "uniform").pvalue > 1e-4
        assert binomial_two_sided(int(np.sum(p < 0.001)), p.size, 0.001) > 1e-4


def test_the_first_order_attitude_model_is_that_of_exact_rotations():
    z = drawn(np.random.default_rng(2), 40_000, 5, tilt=np.radians(0.5) ** 2)
    counted = np.cov(z.reshape(len(z), -1).T)
    covariance = errors_of(5, attitude_covariance_rad2=np.radians(0.5) ** 2)
    np.testing.assert_allclose(counted, covariance, atol=0.03 * np.diag(covariance).max())


def test_neither_the_first_antenna_nor_the_first_satellite_matters():
    rng = np.random.default_rng(3)
    elements = np.vstack([regular_tetrahedron(1.3), [0.3, 2.0, -0.4]])
    phase = rng.standard_normal((20, 8, 5)) * 0.02 + SKY @ elements.T
    sigma = rng.uniform(0.01, 0.03, (8, 5))
    settings = {"attitude_covariance_rad2": np.diag([1.0, 2.0, 3.0]) * TILT, "bias_sigma_cyc": 0.01}

    def statistic(antennas, satellites, fair):
        covariance = residual_covariance(
            elements[antennas],
            SKY[satellites],
            sigma_cyc=sigma[np.ix_(satellites, antennas)],
            position_sigma_cyc=np.arange(1.0, 6.0)[antennas] * 0.01,
            **settings,
        )
        z = unexplained(phase[:, satellites][..., antennas], elements[antennas], SKY[satellites])
        return joint_statistic(*between_signals(z, covariance)) if fair else joint_statistic(z, covariance)

    for fair in (False, True):
        expected = statistic(np.arange(5), np.arange(8), fair)
        np.testing.assert_allclose(statistic(np.array([3, 1, 0, 4, 2]), np.arange(8), fair), expected, rtol=1e-9)
        other = np.array([7, 2, 3, 1, 0, 6, 5, 4])
        np.testing.assert_allclose(statistic(np.arange(5), other, fair), expected, rtol=1e-9)


def test_epochs_are_rows_like_signals_and_their_mean_is_one_row():
    rng = np.random.default_rng(4)
    elements = equilateral_triangle(2)
    at_epochs = np.repeat(SKY, 3, axis=0)  # each satellite three times
    z = rng.standard_normal((24, 2)) * 0.02
    stacked = residual_covariance(elements, at_epochs, position_sigma_cyc=POSITION, attitude_covariance_rad2=TILT)
    design = np.kron(np.eye(8), np.tile(np.eye(2), (3, 1)))  # what moves all epochs of a satellite by the same
    mean = joint_statistic(
        z.reshape(8, 3, 2).mean(axis=1),
        residual_covariance(
            elements, SKY, sigma_cyc=SIGMA / np.sqrt(3), position_sigma_cyc=POSITION, attitude_covariance_rad2=TILT
        ),
    )
    statistic, rest, dof = direction_statistic(z.ravel(), stacked, design)
    assert dof == 16
    assert float(statistic) == pytest.approx(float(mean), rel=1e-8)
    assert float(statistic + rest) == pytest.approx(float(joint_statistic(z, stacked)), rel=1e-8)


def test_what_a_direction_cannot_cause_is_kept_apart():
    rng = np.random.default_rng(5)
    elements = np.vstack([equilateral_triangle(1), [[1.5, 1.0, 0.0], [-1.0, 0.4, 0.0]]])
    design, covariance = array_design(elements), white_covariance([SIGMA] * 5)
    z = rng.multivariate_normal(np.zeros(4), covariance, 50_000)
    statistic, rest, dof = direction_statistic(z, covariance, design)
    assert dof == 2
    for p in (chi_square_survival(statistic, 2), chi_square_survival(rest, 2)):
        assert binomial_two_sided(int(np.sum(p < 0.01)), p.size, 0.01) > 1e-4
    moved = direction_statistic(z + design @ [0.1, 0.2, 0.3], covariance, design)
    np.testing.assert_allclose(moved[1], rest, atol=1e-7)
    assert moved[0].mean() > statistic.mean() + 10


@pytest.mark.parametrize(
    ("side", "shift", "clean", "alone", "given", "joint"),
    [
        (1, 3, 0.352, 0.081, 0.240, 0.077),
        (1, 5, 0.707, 0.285, 0.584, 0.332),
        (1, 10, 0.987, 0.785, 0.947, 0.817),
        (5, 2, 0.954, 0.716, 0.891, 0.744),
        (5, 3, 0.999, 0.898, 0.988, 0.925),
    ],
)
def test_power_on_one_satellite_of_eight(side, shift, clean, alone, given, joint):
    moved = towards(*((az, el + (shift if el < 70 else -shift)) for az, el in SKY_DEG))
    apart = (moved - SKY) @ array_design(equilateral_triangle(side)).T
    covariance = errors_of(side)
    one_false = np.zeros((8, 8, 2))
    one_false[np.arange(8), np.arange(8)] = apart
    own = np.array([covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(8)])
    found = {
        clean: power(0.01, single_statistic(apart, WHITE)),
        alone: power(0.01, single_statistic(apart, own)),
        given: power(0.01, np.diag(conditional_statistics(one_false, covariance))),
        joint: power(0.01, joint_statistic(one_false, covariance), 16),
    }
    for expected, p_d in found.items():
        assert np.mean(p_d) == pytest.approx(expected, abs=1e-3)


# Whole cycles ---------------------------------------------------------------------------------------------------------


def test_blind_directions_of_a_long_triangle():
    here = towards((148, 30))[0]
    blind = blind_directions(here, equilateral_triangle(5))
    assert len(blind) == 69
    assert np.min(np.linalg.norm(blind - here, axis=-1)) < 1e-12
    cycles = array_design(equilateral_triangle(5)) @ (blind - here).T
    np.testing.assert_allclose(cycles, np.rint(cycles), atol=1e-9)
    level = blind[:, :2]
    apart = np.linalg.norm(level[:, None] - level, axis=-1)[~np.eye(69, dtype=bool)]
    assert apart.min() == pytest.approx(1.1547 / 5, abs=1e-5)


def test_no_blind_direction_below_0_577_wavelengths():
    for k, here in enumerate(hemisphere(50)):
        assert len(blind_directions(here, equilateral_triangle(0.57))) == 1, k
    counts = [len(blind_directions(here, equilateral_triangle(1.0))) - 1 for here in hemisphere(3000)]
    assert np.mean(counts) == pytest.approx(1.86, abs=0.08)
    assert max(counts) == 2


def test_a_blind_direction_is_found_only_without_whole_cycles():
    rng = np.random.default_rng(6)
    apart = array_design(equilateral_triangle(1)) @ (towards((335.97, 73.10)) - towards((148, 30)))[0]
    z = apart + rng.multivariate_normal([0, 0], WHITE, 50_000)
    assert np.all(single_statistic(z, WHITE) > 9.2103)
    assert np.mean(single_statistic(z, WHITE, wrapped=True) > 9.2103) == pytest.approx(0.0106, abs=0.0014)


@pytest.mark.parametrize(
    ("side", "plain", "wrapped"),
    # Plain by quadrature; the reference drew 150 directions (2.11, 0.594, 0.188, 0.033, each within 4 % or so).
    [(0.5, 2.081, 2.11), (1, 0.6153, 1.62), (2, 0.1776, 1.53), (5, 0.0334, 1.50)],
)
def test_longer_baselines_do_not_see_more_of_the_sky_if_cycles_are_unknown(side, plain, wrapped):
    predicted, received = hemisphere(100), hemisphere(50_000)
    design = array_design(equilateral_triangle(side))
    found = dead_zone(predicted, received, design, WHITE).mean() / len(received) * 100
    assert found == pytest.approx(plain, rel=0.03)
    found = dead_zone(predicted, received, design, WHITE, wrapped=True).mean() / len(received) * 100
    assert found == pytest.approx(wrapped, rel=0.06)


def block_diagonal(*matrices):
    size = sum(len(m) for m in matrices)
    whole, at = np.zeros((size, size)), 0
    for m in matrices:
        whole[at : at + len(m), at : at + len(m)] = m
        at += len(m)
    return whole


def test_two_frequencies_two_scales_or_a_fourth_antenna_mend_it():
    def share(elements, sphere=False, l2=False):
        design, covariance = array_design(elements), white_covariance([SIGMA] * len(elements))
        if l2:
            design = np.vstack([design, design * 60 / 77])
            covariance = block_diagonal(covariance, covariance)
        received = hemisphere(30_000)
        if sphere:
            received = np.vstack([received, -received])
        found = dead_zone(hemisphere(60), received, design, covariance, wrapped=True)
        return 100 * found.mean() / len(received)

    assert share(equilateral_triangle(1)) == pytest.approx(1.65, rel=0.06)
    assert share(equilateral_triangle(1), l2=True) == pytest.approx(0.452, rel=0.06)
    assert share(equilateral_triangle(5), l2=True) == pytest.approx(0.026, abs=0.01)
    assert share(np.vstack([equilateral_triangle(0.5), equilateral_triangle(5)[1:]])) == pytest.approx(0.027, abs=0.01)
    assert share(regular_tetrahedron(1)) == pytest.approx(0.43, rel=0.08)
    assert share(regular_tetrahedron(1), sphere=True) == pytest.approx(0.26, rel=0.08)


def test_a_tetrahedron_sees_all_directions_alike():
    design = array_design(regular_tetrahedron(1))
    information = design.T @ np.linalg.inv(white_covariance([SIGMA] * 4)) @ design
    np.testing.assert_allclose(information, np.eye(3) / (2 * SIGMA**2), atol=1e-6)


def test_no_single_source_hides_from_eight_satellites():
    assert float(noncentrality_for_power(0.99, 0.01, 16)) == pytest.approx(45.80, abs=5e-3)
    for side, least, with_errors in ((1, 5344, 3463), (5, 4665, 2541)):
        design = array_design(equilateral_triangle(side))
        apart = (hemisphere(20_000)[:, None] - SKY) @ design.T
        found = joint_statistic(apart, np.kron(np.eye(8), WHITE), wrapped=True).min()
        assert found == pytest.approx(least, rel=0.01)  # the reference: 400 000 random sources, no errors
        found = joint_statistic(apart, errors_of(side), wrapped=True).min()
        assert found == pytest.approx(with_errors, rel=0.01)  # ours; no reference


# The detector ---------------------------------------------------------------------------------------------------------


def test_predicted_directions_are_those_of_azimuth_and_elevation():
    week, tow_s = week_and_tow(START)
    by_sat = {orbit.sat: orbit for orbit in NAVIGATION.ephemerides}
    for k, signal in enumerate(SIGNALS):
        position_m = satellite_state_s(by_sat[signal.sat], week, tow_s).position_ecef_m
        az, el = azimuth_elevation(PLACE_M, position_m)
        forward_right_down = [np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)]
        np.testing.assert_allclose(TRUE[0, k], forward_right_down, atol=3e-5)  # the satellite moves on by 300 m


def sky(*numbers, place_m=PLACE_M):
    """A consistent set of these signals at a place."""
    return ConsistentSet(
        receiver="rx1",
        signals=tuple(SIGNALS[k] for k in numbers),
        gpst=START,
        position_ecef_m=place_m,
        clock_bias_s=0.0,
        covariance_m2=np.eye(4),
        statistic=1.0,
        dof=1,
        p_value=0.5,
    )


def said_of(records, **settings):
    """What is said of the signals: of each word the signals."""
    evidence, _ = InsArray(InsArraySettings(**settings)).examine(records)
    assert len({e.says for e in evidence}) == len(evidence)
    return {e.says: {ref.signal for ref in e.subject} for e in evidence}, evidence


def with_two_elsewhere():
    direction = TRUE.copy()
    direction[:, 2:4] = direction[:, :1]
    return array_records(np.random.default_rng(8), direction)


def test_false_signals_are_named_and_the_true_ones_are_not():
    words, _ = said_of(with_two_elsewhere())
    assert words == {"spoofed": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}


def test_a_satellite_behind_the_transmitter_is_not_authentic():
    direction = TRUE.copy()
    direction[:, 2:5] = direction[:, :1]
    words, _ = said_of(array_records(np.random.default_rng(8), direction))
    assert words == {"spoofed": set(SIGNALS[2:5]), "authentic": {SIGNALS[1], *SIGNALS[5:]}}


@pytest.mark.parametrize(("apart_m", "named"), [(200.0, False), (2000.0, True)])
def test_a_signal_that_overlaps_with_another_of_its_satellite_is_not_named_by_itself(monkeypatch, apart_m, named):
    """Its phases are a mixture of both."""
    monkeypatch.setattr("skyproof.detectors.array.ins_array.reflections", lambda *given, **more: frozenset())
    direction = TRUE.copy()
    direction[:, 3], direction[:, 2] = TRUE[:, 2], TRUE[:, 0]
    records = array_records(np.random.default_rng(8), direction)
    signals = (*SIGNALS[:3], replace(SIGNALS[2], copy="b"), *SIGNALS[4:])
    phases = tuple(replace(phases, signals=signals) for phases in records.array_phases)
    range_m = np.full((2, len(signals)), 2.1e7)
    range_m[:, 3] += apart_m
    observed = SimpleNamespace(receiver="rx1", signals=signals, pseudorange_m=range_m)
    words, _ = said_of(replace(records, array_phases=phases, observations=(observed,)))
    assert words.get("spoofed", set()) == ({signals[2]} if named else set())
    assert {*SIGNALS[:2], *SIGNALS[4:]} <= words["authentic"]


def test_reflections_of_several_satellites_from_one_direction_leave_the_sky_open(monkeypatch):
    late = "skyproof.detectors.array.ins_array.reflections"
    monkeypatch.setattr(late, lambda observations, navigation, place_ecef_m, true, others, **given: frozenset(others))
    direction = TRUE.copy()
    direction[:, 2:4] = direction_cosines(np.radians([40.0, 200.0]), np.radians([-25.0, -60.0]))
    words, _ = said_of(array_records(np.random.default_rng(8), direction))
    assert words == {"authentic": {*SIGNALS[:2], *SIGNALS[4:]}}
    words, evidence = said_of(with_two_elsewhere())
    assert words == {"undecided": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}
    (open_still,) = [e for e in evidence if e.says == "undecided"]
    assert open_still.failed
    assert open_still.overrules


def test_where_false_signals_come_from_is_among_the_directions_given():
    direction = TRUE.copy()
    direction[:, 2:4] = direction_cosines(np.radians(40.0), np.radians(-25.0))  # down is positive in the body
    _, evidence = said_of(array_records(np.random.default_rng(8), direction))
    (spoofed,) = [e for e in evidence if e.says == "spoofed"]
    # Level, north at the first epoch and turned by a degree in each second.
    azimuth_rad, elevation_rad = np.radians(40.0 + 1.5), np.radians(25.0)
    off = [
        np.hypot((d.azimuth_rad - azimuth_rad) * np.cos(elevation_rad), d.elevation_rad - elevation_rad) / d.sigma_rad
        for d in spoofed.directions
    ]
    assert min(off) < 3.0
    assert all(d.frame == "enu" for d in spoofed.directions)


def test_one_source_for_all_is_found():
    direction = np.repeat(TRUE[:, :1], len(SIGNALS), axis=1)
    words, evidence = said_of(array_records(np.random.default_rng(9), direction))
    assert words == {"spoofed": set(SIGNALS)}
    assert evidence[0].p_value < 1e-9


def test_where_only_signals_show_the_place_it_is_that_of_a_set_whose_signals_come_from_their_satellites():
    covariance = np.tile(np.radians(0.05) ** 2 * np.eye(9), (STATE.gpst.size, 1, 1))
    covariance[:, range(6), range(6)] = np.inf
    records = replace(with_two_elsewhere(), nav_state=replace(STATE, covariance=covariance))
    words, (said,) = said_of(records)
    assert "position" in said.because
    far = ecef_from_geodetic(np.radians(-20.0), np.radians(80.0), 0.0)
    words, _ = said_of(replace(records, sets=(sky(2, 3, place_m=far), sky(0, 1, 4, 5, 6, 7))))
    assert words == {"spoofed": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}


@pytest.mark.parametrize("false", [False, True])
def test_an_attitude_that_is_wrong_is_reported_and_no_true_signal_is_called_spoofed(false):
    records = with_two_elsewhere() if false else array_records(np.random.default_rng(8))
    turned = STATE.attitude @ Rotation.from_euler("z", 20.0, degrees=True).as_matrix()
    evidence, _ = InsArray().examine(replace(records, nav_state=replace(STATE, attitude=turned)))
    (noted,) = [e.because for e in evidence if e.noted]
    # Fewer signals leave several attitudes open, one cycle of phase apart.
    how = "not" if false else "(19|20|21) degrees from"
    assert re.match(rf"the attitude given is {how} the one that the signals of rx1 show, and is not used", noted)
    spoofed = {ref.signal for e in evidence if e.says == "spoofed" for ref in e.subject}
    assert spoofed == (set(SIGNALS[2:4]) if false else set())


@pytest.mark.parametrize("false", [False, True])
def test_lines_that_are_not_what_was_given_are_reported_and_no_true_signal_is_called_spoofed(false):
    records = with_two_elsewhere() if false else array_records(np.random.default_rng(8))
    (phases,) = records.array_phases
    moved = replace(phases, phase_cyc=phases.phase_cyc + np.array([0.0, 0.3, -0.2]))
    evidence, _ = InsArray().examine(replace(records, array_phases=(moved,)))
    (noted,) = [e.because for e in evidence if e.noted]
    assert "line_bias_cyc of rx1 is not what its signals show" in noted
    spoofed = {ref.signal for e in evidence if e.says == "spoofed" for ref in e.subject}
    assert spoofed == (set(SIGNALS[2:4]) if false else set())


def at_first(phases, **changes):
    """The first epoch alone: the body turns."""
    first = {name: getattr(phases, name)[:1] for name in ("gpst", "elapsed_s", "phase_cyc", "sigma_cyc")}
    return replace(phases, **first, **changes)


def with_an_antenna_off(records, *, lines_known=True):
    """The third antenna is stated 3 m forward of where it is."""
    (phases,) = records.array_phases
    stated = replace(phases, elements_m=phases.elements_m + np.array([[0.0], [0.0], [3.0]]) * [1.0, 0.0, 0.0])
    return replace(records, array_phases=(replace(stated, calibrated=lines_known),))


@pytest.mark.parametrize(("false", "lines_known"), [(0, True), (0, False), (4, False)])
def test_that_an_antenna_is_not_where_it_is_stated_is_told_by_true_signals_alone_and_beside_false_ones(
    false, lines_known
):
    direction = TRUE.copy()
    direction[:, :false] = direction_cosines(np.radians(40.0), np.radians(-25.0))
    records = array_records(np.random.default_rng(8), direction)
    words, evidence = said_of(with_an_antenna_off(records, lines_known=lines_known))
    assert words == {"undecided": set(SIGNALS[false:])} | ({"spoofed": set(SIGNALS[:false])} if false else {})
    (undecided,) = [e for e in evidence if e.says == "undecided"]
    assert "too few do to show that its attitude, lines and antennas are as stated" in undecided.because
    assert "antennas_m" in undecided.would_need


def test_signals_of_one_transmitter_alone_say_the_same_wherever_antennas_are_stated_while_lines_are_not_known():
    """A line that is longer by the way to an antenna elsewhere gives the same phases: no test can tell them apart."""
    direction = np.broadcast_to(direction_cosines(np.radians(40.0), np.radians(-25.0)), TRUE.shape)
    records = array_records(np.random.default_rng(8), direction)
    records = replace(records, array_phases=(at_first(records.array_phases[0], calibrated=False),))
    (right,), _ = InsArray().examine(records)
    (wrong,), _ = InsArray().examine(with_an_antenna_off(records, lines_known=False))
    assert (wrong.says, wrong.subject, wrong.because) == (right.says, right.subject, right.because)
    assert wrong.says == "spoofed"
    assert wrong.directions == right.directions == ()


def test_attitude_and_lines_that_are_not_known_come_from_the_sky_itself():
    records = with_two_elsewhere()
    (phases,) = records.array_phases
    unknown = at_first(replace(phases, phase_cyc=phases.phase_cyc + np.array([0.0, 0.3, -0.2])), calibrated=False)
    words, _ = said_of(
        replace(records, array_phases=(unknown,), nav_state=None, sets=(sky(0, 1, 4, 5, 6, 7),)),
    )
    assert words == {"spoofed": set(SIGNALS[2:4]), "authentic": {*SIGNALS[:2], *SIGNALS[4:]}}


def test_without_an_ephemeris_of_any_satellite_it_says_so():
    records = array_records(np.random.default_rng(10))
    late = nominal_constellation(START + np.timedelta64(40, "D"))
    (said,), _ = InsArray().examine(Records(**(vars(records) | {"navigation": late})))
    assert said.says == "undecided"
    assert said.would_need


def test_differences_are_against_the_first_antenna_along_any_axis():
    values = np.arange(24.0).reshape(2, 3, 4)
    np.testing.assert_array_equal(differences(values), values[..., 1:] - values[..., :1])
    np.testing.assert_array_equal(differences(values, axis=1), values[:, 1:] - values[:, :1])
