"""Directions of arrival by an antenna array and an attitude: the paper's numbers, and error rates of calibrated tests.

Golden numbers are those of an independent re-derivation of the paper, to the digits printed there.
"""

import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from skyproof.detectors.array.array_model import (
    array_design,
    conditional_statistics,
    differences,
    joint_statistic,
    residual_covariance,
    sky_p_value,
    white_covariance,
)
from skyproof.statistics.directions import direction_cosines, hemisphere, mahalanobis_squared, subtract_nearest_whole
from skyproof.statistics.distributions import (
    binomial_two_sided,
    chi_square_survival,
    chi_square_threshold,
    noncentral_chi_square_survival,
)
from skyproof.studies.array_geometry import (
    blind_directions,
    direction_statistic,
    equilateral_triangle,
    phase_residuals,
    regular_tetrahedron,
    single_statistic,
    subtract_first_signal,
)
from skyproof.studies.direction_tests import blocks, measure_dead_zone, noncentrality_for_power

SIGMA = 0.01
WHITE = white_covariance([SIGMA] * 3)
POSITION = 0.003 / 0.19029
TILT = np.radians(0.05) ** 2
SKY_DEG = np.array([(20, 15), (75, 40), (110, 65), (160, 25), (205, 50), (250, 20), (300, 35), (340, 75)], float)


def draw_directions(*pairs_deg):
    return direction_cosines(*np.radians(np.array(pairs_deg, float).T))


SKY = draw_directions(*SKY_DEG)


def compute_noncentrality(side, predicted, received):
    apart = array_design(equilateral_triangle(side)) @ (draw_directions(predicted) - draw_directions(received))[0]
    return float(mahalanobis_squared(apart, WHITE))


def compute_power(p_fa, far, dof=2):
    return noncentral_chi_square_survival(chi_square_threshold(p_fa, dof), dof, far)


def list_errors(side, sky=SKY, **changes):
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
    assert compute_noncentrality(side, predicted, received) == pytest.approx(far, abs=5e-5)
    np.testing.assert_allclose(compute_power([1e-4, 1e-3, 1e-2, 1e-1], far), powers, atol=6e-5)


def test_the_direction_printed_for_figure_5_is_always_found():
    assert compute_noncentrality(1, (20, 40), (121, 40)) == pytest.approx(6988, abs=1)


def test_blocks_of_figure_7():
    predicted = draw_directions((40, 35), (160, 20), (240, 55), (320, 70), (120, 70))
    on_degrees = direction_cosines(*np.radians(np.meshgrid(np.arange(360), np.arange(91)))).reshape(-1, 3)
    design, middle = array_design(equilateral_triangle(1)), blocks()
    assert list(measure_dead_zone(predicted, on_degrees, design, WHITE)) == [123, 217, 119, 177, 177]
    assert list(measure_dead_zone(predicted, middle.direction, design, WHITE)) == [124, 218, 120, 172, 172]
    five = array_design(equilateral_triangle(5))
    assert list(measure_dead_zone(predicted, middle.direction, five, WHITE)) == [4, 8, 4, 8, 8]


def test_blocks_of_figure_8():
    received = blocks(azimuth_place=0.0).direction
    predicted = draw_directions(*((2.5, el) for el in np.arange(2.5, 90, 5)))
    expected = {
        1: [162, 174, 190, 208, 184, 146, 128, 116, 112, 112, 122, 126, 136, 162, 200, 276, 466, 1402],
        5: [18, 24, 12, 10, 6, 6, 6, 6, 6, 6, 4, 4, 4, 4, 6, 8, 14, 40],
    }
    for side, counts in expected.items():
        assert list(measure_dead_zone(predicted, received, array_design(equilateral_triangle(side)), WHITE)) == counts


def test_the_worst_blocks_1554_and_232_to_the_block():
    received = blocks(azimuth_place=0.0).direction
    predicted = draw_directions(*((0.5, el) for el in np.arange(85.5, 90)))
    for side, counts in ((1, [898, 1240, 1402, 1500, 1554]), (5, [22, 28, 40, 66, 232])):
        assert list(measure_dead_zone(predicted, received, array_design(equilateral_triangle(side)), WHITE)) == counts


def test_blocks_with_whole_cycles_unknown():
    received = blocks().direction
    predicted = draw_directions(*((0, el) for el in (2.5, 22.5, 45.5, 67.5, 89.5)))
    for side, counts in ((1, [564, 420, 346, 420, 1554]), (5, [482, 438, 474, 598, 676])):
        design = array_design(equilateral_triangle(side))
        assert list(measure_dead_zone(predicted, received, design, WHITE, wrapped=True)) == counts
    worst = measure_dead_zone(
        draw_directions((0.5, 89.5)), blocks(azimuth_place=0.0).direction, design, WHITE, wrapped=True
    )
    assert worst == [686]


def test_the_map_of_the_whole_sky_is_fast():
    predicted, received = blocks(5.0).direction, blocks().direction
    design = array_design(equilateral_triangle(5))
    took_s = []
    for _ in range(2):
        start = time.process_time()
        found = measure_dead_zone(predicted, received, design, WHITE)
        took_s.append(time.process_time() - start)
    assert found.shape == (1296,)
    assert min(took_s) < 2.0


def test_a_weighted_map_sums_the_share_of_the_hemisphere():
    grid = blocks(0.25)
    design = array_design(equilateral_triangle(1))
    assert grid.share.sum() == pytest.approx(1.0)
    predicted = draw_directions((40, 35), (160, 20), (240, 55), (320, 70))
    share = measure_dead_zone(predicted, grid.direction, design, WHITE, weight=grid.share)
    np.testing.assert_allclose(100 * share, [0.487, 0.992, 0.336, 0.292], rtol=0.015)


# Errors that all satellites share -------------------------------------------------------------------------------------


def test_an_uncalibrated_antenna_makes_27_percent_false_alarms():
    stretch = 1.0 + (POSITION / SIGMA) ** 2
    assert stretch == pytest.approx(3.4854, abs=1.5e-4)  # 3.48548 with the wavelength of 190.29 mm
    covariance = list_errors(1, draw_directions((148, 30)), attitude_covariance_rad2=0.0)
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
    np.testing.assert_allclose(compute_power(0.01, np.array([1.5906, 4.6266, 23.8335]) / stretch), powers, atol=6e-4)


def test_averaging_meets_a_floor_that_calibration_does_not():
    apart = array_design(equilateral_triangle(1)) @ (draw_directions((148.04, 30.85)) - draw_directions((150, 23)))[0]
    for sigma_mm, expected in ((3, {1: 0.406, 10: 0.567, 100: 0.588, 10**9: 0.590}), (0.3, {1: 0.972, 10: 1.000})):
        for epochs, p_d in expected.items():
            covariance = residual_covariance(
                equilateral_triangle(1),
                draw_directions((148.04, 30.85)),
                sigma_cyc=SIGMA / np.sqrt(epochs),
                position_sigma_cyc=0.001 * sigma_mm / 0.19029,
                attitude_covariance_rad2=TILT,
            )
            assert float(compute_power(0.01, mahalanobis_squared(apart, covariance))) == pytest.approx(p_d, abs=1e-3)


@pytest.mark.parametrize(("side", "alone", "given", "unbiased"), [(1, 3.488, 1.484, 1.741), (5, 3.553, 1.486, 1.747)])
def test_what_the_other_satellites_show_of_the_errors(side, alone, given, unbiased):
    def mean_ratio(matrix, invert):
        blocks = [matrix[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(8)]
        blocks = [np.linalg.inv(block) if invert else block for block in blocks]
        return np.mean([np.trace(np.linalg.solve(WHITE, block)) / 2 for block in blocks])

    covariance = list_errors(side)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert mean_ratio(covariance, False) == pytest.approx(alone, abs=1e-3)
    assert mean_ratio(np.linalg.inv(covariance), True) == pytest.approx(given, abs=1e-3)
    biased = np.linalg.inv(list_errors(side, bias_sigma_cyc=100.0))
    assert mean_ratio(biased, True) == pytest.approx(unbiased, abs=1e-3)


def draw_residuals(rng, trials, side, sky=SKY, elements=None, bias=0.0, tilt=TILT, sigma=SIGMA):
    """Draw residuals of true signals under errors of positions, lines and attitude, by exact rotations."""
    elements = equilateral_triangle(side) if elements is None else elements
    wrong = elements + POSITION * rng.standard_normal((trials, *elements.shape))
    rot = Rotation.from_rotvec(np.sqrt(tilt) * rng.standard_normal((trials, 3))).as_matrix()
    true = sky @ np.swapaxes(rot, -1, -2)
    phase = true @ np.swapaxes(wrong, -1, -2) + bias * rng.standard_normal((trials, 1, len(elements)))
    phase = phase + sigma * rng.standard_normal(phase.shape) + rng.random((trials, len(sky), 1))
    return phase_residuals(phase, elements, sky)


@pytest.mark.parametrize("side", [1, 5])
def test_calibrated_tests_alarm_at_the_rate_asked_for(side):
    rng = np.random.default_rng(side)
    z = draw_residuals(rng, 20_000, side, bias=0.02)
    z = z + rng.integers(-3, 4, z.shape)
    covariance = list_errors(side, bias_sigma_cyc=0.02)
    blocks = np.array([covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(8)])
    near = subtract_nearest_whole(z, blocks)[0]
    without_bias, its_covariance = subtract_first_signal(near, list_errors(side))
    p_values = {
        "single": chi_square_survival(single_statistic(z, blocks, wrapped=True)[:, 3], 2),
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
    z = draw_residuals(np.random.default_rng(side), 100_000, side)
    covariance = list_errors(side)
    joint = chi_square_survival(joint_statistic(z, covariance, wrapped=True), 16)
    conditional = chi_square_survival(conditional_statistics(z, covariance, wrapped=True), 2)
    for p in (joint, *conditional.T):
        assert kstest(p, "uniform").pvalue > 1e-4
        assert binomial_two_sided(int(np.sum(p < 0.001)), p.size, 0.001) > 1e-4


def test_the_first_order_attitude_model_matches_rotations():
    z = draw_residuals(np.random.default_rng(2), 40_000, 5, tilt=np.radians(0.5) ** 2)
    counted = np.cov(z.reshape(len(z), -1).T)
    covariance = list_errors(5, attitude_covariance_rad2=np.radians(0.5) ** 2)
    np.testing.assert_allclose(counted, covariance, atol=0.03 * np.diag(covariance).max())


def test_neither_the_first_antenna_nor_satellite_matters():
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
        z = phase_residuals(phase[:, satellites][..., antennas], elements[antennas], SKY[satellites])
        return joint_statistic(*subtract_first_signal(z, covariance)) if fair else joint_statistic(z, covariance)

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
    moved = draw_directions(*((az, el + (shift if el < 70 else -shift)) for az, el in SKY_DEG))
    apart = (moved - SKY) @ array_design(equilateral_triangle(side)).T
    covariance = list_errors(side)
    one_false = np.zeros((8, 8, 2))
    one_false[np.arange(8), np.arange(8)] = apart
    blocks = np.array([covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(8)])
    found = {
        clean: compute_power(0.01, single_statistic(apart, WHITE)),
        alone: compute_power(0.01, single_statistic(apart, blocks)),
        given: compute_power(0.01, np.diag(conditional_statistics(one_false, covariance))),
        joint: compute_power(0.01, joint_statistic(one_false, covariance), 16),
    }
    for expected, p_d in found.items():
        assert np.mean(p_d) == pytest.approx(expected, abs=1e-3)


# Whole cycles ---------------------------------------------------------------------------------------------------------


def test_blind_directions_of_a_long_triangle():
    true_direction = draw_directions((148, 30))[0]
    blind = blind_directions(true_direction, equilateral_triangle(5))
    assert len(blind) == 69
    assert np.min(np.linalg.norm(blind - true_direction, axis=-1)) < 1e-12
    cycles = array_design(equilateral_triangle(5)) @ (blind - true_direction).T
    np.testing.assert_allclose(cycles, np.rint(cycles), atol=1e-9)
    level = blind[:, :2]
    apart = np.linalg.norm(level[:, None] - level, axis=-1)[~np.eye(69, dtype=bool)]
    assert apart.min() == pytest.approx(1.1547 / 5, abs=1e-5)


def test_no_blind_direction_below_0_577_wavelengths():
    for k, true_direction in enumerate(hemisphere(50)):
        assert len(blind_directions(true_direction, equilateral_triangle(0.57))) == 1, k
    counts = [
        len(blind_directions(true_direction, equilateral_triangle(1.0))) - 1 for true_direction in hemisphere(3000)
    ]
    assert np.mean(counts) == pytest.approx(1.86, abs=0.08)
    assert max(counts) == 2


def test_a_blind_direction_is_found_only_without_whole_cycles():
    rng = np.random.default_rng(6)
    apart = array_design(equilateral_triangle(1)) @ (draw_directions((335.97, 73.10)) - draw_directions((148, 30)))[0]
    z = apart + rng.multivariate_normal([0, 0], WHITE, 50_000)
    assert np.all(single_statistic(z, WHITE) > 9.2103)
    assert np.mean(single_statistic(z, WHITE, wrapped=True) > 9.2103) == pytest.approx(0.0106, abs=0.0014)


@pytest.mark.parametrize(
    ("side", "plain", "wrapped"),
    # Plain by quadrature; the reference drew 150 directions (2.11, 0.594, 0.188, 0.033, each within 4 % or so).
    [(0.5, 2.081, 2.11), (1, 0.6153, 1.62), (2, 0.1776, 1.53), (5, 0.0334, 1.50)],
)
def test_longer_baselines_need_known_cycles_to_see_more(side, plain, wrapped):
    predicted, received = hemisphere(100), hemisphere(50_000)
    design = array_design(equilateral_triangle(side))
    found = measure_dead_zone(predicted, received, design, WHITE).mean() / len(received) * 100
    assert found == pytest.approx(plain, rel=0.03)
    found = measure_dead_zone(predicted, received, design, WHITE, wrapped=True).mean() / len(received) * 100
    assert found == pytest.approx(wrapped, rel=0.06)


def make_block_diagonal(*matrices):
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
            covariance = make_block_diagonal(covariance, covariance)
        received = hemisphere(30_000)
        if sphere:
            received = np.vstack([received, -received])
        found = measure_dead_zone(hemisphere(60), received, design, covariance, wrapped=True)
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
        found = joint_statistic(apart, list_errors(side), wrapped=True).min()
        assert found == pytest.approx(with_errors, rel=0.01)  # ours; no reference


def test_differences_are_against_the_first_antenna():
    values = np.arange(24.0).reshape(2, 3, 4)
    np.testing.assert_array_equal(differences(values), values[..., 1:] - values[..., :1])
    np.testing.assert_array_equal(differences(values, axis=1), values[:, 1:] - values[:, :1])
