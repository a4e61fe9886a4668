"""Whole decisions on records at measurement level: who is named what, and who is not."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.multi_receiver.common_epochs import align_ranges
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.one_antenna import TrackNoise
from skyproof.detectors.multi_receiver.pairing import pair_up
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.errors import SettingsError
from skyproof.fusion.open_question import open_question
from skyproof.navigation.sets import find_consistent_sets
from skyproof.records import OBSERVABLES, Cause, SignalId, SignalRef
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

ERRORS = TrackErrors(sigma_m=1.0, correlation=0.5, constant_m=1.0)
PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (24.0, 18.0, 0.0), "rx3": (-20.0, 15.0, 2.0)}
DISTANCE_M = 30.0  # of rx1 and rx2
PAIR = {name: PLACES[name] for name in ("rx1", "rx2")}
MEACONER = FalseSky()


def scene(receivers=2, **changes):
    options = {"antennas_enu_m": dict(list(PLACES.items())[:receivers]), "errors": ERRORS, "epochs": 20}
    return MeasuredScene(**(options | changes))


def examine(records, **settings):
    return MultiReceiver(MultiReceiverSettings(**settings)).examine(records)[0]


def list_named(evidence, says):
    """List {(receiver, copy)} of the signals that findings of this kind name."""
    return {(ref.receiver, ref.signal.copy) for e in evidence if e.says == says for ref in e.signals}


def state_places(receivers=2):
    """Return the places of the antennas as settings."""
    return {"antennas_enu_m": dict(list(PLACES.items())[:receivers])}


def drop_carriers(records):
    observations = (replace(o, carrier_cyc=np.full_like(o.carrier_cyc, np.nan)) for o in records.observations)
    return replace(records, observations=tuple(observations))


def make_rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("receivers", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_clean_sky_over_known_antennas_is_authentic(receivers, seed):
    evidence = examine(scene(receivers).records(make_rng(seed)), **state_places(receivers))
    assert [e.says for e in evidence] == ["authentic"]
    assert len({ref.receiver for ref in evidence[0].signals}) == receivers
    assert evidence[0].p_value < evidence[0].alpha
    assert evidence[0].statistic > evidence[0].threshold


@pytest.mark.parametrize("receivers", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_meaconed_pair_is_spoofed_and_the_sky_beside_it_true(receivers, seed):
    evidence = examine(scene(receivers, false=(MEACONER,)).records(make_rng(seed)))
    names = list(PLACES)[:receivers]
    assert list_named(evidence, "spoofed") == {(name, "b") for name in names}
    assert list_named(evidence, "authentic") == {(name, "a") for name in names}
    assert len({e.group for e in evidence}) == 2
    false = next(e for e in evidence if e.says == "spoofed")
    assert false.log_likelihood_ratio > 9.0


@pytest.mark.parametrize("satellites", [6, 10])
def test_one_antennas_sky_of_few_satellites_may_be_echoes(satellites):
    # Three of six signals that were echoes fitted a wrong place beside the other receiver's, once in twenty hours of
    # walls (`bench/no_attack.py --only walls`): a clean sky was spoofed with a p-value of 1e-27.
    made = scene(sky=(), false=(MEACONER,), max_satellites=satellites, errors=TrackErrors(0.3, 0.0, 0.3))
    records = drop_carriers(made.records(make_rng(4)))
    (finding,) = examine(records, **state_places(), false_alarm_probability=1e-6)
    assert finding.says == ("spoofed" if satellites == 10 else "undecided")
    if satellites == 6:
        assert finding.code == "one_antenna_or_few_echoes"
        assert finding.failed
        assert finding.may_also_be[0] == "reflections"


def test_searched_sets_serve_as_well_as_the_true_ones():
    records = scene(false=(MEACONER,)).records(make_rng())
    found = tuple(s for o in records.observations for s in find_consistent_sets(o, records.navigation))
    evidence = examine(replace(records, sets=found))
    assert list_named(evidence, "spoofed") == {("rx1", "b"), ("rx2", "b")}
    assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx2", "a")}


def test_captured_receivers_are_never_named_authentic():
    records = scene(sky=(), false=(MEACONER,)).records(make_rng())
    undecided = examine(records)
    assert list_named(undecided, "authentic") == set()
    spoofed = examine(records, antenna_separation_m=20.0)
    assert list_named(spoofed, "spoofed") == {("rx1", "a"), ("rx2", "a")}
    assert (spoofed[0].code, spoofed[0].data["limit_m"]) == ("one_antenna_if_apart", 20.0)


def test_possibly_one_antenna_leaves_captured_receivers_open():
    evidence = examine(scene(sky=(), false=(MEACONER,)).records(make_rng()), antenna_separation_m=0.0)
    assert [(e.says, e.code) for e in evidence] == [("undecided", "one_antenna_or_sky")]
    assert not evidence[0].data["antennas_known"]


def test_a_clean_sky_over_antennas_too_near_to_tell_is_undecided():
    near = {"rx1": (0.0, 0.0, 0.0), "rx2": (3.0, 0.0, 0.0)}
    records = drop_carriers(scene(antennas_enu_m=near).records(make_rng()))
    (open_,) = examine(records, antennas_enu_m=near)
    assert (open_.code, open_.data["carriers"], open_.data["antennas_known"]) == ("one_antenna_or_sky", "missing", True)
    evidence = examine(records, antenna_separation_m=2.0)
    assert [(e.says, e.code) for e in evidence] == [("undecided", "one_antenna_or_sky")]
    assert evidence[0].p_value > evidence[0].alpha  # of one antenna: the test was made


def test_antennas_beyond_the_allowed_distance_are_reported():
    (evidence,) = examine(scene().records(make_rng()), max_separation_m=10.0)
    assert (evidence.code, evidence.data["limit_m"]) == ("too_far", 10.0)
    assert evidence.data["farthest_m"] == pytest.approx(DISTANCE_M, abs=5.0)
    assert evidence.failed
    assert evidence.may_also_be[0] == "statement"


def test_a_runs_reason_names_all_kinds_that_share_it():
    records = scene().records(make_rng())
    (of_one,) = examine(records)
    other_band = [SignalRef(ref.receiver, replace(ref.signal, band="L2", code="L")) for ref in of_one.signals]
    reason = open_question([replace(of_one, signals=tuple(other_band)), of_one], records.observations, set())
    assert (reason.finding, reason.also) == (of_one, ("G L2 L",))
    earlier = replace(of_one, signals=tuple(other_band), start_gpst=of_one.start_gpst - np.timedelta64(10, "s"))
    assert open_question([earlier, of_one], records.observations, set()).also == ()


@pytest.mark.parametrize("seed", range(3))
def test_a_clean_sky_without_a_distance_is_open_and_measured(seed):
    (evidence,) = examine(scene().records(make_rng(seed)))
    assert evidence.says == "undecided"
    assert (evidence.code, evidence.failed) == ("one_may_be_false", False)
    assert evidence.data["p_one_antenna"] < evidence.alpha
    assert evidence.p == {"false_sky": 1.0}
    ((distance_m, sigma_m),) = evidence.baselines[0].distances_m
    assert abs(distance_m - DISTANCE_M) < 4.0 * sigma_m
    assert sigma_m < 4.0


@pytest.mark.parametrize("seed", range(3))
def test_a_clean_sky_at_a_known_distance_is_authentic(seed):
    evidence = examine(scene().records(make_rng(seed)), antenna_distance_m=DISTANCE_M)
    assert [e.says for e in evidence] == ["authentic"]
    assert evidence[0].data["assumes"] == ("no_concert", "distance_as_stated_and_not_shown")
    assert (evidence[0].data["distance_m"], evidence[0].data["distance_sigma_m"]) == (DISTANCE_M, 0.75)


@pytest.mark.parametrize("shows_enu_m", [(500.0, 300.0, 5.0), (60.0, 40.0, 0.0), (24.0, -30.0, 2.0)])
@pytest.mark.parametrize("known", [{"antenna_distance_m": DISTANCE_M}, {"antennas_enu_m": PAIR}, {}], ids=str)
def test_a_false_and_a_true_sky_are_never_authentic(known, shows_enu_m):
    attack = replace(MEACONER, receivers=("rx2",), shows_enu_m=shows_enu_m)
    evidence = examine(scene(sky=("rx1",), false=(attack,)).records(make_rng()), **known)
    assert [e.says for e in evidence] == (["attack"] if known else ["undecided"])
    assert evidence[0].code in (("elsewhere_than_known",) if known else ("one_may_be_false", "too_far"))


@pytest.mark.parametrize(("count", "says"), [(6, "undecided"), (10, "attack")])
def test_few_misplaced_signals_may_be_echoes_many_are_not(count, says):
    attack = replace(MEACONER, receivers=("rx2",))
    records = scene(sky=("rx1",), false=(attack,), max_satellites=count).records(make_rng())
    (e,) = examine(records, false_alarm_probability=1e-6, **state_places())
    assert e.says == says
    assert e.code == ("elsewhere_by_few" if says == "undecided" else "elsewhere_than_known")


def test_what_was_given_wrong_is_the_reason_that_is_reported():
    records = scene().records(make_rng())
    reason = open_question(examine(records, antenna_distance_m=45.0), records.observations, set())
    assert (reason.finding.code, reason.finding.data["distance_m"]) == ("elsewhere_than_known", 45.0)


def test_hitting_the_distance_does_not_hide_wrong_places():
    # The false place of rx2 is 30 m from rx1 as the true one is, in another direction.
    attack = replace(MEACONER, receivers=("rx2",), shows_enu_m=(-18.0, 24.0, 0.0))
    records = scene(sky=("rx1",), false=(attack,)).records(make_rng())
    assert [e.says for e in examine(records, antennas_enu_m=PAIR)] == ["attack"]
    fooled = examine(records, antenna_distance_m=DISTANCE_M)
    assert all("distance_as_stated_and_not_shown" in e.data["assumes"] for e in fooled)


def test_one_captured_of_three_is_found_and_the_others_stay():
    attack = replace(MEACONER, receivers=("rx3",))
    evidence = examine(scene(3, sky=("rx1", "rx2"), false=(attack,)).records(make_rng()), **state_places(3))
    assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx2", "a")}
    assert list_named(evidence, "attack") == {("rx3", "a")}


def test_two_captured_of_three_are_never_authentic():
    attack = replace(MEACONER, receivers=("rx2", "rx3"))
    evidence = examine(scene(3, sky=("rx1",), false=(attack,)).records(make_rng()), **state_places(3))
    assert list_named(evidence, "authentic") == set()
    assert list_named(evidence, "attack") == {("rx1", "a"), ("rx2", "a"), ("rx3", "a")}


def make_windows(*scenes, seed=0):
    """Make records of scenes, one after the other."""
    draw = make_rng(seed)
    return [s.records(draw) for s in scenes]


def review_all(records, **settings):
    detector = MultiReceiver(MultiReceiverSettings(**settings))
    return list(detector.review([e for r in records for e in detector.examine(r)[0]]))


def test_windows_with_both_skies_support_the_same_baseline():
    with_both = scene(false=(MEACONER,))
    evidence = review_all(make_windows(scene(), with_both, with_both, scene()))
    assert {e.says for e in evidence} == {"authentic", "spoofed"}
    assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx2", "a")}


def test_windows_with_both_skies_do_not_support_a_captured_one():
    with_both = scene(false=(MEACONER,))
    captured = scene(sky=("rx1",), false=(replace(MEACONER, receivers=("rx2",), shows_enu_m=(60.0, 40.0, 0.0)),))
    evidence = review_all(make_windows(captured, with_both, with_both, captured))
    assert [e.says for e in evidence if e.baselines] == ["undecided", "authentic", "authentic", "undecided"]


def test_signals_that_may_be_of_a_false_antenna_stay_open():
    # A baseline that other windows show is no sign that an antenna of false signals did not send them.
    detector = MultiReceiver()
    found = [e for r in make_windows(*3 * [scene(false=(MEACONER,))]) for e in detector.examine(r)[0]]
    (last,) = (e for e in found[-2:] if e.says == "authentic")
    open_ = replace(last, code="few_without_doubtful", p={Cause.FALSE_SKY: 1.0}, data={**last.data, "found": last.code})
    after = list(detector.review([open_ if e is last else e for e in found]))
    assert [e.says for e in after if e.baselines] == ["authentic", "authentic", "undecided"]


def test_moving_antennas_support_their_own_windows_only():
    moved = {"rx1": (0.0, 0.0, 0.0), "rx2": (-20.0, 22.0, 0.0)}
    with_both = [scene(false=(MEACONER,)), scene(false=(MEACONER,), antennas_enu_m=moved)]
    evidence = review_all(make_windows(scene(), *with_both, scene(antennas_enu_m=moved)))
    assert [e.says for e in evidence if e.baselines] == ["undecided", "authentic", "authentic", "undecided"]


@pytest.mark.parametrize("axis", range(2), ids=["east", "north"])
def test_a_sky_dragged_off_late_in_a_window_is_not_authentic(axis):
    # By 20 m in its last two seconds: its mean over the window is 2 m off.
    records = scene(errors=TrackErrors(0.5, 0.0, 0.3), step_s=0.5).records(make_rng())
    first, second = records.observations
    towards = pair_up(records, records.sets, TrackNoise(), min_satellites=5).unit_enu[:, axis]
    away_m = np.concatenate([np.zeros(16), np.linspace(0.0, 20.0, 4)])
    drawn = replace(second, pseudorange_m=second.pseudorange_m - away_m[:, None] * towards)
    assert list_named(examine(records, **state_places()), "authentic")
    (open_,) = examine(replace(records, observations=(first, drawn)), **state_places())
    assert open_.failed
    assert "motion" in open_.may_also_be


def misstate_noise(records, thermal_m):
    """Return the records with another thermal noise than the errors have."""
    observed = [
        replace(o, pseudorange_sigma_m=np.full_like(o.pseudorange_sigma_m, thermal_m)) for o in records.observations
    ]
    return replace(records, observations=tuple(observed))


@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.98])
def test_bounded_errors_fail_no_more_often_than_stated(correlation):
    # They swing as far as one sigma of 3 m makes them, which is the bound.
    made, numbers = scene(errors=TrackErrors(3.0, correlation, 0.0)), make_rng(5)
    noise = TrackNoise(bound_m=3.0)
    p_values = []
    for _ in range(150):
        records = misstate_noise(made.records(numbers), 0.1)
        p_values.append(pair_up(records, records.sets, noise, min_satellites=5).swing_p_value)
    assert np.mean(np.array(p_values) < 0.05) < 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 150)
    assert correlation or min(p_values) < 0.3  # of white noise it is no idle bound


@pytest.mark.parametrize(("thermal_m", "fails"), [(0.5, True), (8.0, False)])
def test_larger_errors_fail_unless_noise_is_stated_so(thermal_m, fails):
    records = misstate_noise(scene(errors=TrackErrors(8.0, 0.5, 0.0)).records(make_rng()), thermal_m)
    pairing = pair_up(records, records.sets, TrackNoise(bound_m=3.0), min_satellites=5)
    assert (pairing.swing_p_value < 1e-20) is fails


def test_a_jammer_beside_receivers_makes_no_suspicion():
    # Half of the window is jammed: C/N0 states the noise of 6 m, which is beyond the bound of slow errors.
    records = scene(errors=TrackErrors(1.0), step_s=0.5).records(make_rng())
    numbers, jammed = make_rng(3), []
    for o in records.observations:
        late = np.arange(o.gpst.size)[:, None] >= o.gpst.size // 2
        noise_m = np.where(late, numbers.normal(0.0, 6.0, o.pseudorange_m.shape), 0.0)
        sigma_m = np.where(late, 6.0, o.pseudorange_sigma_m)
        jammed.append(replace(o, pseudorange_m=o.pseudorange_m + noise_m, pseudorange_sigma_m=sigma_m))
    assert not any(e.failed for e in examine(replace(records, observations=tuple(jammed)), **state_places()))


def test_a_known_baseline_settles_what_one_set_each_leaves_open():
    assert list_named(examine(scene().records(make_rng()), antennas_enu_m=PAIR), "authentic") == {
        ("rx1", "a"),
        ("rx2", "a"),
    }
    captured = scene(sky=(), false=(MEACONER,)).records(make_rng())
    assert list_named(examine(captured, antennas_enu_m=PAIR), "spoofed") == {("rx1", "a"), ("rx2", "a")}


@pytest.mark.parametrize("other", ["sky", "false"])
def test_two_skies_beside_one_need_a_baseline(other):
    attack = MEACONER if other == "false" else replace(MEACONER, receivers=("rx1",))
    records = scene(sky=("rx1",) if other == "false" else None, false=(attack,)).records(make_rng())
    evidence = examine(records, antenna_separation_m=0.0)
    assert [(e.says, e.code) for e in evidence] == [("attack", "several_skies")]
    certain = examine(records, antennas_enu_m=PAIR)
    if other == "sky":
        assert list_named(certain, "authentic") == {("rx1", "a"), ("rx2", "a")}
        assert list_named(certain, "spoofed") == {("rx1", "b")}  # a second sky beside the true one
        assert [e.whole_sky for e in certain if e.says == "spoofed"] == [True]
    else:
        assert list_named(certain, "spoofed") == {("rx1", "b"), ("rx2", "a")}
        assert list_named(certain, "authentic") == set()


@pytest.mark.parametrize("known", [{"antenna_distance_m": DISTANCE_M}, {"antennas_enu_m": PAIR}, {}], ids=str)
@pytest.mark.parametrize("reached", [("rx1", "rx2"), ("rx2",)], ids=str)
@pytest.mark.parametrize("seed", range(4))
def test_a_false_sky_at_the_true_place_makes_no_signal_false(seed, reached, known):
    # What rx1 gets from the sky and rx2 from the transmitter show one place as well.
    meaconer = replace(MEACONER, shows_enu_m=(0.0, 0.0, 0.0), receivers=reached)
    evidence = examine(scene(false=(meaconer,)).records(make_rng(seed)), **known)
    assert not {("rx1", "a"), ("rx2", "a")} & list_named(evidence, "spoofed")
    assert not {("rx1", "b"), ("rx2", "b")} & list_named(evidence, "authentic")
    if reached == ("rx2",) and known:
        assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx2", "a")}
        assert list_named(evidence, "spoofed") == {("rx2", "b")}


def test_two_false_skies_are_two_groups():
    second = FalseSky(antenna_enu_m=(-500.0, 100.0, 20.0), shows_enu_m=(-900.0, 300.0, 5.0), delay_m=700.0)
    evidence = examine(scene(false=(MEACONER, second)).records(make_rng()))
    groups = {e.group: {ref.signal.copy for ref in e.signals} for e in evidence}
    assert sorted(map(sorted, groups.values())) == [["a"], ["b"], ["c"]]
    assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx2", "a")}


def test_a_receiver_without_a_set_is_left_out():
    records = scene(3, false=(MEACONER,)).records(make_rng())
    evidence = examine(replace(records, sets=tuple(s for s in records.sets if s.receiver != "rx2")))
    assert list_named(evidence, "spoofed") == {("rx1", "b"), ("rx3", "b")}
    assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx3", "a")}


def test_one_sky_does_not_hide_what_two_others_see():
    attack = replace(MEACONER, receivers=("rx1", "rx2"))
    evidence = examine(scene(3, false=(attack,)).records(make_rng()))
    assert list_named(evidence, "spoofed") == {("rx1", "b"), ("rx2", "b")}
    assert list_named(evidence, "authentic") == {("rx1", "a"), ("rx2", "a")}


def test_signals_that_one_lacks_are_named_if_false_only():
    records = scene(false=(MEACONER,)).records(make_rng())
    cut = [replace(s, signals=s.signals[2:]) if s.receiver == "rx2" else s for s in records.sets]
    evidence = examine(replace(records, sets=tuple(cut)))
    gone = {s.sat for s in records.sets[0].signals[:2]}
    named_copies = {(e.says, ref.signal.copy) for e in evidence for ref in e.signals if ref.signal.sat in gone}
    assert named_copies == {("spoofed", "b")}
    assert {e.says for e in evidence} == {"authentic", "spoofed"}


def test_too_few_common_satellites_are_reported():
    records = scene().records(make_rng())
    cut = [replace(s, signals=s.signals[:4]) if s.receiver == "rx2" else s for s in records.sets]
    (evidence,) = examine(replace(records, sets=tuple(cut)))
    assert evidence.says == "undecided"
    assert evidence.code == "few_in_common"
    assert examine(replace(records, sets=tuple(cut)), min_satellites=4)[0].code != evidence.code


def test_without_navigation_the_groups_are_still_decided():
    records = replace(scene(false=(MEACONER,)).records(make_rng()), navigation=None)
    evidence = examine(records)
    assert list_named(evidence, "spoofed") == {("rx1", "b"), ("rx2", "b")}


def test_clocks_and_epochs_that_differ_do_not_show():
    quiet = TrackErrors(sigma_m=0.01)
    offset = scene(sky=(), false=(MEACONER,), errors=quiet, clock_bias_s=(9e-4, -9e-4), first_epoch_s=(0.0, 0.45))
    records = offset.records(make_rng())
    ranges = align_ranges(records, records.sets).range_m
    difference_m = ranges[:, :, 1] - ranges[:, :, 0]
    contrast_m = difference_m - difference_m.mean(axis=1, keepdims=True)
    # 0.45 s by Dopplers with 0.1 Hz noise is 9 mm, the curvature of the range over 0.45 s up to 13 mm.
    assert contrast_m.std() < 0.03
    assert len(ranges) == 20


def test_holes_cost_the_satellite_or_the_epoch_that_has_them():
    records = scene(epochs=20).records(make_rng())
    first, second = records.observations
    pseudorange_m = second.pseudorange_m.copy()
    pseudorange_m[:15, 0] = np.nan  # most of one satellite
    pseudorange_m[5:8, 3] = np.nan  # a little of another
    poorer = replace(records, observations=(first, replace(second, pseudorange_m=pseudorange_m)))
    ranges = align_ranges(poorer, poorer.sets)
    assert second.signals[0].sat not in ranges.sats
    assert second.signals[3].sat in ranges.sats
    assert ranges.range_m.shape[0] == 17
    assert ranges.gaps.max() == pytest.approx(4.0, abs=1e-6)
    assert [e.says for e in examine(poorer, **state_places())] == ["authentic"]


def test_no_common_time_is_reported():
    records = scene().records(make_rng())
    first, second = records.observations
    later = replace(second, gpst=second.gpst + np.timedelta64(3600, "s"))
    (evidence,) = examine(replace(records, observations=(first, later)))
    assert (evidence.says, evidence.code) == ("undecided", "few_common_epochs")


@pytest.mark.parametrize(
    "wrong", [{"false_alarm_probability": 0.0}, {"min_satellites": 3}, {"min_epochs": 3}, {"correlation_max": 1.0}]
)
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        MultiReceiverSettings(**wrong)


@pytest.mark.long
@pytest.mark.parametrize("errors", [ERRORS, TrackErrors(1.0, 0.9, 1.0), TrackErrors(3.0, 0.9, 1.0)], ids=str)
@pytest.mark.parametrize("sats", [7, 12])
def test_no_label_is_wrong_more_often_than_stated(sats, errors):
    windows, rate = 500, 0.01
    near = {"rx1": (0.0, 0.0, 0.0), "rx2": (4.0, 3.0, 0.0)}  # where mistakes would be made
    with_both = scene(antennas_enu_m=near, epochs=15, errors=errors, false=(MEACONER,), max_satellites=sats)
    captured = scene(antennas_enu_m=near, epochs=15, errors=errors, sky=(), false=(MEACONER,), max_satellites=sats)
    clean = scene(antennas_enu_m=near, epochs=15, errors=errors, max_satellites=sats)
    draw = make_rng(1)
    wrong = np.zeros(3)
    for _ in range(windows):
        found = [examine(s.records(draw), false_alarm_probability=rate) for s in (with_both, captured, clean)]
        copies = [{copy for _, copy in list_named(found[0], says)} for says in ("authentic", "spoofed")]
        wrong += [
            "b" in copies[0] or "a" in copies[1],
            bool(list_named(found[1], "authentic")),
            bool(list_named(found[2], "spoofed") | list_named(found[2], "attack")),
        ]
    assert np.all(wrong <= 13)  # 5 expected at most


def keep_few_satellites(records, satellites):
    """Return the records of their first satellites alone, each with signals of four kinds."""
    kinds = (("L1", "CA"), ("L2", "L"), ("L5", "Q"), ("L1", "C"))

    def repeated(o):
        columns = np.tile(np.arange(satellites), len(kinds))
        cells = {
            name: getattr(o, name)[:, columns] for name in (*OBSERVABLES, "status", "half_cycle_open", "quadrature_m")
        }
        known = {name: getattr(o, name)[columns] for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")}
        signals = tuple(SignalId(o.signals[k].sat, *kind) for kind in kinds for k in range(satellites))
        return replace(o, signals=signals, **cells, **known)

    observations = tuple(repeated(o) for o in records.observations)
    sets = tuple(replace(chosen, signals=observations[0].signals) for chosen in records.sets)
    return replace(records, observations=observations, sets=sets)


@pytest.mark.parametrize(("satellites", "known"), [(3, False), (4, True)])
def test_many_signals_of_three_satellites_show_no_baseline(satellites, known):
    records = keep_few_satellites(scene().records(make_rng()), satellites)
    pairing = pair_up(records, records.sets, TrackNoise(), min_satellites=5)
    assert (pairing.unit_enu is not None) is known
    assert np.isfinite(pairing.one_antenna.p_value)
    assert pairing.at_least_p_value(100.0) == 1.0 or known
