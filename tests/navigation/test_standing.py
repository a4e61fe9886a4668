"""A body that stands is noticed, at the stated rate of faults; one that moves is not taken for one that stands."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation.units import REST, ROUND, drawn_start, erroneous, nees, perfect, piece

from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.ins import InsSettings, begin, corrected, step
from skyproof.navigation.standing import at_rest, stillness

STILL, DRIVING = perfect(REST, 6.0, 50.0), perfect(ROUND, 2.0, 50.0)
SURE = np.repeat([1.0, 0.05, np.radians(0.3)], 3)
GRADE = GRADES["industrial"]
SETTINGS = InsSettings(grade=GRADE, oscillator=OSCILLATORS["tcxo"])


def after_a_second(seed, motion=REST, readings=STILL):
    rng = np.random.default_rng(seed)
    unit = erroneous(piece(readings, 0.0, 1.0), GRADE, rng)
    _, state = step(begin(drawn_start(motion, SURE, rng), SETTINGS), unit.readings, SETTINGS)
    return state, unit


def test_units_that_stand_are_said_to_move_at_the_stated_rate():
    runs = [after_a_second(seed) for seed in range(200)]
    rate = 0.2
    moving = sum(
        at_rest(state, unit.readings, SETTINGS, false_alarm_probability=rate, least_speed_m_s=5.0) is None
        for state, unit in runs
    )
    assert stats.binomtest(moving, len(runs), rate - (0.5 * rate) ** 2).pvalue > 1e-3


def test_the_spread_of_readings_at_rest_is_chi_square():
    rng = np.random.default_rng(1)
    values = [stillness(erroneous(piece(STILL, 0.0, 0.5), GRADE, rng).readings, GRADE).p_value for _ in range(200)]
    assert stats.kstest(values, "uniform").pvalue > 1e-3


def test_a_body_that_moves_does_not_stand():
    state, unit = after_a_second(2, ROUND, DRIVING)
    assert at_rest(state, unit.readings, SETTINGS, least_speed_m_s=5.0) is None
    shaken = replace(
        unit.readings,
        specific_force_m_s2=unit.readings.specific_force_m_s2 + 0.2 * np.sin(np.arange(50.0))[:, None],
    )
    assert stillness(shaken, GRADE).p_value < 1e-9


def test_nothing_stands_where_the_velocity_is_not_known_well_enough_to_tell():
    state, unit = after_a_second(3)
    assert at_rest(state, unit.readings, SETTINGS, least_speed_m_s=0.05) is None


def test_standing_keeps_the_filter_true_and_its_velocity_small():
    squares = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        unit = erroneous(STILL, GRADE, rng)
        state = begin(drawn_start(REST, SURE, rng), SETTINGS)
        for second in range(6):
            now = piece(unit.readings, second, second + 1.0)
            _, state = step(state, now, SETTINGS)
            rest = at_rest(state, now, SETTINGS, false_alarm_probability=1e-6, least_speed_m_s=5.0)
            state, _ = corrected(state, rest)
        squares.append(nees(state, REST, 6.0, unit.bias[-1]))
    assert np.sqrt(np.diag(state.covariance)[3:6]).max() < 0.02
    # A rest's mean rate shares its noise with the attitude, which is left out: no more than stated, a little less.
    assert stats.chi2.sf(np.sum(squares), 15 * 20) > 1e-3
    assert np.mean(squares) / 15.0 > 0.6


def test_one_reading_has_no_spread():
    with pytest.raises(ValueError, match="1 readings"):
        stillness(piece(STILL, 0.0, 0.02), GRADE)
