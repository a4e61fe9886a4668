"""Likely slips in stating where antennas stand: each undoes what was done to the truth."""

import numpy as np
import pytest

from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef
from skyproof.gnss.geoid import interpolate_geoid_m
from skyproof.gnss.slips import list_distance_slips, list_position_slips, list_vector_slips

PLACES = [
    (35.134729, 136.977577, 103.2),
    (57.7012, 11.9321, 52.0),
    (-33.8612, 151.2094, 64.0),
    (48.1715, -11.5687, 540.0),
]


def misread_minutes(value):
    """Write degrees and decimal minutes as if they were one decimal number."""
    degrees = np.floor(abs(value))
    return np.copysign(degrees + 0.6 * (abs(value) - degrees), value)


def misread_seconds(value):
    degrees = np.floor(abs(value))
    whole = np.floor(60.0 * (abs(value) - degrees))
    remaining = 3600.0 * (abs(value) - degrees) - 60.0 * whole
    return np.copysign(degrees + whole / 100.0 + remaining / 10000.0, value)


MISTAKES = {
    "height_above_sea_level": lambda lat, lon, h: (lat, lon, h - interpolate_geoid_m(lat, lon)),
    "height_in_feet": lambda lat, lon, h: (lat, lon, h / 0.3048),
    "height_in_feet_above_sea_level": lambda lat, lon, h: (lat, lon, (h - interpolate_geoid_m(lat, lon)) / 0.3048),
    "height_separation_sign": lambda lat, lon, h: (lat, lon, h - 2.0 * interpolate_geoid_m(lat, lon)),
    "longitude_sign": lambda lat, lon, h: (lat, -lon, h),
    "latitude_sign": lambda lat, lon, h: (-lat, lon, h),
    "signs": lambda lat, lon, h: (-lat, -lon, h),
    "degrees_and_minutes": lambda lat, lon, h: (misread_minutes(lat), misread_minutes(lon), h),
    "latitude_degrees_and_minutes": lambda lat, lon, h: (misread_minutes(lat), lon, h),
    "longitude_degrees_and_minutes": lambda lat, lon, h: (lat, misread_minutes(lon), h),
    "degrees_minutes_seconds": lambda lat, lon, h: (misread_seconds(lat), misread_seconds(lon), h),
    "height": lambda lat, lon, h: (lat, lon, h - 12.3),
}


@pytest.mark.parametrize("place", PLACES, ids=str)
@pytest.mark.parametrize("code", MISTAKES)
def test_each_slip_of_a_position_leads_back_to_the_truth(code, place):
    lat, lon, height_m = (float(x) for x in MISTAKES[code](*place))
    stated_m = ecef_from_geodetic(np.radians(lat), np.radians(lon), height_m)
    truth_m = ecef_from_geodetic(np.radians(place[0]), np.radians(place[1]), place[2])
    (slip,) = (item for item in list_position_slips(stated_m) if item.code == code)
    off_m = truth_m - slip.position_ecef_m
    if code == "height":
        up = off_m / np.linalg.norm(off_m)
        assert up @ slip.covariance_m2 @ up > 1e6
    else:
        assert np.linalg.norm(off_m) < 0.02


def test_exchanged_latitude_and_longitude_lead_back_to_the_truth():
    truth_m = ecef_from_geodetic(np.radians(57.7012), np.radians(11.9321), 52.0)
    stated_m = ecef_from_geodetic(np.radians(11.9321), np.radians(57.7012), 52.0)
    (slip,) = (item for item in list_position_slips(stated_m) if item.code == "latitude_and_longitude_swapped")
    np.testing.assert_allclose(slip.position_ecef_m, truth_m, atol=1e-3)


def test_a_true_position_is_among_no_slips_but_the_open_height():
    truth_m = ecef_from_geodetic(np.radians(-33.8612), np.radians(151.2094), 64.0)
    near = [item.code for item in list_position_slips(truth_m) if np.linalg.norm(item.position_ecef_m - truth_m) < 5.0]
    assert near == ["height"]
    assert float(geodetic_from_ecef(truth_m)[2]) == pytest.approx(64.0, abs=1e-6)


@pytest.mark.parametrize(
    ("code", "stated_m"), [("feet", 100.0), ("centimetres", 3048.0), ("twice", 60.96), ("half", 15.24)]
)
def test_each_slip_of_a_distance_leads_back_to_the_truth(code, stated_m):
    (slip,) = (item for item in list_distance_slips(stated_m) if item.code == code)
    assert slip.distance_m == pytest.approx(30.48)


@pytest.mark.parametrize(
    ("code", "stated_m"),
    [
        ("north_east_down", (4.0, 3.0, -2.0)),
        ("east_and_north_swapped", (4.0, 3.0, 2.0)),
        ("east_sign", (-3.0, 4.0, 2.0)),
        ("up_sign", (3.0, 4.0, -2.0)),
        ("receivers_swapped", (-3.0, -4.0, -2.0)),
        ("feet", (3.0 / 0.3048, 4.0 / 0.3048, 2.0 / 0.3048)),
    ],
)
def test_each_slip_of_places_leads_back_to_the_truth(code, stated_m):
    (slip,) = (item for item in list_vector_slips() if item.code == code)
    np.testing.assert_allclose(slip.turn @ np.array(stated_m), (3.0, 4.0, 2.0), rtol=1e-12)
