"""A scene that makes no sense is refused, and the message names the key."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skyproof.errors import ScenarioError
from skyproof.gnss.ephemeris import NavigationData
from skyproof.simulator.scenario import Meaconer, Scenario, Spoofer, parse_scenario, read_scenario
from skyproof.simulator.sky import make_scene

PLACE = {"lat_deg": 40.0, "lon_deg": -3.0, "height_m": 650.0}
TABLE: dict[str, Any] = {
    "start_gpst": "2023-03-04T05:06:07.25",
    "duration_s": 10.0,
    "receivers": [{"name": "one", **PLACE}, {"name": "two", **PLACE}],
    "front_end": {"rate_hz": 4e6, "kind": "real", "if_hz": 1e6, "encoding": "int", "bits": 8},
    "attacks": [
        {"kind": "meaconer", "receive": PLACE, "transmit": {**PLACE, "lat_deg": 40.001}, "delay_s": 1e-6},
        {"kind": "spoofer", "shows": PLACE, "transmit": {**PLACE, "lat_deg": 40.002}, "sats": ["G05"]},
    ],
}


def change(path: str, value: Any) -> dict[str, Any]:
    table: Any = deepcopy(TABLE)
    *parents, last = (int(part) if part.isdigit() else part for part in path.split("."))
    inner = table
    for part in parents:
        inner = inner[part]
    inner[last] = value
    return table  # type: ignore[no-any-return]


def test_a_sound_table_becomes_a_scenario() -> None:
    scenario = parse_scenario(TABLE)
    assert scenario.start_gpst == np.datetime64("2023-03-04T05:06:07.25")
    assert [type(attack) for attack in scenario.attacks] == [Meaconer, Spoofer]
    assert scenario.attack_names == ["meaconer", "spoofer"]


def test_a_scenario_written_and_read_again_is_the_same() -> None:
    scenario = parse_scenario(TABLE | {"start_gpst": "2023-03-04T05:06:07.123456789"})
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("colour", "red", ["colour: unknown", "receivers"]),
        ("receivers.1.hight_m", 3.0, ["receivers[1].hight_m: unknown key", "height_m"]),
        ("receivers.0.height_m", -3000.0, ["receivers[0].height_m", "-500"]),
        ("receivers.0.lat_deg", 91.0, ["receivers[0].lat_deg", "90"]),
        ("receivers.1.name", "one", ["one name"]),
        ("receivers", [], ["receivers"]),
        ("front_end.rate_hz", -4e6, ["front_end.rate_hz"]),
        ("front_end.rate_hz", 4e6 + 0.5, ["front_end.rate_hz", "multiple of 1"]),
        ("front_end.bits", 3, ["front_end", "8 or 16 bits", "3"]),
        ("front_end.if_hz", 0.0, ["front_end", "real samples"]),
        ("attacks.0.delay", 1e-6, ["attacks[0].delay: unknown key", "delay_s"]),
        ("attacks.0.delay_s", -1e-6, ["attacks[0].delay_s"]),
        ("attacks.0.onset_s", 10.0, ["attacks[0].onset_s", "10"]),
        ("attacks.0.until_s", -1.0, ["attacks[0]", "not after onset_s"]),
        ("attacks.0.receive.hight_m", 1.0, ["attacks[0].receive.hight_m: unknown key", "height_m"]),
        ("attacks.1.sats", [], ["attacks[1].sats"]),
        ("attacks.1.sats", ["G33"], ["attacks[1].sats[0]", "G01 to G32"]),
        ("attacks.1.kind", "jammer", ["attacks[1]", "meaconer", "spoofer"]),
        ("start_gpst", "yesterday", ["start_gpst", "2022-01-01T21:45:58"]),
        ("duration_s", float("nan"), ["duration_s"]),
    ],
)
def test_a_mistake_is_refused_with_the_path_of_its_key(path: str, value: Any, words: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(change(path, value), source="scene.toml")
    assert str(caught.value).startswith("scene.toml: ")
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"phase": "random"}, [r"seamless_s ", 'phase = "aligned"', "'random'"]),
        ({"onset_s": 3.0}, ["seamless_s begins at 2 s, before onset_s 3", "onset"]),
        ({"seamless_s": [4.0, 4.0]}, ["seamless_s[1] is at 4 s"]),
        (
            {"amplitude_points": [[4.0, 1.0], [5.0, 0.0]]},
            ["attacks[0].amplitude_points[1][1] = 0.0"],
        ),
        ({"amplitude_points": [[5.0, 1.0], [4.0, 1.0]]}, ["amplitude_points[1] is at 4 s"]),
        ({"guess_s": 0.02}, ["attacks[0].guess_s", "less than 0.02"]),
        ({"clock_corner_s": -1.0}, ["attacks[0].clock_corner_s"]),
    ],
)
def test_a_seamless_takeover_that_is_none_is_refused(changes: dict[str, Any], words: list[str]) -> None:
    attack = {"kind": "takeover", "target": "one", "transmit": {**PLACE, "lat_deg": 40.001}, "phase": "aligned"}
    sound = attack | {"onset_s": 1.0, "seamless_s": [2.0, 4.0], "guess_s": 5e-5}
    assert parse_scenario(TABLE | {"attacks": [sound]}).attacks[0].kind == "takeover"
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(TABLE | {"attacks": [sound | changes]})
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_all_mistakes_are_reported_at_once() -> None:
    table = change("receivers.0.height_m", -3000.0) | {"colour": "red"}
    with pytest.raises(ScenarioError, match=r"(?s)receivers\[0\]\.height_m.*colour"):
        parse_scenario(table)


def test_a_file_that_is_no_toml_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("duration_s = \n")
    with pytest.raises(ScenarioError, match=r"scene\.toml.*line 1"):
        read_scenario(path)


def test_a_spoofed_satellite_that_cannot_be_seen_is_refused(navigation: NavigationData) -> None:
    seen = {heard.id.sat for heard in make_scene(parse_scenario(TABLE | {"attacks": []}), navigation).skies[0].signals}
    hidden = next(eph.sat for eph in navigation.ephemerides if eph.sat not in seen)
    with pytest.raises(ScenarioError, match=rf"attacks\[1\]\.sats: {hidden} .*\b5 degrees"):
        make_scene(parse_scenario(change("attacks.1.sats", [hidden])), navigation)


def test_navigation_data_of_another_day_are_refused(navigation: NavigationData) -> None:
    with pytest.raises(ScenarioError, match=r"start_gpst: .*\b2023-03-14"):
        make_scene(parse_scenario(change("start_gpst", "2023-03-14T05:06:07")), navigation)


def test_a_transmit_antenna_inside_a_receiver_is_refused(navigation: NavigationData) -> None:
    table = change("attacks.1.sats", None)
    table["attacks"][0]["transmit"] = PLACE
    with pytest.raises(ScenarioError, match=r"attacks\[0\]\.transmit: 0\.00 m .*\bone\b"):
        make_scene(parse_scenario(table), navigation)


def test_a_mask_above_every_satellite_is_refused(navigation: NavigationData) -> None:
    with pytest.raises(ScenarioError, match=r"mask_deg: .*\b89\.9 degrees"):
        make_scene(parse_scenario(TABLE | {"attacks": [], "mask_deg": 89.9}), navigation)
