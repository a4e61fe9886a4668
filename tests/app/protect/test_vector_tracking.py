"""A vector receiver in `protect`: what its correlators say stands beside what codes and Dopplers do."""

import numpy as np
import pytest

from skyproof.app.protect import protect
from skyproof.formats.rinex_nav import write_nav
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.files import write, write_series
from skyproof.simulator.scenario import FrontEnd, SceneImu, SceneReceiver
from skyproof.simulator.sky import make_scene


def judge_scene(folder, **changes):
    """Run the command on 24 s of the scene with one false satellite of six, at a low rate."""
    front_end = FrontEnd(rate_hz=2.6e6, bandwidth_hz=2.4e6, encoding="sign-magnitude", bits=2)
    scene = scenes.read_ready_made("vector-one-spoofer").model_copy(
        update={"duration_s": 24.0, "front_end": front_end, **changes}
    )
    navigation = make_navigation(scene)
    write_nav(folder / "nav.rnx", navigation)
    result = protect(write(scene, navigation, folder), nav=folder / "nav.rnx", tracking="vector")
    return result, [item for item in result.outcome.evidence if item.detector == "vector_sqm"]


@pytest.mark.long
def test_the_false_satellite_is_named_and_no_true_one(tmp_path):
    result, labels = judge_scene(tmp_path)
    assert labels
    assert all(item.failed and item.data["suspects"] == ("G02 L1 CA a",) for item in labels)
    (method,) = [item for item in result.verdict.methods if item.detector == "vector_sqm"]
    assert (method.decision, method.p_value) == ("failed", min(item.p_value for item in labels))
    assert result.verdict.verdict == "spoofed"
    assert {signal.sat: signal.label for signal in result.verdict.signals}["G02"] == "spoofed"


@pytest.mark.long
def test_a_clean_sky_of_the_same_satellites_fits(tmp_path):
    scene = scenes.read_ready_made("vector-one-spoofer")
    sky = scene.sky.model_copy(update={"sats": tuple(item.sat for item in scene.sky.directions)})
    _, labels = judge_scene(tmp_path, attacks=(), sky=sky)
    assert [item.says for item in labels] == ["clean"] * len(labels)
    assert labels


@pytest.mark.long
def test_an_inertial_unit_carries_it_with_a_stated_attitude(tmp_path):
    receiver = SceneReceiver(
        name="rx1", lat_deg=57.7, lon_deg=11.94, height_m=50.0, imu=SceneImu(grade="tactical", rate_hz=100.0)
    )
    front_end = FrontEnd(rate_hz=1.6e6, bandwidth_hz=1.28e6, encoding="sign-magnitude", bits=2)
    scene = scenes.make_clean(
        receiver, np.datetime64("2024-05-14T09:59:58"), duration_s=8.0, receivers=1, front_end=front_end
    )
    scene = scene.model_copy(update={"receivers": (receiver,)})
    navigation = make_navigation(scene)
    write_nav(tmp_path / "nav.rnx", navigation)
    recordings = [path for path in write(scene, navigation, tmp_path) if path.name.startswith("rx1")]
    write_series(make_scene(scene, navigation), tmp_path)
    for stated, helped in (
        ("", False),
        ("initial = { heading_deg = 0, pitch_deg = 0, roll_deg = 0, sigma_deg = 0.2 }", True),
    ):
        platform = tmp_path / "platform.toml"
        platform.write_text(f'[imu]\nfile = "rx1-imu.csv"\ngrade = "tactical"\n{stated}\n', encoding="utf-8")
        result = protect(recordings, nav=tmp_path / "nav.rnx", platform=platform, tracking="vector")
        (one,) = result.outcome.receivers
        assert any("inertial" in remark for remark in one.reception.remarks) == helped
        assert any("vector" in remark for remark in one.reception.remarks)
