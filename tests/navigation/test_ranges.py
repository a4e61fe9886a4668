from dataclasses import replace

import numpy as np
import pytest
from tests.gnss import orbit_twin
from tests.navigation import sky

from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.ephemeris import MAX_AGE_S, group_delay_s
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.ranges import compute_atmosphere, correct_ranges
from skyproof.records import NavigationData, SignalId


def make_signal(sat="G05", **changes):
    return (replace(SignalId(sat), **changes),)


def test_an_epoch_label_wrong_by_a_second_moves_no_satellite():
    nav, position = sky.make_navigation(), sky.place(45.0, 5.0, 0.0)
    (sat, *_) = sky.list_visible(nav, position)
    gpst = sky.START + np.arange(5) * np.timedelta64(1, "s")
    right = sky.measure(nav, sat, gpst, position, 0.0).pseudorange_m[:, None]
    wrong_label = gpst + np.timedelta64(937_000_001, "ns")
    wrong = right + 0.937000001 * sky.C
    a = correct_ranges(make_signal(sat), gpst, right, nav)
    b = correct_ranges(make_signal(sat), wrong_label, wrong, nav)
    np.testing.assert_allclose(b.satellite_ecef_m, a.satellite_ecef_m, atol=2e-6)
    np.testing.assert_allclose(b.transmission_tow_s, a.transmission_tow_s, atol=3e-10)
    np.testing.assert_allclose(b.range_m - a.range_m, 0.937000001 * sky.C, atol=1e-6)


def test_each_epoch_takes_the_best_ephemeris_of_navigation():
    early = make_nominal_constellation(np.datetime64("2022-03-04T04:00:00", "ns"))
    late = make_nominal_constellation(np.datetime64("2022-03-04T06:00:00", "ns"))
    shifted = tuple(replace(e, af0=e.af0 + 1e-6) for e in late.ephemerides)
    nav = NavigationData(ephemerides=early.ephemerides + shifted)
    gpst = np.datetime64("2022-03-04T04:50:00", "ns") + np.arange(0, 1200, 60) * np.timedelta64(1, "s")
    pseudorange = np.full((gpst.size, 1), 2.2e7)
    ranges = correct_ranges(make_signal(), gpst, pseudorange, nav)
    for row, label in enumerate(gpst):
        alone = NavigationData(ephemerides=(nav.best("G05", label),))
        expected = correct_ranges(make_signal(), gpst[row : row + 1], pseudorange[:1], alone)
        np.testing.assert_array_equal(ranges.range_m[row], expected.range_m[0])
    assert np.ptp(ranges.range_m) > 250.0  # the change of ephemeris, here of 1 us, has taken place


@pytest.mark.shared_data
def test_ranges_of_all_systems_equal_those_of_the_numpy_twin(shared_data):
    nav = read_nav(shared_data / "real" / "rinex-mosaic-1m" / "base.nav")
    gpst = np.datetime64("2024-06-24T07:40:00", "ns") + np.arange(0, 5400, 300) * np.timedelta64(1, "s")
    signals = tuple(SignalId(*name) for name in (("G05", "L1", "C"), ("E04", "E5a", "Q"), ("C01", "B3", "I"),
                                                 ("C30", "B1C", "P"), ("J03", "L5", "Q"), ("R11", "G2", "C"),
                                                 ("R12", "G1", "C"), ("G99", "L1", "C")))  # fmt: skip
    pseudorange = 2.2e7 + 1e5 * np.arange(gpst.size * len(signals)).reshape(gpst.size, len(signals))
    pseudorange[3, :4] = np.nan
    ours = correct_ranges(signals, gpst, pseudorange, nav, with_unknown_delay=True)
    week, tow_s = week_and_tow(gpst)
    cells = 0
    for row, column in np.ndindex(pseudorange.shape):
        signal, range_m = signals[column], pseudorange[row, column]
        healthy = [e for e in nav.ephemerides if e.sat == signal.sat and e.healthy]
        known = [e for e in healthy if np.isfinite(group_delay_s(e, signal.band, signal.code))] or healthy
        age_s = [abs((gpst[row] - e.reference_gpst) / np.timedelta64(1, "s")) for e in known]
        if not np.isfinite(range_m) or min(age_s, default=np.inf) > MAX_AGE_S[signal.sat[0]]:
            assert np.isnan(ours.range_m[row, column])
            assert np.isnan(ours.satellite_ecef_m[row, column]).all()
            continue
        eph = known[int(np.argmin(age_s))]
        sent_s = tow_s[row] - range_m / sky.C
        sent_s -= orbit_twin.clock_polynomial_s(eph, week[row], sent_s)
        state = orbit_twin.satellite_state_s(eph, week[row], sent_s)
        delay_s = group_delay_s(eph, signal.band, signal.code)
        assert ours.delay_unknown[row, column] == np.isnan(delay_s)
        expected_m = range_m + sky.C * (state.clock_s - np.nan_to_num(delay_s))
        np.testing.assert_allclose(ours.range_m[row, column], expected_m, rtol=0, atol=2e-8)
        np.testing.assert_allclose(ours.satellite_ecef_m[row, column], state.position_ecef_m, rtol=0, atol=5e-7)
        np.testing.assert_allclose(ours.satellite_velocity_ecef_m_s[row, column], state.velocity_ecef_m_s, atol=1e-9)
        np.testing.assert_allclose(ours.satellite_drift[row, column], state.clock_drift, rtol=1e-12)
        cells += 1
    assert cells > 100  # of each system some


def test_copies_share_an_ephemeris_and_keep_their_columns():
    nav = sky.make_navigation()
    signals = (SignalId("G07"), SignalId("G05"), SignalId("G07", copy="b"))
    pseudorange = np.array([[2.2e7, 2.3e7, 2.2e7], [2.2e7, 2.3e7, np.nan]])
    ranges = correct_ranges(signals, sky.START + np.arange(2) * np.timedelta64(1, "s"), pseudorange, nav)
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
    nav = sky.make_navigation()
    nav = replace(nav, ephemerides=tuple(replace(e, **change) for e in nav.ephemerides if e.sat == "G05"))
    ranges = correct_ranges((signal,), np.array([sky.START]), np.array([[2.2e7]]), nav)
    assert np.isnan(ranges.range_m).all()
    assert np.isnan(ranges.satellite_ecef_m).all()


def test_the_atmosphere_is_that_of_the_models():
    nav, position = sky.make_navigation(), sky.place(45.0, 5.0, 300.0)
    lat, lon = np.radians(45.0), np.radians(5.0)
    satellite = np.stack([sky.move_place(position, 1e7 * x, 5e6, 2e7) for x in (-1.0, 0.3, 4.0)])
    az, el = compute_azimuth_elevation(position, satellite)
    delays = compute_atmosphere(position, satellite, np.float64(43200.0), nav.ionosphere, ionosphere_share=0.5)
    ionosphere = sky.C * compute_klobuchar_s(nav.ionosphere, lat, lon, az, el, 43200.0)
    np.testing.assert_allclose(delays.elevation_rad, el, atol=1e-12)
    np.testing.assert_allclose(delays.delay_m, ionosphere + compute_troposphere_m(lat, 300.0, el), atol=1e-7)
    np.testing.assert_allclose(delays.sigma_m, 0.5 * ionosphere, atol=1e-9)


def test_without_parameters_the_ionosphere_is_all_uncertain():
    position = sky.place(45.0, 5.0, 0.0)
    delays = compute_atmosphere(position, sky.move_place(position, 0.0, 0.0, 2e7)[None], np.float64(0.0), None)
    np.testing.assert_allclose(delays.sigma_m, 3.0, atol=0.02)
    np.testing.assert_allclose(delays.delay_m - delays.sigma_m, compute_troposphere_m(np.radians(45.0), 0.0, np.pi / 2))


def test_the_ionosphere_goes_with_the_inverse_square_of_carrier():
    nav, position = sky.make_navigation(), sky.place(45.0, 5.0, 300.0)
    satellite = np.stack([sky.move_place(position, x, 0.0, 2e7) for x in (0.0, 1e7)])
    delays = compute_atmosphere(position, satellite, np.float64(43200.0), nav.ionosphere)
    carrier_hz = np.array([1575.42e6, 1575.42e6 / 2.0])
    two = compute_atmosphere(position, satellite, np.float64(43200.0), nav.ionosphere, carrier_hz=carrier_hz)
    np.testing.assert_allclose(two.ionosphere_m / delays.ionosphere_m, [1.0, 4.0])
    np.testing.assert_allclose(two.sigma_m / delays.sigma_m, [1.0, 4.0])
    np.testing.assert_allclose(two.delay_m - delays.delay_m, [0.0, 3.0 * delays.ionosphere_m[1]], atol=1e-9)


def test_strange_places_have_finite_delays():
    nav = sky.make_navigation()
    satellite = np.array([[2.6e7, 0.0, 0.0], [-2.6e7, 1e6, 0.0]])  # overhead and under the feet
    for height_m in (-2e4, 2e5, 1e6, 3e7):
        delays = compute_atmosphere(sky.place(1.0, 0.0, height_m), satellite, np.float64(0.0), nav.ionosphere)
        assert np.isfinite(delays.delay_m).all()
        assert (delays.delay_m < 200.0).all()
