"""The law of continuous code positions: its rate by counting, and its bounds."""

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.code_motion.laws import CodeMotionLimits, chance_of_clock, chance_of_motion, compute_code_steps
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S

STILL = CodeMotionLimits(acceleration_m_s2=1e-12, speed_m_s=np.inf, clock_jump=0.0, clock_pace_s=0.0)
FREE = CodeMotionLimits(acceleration_m_s2=50.0, speed_m_s=40.0, clock_jump=1e-8, clock_pace_s=1e-8)


def draw_motions(rng: np.random.Generator, trials: int, covariance: np.ndarray, gaps_s=(1.0, 1.0)):
    """Draw motions of three epochs with noise of this covariance; give dof and factor as residuals do."""
    elapsed_s = np.cumsum([0.0, *gaps_s])
    noise = rng.multivariate_normal(np.zeros(4), covariance, (trials, 3))
    dof = 12
    factor = rng.chisquare(dof, trials) / dof
    found = [
        compute_code_steps(elapsed_s, noise[k, :, :3], noise[k, :, 3], np.broadcast_to(covariance, (3, 4, 4)))
        for k in range(trials)
    ]
    return found, factor, np.array([dof])


@pytest.mark.parametrize("gaps_s", [(1.0, 1.0), (0.2, 3.0)])
def test_false_alarms_come_at_the_stated_rate(gaps_s) -> None:
    rng = np.random.default_rng(1)
    found, factor, dof = draw_motions(rng, 4000, 4.0 * np.eye(4), gaps_s)
    for law in (chance_of_motion, chance_of_clock):
        p_values = np.array([law(m, STILL, f[None], dof)[0] for m, f in zip(found, factor, strict=True)])
        for rate in (0.1, 0.01):
            alarms = int((p_values < rate).sum())
            assert stats.binomtest(alarms, p_values.size, rate).pvalue > 1e-3, (law.__name__, rate, alarms)


def test_an_elongated_covariance_errs_to_the_safe_side() -> None:
    rng = np.random.default_rng(2)
    found, factor, dof = draw_motions(rng, 2000, np.diag([1.0, 1.0, 16.0, 4.0]))
    p_values = np.array([chance_of_motion(m, STILL, f[None], dof)[0] for m, f in zip(found, factor, strict=True)])
    assert 0 < (p_values < 0.1).sum() < 200


def find_chances(position_m, clock_m=(0.0, 0.0, 0.0), gaps_s=(1.0, 1.0), speed=np.inf):
    """Return the chances of position and clock of three epochs along one axis, known to a metre."""
    places = np.zeros((3, 3))
    places[:, 0] = position_m
    found = compute_code_steps(
        np.cumsum([0.0, *gaps_s]), places, np.array(clock_m), np.broadcast_to(np.eye(4), (3, 4, 4))
    )
    limits = CodeMotionLimits(acceleration_m_s2=50.0, speed_m_s=speed, clock_jump=1e-8, clock_pace_s=1e-8)
    unit_factor, dof = np.ones(1), np.array([12])
    return chance_of_motion(found, limits, unit_factor, dof)[0], chance_of_clock(found, limits, unit_factor, dof)[0]


def test_what_an_acceleration_can_do_is_no_jump() -> None:
    assert find_chances([0.0, 0.0, 49.0])[0] == 1.0
    assert find_chances([0.0, 900.0, 1849.0])[0] == 1.0  # fast, and faster by 50 m/s
    assert find_chances([0.0, 0.0, 90.0])[0] < 1e-4
    assert find_chances([0.0, 0.0, 1000.0])[0] < 1e-12


def test_a_gap_gives_room_to_accelerate_but_not_to_be_faster() -> None:
    assert find_chances([0.0, 0.0, 1000.0], gaps_s=(1.0, 8.0))[0] == 1.0
    assert find_chances([0.0, 0.0, 1000.0], gaps_s=(1.0, 8.0), speed=40.0)[0] < 1e-12
    assert find_chances([0.0, 20.0, 300.0], gaps_s=(1.0, 8.0), speed=40.0)[0] == 1.0


def test_clocks_jump_but_not_by_whole_milliseconds() -> None:
    ms_m = 1e-3 * SPEED_OF_LIGHT_M_S
    assert find_chances([0.0] * 3, [0.0, 0.0, 3000.0])[1] < 1e-12
    assert find_chances([0.0] * 3, [0.0, 0.0, -ms_m])[1] == 1.0
    assert find_chances([0.0] * 3, [0.0, 300.0, 600.0])[1] == 1.0  # a rate, and no jump
    assert find_chances([0.0] * 3, [0.0, 0.0, np.nan])[1] == 1.0


def test_time_that_was_not_recorded_gives_room_to_move() -> None:
    far_m, ahead_m = 400.0, 10.0 * SPEED_OF_LIGHT_M_S
    assert find_chances([0.0, 0.0, far_m])[0] < 1e-9
    assert find_chances([0.0, 0.0, far_m], [0.0, 0.0, -ahead_m])[0] == 1.0
