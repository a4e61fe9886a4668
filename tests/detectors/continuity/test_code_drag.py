"""Codes that show a motion which carriers do not show: an attack, unless reflections, clocks or a cut explain it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from tests.detectors.continuity.test_detector import (
    FIELD,
    MOTIONS,
    NAVIGATION,
    PLACE_ECEF_M,
    WHITE,
    change_cells,
    examine_all,
    join_rows,
    observe_scene,
)

from skyproof.detectors.continuity.code_drag import find_code_drags
from skyproof.detectors.continuity.series import Limits, build_series

ONSET_S = 25.0
CODES = ("one_motion", "dragged", "dragged_by_some")


def select_attacks(found):
    return [[e for e in evidence if e.says == "attack"] for evidence in found]


def move_codes(o, moved_m):
    return change_cells(o, pseudorange_m=o.pseudorange_m + moved_m)


def drag_codes(o, speed_m_s):
    """Drag codes to the east from the onset on, and leave carriers."""
    unit = build_series(o, NAVIGATION, PLACE_ECEF_M, Limits()).unit
    east = np.array([0.05, 0.999, 0.0])
    return move_codes(o, -(unit @ east) * speed_m_s * np.maximum(o.elapsed_s - ONSET_S, 0.0)[:, None])


@pytest.mark.parametrize("motion", ["standing", "car at 2 g"])
def test_codes_dragged_to_another_place_are_found_in_two_windows(motion):
    found = examine_all(drag_codes(observe_scene(motion=motion, duration_s=52.0), 2.5))
    words = select_attacks(found)
    assert not any(words[:2])
    assert any(words[2:4])
    (first, *_) = (e for evidence in words for e in evidence)
    assert (first.code, first.data["assumes"]) == ("dragged", ())


def test_codes_that_part_as_a_clock_does_are_no_such_attack():
    o = observe_scene()
    late_m = np.broadcast_to(3.0 * np.maximum(o.elapsed_s - ONSET_S, 0.0)[:, None], o.pseudorange_m.shape)
    assert not any(select_attacks(examine_all(move_codes(o, late_m))))


@pytest.mark.parametrize("satellites", [1, 2])
def test_reflections_of_two_satellites_are_no_attack(satellites):
    o = observe_scene()
    late_m = np.zeros(o.pseudorange_m.shape)
    late_m[:, :satellites] = 4.0 * np.maximum(o.elapsed_s - ONSET_S, 0.0)[:, None]
    assert not any(select_attacks(examine_all(move_codes(o, late_m))))


@pytest.mark.parametrize("row", [62, 70, 75, 85, 110])
def test_recordings_that_are_joined_unseen_are_no_attack(row):
    # Codes step by 61 m, and loops that have seen nothing go on.
    other = observe_scene(2, noise=WHITE, place=(40.0, 46.0), lo_ppm=0.8)
    found = examine_all(join_rows(observe_scene(1, noise=WHITE), other, row, slip=False))
    assert not any(select_attacks(found))
    assert any(e.failed for evidence in found for e in evidence)


def test_after_a_step_long_before_codes_that_move_are_no_attack():
    # Reflections that make a step are larger than stated: some in a row are a motion.
    o = drag_codes(observe_scene(duration_s=52.0), 2.5)
    east = build_series(o, NAVIGATION, PLACE_ECEF_M, Limits()).unit @ np.array([0.05, 0.999, 0.0])
    found = examine_all(move_codes(o, -60.0 * east * (o.elapsed_s > 4.0)[:, None]))
    assert not any(e.code == "dragged" for evidence in found for e in evidence)
    assert any(e.failed for evidence in found[2:] for e in evidence)


def test_two_steps_are_no_motion_even_without_a_step_search():
    o = observe_scene()
    o = o.select(o.elapsed_s <= o.elapsed_s[0] + 10.01)
    series = build_series(o, NAVIGATION, PLACE_ECEF_M, Limits())
    since_s = o.elapsed_s - o.elapsed_s[0]
    east = series.unit @ np.array([0.05, 0.999, 0.0])
    for stepped, moved_m in ((True, 30.0 * (since_s > 2.0) + 30.0 * (since_s > 8.0)), (False, 6.0 * since_s)):
        drawn = replace(series, offset_m=series.offset_m - moved_m[:, None] * east)
        motion = find_code_drags([(o, drawn)], multipath_sigma_m=1.0, alpha=1e-4)[0]
        assert motion is not None
        assert motion.p_value < 1e-6
        assert motion.whole_sky_p_value == 1.0 if stepped else motion.whole_sky_p_value < 1e-6


def test_p_values_are_uniform_under_the_stated_multipath():
    # Of a single span: reflections of the first quarter have nothing to do with those of the last.
    o = observe_scene(noise=WHITE)
    o = o.select(o.elapsed_s <= o.elapsed_s[0] + 10.01)
    series, rng, found = build_series(o, NAVIGATION, PLACE_ECEF_M, Limits()), np.random.default_rng(5), []
    half = (np.arange(o.gpst.size) < o.gpst.size // 2)[:, None]
    exact = replace(series, variance_m2=np.full_like(series.variance_m2, 1e-6))
    for _ in range(400):
        before_m, after_m = rng.normal(0.0, 1.0, (2, series.unit.shape[1]))
        span = replace(exact, offset_m=np.where(half, before_m, after_m))
        motion = find_code_drags([(o, span)], multipath_sigma_m=1.0, alpha=0.0)[0]
        assert motion is not None
        found.append(motion.p_value)
    chances = np.array(found)
    # The ionosphere's share of a few per cent makes it larger than uniform by as much.
    assert stats.kstest(chances, "uniform").pvalue > 1e-3
    assert stats.binomtest(int((chances < 0.1).sum()), 400, 0.1).pvalue > 1e-3


@pytest.mark.long
@pytest.mark.parametrize("motion", MOTIONS)
def test_hours_under_the_errors_of_the_model_raise_no_alarm(motion):
    windows, alarms, low, least = 0, 0, 0, 1.0
    for seed in range(3):
        for draw in range(10):
            for evidence in examine_all(observe_scene(draw, noise=FIELD, seed=seed, motion=motion, duration_s=242.0)):
                of_drag = [e for e in evidence if e.code in CODES]
                windows += 1
                alarms += any(e.says != "clean" for e in of_drag)
                low += any(e.p_value < 0.1 for e in of_drag)
                least = min([least, *(e.p_value for e in of_drag)])
    print(f"{motion}: {windows} windows, {alarms} alarms at 2e-7, p below 0.1 in {low}, least {least:.2g}")
    assert alarms == 0
    assert stats.binomtest(low, windows, 0.1, alternative="greater").pvalue > 1e-3
