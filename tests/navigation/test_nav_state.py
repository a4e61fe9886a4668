"""A state between the times at which it is stated: what moves and turns evenly is met exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.nav_state import interpolate_state, mark_covered
from skyproof.records import NavState

NUMBERS = st.floats(-100.0, 100.0)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(np.array)


def make_time(seconds):
    return GPS_EPOCH + np.rint(np.asarray(seconds) * 1e9).astype("timedelta64[ns]")


def make_even_motion(seconds, velocity, turn_rad_s):
    """Make a body that leaves its place evenly and turns about one axis."""
    n = len(seconds)
    return NavState(
        gpst=make_time(seconds),
        position_ecef_m=np.array([6.4e6, 0.0, 0.0]) + np.outer(seconds, velocity),
        velocity_ecef_m_s=np.tile(velocity, (n, 1)),
        attitude=Rotation.from_rotvec(np.outer(seconds, turn_rad_s)).as_matrix(),
        covariance=np.asarray(seconds)[:, None, None] * np.eye(9),
    )


@given(st.lists(st.floats(0.0, 9.0), min_size=1, max_size=5), VECTORS, VECTORS)
def test_even_motion_is_met_between_the_states(seconds, velocity, axis):
    turn_rad_s = 0.018 * axis  # less than half a turn from state to state
    found = interpolate_state(
        make_even_motion(np.array([0.0, 0.3, 1.0, 2.0, 4.0, 9.0]) * 1.0, velocity, 0.2 * turn_rad_s), make_time(seconds)
    )
    wanted = make_even_motion(np.array(seconds), velocity, 0.2 * turn_rad_s)
    assert np.array_equal(found.gpst, wanted.gpst)
    np.testing.assert_allclose(found.position_ecef_m, wanted.position_ecef_m, atol=1e-6)
    np.testing.assert_allclose(found.attitude, wanted.attitude, atol=1e-8)
    np.testing.assert_allclose(found.covariance, wanted.covariance, atol=1e-6)


def test_what_is_not_known_stays_so_between_the_states():
    state = make_even_motion(np.array([0.0, 1.0]), np.ones(3), np.zeros(3))
    covariance = state.covariance.copy()
    covariance[:, range(6), range(6)] = np.inf
    found = interpolate_state(
        NavState(
            gpst=state.gpst,
            position_ecef_m=state.position_ecef_m,
            velocity_ecef_m_s=state.velocity_ecef_m_s,
            attitude=state.attitude,
            covariance=covariance,
        ),
        make_time([0.0, 0.25, 1.0]),
    )
    assert np.isinf(found.covariance[:, range(6), range(6)]).all()
    assert found.covariance[:, 8, 8] == pytest.approx([0.0, 0.25, 1.0])


def test_one_state_holds_at_its_own_time_only():
    state = make_even_motion(np.array([1.0]), np.ones(3), np.zeros(3))
    assert mark_covered(state, make_time([0.999999999, 1.0, 1.000000001])).tolist() == [False, True, False]
    assert np.array_equal(
        interpolate_state(state, make_time([1.0, 1.0])).position_ecef_m, state.position_ecef_m[[0, 0]]
    )
