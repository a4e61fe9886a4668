"""One spinning antenna: the paper's numbers, and what the whole series gives.

Golden numbers are those of an independent re-derivation of the paper, to the digits printed there.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.stats import kstest
from tests.detectors.nulls import ARM, draw_spin_records
from tests.detectors.nulls import draw_spin_phases as series

from skyproof.detectors.array.arm_phases import (
    arm_columns,
    estimate_rate,
    find_bent_signals,
    fit_whole_series,
    repair_slips,
    step_statistics,
    subtract_mean,
)
from skyproof.detectors.array.spin import Spin
from skyproof.records import SpinArm
from skyproof.statistics.directions import direction_cosines, equal_clusters, equal_statistic
from skyproof.statistics.distributions import (
    binomial_two_sided,
    chi_square_survival,
    chi_square_threshold,
    noncentral_chi_square_survival,
)
from skyproof.studies.arm_angles import (
    arm_angles,
    authentic_threshold,
    circular_threshold,
    compare_with_prediction,
    detection_power,
    fit_pairs,
    full_information,
    pair_information,
)
from skyproof.studies.direction_tests import (
    blocks,
    equal_p_value,
    measure_dead_zone,
    noncentrality_for_power,
    outsider_statistic,
)

W = 0.05 * np.pi
ONE = {"radius_cyc": 0.5, "sigma_cyc": 0.01}
PAIR = {"radius_cyc": 0.5, "sigma_cyc": 0.01 * np.sqrt(2.0)}
SKY_DEG = np.array([(20, 15), (75, 40), (110, 65), (160, 25), (205, 50), (250, 20), (300, 35), (340, 75)], float)
SKY = direction_cosines(*np.radians(SKY_DEG.T))[:, :2]


def make_level(az_deg, el_deg):
    return direction_cosines(np.radians(az_deg), np.radians(el_deg))[:2]


APART = make_level(155, 50) - make_level(160, 55)


def move_apart(test, n, apart=APART, **settings):
    angle = arm_angles(n, W)
    information = pair_information if test == "paper" else full_information
    return float(apart @ information(angle, **PAIR, **settings) @ apart)


def make_usual(noncentrality):
    return noncentral_chi_square_survival(chi_square_threshold(0.01, 2), 2, noncentrality)


# The paper's test -----------------------------------------------------------------------------------------------------


def test_information_of_the_papers_differences():
    expected = {
        50: [[0.27591, 0.03485], [0.03485, 0.31142]],
        150: [[0.88770, 0.03485], [0.03485, 0.92321]],
        200: 1.22359 * np.eye(2),
        300: 1.83538 * np.eye(2),
    }
    for n, matrix in expected.items():
        np.testing.assert_allclose(pair_information(arm_angles(n, W), **PAIR) * 4e-4, matrix, atol=5.1e-6)


def test_every_sample_is_used_at_most_once_and_noise_stays_white():
    for n, rows in ((40, 20), (50, 24), (150, 74), (200, 100), (300, 150)):
        sizes = fit_pairs(np.eye(n), arm_angles(n, W), **PAIR)
        used = np.linalg.norm(sizes.level, axis=-1) > 0
        assert used.sum() == 2 * rows


@pytest.mark.parametrize(
    ("apart", "n", "noncentrality", "threshold", "p_d"),
    [
        (APART, 50, 5.1722, 0.2427, 0.1143),
        (APART, 300, 34.8544, 13.5756, 0.9989),
        (make_level(148, 50) - make_level(160, 55), 150, 48.0884, 22.0503, 0.999984),
        (make_level(158, 53) - make_level(160, 55), 150, 2.6821, 0.0760, 0.0373),
        (np.zeros(2), 150, 0.0, 0.0201, 0.0100),
    ],
)
def test_thresholds_and_detection_of_the_paper(apart, n, noncentrality, threshold, p_d):
    found = move_apart("paper", n, apart)
    limit = authentic_threshold(0.01, found)
    assert found == pytest.approx(noncentrality, abs=6e-5)
    assert float(limit) == pytest.approx(threshold, abs=5.1e-5)
    assert float(detection_power(limit)) == pytest.approx(p_d, abs=5.1e-5)


def test_operating_characteristics():
    expected = {
        50: (5.1722, 0.0131, 0.1143, 0.5715),
        100: (11.6181, 0.1923, 0.5815, 0.9303),
        150: (16.7904, 0.5285, 0.8501, 0.9875),
        200: (23.2363, 0.8334, 0.9689, 0.9988),
        250: (28.4085, 0.9409, 0.9924, 0.9998),
        300: (34.8544, 0.9864, 0.9989, 1.0000),
    }
    for n, (noncentrality, *powers) in expected.items():
        found = move_apart("paper", n)
        assert found == pytest.approx(noncentrality, abs=6e-5)
        np.testing.assert_allclose(detection_power(authentic_threshold([1e-3, 1e-2, 1e-1], found)), powers, atol=6e-5)


@pytest.mark.parametrize(
    ("n", "paper", "full"),
    [
        (40, (1194, 1012, 1012, 1516), (145, 210, 140, 205)),
        (50, (994, 863, 846, 1284), (42, 67, 40, 62)),
        (150, (279, 389, 266, 398), (8, 10, 8, 12)),
        (200, (202, 318, 194, 296), (4, 8, 4, 8)),
    ],
)
def test_dead_zones(n, paper, full):
    reference = direction_cosines(*np.radians([(40, 160, 240, 320), (35, 20, 55, 70)]))
    grid, angle = blocks(), arm_angles(n, W)
    for expected, information in ((paper, pair_information(angle, **PAIR)), (full, full_information(angle, **PAIR))):
        found = measure_dead_zone(reference, grid.direction, np.eye(3)[:2], np.linalg.inv(information))
        assert np.abs(found - expected).max() <= 1
    if n == 150:
        assert np.all(20 * np.array(full) < paper)


def test_the_smaller_dead_zone_of_figure_5():
    grid = blocks()
    covariance = np.linalg.inv(pair_information(arm_angles(150, W), **PAIR))
    reference = direction_cosines(*np.radians([[160], [55]]))
    # In the paper's sense: the threshold that a same pair stays below with 0.8, an authentic one with 0.01.
    rates = {"power": 0.99, "false_alarm_probability": 0.2}
    assert float(noncentrality_for_power(0.99, 0.2, 2)) == pytest.approx(15.4596, abs=5e-5)
    assert measure_dead_zone(reference, grid.direction, np.eye(3)[:2], covariance, **rates) == [151]
    near = direction_cosines(*np.radians([(148, 158, 160), (50, 53, 55)]))
    inside = [
        measure_dead_zone(reference, direction[None], np.eye(3)[:2], covariance, **rates)[0] for direction in near
    ]
    assert inside == [0.0, 1.0, 1.0]


def test_the_rule_finds_one_spoofed_pair_in_a_hundred():
    limit = circular_threshold(0.01)
    assert limit == pytest.approx(0.020306, abs=5e-7)
    assert float(detection_power(limit)) == pytest.approx(0.0101, abs=5e-5)
    assert circular_threshold(0.1) == pytest.approx(0.237, abs=5e-4)
    assert float(detection_power(circular_threshold(0.1))) == pytest.approx(0.112, abs=5e-4)
    noise = PAIR["sigma_cyc"] * np.random.default_rng(1).standard_normal((50_000, 150))
    statistic = fit_pairs(noise, arm_angles(150, W), **PAIR).statistic
    np.testing.assert_array_equal(statistic < authentic_threshold(0.01, statistic), statistic < limit)
    assert binomial_two_sided(int(np.sum(statistic < limit)), statistic.size, 0.0101) > 1e-4


# The whole series -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n", "paper", "constant", "slope", "curvature"),
    [
        (20, 2.324, 32.12, 14.77, 0.290),
        (30, 2.849, 163.1, 24.12, 14.67),
        (36, 3.739, 188.1, 45.97, 43.54),
        (40, 4.647, 189.9, 95.60, 63.05),
        (50, 5.172, 247.3, 244.4, 75.51),
        (100, 11.62, 462.2, 462.1, 405.1),
        (150, 16.79, 735.1, 719.0, 717.5),
        (300, 34.85, 1420, 1420, 1399),
    ],
)
def test_noncentrality_against_the_number_of_samples(n, paper, constant, slope, curvature):
    found = [move_apart("paper", n)] + [move_apart("full", n, degree=degree) for degree in (0, 1, 2)]
    np.testing.assert_allclose(found, [paper, constant, slope, curvature], rtol=6e-4)


def test_detection_and_the_fewest_samples():
    assert move_apart("full", 40) == pytest.approx(63.05, abs=5e-3)
    assert move_apart("full", 150) == pytest.approx(717.52, abs=5e-3)
    assert move_apart("full", 150, degree=3) == pytest.approx(655.6, abs=0.05)
    assert move_apart("full", 40, degree=3) == pytest.approx(4.0, abs=0.05)
    assert move_apart("full", 150, make_level(148, 50) - make_level(160, 55)) == pytest.approx(1903, abs=0.5)
    assert move_apart("full", 150, make_level(158, 53) - make_level(160, 55)) == pytest.approx(115.35, abs=5e-3)
    assert float(authentic_threshold(0.01, move_apart("full", 40))) == pytest.approx(32.355, abs=1e-3)
    in_papers_sense = [float(detection_power(authentic_threshold(0.01, move_apart("full", n)))) for n in (20, 30, 36)]
    np.testing.assert_allclose(in_papers_sense, [0.0116, 0.7645, 0.99993], atol=6e-5)
    in_usual_sense = [float(make_usual(move_apart("full", n))) for n in (20, 30, 36)]
    np.testing.assert_allclose(in_usual_sense, [0.0173, 0.8275, 0.99988], atol=6e-5)


def test_whitened_differences_are_the_series_less_two_constants():
    n, rng = 150, np.random.default_rng(2)
    y, columns = rng.standard_normal(n), arm_columns(arm_angles(n, W), 0.5)
    lag = np.eye(n)[2:] - np.eye(n)[:-2]
    covariance = lag @ lag.T
    design = lag @ columns
    information = design.T @ np.linalg.solve(covariance, design)
    overlapping = np.linalg.solve(information, design.T @ np.linalg.solve(covariance, lag @ y))
    constants = np.column_stack([np.arange(n) % 2 == 0, np.arange(n) % 2 == 1]).astype(float)
    whole = np.linalg.lstsq(np.hstack([columns, constants]), y, rcond=None)[0][:2]
    np.testing.assert_allclose(overlapping, whole, rtol=1e-9)
    assert float(APART @ information @ APART) / PAIR["sigma_cyc"] ** 2 == pytest.approx(735.121, abs=1e-3)
    assert move_apart("full", n, degree=0) == pytest.approx(735.149, abs=1e-3)


def test_cycles_drift_curvature_and_order_keep_the_statistic():
    rng = np.random.default_rng(3)
    y = rng.standard_normal((20, 150)) * 0.014
    angle = arm_angles(150, W)
    expected = fit_whole_series(y, angle, **PAIR).statistic
    t = np.arange(150)
    moved = y + rng.integers(-9, 9, (20, 1)) + rng.standard_normal((20, 1)) * t + 0.01 * t**2
    np.testing.assert_allclose(fit_whole_series(moved, angle, **PAIR).statistic, expected, rtol=1e-6)
    np.testing.assert_allclose(fit_whole_series(-y, angle, **PAIR).statistic, expected, rtol=1e-12)
    np.testing.assert_allclose(fit_whole_series(y, angle, **PAIR, time=7.0 + 0.1 * t).statistic, expected, rtol=1e-9)
    # Whole turns, and a quadratic that is nearly blind to them: the start angle only turns the estimate.
    start = fit_whole_series(y, angle + 1.0, **PAIR, degree=0)
    np.testing.assert_allclose(
        start.statistic[:, None], fit_whole_series(y, angle, **PAIR, degree=0).statistic[:, None], rtol=1e-9
    )


@pytest.mark.parametrize("n", [40, 150])
def test_a_drifting_spoofed_pair_keeps_the_full_tests_rate(n):
    rng = np.random.default_rng(n)
    t = np.arange(n) / 10.0
    noise = PAIR["sigma_cyc"] * rng.standard_normal((50_000, n))
    y = noise + 0.7 * rng.standard_normal((50_000, 1)) * t + 0.05 * rng.standard_normal((50_000, 1)) * t**2
    p = chi_square_survival(fit_whole_series(y, arm_angles(n, W), **PAIR).statistic, 2)
    for level_of in (0.1, 0.01):
        assert binomial_two_sided(int(np.sum(p < level_of)), p.size, level_of) > 1e-4
    # Another start and another rate do no harm to the test of equality.
    p = chi_square_survival(fit_whole_series(y, arm_angles(n, 1.05 * W, start_rad=1.0), **PAIR).statistic, 2)
    assert binomial_two_sided(int(np.sum(p < 0.01)), p.size, 0.01) > 1e-4
    if n == 150:
        drift = fit_pairs(0.07 * np.arange(n), arm_angles(n, W), **PAIR).statistic
        assert float(drift) == pytest.approx(37.7, abs=0.1)


@pytest.mark.long
def test_p_values_of_the_full_test_are_uniform():
    rng = np.random.default_rng(4)
    noise = 0.01 * rng.standard_normal((100_000, 4, 60)) + rng.standard_normal((100_000, 1, 60))
    fit = fit_whole_series(subtract_mean(noise), arm_angles(60, W), **ONE)
    pair = fit.level[:, 0] - fit.level[:, 1]
    p = chi_square_survival(np.sum((pair @ fit.information) * pair, axis=-1) / 2.0, 2)
    joint = equal_p_value(fit.level, np.linalg.inv(fit.information))
    for found in (p, joint):
        assert kstest(found, "uniform").pvalue > 1e-4
        assert binomial_two_sided(int(np.sum(found < 0.001)), found.size, 0.001) > 1e-4


def test_motion_that_a_quadratic_leaves():
    # The worst third-order term of a pair that adds 0.8 at N = 150 adds 0.001 at N = 40 and 1.7 at N = 300.
    def bias(n):
        t = np.arange(n) / 10.0
        cubic = legendre.legval(2.0 * t / t[-1] - 1.0, [0, 0, 0, 1.0]) * (t[-1] / 2.0) ** 3 / 2.5
        return float(fit_whole_series(cubic, arm_angles(n, W), **PAIR).statistic)

    scale = 0.8 / bias(150)
    assert scale * bias(300) == pytest.approx(1.7, abs=0.2)
    assert scale * bias(40) == pytest.approx(0.001, abs=5e-4)


# Start angle and rate -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "kept"), [(150, (0.9964, 0.9803, 0.874)), (300, (0.985, 0.944, 0.656))])
def test_what_an_error_of_the_rate_costs(n, kept):
    for error, share in zip((0.01, 0.02, 0.05), kept, strict=True):
        y = arm_columns(arm_angles(n, W * (1 + error)), 0.5) @ APART
        assert float(fit_whole_series(y, arm_angles(n, W), **PAIR).statistic) / move_apart("full", n) == pytest.approx(
            share, abs=6e-4
        )


@pytest.mark.parametrize("w", [W, -W], ids=["clockwise", "counterclockwise"])
def test_the_rate_is_found_as_well_as_it_can_be(w):
    rng = np.random.default_rng(5)
    y = series(rng, SKY[:4], 150, trials=(1000,), rate=1.013 * w, start=0.3)
    found = estimate_rate(y, w, **ONE)
    error = found.rate_rad / w - 1.013
    assert error.std() == pytest.approx(2.5e-4, rel=0.15)
    np.testing.assert_allclose(found.sigma_rad / abs(w), error.std(), rtol=0.1)
    assert abs(error.mean()) < 4 * error.std() / np.sqrt(1000)


def test_what_is_known_of_the_rate_weighs_as_much_as_it_should():
    y = series(np.random.default_rng(17), SKY[:4], 150, trials=(200,), rate=1.004 * W)
    alone = estimate_rate(y, W, **ONE).sigma_rad.mean()
    sigma = 1e-4 * W
    found = estimate_rate(y, W, **ONE, rate_sigma_rad=sigma)
    share = alone**-2.0 / (alone**-2.0 + sigma**-2.0)
    assert found.rate_rad.mean() / W - 1.0 == pytest.approx(0.004 * share, rel=0.1)


def test_signals_of_one_direction_leave_the_rate_where_it_was():
    rng = np.random.default_rng(6)
    y = series(rng, np.repeat(SKY[:1], 4, axis=0), 150, trials=(300,))
    found = estimate_rate(y, W, **ONE, rate_sigma_rad=0.003 * W)
    assert np.abs(found.rate_rad / W - 1.0).max() < 0.003
    # The estimated rate hardly changes the false alarms of the test of equality.
    levels = [
        fit_whole_series(subtract_mean(one_series), arm_angles(150, rate), **ONE).level
        for one_series, rate in zip(y, found.rate_rad, strict=True)
    ]
    covariance = np.linalg.inv(full_information(arm_angles(150, W), **ONE))
    p = equal_p_value(np.array(levels), covariance)
    assert kstest(p, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("n", [40, 150])
def test_predicted_directions_with_a_start_angle_to_estimate(n):
    rng = np.random.default_rng(7)
    y = series(rng, SKY, n, trials=(10_000,), start=0.8)
    fit = fit_whole_series(subtract_mean(y), arm_angles(n, W), **ONE)
    found = compare_with_prediction(fit.level, SKY, fit.information, start_known=False)
    assert found.dof == 13
    assert np.median(found.start_rad) == pytest.approx(0.8, abs=2e-3)
    p = chi_square_survival(found.statistic, found.dof)
    assert binomial_two_sided(int(np.sum(p < 0.01)), p.size, 0.01) > 1e-4
    known = fit_whole_series(subtract_mean(y), arm_angles(n, W, start_rad=0.8), **ONE)
    exact = compare_with_prediction(known.level, SKY, known.information)
    assert exact.dof == 14
    p = chi_square_survival(exact.statistic, 14)
    assert binomial_two_sided(int(np.sum(p < 0.01)), p.size, 0.01) > 1e-4


@pytest.mark.parametrize(("n", "lifted", "p_d"), [(40, 60, 0.936), (150, 60, 1.0), (40, 63, 0.27), (150, 63, 1.0)])
def test_one_satellite_that_is_not_where_predicted(n, lifted, p_d):
    sky = SKY.copy()
    sky[2] = make_level(110, lifted)
    information = full_information(arm_angles(n, W), **ONE)
    start = np.arange(0.0, 2.0 * np.pi, 0.05)  # at one turn much depends on where it starts
    rot = np.moveaxis(np.array([[np.cos(start), -np.sin(start)], [np.sin(start), np.cos(start)]]), -1, 0)
    shift = compare_with_prediction(sky @ np.swapaxes(rot, -1, -2), SKY, information, start_known=False).statistic
    found = noncentral_chi_square_survival(chi_square_threshold(0.01, 13), 13, shift)
    assert found.mean() == pytest.approx(p_d, abs=0.025)
    y = series(np.random.default_rng(8), sky, n, trials=(4000,), start=start[16])
    fit = fit_whole_series(subtract_mean(y), arm_angles(n, W), **ONE)
    counted = compare_with_prediction(fit.level, SKY, fit.information, start_known=False).statistic
    assert np.mean(counted > chi_square_threshold(0.01, 13)) == pytest.approx(found[16], abs=0.02)


def test_noncentrality_of_a_pair_follows_predicted_directions():
    assert move_apart("full", 40, make_level(148, 50) - make_level(158, 53)) == pytest.approx(127.3, abs=0.05)
    assert move_apart("full", 150, make_level(148, 50) - make_level(158, 53)) == pytest.approx(1207, abs=0.5)
    for n, p_d in ((40, 0.502), (150, 0.996)):
        assert float(make_usual(move_apart("paper", n, make_level(148, 50) - make_level(158, 53)))) == pytest.approx(
            p_d, abs=6e-4
        )
    assert float(make_usual(move_apart("paper", 40))) == pytest.approx(0.248, abs=6e-4)


# Slips ----------------------------------------------------------------------------------------------------------------


def test_the_largest_step_of_a_clean_series():
    rng = np.random.default_rng(9)
    y = PAIR["sigma_cyc"] * rng.standard_normal((40_000, 150))
    largest = step_statistics(y, arm_angles(150, W), sigma_cyc=PAIR["sigma_cyc"])[0].max(axis=-1)
    np.testing.assert_allclose(np.quantile(largest, [0.99, 0.999]), [14.2, 19.3], rtol=0.05)


def test_a_half_cycle_slip_stands_out_and_would_divide_a_pair():
    y = 0.5 * (np.arange(150) >= np.arange(5, 146)[:, None])
    statistic, size = step_statistics(y, arm_angles(150, W), sigma_cyc=PAIR["sigma_cyc"])
    assert statistic.max(axis=-1).min() >= 4223
    np.testing.assert_array_equal(statistic.argmax(axis=-1), np.arange(4, 145))
    np.testing.assert_allclose(size[np.arange(141), np.arange(4, 145)], 0.5, rtol=1e-9)
    near_the_middle = np.arange(150) >= 70
    for fit, half, whole in ((fit_whole_series, 1199, 4795), (fit_pairs, 68, 273)):
        for step, bias in ((0.5, half), (1.0, whole)):
            found = fit(step * near_the_middle, arm_angles(150, W), **PAIR).statistic
            assert float(found) == pytest.approx(bias, abs=0.5)


def test_slips_are_repaired_where_they_are_and_nowhere_else():
    rng = np.random.default_rng(10)
    y = series(rng, SKY[:4], 150, trials=(300,))
    place, size = rng.integers(10, 140, 300), rng.choice([-1.0, -0.5, 0.5, 1.0], 300)
    y[:, 2] += size[:, None] * (np.arange(150) >= place[:, None])
    second = rng.integers(10, 140, 300)
    y[:, 0] += 0.5 * (np.arange(150) >= second[:, None])
    repaired = repair_slips(y, arm_angles(150, W), sigma_cyc=0.01)
    expected = np.zeros(y.shape)
    expected[np.arange(300), 2, place] += size
    expected[np.arange(300), 0, second] += 0.5
    # Two of four slipping at once by a half are the other two slipping back: only differences count.
    np.testing.assert_allclose(subtract_mean(repaired.jump_cyc), subtract_mean(expected), atol=1e-12)
    np.testing.assert_allclose(repaired.phase_cyc, y - np.cumsum(repaired.jump_cyc, axis=-1), atol=1e-9)
    clean = repair_slips(repaired.phase_cyc, arm_angles(150, W), sigma_cyc=0.01)
    assert not clean.jump_cyc.any()


# Many signals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("signals", [4, 5])
def test_all_of_one_direction_under_any_clock(signals):
    rng = np.random.default_rng(signals)
    y = series(rng, np.repeat(SKY[:1], signals, axis=0), 60, trials=(20_000,))
    fit = fit_whole_series(subtract_mean(y), arm_angles(60, W), **ONE)
    statistic = equal_statistic(fit.level, np.linalg.inv(fit.information))[0]
    assert statistic.mean() == pytest.approx(2 * (signals - 1), rel=0.02)
    p = chi_square_survival(statistic, 2 * (signals - 1))
    assert binomial_two_sided(int(np.sum(p < 0.01)), p.size, 0.01) > 1e-4


@pytest.mark.parametrize("n", [40, 150])
def test_four_false_signals_among_nine_are_clustered(n):
    distant = [(20, 15), (75, 40), (250, 20), (340, 75)]
    directions = np.array([make_level(160, 55)] * 4 + [make_level(*d) for d in distant] + [make_level(158, 53)])
    y = series(np.random.default_rng(n), directions, n, trials=(2000,))
    fit = fit_whole_series(subtract_mean(y), arm_angles(n, W), **ONE)
    covariance = np.linalg.inv(fit.information)
    clusters = equal_clusters(fit.level, covariance, false_alarm_probability=0.01)
    assert clusters.limit == pytest.approx(16.377, abs=5e-4)
    apart = clusters.distance[:, 8, :4].min(axis=-1) > clusters.limit
    assert np.mean(np.all(clusters.labels[:, 4:8] == [4, 5, 6, 7], axis=-1)) == 1.0
    if n == 150:
        right = np.all(clusters.labels == [0, 0, 0, 0, 4, 5, 6, 7, 8], axis=-1)
        assert np.mean(right) == pytest.approx(0.9990, abs=0.004)
        assert apart.all()
    else:
        near = np.all(clusters.distance[:, :4, :4] <= clusters.limit, axis=(-1, -2))
        assert np.mean(near) == pytest.approx(0.9985, abs=0.004)
        assert np.mean(apart) == pytest.approx(0.036, abs=0.015)
        group, of_mean = equal_statistic(fit.level[:, :4], covariance)[1:]
        from_group = outsider_statistic(fit.level[:, 8], covariance, group, of_mean) > 9.2103
        assert np.mean(from_group) > 0.45


# The detector ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slip", [None, 2, 5])
def test_false_signals_are_named_although_one_slips(slip):
    directions = np.vstack([SKY[:4], np.repeat(make_level(160, 55)[None], 4, axis=0)])
    evidence, _ = Spin().examine(draw_spin_records(np.random.default_rng(13), directions, slip=slip))
    (finding,) = evidence
    assert finding.says == "spoofed"
    assert [ref.signal.sat for ref in finding.signals] == ["G05", "G06", "G07", "G08"]


def test_a_sky_is_authentic_also_where_the_rate_is_known_roughly():
    arm = SpinArm(receiver="rx1", radius_m=ARM.radius_m, rate_rad_s=10.0 * W, rate_sigma_rad_s=0.1 * W)
    evidence, _ = Spin().examine(draw_spin_records(np.random.default_rng(14), SKY, arm=arm, rate=1.008 * W))
    assert [e.says for e in evidence] == ["authentic"]


def test_a_part_of_a_turn_decides_nothing():
    evidence, _ = Spin().examine(draw_spin_records(np.random.default_rng(15), SKY, n=15))
    assert [(e.says, e.p) for e in evidence] == [("undecided", {})]


def test_a_receiver_that_does_not_turn_is_reported():
    still = SpinArm(receiver="other", radius_m=0.1, rate_rad_s=1.0)
    evidence, _ = Spin().examine(draw_spin_records(np.random.default_rng(16), SKY, arm=still))
    assert [e.code for e in evidence] == ["no_arm"]


@pytest.mark.parametrize("timed", [True, False])
def test_signals_without_a_time_are_not_false_beside_others(timed):
    # A jammer's wave, followed as several codes, comes from one direction; a log of carriers alone has no times.
    directions = SKY.copy()
    directions[:3] = SKY[:1]
    records = draw_spin_records(np.random.default_rng(17), directions)
    (o,) = records.observations
    range_m = o.pseudorange_m.copy()
    range_m[:, :3] = np.nan
    if not timed:
        range_m[:] = np.nan
    evidence, _ = Spin().examine(replace(records, observations=(replace(o, pseudorange_m=range_m),)))
    named = {ref.signal for finding in evidence if finding.says == "spoofed" for ref in finding.signals}
    assert named == (set() if timed else set(o.signals[:3]))


# Of no one direction --------------------------------------------------------------------------------------------------


def mix_phases(rng, n=6, count=50, *, mixed=(), cycles_apart=3.0):
    """Draw phases (n, count) of a sky on an arm, each with noise of 0.01 cycle.

    Those in `mixed` have a second signal of half the amplitude from one direction, which is dragged off by some
    cycles.
    """
    angle = 2.0 * np.pi * np.arange(count) / 20.0
    columns = arm_columns(angle, 0.5)
    second = columns @ make_level(100, 30)
    phases = []
    for k in range(n):
        phase = columns @ SKY[k]
        if k in mixed:
            turned = second + cycles_apart * np.arange(count) / count + rng.uniform()
            phase = phase + np.angle(1.0 + 0.5 * np.exp(2j * np.pi * (turned - phase))) / (2.0 * np.pi)
        phases.append(1e7 * (k + 1) + phase + 0.01 * rng.standard_normal(count))
    return np.array(phases), angle


def test_signals_of_one_direction_are_rarely_called_bent():
    rng = np.random.default_rng(8)
    for asked, draws in ((0.1, 1500), (0.01, 1500)):
        found = sum(
            find_bent_signals(*mix_phases(rng), np.full(6, 0.01), accept_probability=asked).size > 0
            for _ in range(draws)
        )
        assert 0.6 * asked * draws - 3.0 * np.sqrt(asked * draws) < found < asked * draws + 3.0 * np.sqrt(asked * draws)


def test_only_signals_that_share_two_directions_are_bent():
    rng = np.random.default_rng(9)
    for mixed in ((), (2,), (0, 3), (0, 1, 2, 3)):
        phases, angle = mix_phases(rng, mixed=mixed)
        assert tuple(find_bent_signals(phases, angle, np.full(6, 0.01))) == mixed


def test_of_two_signals_none_is_said_to_be_bent():
    phases, angle = mix_phases(np.random.default_rng(10), n=2, mixed=(1,))
    assert find_bent_signals(phases, angle, np.full(2, 0.01)).size == 0
