"""Scenes that move, against closed forms from the places and a twin that solves each instant independently."""

from typing import Any

import numpy as np
import pytest
from tests.simulator.exact import compute_delays

from skyproof.errors import ScenarioError
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import ecef_from_geodetic, rot_enu_ecef
from skyproof.simulator.received import ReceiverSky, Scene
from skyproof.simulator.scenario import parse_scenario
from skyproof.simulator.sites import ScenePlace
from skyproof.simulator.sky import make_scene

MM = 1e-3
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / L1_HZ
PLACE = {"lat_deg": 40.0, "lon_deg": -3.0, "height_m": 650.0}
TRANSMIT = {"lat_deg": 40.003, "lon_deg": -3.002, "height_m": 690.0}
TABLE: dict[str, Any] = {
    "seed": 3,
    "start_gpst": "2023-03-04T05:06:07.25",
    "duration_s": 20.0,
    "receivers": [
        {
            "name": "ship",
            **PLACE,
            "path": {"kind": "circle", "radius_m": 80.0, "speed_m_s": 12.0},
            "antennas": [
                {"name": "1"},
                {"name": "2", "body_m": [0.19, 0.0, 0.0]},
                {"name": "3", "body_m": [0.095, 0.16, 0.0]},
                {"name": "arm", "spin": {"radius_m": 0.4, "rate_hz": 1.5, "start_deg": 30.0}},
            ],
        }
    ],
    "attacks": [{"kind": "meaconer", "receive": {**PLACE, "lat_deg": 40.02}, "transmit": TRANSMIT, "delay_s": 1e-6}],
}


def make_scene_with(navigation: NavigationData, **changes: Any) -> Scene:
    return make_scene(parse_scenario(TABLE | changes), navigation)


@pytest.fixture(scope="module")
def scene(navigation: NavigationData) -> Scene:
    return make_scene_with(navigation)


def list_columns(sky: ReceiverSky, label: str) -> list[int]:
    return [column for column, heard in enumerate(sky.signals) if heard.label == label]


def test_delays_are_those_of_each_instant_by_itself(scene: Scene, navigation: NavigationData) -> None:
    for sky in (scene.skies[0], scene.skies[3]):
        for true_s in (0.0, 7.3, 19.9):
            code_s, carrier_s = sky.delays_s(np.array([true_s]))
            place_ecef_m = sky.point(np.array([true_s])).position_ecef_m[0]
            for column in list_columns(sky, "authentic"):
                ephemeris = navigation.best(sky.signals[column].id.sat, scene.scenario.start_gpst)
                exact = compute_delays(place_of(place_ecef_m), ephemeris, navigation, scene.scenario.start_gpst, true_s)
                assert SPEED_OF_LIGHT_M_S * abs(code_s[0, column] - exact.code_s) < 0.2 * MM
                assert SPEED_OF_LIGHT_M_S * abs(carrier_s[0, column] - exact.carrier_s) < 0.2 * MM


def place_of(ecef_m: np.ndarray) -> ScenePlace:
    from_geodetic = np.array([40.0, -3.0, 650.0])
    for _ in range(6):  # Newton, so that no inverse of the package's own is trusted
        base = convert_ecef(from_geodetic)
        slopes = np.stack(
            [(convert_ecef(from_geodetic + step) - base) / step.sum() for step in np.diag([1e-6, 1e-6, 1e-3])]
        )
        from_geodetic = from_geodetic + np.linalg.solve(slopes.T, ecef_m - base)
    return ScenePlace(lat_deg=from_geodetic[0], lon_deg=from_geodetic[1], height_m=from_geodetic[2])


def convert_ecef(geodetic: np.ndarray) -> np.ndarray:
    return ecef_from_geodetic(np.radians(geodetic[0]), np.radians(geodetic[1]), geodetic[2])


@pytest.mark.parametrize("antenna", [1, 2, 3])
def test_antenna_phases_are_the_baseline_on_the_sight_lines(
    scene: Scene, navigation: NavigationData, antenna: int
) -> None:
    first, other = scene.skies[0], scene.skies[antenna]
    at_s = np.array([3.0, 11.5])
    for n, true_s in enumerate(at_s):
        baseline_m = (other.point(at_s).position_ecef_m - first.point(at_s).position_ecef_m)[n]
        double_m = SPEED_OF_LIGHT_M_S * (other.carrier_delay_s(true_s) - first.carrier_delay_s(true_s))
        for column in list_columns(first, "authentic"):
            sight = find_sight(scene, navigation, first.signals[column].id.sat, first, float(true_s))
            assert double_m[column] == pytest.approx(-sight @ baseline_m, abs=0.05 * MM)
        transmit = convert_ecef(np.array(list(TRANSMIT.values())))
        first_m, other_m = (sky.point(at_s).position_ecef_m[n] for sky in (first, other))
        path_m = np.linalg.norm(other_m - transmit) - np.linalg.norm(first_m - transmit)
        assert double_m[list_columns(first, "spoofed")] == pytest.approx(path_m, abs=0.05 * MM)  # one direction for all


def find_sight(scene: Scene, navigation: NavigationData, sat: str, sky: ReceiverSky, true_s: float) -> np.ndarray:
    """Find the unit vector to a satellite by differences of the twin's ranges."""
    ephemeris = navigation.best(sat, scene.scenario.start_gpst)
    place_m = sky.point(np.array([true_s])).position_ecef_m[0]

    def range_m(ecef_m: np.ndarray) -> float:
        return float(compute_delays(place_of(ecef_m), ephemeris, navigation, scene.scenario.start_gpst, true_s).range_m)

    return -np.array([(range_m(place_m + step) - range_m(place_m - step)) / 20.0 for step in 10.0 * np.eye(3)])


def test_the_spinning_arm_turns_as_described(scene: Scene) -> None:
    at_s = np.linspace(0.0, 2.0, 401)
    arm, body = scene.skies[3].point(at_s), scene.skies[0].point(at_s)
    in_body_m = np.einsum("nij,ni->nj", body.attitude, arm.position_ecef_m - body.position_ecef_m)
    angle_rad = np.unwrap(np.arctan2(in_body_m[:, 1], in_body_m[:, 0]))
    assert np.allclose(np.hypot(in_body_m[:, 0], in_body_m[:, 1]), 0.4, atol=1e-9)
    assert np.allclose(angle_rad, np.radians(30.0) + 2.0 * np.pi * 1.5 * at_s, atol=1e-8)


TAKEOVER: dict[str, Any] = {
    "kind": "takeover",
    "target": "ship",
    "transmit": TRANSMIT,
    "onset_s": 2.0,
    "phase": "aligned",
    "away_points_enu_m": [[5.0, 0.0, 0.0, 0.0], [15.0, 60.0, -20.0, 5.0]],
}


def test_a_takeover_starts_on_true_signals_and_leaves(navigation: NavigationData) -> None:
    sky = make_scene_with(navigation, attacks=[TAKEOVER]).skies[0]
    for true_s, away in ((4.0, (0.0, 0.0, 0.0)), (18.0, (60.0, -20.0, 5.0))):
        code_s, carrier_s = sky.delays_s(np.array([true_s]))
        true_columns, false_columns = list_columns(sky, "authentic"), list_columns(sky, "spoofed")
        assert [sky.signals[c].id.sat for c in true_columns] == [sky.signals[c].id.sat for c in false_columns]
        az, el = sky.az_rad[:, true_columns].mean(axis=0), sky.el_rad[:, true_columns].mean(axis=0)
        sights = np.stack([np.sin(az) * np.cos(el), np.cos(az) * np.cos(el), np.sin(el)], axis=1)
        for delay_s in (code_s, carrier_s):
            apart_m = SPEED_OF_LIGHT_M_S * (delay_s[0, false_columns] - delay_s[0, true_columns])
            assert apart_m == pytest.approx(-sights @ np.array(away), abs=0.05 * MM if not any(away) else 0.1)


def test_a_takeover_does_not_know_an_arms_angle(navigation: NavigationData, scene: Scene) -> None:
    alone = [{**TABLE["receivers"][0], "antennas": TABLE["receivers"][0]["antennas"][3:]}]
    sky = make_scene_with(navigation, receivers=alone, attacks=[TAKEOVER]).skies[0]
    at_s = np.array([3.0, 3.2, 3.4, 3.6])
    code_s, carrier_s = sky.delays_s(at_s)
    true_columns, false_columns = list_columns(sky, "authentic"), list_columns(sky, "spoofed")
    hub_m = scene.skies[0].point(at_s).position_ecef_m
    arm_m = sky.point(at_s).position_ecef_m - hub_m
    az, el = sky.az_rad[:, true_columns].mean(axis=0), sky.el_rad[:, true_columns].mean(axis=0)
    sights = np.stack([np.sin(az) * np.cos(el), np.cos(az) * np.cos(el), np.sin(el)], axis=1)
    here_rad = np.radians(PLACE["lat_deg"]), np.radians(PLACE["lon_deg"])
    by_satellite_m = arm_m @ (sights @ rot_enu_ecef(*here_rad)).T
    to_transmit_m = convert_ecef(np.array(list(TRANSMIT.values()))) - hub_m
    by_transmitter_m = np.sum(arm_m * to_transmit_m, axis=1) / np.linalg.norm(to_transmit_m, axis=1)
    for delay_s in (code_s, carrier_s):
        apart_m = SPEED_OF_LIGHT_M_S * (delay_s[:, false_columns] - delay_s[:, true_columns])
        assert apart_m == pytest.approx(by_satellite_m - by_transmitter_m[:, None], abs=2.0 * MM)
    assert np.ptp(apart_m, axis=0).max() > 0.2


def test_a_locked_carrier_stays_while_code_is_dragged_off(navigation: NavigationData) -> None:
    sky = make_scene_with(navigation, attacks=[TAKEOVER | {"carrier": "locked", "phase": "random"}]).skies[0]
    at_s = np.array([4.0, 16.0])
    code_s, carrier_s = sky.delays_s(at_s)
    apart_code_m = SPEED_OF_LIGHT_M_S * (
        code_s[:, list_columns(sky, "spoofed")] - code_s[:, list_columns(sky, "authentic")]
    )
    apart_cyc = L1_HZ * (carrier_s[:, list_columns(sky, "spoofed")] - carrier_s[:, list_columns(sky, "authentic")])
    assert np.abs(apart_code_m[1]).max() > 20.0
    assert np.allclose(apart_cyc[0], apart_cyc[1], atol=1e-3)
    phases = apart_cyc[0] % 1.0
    assert np.ptp(phases) > 0.2


def test_single_satellites_move_alone_in_code_and_doppler(navigation: NavigationData) -> None:
    plain = make_scene_with(navigation, attacks=[TAKEOVER]).skies[0]
    sats = [heard.id.sat for heard in plain.signals if heard.label == "spoofed"][:2]
    moved = make_scene_with(
        navigation, attacks=[TAKEOVER | {"sat_code_m": {sats[0]: 30.0}, "sat_doppler_hz": {sats[1]: 4.0}}]
    ).skies[0]
    at_s = np.array([12.0])
    late_s = (
        2.0
        + np.linalg.norm(plain.point(at_s).position_ecef_m[0] - convert_ecef(np.array(list(TRANSMIT.values())))) / 3e8
    )
    for which, sat, expected_m in ((0, sats[0], 30.0), (1, sats[1], -4.0 * (12.0 - late_s) * WAVELENGTH_M)):
        apart_m = SPEED_OF_LIGHT_M_S * (moved.delays_s(at_s)[which] - plain.delays_s(at_s)[which])[0]
        by_sat = {heard.id.sat: apart_m[c] for c, heard in enumerate(plain.signals) if heard.label == "spoofed"}
        assert by_sat.pop(sat) == pytest.approx(expected_m, abs=1e-4)
        assert all(abs(value) < 1e-6 for value in by_sat.values())


def test_satellites_of_another_antenna_come_from_there(navigation: NavigationData) -> None:
    plain = make_scene_with(navigation).skies[0]
    sats = [heard.id.sat for heard in plain.signals if heard.label == "spoofed"][:2]
    second = {**TRANSMIT, "lat_deg": 39.998, "sats": sats}
    sky = make_scene_with(navigation, attacks=[TABLE["attacks"][0] | {"antennas": [second]}]).skies[0]
    at_s = np.array([6.0])
    place_m = sky.point(at_s).position_ecef_m[0]
    delayed = [
        convert_ecef(np.array([site["lat_deg"], site["lon_deg"], site["height_m"]])) for site in (TRANSMIT, second)
    ]
    further_m = np.linalg.norm(place_m - delayed[1]) - np.linalg.norm(place_m - delayed[0])
    apart_m = SPEED_OF_LIGHT_M_S * (sky.code_delay_s(6.0) - plain.code_delay_s(6.0))
    for column, heard in enumerate(plain.signals):
        expected_m = further_m if heard.label == "spoofed" and heard.id.sat in sats else 0.0
        # the path is longer, and what arrives was received by that much earlier
        assert apart_m[column] == pytest.approx(expected_m, abs=0.01)


def test_power_follows_its_points_and_pauses_are_silent(navigation: NavigationData) -> None:
    times = {"power_points_db": [[4.0, 0.0], [8.0, 6.0]], "off_s": [[10.0, 11.0]], "onset_s": 1.0}
    attack = TABLE["attacks"][0] | times
    sky = make_scene_with(navigation, attacks=[attack], receivers=[{"name": "still", **PLACE}]).skies[0]
    false = list_columns(sky, "spoofed")
    level_dbhz = sky.cn0_dbhz(np.array([3.0, 6.0, 9.0]))[:, false]
    assert np.allclose(level_dbhz - level_dbhz[0], np.array([[0.0], [3.0], [6.0]]), atol=2e-2)
    late_s = (
        np.linalg.norm(convert_ecef(np.array([40.0, -3.0, 650.0])) - convert_ecef(np.array(list(TRANSMIT.values()))))
        / 299792458.0
    )
    for column in false:
        assert np.allclose(
            sky.signals[column].windows_s, [[1.0 + late_s, 10.0 + late_s], [11.0 + late_s, np.inf]], atol=1e-12
        )


def test_a_patch_antenna_favours_what_it_leans_to(navigation: NavigationData) -> None:
    level, leaning = (
        make_scene_with(
            navigation,
            attacks=[],
            receivers=[{"name": "one", **PLACE, "roll_deg": roll_deg, "antennas": [{"name": "1", "gain": "patch"}]}],
        ).skies[0]
        for roll_deg in (0.0, 30.0)
    )
    gained_db = leaning.cn0_dbhz(5.0) - level.cn0_dbhz(5.0)
    az, el = level.az_rad.mean(axis=0), level.el_rad.mean(axis=0)
    # heading north, the right side down: boresight leans to the east by 30 degrees
    expected_db = 10.0 * (np.sin(el) * np.cos(np.radians(30)) + np.cos(el) * np.sin(az) * 0.5 - np.sin(el))
    assert gained_db == pytest.approx(expected_db, abs=0.01)


STEEP = {"kind": "way-points", "speed_m_s": 5.0, "points_enu_m": [[0, 0, 0], [0, 90, -2000]]}
DOWN = {
    "kind": "way-points",
    "speed_m_s": 900.0,
    "from_rest": False,
    "to_rest": False,
    "points_enu_m": [[0, 0, 0], [0, 60000, -5000]],
}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"receivers": [{"name": "a", **PLACE, "path": STEEP}]}, ["receivers[0].path", "degrees"]),
        (
            {"receivers": [{"name": "a", **PLACE, "path": DOWN}], "duration_s": 60.0},
            ["receivers[0].path", "the ground"],
        ),
        ({"attacks": [TAKEOVER | {"target": "shp"}]}, ["attacks[0].target 'shp'", "'ship'"]),
        ({"attacks": [TAKEOVER | {"off_s": [[3.0, 3.05]]}]}, ["attacks[0]", "off_s"]),
        ({"attacks": [TAKEOVER | {"away_points_enu_m": [[5, 0, 0, 0], [4, 0, 0, 0]]}]}, ["rise"]),
        ({"receivers": [TABLE["receivers"][0] | {"heading_deg": 3.0}]}, ["receivers[0]", "heading_deg"]),
        ({"receivers": [TABLE["receivers"][0] | {"oscillator": "tcx"}]}, ["receivers[0]", "'tcxo'"]),
        ({"receivers": [{"name": "a", **PLACE, "multipath": [{"power_db": -6.0}]}]}, ["multipath[0]", "delay_m"]),
        ({"receivers": [{"name": "a", **PLACE, "imu": {"grade": "tactial"}}]}, ["receivers[0].imu", "'tactical'"]),
    ],
)
def test_what_makes_no_sense_is_refused(navigation: NavigationData, changes: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        make_scene_with(navigation, **changes)
    assert all(word in str(caught.value) for word in words), str(caught.value)
