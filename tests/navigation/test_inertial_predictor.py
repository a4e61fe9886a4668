"""The inertial prediction of a receiver that moves: as far off as stated, whatever it did not learn of."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation.units import ARM, REST, ROUND, add_errors, cut_piece, draw_fix, label, read_perfectly

from skyproof.gnss.frames import heading_pitch_roll_rad
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.ins import InsSettings
from skyproof.navigation.predictor import SkyFix
from skyproof.records import Attitude

LEARNED_S, END_S = 30.0, 70.0
TRUE = read_perfectly(ROUND, END_S)


def draw_unit(grade, rng, *, attitude_deg=1.0, motion=ROUND, readings=TRUE):
    drawn = add_errors(readings, GRADES[grade], rng).readings
    initial = None
    if attitude_deg is not None:
        at = motion.at(np.zeros(1))
        angles = np.stack(heading_pitch_roll_rad(at.position_ecef_m[0], at.attitude[0]))
        sigma_rad = float(np.radians(attitude_deg))
        initial = Attitude(
            gpst=drawn.gpst[:1], angles_rad=(angles + sigma_rad * rng.standard_normal(3))[None], sigma_rad=sigma_rad
        )
    settings = InsSettings(grade=GRADES[grade], oscillator=OSCILLATORS["tcxo"], lever_m=ARM)
    return Inertial(readings=drawn, settings=settings, initial=initial, clock=False, by=("inertial_unit",))


def draw_shown(rng, start_s, end_s, *, motion=ROUND, lasting=0.0):
    each = [draw_fix(motion, at_s, rng, shift=lasting) for at_s in np.arange(start_s, end_s)]
    return SkyFix(whole=each[len(each) // 2], each=tuple(each))


def learn(own, rng, *, lasting=0.0):
    for start_s in np.arange(0.5, LEARNED_S, 10.0):
        own = own.learned(draw_shown(rng, start_s, start_s + 10.0, lasting=lasting))
    return own


def draw_squares(grade, draws, at_s, **options):
    """Draw squared errors of position and velocity of the antenna over what is stated, six degrees each."""
    found = []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        lasting = 1.5 * rng.standard_normal(3)
        predictor = learn(draw_unit(grade, rng, **options), rng, lasting=lasting)
        true = predictor.truth_at(label(at_s))
        exact = draw_fix(ROUND, at_s, rng, place_m=0.0, speed_m_s=0.0)
        off, spread = (true.mean - exact.mean)[:6], true.covariance[:6, :6]
        found.append(float(off @ np.linalg.solve(spread, off)))
    return np.array(found)


def test_where_it_is_when_it_ran_free_is_known_as_stated():
    squares = draw_squares("tactical", 4, 60.0)
    assert stats.chi2.sf(squares.sum(), 6 * 4) > 1e-4
    assert stats.chi2.cdf(squares.sum(), 6 * 4) > 1e-4


@pytest.mark.long
@pytest.mark.parametrize("grade", ["navigation", "tactical", "industrial"])
@pytest.mark.parametrize("attitude_deg", [1.0, None], ids=["attitude stated", "aligned in motion"])
def test_of_many_units_each_is_where_it_is_stated_to_be(grade, attitude_deg):
    for at_s in (31.0, 45.0, 69.0):
        squares = draw_squares(grade, 40, at_s, attitude_deg=attitude_deg)
        print(f"{grade}, {attitude_deg}, after {at_s - 30:g} s: squared errors {squares.mean() / 6:.2f} of stated")
        assert 0.2 < squares.mean() / 6.0 < 1.5


def test_a_predicted_fix_has_the_lasting_error_of_learned_ones():
    rng = np.random.default_rng(3)
    lasting = np.array([3.0, -2.0, 1.0])
    predictor = learn(draw_unit("navigation", rng), rng, lasting=lasting)
    at_s = label(31.0)
    expected, true = predictor.at(at_s), predictor.truth_at(at_s)
    exact = draw_fix(ROUND, 31.0, rng, place_m=0.0, speed_m_s=0.0)
    assert np.linalg.norm(expected.mean[:3] - exact.mean[:3] - lasting) < 1.5
    assert np.trace(expected.covariance[:3, :3]) < 0.5 * np.trace(true.covariance[:3, :3])


def test_no_clock_without_an_oscillator_and_nothing_before_a_fix():
    rng = np.random.default_rng(1)
    predictor = draw_unit("tactical", rng)
    assert predictor.at(label(5.0)) is None
    assert list(learn(predictor, rng).at(label(40.0)).there) == [0, 1, 2, 3, 4, 5]


def test_without_an_attitude_a_body_that_stands_is_not_aligned():
    rng = np.random.default_rng(1)
    predictor = draw_unit("tactical", rng, attitude_deg=None, motion=REST, readings=read_perfectly(REST, 20.0))
    assert predictor.learned(draw_shown(rng, 0.5, 15.0, motion=REST)).state is None


def test_missing_readings_end_it_and_it_restarts_by_learning():
    rng = np.random.default_rng(2)
    predictor = learn(draw_unit("tactical", rng), rng)
    early, late = cut_piece(predictor.readings, 0.0, 35.0), cut_piece(predictor.readings, 38.0, END_S)
    rows = {
        name: np.concatenate((getattr(early, name), getattr(late, name)))
        for name in ("gpst", "specific_force_m_s2", "angular_rate_rad_s")
    }
    broken = replace(predictor, readings=replace(predictor.readings, **rows))
    assert broken.at(label(34.0)) is not None
    assert broken.at(label(45.0)) is None
    again = broken.until(label(40.0))
    assert again.state is None
    for start_s in (40.5, 50.5):
        again = again.learned(draw_shown(rng, start_s, start_s + 10.0))
    off = again.at(label(62.0)).mean - draw_fix(ROUND, 62.0, rng, place_m=0.0, speed_m_s=0.0).mean
    assert np.linalg.norm(off[:3]) < 10.0


def test_of_a_drag_that_taught_it_the_tilt_is_doubted_too():
    # It takes a velocity that fixes gain within moments for a tilt, and leaves the truth ever faster.
    drag_m_s, since_s, until_s, at_s = np.array([0.3, 0.3, -0.2]), 30.5, 50.5, 110.0
    readings, size_m_s = read_perfectly(REST, at_s + 1.0), float(np.linalg.norm(drag_m_s))
    sigmas, squares = 2.58, []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        predictor = draw_unit("tactical", rng, attitude_deg=0.1, motion=REST, readings=readings)
        predictor = predictor.learned(draw_shown(rng, 0.5, since_s, motion=REST))
        at = np.arange(since_s, until_s)
        each = [
            replace(fix, mean=fix.mean + np.concatenate(((t - since_s) * drag_m_s, drag_m_s, np.zeros(2))))
            for t, fix in zip(at, draw_shown(rng, since_s, until_s, motion=REST).each, strict=True)
        ]
        predictor = predictor.learned(SkyFix(whole=each[0], each=tuple(each)))
        exact = draw_fix(REST, at_s, rng, place_m=0.0, speed_m_s=0.0)
        for acceleration_m_s2 in (0.0, size_m_s / 10.0):
            bounds = size_m_s * (until_s - since_s), size_m_s, acceleration_m_s2
            true = predictor.doubted(*(bound / sigmas for bound in bounds)).truth_at(label(at_s))
            off = (true.mean - exact.mean)[:3]
            squares.append(off @ np.linalg.solve(true.covariance[:3, :3], off))
    assert stats.chi2.sf(squares[::2], 3).max() < 1e-3
    assert stats.chi2.sf(squares[1::2], 3).min() > 0.01


def test_carried_on_in_steps_or_at_once_it_is_the_same():
    rng = np.random.default_rng(4)
    predictor = learn(draw_unit("tactical", rng), rng)
    whole = predictor.at(label(60.0))
    for at_s in (33.0, 41.02, 55.5):
        predictor = predictor.until(label(at_s))
    assert predictor.at(label(60.0)).mean == pytest.approx(whole.mean, abs=1e-3)
    spreads = (np.diag(item.covariance)[:6] for item in (predictor.at(label(60.0)), whole))
    ratio = np.divide(*spreads)
    assert ratio == pytest.approx(1.0, abs=0.05)
