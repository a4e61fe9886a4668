from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats
from tests.navigation import sky

from skyproof.navigation.window import average_window


def list_seen(position=None, **settings):
    nav, position = sky.make_navigation(), sky.place(59.0, 17.0, 100.0) if position is None else position
    return sky.make_scene(
        nav, [(sky.list_visible(nav, sky.place(59.0, 17.0, 100.0)), position, 1e-3)], **settings
    ).observations


def test_a_window_without_noise_gives_the_middle_epoch():
    velocity = np.array([30.0, -250.0, 10.0])
    path = sky.place(59.0, 17.0, 100.0) + np.arange(15)[:, None] * velocity
    seen = list_seen(path, n=15)
    mean = average_window(seen)
    assert mean.gpst == seen.gpst[7]
    # Code and carrier part by twice the ionosphere's change, which is even about the middle to first order.
    np.testing.assert_allclose(mean.pseudorange_m, seen.pseudorange_m[7], atol=2e-3)


def test_the_noise_averages_as_the_sigma_says():
    clean, rng = list_seen(n=16), np.random.default_rng(1)
    sigma = rng.uniform(1.0, 6.0, clean.pseudorange_m.shape)
    squares, channels = 0.0, len(clean.signals)
    truth = average_window(clean).pseudorange_m
    for _ in range(200):
        noisy = clean.pseudorange_m + sigma * rng.standard_normal(sigma.shape)
        mean = average_window(replace(clean, pseudorange_m=noisy, pseudorange_sigma_m=sigma))
        squares += np.sum(((mean.pseudorange_m - truth) / mean.sigma_m) ** 2)
    np.testing.assert_allclose(mean.sigma_m, 1.0 / np.sqrt(np.sum(sigma**-2, axis=0)))
    assert 1e-3 < stats.chi2(200 * channels).cdf(squares) < 1 - 1e-3


def test_a_slip_is_bridged_by_doppler_at_its_noise():
    seen = list_seen(n=11, air=False)
    carrier, status = seen.carrier_cyc.copy(), seen.status.copy()
    carrier[8:, 0] += 12345.5
    status[8, 0] = 3
    mean, whole = average_window(replace(seen, carrier_cyc=carrier, status=status)), average_window(seen)
    np.testing.assert_allclose(mean.pseudorange_m, whole.pseudorange_m, atol=0.02)
    bridge = sky.WAVELENGTH * 0.1 / np.sqrt(2.0)
    np.testing.assert_allclose(mean.sigma_m[0], np.hypot(whole.sigma_m[0], bridge), rtol=1e-6)
    np.testing.assert_array_equal(mean.sigma_m[1:], whole.sigma_m[1:])


def test_a_carrier_faster_than_anything_is_no_motion():
    seen = list_seen(n=11, air=False)
    carrier = seen.carrier_cyc.copy()
    carrier[8:, 0] += 2.5e8  # a cell that is misread, or a receiver that marks no slip
    mean, whole = average_window(replace(seen, carrier_cyc=carrier)), average_window(seen)
    np.testing.assert_allclose(mean.pseudorange_m, whole.pseudorange_m, atol=0.02)


def test_a_doppler_held_for_minutes_is_as_good_as_its_change():
    # A signal at one epoch a minute that is lost before the middle.
    seen = list_seen(n=15, step_s=60.0, air=False)
    codes, carrier, doppler = (getattr(seen, name).copy() for name in ("pseudorange_m", "carrier_cyc", "doppler_hz"))
    codes[8:, 0], carrier[6:, 0], doppler[6:, 0] = np.nan, np.nan, np.nan
    mean = average_window(replace(seen, pseudorange_m=codes, carrier_cyc=carrier, doppler_hz=doppler))
    whole = average_window(seen)
    off_m = np.abs(mean.pseudorange_m[0] - whole.pseudorange_m[0])
    assert off_m > 5.0
    assert off_m < 3.0 * mean.sigma_m[0]
    np.testing.assert_array_equal(mean.sigma_m[1:], whole.sigma_m[1:])


def test_channels_without_carrier_or_doppler_are_bridged():
    seen = list_seen(n=11, air=False)
    carrier, doppler = seen.carrier_cyc.copy(), seen.doppler_hz.copy()
    carrier[:, :2], doppler[:, 1] = np.nan, np.nan
    mean = average_window(replace(seen, carrier_cyc=carrier, doppler_hz=doppler))
    np.testing.assert_allclose(mean.pseudorange_m[0], seen.pseudorange_m[5, 0], atol=0.05)
    np.testing.assert_allclose(mean.pseudorange_m[1], seen.pseudorange_m[5, 1], atol=1e-6)
    np.testing.assert_allclose(mean.sigma_m[1], seen.pseudorange_sigma_m[5, 1])


def test_tracks_of_less_than_half_of_the_window_are_left_out():
    seen = list_seen(n=10)
    pseudorange = seen.pseudorange_m.copy()
    pseudorange[4:, 0] = np.nan
    pseudorange[5:, 1] = np.nan
    pseudorange[:, 2] = np.nan
    seen = replace(seen, pseudorange_m=pseudorange)
    assert average_window(seen).signals == (seen.signals[1], *seen.signals[3:])
    assert average_window(seen, min_share=0.0).signals == (*seen.signals[:2], *seen.signals[3:])
    np.testing.assert_allclose(average_window(seen).pseudorange_m[0], list_seen(n=10).pseudorange_m[5, 1], atol=0.1)


def test_one_epoch_is_a_window():
    seen = list_seen(n=1)
    np.testing.assert_array_equal(average_window(seen).pseudorange_m, seen.pseudorange_m[0])
    arrays = {f.name: getattr(seen, f.name) for f in fields(seen) if np.ndim(getattr(seen, f.name))}
    per_epoch = {name: array[:0] for name, array in arrays.items() if len(array) == 1}
    with pytest.raises(ValueError, match="no epoch"):
        average_window(replace(seen, **per_epoch))
