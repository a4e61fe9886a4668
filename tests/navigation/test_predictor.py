"""A receiver that stands, or its clock: what was learned is expected, and what is only followed moves no place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.nav_estimate import KNOWN, NavEstimate
from skyproof.navigation.predictor import SkyFix, Standing, place_surveyed
from skyproof.simulator.clocks import make_clock

HOME = np.array([3.8e6, 7.9e5, 5.0e6])
ROWS = np.array([0, 1, 2, 6])
COVARIANCE = np.array([[2.0, 0.3, 0.0, 1.0], [0.3, 1.0, 0.0, 0.2], [0.0, 0.0, 3.0, 1.5], [1.0, 0.2, 1.5, 2.5]])


def show(at_s, place_m=(0.0, 0.0, 0.0), clock_m=0.0):
    mean, covariance = np.zeros(KNOWN), np.diag(np.full(KNOWN, np.inf))
    mean[ROWS] = [*(HOME + place_m), clock_m]
    covariance[np.ix_(ROWS, ROWS)] = COVARIANCE
    return SkyFix(whole=NavEstimate(gpst=label(at_s), mean=mean, covariance=covariance))


def label(at_s):
    return GPS_EPOCH + np.timedelta64(round(at_s * 1e9), "ns")


def make_standing(name=None, *, stands=True):
    return Standing(stands=stands, oscillator=None if name is None else OSCILLATORS[name], by=("standing",))


def test_of_what_nothing_was_learned_nothing_is_expected():
    assert make_standing("ocxo").at(label(1.0)) is None
    assert make_standing(None, stands=False).learned(show(0.0)).at(label(1.0)) is None


def test_one_fix_predicts_its_place_and_nearly_no_clock():
    expected = make_standing("ocxo").learned(show(0.0)).at(label(60.0))
    assert expected.mean[:3] == pytest.approx(HOME)
    # Its error stays as it is, and that of the next fix comes on top.
    assert expected.covariance[:3, :3] == pytest.approx(2.0 * COVARIANCE[:3, :3])
    assert expected.covariance[6, 6] > 1e10


def test_a_place_is_known_no_better_than_by_one_fix():
    known = make_standing()
    for at_s in range(100):
        known = known.learned(show(float(at_s)))
    spread = known.at(label(100.0)).covariance[:3, :3]
    assert np.linalg.eigvalsh(spread - COVARIANCE[:3, :3]).min() > 0.0
    assert np.trace(spread) < 1.02 * np.trace(COVARIANCE[:3, :3])


@given(st.lists(st.floats(-500.0, 500.0), min_size=1, max_size=5))
def test_what_is_followed_moves_no_place(ways_m):
    known = make_standing("tcxo").learned(show(0.0)).learned(show(10.0))
    before = known.at(label(200.0))
    for number, way_m in enumerate(ways_m):
        known = known.followed(show(20.0 + number, (way_m, 0.0, -way_m), way_m))
    after = known.at(label(200.0))
    assert after.mean[:3] == pytest.approx(before.mean[:3], abs=1e-6)
    assert after.covariance[:3, :3] == pytest.approx(before.covariance[:3, :3])


def test_a_surveyed_place_stays_whatever_is_learned():
    known = place_surveyed(make_standing("ocxo"), HOME, 0.01 * np.eye(3))
    assert list(known.at(label(0.0)).there[:3]) == [0, 1, 2]
    assert 6 not in known.at(label(0.0)).there
    for at_s in (0.0, 10.0, 20.0):
        known = known.learned(show(at_s, (5.0, 0.0, 0.0), 1.0))
    expected = known.at(label(30.0))
    assert expected.mean[:3] == pytest.approx(HOME)
    assert expected.covariance[:3, :3] == pytest.approx(0.01 * np.eye(3))
    assert expected.mean[6] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "draws"),
    [("ocxo", 6), *(pytest.param(name, 40, marks=pytest.mark.long) for name in ("tcxo", "ocxo", "rubidium"))],
)
def test_clocks_are_where_their_class_says(name, draws):
    # Learned over 30 s, expected 60 s later: squared errors over what is stated, never more than that.
    squares, rng = [], np.random.default_rng(5)
    root = float(np.sqrt(COVARIANCE[3, 3]))
    for seed in range(draws):
        drawn, known = make_clock(name, seed=seed, duration_s=120.0), make_standing(name, stands=False)
        offset_m = SPEED_OF_LIGHT_M_S * drawn.offset_s(np.array([5.0, 15.0, 25.0, 85.0]))
        for at_s, clock_m in zip((5.0, 15.0, 25.0), offset_m[:3], strict=True):
            known = known.learned(show(at_s, clock_m=clock_m + root * rng.standard_normal()))
        expected = known.at(label(85.0))
        squares.append((expected.mean[6] - offset_m[3]) ** 2 / expected.covariance[6, 6])
    print(f"{name}: squared errors {np.mean(squares):.2f} of what is stated")
    assert 0.05 < np.mean(squares) < 1.0 + 4.0 * np.sqrt(2.0 / len(squares))
