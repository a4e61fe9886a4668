"""How rarely an echo is like a second signal: the law of what echoes are, and its order."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.detectors.second_signals.echoes import EchoModel, Second, echo_p_value, false_over_echo
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.studies.uniformity_echoes import drawn_seconds

MODEL, CHIP_M = EchoModel(), GPS_L1_CA.chip_m
LIKE_AN_ECHO = Second(
    late_m=500.0, over_db=-9.0, apart_hz=1.0, below_db=2.0, chip_m=CHIP_M, elevation_rad=np.radians(20.0)
)


def find_p_value(second, model=MODEL):
    return echo_p_value(model, false_over_echo(model, second), second)


@pytest.mark.parametrize(
    "unlike",
    [{"late_m": 1500.0}, {"over_db": 4.0}, {"apart_hz": 900.0}, {"elevation_rad": np.radians(80.0)}],
    ids=str,
)
def test_later_stronger_or_faster_than_echoes_is_rarer(unlike):
    assert find_p_value(LIKE_AN_ECHO._replace(**unlike)) < 0.5 * find_p_value(LIKE_AN_ECHO)


def test_an_echo_is_likelier_where_the_direct_may_be_blocked():
    strong = LIKE_AN_ECHO._replace(over_db=6.0)
    p_values = [find_p_value(strong._replace(below_db=below)) for below in (0.0, 5.0, 12.0)]
    assert p_values == sorted(p_values)
    assert p_values[0] < 0.1 * p_values[-1]


@given(
    late_m=st.floats(440.0, 3e6),
    over_db=st.floats(-12.0, 25.0),
    apart_hz=st.floats(0.0, 5e3),
    below_db=st.floats(0.0, 20.0),
    elevation_deg=st.floats(0.0, 90.0),
)
def test_ratios_and_p_values_stay_within_what_is_stated(late_m, over_db, apart_hz, below_db, elevation_deg):
    second = Second(late_m, over_db, apart_hz, below_db, CHIP_M, np.radians(elevation_deg))
    with np.errstate(over="raise", invalid="raise"):
        assert 0.0 < false_over_echo(MODEL, second) <= 1.0 / MODEL.unexplained_probability
        assert 0.0 < find_p_value(second) < 0.25


def test_an_unknown_elevation_is_the_lowest():
    assert find_p_value(LIKE_AN_ECHO._replace(elevation_rad=np.nan)) == find_p_value(
        LIKE_AN_ECHO._replace(elevation_rad=0.1)
    )


def test_more_echoes_make_each_more_probable():
    assert find_p_value(LIKE_AN_ECHO, replace(MODEL, echoes_per_satellite=3.0)) > 1.5 * find_p_value(LIKE_AN_ECHO)


@pytest.mark.parametrize(("below_db", "elevation_deg"), [(0.0, 10.0), (6.0, 40.0), (12.0, 70.0)])
def test_p_values_are_uniform_below_the_chance_of_an_echo(below_db, elevation_deg):
    # Drawn without the grid that the law is worked out on: neither too many nor too few at any level.
    rng, n = np.random.default_rng(5), 50_000
    drawn = drawn_seconds(rng, MODEL, np.full(n, below_db), np.full(n, elevation_deg))
    ratios = np.array([false_over_echo(MODEL, second) for _, second in drawn])
    for level in (0.001, 0.003, 0.01):
        rare = np.quantile(ratios, 1.0 - min(1.0, level * n / len(drawn)))
        of_law = echo_p_value(MODEL, rare, drawn[0][1])
        assert of_law == pytest.approx(min(level, len(drawn) / n), rel=0.35)


def test_shorter_chips_show_more_echoes_apart():
    # Second signals count from one and a half chips on, so a tenth of the chip lets nearer and more echoes count.
    nearer = LIKE_AN_ECHO._replace(chip_m=0.1 * CHIP_M)
    assert find_p_value(LIKE_AN_ECHO) < find_p_value(nearer) <= 1.0
