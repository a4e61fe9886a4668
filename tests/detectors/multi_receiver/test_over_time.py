"""Windows in a row: what they decide together, and that an attack that begins among them is not passed over."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.app.common.windows import cut
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.statistics.distributions import binomial_survival
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

WINDOW_S = 10
PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (4.0, 3.0, 0.0)}
GIVEN = {"places": {"antennas_enu_m": PLACES}, "distance": {"antenna_distance_m": 5.0}}
THERE = FalseSky(shows_enu_m=(0.0, 0.0, 0.0), delay_m=0.0)
"""Shows every receiver where the first one stands: nothing but the baseline is wrong."""
ERRORS = TrackErrors(1.0, 0.5, 0.5)


def make_scene(epochs=120, errors=ERRORS, **changes):
    return MeasuredScene(antennas_enu_m=PLACES, epochs=epochs, errors=errors, max_satellites=10, **changes)


def take_over(clean, false, since_s, until_s=np.inf):
    """`clean` records, whose channels follow the `false` scene's signals for a while: errors are the tracks' own."""
    observations = []
    for clean_o, true, other in zip(clean[0].observations, clean[1]._exact, false._exact, strict=True):
        taken = (clean_o.elapsed_s >= since_s) & (clean_o.elapsed_s < until_s)
        shift_m = np.where(taken[:, None], other.pseudorange_m - true.pseudorange_m, 0.0)
        observations.append(replace(clean_o, pseudorange_m=clean_o.pseudorange_m + shift_m))
    return replace(clean[0], observations=tuple(observations))


def make_windows(records):
    early = np.timedelta64(50, "ms")
    count = round(records.observations[0].gpst.size / WINDOW_S)
    for k in range(count):
        start, end = (records.start_gpst + np.timedelta64(WINDOW_S * n, "s") - (early if n else 0) for n in (k, k + 1))
        cuts = tuple(cut(o, start, end) for o in records.observations)
        yield replace(records, start_gpst=start, end_gpst=end, observations=cuts)


def examine_records(records, **settings):
    """Examine the records and return the last finding of each window."""
    detector, state, findings = MultiReceiver(MultiReceiverSettings(**settings)), None, {}
    for window in make_windows(records):
        findings.setdefault(window.start_gpst, set())
        evidence, state = detector.examine(window, state)
        for e in evidence:
            findings[e.start_gpst] |= {e.says}
    return [findings[start] for start in sorted(findings)]


def test_an_undecided_true_sky_is_authentic_in_two_minutes():
    records = make_scene().records(np.random.default_rng(0))
    alone = [MultiReceiver(MultiReceiverSettings(**GIVEN["places"])).examine(w)[0] for w in make_windows(records)]
    assert {e.says for finding in alone for e in finding} == {"undecided"}
    assert all("authentic" in words for words in examine_records(records, **GIVEN["places"]))


def test_an_undecided_captured_pair_is_spoofed_in_two_minutes():
    records = make_scene(sky=(), false=(FalseSky(),)).records(np.random.default_rng(0))
    findings = examine_records(records, **GIVEN["places"])
    assert all("spoofed" in words for words in findings)


def test_nothing_is_added_where_nothing_is_known_of_the_antennas():
    records = make_scene().records(np.random.default_rng(0))
    assert {word for words in examine_records(records) for word in words} == {"undecided"}


def test_an_earlier_windows_evidence_states_how_long_it_took():
    records = make_scene().records(np.random.default_rng(0))
    detector, state, late = MultiReceiver(MultiReceiverSettings(**GIVEN["places"])), None, []
    for window in make_windows(records):
        evidence, state = detector.examine(window, state)
        late += [e for e in evidence if e.says == "authentic" and e.end_gpst < window.end_gpst]
    assert late
    assert {e.end_gpst - e.start_gpst for e in late} <= {w.end_gpst - w.start_gpst for w in make_windows(records)}
    assert {(e.code, e.data["satellites"]) for e in late} == {("as_known_over_time", 10)}
    assert all(e.p_value < 1e-3 and e.data["length_s"] > WINDOW_S for e in late)
    assert all("one_change" in e.data["assumes"] for e in late)


def test_what_is_remembered_is_bounded():
    records = make_scene(epochs=10 * (POLICY.longest_run_windows + 3), errors=TrackErrors(3.0, 0.9, 1.0)).records(
        np.random.default_rng(0)
    )
    detector, state, lengths = MultiReceiver(MultiReceiverSettings(**GIVEN["places"])), None, []
    for window in make_windows(records):
        _, state = detector.examine(window, state)
        lengths.append(len(state.runs[0].parts))
    assert lengths == [*range(1, POLICY.longest_run_windows + 1), *[POLICY.longest_run_windows] * 3]


def test_a_window_that_is_missing_begins_anew():
    first, _, third = list(make_windows(make_scene(epochs=30).records(np.random.default_rng(0))))
    detector = MultiReceiver(MultiReceiverSettings(**GIVEN["places"]))
    _, state = detector.examine(first)
    _, state = detector.examine(third, state)
    assert len(state.runs[0].parts) == 1


@pytest.mark.parametrize("given", GIVEN)
@pytest.mark.parametrize("since_s", [20.0, 33.0, 57.5, 71.0])
def test_a_run_that_ends_off_the_sky_is_not_authentic(given, since_s):
    clean, false = make_scene(epochs=90), make_scene(epochs=90, sky=(), false=(THERE,))
    for seed in range(2):
        findings = examine_records(
            take_over((clean.records(np.random.default_rng(seed)), clean), false, since_s), **GIVEN[given]
        )
        whole = int(np.ceil(since_s / WINDOW_S))
        assert not any("authentic" in words for words in findings[whole:])


@pytest.mark.long
@pytest.mark.parametrize("given", GIVEN)
@pytest.mark.parametrize("errors", [ERRORS, TrackErrors(1.0, 0.0, 1.0), TrackErrors(0.5, 0.9, 0.5)], ids=str)
@pytest.mark.parametrize("kind", ["captured", "clean", "taken over", "for a while"])
def test_no_window_is_wrong_more_often_than_stated(given, errors, kind):
    runs, rate, draw = 60, 0.01, np.random.default_rng(1)
    clean, false = (make_scene(epochs=120, errors=errors, **o) for o in ({}, {"sky": (), "false": (THERE,)}))
    wrong = 0
    for _ in range(runs):
        since_s = {"captured": -1.0, "clean": np.inf}.get(kind, draw.uniform(10.0, 110.0))
        until_s = since_s + draw.uniform(20.0, 60.0) if kind == "for a while" else np.inf
        records = take_over((clean.records(draw), clean), false, since_s, until_s)
        findings = examine_records(records, false_alarm_probability=rate, **GIVEN[given])
        edges_s = WINDOW_S * np.arange(len(findings))
        whole = [since_s <= start + 1.0 and until_s >= start + WINDOW_S for start in edges_s]
        none = [since_s >= start + WINDOW_S + 1.0 or until_s <= start for start in edges_s]
        wrong += any("authentic" in words for words, is_false in zip(findings, whole, strict=True) if is_false)
        wrong += any({"spoofed", "attack"} & words for words, is_true in zip(findings, none, strict=True) if is_true)
    assert binomial_survival(wrong, runs, rate) > 1e-3
