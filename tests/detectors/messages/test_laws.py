"""Differences of two data sets of one satellite, and their chance."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from skyproof.detectors.messages.laws import chance_of_difference, range_difference_m, serve_together
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.nominal import make_nominal_constellation

SENT = replace(make_nominal_constellation(np.datetime64("2024-05-14T10:00:00", "ns")).ephemerides[0], ura_index=0)


def test_a_clock_is_a_range_in_full() -> None:
    late = replace(SENT, af0=SENT.af0 + 30.0 / SPEED_OF_LIGHT_M_S)
    assert range_difference_m(SENT, late) == pytest.approx(30.0, abs=1e-6)
    assert range_difference_m(SENT, SENT) == 0.0


def test_what_lies_along_the_orbit_counts_a_seventh() -> None:
    along_m = 700.0
    moved = replace(SENT, m0=SENT.m0 + along_m / SENT.sqrt_a**2)
    assert range_difference_m(SENT, moved) == pytest.approx(along_m / 7.0, rel=0.05)


def test_the_chance_is_that_of_the_stated_accuracies() -> None:
    late = replace(SENT, af0=SENT.af0 + 10.0 / SPEED_OF_LIGHT_M_S, ura_index=1)
    expected = 2.0 * stats.norm.sf(10.0 / np.hypot(2.4, 3.4))
    assert chance_of_difference(SENT, late) == pytest.approx(expected)
    assert chance_of_difference(SENT, replace(late, ura_index=15)) is None


def test_errors_as_stated_come_at_their_rate() -> None:
    rng = np.random.default_rng(5)
    errors_m = rng.normal(0.0, 2.4, (2000, 2)) / SPEED_OF_LIGHT_M_S
    chances = [
        chance_of_difference(replace(SENT, af0=SENT.af0 + first), replace(SENT, af0=SENT.af0 + second))
        for first, second in errors_m
    ]
    assert stats.kstest(chances, "uniform").pvalue > 1e-3


def test_data_sets_far_apart_in_time_are_not_compared() -> None:
    assert serve_together(SENT, replace(SENT, toe=SENT.toe + 7200.0))
    assert not serve_together(SENT, replace(SENT, toe=SENT.toe + 9000.0))
    assert not serve_together(SENT, replace(SENT, message="CNAV"))
