"""Which sky is true: as often wrong as the probability says, and nothing chosen where that is too much."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.nav_estimate import NavEstimate, estimate_from_parts
from skyproof.navigation.prediction import choose, fit_p_value, predict_standing
from skyproof.simulator.clocks import make_clock

HOME = np.array([3.8e6, 7.9e5, 5.0e6])


def draw_fix(place_m, sigma_m, rng=None, velocity=None):
    off = np.zeros(3) if rng is None else sigma_m * rng.standard_normal(3)
    return estimate_from_parts(
        GPS_EPOCH,
        position_ecef_m=HOME + place_m + off,
        position_m2=sigma_m**2 * np.eye(3),
        velocity_ecef_m_s=velocity,
        velocity_m2_s2=None if velocity is None else 0.01 * np.eye(3),
    )


def draw_choices(n, rng, most_wrong, apart_m=None):
    """Draw predictions and fixes of the true sky, and a false one, and choose between them.

    The false one is at a fixed distance, or anywhere within 25 m along each axis. Return what was chosen, and which
    is true.
    """
    root = np.array([[9.0, 0.0, 0.0], [3.0, 6.0, 0.0], [0.0, -2.0, 3.0]])
    for _ in range(n):
        prediction = estimate_from_parts(
            GPS_EPOCH, position_ecef_m=HOME + root @ rng.standard_normal(3), position_m2=root @ root.T
        )
        apart = rng.uniform(-25.0, 25.0, 3)
        if apart_m is not None:
            apart *= apart_m / np.linalg.norm(apart)
        skies = [draw_fix(np.zeros(3), 2.0, rng), draw_fix(apart, 2.0, rng)]
        order = rng.permutation(2)
        found = choose(prediction, [skies[k] for k in order], most_wrong=most_wrong, false_alarm_probability=1e-9)
        yield found, int(np.flatnonzero(order == 0)[0])


def test_of_skies_anywhere_as_many_are_wrong_as_predicted():
    predicted, wrong = 0.0, 0
    for found, true in draw_choices(1000, np.random.default_rng(1), 1.0):
        predicted += found.wrong_probability
        wrong += int(np.argmax(found.probabilities)) != true
    print(f"anywhere within 25 m: {wrong} of 1000 wrong, predicted {predicted:.1f}")
    assert predicted > 10.0
    assert min(stats.poisson.sf(wrong - 1, predicted), stats.poisson.cdf(wrong, predicted)) > 1e-3


@pytest.mark.parametrize("apart_m", [2.0, 20.0])
def test_whatever_the_distance_no_more_are_wrong_than_the_limit(apart_m):
    rng, limit, n = np.random.default_rng(int(apart_m)), 1e-2, 500
    found = list(draw_choices(n, rng, limit, apart_m))
    chosen = [choice.chosen == true for choice, true in found if choice.chosen is not None]
    print(f"{apart_m:g} m apart: {len(chosen)} of {n} chosen, {chosen.count(False)} wrong")
    assert len(chosen) < n
    assert stats.binom.sf(chosen.count(False) - 1, n, limit) > 1e-3
    if apart_m > 10.0:
        assert len(chosen) > n / 10


def test_an_unfitting_sky_is_not_taken_even_if_the_only_one():
    prediction = estimate_from_parts(GPS_EPOCH, position_ecef_m=HOME, position_m2=np.eye(3))
    found = choose(prediction, [draw_fix(np.array([50.0, 0.0, 0.0]), 1.0)])
    assert found.chosen is None
    assert found.fits[0] < 1e-9
    assert choose(prediction, [draw_fix(np.zeros(3), 1.0)]).chosen == 0


def test_nothing_is_chosen_of_two_that_are_alike():
    prediction = estimate_from_parts(GPS_EPOCH, position_ecef_m=HOME, position_m2=np.eye(3))
    found = choose(prediction, [draw_fix(np.zeros(3), 1.0), draw_fix(np.array([0.5, 0.0, 0.0]), 1.0)])
    assert found.chosen is None
    assert found.wrong_probability == pytest.approx(0.5, abs=0.1)


@given(st.permutations(range(3)))
def test_the_order_of_skies_is_of_no_account(order):
    prediction = estimate_from_parts(GPS_EPOCH, position_ecef_m=HOME, position_m2=4.0 * np.eye(3))
    skies = [draw_fix(np.array([east, 0.0, 0.0]), 1.0) for east in (0.0, 3.0, -8.0)]
    found = choose(prediction, [skies[k] for k in order])
    straight = choose(prediction, skies)
    assert [found.probabilities[order.index(k)] for k in range(3)] == pytest.approx(list(straight.probabilities))


def test_only_what_all_have_is_compared():
    prediction = estimate_from_parts(
        GPS_EPOCH,
        position_ecef_m=HOME,
        position_m2=np.eye(3),
        clock_m=np.zeros(2),
        clock_m2=np.eye(2),
    )
    assert choose(prediction, [draw_fix(0.0, 1.0, velocity=np.zeros(3))]).used == (0, 1, 2)
    only_clock = estimate_from_parts(GPS_EPOCH, clock_m=np.zeros(2), clock_m2=np.eye(2))
    with pytest.raises(ValueError, match="nothing to"):
        choose(only_clock, [draw_fix(0.0, 1.0)])


def test_a_clock_push_alone_is_recognized_by_the_oscillator():
    # A standing receiver: 300 m of clock in a minute; a poor crystal leaves that open, a rubidium does not.
    last = estimate_from_parts(
        GPS_EPOCH,
        position_ecef_m=HOME,
        position_m2=np.eye(3),
        clock_m=np.array([1e4, 3.0]),
        clock_m2=np.diag([1.0, 1e-4]),
    )
    later = GPS_EPOCH + np.timedelta64(60, "s")

    def make_sky(push_m: float) -> NavEstimate:
        return estimate_from_parts(
            later,
            position_ecef_m=HOME,
            position_m2=np.eye(3),
            clock_m=np.array([1e4 + 180.0 + push_m, 3.0]),
            clock_m2=np.diag([1.0, 100.0]),
        )

    chosen = {
        name: choose(predict_standing(last, later, OSCILLATORS[name]), [make_sky(0.0), make_sky(30.0)]).chosen
        for name in ("tcxo", "rubidium")
    }
    assert chosen == {"tcxo": None, "rubidium": 0}


def test_a_standing_receivers_clock_is_where_its_class_says():
    squares, later = [], GPS_EPOCH + np.timedelta64(20, "s")
    for seed in range(20):
        drawn = make_clock("ocxo", seed=seed, duration_s=30.0)
        offset, drift = drawn.offset_s(np.array([0.0, 20.0])), drawn.drift(np.zeros(1))[0]
        last = estimate_from_parts(
            GPS_EPOCH,
            position_ecef_m=HOME,
            position_m2=np.eye(3),
            clock_m=SPEED_OF_LIGHT_M_S * np.array([offset[0], drift]),
            clock_m2=1e-12 * np.eye(2),
        )
        found = predict_standing(last, later, OSCILLATORS["ocxo"])
        squares.append((found.mean[6] - SPEED_OF_LIGHT_M_S * offset[1]) ** 2 / found.covariance[6, 6])
    assert 0.2 < np.mean(squares) < 1.0 + 4.0 * np.sqrt(2.0 / 20)


def test_a_standing_receiver_stays_and_what_was_unknown_stays_so():
    last = draw_fix(0.0, 1.0)
    found = predict_standing(last, GPS_EPOCH + np.timedelta64(3600, "s"), OSCILLATORS["tcxo"])
    assert found.mean[:3] == pytest.approx(HOME)
    assert np.diag(found.covariance)[:3] == pytest.approx(1.0)
    assert list(found.there) == [0, 1, 2, 3, 4, 5]
    assert found.mean[3:6] == pytest.approx(0.0)


def test_one_fix_is_tested_as_the_only_one_of_a_choice_is():
    # In all that both know: a fix with velocity against a prediction without one is tested in place alone.
    rng = np.random.default_rng(11)
    prediction = draw_fix(np.zeros(3), 3.0)
    for fix in (
        draw_fix(np.zeros(3), 2.0, rng),
        draw_fix(np.array([5.0, 0.0, 0.0]), 2.0, rng, velocity=np.full(3, 0.1)),
    ):
        assert fit_p_value(prediction, fix) == choose(prediction, [fix]).fits[0]
    clock_only = estimate_from_parts(GPS_EPOCH, clock_m=np.zeros(2), clock_m2=np.eye(2))
    with pytest.raises(ValueError, match="nothing to"):
        fit_p_value(prediction, clock_only)
