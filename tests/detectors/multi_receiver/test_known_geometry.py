"""What is known of the antennas against what signals show: distributions under the truth, and what is off."""

import numpy as np
import pytest
from scipy import optimize

from skyproof.detectors.multi_receiver.known_geometry import (
    AntennaDistance,
    AntennaPlaces,
    LearntBaseline,
    consistency_p_value,
    geometry_survival,
)
from skyproof.detectors.multi_receiver.one_antenna import BaselineEstimate
from skyproof.records import Baseline

START = np.datetime64("2024-05-14T10:00:00", "ns")
PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (24.0, 18.0, 0.0), "rx3": (-20.0, 15.0, 2.0)}
TRUE_M = np.array([24.0, 18.0, 0.0])
RECEIVERS = ("rx1", "rx2")


def make_covariance(rng, scale=1.0):
    root = rng.normal(size=(3, 3))
    return scale * (root @ root.T / 3.0 + 0.1 * np.eye(3))


def build_measured(enu_m, covariance_m2):
    enu_m = np.asarray(enu_m, float).reshape(-1, 3)
    names = tuple(PLACES)[: len(enu_m) + 1]
    return Baseline(receivers=names, start_gpst=START, end_gpst=START, enu_m=enu_m, covariance_m2=covariance_m2)


@pytest.mark.parametrize("seed", range(20))
def test_the_nearest_baseline_of_a_distance_is_nearest_of_all(seed):
    rng = np.random.default_rng(seed)
    distance_m = 10.0 ** rng.uniform(0.3, 2.6)
    sigma_m, shown_m = rng.uniform(0.3, 10.0), rng.normal(size=3) * distance_m
    spread_m2 = make_covariance(rng, 10.0 ** rng.uniform(-1.0, 1.0))
    weight = np.linalg.inv(spread_m2)

    def find_cost(b):
        return (shown_m - b) @ weight @ (shown_m - b) + ((np.linalg.norm(b) - distance_m) / sigma_m) ** 2

    starts = [shown_m, -shown_m, *(rng.normal(size=(4, 3)) * distance_m)]
    options = {"xatol": 1e-8, "fatol": 1e-10, "maxiter": 4000}
    least = min(optimize.minimize(find_cost, start, method="Nelder-Mead", options=options).fun for start in starts)
    found = AntennaDistance(distance_m, sigma_m).misfit(RECEIVERS, shown_m, spread_m2).squared
    assert float(found) == pytest.approx(least, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("known", ["distance", "places", "learnt"])
def test_agreement_is_uniform_and_survival_never_too_small(known):
    # Measured baselines and what is known of them are drawn about the truth, with the sigmas that are stated.
    rng = np.random.default_rng(3)
    spread_m2, draws = make_covariance(rng, 2.0), 400
    root_m = np.linalg.cholesky(spread_m2)
    agreed, survived = np.empty(draws), np.empty(draws)
    for k in range(draws):
        shown_m = TRUE_M + root_m @ rng.normal(size=3)
        if known == "distance":
            geometry = AntennaDistance(float(30.0 + 0.75 * rng.normal()), 0.75)
        elif known == "places":
            off_m = 0.5 * rng.normal(size=(2, 3))
            places = {n: tuple(np.add(PLACES[n], o)) for n, o in zip(RECEIVERS, off_m, strict=True)}
            geometry = AntennaPlaces(places, 0.5)
        else:
            learnt_m = TRUE_M + root_m @ rng.normal(size=3)
            geometry = LearntBaseline(build_measured(learnt_m, spread_m2))
        agreed[k] = consistency_p_value(geometry, (build_measured(shown_m, spread_m2),))
        estimate = BaselineEstimate(shown_m[None], spread_m2[None])
        survived[k] = geometry_survival(geometry, RECEIVERS, estimate, np.array([np.inf]))[0]
    for rate in (0.2, 0.05):
        assert abs(np.mean(agreed < rate) - rate) < 4.0 * np.sqrt(rate * (1.0 - rate) / draws)
        assert np.mean(survived < rate) <= rate + 4.0 * np.sqrt(rate / draws)


@pytest.mark.parametrize("off_m", [(10.0, 0.0, 0.0), (0.0, -12.0, 0.0), (0.0, 0.0, 15.0)])
def test_places_notice_every_direction(off_m):
    baseline = build_measured(TRUE_M + off_m, np.diag([1.0, 1.0, 4.0]))
    assert consistency_p_value(AntennaPlaces(PLACES), (baseline,)) < 1e-6


def test_a_distance_notices_near_and_far_but_not_beside():
    known = AntennaDistance(30.0, 0.5)
    for shown_m, agrees in (
        ((24.0, 18.0, 0.0), True),
        ((-18.0, 24.0, 0.0), True),
        ((18.0, 12.0, 0.0), False),
        ((60.0, 40.0, 0.0), False),
    ):
        assert (consistency_p_value(known, (build_measured(shown_m, np.eye(3)),)) > 0.5) == agrees


def test_the_worst_part_of_a_window_counts():
    good, bad = build_measured(TRUE_M, np.eye(3)), build_measured(TRUE_M + (12.0, 0.0, 0.0), np.eye(3))
    known = AntennaPlaces(PLACES)
    assert consistency_p_value(known, (good, good)) > 0.5
    assert consistency_p_value(known, (good, bad)) < 1e-6


def test_three_receivers_share_the_first_ones_error():
    enu_m = np.array([PLACES["rx2"], PLACES["rx3"]])
    known = AntennaPlaces(PLACES, sigma_m=1.0)
    shifted = known.misfit(tuple(PLACES), (enu_m + 1.0).ravel(), 1e-6 * np.eye(6))  # the first one is 1 m off, say
    assert (shifted.dof, shifted.exact) == (6, 6)
    assert float(shifted.squared) == pytest.approx(2.0, rel=1e-3)  # 3 axes, 2 others: 2 / (1 + 2) of each axis


def test_the_nearest_place_at_a_distance_matches_a_search():
    rng = np.random.default_rng(5)
    root = rng.standard_normal((40, 3, 3))
    covariance_m2 = root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(3)
    enu_m = 3.0 * rng.standard_normal((40, 3))
    geometry = AntennaDistance(2.0, 0.3)
    directions = rng.standard_normal((4000, 3))
    around = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    for k in range(40):
        squared = float(geometry.misfit(("a", "b"), enu_m[k], covariance_m2[k]).squared)
        places = np.concatenate([length_m * around for length_m in np.linspace(0.5, 4.0, 71)])
        off_m = enu_m[k] - places
        all_squared = np.einsum("ni,ij,nj->n", off_m, np.linalg.inv(covariance_m2[k]), off_m)
        all_squared += ((np.linalg.norm(places, axis=1) - 2.0) / 0.3) ** 2
        assert squared <= all_squared.min() + 1e-9
        assert squared >= 0.8 * all_squared.min() - 0.05
    misfit = geometry.misfit(("a", "b"), enu_m, covariance_m2[0]).squared  # one covariance for all places
    each = [geometry.misfit(("a", "b"), place, covariance_m2[0]).squared for place in enu_m]
    np.testing.assert_allclose(misfit, each, rtol=1e-12)
