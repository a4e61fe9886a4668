"""`VectorSqm` on records."""

from dataclasses import replace

import numpy as np
import pytest
from tests.detectors.nulls import with_vector_taps

from skyproof.detectors.correlators.vector_sqm import equilibrium, satellite_geometry
from skyproof.detectors.correlators.vector_sqm_detector import VectorSqm, VectorSqmSettings, _design
from skyproof.errors import SettingsError


def settled(records, code_chips, doppler_hz, place):
    """Offsets when one satellite is attacked."""
    (o,), (taps,) = records.observations, records.vector_taps
    where = satellite_geometry(_design(o, records.navigation, taps, records.sets[0].position_ecef_m))
    attack = np.eye(len(o.signals))[place]
    return equilibrium(where, code_chips * attack, doppler_hz * attack, 45.0)


def test_an_inconsistent_satellite_is_an_attack_and_named():
    rng = np.random.default_rng(5)
    offsets = settled(with_vector_taps(rng), 0.3, 150.0, 3)
    records = with_vector_taps(rng, *offsets)
    (evidence,) = VectorSqm().examine(records)[0]
    assert evidence.says == "attack"
    assert str(records.observations[0].signals[3]) in evidence.because


def test_without_the_right_taps_nothing_is_said():
    records = with_vector_taps(np.random.default_rng(6))
    (taps,) = records.vector_taps
    for changed in (
        replace(taps, delays_chips=np.array([0.25, 0.0, -0.25])),
        replace(taps, delays_chips=np.array([0.5, 0.1, -0.5])),
        replace(taps, value=np.full(taps.value.shape, np.nan, np.complex64)),
    ):
        (evidence,) = VectorSqm().examine(replace(records, vector_taps=(changed,)))[0]
        assert evidence.says == "undecided"
        assert evidence.would_need


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="four always fit"):
        VectorSqmSettings(min_satellites=4)
    with pytest.raises(SettingsError, match="above 0 and below 1"):
        VectorSqmSettings(false_alarm_probability=0.0)
