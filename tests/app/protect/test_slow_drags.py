"""Drags that an inertial unit learns of before any test notices, behind drawn correlators."""

import numpy as np
import pytest
import tomli_w
from tests.app.protect.test_first_words import change_attack

from skyproof.app.protect.coasting import usable_fixes
from skyproof.gnss.frames import heading_pitch_roll_rad
from skyproof.simulator import make_navigation
from skyproof.simulator.files import write_series
from skyproof.simulator.scenario import SceneImu
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene
from skyproof.studies.protection.errors import fix_errors

ONSET_S, DRAG_M_S = 36.0, 1.0


def protect_drag(folder, grade):
    """Protect the aircraft of `las-vegas`, dragged from within a window on."""
    off_m = DRAG_M_S * 120.0 / np.sqrt(2.0)
    away = ((ONSET_S, 0.0, 0.0, 0.0), (ONSET_S + 120.0, off_m, 0.0, off_m))
    scenario = change_attack("las-vegas", ONSET_S + 134.0, away_points_enu_m=away)
    (receiver,) = scenario.receivers
    receiver = receiver.model_copy(update={"imu": SceneImu(grade=grade, rate_hz=100.0)})
    scenario = scenario.model_copy(update={"receivers": (receiver,)})
    navigation = make_navigation(scenario)
    scene = make_scene(scenario, navigation)
    write_series(scene, folder)
    at = scene.trajectories[receiver.name].at(np.zeros(1))
    angles = np.degrees(heading_pitch_roll_rad(at.position_ecef_m[0], at.attitude[0]))
    initial = dict(zip(("heading_deg", "pitch_deg", "roll_deg"), map(float, angles), strict=True)) | {"sigma_deg": 0.1}
    platform = folder / "platform.toml"
    imu = {"file": f"{receiver.name}-imu.csv", "grade": grade, "initial": initial}
    platform.write_text(tomli_w.dumps({"motion": "moving", "receivers": [{"name": receiver.name}], "imu": imu}))
    return scene, protect_scene(scene, navigation, platform, scenario.seed)[1]


@pytest.mark.long
@pytest.mark.parametrize(("grade", "most_m"), [("tactical", 110.0), ("navigation", 10.0)])
def test_a_unit_that_a_drag_has_taught_chooses_no_false_sky(tmp_path, grade, most_m):
    scene, outcome = protect_drag(tmp_path, grade)
    errors = [fix_errors(scene, scene.skies[0], fix) for _, fix in usable_fixes(outcome.receivers[0].positions)]
    space_m, bound_m = (
        np.concatenate(values)
        for values in (
            [each.space_m for each in errors],
            [each.space_bound_m + np.nan_to_num(each.hidden_m, nan=np.inf) for each in errors],
        )
    )
    print(f"{grade}: {space_m.max():.1f} m off at worst, {np.max(space_m / bound_m):.2f} of its bound")
    assert (space_m <= bound_m).all()
    assert space_m.max() < most_m
