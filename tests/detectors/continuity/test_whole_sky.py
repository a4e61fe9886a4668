"""A motion of the whole sky: not of some satellites, and not of errors larger than stated."""

import numpy as np
import pytest

from skyproof.detectors.continuity.whole_sky import estimate_motion

ALPHA = 1e-7


def draw_unit_vectors(satellites, rng):
    elevation_rad = np.arcsin(rng.uniform(0.15, 1.0, satellites))
    azimuth_rad = rng.uniform(0.0, 2.0 * np.pi, satellites)
    along = np.cos(elevation_rad)
    return np.stack([along * np.sin(azimuth_rad), along * np.cos(azimuth_rad), np.sin(elevation_rad)], axis=1)


def find_motion(unit, change):
    names = np.array([f"G{number:02d}" for number in range(len(unit))])
    motion = estimate_motion(names, unit, change, np.ones(len(unit)), 10.0, alpha=ALPHA)
    assert motion is not None
    return motion


@pytest.mark.parametrize("satellites", [8, 10, 12])
def test_a_motion_under_stated_errors_is_the_whole_skys(satellites):
    rng = np.random.default_rng(satellites)
    found = []
    for _ in range(40):
        unit = draw_unit_vectors(satellites, rng)
        change = -unit @ [60.0, 0.0, 0.0] + 7.0 + rng.normal(size=satellites)
        found.append(find_motion(unit, change).whole_sky_p_value < ALPHA)
    assert np.mean(found) > 0.9


@pytest.mark.parametrize("scale", [5.0, 10.0, 30.0])
@pytest.mark.parametrize("satellites", [8, 10, 12])
def test_far_larger_errors_are_no_motion_of_the_whole_sky(satellites, scale):
    # As between houses: without this rule up to 66 of 150 draws were one.
    rng = np.random.default_rng(satellites)
    chances = [
        find_motion(draw_unit_vectors(satellites, rng), scale * rng.normal(size=satellites)).whole_sky_p_value
        for _ in range(150)
    ]
    assert sum(chance < ALPHA for chance in chances) <= 1
