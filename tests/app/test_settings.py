"""The settings of a run: what is accepted, and that all of it reaches the verdict."""

import json

from skyproof.app.document import Outcome, document
from skyproof.app.settings import Settings
from skyproof.formats.verdict import verdict_json
from skyproof.fusion.fuse import fuse
from skyproof.records import NavigationData

EVERYTHING = {
    "antennas_enu_m": {"rx1": [0.0, 0.0, 0.0], "rx2": [48.0, -34.0, 0.8]},
    "place_deg": [57.7, 11.9],
    "duration_s": 30.0,
}  # beside what has a default


def test_every_setting_stands_in_the_verdict():
    nothing = Outcome(
        receivers=(), decision=fuse([], [], []), evidence=(), sets=(), navigation=NavigationData(ephemerides=())
    )
    verdict = document(nothing, [], Settings(**EVERYTHING))
    told = json.loads(verdict_json(verdict))["settings"]
    assert set(told) == set(Settings.model_fields)
    assert told | EVERYTHING == told
