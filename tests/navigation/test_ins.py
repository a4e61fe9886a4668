"""The corrected inertial navigator: as far off as it states, whatever corrects it, in one piece and in many."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation
from tests.navigation.units import (
    ARM,
    HOME,
    REST,
    ROUND,
    add_errors,
    compute_nees,
    cut_piece,
    draw_fix,
    draw_start,
    label,
    read_perfectly,
)

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.ins import CLOCK, SIZE, InsSettings, begin, correct, step
from skyproof.navigation.ins_updates import expect_fix, measurement_from_fix
from skyproof.navigation.nav_estimate import estimate_from_parts

START = np.repeat([2.0, 0.3, np.radians(1.0)], 3)
SECONDS = 20
TRUE = read_perfectly(ROUND, float(SECONDS))


def make_settings(grade, **more):
    return InsSettings(grade=grade, oscillator=OSCILLATORS["tcxo"], lever_m=ARM, **more)


def run_filter(grade, seed, seconds=SECONDS):
    """Run the filter; return NEES at the end, and the normalised innovation of each fix."""
    rng, settings = np.random.default_rng(seed), make_settings(grade)
    unit = add_errors(cut_piece(TRUE, 0.0, seconds), grade, rng)
    state, squares = begin(draw_start(ROUND, START, rng), settings), []
    for second in range(seconds):
        _, state = step(state, cut_piece(unit.readings, second, second + 1.0), settings)
        state, fit = correct(state, measurement_from_fix(state, draw_fix(ROUND, second + 1.0, rng), settings))
        squares.append(fit.nis)
    return compute_nees(state, ROUND, float(seconds), unit.bias[-1]), squares


def find_chance(squares, dof):
    """Return the two-sided p-value of a sum of squares that are chi-square with `dof` degrees each."""
    below = stats.chi2.cdf(np.sum(squares), dof * len(squares))
    return 2.0 * min(below, 1.0 - below)


def test_errors_and_innovations_are_as_large_as_stated():
    runs = [run_filter(GRADES["industrial"], seed, 5) for seed in range(25)]
    assert find_chance([square for square, _ in runs], 15) > 1e-3
    assert find_chance([square for _, squares in runs for square in squares], 6) > 1e-3


@pytest.mark.long
@pytest.mark.parametrize("name", ["consumer", "industrial", "tactical", "navigation"])
def test_errors_of_every_grade_are_as_large_as_stated(name, record_property):
    runs = [run_filter(GRADES[name], seed) for seed in range(100)]
    errors, fits = [square for square, _ in runs], [square for _, squares in runs for square in squares]
    record_property("nees_a_state", float(np.mean(errors) / 15.0))
    record_property("nis_a_number", float(np.mean(fits) / 6.0))
    print(f"{name}: NEES {np.mean(errors) / 15.0:.3f} a state, NIS {np.mean(fits) / 6.0:.3f} a number")
    if name == "consumer":  # turned by degrees before its biases are known: what is not linear is noise by our choice
        assert 0.85 < np.mean(errors) / 15.0 < 1.15
        assert 0.9 < np.mean(fits) / 6.0 < 1.1
    else:
        assert find_chance(errors, 15) > 1e-4
        assert find_chance(fits, 6) > 1e-4


def test_pieces_give_what_the_whole_gives():
    settings = make_settings(GRADES["tactical"])
    unit = add_errors(TRUE, GRADES["tactical"], np.random.default_rng(1))
    start = begin(draw_start(ROUND, START, np.random.default_rng(2)), settings)
    _, whole = step(start, unit.readings, settings)
    state = start
    for first, last in ((0.0, 0.5), (0.5, 7.25), (7.25, 20.0)):
        _, state = step(state, cut_piece(unit.readings, first, last), settings)
    # Gravity is taken as linear about other places: 1e-8 m/s2.
    assert np.abs(state.position_ecef_m - whole.position_ecef_m).max() < 1e-5
    assert np.abs(state.attitude - whole.attitude).max() < 1e-12
    ratio = np.sqrt(np.diag(state.covariance)[:9] / np.diag(whole.covariance)[:9])
    assert ratio == pytest.approx(1.0, abs=0.02)  # knots of the covariance lie elsewhere


def test_a_false_fix_is_refused_and_leaves_the_state_as_it_was():
    settings = make_settings(GRADES["tactical"])
    rng = np.random.default_rng(3)
    state = begin(draw_start(ROUND, START / 10.0, rng), settings)
    _, state = step(state, cut_piece(TRUE, 0.0, 1.0), settings)
    far = measurement_from_fix(state, draw_fix(ROUND, 1.0, rng, shift=30.0), settings)
    after, fit = correct(state, far, false_alarm_probability=1e-3)
    assert not fit.used
    assert fit.p_value < 1e-6
    assert after is state


def test_good_fixes_are_refused_at_the_stated_rate():
    settings = make_settings(GRADES["tactical"])
    refused, n = 0, 200
    for seed in range(n):
        rng = np.random.default_rng(seed)
        state = begin(draw_start(ROUND, START, rng), settings)
        _, fit = correct(
            state, measurement_from_fix(state, draw_fix(ROUND, 0.0, rng), settings), false_alarm_probability=0.05
        )
        refused += not fit.used
    assert stats.binomtest(refused, n, 0.05).pvalue > 1e-3


def test_lasting_errors_of_fixes_do_not_average_out():
    lasting = np.diag([9.0, 9.0, 9.0, 4.0])
    settings = make_settings(GRADES["navigation"], lasting_m2=lasting)
    rng = np.random.default_rng(5)
    state = begin(draw_start(ROUND, START / 10.0, rng), settings)
    before = np.sqrt(np.diag(state.covariance)[:3])
    for second in range(10):
        _, state = step(state, cut_piece(TRUE, second, second + 1.0), settings)
        state, _ = correct(
            state, measurement_from_fix(state, draw_fix(ROUND, second + 1.0, rng, place_m=0.1), settings)
        )
    assert np.all(np.sqrt(np.diag(state.covariance)[:3]) > 0.9 * before)  # as the start, not as the fixes
    result = expect_fix(state, settings)
    assert np.sqrt(np.diag(result.covariance)[:3]).max() < 0.1  # what a fix says is known far better than where one is


def test_the_clock_runs_on_with_its_class():
    settings = make_settings(GRADES["tactical"])
    rng = np.random.default_rng(6)
    begun = begin(draw_start(ROUND, START, rng), settings, [1e4, 30.0], np.diag([1.0, 1e-4]))
    _, state = step(begun, TRUE, settings)
    assert state.clock_m == pytest.approx([1e4 + 30.0 * SECONDS, 30.0])
    tcxo = OSCILLATORS["tcxo"]
    walk = 2.0 * np.pi**2 * tcxo.walk_hz * SECONDS * SPEED_OF_LIGHT_M_S**2
    assert state.covariance[CLOCK, CLOCK][1, 1] == pytest.approx(1e-4 + walk, rel=0.1)
    fix = estimate_from_parts(
        state.gpst, clock_m=np.array([1e4 + 30.0 * SECONDS + 3.0, 30.1]), clock_m2=np.diag([1.0, 0.01])
    )
    after, fit = correct(state, measurement_from_fix(state, fix, settings))
    assert fit.dof == 2
    assert abs(after.clock_m[0] - fix.mean[6]) < 0.2


def test_the_sensitivity_is_the_derivative_of_the_innovation():
    settings = make_settings(GRADES["tactical"])
    rng = np.random.default_rng(7)
    state = begin(draw_start(REST, START, rng), settings, [5.0, 0.1], np.eye(2))
    state = replace(state, run=replace(state.run, last=np.stack((-HOME / 6.4e5, [0.1, -0.2, 0.3]))))
    fix = draw_fix(REST, 0.004, rng)
    measurement = measurement_from_fix(state, fix, settings)
    for column in range(39):
        size = 1e-4
        moved = measurement_from_fix(_change_state(state, column, size), fix, settings)
        slope = (moved.innovation - measurement.innovation) / size
        # An acceleration within the time to the fix is not followed: at most g times that, and a gain of g.
        assert slope == pytest.approx(measurement.sensitivity[:, column], abs=0.05)


def _change_state(state, column, size):
    """Change a state by `size` in one of its errors."""
    wrong = np.zeros(SIZE)
    wrong[column] = size
    row = state.run.state
    bias = state.bias - wrong[9:21]
    less, gain = wrong[9:21].reshape(4, 3), wrong[21:39].reshape(2, 3, 3)
    return replace(
        state,
        bias=bias,
        gain=state.gain - gain,
        run=replace(
            state.run,
            state=replace(
                row,
                position_ecef_m=row.position_ecef_m + wrong[:3],
                velocity_ecef_m_s=row.velocity_ecef_m_s + wrong[3:6],
                attitude=Rotation.from_rotvec(wrong[6:9]).as_matrix() @ row.attitude,
            ),
            last=state.run.last
            + np.stack((less[0] + less[2], less[1] + less[3]))
            + np.einsum("sjk,sk->sj", gain, state.run.last),
        ),
    )


def test_a_state_ends_at_a_long_gap():
    settings = make_settings(GRADES["tactical"])
    state = begin(draw_start(ROUND, START, np.random.default_rng(8)), settings)
    _, state = step(state, cut_piece(TRUE, 0.0, 2.0), settings)
    path, ended = step(state, cut_piece(TRUE, 5.0, 6.0), settings)
    assert ended is None
    assert path.gpst[-1] == label(2.0)
