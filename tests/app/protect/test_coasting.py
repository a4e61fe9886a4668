"""While nothing is trusted a receiver that stands is where its last trusted fix was; false signals move nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special
from tests.app.protect.test_positions import RECORDS, WHOLE, make_decision

from skyproof.app.common.settings import Settings
from skyproof.app.protect.coasting import Flown, coast, step, usable_fixes
from skyproof.app.protect.hidden import HiddenDrag
from skyproof.app.protect.positions import set_up_positions
from skyproof.navigation.nav_estimate import estimate_from_parts
from skyproof.records import Fix

LABELS = np.datetime64("2022-01-01T21:45:58", "ns") + np.arange(12) * np.timedelta64(1, "s")


def fix_at(good) -> Fix:
    """Make fixes, each epoch at a position of its own."""
    n = len(good)
    return Fix(
        receiver="rx1",
        signals=(),
        gpst=LABELS[:n] - np.timedelta64(1_000_000, "ns"),
        position_ecef_m=np.where(np.array(good)[:, None], 6.4e6 + np.arange(n)[:, None] + np.zeros(3), np.nan),
        velocity_ecef_m_s=np.zeros((n, 3)),
        clock_bias_s=np.where(good, 1e-3 + 1e-6 * np.arange(n), np.nan),
        clock_drift=np.full(n, 1e-6),
        covariance_m2=np.tile(4.0 * np.eye(4), (n, 1, 1)),
        residual_m=np.empty((n, 0)),
        status=np.where(good, 0, 1).astype(np.uint8),
        protection_m=10.0 + np.arange(n)[:, None] + np.array([0.0, 0.5]),
        hidden_m=1.0 * np.arange(n),
    )


def test_epochs_without_a_fix_keep_the_last_position_and_sigma():
    good = [False, True, True, False, False, True, False]
    found, last = step(None, "rx1", LABELS[:7], fix_at(good))
    assert found.position_ecef_m[:, 0] - 6.4e6 == pytest.approx([2.0, 2.0, 5.0])
    assert found.covariance_m2[:, :3, :3] == pytest.approx(np.tile(4.0 * np.eye(3), (3, 1, 1)))
    assert found.protection_m == pytest.approx(np.array([[12.0, 12.5], [12.0, 12.5], [15.0, 15.5]]))
    assert found.hidden_m.tolist() == [2.0, 2.0, 5.0]
    assert found.clock_bias_s == pytest.approx(1e-3 + 1e-6 * np.array([3.0, 4.0, 6.0]))
    assert np.abs(found.gpst - (LABELS[[3, 4, 6]] - np.timedelta64(1_000_000, "ns"))).max() < np.timedelta64(10, "us")
    assert last.gpst == LABELS[5]


def test_before_the_first_fix_there_is_nothing():
    assert step(None, "rx1", LABELS[:3], None) == (None, None)


@given(st.lists(st.booleans(), min_size=12, max_size=12), st.integers(0, 12))
def test_pieces_give_what_the_whole_gives(good, cut):
    whole, fix = step(None, "rx1", LABELS, fix_at(good))[0], fix_at(good)
    first, last = step(None, "rx1", LABELS[:cut], fix.select(slice(0, cut)))
    second, _ = step(last, "rx1", LABELS[cut:], fix.select(slice(cut, 12)))
    parts = [part.position_ecef_m for part in (first, second) if part is not None]
    if whole is None:
        assert not parts
    else:
        assert np.array_equal(np.concatenate(parts), whole.position_ecef_m)


@pytest.mark.parametrize("speed_m_s", [0.0, None])
def test_a_run_goes_on_where_its_receiver_stands_and_only_there(speed_m_s):
    settings = Settings(smoothing_s=20.0, speed_max_m_s=speed_m_s)
    positions = set_up_positions(WHOLE, make_decision(), RECORDS.navigation, settings)
    found = list(usable_fixes(positions))
    trusted = [fix for kind, fix in found if kind == "trusted"]
    carried = [fix for kind, fix in found if kind == "held"]
    assert len(trusted) == 1
    if speed_m_s is None:
        assert not carried
        return
    (after,) = carried
    last = np.flatnonzero(trusted[0].status == 0)[-1]
    assert after.gpst.size == 90 - 1 - last  # the false sky goes on to the end
    assert after.position_ecef_m == pytest.approx(np.tile(trusted[0].position_ecef_m[last], (after.gpst.size, 1)))


class Heard:
    """Stands in for an inertial unit's predictor and keeps each call with its instant."""

    def __init__(self):
        self.told = []

    def learned(self, shown):
        self.told += [("learned", item.gpst) for item in shown.each]
        return self

    def followed(self, shown):
        self.told += [("followed", item.gpst) for item in shown.each]
        return self

    def until(self, gpst):
        self.told.append(("until", gpst))
        return self

    def truth_at(self, gpst):
        return None


@pytest.mark.parametrize("cuts", [(12,), (5, 12), (3, 7, 12)])
def test_fixes_of_overlapping_skies_correct_the_unit_once(cuts):
    # Two are after the last trusted fix; the one before it comes too late to tell anything.
    good = [True] * 4 + [False] * 8
    whole, heard = fix_at(good), Heard()
    times = [LABELS[k] + np.timedelta64(500, "ms") for k in (1, 5, 8)]
    place = {"position_ecef_m": np.zeros(3), "position_m2": np.eye(3)}
    flown = Flown(predictor=heard, coming=tuple(estimate_from_parts(gpst, **place) for gpst in times))
    first = 0
    for stop in cuts:
        rows = slice(first, stop)
        _, flown = coast(flown, "rx1", LABELS[rows], whole.select(rows))
        first = stop
    assert [gpst for word, gpst in heard.told if word == "followed"] == times[1:]
    assert flown.coming == ()
    asked = [gpst for word, gpst in heard.told if word != "learned"]
    assert asked == sorted(asked)


def test_doubtful_fixes_correct_no_unit_and_stay_what_they_are():
    heard, doubtful = Heard(), np.arange(12) >= 6
    coast(Flown(predictor=heard), "rx1", LABELS, fix_at([True] * 9 + [False] * 3), doubtful)
    bias = np.timedelta64(1_000_000, "ns")
    assert [gpst for word, gpst in heard.told if word == "learned"] == list(LABELS[:6] - bias)
    assert [word for word, _ in heard.told].count("until") == 3


class Drifts(Heard):
    """A navigator that stands; its sigma grows by a metre a second on each axis."""

    def truth_at(self, gpst):
        sigma_m = float((gpst - LABELS[3]) / np.timedelta64(1, "s"))
        place = {"position_ecef_m": np.array([6.4e6, 0.0, 0.0]), "position_m2": sigma_m**2 * np.eye(3)}
        return estimate_from_parts(gpst, **place, velocity_ecef_m_s=np.zeros(3), velocity_m2_s2=np.eye(3))


def test_inertial_levels_and_hidden_error_grow_from_the_last_fix():
    fix = fix_at([True] * 4 + [False] * 8)
    drag = HiddenDrag(
        zero=LABELS[0],
        edges_s=np.array([0.0, 20.0]),
        rate_m_s=np.array([2.0]),
        jump_m=np.zeros(1),
        far_m=np.array([np.inf]),
    )
    carried, _ = coast(Flown(predictor=Drifts(), hidden=drag, integrity_risk=1e-7), "rx1", LABELS, fix)
    seconds = (carried.gpst - LABELS[3]) / np.timedelta64(1, "s")
    assert carried.protection_m[:, 0] == pytest.approx(13.0 + seconds * np.sqrt(-2.0 * np.log(1e-7)), rel=1e-6)
    assert carried.protection_m[:, 1] == pytest.approx(13.5 - seconds * special.ndtri(0.5e-7), rel=1e-6)
    assert carried.hidden_m == pytest.approx(3.0 + 2.0 * seconds, abs=0.01)


def test_nothing_is_hidden_by_inertia_after_a_trusted_fix():
    fix = replace(fix_at([True] * 4 + [False] * 8), hidden_m=np.zeros(12))
    drag = HiddenDrag(
        zero=LABELS[0],
        edges_s=np.array([0.0, 20.0]),
        rate_m_s=np.array([2.0]),
        jump_m=np.zeros(1),
        far_m=np.array([np.inf]),
    )
    coming = (estimate_from_parts(LABELS[7], position_ecef_m=np.zeros(3), position_m2=np.eye(3)),)
    flown = Flown(predictor=Drifts(), hidden=drag, integrity_risk=1e-7, coming=coming)
    carried, _ = coast(flown, "rx1", LABELS, fix)
    assert (carried.hidden_m == 0.0).all()
    assert np.isfinite(carried.protection_m[:, 0]).tolist() == [True] * 4 + [False] * 4
