"""The inertial filter on a real walk: aligned on the way, cut off from fixes, led away by false ones."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation
from tests.navigation.walk import SETTINGS, align, follow, read_walk

from skyproof.navigation.inertia import select_readings
from skyproof.navigation.ins import correct, step
from skyproof.navigation.ins_updates import measurement_from_fix
from skyproof.navigation.nav_estimate import estimate_from_parts

pytestmark = [pytest.mark.long, pytest.mark.shared_data]

STARTS_S = np.arange(40.0, 101.0, 10.0)
EAST_NORTH = [np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in np.radians([0.0, 120.0, 240.0])]


@pytest.fixture(scope="module")
def walk(shared_data):
    return read_walk(shared_data / "real" / "imu-gnss-walk")


@pytest.fixture(scope="module")
def states(walk):
    """Align in motion from 11 to 25 s, and return the filter's states after the fixes at the start of each cut."""
    state, found = align(walk, 11.0, 25.0).state, {}
    for start_s in STARTS_S:
        _, state = follow(walk, state, start_s)
        found[start_s] = state
    return found


def test_alignments_in_motion_agree_as_far_as_they_state(walk):
    # Attitudes at the ends of windows, each against the whole window's, carried there by the gyros.
    whole = align(walk, 11.0, 40.0)
    for start_s, end_s in ((2.0, 14.0), (11.0, 20.0), (15.0, 25.0), (20.0, 35.0)):
        found = align(walk, start_s, end_s)
        assert found.state is not None
        _, later = follow(walk, found.state, 40.0, use=lambda at: False)
        turned = Rotation.from_matrix(later.attitude @ whole.state.attitude.T).as_rotvec()
        spread = later.covariance[6:9, 6:9] + whole.state.covariance[6:9, 6:9]
        square = turned @ np.linalg.solve(spread, turned)
        print(f"{start_s:g} to {end_s:g} s: heading to {np.degrees(found.heading_sigma_rad):.1f}, {square:.1f} of 3")
        assert stats.chi2.sf(square, 3) > 1e-4


@pytest.mark.parametrize("cut_s", [10.0, 20.0, 30.0])
def test_without_fixes_the_position_is_off_as_far_as_stated(walk, states, cut_s):
    off_m, sigma_m, squares = [], [], []
    for start_s, state in states.items():
        if start_s + cut_s > walk.seconds[-1]:
            continue
        seen, _ = follow(walk, state, start_s + cut_s, use=lambda at: False)
        off, spread = seen.off[-1, :3], seen.spread[-1, :3, :3]
        off_m.append(np.linalg.norm(off))
        sigma_m.append(np.sqrt(np.trace(spread)))
        squares.append(off @ np.linalg.solve(spread, off))
    n = len(squares)
    print(
        f"{cut_s:g} s, {n} cuts: off {np.median(off_m):.2f} m, at most {max(off_m):.2f}; stated "
        f"{np.median(sigma_m):.2f} m; {np.mean(squares) / 3:.2f} of what is stated"
    )
    # Cuts of one unit share its errors, and its grade is a guess: as stated, or better, by what a few may scatter.
    assert 0.1 < np.mean(squares) / 3.0 < 2.0


@pytest.mark.parametrize("speed_m_s", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("with_velocity", [True, False])
def test_false_fixes_are_noticed(walk, states, speed_m_s, with_velocity):
    # Drawn off at a steady speed, with velocities that go with it, or positions alone; fixes as good as true ones.
    delays_s, dragged_m = [], []
    for start_s, state in states.items():
        for direction in EAST_NORTH:
            away = speed_m_s * direction @ walk.to_enu
            noticed_s, spoofed = np.inf, state
            for fix, at in zip(walk.fixes, walk.seconds, strict=True):
                if not start_s < at < start_s + 10.0:
                    continue
                _, spoofed = step(spoofed, select_readings(walk.readings, spoofed.gpst, fix.gpst), SETTINGS)
                false = estimate_from_parts(
                    fix.gpst,
                    position_ecef_m=fix.mean[:3] + (at - start_s) * away,
                    position_m2=fix.covariance[:3, :3],
                    velocity_ecef_m_s=fix.mean[3:6] + away if with_velocity else None,
                    velocity_m2_s2=fix.covariance[3:6, 3:6] if with_velocity else None,
                )
                spoofed, fit = correct(
                    spoofed, measurement_from_fix(spoofed, false, SETTINGS), false_alarm_probability=1e-4
                )
                if not fit.used:
                    noticed_s = at - start_s
                    break
            delays_s.append(noticed_s)
            dragged_m.append(speed_m_s * noticed_s)
    words = f"{speed_m_s:g} m/s, {'with' if with_velocity else 'without'} velocity"
    print(f"{words}: noticed after {np.median(delays_s):.2f} s, at most {max(delays_s):.2f} s, {max(dragged_m):.1f} m")
    assert np.max(delays_s) < 3.0


def test_true_fixes_are_refused_seldom(walk, states):
    seen, _ = follow(walk, states[STARTS_S[0]], 120.0)
    print(f"{np.mean(seen.p_value < 1e-4):.4f} of {seen.p_value.size} fixes refused at 1e-4")
    assert np.mean(seen.p_value < 1e-4) < 0.02
