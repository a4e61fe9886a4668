"""Clusters of one direction, with an array and no attitude."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.stats import binom
from tests.detectors.nulls import draw_array_phases, make_window

from skyproof.detectors.array.array_common import (
    ArrayCommon,
    ArrayCommonSettings,
    bound_chance_by_size,
    bound_chance_of_cluster,
)
from skyproof.detectors.array.array_model import array_design, white_covariance
from skyproof.records import ArrayPhases, Cause, SignalId
from skyproof.statistics.directions import (
    Clusters,
    complete_linkage,
    direction_cosines,
    equal_clusters,
    equal_statistic,
    equality_chance,
    pair_statistics,
    subtract_nearest_whole,
)
from skyproof.statistics.distributions import binomial_two_sided, chi_square_threshold
from skyproof.studies.array_geometry import equilateral_triangle, regular_tetrahedron
from skyproof.studies.direction_tests import equal_p_value, outsider_statistic

SKY_DEG = np.array([(20, 15), (75, 40), (110, 65), (160, 25), (205, 50), (250, 20), (300, 35), (340, 75)], float)
SKY = direction_cosines(*np.radians(SKY_DEG.T))


# Equality -------------------------------------------------------------------------------------------------------------


def test_whole_cycles_do_not_matter_nor_does_the_first_antenna():
    rng = np.random.default_rng(1)
    phase = 0.05 * rng.standard_normal((500, 5))
    covariance = white_covariance(np.full(5, 0.05))
    expected = subtract_nearest_whole(phase[:, 1:] - phase[:, :1], covariance)[1]
    moved = phase + rng.integers(-4, 5, phase.shape)
    for order in (slice(None), [3, 0, 1, 2, 4]):
        turned = moved[:, order]
        found = subtract_nearest_whole(turned[:, 1:] - turned[:, :1], covariance)[1]
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_nearest_whole_is_the_least_over_all_whole_numbers():
    rng = np.random.default_rng(2)
    covariance = white_covariance([0.1, 0.1, 0.1])
    z = rng.random((200, 2)) * 6 - 3
    all_whole = np.stack(np.meshgrid(np.arange(-6, 7), np.arange(-6, 7)), axis=-1).reshape(-1, 2)
    rest = z[:, None] - all_whole
    every = np.einsum("tka,ab,tkb->tk", rest, np.linalg.inv(covariance), rest)
    remainder, least = subtract_nearest_whole(z, covariance)
    np.testing.assert_allclose(least, every.min(axis=1), rtol=1e-12)
    np.testing.assert_allclose(remainder, rest[np.arange(200), every.argmin(axis=1)], atol=1e-12)


@pytest.mark.parametrize("wrapped", [False, True])
def test_p_values_of_equality_are_uniform(wrapped):
    rng = np.random.default_rng(3)
    covariance = white_covariance([0.01, 0.02, 0.015])
    values = rng.multivariate_normal([0.3, 0.48], covariance, (50_000, 4))
    if wrapped:
        values = values + rng.integers(-3, 3, values.shape)
    p = equal_p_value(values, covariance, wrapped=wrapped)
    for level in (0.5, 0.1, 0.01):
        assert binomial_two_sided(int(np.sum(p < level)), p.size, level) > 1e-4


def test_equality_of_one_pair_is_the_statistic_of_the_pair():
    rng = np.random.default_rng(4)
    covariance = np.stack([white_covariance([0.01, 0.02, 0.015]), white_covariance([0.03, 0.01, 0.01])])
    values = rng.standard_normal((7, 2, 2))
    statistic, mean, of_mean = equal_statistic(values, covariance)
    np.testing.assert_allclose(statistic, pair_statistics(values, covariance)[:, 0, 1])
    # A third vector where the mean is changes nothing.
    np.testing.assert_allclose(outsider_statistic(mean, covariance[0], mean, of_mean), 0.0, atol=1e-12)


def test_complete_linkage_makes_the_clusters_of_its_definition():
    rng = np.random.default_rng(5)
    points = rng.random((300, 7))
    distance = np.abs(points[:, :, None] - points[:, None, :])
    for far, labels in zip(distance, complete_linkage(distance, 0.2), strict=True):
        clusters = [np.flatnonzero(labels == k) for k in np.unique(labels)]
        assert max(far[np.ix_(c, c)].max() for c in clusters) <= 0.2
        apart = [far[np.ix_(a, b)].max() for i, a in enumerate(clusters) for b in clusters[:i]]
        assert min(apart, default=1.0) > 0.2
        assert all(c.min() == k for c, k in zip(clusters, np.unique(labels), strict=True))


def test_equal_vectors_are_divided_as_rarely_as_stated():
    rng = np.random.default_rng(6)
    covariance = white_covariance(np.full(4, 0.01))
    values = rng.multivariate_normal(np.zeros(3), covariance, (20_000, 5))
    clusters = equal_clusters(values, covariance, false_alarm_probability=0.05)
    divided = float(np.mean(np.any(clusters.labels != 0, axis=-1)))
    assert 0.03 < divided < 0.053  # the union bound over ten dependent pairs costs this much
    assert clusters.limit == pytest.approx(float(chi_square_threshold(0.005, 3)))


def test_false_signals_cluster_and_true_ones_do_not():
    rng = np.random.default_rng(7)
    direction = np.vstack([SKY[:5], np.repeat(SKY[6:7], 4, axis=0)])
    elements = regular_tetrahedron(1.0)
    phase = direction @ elements.T + 0.01 * rng.standard_normal((2000, 9, 4))
    values = phase[..., 1:] - phase[..., :1]
    covariance = white_covariance(np.full(4, 0.01))
    labels = equal_clusters(values - np.rint(values), covariance, false_alarm_probability=0.01, wrapped=True).labels
    assert np.mean(np.all(labels == [0, 1, 2, 3, 4, 5, 5, 5, 5], axis=-1)) > 0.985


# What chance makes ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrapped", [False, True])
def test_chance_of_equality_bounds_what_random_skies_do(wrapped):
    rng = np.random.default_rng(8)
    design, covariance = array_design(equilateral_triangle(1.0)), white_covariance([0.01] * 3)
    chance = equality_chance(design, covariance, 9.21, wrapped=wrapped)
    sky = direction_cosines(2.0 * np.pi * rng.random((30_000, 2)), np.arcsin(rng.random((30_000, 2))))
    values = sky @ design.T + rng.multivariate_normal([0, 0], covariance, (30_000, 2))
    equal = float(np.mean(pair_statistics(values, covariance, wrapped=wrapped)[:, 0, 1] < 9.21))
    assert 0.4 * chance < equal < 1.05 * chance
    assert bound_chance_by_size(6, 3, chance) == pytest.approx(20 * chance**2)


@pytest.mark.parametrize("size", [2, 3])
def test_a_clusters_chance_is_at_least_that_of_random_skies(size):
    rng = np.random.default_rng(9)
    design, covariance = array_design(np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])), white_covariance([0.01] * 2)
    p_values = []
    for _ in range(80):
        sky = direction_cosines(2.0 * np.pi * rng.random(3), np.arcsin(rng.random(3)))
        values = sky @ design.T + rng.multivariate_normal([0.0], covariance, 3)
        distance = pair_statistics(values, covariance, wrapped=True)
        clusters = Clusters(np.zeros(3, int), distance, 1e3)
        best = min(combinations(range(3), size), key=lambda rows: distance[np.ix_(rows, rows)].max())
        p_values.append(bound_chance_of_cluster(clusters, np.array(best), 3, size, design, covariance, wrapped=True))
    for level in (0.05, 0.2, 0.5):
        assert binom.sf(np.sum(np.array(p_values) <= level) - 1, 80, level) > 1e-3


# The detector ---------------------------------------------------------------------------------------------------------


def test_signals_of_one_antenna_are_named_but_no_true_one():
    rng = np.random.default_rng(11)
    direction = np.vstack([SKY[:1], np.repeat(SKY[6:7], 5, axis=0)])
    evidence, _ = ArrayCommon().examine(make_window(draw_array_phases(rng, direction)))
    (finding,) = evidence
    assert finding.says == "spoofed"
    assert [ref.signal.sat for ref in finding.signals] == ["G02", "G03", "G04", "G05", "G06"]
    assert finding.p_value < 1e-3


def test_of_two_signals_from_the_transmitter_neither_is_named():
    # The satellite stands behind the transmitter: one of them is its own.
    rng = np.random.default_rng(12)
    phases = draw_array_phases(rng, np.repeat(SKY[6:7], 6, axis=0))
    twice = SignalId("G02", copy="b")
    phases = replace(phases, signals=(*phases.signals[:5], twice))
    evidence, _ = ArrayCommon().examine(make_window(phases))
    (finding,) = evidence
    assert (finding.says, finding.code) == ("spoofed", "one_direction")
    assert (finding.data["size"], finding.data["of"]) == (5, 5)
    assert sorted(ref.signal.sat for ref in finding.signals) == ["G01", "G03", "G04", "G05"]


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_channel_that_lost_its_signal_is_not_compared(share):
    rng = np.random.default_rng(13)
    phases = draw_array_phases(rng, np.repeat(SKY[6:7], 6, axis=0), epochs=20)
    phase_cyc = phases.phase_cyc.copy()
    phase_cyc[round(share * 20) :, 2] = np.nan
    evidence, _ = ArrayCommon().examine(make_window(replace(phases, phase_cyc=phase_cyc)))
    (finding,) = evidence
    assert len(finding.signals) == (5 if share < 0.2 else 6)


def test_a_sky_of_eight_is_authentic():
    evidence, _ = ArrayCommon().examine(make_window(draw_array_phases(np.random.default_rng(12), SKY)))
    assert [e.says for e in evidence] == ["authentic"]
    assert len(evidence[0].signals) == 8


def test_two_equal_antennas_are_one_or_hear_one_transmitter():
    # Phases of two receiver channels behind one splitter, 42 ms long.
    seen_cyc = [0.272, 0.275, 0.273, 0.266, 0.273, 0.274, 0.275, 0.272]
    elements = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    phases = draw_array_phases(np.random.default_rng(14), SKY, epochs=2, elements=elements)
    phase_cyc = np.zeros((2, 8, 2))
    phase_cyc[..., 1] = seen_cyc
    alike = replace(phases, phase_cyc=phase_cyc, sigma_cyc=np.full(phase_cyc.shape, 0.003), lasting_sigma_cyc=0.01)
    detector = ArrayCommon(ArrayCommonSettings(false_alarm_probability=1e-9))
    (found,), _ = detector.examine(make_window(alike))
    assert (found.code, found.says, found.may_also_be) == ("one_direction_or_antenna", "undecided", (Cause.STATEMENT,))
    assert found.failed
    assert found.p[Cause.CLEAN] < 1e-9
    phase_cyc[:, 0, 1] = 0.9
    detector = ArrayCommon(ArrayCommonSettings(false_alarm_probability=1e-4))
    (found,), _ = detector.examine(make_window(replace(alike, phase_cyc=phase_cyc)))
    assert (found.code, found.says, len(found.signals)) == ("one_direction", "spoofed", 7)


def test_two_signals_from_one_place_are_too_few_to_tell():
    phases = draw_array_phases(np.random.default_rng(13), np.repeat(SKY[:1], 2, axis=0))
    (finding,), _ = ArrayCommon().examine(make_window(phases))
    assert (finding.says, finding.p) == ("undecided", {})


def test_missing_antennas_cost_only_their_cells():
    rng = np.random.default_rng(14)
    phases = draw_array_phases(rng, SKY)
    holed = phases.phase_cyc.copy()
    holed[0, :, 1] = np.nan
    holed[:, 3, 2] = np.nan
    made = {name: getattr(phases, name) for name in ("receiver", "signals", "gpst", "elapsed_s", "elements_m")}
    (finding,), _ = ArrayCommon().examine(make_window(ArrayPhases(**made, phase_cyc=holed, sigma_cyc=phases.sigma_cyc)))
    assert finding.says == "authentic"
    assert "G04" not in {ref.signal.sat for ref in finding.signals}
    assert len(finding.signals) == 7
