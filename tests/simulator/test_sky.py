"""Delays against closed forms from the places, against models called directly, and against another simulator."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.simulator.exact import compute_delays

from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss.atmosphere import compute_klobuchar_s
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.orbits import compute_satellite_state
from skyproof.gnss.sky import compute_unit_vectors, rotate_to_reception
from skyproof.gnss.time import week_and_tow
from skyproof.records import SignalRef
from skyproof.simulator.received import ReceiverSky, Scene
from skyproof.simulator.scenario import Scenario, ScenePlace, Spoofer, parse_scenario
from skyproof.simulator.sky import make_scene

MM = 1e-3


@pytest.fixture(scope="module")
def scene(scenario: Scenario, navigation: NavigationData) -> Scene:
    return make_scene(scenario, navigation)


def convert_ecef(place: ScenePlace) -> np.ndarray:
    return ecef_from_geodetic(np.radians(place.lat_deg), np.radians(place.lon_deg), place.height_m)


def list_delays_m(sky: ReceiverSky, true_s: float, *, label: str, kind: str) -> tuple[list[str], np.ndarray]:
    """List satellites and delays of the signals with this label, in metres."""
    columns = [column for column, heard in enumerate(sky.signals) if heard.label == label]
    spline = sky.code_delay_s if kind == "code" else sky.carrier_delay_s
    return [sky.signals[c].id.sat for c in columns], SPEED_OF_LIGHT_M_S * spline(true_s)[columns]


@pytest.mark.parametrize("kind", ["code", "carrier"])
def test_double_differences_of_false_signals_are_zero(scene: Scene, kind: str) -> None:
    (sats, one_m), (same, two_m) = (list_delays_m(sky, 2.0, label="spoofed", kind=kind) for sky in scene.skies)
    single_m = two_m - one_m
    assert sats == same
    assert len(sats) >= 8
    assert np.abs(single_m - single_m[0]).max() < MM
    assert single_m[0] == pytest.approx(scene.path_m[0, 1] - scene.path_m[0, 0], abs=MM)


@pytest.mark.parametrize("kind", ["code", "carrier"])
def test_double_differences_are_the_baseline_on_sight_lines(
    scene: Scene, navigation: NavigationData, kind: str
) -> None:
    first, second = scene.scenario.receivers
    true_s = 2.0
    (sats, one_m), (_, two_m) = (list_delays_m(sky, true_s, label="authentic", kind=kind) for sky in scene.skies)
    middle = 0.5 * (convert_ecef(first) + convert_ecef(second))
    sights = []
    for sat in sats:
        ephemeris = navigation.best(sat, scene.scenario.start_gpst)
        assert ephemeris is not None
        sent = scene.scenario.start_gpst + np.timedelta64(round((true_s - 0.075) * 1e9), "ns")
        sat_ecef_m = rotate_to_reception(compute_satellite_state(ephemeris, sent).position_ecef_m, 0.075)
        sights.append(compute_unit_vectors(middle, sat_ecef_m))
    expected_m = -np.array(sights) @ (convert_ecef(second) - convert_ecef(first))
    double_m = (two_m - one_m) - (two_m - one_m)[0]
    assert np.abs(expected_m - expected_m[0]).max() > 30.0
    assert np.abs(double_m - (expected_m - expected_m[0])).max() < MM


def test_code_minus_carrier_is_twice_the_ionosphere(scene: Scene, navigation: NavigationData) -> None:
    assert navigation.ionosphere is not None
    _, tow_s = week_and_tow(scene.scenario.start_gpst)
    sky, knot = scene.skies[0], 4
    true_s = float(sky.knots_s[knot])
    apart_s = sky.code_delay_s(true_s) - sky.carrier_delay_s(true_s)
    for column, heard in enumerate(sky.signals):
        place = sky.receiver if heard.label == "authentic" else scene.scenario.attacks[0].shows
        ionosphere_s = compute_klobuchar_s(
            navigation.ionosphere,
            np.radians(place.lat_deg),
            np.radians(place.lon_deg),
            sky.az_rad[knot, column],
            sky.el_rad[knot, column],
            tow_s + true_s,
        )
        assert apart_s[column] == pytest.approx(2.0 * ionosphere_s, abs=1e-13)
        assert ionosphere_s > 1e-9


def test_splines_between_knots_keep_a_tenth_of_a_millimetre(scene: Scene, navigation: NavigationData) -> None:
    sky = scene.skies[1]
    true_s = np.linspace(-0.2, 3.2, 101)
    for column, heard in enumerate(sky.signals):
        if heard.label == "authentic":
            ephemeris = navigation.best(heard.id.sat, scene.scenario.start_gpst)
            assert ephemeris is not None
            exact = compute_delays(sky.receiver, ephemeris, navigation, scene.scenario.start_gpst, true_s)
            for spline, exact_s in ((sky.code_delay_s, exact.code_s), (sky.carrier_delay_s, exact.carrier_s)):
                assert SPEED_OF_LIGHT_M_S * np.abs(spline(true_s)[:, column] - exact_s).max() < 1e-4


def test_a_copy_is_as_strong_as_asked_and_fades_with_distance(scenario: Scenario, navigation: NavigationData) -> None:
    attack = scenario.attacks[0].model_copy(update={"power_db": 3.0, "sat_db": {}})
    scene = make_scene(scenario.model_copy(update={"attacks": (attack,)}), navigation)
    excess_db = []
    for sky in scene.skies:
        cn0 = dict(zip(((h.id.sat, h.label) for h in sky.signals), sky.cn0_dbhz(1.0), strict=True))
        excess_db.append([cn0[sat, "spoofed"] - cn0[sat, "authentic"] for sat, label in cn0 if label == "spoofed"])
    assert np.allclose(excess_db[0], 3.0, atol=1e-9)
    fading_db = 20.0 * np.log10(scene.path_m[0, 1] / scene.path_m[0, 0])
    assert abs(fading_db) > 1.0
    assert np.allclose(excess_db[1], 3.0 - fading_db, atol=1e-3)


def test_a_spoofer_shows_its_false_place_and_clock(scenario: Scenario, navigation: NavigationData) -> None:
    # What reaches the receiver is what a receiver at the false place hears, later by the way and the false clock.
    shows = ScenePlace(lat_deg=40.3, lon_deg=-3.2, height_m=900.0)
    spoofer = Spoofer(transmit=scenario.attacks[0].transmit, shows=shows, clock_offset_s=-2.5e-3)
    scene = make_scene(scenario.model_copy(update={"attacks": (spoofer,)}), navigation)
    sky, true_s = scene.skies[0], 1.0
    added_s = scene.path_m[0, 0] / SPEED_OF_LIGHT_M_S - 2.5e-3
    for column, heard in enumerate(sky.signals):
        if heard.label == "spoofed":
            ephemeris = navigation.best(heard.id.sat, scenario.start_gpst)
            assert ephemeris is not None
            shown_s = compute_delays(shows, ephemeris, navigation, scenario.start_gpst, true_s - added_s)
            assert sky.code_delay_s(true_s)[column] == pytest.approx(float(shown_s.code_s) + added_s, abs=1e-13)


def test_labels_name_every_signal_of_every_receiver(scene: Scene) -> None:
    labels = scene.labels
    assert len(labels) == sum(len(sky.signals) for sky in scene.skies)
    heard = next(heard for heard in scene.skies[0].signals if heard.label == "spoofed")
    assert labels[SignalRef("one", heard.id)] == "spoofed"
    assert heard.id.copy == "b"
    assert heard.from_s == pytest.approx(1.5 + scene.path_m[0, 0] / SPEED_OF_LIGHT_M_S, abs=1e-12)


def test_the_clock_inverts(scene: Scene) -> None:
    sky, elapsed_s = scene.skies[1], np.array([0.0, 1.7, 2.9])
    true_s = elapsed_s + sky.true_minus_elapsed_s(elapsed_s)
    assert true_s[0] == pytest.approx(-4.1e-4)
    assert np.allclose(sky.elapsed_at(true_s), elapsed_s, atol=1e-15)
    # 1.1 ppm slow: the true time runs ahead
    assert (true_s[2] - true_s[0]) / 2.9 - 1.0 == pytest.approx(1.1e-6, rel=1e-5)


# --- the rendered pair, made by another program from the same places and the same navigation file


def _make_pair(truth: dict[str, Any]) -> Scenario:
    def place(position: dict[str, float]) -> dict[str, float]:
        return {"lat_deg": position["lat_deg"], "lon_deg": position["lon_deg"], "height_m": position["h_m"]}

    meaconer = truth["transmitters"][0]
    return parse_scenario(
        {
            "start_gpst": truth["epoch_gpst"],
            "duration_s": truth["duration_s"],
            "mask_deg": truth["mask_deg"],
            "receivers": [
                {
                    "name": receiver["name"],
                    **place(receiver["position"]),
                    "lo_ppm": receiver["lo_ppm"],
                    "start_offset_s": receiver["true_start_after_epoch_s"],
                    "clock_offset_s": receiver["clock_offset_at_start_s"],
                }
                for receiver in truth["receivers"]
            ],
            "attacks": [
                {
                    "kind": "meaconer",
                    "receive": place(meaconer["receive_antenna"]),
                    "transmit": place(meaconer["transmit_antennas"][0]),
                    "delay_s": meaconer["processing_delay_s"],
                    "onset_s": meaconer["onset_after_epoch_s"],
                }
            ],
        }
    )


@pytest.mark.shared_data
def test_delays_and_doppler_agree_with_another_simulator(shared_data: Path) -> None:
    folder = shared_data / "rf" / "meaconing-pair"
    truth = json.loads((folder / "truth.json").read_text())
    navigation = read_nav(shared_data / "rf" / "brdc0010.22n")
    scene = make_scene(_make_pair(truth), navigation)
    with open(folder / "truth.csv", encoding="ascii") as lines:
        rows = [row for row in csv.DictReader(lines)]
    assert len({heard.id.sat for heard in scene.skies[0].signals}) == len(truth["authentic_prns"])
    compared = 0
    for sky, receiver in zip(scene.skies, truth["receivers"], strict=True):
        for column, heard in enumerate(sky.signals):
            mine = [
                row
                for row in rows
                if row["receiver"] == receiver["name"]
                and row["label"] == heard.label
                and int(row["prn"]) == int(heard.id.sat[1:])
            ]
            table = {
                key: np.array([float(row[key]) for row in mine])
                for key in ("tow_s", "code_delay_s", "carrier_delay_s", "doppler_hz")
            }
            true_s = table["tow_s"] - truth["epoch_tow_s"]
            # places are given to 1e-9 degrees, 0.1 mm; nothing else should differ
            for spline, key in ((sky.code_delay_s, "code_delay_s"), (sky.carrier_delay_s, "carrier_delay_s")):
                assert SPEED_OF_LIGHT_M_S * np.abs(spline(true_s)[:, column] - table[key]).max() < 0.5 * MM
            # that simulator's oscillators wander by a sinusoid, which ours do not have
            wander = receiver["wander"]
            turn = 2.0 * np.pi / wander["period_s"]
            drift = wander["amp_s"] * turn * np.cos(turn * true_s + wander["phase_rad"])
            ahead = sky.receiver.lo_ppm * 1e-6 / (1.0 + sky.receiver.lo_ppm * 1e-6)  # by its own seconds
            around_s = sky.carrier_delay_s(true_s + np.array([[-0.01], [0.01]]))[..., column]
            delay_rate = (around_s[1] - around_s[0]) / 0.02
            doppler_hz = -L1_HZ * (ahead + drift + (1.0 - ahead) * delay_rate)
            assert np.abs(doppler_hz - table["doppler_hz"]).max() < 0.01  # 2 mm/s
            compared += len(mine)
    assert compared > 2500
