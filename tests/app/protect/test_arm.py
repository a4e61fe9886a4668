"""The scene of the turning arm as a receiver's own measurements, ten a second in RINEX, through all of `protect`."""

import numpy as np
import pytest
import tomli_w

from skyproof.app.common.rinex import write_channels
from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import draw, make_ideal_measurements
from skyproof.simulator.scenes import read_ready_made
from skyproof.simulator.sky import make_scene

FROM_DEG = 160.0, 55.0


@pytest.fixture(scope="module")
def measurements():
    """Simulate the scene: its measurements, the label of each signal, and the orbits."""
    scene = make_scene(read_ready_made("spin"), make_navigation(read_ready_made("spin")))
    (observations,), labels = draw(make_ideal_measurements(scene, interval_s=0.1), rng=np.random.default_rng(3))
    return observations, {ref.signal: label for ref, label in labels.items()}, scene


def judge_signals(measured, folder, *, attacked=True, rate_hz=-0.25, rate_sigma_hz=0.0):
    """Run the command on the strongest signal of each satellite, or on the true one."""
    o, labels, scene = measured
    wanted = {}
    for signal in o.signals:
        if labels[signal] == "authentic" or attacked:
            known = wanted.get(signal.sat)
            if known is None or labels[signal] == "spoofed":
                wanted[signal.sat] = signal
    write_channels(folder / "arm.obs", o, "unjudged", None, tuple(wanted.values()))
    write_nav(folder / "nav.rnx", scene.navigation)
    spin = {"radius_m": 0.0951468, "rate_hz": rate_hz, "rate_sigma_hz": rate_sigma_hz}
    table = {"name": "arm", "inputs": ["arm.obs"], "spin": spin}
    (folder / "platform.toml").write_text(tomli_w.dumps({"receivers": [table]}))
    result = protect(platform=folder / "platform.toml", nav=folder / "nav.rnx")
    said = {s.sat: s.label for s in result.verdict.signals}
    return result, said, {sat for sat, signal in wanted.items() if labels[signal] == "spoofed"}


CASES = {"as stated": {}, "rate wrong by 1 %": {"rate_hz": -0.2475, "rate_sigma_hz": 0.0025}}


@pytest.mark.long
@pytest.mark.parametrize("stated", CASES.values(), ids=CASES.keys())
def test_rinex_ten_times_a_second_says_what_samples_say(measurements, tmp_path, stated):
    result, labels, false = judge_signals(measurements, tmp_path, **stated)
    assert false == {"G01", "G02"}
    assert result.verdict.verdict == "spoofed"
    assert {sat for sat, label in labels.items() if label == "spoofed"} == false
    assert {labels[sat] for sat in labels if sat not in false} == {"authentic"}
    seen = [item for source in result.verdict.sources for item in source.directions]
    level = np.cos(np.radians(FROM_DEG[1]))
    off_deg = [
        np.hypot((item.azimuth_deg - FROM_DEG[0]) * level, item.elevation_deg - FROM_DEG[1])
        / np.hypot(item.along_sigma_deg, item.up_sigma_deg)
        for item in seen
    ]
    assert min(off_deg) < 3.0
    fix = result.verdict.receivers[0].trusted_fix
    place_m = ecef_from_geodetic(*np.radians([fix.lat_deg, fix.lon_deg]), fix.height_m)
    sigma_m = np.linalg.norm([fix.sigma_east_m, fix.sigma_north_m, fix.sigma_up_m])
    assert np.linalg.norm(place_m - ecef_from_geodetic(*np.radians([28.23, 112.99]), 60.0)) < 4.0 * sigma_m


@pytest.mark.long
@pytest.mark.parametrize("stated", CASES.values(), ids=CASES.keys())
def test_no_true_signal_of_the_arm_is_called_false(measurements, tmp_path, stated):
    result, labels, false = judge_signals(measurements, tmp_path, attacked=False, **stated)
    assert not false
    assert result.verdict.verdict != "spoofed"
    assert "spoofed" not in labels.values()
