from dataclasses import replace

import numpy as np
import pytest
from tests.navigation import sky

from skyproof.gnss.atmosphere import klobuchar_delay_s, troposphere_delay_m
from skyproof.gnss.nominal import nominal_constellation
from skyproof.gnss.sky import azimuth_elevation
from skyproof.navigation.ranges import atmosphere, corrected_ranges
from skyproof.records import NavigationData, SignalId


def one_signal(sat="G05", **changes):
    return (replace(SignalId(sat), **changes),)


def test_an_epoch_label_wrong_by_a_second_moves_no_satellite():
    nav, position = sky.navigation(), sky.place(45.0, 5.0, 0.0)
    (sat, *_) = sky.visible(nav, position)
    gpst = sky.START + np.arange(5) * np.timedelta64(1, "s")
    right = sky.measured(nav, sat, gpst, position, 0.0).pseudorange_m[:, None]
    wrong_label = gpst + np.timedelta64(937_000_001, "ns")
    wrong = right + 0.937000001 * sky.C
    a = corrected_ranges(one_signal(sat), gpst, right, nav)
    b = corrected_ranges(one_signal(sat), wrong_label, wrong, nav)
    np.testing.assert_allclose(b.satellite_ecef_m, a.satellite_ecef_m, atol=2e-6)
    np.testing.assert_allclose(b.transmission_tow_s, a.transmission_tow_s, atol=3e-10)
    np.testing.assert_allclose(b.range_m - a.range_m, 0.937000001 * sky.C, atol=1e-6)


def test_each_epoch_takes_the_ephemeris_that_navigation_calls_best():
    early = nominal_constellation(np.datetime64("2022-03-04T04:00:00", "ns"))
    late = nominal_constellation(np.datetime64("2022-03-04T06:00:00", "ns"))
    shifted = tuple(replace(e, af0=e.af0 + 1e-6) for e in late.ephemerides)
    nav = NavigationData(ephemerides=early.ephemerides + shifted)
    gpst = np.datetime64("2022-03-04T04:50:00", "ns") + np.arange(0, 1200, 60) * np.timedelta64(1, "s")
    pseudorange = np.full((gpst.size, 1), 2.2e7)
    ranges = corrected_ranges(one_signal(), gpst, pseudorange, nav)
    for row, label in enumerate(gpst):
        alone = NavigationData(ephemerides=(nav.best("G05", label),))
        expected = corrected_ranges(one_signal(), gpst[row : row + 1], pseudorange[:1], alone)
        np.testing.assert_array_equal(ranges.range_m[row], expected.range_m[0])
    assert np.ptp(ranges.range_m) > 250.0  # the change of ephemeris, here of 1 us, has taken place


def test_copies_of_one_satellite_share_its_ephemeris_and_columns_keep_their_places():
    nav = sky.navigation()
    signals = (SignalId("G07"), SignalId("G05"), SignalId("G07", copy="b"))
    pseudorange = np.array([[2.2e7, 2.3e7, 2.2e7], [2.2e7, 2.3e7, np.nan]])
    ranges = corrected_ranges(signals, sky.START + np.arange(2) * np.timedelta64(1, "s"), pseudorange, nav)
    np.testing.assert_array_equal(ranges.range_m[0, 0], ranges.range_m[0, 2])
    np.testing.assert_array_equal(ranges.satellite_ecef_m[0, 0], ranges.satellite_ecef_m[0, 2])
    assert np.isnan(ranges.range_m[1, 2])
    assert np.isnan(ranges.satellite_ecef_m[1, 2]).all()
    assert np.isfinite(ranges.range_m[1, :2]).all()


@pytest.mark.parametrize(
    ("signal", "change"),
    [
        (SignalId("G05", band="L5", code="I"), {}),
        (SignalId("G05"), {"health": 1}),
        (SignalId("G05"), {"toe": 0.0}),
        (SignalId("G31"), {}),
    ],
    ids=["no L1 C/A", "unhealthy", "too old", "no ephemeris"],
)
def test_what_cannot_be_placed_is_nan(signal, change):
    nav = sky.navigation()
    nav = replace(nav, ephemerides=tuple(replace(e, **change) for e in nav.ephemerides if e.sat == "G05"))
    ranges = corrected_ranges((signal,), np.array([sky.START]), np.array([[2.2e7]]), nav)
    assert np.isnan(ranges.range_m).all()
    assert np.isnan(ranges.satellite_ecef_m).all()


def test_the_atmosphere_is_that_of_the_models():
    nav, position = sky.navigation(), sky.place(45.0, 5.0, 300.0)
    lat, lon = np.radians(45.0), np.radians(5.0)
    satellite = np.stack([sky.moved(position, 1e7 * x, 5e6, 2e7) for x in (-1.0, 0.3, 4.0)])
    az, el = azimuth_elevation(position, satellite)
    delays = atmosphere(position, satellite, np.float64(43200.0), nav.ionosphere, ionosphere_share=0.5)
    ionosphere = sky.C * klobuchar_delay_s(nav.ionosphere, lat, lon, az, el, 43200.0)
    np.testing.assert_allclose(delays.elevation_rad, el, atol=1e-12)
    np.testing.assert_allclose(delays.delay_m, ionosphere + troposphere_delay_m(lat, 300.0, el), atol=1e-7)
    np.testing.assert_allclose(delays.sigma_m, 0.5 * ionosphere, atol=1e-9)


def test_without_parameters_the_ionosphere_is_uncertain_by_as_much_as_is_taken():
    position = sky.place(45.0, 5.0, 0.0)
    delays = atmosphere(position, sky.moved(position, 0.0, 0.0, 2e7)[None], np.float64(0.0), None)
    np.testing.assert_allclose(delays.sigma_m, 3.0, atol=0.02)
    np.testing.assert_allclose(delays.delay_m - delays.sigma_m, troposphere_delay_m(np.radians(45.0), 0.0, np.pi / 2))


def test_the_ionosphere_goes_with_the_inverse_square_of_the_carrier():
    nav, position = sky.navigation(), sky.place(45.0, 5.0, 300.0)
    satellite = np.stack([sky.moved(position, x, 0.0, 2e7) for x in (0.0, 1e7)])
    one = atmosphere(position, satellite, np.float64(43200.0), nav.ionosphere)
    carrier_hz = np.array([1575.42e6, 1575.42e6 / 2.0])
    two = atmosphere(position, satellite, np.float64(43200.0), nav.ionosphere, carrier_hz=carrier_hz)
    np.testing.assert_allclose(two.ionosphere_m / one.ionosphere_m, [1.0, 4.0])
    np.testing.assert_allclose(two.sigma_m / one.sigma_m, [1.0, 4.0])
    np.testing.assert_allclose(two.delay_m - one.delay_m, [0.0, 3.0 * one.ionosphere_m[1]], atol=1e-9)


def test_strange_places_have_finite_delays():
    nav = sky.navigation()
    satellite = np.array([[2.6e7, 0.0, 0.0], [-2.6e7, 1e6, 0.0]])  # overhead and under the feet
    for height_m in (-2e4, 2e5, 1e6, 3e7):
        delays = atmosphere(sky.place(1.0, 0.0, height_m), satellite, np.float64(0.0), nav.ionosphere)
        assert np.isfinite(delays.delay_m).all()
        assert (delays.delay_m < 200.0).all()
