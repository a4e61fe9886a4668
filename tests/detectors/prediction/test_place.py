"""Signals that put a receiver elsewhere than where it is stated to stand: an attack, or a wrong statement."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats
from tests.app.protect.choosing import NAVIGATION, find_nothing, make_takeover

from skyproof.app.common.epoch_source import WholeSource
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import windows_of
from skyproof.detectors.continuity.series import Limits, build_series
from skyproof.detectors.prediction.place import StatedPlace, StatedPlaceSettings
from skyproof.gnss.frames import rot_enu_ecef
from skyproof.gnss.slips import HEIGHT, UNLISTED
from skyproof.navigation.predictor import Standing, place_surveyed
from skyproof.records import Cause
from skyproof.simulator.sky import make_scene
from skyproof.studies.receiver_model import ChannelNoise, model_receptions

ALPHA = 1e-7
ONSET_S = 35.0
STANDS = Standing(stands=True, oscillator=None, by=("standing",), assumes=("receiver_stands",))


@cache
def simulate_standing(speed_m_s=0.0, seed=1, duration_s=81.0, code_m=0.5, ar1=0.0, constant_m=0.0):
    """Simulate a standing receiver: measurements, windows with their sets, and its place; attacked if fast."""
    scene = make_takeover(speed_m_s=speed_m_s or 1.0, onset_s=ONSET_S, duration_s=duration_s, seed=seed)
    if not speed_m_s:
        scene = make_scene(scene.scenario.model_copy(update={"attacks": ()}), NAVIGATION)
    noise = ChannelNoise(code_m=code_m, ar1=ar1, constant_m=constant_m)
    (model,) = model_receptions(scene, noise, rng=np.random.default_rng(seed))
    o = model.reception.observations
    return o, list(windows_of([WholeSource(o)], NAVIGATION, Settings())), model.position_ecef_m[0]


def list_departures(found, predictor):
    """Return findings of windows that do not show the place where the receiver stands."""
    o, windows, _ = found
    return [e for e in examine(windows, o, predictor) if e.code not in ("there", "no_place")]


def examine(windows, o, predictor):
    """Return all findings of windows in which no other test finds anything."""
    state, findings = None, []
    detector = StatedPlace(StatedPlaceSettings(false_alarm_probability=ALPHA))
    for window, clean in zip(windows, find_nothing(windows, o.signals), strict=True):
        found, state = detector.examine(replace(window, standing={"bow": predictor}, findings=(clean,)), state)
        findings += found
    return findings


def move_place(o, since, place_m, by_m):
    """Return measurements that show another place from an instant on, by (3,) ECEF."""
    unit = build_series(o, NAVIGATION, place_m, Limits()).unit
    return replace(o, pseudorange_m=o.pseudorange_m - (o.gpst >= since)[:, None] * (unit @ by_m))


def make_place(found, *, north_m=0.0, up_m=0.0):
    """Make a stated place so far from the receiver's."""
    away_m = rot_enu_ecef(np.radians(57.7), np.radians(11.94)).T @ [0.0, north_m, up_m]
    return place_surveyed(STANDS, found[2] + away_m, 0.01 * np.eye(3))


def test_what_stands_where_it_is_stated_to_says_nothing():
    found = simulate_standing()
    assert list_departures(found, STANDS) == []
    assert list_departures(found, make_place(found)) == []


@pytest.mark.parametrize(
    ("where", "code"), [({"north_m": 200.0}, UNLISTED), ({"up_m": 60.0}, HEIGHT), ({"up_m": -36.3}, "above_sea_level")]
)
def test_a_place_that_no_window_shows_is_false_or_wrongly_stated(where, code):
    found = simulate_standing()
    every = list_departures(found, make_place(found, **where))
    assert len(every) == len(found[1])
    assert {(e.says, e.failed, e.overrules) for e in every} == {("undecided", True, True)}
    assert all(e.wrong_statements[0].code.endswith(code) for e in every)
    assert all(e.wrong_statements[0].about == "position of bow" for e in every)


@pytest.mark.parametrize("north_m", np.linspace(8.0, 20.0, 7))
def test_a_place_that_is_wrong_by_what_just_fits_is_no_attack(north_m):
    # It fits in one window and not in the next, and what is shown stays where it is.
    for seed in (1, 2, 3):
        found = simulate_standing(seed=seed, code_m=1.0, ar1=0.9, constant_m=1.0)
        assert {e.says for e in list_departures(found, make_place(found, north_m=north_m))} <= {"undecided"}


@pytest.mark.parametrize("stated", [False, True])
def test_a_place_that_was_shown_and_is_left_is_an_attack(stated):
    found = simulate_standing(speed_m_s=3.0)
    first, *rest = list_departures(found, make_place(found) if stated else STANDS)
    after_s = float((first.end_gpst - found[0].gpst[0]) / np.timedelta64(1, "s")) - ONSET_S - 3.0
    assert first.says == "attack"
    assert 0.0 < after_s <= 15.0
    assert first.data["assumes"] == ("receiver_stands",)
    assert {(e.says, e.code) for e in (first, *rest)} == {("attack", "elsewhere")}
    dated_s = float((first.dated_gpst - found[0].gpst[0]) / np.timedelta64(1, "s")) - ONSET_S - 3.0
    assert 0.0 <= dated_s < after_s - 1.0
    assert first.dated_gpst in found[0].gpst
    assert [e.dated_gpst - e.start_gpst < np.timedelta64(1, "s") for e in rest] == [True] * len(rest)


@pytest.mark.long
@pytest.mark.parametrize(("constant_m", "code_m", "ar1"), [(3.0, 1.0, 0.9), (10.0, 3.0, 0.9), (30.0, 10.0, 0.9)])
def test_errors_many_times_as_large_as_stated_are_no_attack(constant_m, code_m, ar1):
    windows = open_ = 0
    for seed in range(60):
        found = simulate_standing.__wrapped__(seed=seed, code_m=code_m, ar1=ar1, constant_m=constant_m)
        every = list_departures(found, STANDS)
        windows, open_ = windows + len(found[1]), open_ + len(every)
        assert not any(e.says == "attack" for e in every), seed
    print(f"{constant_m:.0f} m constant, {code_m:.0f} m with {ar1}: {windows} windows, {open_} open")


@pytest.mark.parametrize("draws", [12, pytest.param(300, marks=pytest.mark.long)])
def test_moves_of_the_size_that_is_stated_are_noticed(draws):
    # However slow: the window that shows the place moved as a whole is tested against the first one.
    rng, noticed, few = np.random.default_rng(3), 0, 0
    for draw in range(draws):
        o, windows, place_m = simulate_standing.__wrapped__(seed=draw, duration_s=41.0)
        (size,) = examine(windows, o, STANDS)[-1].noticed
        assert size.kind == "displacement"
        heading = rng.uniform(0.0, 2.0 * np.pi)
        level = rot_enu_ecef(np.radians(57.7), np.radians(11.94)).T @ [np.sin(heading), np.cos(heading), 0.0]
        for share in (1.0, 0.4):
            other = move_place(o, windows[-1].start_gpst, place_m, share * size.size * level)
            found = examine(list(windows_of([WholeSource(other)], NAVIGATION, Settings())), o, STANDS)[-1]
            seen = found.p[Cause.CLEAN] < found.alpha
            noticed, few = noticed + (seen and share == 1.0), few + (seen and share < 1.0)
    print(f"{draws} draws: {noticed} noticed, of 0.4 of the size {few}; the last {size.size:.1f} m")
    assert stats.binomtest(noticed, draws, 0.97, alternative="less").pvalue > 1e-3
    assert few < 0.5 * draws
