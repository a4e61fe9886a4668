"""How far an attack may have moved a position without any test noticing it."""

import numpy as np
import pytest
from tests.app.protect.test_noticed import START, make_finding

from skyproof.app.protect.hidden import bound_drags
from skyproof.records import NoticedAttack


def make_noticed(drag_m_s=1.0, jump_m=10.0, motion_m_s=0.0):
    found = (NoticedAttack("code_drag", drag_m_s), NoticedAttack("position_jump", jump_m))
    return (*found, NoticedAttack("motion", motion_m_s)) if motion_m_s is not None else found


def list_hidden_m(findings, *seconds, since_s=0.0, standing=("rx1",), reach_s=0.0):
    drag = bound_drags(findings, standing=standing)["rx1"]
    gpst = START + (1e9 * np.array(seconds)).astype("timedelta64[ns]")
    since = np.full(gpst.size, START + np.timedelta64(int(1e9 * since_s), "ns"))
    return drag.bound_between(since, gpst, gpst + np.timedelta64(int(1e9 * reach_s), "ns"))


def test_it_grows_by_each_windows_rate_beside_the_largest_jump():
    found = [
        make_finding(0, *make_noticed(1.0, 10.0)),
        make_finding(1, *make_noticed(0.5, 30.0)),
        make_finding(2, *make_noticed(0.5, 20.0)),
    ]
    assert list_hidden_m(found, 0.0, 5.0, 15.0, 30.0) == pytest.approx([10.0, 15.0, 42.5, 50.0])
    assert list_hidden_m(found, 25.0, since_s=20.0) == pytest.approx([32.5])


def test_what_a_fix_is_smoothed_over_counts_where_it_is_later():
    found = [make_finding(k, *make_noticed(1.0, 10.0)) for k in range(10)]
    assert list_hidden_m(found, 0.0, 20.0, 50.0, 80.0, reach_s=20.0) == pytest.approx([20.0, 30.0, 60.0, 90.0])


def test_of_a_receiver_that_stands_carriers_may_move_it_as_well():
    assert list_hidden_m([make_finding(0, *make_noticed(1.0, 10.0, 0.1))], 10.0) == pytest.approx([21.0])


def test_what_may_move_is_dragged_with_its_carriers_unbounded():
    assert np.isnan(list_hidden_m([make_finding(0, *make_noticed())], 5.0, standing=())).all()


def test_an_untested_window_takes_the_next_ones_bound():
    found = [make_finding(0), make_finding(1, *make_noticed(2.0, 10.0)), make_finding(2)]
    assert list_hidden_m(found, 10.0, 20.0) == pytest.approx([30.0, 50.0])
    assert np.isnan(list_hidden_m(found, 25.0)).all()


def test_a_stated_stand_without_a_carrier_test_bounds_nothing():
    assert np.isnan(list_hidden_m([make_finding(0, *make_noticed(motion_m_s=None))], 5.0)).all()


def test_of_a_receiver_with_an_inertial_unit_any_drag_is_bounded():
    found = [make_finding(0, *make_noticed(1.0, 10.0), NoticedAttack("drag", 0.3))]
    drag = bound_drags(found, standing=(), inertial=("rx1",))["rx1"]
    gpst = np.array([START + np.timedelta64(10, "s")])
    assert drag.bound_between(np.array([START]), gpst, gpst) == pytest.approx([13.0])


def test_for_a_standing_receiver_its_place_bounds_the_growth():
    found = [make_finding(k, *make_noticed(2.0, 10.0), NoticedAttack("displacement", 12.0)) for k in range(9)] + [
        make_finding(9, *make_noticed(2.0, 10.0))
    ]
    assert list_hidden_m(found, 0.0, 5.0, 30.0, 85.0, 95.0) == pytest.approx([10.0, 20.0, 32.0, 32.0, 200.0])
