"""Attitude from nothing: levelled and by compass at rest, by fixes in motion, no more and no less off than stated."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation.units import ARM, ROUND, add_errors, compute_nees, draw_fix, read_perfectly

from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.alignment import align_moving, heading_sigma_rad
from skyproof.navigation.ins import ATTITUDE, InsSettings
from skyproof.simulator.trajectories import make_las_vegas

DRIVING = read_perfectly(ROUND, 10.0)
STRAIGHT = make_las_vegas()


def make_settings(name):
    return InsSettings(grade=GRADES[name], oscillator=OSCILLATORS["tcxo"], lever_m=ARM)


def find_chance(squares, dof):
    below = stats.chi2.cdf(np.sum(squares), dof * len(squares))
    return 2.0 * min(below, 1.0 - below)


@pytest.mark.parametrize("name", ["tactical", "industrial"])
def test_in_motion_the_errors_are_as_large_as_stated(name):
    squares = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        unit = add_errors(DRIVING, GRADES[name], rng)
        fixes = [draw_fix(ROUND, second, rng) for second in np.arange(0.5, 10.5)]
        found = align_moving(unit.readings, fixes, make_settings(name))
        assert found.state is not None
        bias = unit.bias[round(20 * 9.5)]
        squares.append(compute_nees(found.state, ROUND, 9.5, bias))
    assert find_chance(squares, 15) > 1e-3


def test_motion_that_does_not_change_shows_no_heading():
    rng = np.random.default_rng(2)
    unit = add_errors(read_perfectly(STRAIGHT, 8.0), GRADES["tactical"], rng)
    fixes = [draw_fix(STRAIGHT, second, rng) for second in np.arange(0.5, 8.0)]
    found = align_moving(unit.readings, fixes, make_settings("tactical"))
    assert found.state is None
    assert found.heading_sigma_rad > np.radians(10.0)
    assert "heading" in found.because


def test_two_fixes_are_too_few():
    rng = np.random.default_rng(3)
    found = align_moving(DRIVING, [draw_fix(ROUND, at, rng) for at in (1.0, 2.0)], make_settings("tactical"))
    assert found.state is None
    assert "three" in found.because


def test_fixes_between_two_readings_align_nothing():
    rows = [0, DRIVING.gpst.size - 1]
    values = {name: getattr(DRIVING, name)[rows] for name in ("gpst", "specific_force_m_s2", "angular_rate_rad_s")}
    sparse = replace(DRIVING, interval_s=10.0, **values)
    rng = np.random.default_rng(3)
    found = align_moving(sparse, [draw_fix(ROUND, at, rng) for at in (1.0, 2.0, 3.0)], make_settings("tactical"))
    assert found.state is None
    assert "readings" in found.because


def test_the_heading_sigma_is_that_of_a_turn_about_the_vertical():
    fixes = [draw_fix(ROUND, second, np.random.default_rng(4)) for second in np.arange(0.5, 10.5)]
    state = align_moving(DRIVING, fixes, make_settings("tactical")).state
    up = rot_enu_ecef(*geodetic_from_ecef(state.position_ecef_m)[:2])[2]
    covariance = np.zeros_like(state.covariance)
    covariance[ATTITUDE, ATTITUDE] = 0.3**2 * (np.eye(3) - np.outer(up, up)) + 0.02**2 * np.outer(up, up)
    assert heading_sigma_rad(replace(state, run=replace(state.run, covariance=covariance))) == pytest.approx(0.02)
