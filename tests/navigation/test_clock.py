from dataclasses import replace

import numpy as np
import pytest

from skyproof.navigation.clock import anchored, clock_steps, unstepped
from skyproof.navigation.fix import fix
from skyproof.navigation.ranges import corrected_ranges


@pytest.mark.parametrize("bias_s", [0.0, 0.00049, 0.00051, -0.0214, 0.93])
def test_the_clock_comes_within_half_a_millisecond_and_nothing_else_moves(sky, bias_s):
    nav, position = sky.navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.scene(nav, [(sky.visible(nav, position), position, bias_s)], n=5).observations
    moved = anchored(seen, bias_s)
    before, after = fix(seen, nav), fix(moved, nav)
    assert (np.abs(after.clock_bias_s) <= 0.0005).all()
    np.testing.assert_allclose(after.position_ecef_m, before.position_ecef_m, atol=1e-5)
    assert np.abs((after.gpst - before.gpst).astype(int)).max() <= 1  # a nanosecond of rounding
    k = round(bias_s * 1e3)
    np.testing.assert_array_equal((seen.gpst - moved.gpst).astype(int), k * 1_000_000)
    np.testing.assert_allclose(seen.pseudorange_m - moved.pseudorange_m, k * 299792.458, atol=1e-7)
    np.testing.assert_allclose(seen.carrier_cyc - moved.carrier_cyc, k * 1575420.0, atol=1e-5)


def test_times_of_transmission_stay(sky):
    nav, position = sky.navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.scene(nav, [(sky.visible(nav, position), position, -0.0437)], n=3).observations
    moved = anchored(seen, -0.0437)
    a = corrected_ranges(seen.signals, seen.gpst, seen.pseudorange_m, nav)
    b = corrected_ranges(moved.signals, moved.gpst, moved.pseudorange_m, nav)
    np.testing.assert_allclose(a.transmission_tow_s, b.transmission_tow_s, atol=3e-10)


def test_a_drifting_clock_steps_by_a_millisecond_with_code_and_carrier_together(sky):
    nav, position = sky.navigation(), sky.place(59.0, 17.0, 100.0)
    drift = 1e-4
    seen = sky.scene(nav, [(sky.visible(nav, position), position, 0.0)], n=30, drift=drift).observations
    moved = anchored(seen, drift * np.arange(30))
    found = fix(moved, nav)
    assert (np.abs(found.clock_bias_s) < 0.00051).all()
    assert np.ptp(np.diff(found.clock_bias_s)) > 0.9e-3
    level = seen.pseudorange_m - seen.carrier_cyc * sky.WAVELENGTH
    np.testing.assert_allclose(moved.pseudorange_m - moved.carrier_cyc * sky.WAVELENGTH, level, atol=1e-6)


@pytest.mark.parametrize("bias_s", [np.nan, np.zeros(3), np.array([0.0, np.nan, 0.0, 0.0, 0.0])])
def test_a_bias_that_is_no_number_or_does_not_fit_is_refused(sky, bias_s):
    nav, position = sky.navigation(), sky.place(59.0, 17.0, 100.0)
    seen = sky.scene(nav, [(sky.visible(nav, position), position, 0.0)], n=5).observations
    with pytest.raises(ValueError, match="clock_bias_s must be finite"):
        anchored(seen, bias_s)


def stepping(sky, *, step_s=1.0, carrier_too=True, dopplers=True):
    """A clock that drifts by 100 us a second, which the receiver sets by a millisecond now and then; and as it runs."""
    nav, position = sky.navigation(), sky.place(59.0, 17.0, 100.0)
    drift = 1e-4
    free = sky.scene(nav, [(sky.visible(nav, position), position, 0.0)], n=30, drift=drift, step_s=step_s).observations
    reported = anchored(free, drift * step_s * np.arange(30))
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
def test_steps_of_a_clock_are_taken_back_however_the_receiver_makes_them(
    sky, step_s, carrier_too, dopplers, stretch_epochs
):
    free, reported = stepping(sky, step_s=step_s, carrier_too=carrier_too, dopplers=dopplers)
    found = clock_steps(reported, stretch_epochs)
    steady = unstepped(reported, found)
    np.testing.assert_allclose(steady.pseudorange_m, free.pseudorange_m, atol=1e-6)
    np.testing.assert_allclose(steady.carrier_cyc, free.carrier_cyc, atol=1e-4)
    np.testing.assert_array_equal(steady.gpst, free.gpst)
    np.testing.assert_allclose(steady.elapsed_s, free.elapsed_s, atol=1e-8)
    middle = unstepped(reported.read(10, 20), found, 10)
    np.testing.assert_array_equal(middle.pseudorange_m, steady.pseudorange_m[10:20])
    assert sum(step.milliseconds for step in found.steps) == -round(1e-4 * step_s * 29 * 1e3)


def test_a_clock_that_runs_on_is_left_alone(sky):
    free, _ = stepping(sky)
    assert clock_steps(free) is None


def test_a_step_that_not_all_satellites_make_is_no_step_of_the_clock(sky):
    free, _ = stepping(sky)
    code_m = free.pseudorange_m.copy()
    code_m[15:, : code_m.shape[1] // 2 - 1] += 299792.458
    assert clock_steps(replace(free, pseudorange_m=code_m)) is None


def test_what_is_no_whole_millisecond_is_no_step_of_the_clock(sky):
    free, _ = stepping(sky)
    code_m = free.pseudorange_m.copy()
    code_m[15:] += 299792.458 + 400.0
    assert clock_steps(replace(free, pseudorange_m=code_m)) is None
