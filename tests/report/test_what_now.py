"""What the report advises its reader to do."""

import math
import re

import numpy as np
import pytest
from tests.report.sample import SAMPLE

from skyproof.gnss.time import format_clock
from skyproof.report.positions import radius_95_m
from skyproof.report.what_now import Advice, what_now
from skyproof.verdict import Verdict

FIX = SAMPLE["receivers"][0]["trusted_fix"]
FALSE = SAMPLE["receivers"][0]["false_fix"]


def make_verdict(word: str = "spoofed", **fixes: object) -> Verdict:
    kinds = ("trusted", "consistent", "inertial", "held", "false", "unprotected")
    receiver = SAMPLE["receivers"][0] | {f"{kind}_fix": None for kind in kinds} | fixes
    why = {"reason": "why", "not_excluded": ["a slow drag"]} if word != "spoofed" else {}
    return Verdict.model_validate(SAMPLE | {"verdict": word, "receivers": [receiver], "signals": []} | why)


def test_a_dragged_receiver_is_named_with_distance_and_remedy() -> None:
    use, ignore = what_now(make_verdict(trusted_fix=FIX, unprotected_fix=FALSE))
    assert use[0] is Advice.USE_TRUSTED
    assert "rx1-trusted.nmea" in use[1]
    assert ignore[0] is Advice.IGNORE_OTHERS
    assert re.search(r"rx1 .*\b902 m .*south-east; .*\b4\.46 µs behind$", ignore[1])


def test_an_attack_that_harms_nobody_yet_is_not_said_to_harm() -> None:
    _, wait = what_now(make_verdict(trusted_fix=FIX, unprotected_fix=FIX | {"lat_deg": FIX["lat_deg"] + 1e-5}))
    assert wait[0] is Advice.DO_NOT_WAIT


def test_a_position_of_the_signals_beside_false_ones_is_used_with_care() -> None:
    verdict = make_verdict(consistent_fix=FIX, unprotected_fix=FIX)
    window = {"receiver": "rx1", "word": "spoofed", "from_gpst": "2000-01-01T00:00:00", "to_gpst": FIX["gpst"]} | {
        "may_also_be": []
    }
    attacked = Verdict.model_validate(
        verdict.model_dump() | {"windows": [window], "since_latest_gpst": "2000-01-01T00:00:10"}
    )
    use, _ = what_now(attacked)
    assert use[0] is Advice.USE_OTHERS
    assert "rx1-consistent.nmea" in use[1]
    ended = attacked.model_copy(update={"since_latest_gpst": FIX["gpst"]})
    assert what_now(ended)[0][0] is Advice.USE_NOTHING


def test_without_a_trusted_position_no_satellite_is_to_be_used() -> None:
    [(action, why)] = what_now(make_verdict(false_fix=FALSE))
    assert action is Advice.USE_NOTHING
    assert f" {format_clock('2022-01-01T10:00:24')}" in why


def test_a_trusted_position_that_has_ended_is_none_for_now() -> None:
    old = FIX | {"gpst": "2022-01-01T10:00:30"}
    assert what_now(make_verdict(trusted_fix=old, unprotected_fix=FALSE))[0][0] is Advice.USE_NOTHING


@pytest.mark.parametrize("kind", ["inertial", "held"])
@pytest.mark.parametrize("word", ["spoofed", "suspect"])
def test_a_position_that_no_signal_moves_may_be_used(kind: str, word: str) -> None:
    old = FIX | {"gpst": "2022-01-01T10:00:30", "hidden_m": 40.0}
    fixes = {"consistent_fix": old, f"{kind}_fix": FIX | {"hidden_m": 40.0}, "unprotected_fix": FALSE}
    verdict = make_verdict(word, **fixes)
    assert verdict.receivers[0].usable[0] == kind
    assert what_now(verdict)[0][0] is Advice.USE_CARRIED
    alone = make_verdict(word, consistent_fix=old, unprotected_fix=FALSE)
    assert what_now(alone)[0][0] in (Advice.USE_NOTHING, Advice.RELY_ON_NOTHING)


def test_a_consistent_position_may_be_used_but_is_unproven() -> None:
    verdict = make_verdict("no_attack_seen", consistent_fix=FIX | {"hidden_m": 40.0}, unprotected_fix=FIX)
    (action, why), *_ = what_now(verdict)
    assert (action, "rx1-consistent.nmea" in why) == (Advice.GO_ON, True)
    (words,) = (words for heading, words in verdict.explained if heading == "Position:")
    assert re.search(r"^rx1 is consistent, .* 2\.\d m .*\b40 m at most", words)


@pytest.mark.parametrize(
    ("word", "what"),
    [("authentic", Advice.NOTHING), ("no_attack_seen", Advice.GO_ON), ("suspect", Advice.RELY_ON_NOTHING)],
)
def test_other_verdicts_have_a_line_too(word: str, what: Advice) -> None:
    assert what_now(make_verdict(word))[0][0] is what


@pytest.mark.parametrize("ratio", [0.0, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("turn_rad", [0.0, 0.6, 0.25 * math.pi])
def test_the_radius_holds_95_per_cent_of_errors_of_any_shape(ratio: float, turn_rad: float) -> None:
    rng = np.random.default_rng(4)
    major, minor = rng.normal(0.0, 1.0, 40_000), rng.normal(0.0, ratio, 40_000)
    sigma_east_m = math.hypot(math.cos(turn_rad), ratio * math.sin(turn_rad))
    sigma_north_m = math.hypot(math.sin(turn_rad), ratio * math.cos(turn_rad))
    held = float(np.mean(np.hypot(major, minor) <= radius_95_m(sigma_east_m, sigma_north_m)))
    assert 0.9465 < held < 0.982
