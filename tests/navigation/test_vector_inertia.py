"""What an inertial unit tells a vector receiver's filter, from one row of measurements to the next."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.frames import attitude_ecef, ecef_from_geodetic
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.navigation.ins import InsSettings
from skyproof.navigation.vector_filter import VectorSettings, VectorState, propagate_state
from skyproof.navigation.vector_inertia import LASTS_S, AntennaUnit, begin_motion, carry_motion
from skyproof.records import Attitude, ImuSeries

START = np.datetime64("2024-05-14T10:00:00", "ns")
PLACE_M = ecef_from_geodetic(np.radians(57.7), np.radians(11.9), 50.0)
HEADING_RAD, PUSH_M_S2, GRAVITY_M_S2 = 0.7, 15.0, 9.818
FORWARD = attitude_ecef(PLACE_M[None], np.array([HEADING_RAD]), np.zeros(1), np.zeros(1))[0] @ [1.0, 0.0, 0.0]


def add_seconds(seconds):
    return START + np.timedelta64(round(seconds * 1e9), "ns")


def make_unit(sigma_deg=0.2, seconds=8.0, lever_m=(0.0, 0.0, 0.0)):
    """Make a unit at rest for 3 s that is then pushed forward.

    The Earth's rate is left out: it is a thousandth of what is tested.
    """
    ends_s = 0.01 * np.arange(1, round(seconds * 100.0) + 1)
    force = np.zeros((ends_s.size, 3))
    force[:, 2], force[ends_s > 3.005, 0] = -GRAVITY_M_S2, PUSH_M_S2
    readings = ImuSeries(
        gpst=np.array([add_seconds(end) for end in ends_s]),
        interval_s=0.01,
        specific_force_m_s2=force,
        angular_rate_rad_s=np.zeros((ends_s.size, 3)),
    )
    initial = Attitude(
        gpst=readings.gpst[:1], angles_rad=np.array([[HEADING_RAD, 0, 0]]), sigma_rad=np.radians(sigma_deg)
    )
    settings = InsSettings(grade=GRADES["tactical"], oscillator=OSCILLATORS["tcxo"], lever_m=np.array(lever_m))
    return AntennaUnit(readings, initial, settings)


def run_filter(elapsed_s=2.0, velocity=(0.0, 0.0, 0.0)):
    mean = np.concatenate((PLACE_M, velocity, [0.0, 0.0]))
    return VectorState(elapsed_s=elapsed_s, mean=mean, covariance=np.diag([1.0] * 3 + [0.01] * 3 + [1.0, 0.01]))


@pytest.mark.parametrize("lever_m", [(0.0, 0.0, 0.0), (2.0, -1.0, 0.5)])
def test_changes_of_rows_add_up_to_the_motion(lever_m):
    carried, state = begin_motion(make_unit(lever_m=lever_m), run_filter(), add_seconds(2.0)), run_filter()
    for row in range(1, 26):
        carried, (change, walk2) = carry_motion(carried, add_seconds(2.0 + 0.2 * row))
        state = propagate_state(state, 2.0 + 0.2 * row, VectorSettings(), change, walk2=walk2)
    moved = np.concatenate((0.5 * PUSH_M_S2 * 4.0**2 * FORWARD, PUSH_M_S2 * 4.0 * FORWARD))
    off = state.mean[:6] - run_filter().mean[:6] - moved
    assert np.linalg.norm(off[:3]) < 0.5  # of 120 m: the Earth turns under it
    assert np.linalg.norm(off[3:]) < 0.2
    assert np.linalg.norm(off[:3]) < 3.0 * np.sqrt(np.trace(state.covariance[:3, :3]))


def test_the_open_walk_covers_a_tilt_for_a_minute():
    sizes = []
    for sigma_deg in (0.1, 1.0):
        _, (_, walk2) = carry_motion(
            begin_motion(make_unit(sigma_deg), run_filter(), add_seconds(2.0)), add_seconds(2.2)
        )
        wrong_m_s2 = 9.8 * np.radians(sigma_deg)
        assert walk2 * LASTS_S >= (wrong_m_s2 * LASTS_S) ** 2
        sizes.append(walk2)
    assert sizes[1] > 5.0 * sizes[0]
    loose = propagate_state(run_filter(), 3.0, VectorSettings(), np.zeros(6), walk2=1e9)
    np.testing.assert_array_equal(loose.covariance, propagate_state(run_filter(), 3.0, VectorSettings()).covariance)


def test_without_readings_it_carries_nobody():
    whole = make_unit()
    carried = begin_motion(whole, run_filter(), add_seconds(2.0))
    assert carry_motion(carried, add_seconds(9.0)) is None
    assert begin_motion(whole, run_filter(), add_seconds(9.0)) is None
    rows = np.r_[0:400, 600:800]  # two seconds are missing
    part = {name: getattr(whole.readings, name)[rows] for name in ("gpst", "specific_force_m_s2", "angular_rate_rad_s")}
    gap = AntennaUnit(replace(whole.readings, **part), whole.initial, whole.settings)
    assert carry_motion(begin_motion(gap, run_filter(), add_seconds(2.0)), add_seconds(5.0)) is None
