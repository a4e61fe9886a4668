"""The settings of a run: what is accepted, and that all of it reaches the verdict."""

import json

import pytest

from skyproof.app.common.settings import Settings, resolve_settings
from skyproof.app.protect.document import document
from skyproof.app.protect.outcome import Outcome
from skyproof.errors import SettingsError
from skyproof.formats.verdict import write_verdict_json
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
    reported = json.loads(write_verdict_json(verdict))["settings"]
    assert set(reported) == set(Settings.model_fields)
    assert reported | EVERYTHING == reported


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"antenna_separation_m": 1e300}, r"antenna_separation_m = 1e\+300, .*\b100000\b"),
        ({"antenna_separation_m": 400.0}, r"antenna_separation_m = 400 .*\bmax_separation_m = 300;"),
        ({"place_deg": (999.0, 999.0)}, r"place_deg\[0\] = 999\.0, .*\b90\b.*; place_deg\[1\] = 999"),
        ({"place_deg": (1.0, float("nan"))}, r"place_deg\[1\] = nan"),
        (
            {"antennas_enu_m": {"a": (0.0, 1e9, 0.0)}},
            r"antennas_enu_m\.a\[1\] = 1000000000\.0, .*\b100000\b",
        ),
        ({"antennas_enu_m": {"a": (0.0, 1.0)}}, r"antennas_enu_m\.a\[2\] "),
        ({"antennas_enu_m": {"a": (0.0, float("inf"), 0.0)}}, r"antennas_enu_m\.a\[1\] = inf, "),
        ({"antenna_separation_m": 400.0}, r"\[protect\]"),
        ({"antenna_distance_m": "60"}, r'antenna_distance_m = "60", .*: 60$'),
        ({"antenna_distance_m": "sixty"}, r'antenna_distance_m = "sixty", .*number$'),
        ({"antenna_distance_m": True}, "antenna_distance_m = true, "),
        ({"place_deg": ("57.7", 11.9)}, r'place_deg\[0\] = "57.7", .*: 57\.7$'),
        ({"window_s": 1e300}, r"window_s = 1e\+300, .*\b100000\b"),
    ],
)
def test_a_setting_that_makes_no_sense_is_refused(options, words):
    with pytest.raises(SettingsError, match=words):
        resolve_settings(None, **options)
