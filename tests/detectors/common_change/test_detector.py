"""Slow attacks that move all satellites alike are named; skies, platforms and oscillators that do nothing of it are
not."""

import numpy as np
import pytest
from scipy import stats
from tests.detectors.continuity.test_detector import FIELD, MOTIONS, WHITE, change_cells, make_windows, observe_scene

from skyproof.detectors.common_change.detector import CommonChange, CommonChangeSettings
from skyproof.errors import SettingsError
from skyproof.records import Cause
from skyproof.testing import check_missing_named, check_pieces

WAVE_M = 299_792_458.0 / 1575.42e6
ONSET_S = 40.0
DURATION_S = 92.0


def examine_all(records, **settings):
    """Examine the records and list the evidence by window."""
    detector, state, every = (
        CommonChange(CommonChangeSettings(**{"false_alarm_probability": 1e-6} | settings)),
        None,
        [],
    )
    for window in records:
        evidence, state = detector.examine(window, state)
        every.append(evidence)
    return every


def select_failed(every):
    """Select the findings of failed tests, by window."""
    return [[e for e in evidence if e.failed] for evidence in every]


def drag_codes(o, rate_m_s, columns=slice(None)):
    """Drag codes off from the onset on and leave their carriers."""
    late_m = rate_m_s * np.maximum(o.elapsed_s - ONSET_S, 0.0)
    moved = o.pseudorange_m.copy()
    moved[:, columns] += late_m[:, None]
    return change_cells(o, pseudorange_m=moved)


def push_clock(o, turn_m_s2):
    """Push the clock from the onset on, which moves code and carrier of all signals."""
    moved_m = 0.5 * turn_m_s2 * np.maximum(o.elapsed_s - ONSET_S, 0.0)[:, None] ** 2
    return change_cells(o, pseudorange_m=o.pseudorange_m + moved_m, carrier_cyc=o.carrier_cyc + moved_m / WAVE_M)


@pytest.mark.parametrize("rate_m_s", [1.2, -1.2])
def test_code_dragged_off_its_carrier_is_named_in_ten_seconds(rate_m_s):
    every = examine_all(make_windows(drag_codes(observe_scene(duration_s=DURATION_S), rate_m_s)))
    found = select_failed(every)
    assert not any(found[:4])
    assert found[4][0].data["rate_m_s"] == pytest.approx(rate_m_s, abs=0.2)
    assert found[5]
    assert all(e.code == "parted" and e.overrules and e.may_also_be == (Cause.OSCILLATOR,) for e in found[5])


def test_slower_drags_take_half_a_minute_and_three_satellites():
    o = observe_scene(duration_s=DURATION_S)
    slow = select_failed(examine_all(make_windows(drag_codes(o, 0.5))))
    assert not any(slow[:4])
    assert slow[7]
    assert not any(select_failed(examine_all(make_windows(drag_codes(o, 5.0, [1, 3])))))


def test_oscillators_that_part_code_from_carrier_are_no_attack():
    o = observe_scene(duration_s=DURATION_S)
    drifting = change_cells(o, pseudorange_m=o.pseudorange_m + 3.0 * o.elapsed_s[:, None])
    assert not any(select_failed(examine_all(make_windows(drifting))))


def test_carriers_turn_faster_than_the_oscillator_wanders():
    # By 1 cm/s more each second: ten wavelengths in twenty seconds.
    o = push_clock(observe_scene(noise=WHITE, oscillator="ocxo", duration_s=DURATION_S), 0.01)
    named = select_failed(examine_all(make_windows(o), oscillator="ocxo"))
    assert not any(named[:4])
    (first, *_) = named[5]
    assert (first.code, first.overrules, first.may_also_be) == ("turned", True, (Cause.OSCILLATOR, Cause.STATEMENT))
    assert not any(select_failed(examine_all(make_windows(o), oscillator="tcxo")))
    assert not any(select_failed(examine_all(make_windows(o))))


def test_it_reports_what_it_lacks_and_pieces_equal_the_whole():
    records = make_windows(observe_scene())
    check_pieces(CommonChange, records)
    check_missing_named(CommonChange(), records[0])
    (first,), _ = CommonChange().examine(records[0])
    assert first.code == "first_window"


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(SettingsError, match="sundial"):
        CommonChangeSettings(oscillator="sundial")
    with pytest.raises(SettingsError, match="carrier_error_m"):
        CommonChangeSettings(carrier_error_m=0.0)


@pytest.mark.long
@pytest.mark.parametrize("oscillator", ["ocxo", "rubidium"])
def test_turns_of_true_clocks_have_uniform_p_values(oscillator):
    # With the share that a class is trusted with at one, and no errors but those that are stated.
    p_values = []
    for number in range(100):
        o = observe_scene(number, noise=WHITE, oscillator=oscillator, duration_s=42.0, seed=number)
        every = examine_all(make_windows(o), oscillator=oscillator, oscillator_share=1.0, carrier_error_m=1e-4)
        p_values += [
            e.p_value for e in every[-1] if e.code in ("turns_as_clock", "turned")
        ]  # windows share epochs: one of each
    assert len(p_values) == 100
    for level in (0.1, 0.3):  # a bound of two spans
        low, high = stats.binom.ppf([0.001, 0.999], len(p_values), level)
        assert 0.5 * low <= np.sum(np.array(p_values) <= level) <= high


@pytest.mark.long
@pytest.mark.parametrize("motion", MOTIONS)
def test_clean_skies_alarm_no_more_often_than_asked(motion):
    # Reflections, ionosphere and oscillators as the simulator has them: two hours.
    asked, p_values = 0.03, []
    for number in range(60):
        o = observe_scene(
            number, noise=FIELD, motion=motion, oscillator="ocxo", duration_s=122.0, seed=1 + number // 10
        )
        every = examine_all(make_windows(o), false_alarm_probability=asked, oscillator="ocxo")
        p_values += [min(e.p_value for e in evidence if e.p_value is not None) for evidence in every[1:]]
    alarms = int(np.sum(np.array(p_values) < asked / 3.0))
    assert alarms <= stats.binom.ppf(0.999, len(p_values), asked)
