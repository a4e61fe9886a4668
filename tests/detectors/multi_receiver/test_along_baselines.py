"""Two skies near together: which of them is from one antenna, whatever the noise over time."""

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.one_antenna import TrackNoise
from skyproof.detectors.multi_receiver.pairing import compare_pairings, pair_up
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.statistics.distributions import binomial_survival
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

NEAR = {"rx1": (0.0, 0.0, 0.0), "rx2": (4.0, 3.0, 0.0)}
ELSEWHERE = FalseSky(antenna_enu_m=(-300.0, 400.0, 10.0), shows_enu_m=(700.0, -200.0, 5.0), delay_m=900.0)


def pairings(scene, rng):
    """Return the pairing of each copy in all receivers."""
    records = scene.records(rng)
    copies = sorted({signal.copy for o in records.observations for signal in o.signals})
    of_copy = [tuple(s for s in records.sets if {signal.copy for signal in s.signals} == {c}) for c in copies]
    return [pair_up(records, sets, TrackNoise(), min_satellites=5) for sets in of_copy]


@pytest.mark.parametrize("seed", range(4))
def test_the_sky_over_antennas_5_m_apart_is_no_false_one(seed):
    # The scatter over 30 s shows no noise law well enough: by it alone, none of these were decided.
    errors = TrackErrors(1.0, 0.5, 0.0)
    scene = MeasuredScene(antennas_enu_m=NEAR, false=(ELSEWHERE,), epochs=30, errors=errors, max_satellites=8)
    settings = MultiReceiverSettings(false_alarm_probability=1e-5)
    found = MultiReceiver(settings).examine(scene.records(np.random.default_rng(seed)))[0]
    said = {e.says: {ref.signal.copy for ref in e.signals} for e in found}
    assert said == {"spoofed": {"b"}, "authentic": {"a"}}
    true = next(e for e in found if e.says == "authentic")
    assert true.data["by"] == "skies"
    assert true.statistic > true.threshold


def test_stated_places_decide_what_the_noise_hides_and_wrong_ones_call_nothing_true():
    errors = TrackErrors(1.0, 0.9, 0.0)
    scene = MeasuredScene(antennas_enu_m=NEAR, false=(ELSEWHERE,), epochs=30, errors=errors, max_satellites=8)
    windows = [scene.records(np.random.default_rng(seed)) for seed in range(4)]

    def said(places_enu_m):
        settings = MultiReceiverSettings(false_alarm_probability=1e-5, antennas_enu_m=places_enu_m)
        for records in windows:
            found = MultiReceiver(settings).examine(records)[0]
            yield {e.says: {ref.signal.copy for ref in e.signals} for e in found if e.says in ("spoofed", "authentic")}

    decided = {"spoofed": {"b"}, "authentic": {"a"}}
    assert sum(words == decided for words in said(None)) < 4
    assert all(words == decided for words in said(NEAR))
    assert all("authentic" not in words for words in said({"rx1": (4.0, 3.0, 0.0), "rx2": (0.0, 0.0, 0.0)}))


@pytest.mark.parametrize(
    ("errors", "satellites"),
    [(TrackErrors(1.0, 0.95, 0.0), 6), (TrackErrors(0.3, 0.0, 2.0), 9), (TrackErrors(2.0, 0.5, 0.5), 12)],
)
def test_two_skies_of_one_antenna_each_are_distinguished_no_more_often_than_stated(errors, satellites):
    trials, alpha, rng = 250, 0.05, np.random.default_rng(satellites)
    scene = MeasuredScene(
        antennas_enu_m=NEAR, sky=(), false=(FalseSky(), ELSEWHERE), epochs=10, errors=errors, max_satellites=satellites
    )
    found = 0
    for _ in range(trials):
        one, other = pairings(scene, rng)
        found += compare_pairings(one, other).p_value < alpha
    assert binomial_survival(found, trials, alpha) > 1e-4


def test_far_false_places_and_clocks_do_not_show_as_noise():
    # Expected ranges are taken off at each set's own place: what remains is metres, not the 2e7 m of a range.
    scene = MeasuredScene(antennas_enu_m=NEAR, false=(ELSEWHERE,), errors=TrackErrors(0.1, 0.0, 0.0))
    for pairing in pairings(scene, np.random.default_rng(1)):
        near_m = pairing.near_place_m
        assert np.abs(near_m - near_m.mean(axis=0)).max() < 10.0
