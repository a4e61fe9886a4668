"""The first word on attacks through the whole of `protect`, behind drawn correlators."""

import numpy as np
import pytest

from skyproof.app.protect.outcome import Outcome
from skyproof.records import FixStatus
from skyproof.simulator import make_navigation, read_ready_made
from skyproof.simulator.scenario import Scenario
from skyproof.simulator.sky import make_scene
from skyproof.studies.correlator_model import protect_scene
from skyproof.verdict import Verdict


def protect_drawn(scenario: Scenario, folder, **settings: str) -> tuple[Verdict, Outcome]:
    """Protect a scene without samples."""
    platform = folder / "platform.toml"
    lines = [f'{key} = "{value}"' for key, value in settings.items()]
    platform.write_text("\n".join(["[protect]", *lines]), encoding="utf-8")
    navigation = make_navigation(scenario)
    return protect_scene(make_scene(scenario, navigation), navigation, platform, 1)


def change_attack(name: str, duration_s: float, **changes: object) -> Scenario:
    """Return a ready-made scene with its attack changed."""
    scenario = read_ready_made(name)
    (attack,) = scenario.attacks
    return scenario.model_copy(update={"attacks": (attack.model_copy(update=changes),), "duration_s": duration_s})


@pytest.mark.parametrize(("place_of_onset", "most_s"), [(0.6, 10.0), (0.9, 14.0)])
def test_a_loud_takeover_is_dated_to_three_seconds(tmp_path, place_of_onset: float, most_s: float) -> None:
    # Ten decibels over the true signals, on top of them; nothing is drawn off within the recording.
    onset_s = 20.0 + 10.0 * place_of_onset
    scenario = change_attack("takeover", 42.0, onset_s=onset_s, power_db=10.0, power_points_db=(), away_points_enu_m=())
    _, outcome = protect_drawn(scenario, tmp_path)
    failed = [e for e in outcome.evidence if e.failed and e.data.get("test") == "entered"]
    since_s = [float((e.dated_gpst - scenario.start_gpst) / np.timedelta64(1, "s")) - onset_s for e in failed]
    word_s = [float((e.end_gpst - scenario.start_gpst) / np.timedelta64(1, "s")) - onset_s for e in failed]
    assert abs(since_s[0]) < 3.0
    assert 0.0 < word_s[0] < most_s
    assert not [e for e in outcome.evidence if e.failed and e not in failed and e.end_gpst < failed[0].end_gpst]


@pytest.mark.parametrize(
    ("name", "changes", "false", "left", "tracking"),
    [
        ("vector-one-spoofer", {}, {"G02"}, 5, "vector"),
        ("vector-one-spoofer", {}, {"G02"}, 5, "scalar"),
        ("vector-one-spoofer", {"sat_code_m": {"G02": 146.5}}, {"G02"}, 5, "vector"),  # it stays in the filter
        ("vector-many", {}, {"G12", "G13", "G17"}, 3, "vector"),
        ("vector-many", {}, {"G12", "G13", "G17"}, 3, "scalar"),
    ],
)
def test_codes_that_leave_their_dopplers_are_named_and_the_others_go_on(
    tmp_path, name: str, changes: dict, false: set[str], left: int, tracking: str
) -> None:
    verdict, outcome = protect_drawn(change_attack(name, 14.0, **changes), tmp_path, tracking=tracking)
    assert verdict.verdict == "spoofed"
    assert {ref.signal.sat for source in outcome.decision.sources for ref in source.signals} == false
    first = next(e for e in outcome.evidence if e.says == "spoofed")
    assert first.detector == "code_doppler"
    assert first.end_gpst - read_ready_made(name).start_gpst < np.timedelta64(15, "s")
    (receiver,) = outcome.receivers
    assert receiver.has_rest_fixes == (left > 4)
    if left > 4:
        fix = receiver.positions.whole("consistent")
        assert (fix.status == FixStatus.OK).sum() > 0.9 * fix.gpst.size
        assert len(fix.signals) == left
        assert "one satellite at most" in verdict.assumed
