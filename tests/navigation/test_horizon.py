"""Satellites above the horizon against elevations worked out one by one."""

import numpy as np
import pytest

from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.signals import GPS_SATS
from skyproof.gnss.sky import compute_azimuth_elevation
from skyproof.navigation.horizon import MARGIN_DEG, list_sats_above

START = np.datetime64("2024-05-14T10:00:00", "ns")


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(57.7, 11.9), (-33.0, 151.0), (89.9, 0.0)])
def test_those_that_rise_in_the_recording_are_in_no_others(lat_deg: float, lon_deg: float) -> None:
    navigation = make_nominal_constellation(START)
    end = START + np.timedelta64(1, "h")
    above = list_sats_above(navigation, GPS_SATS, np.radians(lat_deg), np.radians(lon_deg), START, end)
    place_ecef_m = ecef_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), 0.0)
    for sat in GPS_SATS:
        ephemeris = navigation.best(sat, START)
        if ephemeris is None:
            assert sat not in above
            continue
        minutes = [START + np.timedelta64(60 * k, "s") for k in range(61)]
        places = np.stack([compute_satellite_state(ephemeris, at).position_ecef_m for at in minutes])
        highest_deg = np.degrees(compute_azimuth_elevation(place_ecef_m, places)[1].max())
        if abs(highest_deg + MARGIN_DEG) > 1.5:  # between the steps
            assert (sat in above) == (highest_deg > -MARGIN_DEG)
    assert 8 <= len(above) < len(GPS_SATS)


def test_a_file_without_orbits_of_that_day_gives_none() -> None:
    navigation = make_nominal_constellation(START)
    later = START + np.timedelta64(10, "D")
    assert list_sats_above(navigation, GPS_SATS, 1.0, 0.2, later, later) == ()
