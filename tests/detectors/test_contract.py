"""Each detector meets the contract of `skyproof.testing`, false alarms at the stated rate included."""

import numpy as np
import pytest

from skyproof.detectors.multi_receiver import MultiReceiver, MultiReceiverSettings
from skyproof.detectors.peaks import Peaks, PeaksSettings
from skyproof.detectors.residual import Residual, ResidualSettings
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors, check_detector, check_false_alarms

CAPTURED = MeasuredScene(sky=(), false=(FalseSky(),), epochs=8, errors=TrackErrors(1.0))
CLEAN = MeasuredScene(epochs=8, errors=TrackErrors(1.0, constant_m=1.0))
ECHO_PROBABILITY = 0.01
ECHOES = MeasuredScene(
    antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=3, false=(FalseSky(shows_enu_m=(0.0, 0.0, 0.0)),)
)


def with_echoes(rng):
    """A clean sky in which each satellite has a far echo now and then; the other second signals are silent."""
    records = ECHOES.records(rng)
    (o,) = records.observations
    n = len(o.signals) // 2
    silent = np.concatenate([np.zeros(n, bool), rng.random(n) >= ECHO_PROBABILITY])
    cn0_dbhz = np.where(silent, np.nan, o.cn0_dbhz)
    pseudorange_m = np.where(silent, np.nan, o.pseudorange_m)
    changed = type(o)(**(vars(o) | {"cn0_dbhz": cn0_dbhz, "pseudorange_m": pseudorange_m}))
    return type(records)(**(vars(records) | {"observations": (changed,), "sets": records.sets[:1]}))


def exact(rate):
    """Without the allowance for noise that is not white: exact, so that too few false alarms are a fault as well."""
    return MultiReceiver(
        MultiReceiverSettings(
            false_alarm_probability=rate, multipath_sigma_m=0.0, correlation_max=0.0, error_bound_m=np.inf
        )
    )


def test_multi_receiver_authenticates_false_signals_as_rarely_as_it_states():
    check_detector(
        lambda: exact(0.1), CAPTURED.records, np.random.default_rng(1), alarms={"authentic"}, windows=700
    )


def test_multi_receiver_as_it_comes_meets_the_contract():
    check_detector(
        MultiReceiver, CAPTURED.records, np.random.default_rng(2), alarms={"authentic"}, windows=100,
        conservative="allows for correlated noise and constant errors that these records do not have",
    )  # fmt: skip


def test_multi_receiver_does_not_name_the_sky_false():
    check_detector(
        lambda: MultiReceiver(MultiReceiverSettings(false_alarm_probability=0.01)), CLEAN.records,
        np.random.default_rng(3), windows=100, conservative="the antennas are farther apart than it was told",
    )  # fmt: skip


def test_peaks_meets_the_contract():
    settings = PeaksSettings(false_alarm_probability=0.02, long_echo_probability=ECHO_PROBABILITY)
    check_detector(lambda: Peaks(settings), with_echoes, np.random.default_rng(4), windows=2000)


def test_residual_meets_the_contract():
    check_detector(
        lambda: Residual(ResidualSettings(false_alarm_probability=0.01)), CLEAN.records, np.random.default_rng(5),
        windows=40, conservative="its p-value is a union bound over all sets that could be formed",
    )  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("epochs", [5, 30])
@pytest.mark.parametrize("receivers", [2, 3])
def test_multi_receiver_false_alarms_at_one_percent_and_one_per_mille(receivers, epochs):
    places = {"rx1": (0.0, 0.0, 0.0), "rx2": (20.0, 0.0, 0.0), "rx3": (0.0, 30.0, 0.0)}
    captured = MeasuredScene(
        antennas_enu_m=dict(list(places.items())[:receivers]), sky=(), false=(FalseSky(),), epochs=epochs,
        errors=TrackErrors(1.0), max_satellites=6,
    )  # fmt: skip
    rng = np.random.default_rng(6)
    for rate, windows in ((0.01, 4000), (0.001, 4000)):
        check_false_alarms(
            lambda rate=rate: exact(rate), (captured.records(rng) for _ in range(windows)), alarms={"authentic"}
        )


@pytest.mark.long
def test_peaks_false_alarms_at_the_attained_rate():
    rng = np.random.default_rng(7)
    count, tests, rate = check_false_alarms(Peaks, (with_echoes(rng) for _ in range(100_000)))
    assert rate < 1e-3
    assert count > 0
    assert tests == 100_000
