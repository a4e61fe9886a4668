"""A step's p-values under each benign cause hold their rates; an exchange of signals is none of them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats
from tests.detectors.continuity.test_detector import (
    LIGHT_M_S,
    NAVIGATION,
    PLACE_ECEF_M,
    WHITE,
    join_rows,
    observe_scene,
    shift_ahead,
)

from skyproof.detectors.continuity.causes import p_values_by_cause
from skyproof.detectors.continuity.series import Limits, build_series
from skyproof.detectors.continuity.steps import find_largest_steps
from skyproof.records import Cause

ROW, DRAWS = 100, 80
LIMITS = Limits()


def find_p_values(o):
    """Return the p-values of the step at `ROW` by cause."""
    series = build_series(o, NAVIGATION, PLACE_ECEF_M, LIMITS)
    (step,) = find_largest_steps([(series, np.array([ROW]))], LIMITS, alpha=1.0)
    return p_values_by_cause(series, ROW, step, LIMITS, span_s=10.0)


@cache
def clean(draw):
    return observe_scene(draw, noise=WHITE, duration_s=32.0)


def move_ranges(o, change_m):
    """Change ranges by so much, (m,), at `ROW`."""
    later = np.arange(o.gpst.size)[:, None] >= ROW
    return replace(o, pseudorange_m=o.pseudorange_m + np.where(later, change_m, 0.0))


def draw_clock_steps(rng, o):
    return move_ranges(o, np.full(len(o.signals), rng.normal(0.0, 3e-7) * LIGHT_M_S))


def draw_two_faults(rng, o):
    change_m = np.zeros(len(o.signals))
    change_m[rng.choice(change_m.size, 2, replace=False)] = rng.normal(0.0, 200.0, 2)
    return move_ranges(o, change_m)


def draw_reflections(rng, o):
    late = rng.random(len(o.signals)) < 0.6
    return move_ranges(o, np.where(late, rng.uniform(-300.0, 300.0, late.size), 0.0))


def draw_missing_samples(rng, o):
    return shift_ahead(o, ROW, float(rng.uniform(-1.0, 1.0)) * 1e-4)


@pytest.mark.parametrize(
    ("cause", "error"),
    [
        (Cause.OSCILLATOR, draw_clock_steps),
        (Cause.FAULT, draw_two_faults),
        (Cause.REFLECTIONS, draw_reflections),
        (Cause.MISSING_SAMPLES, draw_missing_samples),
    ],
)
def test_no_cause_is_rejected_more_often_than_stated(cause, error):
    rng = np.random.default_rng(11)
    p = np.array([find_p_values(error(rng, clean(draw)))[cause] for draw in range(DRAWS)])
    for rate in (0.1, 0.02):
        assert stats.binomtest(int((p < rate).sum()), DRAWS, rate, alternative="greater").pvalue > 1e-3


def test_recordings_of_two_receivers_seldom_have_one_rate():
    # Rates spread about zero; the mark is what one join in a thousand hours has by its clock.
    rng, p = np.random.default_rng(3), []
    for draw in range(30):
        rates = rng.normal(0.0, 0.5, 2)
        first, second = (
            observe_scene(draw, noise=WHITE, duration_s=32.0, lo_ppm=float(rate), place=(60.0 * k, 0.0))
            for k, rate in enumerate(rates)
        )
        p.append(find_p_values(join_rows(first, second, ROW))[Cause.JOINED])
    most = 1e-3 * 10.0 / 3600.0
    for rate in (0.5, 0.1):
        assert stats.binomtest(int((np.array(p) < rate * most).sum()), 30, rate, alternative="greater").pvalue > 1e-3


def test_another_place_by_the_same_clock_is_none_of_them():
    elsewhere = observe_scene(2, noise=WHITE, duration_s=32.0, place=(90.0, 46.0))
    p = find_p_values(join_rows(clean(1), elsewhere, ROW))
    assert max(p.values()) < 1e-7
