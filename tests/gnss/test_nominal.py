import numpy as np
import pytest

from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.lnav import quantise
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbit_faults import find_orbit_fault
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.gnss.time import gpst as instant
from skyproof.gnss.time import leap_seconds, parse_iso, seconds_between

DATES = ("1980-01-06", "1994-03-03T03:03:03", "2022-01-01T21:45:58", "2026-07-04T12:00:00", "2045-11-11T11:11:11.5")


@pytest.mark.parametrize("date", DATES)
def test_six_satellites_stand_above_ten_degrees_always(date):
    lat_rad, lon_rad = np.radians(np.arange(-90.0, 91.0, 10.0))[:, None], np.radians(np.arange(-180.0, 180.0, 15.0))
    rx_m = ecef_from_geodetic(lat_rad, lon_rad, 0.0)[:, :, None, None, :]
    times = parse_iso(date) + np.arange(0, 86400, 3600) * np.timedelta64(1, "s")
    counts = []
    for hour in times:
        ephemerides = make_nominal_constellation(hour).ephemerides
        sat_m = np.array([compute_satellite_state(e, hour).position_ecef_m for e in ephemerides])[:, None, :]
        _, el_rad = compute_azimuth_elevation(rx_m, sat_m)
        counts.append((el_rad > np.radians(10.0)).sum(axis=(-2, -1)))
    assert np.min(counts) >= 6


@pytest.mark.parametrize("date", DATES)
def test_any_date_has_a_valid_set(date):
    t = parse_iso(date)
    navigation = make_nominal_constellation(t)
    sats = [e.sat for e in navigation.ephemerides]
    assert sats == [f"G{prn:02d}" for prn in range(1, 32)]
    for eph in navigation.ephemerides:
        assert abs(seconds_between(t, instant(eph.week, eph.toe))) <= 3600.0
        assert 0.0 <= eph.toe < 604800.0
        assert find_orbit_fault(eph) is None
        assert eph.iodc % 256 == eph.iode
        state = compute_satellite_state(eph, t)
        assert abs(np.linalg.norm(state.position_ecef_m) - 26.56e6) < 0.4e6
        assert abs(state.clock_s) < 1e-3
    assert navigation.best("G17", t) is navigation.ephemerides[16]
    assert navigation.ionosphere is not None
    assert navigation.utc is not None
    assert navigation.utc.leap_seconds == leap_seconds(t)


def test_a_call_always_gives_the_same_set_that_fits_the_message():
    t = parse_iso("2022-01-01T21:45:58")
    ephemerides = make_nominal_constellation(t).ephemerides
    assert repr(ephemerides) == repr(make_nominal_constellation(t + np.timedelta64(10, "m")).ephemerides)
    assert repr(ephemerides) == repr(tuple(quantise(e) for e in ephemerides))


def test_neighbouring_sets_lie_on_one_orbit():
    t = parse_iso("2022-01-01T23:00:00")  # half way between two times of ephemeris, across the end of a week
    before = make_nominal_constellation(t - np.timedelta64(1, "s")).ephemerides
    after = make_nominal_constellation(t + np.timedelta64(1, "s")).ephemerides
    for old, new in zip(before, after, strict=True):
        assert (old.week, new.week) == (2190, 2191)
        gap_m = compute_satellite_state(old, t).position_ecef_m - compute_satellite_state(new, t).position_ecef_m
        assert np.linalg.norm(gap_m) < 0.5  # steps of the message


def test_ground_tracks_repeat():
    t = parse_iso("2022-01-01T12:00:00")
    # The Earth turns below the node in 86154.8 s: sidereal day 86164.1 s, node going back by 4.4874e-7 deg/s.
    turn_s = 2.0 * np.pi / (7.2921151467e-5 + 7.8320e-9)
    later = t + np.timedelta64(round(turn_s * 1000 * 1e9), "ns")
    for old, new in zip(
        make_nominal_constellation(t).ephemerides, make_nominal_constellation(later).ephemerides, strict=True
    ):
        gap_m = compute_satellite_state(old, t).position_ecef_m - compute_satellite_state(new, later).position_ecef_m
        assert np.linalg.norm(gap_m) < 1.0


def test_every_plane_of_the_standard_is_there():
    # GPS SPS Performance Standard 2020, section 3.2: six planes 60 degrees apart, inclined by 55 degrees.
    ephemerides = make_nominal_constellation(parse_iso("2022-01-01")).ephemerides
    nodes_deg = np.degrees([e.omega0 for e in ephemerides])
    steps = (nodes_deg - nodes_deg[0]) / 60.0
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-5)
    assert len(set(np.rint(steps).astype(int) % 6)) == 6
    np.testing.assert_allclose([e.i0 for e in ephemerides], np.radians(55.0), atol=1e-8)
