"""Where rays meet: within the covariance stated, whatever errors they share."""

import numpy as np
import pytest

from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.navigation.bearings import BearingRay, locate_transmitter

LAT, LON = np.radians(47.0), np.radians(8.0)
HERE_M = ecef_from_geodetic(LAT, LON, 400.0)
TURN = rot_enu_ecef(LAT, LON)


def make_place(east_m, north_m, up_m=0.0):
    return HERE_M + np.array([east_m, north_m, up_m]) @ TURN


def make_ray(place_m, target_m, *, sigma_rad=0.01, off_rad=(0.0, 0.0), place_sigma_m=1.0, body="ship"):
    east, north, up = TURN @ (target_m - place_m)
    azimuth_rad, elevation_rad = np.arctan2(east, north), np.arctan2(up, np.hypot(east, north))
    return BearingRay(
        place_ecef_m=place_m,
        place_covariance_m2=place_sigma_m**2 * np.eye(3),
        azimuth_rad=azimuth_rad + off_rad[0] / np.cos(elevation_rad),
        elevation_rad=elevation_rad + off_rad[1],
        covariance_rad2=sigma_rad**2 * np.eye(2),
        body=body,
    )


def test_rays_without_error_meet_at_the_transmitter():
    target_m = make_place(800.0, 1500.0, 120.0)
    found = locate_transmitter([make_ray(make_place(x, 0.0), target_m) for x in (-600.0, 0.0, 700.0)])
    # The verticals of places 1 km apart differ by 0.2 mrad: `ray` takes one of them for all.
    assert np.linalg.norm(found.position_ecef_m - target_m) < 1.0
    assert found.p_value > 0.9


@pytest.mark.parametrize("shared", [False, True], ids=["own errors", "one error"])
def test_the_ellipse_holds_the_transmitter(shared):
    rng = np.random.default_rng(6)
    target_m = make_place(900.0, 1800.0, 60.0)
    squares = []
    for _ in range(300):
        error_rad = 0.01 * rng.standard_normal(2)
        offs = [error_rad if shared else 0.01 * rng.standard_normal(2) for _ in range(6)]
        rays = [
            make_ray(make_place(x, 0.0), target_m, off_rad=off)
            for x, off in zip(np.linspace(-900.0, 900.0, 6), offs, strict=True)
        ]
        found = locate_transmitter(rays)
        error_m = found.position_ecef_m - target_m
        squares.append(error_m @ np.linalg.solve(found.covariance_m2, error_m))
        assert found.p_value > 1e-4
    assert np.mean(np.array(squares) > 11.34) < 0.02  # 1 % of chi-square with three degrees, or fewer


def test_two_platforms_count_as_their_own():
    rng = np.random.default_rng(7)
    target_m = make_place(900.0, 1800.0, 60.0)
    squares = []
    for _ in range(400):
        pair = [
            make_ray(place_m, target_m, off_rad=0.005 * rng.standard_normal(2), sigma_rad=0.005, body=body)
            for place_m, body in ((make_place(-800.0, 0.0), "one"), (make_place(800.0, 100.0), "two"))
        ]
        found = locate_transmitter(pair)
        error_m = found.position_ecef_m - target_m
        squares.append(error_m @ np.linalg.solve(found.covariance_m2, error_m))
    assert np.mean(np.array(squares) > 6.25) == pytest.approx(0.1, abs=0.05)  # 10 % of three degrees


def test_rays_that_run_alike_or_apart_do_not_meet():
    target_m = make_place(900.0, 1800.0, 60.0)
    assert locate_transmitter([make_ray(HERE_M, target_m)]) is None
    assert locate_transmitter([make_ray(HERE_M, target_m), make_ray(HERE_M, target_m)]) is None
    assert (
        locate_transmitter([make_ray(make_place(x, 0.0), make_place(0.0, 50_000.0)) for x in (-10.0, 0.0, 10.0)])
        is None
    )
    apart = [make_ray(make_place(x, 0.0), make_place(2.0 * x, 1000.0)) for x in (-500.0, 500.0)]
    assert locate_transmitter(apart) is None


def test_rays_to_different_places_are_refused_by_their_p_value():
    first, other = make_place(900.0, 1800.0, 60.0), make_place(-1500.0, 1800.0, 60.0)
    rays = [
        make_ray(make_place(x, 0.0), first if x < 0.0 else other, sigma_rad=0.002)
        for x in np.linspace(-900.0, 900.0, 6)
    ]
    found = locate_transmitter(rays)
    assert found is None or found.p_value < 1e-4
