"""What a receiver without samples measures of a scene."""

import numpy as np

from skyproof.studies.random_scenes import build_scene, draw_scene
from skyproof.studies.receiver_model import ChannelNoise, model_receptions


def test_a_clean_sky_is_followed_whole_by_every_receiver():
    scene = build_scene(draw_scene("clean-3")).scene
    receptions = model_receptions(scene, ChannelNoise(code_m=0.5, field=False), rng=np.random.default_rng(1))
    for known, sky in zip(receptions, scene.skies, strict=True):
        o = known.reception.observations
        assert {s.sat for s in o.signals} == {signal.id.sat for signal in sky.signals}
        assert {s.copy for s in o.signals} == {"a"}
        assert (o.status[3:] == 0).all()
        assert np.nanmax(known.false_share) == 0.0
