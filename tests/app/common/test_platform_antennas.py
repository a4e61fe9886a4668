"""What a platform file says of antennas."""

from typing import Any

import numpy as np
import pytest

from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_antennas import build_arrays, build_spin_arms
from skyproof.app.common.platform_tables import PlatformReceiver
from skyproof.errors import SettingsError

PLACES_M = [[0.0, 0.0, 0.0], [0.19, 0.0, 0.0], [0.1, 0.16, 0.0]]


def make_tables(**keys: Any) -> dict[str, PlatformReceiver]:
    return {"rx": Platform.model_validate({"receivers": [keys]}).receivers[0]}


def test_an_array_is_where_its_antennas_are() -> None:
    stated = {"antenna_sigma_m": 0.002, "antenna_pattern_sigma_m": 0.01, "line_bias_cyc": [0.0, 0.2, -0.1]}
    described = make_tables(antennas_m=PLACES_M, **stated)
    array = build_arrays(described, {"rx": 3})["rx"]
    assert np.array_equal(array.elements_m, PLACES_M)
    assert (array.sigma_m, array.pattern_sigma_m) == (0.002, 0.01)
    assert array.line_bias_cyc is not None
    assert array.line_bias_cyc.tolist() == [0.0, 0.2, -0.1]
    unknown = build_arrays(make_tables(antennas_m=PLACES_M), {"rx": 3})["rx"]
    assert unknown.line_bias_cyc is None
    assert (unknown.sigma_m, unknown.pattern_sigma_m) == (None, None)


def test_antennas_without_stated_places_are_no_array() -> None:
    assert build_arrays(make_tables(line_bias_cyc=[0.0, 0.1]), {"rx": 2}) == {}
    assert build_arrays(make_tables(antennas_m=PLACES_M[:1]), {"rx": 1}) == {}


@pytest.mark.parametrize(
    ("keys", "count", "words"),
    [
        ({"antennas_m": PLACES_M}, 4, r"p\.toml: antennas_m .*\brx .*\b3 antennas\b.* 4"),
        ({"antennas_m": PLACES_M}, 1, r"antennas_m .*\brx .*\b3 antennas\b.* 1;"),
        ({"line_bias_cyc": [0.0, 0.1]}, 3, r"line_bias_cyc .*\brx .*\b2 antennas\b.* 3"),
    ],
)
def test_a_number_of_antennas_other_than_the_inputs_is_refused(keys: Any, count: int, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        build_arrays(make_tables(**keys), {"rx": count}, "p.toml")


def test_an_arm_turns_with_its_rate() -> None:
    (arm,) = build_spin_arms(make_tables(spin={"radius_m": 0.0951, "rate_hz": -0.25, "rate_sigma_hz": 0.001}))
    assert (arm.receiver, arm.radius_m) == ("rx", 0.0951)
    assert arm.rate_rad_s == pytest.approx(-0.5 * np.pi)
    assert arm.rate_sigma_rad_s == pytest.approx(0.002 * np.pi)
    assert arm.pattern_sigma_m is None
    spin = {"radius_m": 0.0951, "rate_hz": 0.25}
    (arm,) = build_spin_arms(make_tables(spin=spin, antenna_pattern_sigma_m=0.005))
    assert arm.pattern_sigma_m == 0.005
    assert build_spin_arms(make_tables()) == ()
