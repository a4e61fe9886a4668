"""Positions from tens of milliseconds: simulated samples, and the recording of the meaconing pair before its onset."""

import json

import numpy as np
import pytest

from skyproof.app.receive.snapshot import snapshot
from skyproof.errors import NotEnoughData
from skyproof.formats.raw import open_raw
from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator import render_samples, scenes
from skyproof.simulator.scenario import FrontEnd, ScenePlace

START = np.datetime64("2024-03-03T11:59:58", "ns")
PLACE = ScenePlace(lat_deg=-33.9, lon_deg=18.4, height_m=40.0)


@pytest.fixture(scope="module")
def recording():
    front_end = FrontEnd(rate_hz=2_600_000, encoding="sign-magnitude", bits=2)
    scenario = scenes.make_clean(
        PLACE,
        START,
        duration_s=1.0,
        zenith_cn0_dbhz=48.0,
        horizon_cn0_dbhz=42.0,
        receivers=1,
        mask_deg=8.0,
        front_end=front_end,
        seed=4,
    )
    navigation = make_nominal_constellation(START)
    return render_samples(scenario, navigation)[0], navigation


@pytest.mark.parametrize(("start_s", "late_s"), [(0.1, -47.0), (0.7, 31.0)])
def test_50_ms_and_a_time_good_to_a_minute_give_the_place(recording, start_s, late_s):
    samples, navigation = recording
    rough = START + np.timedelta64(round(late_s * 1e9), "ns")
    result = snapshot(samples, navigation, rough_gpst=rough, start_s=start_s)
    assert result.coarse.status == 0
    error_m = np.linalg.norm(result.fix.position_ecef_m[0] - ecef_from_geodetic(*PLACE.geodetic_rad))
    sigma_m = np.sqrt(np.trace(result.fix.covariance_m2[0, :3, :3]))
    assert sigma_m < 20.0
    assert error_m < 4.0 * sigma_m
    assert abs(result.coarse.time_error_s + late_s) < 5.0 * result.coarse.time_sigma_s + 1e-3
    assert result.fix.signals == tuple(sorted(result.fix.signals))


def test_a_time_off_by_half_an_hour_is_reported(recording):
    samples, navigation = recording
    result = snapshot(samples, navigation, rough_gpst=START + np.timedelta64(1800, "s"))
    assert result.coarse.status == 4
    assert result.fix is None


def test_a_stretch_beyond_the_end_is_refused(recording):
    samples, navigation = recording
    with pytest.raises(NotEnoughData, match="stretch"):
        snapshot(samples, navigation, start_s=0.99)


@pytest.mark.shared_data
def test_50_ms_of_the_clean_part_of_the_meaconing_pair(shared_data):
    folder = shared_data / "rf"
    truth = json.loads((folder / "meaconing-pair" / "truth.json").read_text())["receivers"][0]
    samples = open_raw(folder / "meaconing-pair" / "rx1.bin")
    navigation = read_nav(folder / "brdc0010.22n")
    for start_s, late_s in ((1.5, 40.0), (9.5, -55.0), (17.5, 5.0)):
        rough = samples.start_gpst + np.timedelta64(round(late_s * 1e9), "ns")
        result = snapshot(samples, navigation, rough_gpst=rough, start_s=start_s)
        assert result.coarse.status == 0
        off_m = result.coarse.position_ecef_m - np.array(truth["position"]["ecef_m"])
        # Chi-square with three degrees exceeds 21.1 once in 10 000.
        assert off_m @ np.linalg.solve(result.coarse.covariance[:3, :3], off_m) < 21.1
        begin = np.datetime64(truth["true_start_gpst"]) - rough
        assert result.coarse.time_error_s == pytest.approx(begin / np.timedelta64(1, "s"), abs=0.015)
