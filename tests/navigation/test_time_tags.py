"""Labels that are not the time at which the ranges of their epoch were measured."""

from dataclasses import replace

import numpy as np
import pytest
from tests.navigation import sky

from skyproof.navigation.time_tags import TagErrors, estimate_tag_errors

EPOCHS = 20


def measure(*, noise_m=1.0, bias_s=2e-4, first=None):
    """Measure as a receiver to which some satellites may show another place (m to the east)."""
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0)
    sats = sky.list_visible(nav, position)
    skies = [(sats, position, bias_s)]
    if first is not None:
        other = sky.move_place(position, first, 0.0, 0.0)
        skies = [(sats[::2], other, bias_s), (sats[1::2], position, bias_s)]
    return sky.make_scene(nav, skies, n=EPOCHS, noise_m=noise_m, constant_m=0.3).observations, nav


def label(o, late_s):
    return replace(o, gpst=o.gpst + np.rint(np.broadcast_to(late_s, o.gpst.shape) * 1e9).astype("timedelta64[ns]"))


@pytest.mark.parametrize("late_s", [0.05, -0.4, 1.0, 18.0, -18.0, 60.0])
def test_labels_that_are_all_late_show_by_how_much(late_s):
    o, nav = measure()
    found = estimate_tag_errors(label(o, late_s), nav)
    assert found.known.all()
    assert not found.stray.any()
    assert found.offset_s == pytest.approx(late_s, abs=0.01)
    np.testing.assert_allclose(found.error_s, late_s, atol=6.0 * found.sigma_s.max())


@pytest.mark.parametrize("late_s", [-18.0, 60.0])
def test_whole_seconds_are_taken_as_such(late_s):
    o, nav = measure()
    assert estimate_tag_errors(label(o, late_s), nav).offset_s == late_s


def test_labels_that_stray_are_told_from_the_rest():
    o, nav = measure()
    late_s = np.zeros(EPOCHS)
    late_s[[3, 7, 8, 15]] = [0.3, -0.2, 0.06, -0.38]
    found = estimate_tag_errors(label(o, late_s), nav)
    np.testing.assert_array_equal(np.flatnonzero(found.stray), [3, 7, 8, 15])
    assert found.offset_s == 0.0
    np.testing.assert_allclose(found.error_s, late_s, atol=0.02)


@pytest.mark.parametrize("bias_s", [0.0, 7e-4, 0.93])
def test_a_clock_that_is_off_is_no_wrong_label(bias_s):
    # It stands in the ranges as well.
    o, nav = measure(bias_s=bias_s)
    found = estimate_tag_errors(o, nav)
    assert found.known.all()
    assert not found.error_s.any()


def test_noise_beyond_its_sigma_makes_no_label_wrong():
    o, nav = measure(noise_m=15.0)
    understated = replace(o, pseudorange_sigma_m=np.full_like(o.pseudorange_sigma_m, 1.0))
    assert not estimate_tag_errors(understated, nav).error_s.any()


def test_two_skies_make_no_label_wrong():
    o, nav = measure(first=400.0)
    assert not estimate_tag_errors(o, nav).error_s.any()


def test_without_orbits_nothing_is_known():
    o, nav = measure()
    found = estimate_tag_errors(o, replace(nav, ephemerides=()))
    assert not found.known.any()
    assert found.offset_s == 0.0
    assert not found.stray.any()


def test_stretches_are_judged_as_the_whole():
    o, nav = measure()
    late = label(o, -18.0)
    parts = [estimate_tag_errors(late.read(0, 7), nav), estimate_tag_errors(late.read(7, EPOCHS), nav)]
    joined = TagErrors.join(parts)
    np.testing.assert_allclose(joined.error_s, estimate_tag_errors(late, nav).error_s, atol=1e-9)
