from dataclasses import replace

import numpy as np
import pytest
from tests.navigation import sky

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.navigation.clock import TimeBreaks, anchor_label, find_clock_steps, remove_clock_steps
from skyproof.navigation.fix import fix
from skyproof.navigation.ranges import correct_ranges


@pytest.mark.parametrize("bias_s", [0.0, 0.00049, 0.00051, -0.0214, 0.93])
def test_the_clock_comes_within_half_a_ms_and_nothing_moves(bias_s):
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, bias_s)], n=5).observations
    moved = anchor_label(seen, bias_s)
    before, after = fix(seen, nav), fix(moved, nav)
    assert (np.abs(after.clock_bias_s) <= 0.0005).all()
    np.testing.assert_allclose(after.position_ecef_m, before.position_ecef_m, atol=1e-5)
    assert np.abs((after.gpst - before.gpst).astype(int)).max() <= 1  # a nanosecond of rounding
    k = round(bias_s * 1e3)
    np.testing.assert_array_equal((seen.gpst - moved.gpst).astype(int), k * 1_000_000)
    np.testing.assert_allclose(seen.pseudorange_m - moved.pseudorange_m, k * 299792.458, atol=1e-7)
    np.testing.assert_allclose(seen.carrier_cyc - moved.carrier_cyc, k * 1575420.0, atol=1e-5)


def test_times_of_transmission_stay():
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, -0.0437)], n=3).observations
    moved = anchor_label(seen, -0.0437)
    a = correct_ranges(seen.signals, seen.gpst, seen.pseudorange_m, nav)
    b = correct_ranges(moved.signals, moved.gpst, moved.pseudorange_m, nav)
    np.testing.assert_allclose(a.transmission_tow_s, b.transmission_tow_s, atol=3e-10)


def test_a_drifting_clock_steps_code_and_carrier_by_one_ms():
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    drift = 1e-4
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, 0.0)], n=30, drift=drift).observations
    moved = anchor_label(seen, drift * np.arange(30))
    found = fix(moved, nav)
    assert (np.abs(found.clock_bias_s) < 0.00051).all()
    assert np.ptp(np.diff(found.clock_bias_s)) > 0.9e-3
    level = seen.pseudorange_m - seen.carrier_cyc * sky.WAVELENGTH
    np.testing.assert_allclose(moved.pseudorange_m - moved.carrier_cyc * sky.WAVELENGTH, level, atol=1e-6)


@pytest.mark.parametrize("bias_s", [np.nan, np.zeros(3), np.array([0.0, np.nan, 0.0, 0.0, 0.0])])
def test_a_bias_that_is_no_number_or_does_not_fit_is_refused(bias_s):
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.make_scene(nav, [(sky.list_visible(nav, position), position, 0.0)], n=5).observations
    with pytest.raises(ValueError, match="clock_bias_s"):
        anchor_label(seen, bias_s)


def make_stepping(*, step_s=1.0, carrier_too=True, dopplers=True):
    """Make a clock that drifts by 100 us a second and is set by a millisecond at times; and as it runs."""
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    drift = 1e-4
    free = sky.make_scene(
        nav, [(sky.list_visible(nav, position), position, 0.0)], n=30, drift=drift, step_s=step_s
    ).observations
    reported = anchor_label(free, drift * step_s * np.arange(30))
    reported = replace(reported, elapsed_s=(reported.gpst - reported.gpst[0]) / np.timedelta64(1, "ns") * 1e-9)
    if not carrier_too:
        reported = replace(reported, carrier_cyc=free.carrier_cyc)
    if not dopplers:
        reported = replace(reported, doppler_hz=np.full_like(reported.doppler_hz, np.nan))
    return free, reported


@pytest.mark.parametrize("step_s", [0.5, 1.0])
@pytest.mark.parametrize("carrier_too", [True, False])
@pytest.mark.parametrize("dopplers", [True, False])
@pytest.mark.parametrize("stretch_epochs", [1024, 7])
def test_clock_steps_are_removed_however_a_receiver_makes_them(step_s, carrier_too, dopplers, stretch_epochs):
    free, reported = make_stepping(step_s=step_s, carrier_too=carrier_too, dopplers=dopplers)
    found = find_clock_steps(reported, stretch_epochs)
    steady = remove_clock_steps(reported, found)
    np.testing.assert_allclose(steady.pseudorange_m, free.pseudorange_m, atol=1e-6)
    np.testing.assert_allclose(steady.carrier_cyc, free.carrier_cyc, atol=1e-4)
    np.testing.assert_array_equal(steady.gpst, free.gpst)
    np.testing.assert_allclose(steady.elapsed_s, free.elapsed_s, atol=1e-8)
    middle = remove_clock_steps(reported.read(10, 20), found, 10)
    np.testing.assert_array_equal(middle.pseudorange_m, steady.pseudorange_m[10:20])
    assert sum(step.milliseconds for step in found.steps) == -round(1e-4 * step_s * 29 * 1e3)


def test_a_clock_that_runs_on_is_left_alone():
    free, _ = make_stepping()
    assert find_clock_steps(free) is None


def test_a_step_of_some_satellites_is_no_clock_step():
    free, _ = make_stepping()
    code_m = free.pseudorange_m.copy()
    code_m[15:, : code_m.shape[1] // 2 - 1] += 299792.458
    assert find_clock_steps(replace(free, pseudorange_m=code_m)) is None


def test_what_is_no_whole_millisecond_is_no_step_of_the_clock():
    free, _ = make_stepping()
    code_m = free.pseudorange_m.copy()
    code_m[15:] += 299792.458 + 400.0
    assert find_clock_steps(replace(free, pseudorange_m=code_m)) is None


def drop_samples(missing_s, back):
    """Drop samples before the 15th epoch of a second each; channels come back at `back`."""
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    sats = sky.list_visible(nav, position)
    before = sky.make_scene(nav, [(sats, position, 0.0)], n=30, noise_m=3.0).observations
    missing = np.timedelta64(round(missing_s * 1e9), "ns")
    after = sky.make_scene(nav, [(sats, position, 0.0)], n=30, noise_m=3.0, start=before.gpst[0] + missing).observations
    labelled_ms = round(missing_s * 1e3)  # the label takes up whole milliseconds, ranges what is left
    range_m = after.pseudorange_m - (missing_s - 1e-3 * labelled_ms) * SPEED_OF_LIGHT_M_S
    later = np.arange(30) >= 15
    present = ~later[:, None] | (np.arange(30)[:, None] >= 15 + np.resize(back, len(sats)))
    code_m = np.where(later[:, None], range_m, before.pseudorange_m)
    return replace(
        before,
        gpst=before.gpst + np.where(later, labelled_ms, 0).astype("timedelta64[ms]"),
        pseudorange_m=np.where(present, code_m, np.nan),
    )


def time_breaks(log, stretch_epochs=1024):
    """Time the search for breaks in a log that comes in stretches."""
    breaks = TimeBreaks()
    for first in range(0, log.gpst.size, stretch_epochs):
        breaks.take(log.read(first, first + stretch_epochs))
    return breaks.gpst


@pytest.mark.parametrize("missing_s", [2e-6, 1e-3, 0.3331, 0.25])
@pytest.mark.parametrize("back", [[0], [3], [1, 2, 3, 4], [2, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4]])
@pytest.mark.parametrize("stretch_epochs", [1024, 7, 16])
def test_time_breaks_once_at_missing_samples(missing_s, back, stretch_epochs):
    observed = drop_samples(missing_s, back)
    (found,) = time_breaks(observed, stretch_epochs)
    assert found == observed.gpst[15 + min(back)]


@pytest.mark.parametrize("back", [[0], [6], [1, 2, 3, 4]])
def test_time_continues_through_blockage_and_clock_setting(back):
    assert not time_breaks(drop_samples(0.0, back)).size
    free, _ = make_stepping()
    assert not time_breaks(free).size
    assert not time_breaks(anchor_label(free, 1e-4 * np.arange(30))).size


def test_one_signal_that_leaps_is_no_break_of_time():
    observed = drop_samples(0.0, [0])
    code_m = observed.pseudorange_m.copy()
    code_m[15:, :2] += 5000.0
    assert not time_breaks(replace(observed, pseudorange_m=code_m)).size
