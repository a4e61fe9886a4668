"""Fades: how often noise passes for a signal, and where a channel goes that has none."""

import numpy as np
import pytest
from scipy import stats

from skyproof.receiver import coasting as c
from skyproof.receiver import kernels as k

NOMINAL = 1.023e6, 1575.42e6


def make_loops(power, count, n=1):
    loops = np.zeros((n, k.N_STATE))
    loops[:, k.LOCK_I], loops[:, k.LOCK_Q] = np.asarray(power).reshape(2, -1)
    loops[:, k.LOCK_COUNT] = count
    return loops


@pytest.mark.parametrize("count", [5, 20, 100])
def test_noise_passes_for_a_signal_as_often_as_stated(count):
    rng = np.random.default_rng(count)
    n, stated, noise = 200_000, 1e-3, 7.0
    squares = 0.5 * noise * rng.chisquare(count, (2, n))  # of prompts whose I and Q have half the noise each
    passed = int(c.has_power(make_loops(squares, count, n), noise, stated).sum())
    assert stats.binomtest(passed, n, stated).pvalue > 1e-4


def test_a_frame_of_nothing_has_no_power():
    assert not c.has_power(make_loops(np.zeros((2, 1)), 0), 1.0, 1e-3).any()
    assert not c.has_power(make_loops(np.zeros((2, 1)), 0), 0.0, 1e-3).any()


def build_measured(rates_hz_s, drift_hz_s, lost, seconds, rng):
    """Build courses after rows measured each 0.2 s; the `lost` channel is measured for the first half only."""
    rates = np.array(rates_hz_s)
    courses = np.full((rates.size, c.N_COURSE), np.nan)
    for row in range(1, round(seconds / 0.2) + 1):
        at_s = 0.2 * row
        drift_hz = drift_hz_s * max(at_s - 0.5 * seconds, 0.0)
        doppler_hz = 1000.0 * np.arange(rates.size) + rates * at_s + drift_hz
        good = np.ones(rates.size, np.bool_)
        good[lost] = at_s <= 0.5 * seconds
        courses = c.update_courses(courses, doppler_hz + 0.1 * rng.normal(size=rates.size), good, at_s)
    return courses, doppler_hz


@pytest.mark.parametrize("drift_hz_s", [0.0, 2.0])
def test_a_faded_channel_keeps_its_course_with_the_clock(drift_hz_s):
    courses, doppler_hz = build_measured([0.4, -0.3, 0.1, 0.0, -0.6], drift_hz_s, 2, 20.0, np.random.default_rng(5))
    assert np.abs(courses[:, c.DOPPLER_HZ] - doppler_hz).max() < 4.0


def test_a_channel_without_power_coasts_and_closes_its_loops():
    courses = np.full((3, c.N_COURSE), np.nan)
    courses[:2, [c.AT_S, c.DOPPLER_HZ, c.RATE_HZ_S]] = [10.0, 1500.0, 2.0]
    loops = np.zeros((3, k.N_STATE))
    loops[:, k.FREQUENCY] = 77.0
    received = np.array([False, True, False])  # the third was never measured
    loops, courses = c.coast(loops, courses, received, 10.5, 40_000.0, NOMINAL, 0.5)
    assert np.isfinite(courses[:, c.SINCE_S]).tolist() == [True, False, False]
    assert loops[:, k.FREQUENCY].tolist() == [40_000.0 + 1501.0, 77.0, 77.0]
    assert loops[0, k.CODE_RATE] == pytest.approx(1.023e6 * (1.0 + 1501.0 / 1575.42e6), rel=1e-12)
    assert loops[:, k.SLIPPED].tolist() == [0.0, 0.0, 0.0]
    loops, courses = c.coast(loops, courses, np.ones(3, np.bool_), 12.0, 40_000.0, NOMINAL, 0.5)
    assert not np.isfinite(courses[:, c.SINCE_S]).any()
    assert loops[:, k.SLIPPED].tolist() == [1.0, 0.0, 0.0]
    assert courses[0, c.PULL_UNTIL_S] == 12.5  # after a long fade
