"""Attacks of just the size that a finding gives are noticed as often as it says."""

import numpy as np
import pytest
from scipy import stats
from tests.detectors.continuity.test_detector import (
    LIGHT_M_S,
    NAVIGATION,
    PLACE_ECEF_M,
    WHITE,
    change_cells,
    make_windows,
    observe_scene,
)

from skyproof.detectors.continuity.detector import Continuity, ContinuitySettings
from skyproof.detectors.continuity.series import Limits, build_series
from skyproof.statistics.distributions import noncentrality_for_power

LIMITS = Limits()


def find_all(o):
    detector, state, found = Continuity(ContinuitySettings(false_alarm_probability=1e-6)), None, []
    for records in make_windows(o):
        evidence, state = detector.examine(records, state)
        found += evidence
    return found


def find_size(found, kind):
    """Return the size in the window in which the tests see least."""
    return max(attack.size for finding in found for attack in finding.noticed if attack.kind == kind)


def shift_ranges(o, change_m, *, row=None):
    """Change pseudoranges by so much, (n, m), from a row at which all carriers break."""
    status = o.status.copy()
    if row is not None:
        status[row] = 3
    return change_cells(o, pseudorange_m=o.pseudorange_m + change_m, status=status)


def move_at_once(o, rng, size_m):
    """Let the position of the attacked receiver jump in any direction."""
    row = int(rng.integers(30, o.gpst.size - 30))
    direction = rng.normal(size=3)
    direction *= size_m / np.linalg.norm(direction)
    unit = build_series(o, NAVIGATION, PLACE_ECEF_M, LIMITS).unit
    return shift_ranges(o, np.where(np.arange(o.gpst.size)[:, None] >= row, -unit @ direction, 0.0), row=row)


def delay_time(o, rng, size_s):
    """Let the time jump back; missing samples would make it jump ahead."""
    row = int(rng.integers(30, o.gpst.size - 30))
    change_m = np.where(np.arange(o.gpst.size) >= row, LIGHT_M_S * size_s, 0.0)
    return shift_ranges(o, np.broadcast_to(change_m[:, None], o.pseudorange_m.shape), row=row)


def drag_codes(o, rng, size_m_s):
    """Drag the position off by codes alone, without the carriers."""
    direction = rng.normal(size=3)
    direction *= size_m_s / np.linalg.norm(direction)
    unit = build_series(o, NAVIGATION, PLACE_ECEF_M, LIMITS).unit
    return shift_ranges(o, -(unit @ direction) * np.maximum(o.elapsed_s - 8.0, 0.0)[:, None])


def change_rates(o, begins_m_s, row):
    """Change codes and carriers at such rates from a row on, (m,), unbroken."""
    since_s = np.maximum(o.elapsed_s - o.elapsed_s[row - 1], 0.0)[:, None]
    wavelength_m = LIGHT_M_S / o.carrier_hz
    return change_cells(
        o,
        pseudorange_m=o.pseudorange_m + begins_m_s * since_s,
        carrier_cyc=o.carrier_cyc + begins_m_s * since_s / wavelength_m,
        doppler_hz=o.doppler_hz - np.where(since_s > 0.0, begins_m_s / wavelength_m, 0.0),
    )


def pull_position(o, rng, size_m_s):
    """Drag the position off by codes and carriers together from the start."""
    row = int(rng.integers(30, o.gpst.size - 30))
    direction = rng.normal(size=3)
    direction *= size_m_s / np.linalg.norm(direction)
    return change_rates(o, -build_series(o, NAVIGATION, PLACE_ECEF_M, LIMITS).unit[row] @ direction, row)


def push_time(o, rng, size_s_s):
    """Push the time from the start."""
    row = int(rng.integers(30, o.gpst.size - 30))
    return change_rates(o, np.full(len(o.signals), LIGHT_M_S * size_s_s * rng.choice([-1.0, 1.0])), row)


@pytest.mark.parametrize(
    ("kind", "attack", "small"),
    # A drag adds up from window to window: the first one sees least of it.
    [
        ("position_jump", move_at_once, 0.4),
        ("clock_jump", delay_time, 0.4),
        ("velocity_jump", pull_position, 0.4),
        ("clock_push", push_time, 0.4),
        ("code_drag", drag_codes, 0.1),
    ],
)
@pytest.mark.parametrize("draws", [25, pytest.param(300, marks=pytest.mark.long)])
def test_attacks_of_the_size_that_is_stated_are_noticed(kind, attack, small, draws):
    rng, noticed, few = np.random.default_rng(17), 0, 0
    for draw in range(draws):
        o = observe_scene(draw, noise=WHITE, duration_s=42.0)
        size = find_size(find_all(o), kind)
        noticed += any(finding.failed or finding.says == "attack" for finding in find_all(attack(o, rng, size)))
        few += any(finding.failed or finding.says == "attack" for finding in find_all(attack(o, rng, small * size)))
    assert stats.binomtest(noticed, draws, 0.97, alternative="less").pvalue > 1e-3
    assert few < 0.5 * draws


def test_power_is_that_of_the_noncentral_chi_square():
    rng, noncentrality = np.random.default_rng(1), noncentrality_for_power(35.4, 3, power=0.9)
    drawn = (rng.normal(size=(4000, 3)) + np.sqrt(noncentrality / 3.0)) ** 2
    assert stats.binomtest(int((drawn.sum(axis=1) > 35.4).sum()), 4000, 0.9).pvalue > 1e-3
