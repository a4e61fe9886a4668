"""The kernels of least squares and search against their NumPy twin."""

from dataclasses import replace

import numpy as np
import pytest
from tests.navigation import fit_twin, sky

from skyproof.navigation import least_squares, search
from skyproof.navigation.ranges import compute_atmosphere
from skyproof.navigation.sets import measure_window
from skyproof.records import Klobuchar

KLOBUCHAR = Klobuchar(alpha=(1.1e-8, 1.5e-8, -6e-8, -6e-8), beta=(9e4, 6e4, -2e5, -3e5))


@pytest.fixture(scope="module")
def two_skies():
    """Draw ranges of two skies over each other, and the signals of each satellite."""
    nav, place = sky.make_navigation(), sky.place(40.0, 20.0, 300.0)
    sats = sky.list_visible(nav, place, 5.0)
    places = [(sats[:9], place, 0.0), (sats[2:8], sky.move_place(place, 500.0, -900.0, 30.0), 1e-5)]
    seen = sky.make_scene(nav, places, n=4, noise_m=3.0, rng=np.random.default_rng(4)).observations
    _, ranges, _ = measure_window(seen, nav, multipath_sigma_m=0.5, ionosphere_share=0.25)
    copies = [
        np.flatnonzero([s.sat == sat for s in seen.signals]) for sat in dict.fromkeys(s.sat for s in seen.signals)
    ]
    return ranges, copies, place


def draw_problems(rng, m, k):
    """Draw satellites (m, k, 3) above places (m, 3), ranges and sigmas, some of them unused."""
    place = rng.standard_normal((m, 3))
    place *= 6.38e6 / np.linalg.norm(place, axis=-1, keepdims=True)
    away = rng.standard_normal((m, k, 3)) + 1.5 * place[:, None] / 6.38e6
    satellite = place[:, None] + 2.2e7 * away / np.linalg.norm(away, axis=-1, keepdims=True)
    range_m = np.linalg.norm(satellite - place[:, None], axis=-1) + rng.normal(1e4, 5.0, (m, k))
    sigma_m = rng.uniform(0.5, 5.0, (m, k))
    sigma_m[rng.random((m, k)) < 0.1] = np.nan
    return satellite, range_m, sigma_m, place


@pytest.mark.parametrize("n", [1, 3, 4, 7])
def test_the_inverse_equals_the_twins(n):
    root = np.random.default_rng(n).standard_normal((40, 9, n))
    matrix = np.swapaxes(root, -1, -2) @ root
    matrix[3] = 0.0
    matrix[4, 0, 0] = np.nan
    np.testing.assert_allclose(least_squares.invert_spd(matrix), fit_twin.invert_spd(matrix), rtol=1e-8, atol=1e-13)


def test_lines_of_sight_equal_the_twins():
    satellite, _, _, place = draw_problems(np.random.default_rng(1), 6, 8)
    satellite[2, 3] = np.nan
    for position in (place, place[0], np.zeros(3)):
        ours, twins = (
            least_squares.compute_line_of_sight(satellite, position),
            fit_twin.compute_line_of_sight(satellite, position),
        )
        for first, other in zip(ours, twins, strict=True):
            np.testing.assert_allclose(first, other, rtol=0, atol=2e-8)


@pytest.mark.parametrize("ionosphere", [KLOBUCHAR, None])
def test_delays_on_the_way_equal_the_twins(ionosphere):
    satellite, _, _, place = draw_problems(np.random.default_rng(2), 7, 9)
    place[3] *= 1.01  # 64 km up
    place[5] = np.nan
    tow_s, carrier_hz = np.linspace(0.0, 6e5, 7), np.linspace(1.1e9, 1.6e9, 9)
    ours = compute_atmosphere(place, satellite, tow_s, ionosphere, carrier_hz=carrier_hz)
    twins = fit_twin.compute_atmosphere(place, satellite, tow_s, ionosphere, carrier_hz=carrier_hz)
    for name in ("elevation_rad", "delay_m", "sigma_m", "ionosphere_m"):
        np.testing.assert_allclose(getattr(ours, name), getattr(twins, name), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("n_clocks", [1, 3])
def test_least_squares_equal_the_twins(n_clocks):
    rng = np.random.default_rng(3)
    satellite, range_m, sigma_m, _ = draw_problems(rng, 12, 10)
    sigma_m[2, 3:] = np.nan  # cannot be solved
    clocks = None if n_clocks == 1 else np.eye(3)[rng.integers(0, 2, 10)]  # the third has no satellite
    start = np.zeros((12, 3 + n_clocks))
    ours = least_squares.fit_position(satellite, range_m, sigma_m, start, clocks=clocks)
    twins = fit_twin.fit_position(satellite, range_m, sigma_m, start, clocks=clocks)
    np.testing.assert_allclose(ours.state_m, twins.state_m, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ours.covariance_m2, twins.covariance_m2, rtol=1e-8)
    np.testing.assert_allclose(ours.residual_m, twins.residual_m, rtol=0, atol=1e-6)
    assert np.isnan(ours.state_m[2]).all()


def test_solutions_and_predictions_equal_the_twins(two_skies):
    ranges, copies, place = two_skies
    choice = np.array([[copy[0] for copy in copies], [copy[-1] for copy in copies]])
    choice[1, 0] = -1
    start = np.tile(np.append(place, 0.0), (2, 1))
    ours, twins = (room.solve(ranges, choice, start, rounds=2) for room in (search, fit_twin))
    np.testing.assert_allclose(ours.state_m, twins.state_m, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ours.statistic, twins.statistic, rtol=1e-6)
    rows = np.array([copy[0] for copy in copies[:2]])
    mine, theirs = (
        room.compute_innovation(ranges, rows, ours.state_m, ours.covariance_m2) for room in (search, fit_twin)
    )
    np.testing.assert_allclose(mine[0], theirs[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(mine[1], theirs[1], rtol=1e-10)


@pytest.mark.parametrize("size", [5, 6, 8, 9])
def test_the_search_finds_what_the_twin_finds(two_skies, size):
    ranges, copies, _ = two_skies
    free = np.ones(sum(map(len, copies)), bool)
    free[copies[4][0]] = size > 6
    ours, twins = (
        room.SetSearch(ranges, copies).find_of_size(size, free, false_alarm_probability=1e-4)
        for room in (search, fit_twin)
    )
    assert len(ours.statistic) == len(twins.statistic) > (0 if size < 9 else -1)
    np.testing.assert_array_equal(np.sort(ours.choice, axis=0), np.sort(twins.choice, axis=0))
    np.testing.assert_allclose(ours.statistic, twins.statistic, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(ours.state_m, twins.state_m, rtol=0, atol=1e-4)


def test_a_signal_without_an_orbit_first_spoils_no_set(two_skies):
    ranges, copies, place = two_skies
    row = copies[0][0]
    satellite = np.array(ranges.satellite_ecef_m)
    satellite[row] = np.nan
    spoilt = replace(ranges, satellite_ecef_m=satellite)
    choice = np.array([[-1, *(copy[0] for copy in copies[1:])]])
    start = np.append(place, 0.0)[None]
    alone = search.solve(ranges, choice, start)
    np.testing.assert_array_equal(search.solve(spoilt, choice, start).state_m, alone.state_m)
