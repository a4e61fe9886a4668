"""Some satellites imitated, from several antennas: what is said of every signal, at the level of measurements."""

import numpy as np
import pytest

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.protect import judge
from skyproof.app.protect.document import document
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.simulator.scenes import read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.studies.receiver_model import ChannelNoise, model_receptions


@pytest.fixture(scope="module")
def measurements():
    """Simulate what both receivers of a ready-made scene measure, and the orbits."""
    made = {}

    def heard(name):
        if name not in made:
            scenario = read_ready_made(name).model_copy(update={"duration_s": 56.0})
            navigation = make_nominal_constellation(scenario.start_gpst)
            scene = make_scene(scenario, navigation)
            observed = model_receptions(scene, ChannelNoise(code_m=0.5), rng=np.random.default_rng(1))
            made[name] = observed, navigation
        return made[name]

    return heard


def judge_scene(heard, **given):
    """Return the outcome, its document, and (label, whether false) of every signal's epochs."""
    observed, navigation = heard
    settings = Settings(**given)
    outcome, _ = judge([h.reception for h in observed], navigation, settings, Silent())
    share = {h.reception.observations.receiver: (h.reception.observations, h.false_share) for h in observed}
    epochs: dict[tuple[str, bool], int] = {}
    for s in outcome.decision.labels:
        o, false = share[s.ref.receiver]
        mean = float(np.nanmean(false[s.first_epoch : s.last_epoch + 1, o.signals.index(s.ref.signal)]))
        key = s.label, mean > 0.5
        epochs[key] = epochs.get(key, 0) + s.last_epoch - s.first_epoch + 1
    return outcome, document(outcome, (), settings), epochs


def test_four_of_ten_from_two_antennas_are_always_an_attack(measurements):
    _, verdict, epochs = judge_scene(measurements("some-satellites"))
    assert verdict.verdict == "spoofed"
    assert "no sign" not in verdict.summary
    assert {label for label, _ in epochs} == {"unknown"}


def test_four_of_ten_from_two_antennas_are_named_by_distance(measurements):
    outcome, verdict, epochs = judge_scene(measurements("some-satellites"), antenna_distance_m=40.0)
    assert verdict.verdict == "spoofed"
    assert len(outcome.decision.sources) == 2
    assert set(epochs) <= {("authentic", False), ("spoofed", True), ("unknown", True)}
    assert epochs["spoofed", True] > 0.6 * sum(n for (_, false), n in epochs.items() if false)
    parts = [{ref.signal.sat for ref in source.signals} for source in outcome.decision.sources]
    assert sorted(map(sorted, parts)) == [["G07", "G21"], ["G17", "G29"]]
    assert all(source.one_antenna for source in outcome.decision.sources)


def test_a_shared_sky_is_named_whole_by_a_known_distance(measurements):
    _, verdict, epochs = judge_scene(measurements("two-antennas"), antenna_distance_m=20.0)
    assert verdict.verdict == "spoofed"
    assert len({sat for source in verdict.sources for sat in source.sats}) == 10
    assert set(epochs) == {("authentic", False), ("spoofed", True)}
