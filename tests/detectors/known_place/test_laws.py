"""The chance of codes at a known place is uniform under the model, and small where one is off."""

import numpy as np
from scipy import stats

from skyproof.detectors.known_place.laws import chance_at_place


def draw_epoch(rng: np.random.Generator, n: int, scales: int):
    unit = rng.normal(size=(n, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    sigma_m = rng.uniform(1.0, 4.0, n)
    clocks = np.eye(scales)[np.arange(n) % scales]
    place_m2 = np.diag([4.0, 1.0, 9.0])
    place_m = rng.multivariate_normal(np.zeros(3), place_m2)
    clock_m = rng.uniform(-1e6, 1e6, scales)
    misfit_m = sigma_m * rng.standard_normal(n) + unit @ place_m + clocks @ clock_m
    return misfit_m, sigma_m, unit, clocks, place_m2


def test_the_chance_is_uniform_under_the_model() -> None:
    rng = np.random.default_rng(4)
    for n, scales in ((2, 1), (5, 2), (9, 3)):
        chances = [chance_at_place(*draw_epoch(rng, n, scales)) for _ in range(1500)]
        assert stats.kstest(chances, "uniform").pvalue > 1e-3


def test_one_satellite_a_scale_says_nothing() -> None:
    assert chance_at_place(*draw_epoch(np.random.default_rng(0), 3, 3)) == 1.0


def test_a_code_that_is_off_has_no_chance_unless_it_is_left_out() -> None:
    misfit_m, *rest = draw_epoch(np.random.default_rng(1), 5, 1)
    misfit_m[2] += 500.0
    assert chance_at_place(misfit_m, *rest) < 1e-12
    assert chance_at_place(misfit_m, *rest, kept=np.arange(5) != 2) > 1e-3
