"""`VectorSqm` on records."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.detectors.nulls import draw_vector_taps

from skyproof.detectors.correlators.correlator_laws import triangle
from skyproof.detectors.correlators.vector_sqm import satellite_geometry
from skyproof.detectors.correlators.vector_sqm_detector import (
    VectorSqm,
    VectorSqmSettings,
    code_offset_chips,
    select_pair,
    t_squared_survival,
)
from skyproof.errors import SettingsError
from skyproof.navigation.directions import compute_directions
from skyproof.records import Cause
from skyproof.studies.vector_rules import equilibrium


def settle_loops(records, code_chips, doppler_hz, places):
    """Return the offsets at which loops settle when these satellites are attacked alike."""
    (o,), (taps,) = records.observations, records.vector_taps
    where = satellite_geometry(compute_directions(o, records.navigation, taps.signals).design)
    attack = np.isin(np.arange(len(o.signals)), places)
    return equilibrium(where, code_chips * attack, doppler_hz * attack, 45.0)


def examine_attack(places, code_chips=0.3, doppler_hz=150.0, seed=5):
    """Examine an attack; return its findings and the names of the signals."""
    offsets = settle_loops(draw_vector_taps(np.random.default_rng(seed)), code_chips, doppler_hz, places)
    records = draw_vector_taps(np.random.default_rng(seed), *offsets)
    (evidence,) = VectorSqm().examine(records)[0]
    return evidence, [str(signal) for signal in records.vector_taps[0].signals]


def test_a_signal_that_does_not_fit_fails_the_test_and_is_named():
    evidence, names = examine_attack([3])
    assert evidence.failed
    assert (evidence.code, evidence.may_also_be) == ("does_not_fit", (Cause.REFLECTIONS, Cause.FAULT))
    assert (evidence.data["sets"], evidence.data["suspects"]) == (1, (names[3],))


def test_an_offset_below_each_window_is_found_and_dated():
    offsets = settle_loops(draw_vector_taps(np.random.default_rng(5)), 0.0, 5.0, [3])
    rng, strict = np.random.default_rng(12), VectorSqm(VectorSqmSettings(1e-6))
    state, together, alone = None, [], []
    for _ in range(14):
        records = draw_vector_taps(rng, *offsets)
        alone += strict.examine(records)[0]
        evidence, state = strict.examine(records, state)
        together += evidence
    assert not any(finding.failed for finding in alone)
    assert any(finding.failed and "seen_s" in finding.data for finding in together)


def test_nobody_is_called_false_where_many_sets_fit_alike():
    evidence, _ = examine_attack([0, 2, 4, 6])
    assert evidence.failed
    assert evidence.says == "undecided"
    assert (evidence.data["sets"], evidence.data["suspects"]) == (0, ())


def test_signals_that_agree_on_one_false_place_show_nothing():
    rng = np.random.default_rng(8)
    records = draw_vector_taps(rng)
    (o,), (taps,) = records.observations, records.vector_taps
    design = compute_directions(o, records.navigation, taps.signals).design
    offsets = equilibrium(
        satellite_geometry(design), design @ [0.3, -0.2, 0.1, 0.2], design @ [50.0, 80.0, 0.0, 0.0], 45
    )
    (evidence,) = VectorSqm().examine(draw_vector_taps(np.random.default_rng(8), *offsets))[0]
    assert evidence.says == "clean"


def test_an_error_that_ranges_have_as_well_is_no_alarm():
    code_chips = np.random.default_rng(3).normal(0.0, 1.5 / 293.05, 8)  # 1.5 m
    records = draw_vector_taps(np.random.default_rng(9), code_chips, n=2000)
    assert VectorSqm(VectorSqmSettings(multipath_sigma_m=1.5)).examine(records)[0][0].says == "clean"
    strict = VectorSqmSettings(multipath_sigma_m=0.0, ionosphere_share=0.0, false_alarm_probability=0.1)
    measured = replace(records.observations[0], pseudorange_sigma_m=1e-3 * records.observations[0].pseudorange_sigma_m)
    assert VectorSqm(strict).examine(replace(records, observations=(measured,)))[0][0].failed


def test_channels_below_the_mask_are_not_tested():
    records = draw_vector_taps(np.random.default_rng(5))
    (o,), (taps,) = records.observations, records.vector_taps

    def list_tested(mask_deg):
        seen = compute_directions(o, records.navigation, taps.signals, elevation_mask_deg=mask_deg)
        return np.isfinite(seen.sigma_m)

    every, high = list_tested(0.0), list_tested(25.0)
    assert every.all()
    assert 4 <= high.sum() < every.sum()
    (evidence,) = VectorSqm(VectorSqmSettings(elevation_mask_deg=25.0)).examine(records)[0]
    assert {ref.signal for ref in evidence.signals} == {s for s, kept in zip(taps.signals, high, strict=True) if kept}


def test_without_the_right_taps_nothing_is_said():
    records = draw_vector_taps(np.random.default_rng(6))
    (taps,) = records.vector_taps
    for changed, code in (
        (replace(taps, delays_chips=np.array([0.5, 0.1, -0.5])), "no_pair"),
        (replace(taps, delays_chips=np.array([0.5, 0.0, -0.4])), "no_pair"),
        (replace(taps, value=np.full(taps.value.shape, np.nan, np.complex64)), "few_satellites"),
        (taps.select_between(0.0, 0.3), "few_looks"),
    ):
        (evidence,) = VectorSqm().examine(replace(records, vector_taps=(changed,)))[0]
        assert (evidence.says, evidence.failed, evidence.code) == ("undecided", False, code)


def test_the_pair_nearest_to_half_a_chip_is_taken():
    (taps,) = draw_vector_taps(np.random.default_rng(6)).vector_taps
    delays = np.array([0.125, 0.0, -0.125, 0.504, -0.504, 0.996, -0.996])
    several = replace(taps, delays_chips=delays, value=np.zeros((200, 8, 1, 7), np.complex64))
    assert select_pair(several) == (0.504, 3, 1, 4)


@pytest.mark.parametrize("spacing", [0.25, 0.5, 0.75])
def test_the_offset_of_a_triangle_is_found_at_any_spacing(spacing):
    offset = np.linspace(-0.2, 0.2, 9)
    found = code_offset_chips(triangle(offset - spacing), triangle(offset + spacing), spacing)
    np.testing.assert_allclose(found, offset, atol=1e-12)


def test_t_squared_follows_means_over_estimated_covariances():
    rng = np.random.default_rng(2)
    draws = rng.standard_normal((4000, 30, 3))
    mean, apart = draws.mean(axis=1), draws - draws.mean(axis=1, keepdims=True)
    covariance = np.einsum("tki,tkj->tij", apart, apart) / 29 / 30
    statistic = np.einsum("ti,tij,tj->t", mean, np.linalg.inv(covariance), mean)
    p_values = [t_squared_survival(value, 3, 30) for value in statistic]
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="always fit"):
        VectorSqmSettings(min_satellites=4)
    with pytest.raises(SettingsError, match="above 0"):
        VectorSqmSettings(false_alarm_probability=0.0)
    with pytest.raises(SettingsError, match="0 or more"):
        VectorSqmSettings(multipath_sigma_m=-1.0)
