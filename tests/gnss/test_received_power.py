"""A rise of the noise becomes a jammer's power over it, with limits that hold it as often as they say."""

import numpy as np
import pytest

from skyproof.gnss.received_power import estimate_jammer_to_noise


def rise_db(jammer_db: float) -> float:
    return 10.0 * np.log10(1.0 + 10.0 ** (jammer_db / 10.0))


@pytest.mark.parametrize("jammer_db", [-5.0, 0.0, 20.0, 40.0])
def test_a_rise_is_one_plus_the_jammer(jammer_db: float) -> None:
    found = estimate_jammer_to_noise([rise_db(jammer_db)] * 2, [0.1, 1.0])
    assert found.db == pytest.approx(jammer_db, abs=1e-9)
    assert (found.low_db or -np.inf) < jammer_db < found.high_db


@pytest.mark.parametrize("jammer_db", [0.0, 10.0])
def test_the_limits_hold_it_in_95_percent(jammer_db: float) -> None:
    rng, n = np.random.default_rng(1), 4000
    held = 0
    for each in rise_db(jammer_db) + 0.5 * rng.standard_normal(n):
        found = estimate_jammer_to_noise(each, 0.5)
        held += found is not None and (found.low_db or -np.inf) <= jammer_db <= found.high_db
    assert held / n == pytest.approx(0.95, abs=0.015)


def test_noise_alone_has_no_lower_limit_and_a_fall_no_jammer() -> None:
    assert estimate_jammer_to_noise(0.5, 1.0).low_db is None
    assert estimate_jammer_to_noise(-0.1, 1.0) is None


def test_a_lower_bound_has_no_upper_limit() -> None:
    assert estimate_jammer_to_noise(10.0, 1.0, at_least=True).high_db is None


def test_rises_that_disagree_are_less_certain() -> None:
    alike, apart = (estimate_jammer_to_noise([10.0, other], [1.0, 1.0]) for other in (11.0, 20.0))
    assert apart.high_db - apart.low_db > 3.0 * (alike.high_db - alike.low_db)
