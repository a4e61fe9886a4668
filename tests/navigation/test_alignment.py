"""Attitude from nothing: levelled and by compass at rest, by fixes in motion, no more and no less off than stated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation.units import ARM, REST, ROUND, drawn_fix, erroneous, nees, perfect

from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.alignment import align_moving, align_standing, heading_sigma_rad
from skyproof.navigation.ins import InsSettings
from skyproof.simulator.trajectories import las_vegas

STILL, DRIVING = perfect(REST, 60.0, 10.0), perfect(ROUND, 10.0)
STRAIGHT = las_vegas()


def settings_of(name):
    return InsSettings(grade=GRADES[name], oscillator=OSCILLATORS["tcxo"], lever_m=ARM)


def chance(squares, dof):
    below = stats.chi2.cdf(np.sum(squares), dof * len(squares))
    return 2.0 * min(below, 1.0 - below)


@pytest.mark.parametrize(("name", "heading"), [("industrial", True), ("navigation", False)])
def test_at_rest_the_errors_are_as_large_as_stated(name, heading):
    squares = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        unit = erroneous(STILL, GRADES[name], rng)
        given = {"heading_rad": 0.5 + 0.02 * rng.standard_normal(), "heading_sigma": 0.02} if heading else {}
        found = align_standing(unit.readings, drawn_fix(REST, 60.0, rng), settings_of(name), **given)
        squares.append(nees(found.state, REST, 60.0, unit.bias[-1]))
    # What a wrong heading makes of a bias is a product of two errors, for which a Gaussian states a little too much.
    assert stats.chi2.sf(np.sum(squares), 15 * len(squares)) > 1e-3
    assert np.mean(squares) / 15.0 > 0.7
    assert np.degrees(found.heading_sigma_rad) == pytest.approx(1.15 if heading else 0.055, rel=0.1)


def test_gyros_that_do_not_feel_the_earth_find_no_heading():
    rng = np.random.default_rng(1)
    unit = erroneous(STILL, GRADES["tactical"], rng)
    found = align_standing(unit.readings, drawn_fix(REST, 60.0, rng), settings_of("tactical"))
    assert found.state is None
    assert "give the heading" in found.because


@pytest.mark.parametrize("name", ["tactical", "industrial"])
def test_in_motion_the_errors_are_as_large_as_stated(name):
    squares = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        unit = erroneous(DRIVING, GRADES[name], rng)
        fixes = [drawn_fix(ROUND, second, rng) for second in np.arange(0.5, 10.5)]
        found = align_moving(unit.readings, fixes, settings_of(name))
        assert found.state is not None
        bias = unit.bias[round(20 * 9.5)]
        squares.append(nees(found.state, ROUND, 9.5, bias))
    assert chance(squares, 15) > 1e-3


def test_motion_that_does_not_change_shows_no_heading():
    rng = np.random.default_rng(2)
    unit = erroneous(perfect(STRAIGHT, 8.0), GRADES["tactical"], rng)
    fixes = [drawn_fix(STRAIGHT, second, rng) for second in np.arange(0.5, 8.0)]
    found = align_moving(unit.readings, fixes, settings_of("tactical"))
    assert found.state is None
    assert found.heading_sigma_rad > np.radians(10.0)
    assert "does not show the heading" in found.because


def test_two_fixes_are_too_few():
    rng = np.random.default_rng(3)
    found = align_moving(DRIVING, [drawn_fix(ROUND, at, rng) for at in (1.0, 2.0)], settings_of("tactical"))
    assert found.state is None
    assert "fewer than three" in found.because


def test_fixes_between_two_readings_align_nothing():
    rows = [0, DRIVING.gpst.size - 1]
    values = {name: getattr(DRIVING, name)[rows] for name in ("gpst", "specific_force_m_s2", "angular_rate_rad_s")}
    sparse = replace(DRIVING, interval_s=10.0, **values)
    rng = np.random.default_rng(3)
    found = align_moving(sparse, [drawn_fix(ROUND, at, rng) for at in (1.0, 2.0, 3.0)], settings_of("tactical"))
    assert found.state is None
    assert "readings are missing" in found.because


def test_the_heading_sigma_is_that_of_a_turn_about_the_vertical():
    rng = np.random.default_rng(4)
    found = align_standing(
        STILL, drawn_fix(REST, 60.0, rng), settings_of("industrial"), heading_rad=0.5, heading_sigma=0.02
    )
    assert heading_sigma_rad(found.state) == pytest.approx(0.02, rel=0.05)
