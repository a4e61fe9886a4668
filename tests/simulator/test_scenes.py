"""The ready-made scenes are what they say."""

import numpy as np
import pytest

from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.time import week_and_tow
from skyproof.simulator.scenario import Scenario, ScenePlace
from skyproof.simulator.scenes import make_clean, make_demo
from skyproof.simulator.sky import make_scene

CHIP_M = 293.05


def measure_baseline_m(scenario: Scenario) -> float:
    places = [ecef_from_geodetic(*place.geodetic_rad) for place in scenario.receivers]
    return float(np.linalg.norm(places[1] - places[0]))


def test_the_demo_has_ten_satellites_each_with_a_copy_of_its_own() -> None:
    scenario = make_demo()
    scene = make_scene(scenario, make_nominal_constellation(scenario.start_gpst))
    assert measure_baseline_m(scenario) == pytest.approx(60.0, abs=5.0)
    for sky in scene.skies:
        code_m = 299_792_458.0 * sky.code_delay_s(20.0)
        by_label = {
            label: {heard.id.sat: code_m[column] for column, heard in enumerate(sky.signals) if heard.label == label}
            for label in ("authentic", "spoofed")
        }
        assert len(by_label["authentic"]) >= 10
        assert by_label["spoofed"].keys() == by_label["authentic"].keys()
        lags = np.array([by_label["spoofed"][sat] - by_label["authentic"][sat] for sat in by_label["authentic"]])
        assert lags.min() > 1.5 * CHIP_M


def test_the_demo_jams_until_a_stronger_false_sky_begins() -> None:
    scenario = make_demo()
    [jammer], [meaconer] = scenario.interference, scenario.attacks
    assert jammer.until_s == meaconer.onset_s
    assert jammer.power_db > scenario.sky.zenith_cn0_dbhz - 25.0  # nobody follows a signal below 25 dB-Hz
    assert meaconer.power_db >= 6.0


def test_the_demo_holds_a_whole_ephemeris_before_the_end() -> None:
    scenario = make_demo()
    _, tow_s = week_and_tow(scenario.start_gpst)
    until_subframe_1 = -tow_s % 30.0
    assert until_subframe_1 + 18.0 < scenario.duration_s


@pytest.mark.parametrize(
    "place",
    [ScenePlace(lat_deg=-33.0, lon_deg=179.9999, height_m=0.0), ScenePlace(lat_deg=70.0, lon_deg=25.0, height_m=300.0)],
)
def test_a_clean_scene_stands_where_and_when_it_is_asked(place: ScenePlace) -> None:
    scenario = make_clean(place, np.datetime64("2031-10-05T23:59:50"), baseline_m=100.0, receivers=3)
    assert measure_baseline_m(scenario) == pytest.approx(100.0, rel=0.01)
    assert len(scenario.receivers) == 3
    scene = make_scene(scenario, make_nominal_constellation(scenario.start_gpst))
    assert set(scene.labels.values()) == {"authentic"}
    assert all(len(sky.signals) >= 6 for sky in scene.skies)
