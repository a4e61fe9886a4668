"""What a platform file gives a run: inputs and names, and settings that follow from positions, body and motion."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.app.kit import ENU_M, PLACES

from skyproof.app.common.platform import Platform
from skyproof.app.common.platform_use import derive_settings, match_tables, select_inputs
from skyproof.app.common.settings import Settings
from skyproof.errors import SettingsError
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef

NAMES = [place.name for place in PLACES]
SURVEYED = [
    {
        "name": place.name,
        "position": {
            "lat_deg": place.lat_deg,
            "lon_deg": place.lon_deg,
            "height_m": place.height_m,
            "sigma_m": 0.02 * (1 + number),
        },
    }
    for number, place in enumerate(PLACES)
]


def find_unused(
    settings: Settings | None = None, names: list[str] = NAMES, **tables: Any
) -> tuple[Settings, tuple[str, ...]]:
    platform = Platform.model_validate(tables)
    return derive_settings(platform, settings or platform.protect, names, match_tables(platform, names))


def test_surveyed_positions_are_the_antennas_places() -> None:
    settings, remarks = find_unused(receivers=SURVEYED)
    assert settings.antennas_enu_m is not None
    assert list(settings.antennas_enu_m) == NAMES
    for name, enu_m in settings.antennas_enu_m.items():
        np.testing.assert_allclose(enu_m, ENU_M[name], atol=1e-6)
    assert settings.antennas_sigma_m == pytest.approx(0.06)
    assert remarks == ()


def list_unused(remarks: Sequence[str]) -> list[str]:
    """List the keys of the platform file that remarks call unused."""
    found = [re.fullmatch("(.*): read, used by no method.*", remark) for remark in remarks]
    return [match[1] for match in found if match]


def test_incomplete_positions_give_no_antennas_but_serve_fixed() -> None:
    for motion, remark in ((None, ()), ("moving", ("motion, receivers[0].position",))):
        settings, remarks = find_unused(receivers=[SURVEYED[0], {"name": "stern"}, {"name": "mast"}], motion=motion)
        assert settings == Settings()
        assert list_unused(remarks) == list(remark)
    settings, _ = find_unused(receivers=SURVEYED[:2])  # the third recording has no table
    assert settings.antennas_enu_m is None


@pytest.mark.parametrize(
    ("tables", "used_by"),
    [
        ({}, True),
        ({"motion": "moving"}, True),
        ({"motion": "static"}, False),
        ({"receivers": SURVEYED[:1]}, False),
        ({"receivers": SURVEYED[:1], "motion": "moving"}, True),
    ],
)
def test_an_inertial_unit_is_used_where_a_receiver_may_move(tables: dict[str, Any], used_by: bool) -> None:
    _, remarks = find_unused(names=NAMES[:1], imu={"file": "imu.csv"}, **tables)
    assert any("imu" in remark for remark in remarks) != used_by


def test_an_option_comes_before_the_oscillator_setting() -> None:
    settings, remarks = find_unused(oscillator="ocxo")
    assert (settings.oscillator, remarks) == ("ocxo", ())
    settings, remarks = find_unused(Settings(oscillator="tcxo"), oscillator="ocxo")
    assert settings.oscillator == "tcxo"
    assert list_unused(remarks) == ["oscillator"]


BODY = [{"name": "a", "body_m": [10.0, 0.0, 0.0]}, {"name": "b", "body_m": [10.0, 3.0, -1.0]}]


@pytest.mark.parametrize(
    ("angles", "enu_m"),
    [
        ((0.0, 0.0, 0.0), (3.0, 0.0, 1.0)),
        ((90.0, 0.0, 0.0), (0.0, -3.0, 1.0)),
        ((180.0, 0.0, 0.0), (-3.0, 0.0, 1.0)),
        ((0.0, 90.0, 0.0), (3.0, -1.0, 0.0)),  # nose up: what was up points back
        ((0.0, 0.0, 90.0), (1.0, 0.0, -3.0)),  # right side down
    ],
)
def test_the_body_turns_with_its_attitude(angles: Any, enu_m: Any) -> None:
    attitude = dict(zip(("heading_deg", "pitch_deg", "roll_deg"), angles, strict=True), sigma_deg=2.0)
    settings, remarks = find_unused(names=["a", "b"], receivers=BODY, attitude=attitude)
    assert settings.antennas_enu_m is not None
    assert settings.antennas_enu_m["a"] == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(settings.antennas_enu_m["b"], enu_m, atol=1e-12)
    assert settings.antennas_sigma_m == pytest.approx(np.hypot(0.1, np.sqrt(10.0) * np.radians(2.0)))
    assert remarks == ()


@given(st.floats(-180.0, 180.0), st.floats(-89.0, 89.0), st.floats(-180.0, 180.0))
def test_no_attitude_changes_the_distances(heading_deg: float, pitch_deg: float, roll_deg: float) -> None:
    attitude = {"heading_deg": heading_deg, "pitch_deg": pitch_deg, "roll_deg": roll_deg, "sigma_deg": 0.1}
    settings, _ = find_unused(names=["a", "b"], receivers=BODY, attitude=attitude)
    assert settings.antennas_enu_m is not None
    assert np.linalg.norm(settings.antennas_enu_m["b"]) == pytest.approx(np.sqrt(10.0))


@pytest.mark.parametrize(
    "more", [{}, {"motion": "moving", "attitude": {"heading_deg": 3.0, "sigma_deg": 1.0}}], ids=["absent", "moving"]
)
def test_antennas_keep_their_body_distance_without_an_attitude(more: dict[str, Any]) -> None:
    settings, remarks = find_unused(
        names=["a", "b"], receivers=[item | {"antenna_sigma_m": 0.01} for item in BODY], **more
    )
    assert settings.antennas_enu_m is None
    assert settings.antenna_distance_m == pytest.approx(np.sqrt(10.0))
    assert settings.antenna_distance_sigma_m == pytest.approx(0.01 * np.sqrt(2.0))
    assert list_unused(remarks) == (["motion, attitude"] if more else [])


@pytest.mark.parametrize("turns", [True, False])
def test_places_in_a_body_that_turns_are_used_window_by_window(turns: bool) -> None:
    three = [*BODY, {"name": "c", "body_m": [0.0, 0.0, 0.0]}]
    unit = {"imu": {"file": "imu.csv", "grade": "tactical"}} if turns else {}
    settings, remarks = find_unused(names=["a", "b", "c"], receivers=three, **unit)
    assert settings == Settings()
    keys = ", ".join(f"receivers[{number}].body_m" for number in range(3))
    assert list_unused(remarks) == ([] if turns else [keys])


def test_antennas_at_one_place_of_the_body_give_no_distance() -> None:
    settings, remarks = find_unused(names=["a", "b"], receivers=[BODY[0], BODY[0] | {"name": "b"}])
    assert settings == Settings()
    assert list_unused(remarks) == ["receivers[0].body_m, receivers[1].body_m"]


@pytest.mark.parametrize("key", ["antennas_enu_m", "antenna_distance_m"])
def test_settings_of_the_run_override_the_platform_and_report_it(key: str) -> None:
    value = {"antennas_enu_m": {name: (0.0, 0.0, 0.0) for name in NAMES}, "antenna_distance_m": 12.0}[key]
    settings, remarks = find_unused(Settings(**{key: value}), receivers=SURVEYED)
    assert getattr(settings, key) == value
    assert settings == Settings(**{key: value})
    assert len(remarks) == 1
    assert re.match(rf"{re.escape(key)} .*\breceivers\[0\]\.", remarks[0])


@pytest.mark.parametrize(
    ("tables", "speed_m_s"),
    [
        ({}, None),
        ({"speed_max_m_s": 30.0}, 30.0),
        ({"motion": "static"}, 0.0),
        ({"motion": "static", "speed_max_m_s": 30.0}, 0.0),
        ({"motion": "moving", "speed_max_m_s": 30.0}, 30.0),
        ({"motion": "static", "receivers": [{"spin": {"radius_m": 0.1, "rate_hz": -0.5}}]}, 0.1 * np.pi),
        ({"receivers": [{"spin": {"radius_m": 0.1, "rate_hz": -0.5}}]}, None),
        ({"speed_max_m_s": 30.0, "receivers": [{"spin": {"radius_m": 0.1, "rate_hz": 0.5}}]}, 30.0 + 0.1 * np.pi),
    ],
)
def test_no_antenna_is_faster_than_the_platform_and_its_arm(tables: dict[str, Any], speed_m_s: float | None) -> None:
    settings, _ = find_unused(names=["a"], **tables)
    assert settings.speed_max_m_s == (speed_m_s if speed_m_s is None else pytest.approx(speed_m_s))


def test_an_option_comes_before_the_platforms_speed() -> None:
    settings, remarks = find_unused(Settings(speed_max_m_s=5.0), speed_max_m_s=30.0)
    assert settings.speed_max_m_s == 5.0
    assert list_unused(remarks) == ["speed_max_m_s"]


def test_what_no_method_uses_stands_in_one_remark() -> None:
    tables = {
        "motion": "moving",
        "oscillator": "ocxo",
        "attitude": {"file": "a.csv", "sigma_deg": 1.0},
        "imu": {"file": "imu.csv"},
        "receivers": [{"line_bias_cyc": [0.1], "spin": {"radius_m": 0.1, "rate_hz": 0.5}}],
    }
    _, remarks = find_unused(names=["a"], **tables)
    keys = "motion, attitude, receivers[0].line_bias_cyc"
    assert list_unused(remarks) == [keys]


def test_inputs_and_names_come_from_the_platform(tmp_path: Path) -> None:
    platform = Platform.model_validate({"receivers": [{"name": "rx1", "inputs": ["a.bin"]}, {"inputs": ["b.obs"]}]})
    assert select_inputs(platform, []) == ([(Path("a.bin"),), (Path("b.obs"),)], ["rx1", None])
    assert list(match_tables(platform, ["rx1", "b"]).items()) == [
        ("rx1", platform.receivers[0]),
        ("b", platform.receivers[1]),
    ]
    assert select_inputs(Platform(), ["c.bin"]) == ([Path("c.bin")], [None])
    assert match_tables(Platform(), ["c"]) == {}
    alone = Platform.model_validate({"receivers": [{"body_m": [1.0, 0.0, 0.0]}]})
    assert match_tables(alone, ["c"]) == {"c": alone.receivers[0]}


PAIR_M = [[0, 0, 0], [0.2, 0, 0]]


@pytest.mark.parametrize(
    ("receivers", "given", "inputs", "called"),
    [
        ([{"name": "rx", "inputs": ["a", "b"]}], [], [("a", "b")], ["rx"]),
        ([{"antennas_m": PAIR_M}], ["a", "b"], [("a", "b")], [None]),
        ([{"antennas_m": PAIR_M}], ["both"], [("both",)], [None]),
        (
            [{"name": "rx", "antennas_m": PAIR_M}, {"name": "b"}],
            ["rx.bin", "b.bin"],
            [("rx.bin",), "b.bin"],
            [None] * 2,
        ),
        ([{"antennas_m": PAIR_M}], ["a", "b", "c"], ["a", "b", "c"], [None] * 3),
        ([{"body_m": [0, 0, 0]}], ["channels"], ["channels"], [None]),
    ],
)
def test_antennas_of_a_receiver_are_opened_as_one(receivers: Any, given: list[str], inputs: Any, called: Any) -> None:
    wanted = [tuple(map(Path, paths)) if isinstance(paths, tuple) else Path(paths) for paths in inputs]
    assert select_inputs(Platform.model_validate({"receivers": receivers}), given) == (wanted, called)


@pytest.mark.parametrize(
    ("receivers", "given", "words"),
    [
        ([{"inputs": ["a"]}], ["b"], r"p\.toml: receivers\[0\] .*command line"),
        ([{"inputs": ["a"]}, {"name": "b"}], [], r"p\.toml: receivers\[1\] has no"),
    ],
)
def test_inputs_that_do_not_fit_the_platform_are_refused(receivers: Any, given: list[str], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        select_inputs(Platform.model_validate({"receivers": receivers}), given, "p.toml")


@pytest.mark.parametrize(
    ("receivers", "words"),
    [
        ([{"name": "a"}, {"name": "c"}], r"p\.toml: receivers\[1\] is c, .*\ba, b;"),
        ([{"name": "a"}, {}], r"p\.toml: receivers\[1\] is without .*\ba, b\b"),
    ],
)
def test_a_table_of_no_receiver_of_the_run_is_refused(receivers: Any, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        match_tables(Platform.model_validate({"receivers": receivers}), ["a", "b"], "p.toml")


@given(st.floats(-89.0, 89.0), st.floats(-180.0, 180.0), st.lists(st.floats(-3e4, 3e4), min_size=3, max_size=3))
def test_positions_anywhere_give_back_the_baseline(lat_deg: float, lon_deg: float, enu_m: list[float]) -> None:
    first = {"lat_deg": lat_deg, "lon_deg": lon_deg, "height_m": 4e4, "sigma_m": 1.0}
    place = Platform.model_validate({"receivers": [{"position": first}]}).receivers[0].position
    assert place is not None
    moved_m = place.ecef_m + rot_enu_ecef(np.radians(lat_deg), np.radians(lon_deg)).T @ enu_m
    lat, lon, height_m = geodetic_from_ecef(moved_m)
    second = {"lat_deg": float(np.degrees(lat)), "lon_deg": float(np.degrees(lon)), "height_m": float(height_m)}
    receivers = [{"name": "a", "position": first}, {"name": "b", "position": second | {"sigma_m": 1.0}}]
    settings, _ = find_unused(names=["a", "b"], receivers=receivers)
    assert settings.antennas_enu_m is not None
    np.testing.assert_allclose(settings.antennas_enu_m["b"], enu_m, atol=1e-5)
