"""`Sqm` and `VectorSqm` on records."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.correlator_laws import prompt_amplitude
from skyproof.detectors.sqm_detector import Sqm, SqmSettings
from skyproof.detectors.vector_sqm import equilibrium, sky
from skyproof.detectors.vector_sqm_detector import VectorSqm, VectorSqmSettings, _design
from skyproof.errors import SettingsError
from skyproof.records import Taps
from skyproof.studies.vector_loops import draw_taps
from skyproof.testing import MeasuredScene, check_detector

EPOCHS = 3
SCENE = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=EPOCHS, step_s=0.02, max_satellites=8, cn0_dbhz=45.0
)


def with_taps(rng, name, code_chips=0.0, phase_rad=0.0, second=0.0):
    """Records of the scene with taps of channels at the offsets; `second` is added to each early one."""
    records = SCENE.records(rng)
    (o,) = records.observations
    amplitude = prompt_amplitude(SCENE.cn0_dbhz, coherent_s=SCENE.step_s)
    value = draw_taps(rng, (EPOCHS, len(o.signals)), amplitude, code_chips, phase_rad) / amplitude
    value[..., 0] += second
    taps = Taps(
        receiver=o.receiver, signals=o.signals, elapsed_s=o.elapsed_s, delays_chips=np.array([0.5, 0.0, -0.5]),
        dopplers_hz=np.zeros(1), value=(0.07 * value[:, :, None, :]).astype(np.complex64),
    )  # fmt: skip
    return replace(records, extras={name: (taps,)})


def settled(records, code_chips, doppler_hz, place):
    """Offsets when one satellite is attacked."""
    (o,), (taps,) = records.observations, records.extras["vector_taps"]
    where = sky(_design(o, records.navigation, taps, records.sets[0].position_ecef_m))
    attack = np.eye(len(o.signals))[place]
    return equilibrium(where, code_chips * attack, doppler_hz * attack, 45.0)


def test_sqm_meets_the_contract():
    settings = SqmSettings(false_alarm_probability=0.05, distortion_allowed=0.0)
    check_detector(lambda: Sqm(settings), lambda rng: with_taps(rng, "taps"), np.random.default_rng(1), windows=600)


def test_sqm_as_it_comes_meets_the_contract():
    check_detector(
        lambda: Sqm(SqmSettings(false_alarm_probability=0.05)), lambda rng: with_taps(rng, "taps"),
        np.random.default_rng(2), windows=60, conservative="allows for distortion that these records do not have",
    )  # fmt: skip


def test_vector_sqm_meets_the_contract():
    settings = VectorSqmSettings(false_alarm_probability=0.05)
    check_detector(
        lambda: VectorSqm(settings), lambda rng: with_taps(rng, "vector_taps"), np.random.default_rng(3), windows=400
    )


def test_a_distorted_signal_is_an_attack():
    records = with_taps(np.random.default_rng(4), "taps", second=np.array([0.0, 0.0, 0.5] + [0.0] * 5))
    (evidence,) = Sqm().examine(records)[0]
    assert evidence.says == "attack"
    assert [ref.signal for ref in evidence.subject] == [records.observations[0].signals[2]]


def test_an_inconsistent_satellite_is_an_attack_and_named():
    rng = np.random.default_rng(5)
    offsets = settled(with_taps(rng, "vector_taps"), 0.3, 150.0, 3)
    records = with_taps(rng, "vector_taps", *offsets)
    (evidence,) = VectorSqm().examine(records)[0]
    assert evidence.says == "attack"
    assert str(records.observations[0].signals[3]) in evidence.because


def test_without_the_right_taps_nothing_is_said():
    records = with_taps(np.random.default_rng(6), "vector_taps")
    (taps,) = records.extras["vector_taps"]
    for changed in (
        replace(taps, delays_chips=np.array([0.25, 0.0, -0.25])),
        replace(taps, delays_chips=np.array([0.5, 0.1, -0.5])),
        replace(taps, value=np.full(taps.value.shape, np.nan, np.complex64)),
    ):
        (evidence,) = VectorSqm().examine(replace(records, extras={"vector_taps": (changed,)}))[0]
        assert evidence.says == "undecided"
        assert evidence.would_need


def test_sqm_without_a_pair_or_a_signal_is_undecided():
    records = with_taps(np.random.default_rng(7), "taps")
    (taps,) = records.extras["taps"]
    for changed in (
        replace(taps, delays_chips=np.array([0.5, 0.0, -0.4])),
        replace(taps, value=np.full(taps.value.shape, np.nan, np.complex64)),
    ):
        (evidence,) = Sqm().examine(replace(records, extras={"taps": (changed,)}))[0]
        assert evidence.says == "undecided"
        assert evidence.would_need


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="four always fit"):
        VectorSqmSettings(min_satellites=4)
    with pytest.raises(SettingsError, match="between 0 and 1"):
        VectorSqmSettings(false_alarm_probability=0.0)
    with pytest.raises(SettingsError, match="between 0 and 1"):
        SqmSettings(false_alarm_probability=1.0)
    with pytest.raises(SettingsError, match="0 or more"):
        SqmSettings(distortion_allowed=-0.1)
