"""Scenes drawn at random follow from their names."""

import pytest

from skyproof.errors import ScenarioError
from skyproof.studies.random_scenes import build_scene, draw_scene


def test_a_scene_follows_from_its_name():
    assert draw_scene("attack-3") == draw_scene("attack-3") != draw_scene("attack-4")


@pytest.mark.parametrize("name", ["attack", "attack-x", "storm-1"])
def test_a_name_of_no_scene_is_refused(name):
    with pytest.raises(ScenarioError):
        draw_scene(name)


def test_receivers_that_are_not_reached_keep_their_own_sky():
    names = (f"attack-{number}" for number in range(20))
    drawn = next(scene for scene in map(draw_scene, names) if len(scene.attack.reached) < len(scene.antennas_body_m))
    scene = build_scene(drawn).scene
    for number, sky in enumerate(scene.skies):
        false = any(signal.label == "spoofed" for signal in sky.signals)
        assert false == (number in drawn.attack.reached)
