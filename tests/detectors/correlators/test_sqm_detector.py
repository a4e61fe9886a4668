"""`Sqm` on records: what its counts of distorted signals say."""

from dataclasses import replace

import numpy as np
import pytest
from tests.detectors.nulls import TAPS_SIGNALS, reflect, take_looks

from skyproof.detectors.correlators.sqm_detector import Sqm, SqmSettings
from skyproof.errors import SettingsError
from skyproof.explain import stands_beside
from skyproof.records import Cause, Need, SignalId
from skyproof.statistics.distributions import binomial_survival

RARE = Sqm(SqmSettings(false_alarm_probability=1e-6))
LATE = {"second": 0.6, "lag_chips": 0.6}
EARLY = {"second": 0.6, "lag_chips": -0.6}


def examine_all(seed, seconds, detector=RARE):
    rng = np.random.default_rng(seed)
    beats = {k: {"beat_hz": rng.uniform(3.0, 20.0), **ray} for k, ray in seconds.items()}
    (evidence,), _ = detector.examine(take_looks(rng, (42.0, 50.0), seconds=beats))
    return evidence


def list_sats(evidence):
    return [ref.signal.sat for ref in evidence.signals]


def test_signals_alone_are_clean():
    evidence = examine_all(1, {})
    assert evidence.says == "clean"
    assert len(evidence.signals) == len(TAPS_SIGNALS)


@pytest.mark.parametrize("ray", [LATE, EARLY])
def test_one_distorted_signal_is_reported_and_turns_nothing(ray):
    evidence = examine_all(2, {3: ray})
    assert (evidence.says, evidence.code, stands_beside(evidence)) == ("clean", "some_distorted", True)
    assert list_sats(evidence) == ["G04"]


def test_late_signals_everywhere_are_open_and_no_attack():
    evidence = examine_all(3, dict.fromkeys(range(10), LATE))
    assert evidence.says == "undecided"
    assert (evidence.code, evidence.may_also_be) == ("many_distorted", (Cause.REFLECTIONS,))
    assert evidence.failed
    assert evidence.statistic == 10


def test_early_signals_in_several_are_an_attack():
    evidence = examine_all(4, dict.fromkeys((0, 2, 4, 6, 8), EARLY))
    assert (evidence.says, evidence.code) == ("attack", "earlier_signals")
    assert list_sats(evidence) == ["G01", "G03", "G05", "G07", "G09"]
    assert evidence.p_value < 1e-6


@pytest.mark.parametrize("windows", [60, pytest.param(2000, marks=pytest.mark.long)])
def test_reflections_as_often_as_stated_seldom_leave_all_open(windows):
    rng = np.random.default_rng(10)
    detector = Sqm(SqmSettings(false_alarm_probability=0.2, reflection_probability=0.3))
    failed = sum(detector.examine(reflect(rng, 0.3))[0][0].failed for _ in range(windows))
    assert binomial_survival(failed, windows, 0.2) > 1e-4
    assert failed > 0.01 * windows or windows < 100


def test_three_early_ones_are_too_few_for_a_rare_alarm():
    assert examine_all(5, dict.fromkeys((0, 2, 4), EARLY)).code == "some_distorted"


def test_signals_beside_another_of_their_satellite_are_left_out():
    records = take_looks(np.random.default_rng(6))
    (taps,) = records.taps
    doubled = replace(taps, signals=(*TAPS_SIGNALS[:8], SignalId("G01", copy="b"), SignalId("G02", copy="b")))
    (evidence,), _ = RARE.examine(replace(records, taps=(doubled,)))
    assert list_sats(evidence) == ["G03", "G04", "G05", "G06", "G07", "G08"]


def test_gaps_shorten_what_is_looked_at():
    records = take_looks(np.random.default_rng(7))
    (taps,) = records.taps
    value = taps.value.copy()
    value[90:92, :7] = np.nan  # 408 looks are left
    value[::90, 7:] = np.nan
    (evidence,), _ = RARE.examine(replace(records, taps=(replace(taps, value=value),)))
    assert len(evidence.signals) == 7


@pytest.mark.parametrize("least", [4, 11])
def test_without_a_pair_or_with_too_few_signals_it_is_undecided(least):
    records = take_looks(np.random.default_rng(8), n=150)
    (taps,) = records.taps
    delays = taps.delays_chips if least == 11 else np.arange(7.0)
    detector = Sqm(SqmSettings(min_signals=least))
    (evidence,), _ = detector.examine(replace(records, taps=(replace(taps, delays_chips=delays),)))
    assert evidence.says == "undecided"
    assert (evidence.code, evidence.p_value) == ("no_pair" if least == 4 else "few_signals", None)


def test_without_taps_it_says_so_as_data():
    (evidence,), _ = RARE.examine(replace(take_looks(np.random.default_rng(9), n=100), taps=()))
    assert evidence.lacking == (Need.TAPS,)


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="above 0"):
        SqmSettings(false_alarm_probability=1.0)
    with pytest.raises(SettingsError, match="above 0"):
        SqmSettings(reflection_probability=0.0)
    with pytest.raises(SettingsError, match="0 or more"):
        SqmSettings(multipath_sigma_m=-0.1)
